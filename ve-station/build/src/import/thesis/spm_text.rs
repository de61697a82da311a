//! An SPM as text. A split names its new faces and their neighbours:
//!
//! `v* i vs vu vt cu ct dxu dyu dzu dxt dyt dzt vol n_vol vol n_vol p_vsp & face & face`, where
//! `cu` and `ct` are the children's numbers in the CDPM of the same splits, and a `face` is
//!
//! `number leaf [neighbour corner vsp] [neighbour corner vsp]`: its sign is its turn, a neighbour's
//! plus says that it goes to vu, its minus to vt; `corner` (1 to 3) is where the neighbour has the
//! third vertex, `vsp` made it.
//!
//! So what a split does to the faces round vs follows from the neighbours, as in [`ActiveMesh`],
//! which does it.

use super::{Fields, check_count, keyword_lines, refused, sum};
use crate::edges::neighbours;
use crate::error::BuildError;
use crate::mesh::SoupMesh;
use ab_tree::leaf_key;
use spm::{
    ActiveMesh, Certified, CertifiedCode, NONE, OperationError, OperationFaces, Sizes, VspRecord,
};

/// What the lines say.
#[derive(Default)]
struct Text {
    /// Faces and vertices that the base mesh has by `b`.
    base: Option<[u64; 2]>,
    /// Faces, vertices and splits that there are by `$`.
    full: Option<[u64; 3]>,
    /// By vertex of ours: base vertices, then two a split.
    positions: Vec<[f64; 3]>,
    /// For every vertex of the file ours.
    vertex: Vec<u32>,
    base_faces: Vec<[u32; 3]>,
    /// For every face of the file ours, [`NONE`] for a number left out.
    face: Vec<u32>,
    splits: Vec<Split>,
}

struct Split {
    line: u64,
    vs: u32,
    fn_: [u32; 4],
    has_right: bool,
}

/// A new face of a split.
struct NewFace {
    /// Its number in the file, from 1.
    number: u64,
    /// Neighbours on the sides of vu and vt.
    sides: [u32; 2],
}

pub(super) fn read(text: &[u8]) -> Result<SoupMesh, BuildError> {
    let mut read = Text::default();
    for (keyword, mut fields) in keyword_lines(text) {
        let splits = !read.splits.is_empty();
        match keyword {
            "v" if !splits => {
                vertex(&mut fields, &mut read).ok_or_else(|| fields.bad("no next vertex"))?;
            }
            "f" if !splits => {
                face(&mut fields, &mut read).ok_or_else(|| fields.bad("no next face"))?;
            }
            "v*" => {
                let split = split(&mut fields, &mut read);
                let split = split.ok_or_else(|| fields.bad("no next split"))?;
                read.splits.push(split);
            }
            "b" => {
                let base = counts(&mut fields);
                read.base = Some(base.ok_or_else(|| fields.bad("no line of counts"))?);
            }
            "$" => {
                let full = counts(&mut fields);
                read.full = Some(full.ok_or_else(|| fields.bad("no line of counts"))?);
            }
            // The cells say which region comes when.
            _ if keyword.parse::<u32>().is_ok() => {}
            _ => return Err(fields.bad("no line of an SPM text")),
        }
    }
    check_counts(&read)?;
    let mesh = refined(&read)?;
    let faces = read.full.map_or(0, |[faces, ..]| faces);
    check_count("faces", faces, mesh.triangles.len())?;
    Ok(mesh)
}

/// The numbers of a line of counts.
fn counts<'a, const N: usize>(
    fields: &mut Fields<'a, impl Iterator<Item = &'a str>>,
) -> Option<[u64; N]> {
    let mut counts = [0; N];
    for count in &mut counts {
        *count = u64::try_from(fields.integer()?).ok()?;
    }
    Some(counts)
}

/// Refuses a text whose lines are not as many as it says: refined by the splits that are left it
/// would be a coarser mesh.
fn check_counts(read: &Text) -> Result<(), BuildError> {
    let (Some([faces, vertices]), Some([.., splits])) = (read.base, read.full) else {
        return Err(refused(
            "it has no line that starts with b, or none that starts with $",
        ));
    };
    let own = read.positions.len() - 2 * read.splits.len();
    check_count("faces of the base mesh", faces, read.base_faces.len())?;
    check_count("vertices of the base mesh", vertices, own)?;
    check_count("splits", splits, read.splits.len())
}

/// `number x y z`.
fn vertex<'a>(
    fields: &mut Fields<'a, impl Iterator<Item = &'a str>>,
    read: &mut Text,
) -> Option<()> {
    let number = fields.index()?;
    if number as usize != read.positions.len() {
        return None;
    }
    read.positions.push(fields.vector()?);
    read.vertex.push(number);
    Some(())
}

/// `number a b c leaf`.
fn face<'a>(fields: &mut Fields<'a, impl Iterator<Item = &'a str>>, read: &mut Text) -> Option<()> {
    let number = fields.index()?;
    if number as usize != read.base_faces.len() {
        return None;
    }
    let corners = [fields.index()?, fields.index()?, fields.index()?];
    read.base_faces.push(corners);
    read.face.push(number);
    Some(())
}

/// A line of a split, after `v*`: adds its children and its faces to what was read.
fn split<'a>(
    fields: &mut Fields<'a, impl Iterator<Item = &'a str>>,
    read: &mut Text,
) -> Option<Split> {
    let i = u32::try_from(read.splits.len()).ok()?;
    let vs = split_vertex(fields, read, i)?;
    fields.integer()?;
    fields.integer()?;
    let (of_u, of_t) = (fields.vector()?, fields.vector()?);
    for _ in 0..5 {
        fields.integer()?;
    }
    if fields.words.next()? != "&" {
        return None;
    }
    let (faces, swapped) = new_faces(fields, read)?;
    let mut fn_ = [NONE; 4];
    for (sides, face) in fn_.chunks_mut(2).zip(&faces) {
        if let Some(face) = face {
            sides.copy_from_slice(&face.sides);
        }
    }
    let has_right = faces[1].is_some();
    number_faces(&faces, i, read)?;
    let parent = read.positions[vs as usize];
    let (u, t) = (sum(parent, of_u), sum(parent, of_t));
    let own = read.positions.len() as u32;
    if swapped {
        read.positions.extend([t, u]);
        read.vertex.extend([own + 1, own]);
    } else {
        read.positions.extend([u, t]);
        read.vertex.extend([own, own + 1]);
    }
    Some(Split {
        line: fields.line,
        vs,
        fn_,
        has_right,
    })
}

/// `i vs vu vt`: our number of vs, when i, vu and vt are the next numbers.
fn split_vertex<'a>(
    fields: &mut Fields<'a, impl Iterator<Item = &'a str>>,
    read: &Text,
    i: u32,
) -> Option<u32> {
    let vertices = read.vertex.len();
    let number = fields.index()?;
    let (own, vs, vu, vt) = (number, fields.index()?, fields.index()?, fields.index()?);
    if own != i || vu as usize != vertices || vt as usize != vertices + 1 {
        return None;
    }
    read.vertex.get(vs as usize).copied()
}

/// The left and the right face of a split, and whether the children change places for them.
///
/// Left is the face that turns (first, second). Where there is only the other, the children change
/// places.
fn new_faces<'a>(
    fields: &mut Fields<'a, impl Iterator<Item = &'a str>>,
    read: &Text,
) -> Option<([Option<NewFace>; 2], bool)> {
    let mut faces = [None, None];
    let mut more = true;
    while more {
        let (turn, sides, and) = new_face(fields, read)?;
        let number = turn.unsigned_abs();
        let place: &mut Option<NewFace> = &mut faces[usize::from(turn < 0)];
        if place.replace(NewFace { number, sides }).is_some() {
            return None;
        }
        more = and;
    }
    let swapped = faces[0].is_none();
    if swapped {
        faces.swap(0, 1);
        // Plus and minus change places with the children.
        for face in faces.iter_mut().flatten() {
            face.sides.swap(0, 1);
        }
    }
    Some((faces, swapped))
}

/// Enters the new faces of split `i` under their numbers in the file.
fn number_faces(faces: &[Option<NewFace>; 2], i: u32, read: &mut Text) -> Option<()> {
    let base_faces = u32::try_from(read.base_faces.len()).ok()?;
    let mut numbers = Vec::new();
    for (k, face) in (0u32..).zip(faces) {
        let Some(face) = face else { continue };
        let own = base_faces.checked_add(2 * i)?.checked_add(k)?;
        numbers.push((usize::try_from(face.number).ok()?.checked_sub(1)?, own));
    }
    numbers.sort_unstable();
    for (number, own) in numbers {
        // Numbers ascend; where a split makes one face a second number may be left out.
        let end = read.base_faces.len() + 2 * i as usize + 2;
        if number < read.face.len() || number >= end {
            return None;
        }
        read.face.resize(number, NONE);
        read.face.push(own);
    }
    Some(())
}

/// A new face: its signed number, its neighbours on the sides of vu and vt, and whether another one
/// follows.
fn new_face<'a>(
    fields: &mut Fields<'a, impl Iterator<Item = &'a str>>,
    read: &Text,
) -> Option<(i64, [u32; 2], bool)> {
    let number = fields.integer()?;
    fields.integer()?;
    let mut sides = [NONE; 2];
    let mut and = false;
    while let Some(word) = fields.words.next() {
        if word == "&" {
            and = true;
            break;
        }
        let neighbour: i64 = word.parse().ok()?;
        let face = usize::try_from(neighbour.unsigned_abs().checked_sub(1)?).ok()?;
        let side = &mut sides[usize::from(neighbour < 0)];
        if *side != NONE {
            return None;
        }
        *side = *read.face.get(face).filter(|&&face| face != NONE)?;
        fields.integer()?;
        fields.integer()?;
    }
    (number != 0).then_some((number, sides, and))
}

/// The full mesh.
fn refined(read: &Text) -> Result<SoupMesh, BuildError> {
    let vsps = read.splits.len() as u32;
    let base_faces = read.base_faces.len() as u32;
    let sizes = Sizes {
        base_vertices: read.positions.len() as u32 - 2 * vsps,
        base_faces,
        vsps,
        faces: base_faces.saturating_add(2 * vsps),
    };
    if base_faces == 0 {
        return Err(refused("its base mesh has no face"));
    }
    let mut mesh = base_mesh(read, sizes)?;
    let leaf = leaf_key(0, sizes.faces);
    let mut out = OperationFaces::new();
    for (i, split) in (0u32..).zip(&read.splits) {
        let record = VspRecord {
            i,
            vs: split.vs,
            fn_: split.fn_,
            leaf_l: leaf,
            leaf_r: if split.has_right { leaf } else { NONE },
            // Positions stay in f64, outside.
            pos_t: [0.0; 3],
            pos_u: [0.0; 3],
            certified: [CertifiedCode::default(); 2],
            e: 0,
        };
        let refused = |reason: &str| BuildError::Line {
            line: split.line,
            reason: reason.to_string(),
        };
        let unfit = || refused("the split does not fit the mesh so far: correct it");
        record.validate(i, sizes).map_err(|_| unfit())?;
        mesh.load(i, &record, split.vs, split.fn_, [Certified::EXACT; 2]);
        if !mesh.split_is_legal(i) {
            return Err(unfit());
        }
        mesh.split(i, &mut out).map_err(|error| match error {
            OperationError::Damaged(_) => unfit(),
            OperationError::TooManyFaces(_) => refused(&format!(
                "the vertex has more than the {} faces round it that a split may change: export the full mesh in another format",
                OperationFaces::MAX_FACES
            )),
        })?;
    }
    Ok(used_vertices(&mesh, &read.positions))
}

/// The base mesh, with room for the splits.
fn base_mesh(read: &Text, sizes: Sizes) -> Result<ActiveMesh, BuildError> {
    let bad = |face: usize| {
        refused(&format!(
            "face {} of its base mesh names a vertex twice, or one that is not there",
            face + 1
        ))
    };
    // Before memory is taken for every number up to the largest.
    let is_beyond = |face: &[u32; 3]| face.iter().any(|&v| v >= sizes.base_vertices);
    if let Some(face) = read.base_faces.iter().position(is_beyond) {
        return Err(bad(face));
    }
    let neighbours = neighbours(&read.base_faces).ok_or_else(|| {
        refused(
            "an edge of its base mesh has more than two faces, or two that turn against each other",
        )
    })?;
    let mut mesh = ActiveMesh::new(sizes.base_vertices, sizes.base_faces, sizes.vsps);
    for (face, (&corners, &across)) in read.base_faces.iter().zip(&neighbours).enumerate() {
        mesh.set_base_face(face as u32, corners, across)
            .ok_or_else(|| bad(face))?;
    }
    Ok(mesh)
}

/// The active faces, over the vertices that they use.
fn used_vertices(mesh: &ActiveMesh, positions: &[[f64; 3]]) -> SoupMesh {
    let mut number = vec![NONE; positions.len()];
    let mut soup = SoupMesh::default();
    mesh.for_each_active_face(|face| {
        let corners = mesh.face(face).corners.map(|vertex| {
            let number = &mut number[vertex as usize];
            if *number == NONE {
                *number = soup.positions.len() as u32;
                soup.positions.push(positions[vertex as usize]);
            }
            *number
        });
        soup.triangles.push(corners);
    });
    soup
}
