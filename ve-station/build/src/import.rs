//! Mesh files in: positions as f64 where the format has them, polygons cut into triangles.
//!
//! Read here and not by other crates, since messages then name the line, faces that name no vertex
//! are counted instead of refusing the file, vertices keep their identity across groups, and no
//! number in a file is believed before the bytes that it promises are there: memory follows the
//! length of the file.
//!
//! | format | is read | and |
//! |---|---|---|
//! | OBJ | `v`, `f` | any line ending, joined lines, numbers from the end |
//! | PLY | elements `vertex`, `face`, `tristrips` | text and both byte orders, any other property, list or element |
//! | STL | text and binary | equal corners become one vertex |
//! | OFF | text | colours and normals are passed over |
//! | CDPM, SPM text | the thesis's own (appendices A and B) | refined in full |

mod obj;
mod off;
mod ply;
mod polygon;
mod stl;
mod text;
mod thesis;

use crate::error::{BuildError, MAX_FACES};
use crate::mesh::SoupMesh;
use polygon::TooManyCorners;
use std::path::Path;

/// A soup while it is read. Polygons are fans until all positions are known, since a file may name
/// a vertex before it gives its position.
#[derive(Default)]
struct Soup {
    mesh: SoupMesh,
    /// Polygons of four corners and more: their first triangle, and how many corners.
    polygons: Vec<(usize, u32)>,
}

impl Soup {
    /// Adds a polygon. Fewer than three corners make one triangle without area, so that it is
    /// counted.
    fn push_polygon(&mut self, corners: &[u32]) {
        let triangles = &mut self.mesh.triangles;
        match *corners {
            [] => {}
            [a] => triangles.push([a, a, a]),
            [a, b] => triangles.push([a, b, b]),
            [a, b, c] => triangles.push([a, b, c]),
            [a, ref rest @ ..] => {
                self.polygons.push((triangles.len(), corners.len() as u32));
                triangles.extend(rest.windows(2).map(|pair| [a, pair[0], pair[1]]));
            }
        }
    }

    /// Cuts the polygons along diagonals that lie inside.
    fn finish(mut self) -> Result<SoupMesh, BuildError> {
        let SoupMesh {
            positions,
            triangles,
        } = &mut self.mesh;
        // Triangles beyond one for each face so far.
        let mut more = 0;
        for (first, corners) in self.polygons {
            let face = first - more + 1;
            more += corners as usize - 3;
            let fan = &mut triangles[first..first + corners as usize - 2];
            let numbers: Vec<u32> = [fan[0][0], fan[0][1]]
                .into_iter()
                .chain(fan.iter().map(|triangle| triangle[2]))
                .collect();
            let points: Option<Vec<[f64; 3]>> = numbers
                .iter()
                .map(|&number| positions.get(number as usize).copied())
                .collect();
            let Some(points) = points else {
                continue;
            };
            let cut = polygon::triangulate(&points)
                .map_err(|TooManyCorners(corners)| BuildError::LargePolygon { face, corners })?;
            if let Some(cut) = cut {
                for (triangle, corners) in fan.iter_mut().zip(cut) {
                    *triangle = corners.map(|corner| numbers[corner]);
                }
            }
        }
        Ok(self.mesh)
    }
}

/// The formats that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeshFormat {
    /// Wavefront OBJ.
    Obj,
    /// PLY, text or binary.
    Ply,
    /// STL, text or binary.
    Stl,
    /// OFF, text.
    Off,
    /// The thesis's text of a CDPM or an SPM (appendices A and B); the content tells which.
    Thesis,
}

impl MeshFormat {
    /// All endings that name a format.
    pub const ENDINGS: [(&'static str, Self); 6] = [
        ("obj", Self::Obj),
        ("ply", Self::Ply),
        ("stl", Self::Stl),
        ("off", Self::Off),
        ("cdpm", Self::Thesis),
        ("spmtxt", Self::Thesis),
    ];

    /// The format that the ending of a file names.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        let ending = path.extension()?.to_str()?;
        let mut known = Self::ENDINGS.iter();
        known
            .find(|(name, _)| ending.eq_ignore_ascii_case(name))
            .map(|&(_, format)| format)
    }
}

/// Whether the ending names a mesh format that [`read_mesh`] reads.
#[must_use]
pub fn is_mesh_file(path: &Path) -> bool {
    MeshFormat::of(path).is_some()
}

/// Reads a mesh file; its ending names the format.
///
/// # Errors
/// When the file cannot be read or understood, or holds more triangles than an SPM can.
pub fn read_mesh(path: &Path) -> Result<SoupMesh, BuildError> {
    let format = MeshFormat::of(path);
    // A missing file is said to be missing, whatever its ending; a pipe would never end.
    if !std::fs::metadata(path)?.is_file() {
        return Err(BuildError::NoFile);
    }
    let format = format.ok_or(BuildError::UnknownFormat)?;
    read_mesh_bytes(&std::fs::read(path)?, format)
}

/// Reads a mesh from the bytes of a file. Takes memory in proportion to their number, whatever they
/// say.
///
/// # Errors
/// When the bytes cannot be understood, or hold more triangles than an SPM can.
pub fn read_mesh_bytes(bytes: &[u8], format: MeshFormat) -> Result<SoupMesh, BuildError> {
    let mesh = match format {
        MeshFormat::Obj => obj::read(text::decoded(bytes)?)?,
        MeshFormat::Ply => ply::read(text::decoded(bytes)?)?,
        MeshFormat::Stl => stl::read(bytes)?,
        MeshFormat::Off => off::read(text::decoded(bytes)?)?,
        MeshFormat::Thesis => thesis::read(text::decoded(bytes)?)?,
    };
    let faces = mesh.triangles.len() as u64;
    if faces > MAX_FACES || mesh.positions.len() as u64 > 3 * MAX_FACES {
        return Err(BuildError::TooLarge(faces));
    }
    Ok(mesh)
}

#[cfg(test)]
mod tests;
