//! STL, text or binary, through `stl_io`. The format repeats the corners of every face, so equal ones
//! become one vertex: equal to the last bit that an f32 has at the model's size. (Writers leave noise of
//! 1e-17 where others write 0; an exact comparison would tear the model there.)

use super::{BuildError, SoupMesh};
use std::io::Cursor;

/// Bytes before the triangles of a binary file.
const HEAD: usize = 84;
/// Bytes of a triangle in a binary file.
const TRIANGLE: usize = 50;

pub(super) fn read(mut bytes: Vec<u8>) -> Result<SoupMesh, BuildError> {
    let mut corners: Vec<[f32; 3]> = Vec::new();
    if is_binary(&bytes) {
        // Some binary files start with "solid" like text ones; their head means nothing.
        bytes[0] = b' ';
        read_solid(&bytes, &mut corners)?;
    } else if bytes.starts_with(b"solid") {
        for solid in solids(&bytes) {
            read_solid(solid, &mut corners)?;
        }
    } else {
        return Err(refused(
            "its length is not that of the triangles it announces",
        ));
    }
    Ok(weld(&corners))
}

/// Whether the length is exactly that of the announced triangles.
fn is_binary(bytes: &[u8]) -> bool {
    let Some(count) = bytes.get(80..HEAD) else {
        return false;
    };
    let count = u32::from_le_bytes([count[0], count[1], count[2], count[3]]) as usize;
    bytes.len() == HEAD + count * TRIANGLE
}

/// The solids of a text file: it may hold several, one after the other.
fn solids(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    let starts: Vec<usize> = (0..bytes.len())
        .filter(|&at| {
            bytes[at..].starts_with(b"solid") && (at == 0 || matches!(bytes[at - 1], b'\n' | b'\r'))
        })
        .chain([bytes.len()])
        .collect();
    (1..starts.len()).map(move |k| &bytes[starts[k - 1]..starts[k]])
}

fn read_solid(bytes: &[u8], corners: &mut Vec<[f32; 3]>) -> Result<(), BuildError> {
    let mut source = Cursor::new(bytes);
    let reader = stl_io::create_stl_reader(&mut source).map_err(|e| refused(&e.to_string()))?;
    for triangle in reader {
        let triangle = triangle.map_err(|e| refused(&e.to_string()))?;
        corners.extend(triangle.vertices.iter().map(|v| v.0));
    }
    Ok(())
}

fn refused(reason: &str) -> BuildError {
    BuildError::Format {
        format: "STL",
        reason: reason.trim_end_matches(['.', '?']).to_string(),
    }
}

/// One vertex for each position, that of its first use.
fn weld(corners: &[[f32; 3]]) -> SoupMesh {
    let extent = corners
        .as_flattened()
        .iter()
        .filter(|x| x.is_finite())
        .fold(0.0f32, |most, x| most.max(x.abs()));
    // Adding the extent and taking it away again leaves the bits that count at this size.
    let key = |at: u32| corners[at as usize].map(|x| ((x + extent) - extent + 0.0).to_bits());
    let mut order: Vec<u32> = (0..corners.len() as u32).collect();
    order.sort_unstable_by_key(|&at| (key(at), at));
    let mut first_use = vec![0u32; corners.len()];
    for pair in 0..order.len() {
        let at = order[pair];
        let same = pair > 0 && key(order[pair - 1]) == key(at);
        first_use[at as usize] = if same {
            first_use[order[pair - 1] as usize]
        } else {
            at
        };
    }
    let mut mesh = SoupMesh::default();
    let mut vertex_of = vec![0u32; corners.len()];
    for at in 0..corners.len() {
        let first = first_use[at] as usize;
        if first == at {
            vertex_of[at] = mesh.positions.len() as u32;
            mesh.positions.push(corners[at].map(f64::from));
        } else {
            vertex_of[at] = vertex_of[first];
        }
    }
    mesh.triangles = vertex_of
        .chunks_exact(3)
        .map(|t| [t[0], t[1], t[2]])
        .collect();
    mesh
}
