//! STL, text or binary. The format repeats the corners of every face, so equal ones become one
//! vertex: equal to the last bit that an f32 has at the model's size, wherever its origin is.
//! (Writers leave noise of 1e-17 where others write 0; an exact comparison would tear the model
//! there.) Where something stray makes the model seem so large that its facets would vanish in
//! that, their corners are compared by all bits but such noise.

use super::Soup;
use super::text::{Lines, excerpt, number, words};
use crate::clean::{box_of_faces, far_origin};
use crate::error::BuildError;
use crate::mesh::SoupMesh;
use crate::tuning::input::FINE_FACET_STEPS;
use rayon::prelude::*;

/// Bytes before the triangles of a binary file.
const HEAD: usize = 84;
/// Bytes of a triangle in a binary file.
const TRIANGLE: usize = 50;

pub(super) fn read(bytes: &[u8]) -> Result<SoupMesh, BuildError> {
    if is_text(bytes) {
        return read_text(bytes);
    }
    let body = bytes.get(HEAD..).ok_or_else(|| {
        refused("it neither starts with \"solid\" nor is as long as the head of a binary file")
    })?;
    let announced = u32::from_le_bytes([bytes[80], bytes[81], bytes[82], bytes[83]]) as usize;
    let there = body.len() / TRIANGLE;
    // Some who write a stream never come back to put the number in.
    let unknown = announced == 0 || announced == u32::MAX as usize;
    let count = if unknown && body.len() % TRIANGLE == 0 {
        there
    } else {
        announced
    };
    if count > there {
        // A page or a pointer instead of the file: a count of such bytes would be 150 million.
        if bytes[..HEAD].iter().all(|&byte| byte >= b'\t') {
            return Err(refused(
                "it is neither a text that starts with \"solid\" nor a binary STL: copy or download the mesh itself",
            ));
        }
        return Err(refused(&format!(
            "it announces {announced} triangles and holds {there}: copy or export it again"
        )));
    }
    let corners: Vec<[f32; 3]> = body
        .chunks_exact(TRIANGLE)
        .take(count)
        .flat_map(|triangle| {
            let coordinate = |at: usize| {
                let bytes = &triangle[at..at + 4];
                f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
            };
            // The normal comes first; the corners tell it better.
            [12, 24, 36].map(|at| [coordinate(at), coordinate(at + 4), coordinate(at + 8)])
        })
        .collect();
    let corner_numbers: Vec<u32> = (0..corners.len() as u32).collect();
    let mut soup = Soup::default();
    soup.mesh.triangles = corner_numbers.as_chunks::<3>().0.to_vec();
    Ok(welded(soup.finish()?, &corners))
}

/// Binary files may start with "solid" too, whose head means nothing: text has a facet, or ends,
/// and is not as long as a binary file would be.
fn is_text(bytes: &[u8]) -> bool {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let starts = text.trim_ascii_start();
    if !starts
        .get(..5)
        .is_some_and(|start| start.eq_ignore_ascii_case(b"solid"))
    {
        return false;
    }
    let announced = bytes
        .get(80..HEAD)
        .map(|count| u32::from_le_bytes([count[0], count[1], count[2], count[3]]));
    let exact = announced.is_some_and(|count| bytes.len() == HEAD + count as usize * TRIANGLE);
    !exact && !starts[..starts.len().min(1024)].contains(&0)
}

/// Words, wherever lines end; names of solids are passed over.
fn read_text(bytes: &[u8]) -> Result<SoupMesh, BuildError> {
    let bytes = super::text::decoded(bytes)?;
    let mut soup = Soup::default();
    let mut positions: Vec<[f64; 3]> = Vec::new();
    // Numbers of the corners of the loop that is open.
    let mut corners: Option<Vec<u32>> = None;
    // Coordinates of the vertex that is being read, or of a normal.
    let mut coordinates: Vec<f64> = Vec::new();
    let mut in_vertex = false;
    // Whether the solid that was begun last is whole.
    let mut is_ended = true;
    let mut last_line = 1;
    for (line, content) in Lines::of(bytes) {
        last_line = line;
        let bad = |what: &str| BuildError::Line {
            line,
            reason: format!("\"{}\" is {what} of an STL mesh", excerpt(content)),
        };
        for word in words(content) {
            if let Some(number) = number(word) {
                coordinates.push(number);
                if in_vertex && coordinates.len() == 3 {
                    let open = corners.as_mut().ok_or_else(|| bad("no vertex in a loop"))?;
                    open.push(positions.len() as u32);
                    positions.push([0, 1, 2].map(|k| coordinates[k]));
                    coordinates.clear();
                    in_vertex = false;
                }
                continue;
            }
            if in_vertex {
                return Err(bad("no vertex"));
            }
            coordinates.clear();
            let word = word.to_ascii_lowercase();
            is_ended = word == "endsolid";
            match word.as_str() {
                "solid" | "endsolid" => break,
                "facet" | "normal" | "outer" | "endfacet" => {}
                "loop" => corners = Some(Vec::new()),
                "vertex" => in_vertex = true,
                "endloop" => {
                    let closed = corners.take().ok_or_else(|| bad("no end of a loop"))?;
                    soup.push_polygon(&closed);
                }
                _ => return Err(bad("no part")),
            }
        }
    }
    let is_in_face = in_vertex || corners.is_some();
    if is_in_face || !is_ended {
        let place = if is_in_face {
            "within a face"
        } else {
            "before \"endsolid\""
        };
        return Err(BuildError::Line {
            line: last_line,
            reason: format!("the STL mesh ends {place}: copy or export it again"),
        });
    }
    soup.mesh.positions.clone_from(&positions);
    Ok(welded(soup.finish()?, &positions))
}

fn refused(reason: &str) -> BuildError {
    BuildError::Format {
        format: "STL",
        reason: reason.to_string(),
    }
}

/// One vertex for each position, that of its first use; triangles name corners so far.
fn welded<T: Copy + Into<f64> + Sync>(mut mesh: SoupMesh, corners: &[[T; 3]]) -> SoupMesh {
    let mut first_use = first_uses(&mesh.triangles, corners);
    mesh.positions.clear();
    // In place: a first use comes before every other one, so what it points to is a vertex by then.
    for at in 0..corners.len() {
        let first = first_use[at] as usize;
        if first == at {
            first_use[at] = mesh.positions.len() as u32;
            mesh.positions.push(corners[at].map(Into::into));
        } else {
            first_use[at] = first_use[first];
        }
    }
    for corner in mesh.triangles.as_flattened_mut() {
        *corner = first_use[*corner as usize];
    }
    mesh
}

/// For every corner the first one of its position.
fn first_uses<T: Copy + Into<f64> + Sync>(triangles: &[[u32; 3]], corners: &[[T; 3]]) -> Vec<u32> {
    // Where a model lies far from its own origin, that is moved there later ([`crate::clean`]).
    let [lower, upper] = box_of_faces(corners, triangles);
    let origin = far_origin([lower, upper]);
    let extent = (lower - origin).abs().max((upper - origin).abs());
    let (origin, extent) = (origin.to_array(), extent.max_element() as f32);
    // Without a face there is no box, and infinity less infinity would make all corners one.
    let extent = if extent.is_finite() { extent } else { 0.0 };
    // Plus zero: the two zeros are one position.
    let place = |at: u32| {
        let p = corners[at as usize];
        [0, 1, 2].map(|k| (p[k].into() - origin[k]) as f32 + 0.0)
    };
    // Adding the extent and taking it away again leaves the bits that count at this size.
    let rounded = |p: [f32; 3]| p.map(|x| ((x + extent) - extent + 0.0).to_bits());
    let size = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(place);
        let side = |k: usize| a[k].max(b[k]).max(c[k]) - a[k].min(b[k]).min(c[k]);
        side(0).max(side(1)).max(side(2))
    };
    // One facet may be a million times as far out as the model is large: then most are small.
    let fine = FINE_FACET_STEPS * f32::EPSILON * extent;
    let is_fine = |size: f32| size > 0.0 && size < fine;
    let count = corners.len() as u32;
    let fine_facets = triangles.par_iter().filter(|of| is_fine(size(of)));
    if 2 * fine_facets.count() <= triangles.len() {
        return first_of_same(count, |at| rounded(place(at)));
    }
    // Corners of equal bits stay together, whatever the facets: by the first of them the size of
    // the smallest facet there.
    let same = first_of_same(count, |at| place(at).map(f32::to_bits));
    let mut smallest = vec![f32::INFINITY; corners.len()];
    for triangle in triangles {
        let size = size(triangle);
        for &corner in triangle.iter().filter(|_| size > 0.0) {
            let smallest = &mut smallest[same[corner as usize] as usize];
            *smallest = smallest.min(size);
        }
    }
    first_of_same(count, |at| {
        let size = smallest[same[at as usize] as usize];
        if !is_fine(size) {
            return rounded(place(at));
        }
        // Of a small facet only what is noise beside itself is taken away.
        let noise = f32::EPSILON * size;
        place(at).map(|x| if x.abs() <= noise { 0 } else { x.to_bits() })
    })
}

/// For every corner of so many the first one with the same key.
fn first_of_same(count: u32, key: impl Fn(u32) -> [u32; 3] + Sync + Send) -> Vec<u32> {
    let keys = (0..count).into_par_iter().map(|at| (key(at), at));
    let mut order: Vec<([u32; 3], u32)> = keys.collect();
    order.par_sort_unstable();
    let mut first = vec![0; order.len()];
    for same in order.chunk_by(|a, b| a.0 == b.0) {
        for &(_, at) in same {
            first[at as usize] = same[0].1;
        }
    }
    first
}
