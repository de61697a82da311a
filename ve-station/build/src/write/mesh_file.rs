//! Mesh files out: OBJ as text, PLY as little-endian binary.

use super::{try_output, write_atomically};
use crate::mesh::SoupMesh;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why a mesh file could not be written.
#[derive(Debug, Error)]
pub enum MeshWriteError {
    /// The ending names no format.
    #[error("{}: a mesh is written as .obj or .ply: give the file one of these endings", .0.display())]
    UnknownFormat(PathBuf),
    /// The operating system says no.
    #[error("{}: {error}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What it says.
        error: io::Error,
    },
}

/// The formats that are written.
enum Format {
    Obj,
    Ply,
}

/// The format that the ending of a file names.
fn format_of(path: &Path) -> Result<Format, MeshWriteError> {
    let ending = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    match ending.to_ascii_lowercase().as_str() {
        "obj" => Ok(Format::Obj),
        "ply" => Ok(Format::Ply),
        _ => Err(MeshWriteError::UnknownFormat(path.to_path_buf())),
    }
}

fn failed(path: &Path, error: io::Error) -> MeshWriteError {
    MeshWriteError::Io {
        path: path.to_path_buf(),
        error,
    }
}

/// Makes a mesh, writes it as [`write_mesh`] does, and gives it back. What cannot be written is not
/// made.
///
/// # Errors
/// When the ending is none of a mesh or the file cannot be written.
pub fn make_mesh_file(
    path: &Path,
    make: impl FnOnce() -> SoupMesh,
) -> Result<SoupMesh, MeshWriteError> {
    format_of(path)?;
    try_output(path).map_err(|error| failed(path, error))?;
    let mesh = make();
    write_mesh(&mesh, path)?;
    Ok(mesh)
}

/// Writes a mesh, OBJ or PLY by the ending. Positions are rounded to f32 first, so both hold the
/// same.
///
/// # Errors
/// When the ending is another one or the file cannot be written.
pub fn write_mesh(mesh: &SoupMesh, path: &Path) -> Result<(), MeshWriteError> {
    let format = format_of(path)?;
    let written = write_atomically(path, |out| match format {
        Format::Obj => write_obj(mesh, out),
        Format::Ply => write_ply(&mesh.positions, &mesh.triangles, true, out),
    });
    written.map_err(|error| failed(path, error))
}

fn write_obj(mesh: &SoupMesh, out: &mut impl Write) -> io::Result<()> {
    for p in &mesh.positions {
        let [x, y, z] = p.map(|x| x as f32);
        writeln!(out, "v {x} {y} {z}")?;
    }
    for [a, b, c] in &mesh.triangles {
        writeln!(out, "f {} {} {}", a + 1, b + 1, c + 1)?;
    }
    Ok(())
}

/// Writes a little-endian binary PLY, its coordinates as f32 if `single`, else as f64.
///
/// # Errors
/// When the output fails.
pub fn write_ply(
    positions: &[[f64; 3]],
    triangles: &[[u32; 3]],
    single: bool,
    out: &mut impl Write,
) -> io::Result<()> {
    let scalar = if single { "float" } else { "double" };
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty {scalar} x\n\
         property {scalar} y\nproperty {scalar} z\nelement face {}\n\
         property list uchar uint vertex_indices\nend_header\n",
        positions.len(),
        triangles.len()
    )?;
    for x in positions.as_flattened() {
        if single {
            out.write_all(&(*x as f32).to_le_bytes())?;
        } else {
            out.write_all(&x.to_le_bytes())?;
        }
    }
    for corners in triangles {
        out.write_all(&[3])?;
        for corner in corners {
            out.write_all(&corner.to_le_bytes())?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::{Shape, generate};

    #[test]
    fn a_mesh_that_cannot_be_written_is_not_made() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("folder.ply")).unwrap();
        for name in ["a.stl", "a", "nowhere/a.obj", "folder.ply"] {
            let refused = make_mesh_file(&at(name), || panic!("{name}: it is made"));
            let sentence = refused.unwrap_err().to_string();
            assert!(sentence.contains(name), "{sentence}");
        }
        let make = || generate(Shape::Plate, 100, 1);
        assert_eq!(make_mesh_file(&at("a.obj"), make).unwrap(), make());
        assert!(at("a.obj").is_file());
    }
}
