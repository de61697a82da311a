//! The thesis's text formats, laid out as printed in its appendices; the reader in `build` says
//! what each field is. Where the print leaves it open: `vu` is our `vt`, cells are numbered along
//! x, then y, then z, and a leaf code is the place of the face in AB-tree order. All count from 1;
//! 0 is none.
//!
//! Differences are written with as many digits as it takes for the sum, as the reader forms it, to
//! give the same f32 again; where it cannot (a coordinate a billion times smaller than its
//! parent's) all seventeen.

use super::Front;
use crate::tuning::inspect::DIVISIONS;
use ab_tree::depth;
use spm::{ActiveMesh, NONE, OperationFaces, Sizes, VspRecord};
use std::io::{self, Write};

pub(super) fn write_cdpm(front: &Front, out: &mut impl Write) -> io::Result<()> {
    let mut replay = Replay::new(front);
    write_counts(front, out)?;
    for vertex in 0..front.header.base_vertices {
        let position = replay.base_position(vertex);
        writeln!(out, "v {position}")?;
    }
    for face in 0..front.header.base_faces {
        let [a, b, c] = front.base.face(face).corners.map(|v| v + 1);
        writeln!(out, "f {a} {b} {c}")?;
    }
    for record in &front.splits {
        let split = replay.split(record);
        write!(out, "v* {} {}", split.vs_cdpm, split.differences)?;
        for (third, sign) in split.thirds.into_iter().flatten().zip(["", "-"]) {
            write!(out, " {sign}{}", replay.cdpm[third as usize])?;
        }
        let mesh = &replay.mesh;
        let vt = front.header.sizes().vt(record.i);
        let (first, second): (Vec<u32>, Vec<u32>) = replay
            .operation
            .deformed()
            .iter()
            .partition(|&&face| mesh.face(face).corners.contains(&vt));
        write!(out, " & {}", first.len())?;
        for face in first.into_iter().chain(second) {
            write!(out, " {}", replay.face_number(face))?;
        }
        writeln!(out)?;
    }
    Ok(())
}

pub(super) fn write_spm_text(front: &Front, out: &mut impl Write) -> io::Result<()> {
    let (header, vsps) = (&front.header, front.splits.len());
    let mut replay = Replay::new(front);
    let numbers = Numbers::new(front);
    let cells = Cells::new(front);
    write_counts(front, out)?;
    writeln!(out, "b {} {}", header.base_faces, header.base_vertices)?;
    let vertices = header.base_vertices as usize + vsps;
    writeln!(out, "$ {} {vertices} {vsps}", front.faces)?;
    for row in cells.first.chunks(DIVISIONS * DIVISIONS) {
        let row: Vec<String> = row.iter().map(u32::to_string).collect();
        writeln!(out, "{}", row.join(" "))?;
    }
    for vertex in 0..header.base_vertices {
        let position = replay.base_position(vertex);
        writeln!(out, "v {} {position}", vertex + 1)?;
    }
    for face in 0..header.base_faces {
        let [a, b, c] = front.base.face(face).corners.map(|v| v + 1);
        writeln!(out, "f {} {a} {b} {c} {}", face + 1, numbers.code(face))?;
    }
    let sizes = header.sizes();
    for (rank, record) in (0u32..).zip(&front.splits) {
        let split = replay.split(record);
        let vt = sizes.vt(record.i);
        let cdpm = [vt, vt + 1].map(|v| replay.cdpm[v as usize]);
        write!(
            out,
            "v* {} {} {} {} {} {} {}",
            rank + 1,
            numbers.vertex(record.vs),
            numbers.vertex(vt),
            numbers.vertex(vt + 1),
            cdpm[0],
            cdpm[1],
            split.differences
        )?;
        let links = cells.of_split[rank as usize];
        for [cell, next] in links {
            write!(out, " {cell} {next}")?;
        }
        let creator = numbers.split(sizes.creator_of_vertex(record.vs));
        write!(out, " {creator}")?;
        write_new_faces(&replay, &numbers, record, split.thirds, out)?;
        writeln!(out)?;
    }
    Ok(())
}

/// The new faces of a split and their neighbours, as fields of its line in the SPM text.
fn write_new_faces(
    replay: &Replay,
    numbers: &Numbers,
    record: &VspRecord,
    thirds: [Option<u32>; 2],
    out: &mut impl Write,
) -> io::Result<()> {
    let sizes = numbers.sizes;
    let fl = sizes.fl(record.i);
    for (k, third) in thirds.into_iter().enumerate() {
        let Some(third) = third else { continue };
        let (face, sign) = ([fl, fl + 1][k], ["", "-"][k]);
        let (number, code) = (replay.face_number(face), numbers.code(face));
        write!(out, " & {sign}{number} {code}")?;
        for (&neighbour, side) in record.fn_[2 * k..2 * k + 2].iter().zip(["", "-"]) {
            if neighbour != NONE {
                let corners = replay.mesh.face(neighbour).corners;
                let corner = corners.iter().position(|&c| c == third);
                let corner = corner.map_or(0, |c| c + 1);
                let number = replay.face_number(neighbour);
                let creator = numbers.split(sizes.creator_of_face(neighbour));
                write!(out, " {side}{number} {corner} {creator}")?;
            }
        }
    }
    Ok(())
}

/// Numbers of vertices, splits and leaves in the SPM text.
struct Numbers {
    sizes: Sizes,
    /// By split of the model: its place in the front.
    ranks: Vec<u32>,
    /// By face id: its leaf code, from 1.
    codes: Vec<u32>,
}

impl Numbers {
    fn new(front: &Front) -> Self {
        Self {
            sizes: front.header.sizes(),
            ranks: front.ranks(),
            codes: leaf_codes(front),
        }
    }

    /// Number of a vertex, from 1: the base vertices, then two a split of the front.
    fn vertex(&self, vertex: u32) -> u32 {
        match self.sizes.creator_of_vertex(vertex) {
            None => vertex + 1,
            Some(i) => {
                let before = self.sizes.base_vertices + 2 * self.ranks[i as usize];
                before + 1 + (vertex - self.sizes.vt(i))
            }
        }
    }

    /// Number of a split, from 1; 0 for none.
    fn split(&self, i: Option<u32>) -> u32 {
        i.map_or(0, |i| self.ranks[i as usize] + 1)
    }

    fn code(&self, face: u32) -> u32 {
        self.codes[face as usize]
    }
}

fn write_counts(front: &Front, out: &mut impl Write) -> io::Result<()> {
    let header = &front.header;
    let vertices = header.base_vertices as usize + front.splits.len();
    writeln!(
        out,
        "# 3D model: {} faces {vertices} vertices {} VSPs\n# Base Mesh: {} faces {} vertices",
        front.faces,
        front.splits.len(),
        header.base_faces,
        header.base_vertices
    )
}

/// The splits as they are written, one after the other, and what a reader then has.
struct Replay<'a> {
    front: &'a Front,
    mesh: ActiveMesh,
    operation: OperationFaces,
    /// By vertex id: where the reader has it.
    at: Vec<[f64; 3]>,
    /// By vertex id: its number in the CDPM, where the first child takes over that of its parent.
    cdpm: Vec<u32>,
    /// By split of the model: number of its left face, from 1.
    left_face: Vec<u32>,
    faces: u32,
    vertices: u32,
}

/// What a line says of a split beside its faces.
struct Split {
    /// Number of the split vertex in the CDPM.
    vs_cdpm: u32,
    /// Of the first and the second child to it.
    differences: String,
    /// Third vertices of the left and the right face.
    thirds: [Option<u32>; 2],
}

impl<'a> Replay<'a> {
    fn new(front: &'a Front) -> Self {
        let sizes = front.header.sizes();
        let ids = sizes.vt(sizes.vsps) as usize;
        Self {
            front,
            mesh: front.base.clone(),
            operation: OperationFaces::new(),
            at: vec![[0.0; 3]; ids],
            cdpm: (1..=ids as u32).collect(),
            left_face: vec![0; sizes.vsps as usize],
            faces: sizes.base_faces,
            vertices: sizes.base_vertices,
        }
    }

    fn base_position(&mut self, vertex: u32) -> String {
        let wanted = self.front.position(vertex);
        let words = [0, 1, 2].map(|k| self.digits(0.0, wanted[k]));
        self.at[vertex as usize] = [0, 1, 2].map(|k| words[k].1);
        words.map(|(word, _)| word).join(" ")
    }

    fn split(&mut self, record: &VspRecord) -> Split {
        let sizes = self.front.header.sizes();
        let (vs, vt) = (record.vs as usize, sizes.vt(record.i) as usize);
        let parent = self.at[vs];
        let mut differences = Vec::with_capacity(6);
        for child in [vt, vt + 1] {
            let wanted = self.front.position(child as u32);
            for k in 0..3 {
                let (word, value) = self.digits(parent[k], wanted[k]);
                self.at[child][k] = value;
                differences.push(word);
            }
        }
        self.vertices += 1;
        self.cdpm[vt] = self.cdpm[vs];
        self.cdpm[vt + 1] = self.vertices;
        let fitted = self.mesh.split(record.i, &mut self.operation);
        assert!(fitted.is_ok(), "the front was performed before");
        self.left_face[record.i as usize] = self.faces + 1;
        self.faces += self.operation.pair_count as u32;
        let fl = sizes.fl(record.i);
        let third = |face: u32| self.mesh.face(face).corners[2];
        Split {
            vs_cdpm: self.cdpm[vs],
            differences: differences.join(" "),
            thirds: [
                Some(third(fl)),
                record.has_right_face().then(|| third(fl + 1)),
            ],
        }
    }

    fn face_number(&self, face: u32) -> u32 {
        let sizes = self.front.header.sizes();
        match sizes.creator_of_face(face) {
            None => face + 1,
            Some(i) => self.left_face[i as usize] + (face - sizes.fl(i)),
        }
    }

    /// A difference in the fewest digits (nine or more) that lead from the parent to the wanted
    /// f32, and where the reader comes to with it.
    fn digits(&self, parent: f64, wanted: f64) -> (String, f64) {
        let exact = wanted - parent;
        if self.front.is_single() {
            if parent as f32 == wanted as f32 {
                return ("0".to_string(), parent);
            }
            for digits in 8..16 {
                let rounded: f64 = format!("{exact:.digits$e}").parse().unwrap_or(exact);
                if (parent + rounded) as f32 == wanted as f32 {
                    return (format!("{rounded:?}"), parent + rounded);
                }
            }
        }
        (format!("{exact:?}"), parent + exact)
    }
}

/// The cells of the box and the splits that end in each.
struct Cells {
    /// By cell: its first split, from 1.
    first: Vec<u32>,
    /// By split of the front: cell of each child and the next split there; zeros where the child is
    /// split again.
    of_split: Vec<[[u32; 2]; 2]>,
}

impl Cells {
    /// Thesis 5.3.1.1, MeshPartition. A split with both children in one cell is linked from once.
    fn new(front: &Front) -> Self {
        let sizes = front.header.sizes();
        let split = front.is_split();
        let mut first = vec![0u32; DIVISIONS.pow(3)];
        let mut of_split = vec![[[0u32; 2]; 2]; front.splits.len()];
        for (rank, record) in front.splits.iter().enumerate().rev() {
            let vt = sizes.vt(record.i);
            let leaves = [vt, vt + 1].map(|v| (!split[v as usize]).then(|| cell(front, v)));
            for (links, leaf) in of_split[rank].iter_mut().zip(leaves) {
                if let Some(cell) = leaf {
                    *links = [cell as u32 + 1, first[cell]];
                }
            }
            for cell in leaves.into_iter().flatten() {
                first[cell] = rank as u32 + 1;
            }
        }
        Self { first, of_split }
    }
}

fn cell(front: &Front, vertex: u32) -> usize {
    let position = front.refined.position(vertex).to_array();
    let (lower, upper) = (front.header.lower, front.header.upper);
    let step = |k: usize| {
        let share = (f64::from(position[k]) - lower[k]) / (upper[k] - lower[k]);
        // A flat box has one layer.
        ((share * DIVISIONS as f64) as usize).min(DIVISIONS - 1)
    };
    step(0) + DIVISIONS * (step(1) + DIVISIONS * step(2))
}

/// By face id: its place among the faces of the front in AB-tree order, from 1.
fn leaf_codes(front: &Front) -> Vec<u32> {
    let mut faces = Vec::with_capacity(front.faces as usize);
    front.refined.for_each_active_face(|face| {
        let key = front.leaf(face);
        // Left-aligned to one depth, keys ascend in tree order.
        faces.push((u64::from(key) << (32 - depth(key)), face));
    });
    faces.sort_unstable();
    let sizes = front.header.sizes();
    let mut codes = vec![0; sizes.fl(sizes.vsps) as usize];
    for (code, &(_, face)) in (1u32..).zip(&faces) {
        codes[face as usize] = code;
    }
    codes
}
