//! Mesh files in: positions as f64 where the format has them, polygons as fans of triangles.
//!
//! OBJ and OFF are read here, since messages then name the line, faces that name no vertex are counted
//! instead of refusing the file, vertices keep their identity across groups, and vertices that no face
//! uses are counted.

mod obj;
mod off;
mod ply;
mod stl;
mod text;

use super::{BuildError, MOST_FACES};
use std::path::Path;

/// A triangle soup as read: nothing checked.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SoupMesh {
    /// Positions, model units; may be anything.
    pub positions: Vec<[f64; 3]>,
    /// Corners, counterclockwise; may name no vertex ([`u32::MAX`] when the file's number is beyond u32).
    pub triangles: Vec<[u32; 3]>,
}

impl SoupMesh {
    /// Adds a polygon as a fan. Fewer than three corners make one triangle without area, so that it is
    /// counted as such.
    fn push_polygon(&mut self, corners: &[u32]) {
        match *corners {
            [] => {}
            [a] => self.triangles.push([a, a, a]),
            [a, b] => self.triangles.push([a, b, b]),
            [a, ref rest @ ..] => self
                .triangles
                .extend(rest.windows(2).map(|pair| [a, pair[0], pair[1]])),
        }
    }
}

/// Which reader takes a file, by its ending.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Obj,
    Ply,
    Stl,
    Off,
}

impl Format {
    fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "obj" => Some(Self::Obj),
            "ply" => Some(Self::Ply),
            "stl" => Some(Self::Stl),
            "off" => Some(Self::Off),
            _ => None,
        }
    }
}

/// Whether the ending names a mesh format that [`read_mesh`] reads.
#[must_use]
pub fn is_mesh_file(path: &Path) -> bool {
    Format::of(path).is_some()
}

/// Reads a mesh file; its ending names the format.
///
/// # Errors
/// When the file cannot be read or understood, or holds more triangles than an SPM can.
pub fn read_mesh(path: &Path) -> Result<SoupMesh, BuildError> {
    let format = Format::of(path);
    // A missing file is said to be missing, whatever its ending.
    let bytes = std::fs::read(path)?;
    let mesh = match format.ok_or(BuildError::UnknownFormat)? {
        Format::Obj => obj::read(&bytes)?,
        Format::Ply => ply::read(&bytes)?,
        Format::Stl => stl::read(bytes)?,
        Format::Off => off::read(&bytes)?,
    };
    let faces = mesh.triangles.len() as u64;
    if faces > MOST_FACES || mesh.positions.len() as u64 > 3 * MOST_FACES {
        return Err(BuildError::TooLarge(faces));
    }
    Ok(mesh)
}

#[cfg(test)]
mod tests;
