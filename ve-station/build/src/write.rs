//! Files out, each whole or not at all: SPM files and plain meshes.

mod mesh_file;

pub use mesh_file::{MeshWriteError, make_mesh_file, write_mesh, write_ply};

use crate::error::BuildError;
use crate::tuning::write::{MAX_BYTES_A_FACE, MAX_BYTES_BESIDE};
use spm::{SpmParts, write_spm};
use std::fs::File;
use std::io;
use std::path::Path;
use tempfile::NamedTempFile;

/// Bytes of the SPM file of a mesh at the most.
#[must_use]
pub fn max_spm_bytes(faces: u64) -> u64 {
    faces * MAX_BYTES_A_FACE + MAX_BYTES_BESIDE
}

/// Checks that the file system of an SPM file has room for it, before it is built.
///
/// # Errors
/// When it has not. A folder that says nothing of its room is no error: writing will tell.
pub fn check_room(output: &Path, faces: u64) -> Result<(), BuildError> {
    if is_stream(output) {
        return Ok(());
    }
    let folder = folder_of(output);
    let Ok(system) = rustix::fs::statvfs(folder) else {
        return Ok(());
    };
    let free = system.f_bavail.saturating_mul(system.f_frsize);
    let needed = max_spm_bytes(faces);
    if needed <= free {
        return Ok(());
    }
    Err(BuildError::NoRoom {
        folder: folder.to_path_buf(),
        faces,
        needed,
        free,
    })
}

/// The folder that a file is in.
fn folder_of(file: &Path) -> &Path {
    match file.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Whether this is there and neither a file nor a folder: a pipe, a device.
fn is_stream(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|of| !of.is_file() && !of.is_dir())
}

/// Checks that a file can be written, before anything is made for it.
///
/// # Errors
/// When it is a folder, or its own folder is missing or takes no file.
pub fn try_output(output: &Path) -> io::Result<()> {
    if is_stream(output) {
        return Ok(());
    }
    if output.is_dir() {
        return Err(io::ErrorKind::IsADirectory.into());
    }
    temporary_beside(output).map(drop)
}

/// Writes an SPM file: to a temporary file beside it, renamed when whole. Returns its length.
///
/// # Errors
/// When the folder cannot be written to.
pub fn write_spm_file(parts: &SpmParts, output: &Path) -> io::Result<u64> {
    write_atomically(output, |out| write_spm(parts, out))
}

/// How the names of temporary files begin; one that nobody has locked is left of a process that was
/// killed.
pub const TEMPORARY_PREFIX: &str = ".ve-station-";

/// Writes a file through a temporary one in the same folder, renamed when whole; a pipe or a device
/// is written into, since a renamed file would take its place.
///
/// # Errors
/// When the folder takes no file, or the output fails.
pub fn write_atomically<T>(
    output: &Path,
    write: impl FnOnce(&mut io::BufWriter<&File>) -> io::Result<T>,
) -> io::Result<T> {
    if is_stream(output) {
        return write_into(&File::options().write(true).open(output)?, write);
    }
    let temporary = temporary_beside(output)?;
    // Who cleans up leaves alone what is locked, and everything where there are no locks; who looks
    // whether it is holds it for a moment.
    let _ = temporary.as_file().lock();
    let written = write_into(temporary.as_file(), write)?;
    temporary.as_file().sync_all()?;
    temporary.persist(output).map_err(|e| e.error)?;
    Ok(written)
}

fn write_into<T>(
    file: &File,
    write: impl FnOnce(&mut io::BufWriter<&File>) -> io::Result<T>,
) -> io::Result<T> {
    let mut out = io::BufWriter::new(file);
    let written = write(&mut out)?;
    io::Write::flush(&mut out)?;
    Ok(written)
}

fn temporary_beside(output: &Path) -> io::Result<NamedTempFile> {
    tempfile::Builder::new()
        .prefix(TEMPORARY_PREFIX)
        .permissions(readable_by_all())
        .tempfile_in(folder_of(output))
}

/// What a plain new file gets before the umask: a temporary one would be private.
fn readable_by_all() -> std::fs::Permissions {
    std::os::unix::fs::PermissionsExt::from_mode(0o666)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::{Shape, generate};
    use crate::{BuildOptions, NoProgress, SoupMesh, build_model};
    use std::io::{Read, Write};
    use std::os::unix::fs::FileTypeExt;

    /// A strip of triangles, each of which shares an edge with the next.
    fn strip(faces: u32) -> SoupMesh {
        let bend = |k: u32| f64::from(k % 97) * f64::from(k % 89) * 1e-4;
        SoupMesh {
            positions: (0..faces + 2)
                .map(|k| [f64::from(k), f64::from(k % 2), bend(k)])
                .collect(),
            triangles: (0..faces)
                .map(|k| [k, k + 1 + k % 2, k + 2 - k % 2])
                .collect(),
        }
    }

    /// Triangles that share nothing.
    fn separate(faces: u32) -> SoupMesh {
        let at = |k: u32| f64::from(k % 40) * 2.0;
        let corners = |k: u32| {
            let (x, y, z) = (at(k), at(k / 40), at(k / 1600));
            [[x, y, z], [x + 1.0, y, z], [x, y + 1.0, z]]
        };
        SoupMesh {
            positions: (0..faces).flat_map(corners).collect(),
            triangles: (0..faces).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(),
        }
    }

    #[test]
    fn a_pipe_gets_what_is_written_and_stays_a_pipe() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        if !made.is_ok_and(|status| status.success()) {
            println!("skipped: there is no mkfifo");
            return;
        }
        // With a reader and a writer nobody waits; the pipe holds what is written.
        let both = File::options().read(true).write(true).open(&pipe);
        let mut both = both.unwrap();
        assert!(try_output(&pipe).is_ok());
        write_atomically(&pipe, |out| out.write_all(b"whole")).unwrap();
        assert!(std::fs::metadata(&pipe).unwrap().file_type().is_fifo());
        let mut read = [0; 5];
        both.read_exact(&mut read).unwrap();
        assert_eq!(&read, b"whole");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn no_file_is_longer_than_its_bound() {
        let shapes = [Shape::Sphere, Shape::Terrain, Shape::Plate, Shape::Relief];
        let shapes = shapes.map(|shape| (format!("{shape}"), generate(shape, 20_000, 1)));
        let soups = [("strip", strip(20_000)), ("separate", separate(20_000))];
        let soups = soups.map(|(name, mesh)| (name.to_owned(), mesh));
        let small = [10, 100, 1000].map(|faces| {
            let mesh = generate(Shape::Sphere, faces, 1);
            (format!("sphere of {faces}"), mesh)
        });
        for (name, mesh) in shapes.into_iter().chain(soups).chain(small) {
            let faces = mesh.triangles.len() as u64;
            let parts = build_model(mesh, &BuildOptions::default(), &NoProgress).unwrap();
            let bytes = write_spm(&parts, &mut io::sink()).unwrap();
            println!("{name}: {bytes} bytes, {} a face", bytes / faces);
            assert!(bytes <= max_spm_bytes(faces), "{name}: {bytes} bytes");
        }
    }
}
