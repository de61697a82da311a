//! Mesh files out: OBJ as text, PLY as little-endian binary.

use super::write_atomically;
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

/// Writes a mesh, OBJ or PLY by the ending. Positions are rounded to f32 first, so both hold the
/// same.
///
/// # Errors
/// When the ending is another one or the file cannot be written.
pub fn write_mesh(mesh: &SoupMesh, path: &Path) -> Result<(), MeshWriteError> {
    let ending = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    let written = match ending.to_ascii_lowercase().as_str() {
        "obj" => write_atomically(path, |out| write_obj(mesh, out)),
        "ply" => write_atomically(path, |out| {
            write_ply(&mesh.positions, &mesh.triangles, true, out)
        }),
        _ => return Err(MeshWriteError::UnknownFormat(path.to_path_buf())),
    };
    written.map_err(|error| MeshWriteError::Io {
        path: path.to_path_buf(),
        error,
    })
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
