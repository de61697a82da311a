//! Files out, each whole or not at all: SPM files and plain meshes.

mod mesh_file;

pub use mesh_file::{MeshWriteError, write_mesh, write_ply};

use spm::{SpmParts, write_spm};
use std::io;
use std::path::Path;

/// Writes an SPM file: to a temporary file beside it, renamed when whole. Returns its length.
///
/// # Errors
/// When the folder cannot be written to.
pub fn write_spm_file(parts: &SpmParts, output: &Path) -> io::Result<u64> {
    write_atomically(output, |out| write_spm(parts, out))
}

/// How the names of temporary files begin; one that is left belongs to a build that was killed.
pub const TEMPORARY_PREFIX: &str = ".ve-station-";

/// Writes a file through a temporary one in the same folder, renamed when whole.
pub fn write_atomically<T>(
    output: &Path,
    write: impl FnOnce(&mut io::BufWriter<&std::fs::File>) -> io::Result<T>,
) -> io::Result<T> {
    let folder = match output.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let temporary = tempfile::Builder::new()
        .prefix(TEMPORARY_PREFIX)
        .permissions(readable_by_all())
        .tempfile_in(folder)?;
    let mut out = io::BufWriter::new(temporary.as_file());
    let written = write(&mut out)?;
    io::Write::flush(&mut out)?;
    drop(out);
    temporary.as_file().sync_all()?;
    temporary.persist(output).map_err(|e| e.error)?;
    Ok(written)
}

/// What a plain new file gets before the umask: a temporary one would be private.
fn readable_by_all() -> std::fs::Permissions {
    std::os::unix::fs::PermissionsExt::from_mode(0o666)
}
