//! Files out, each whole or not at all: SPM files and plain meshes.

mod mesh_file;

pub use mesh_file::{MeshWriteError, make_mesh_file, write_mesh, write_ply};

use crate::error::BuildError;
use crate::tuning::write::{MAX_BYTES_A_FACE, MAX_BYTES_BESIDE};
use spm::{SpmParts, write_spm};
use std::ffi::OsString;
use std::fs::{self, File};
use std::io;
use std::os::fd::AsFd;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tempfile::{NamedTempFile, PersistError};

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
    let output = real(output);
    let folder = folder_of(&output);
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

/// Where a path leads: a link is no output itself, it stays. What the last one leads to need not be
/// there.
fn real(output: &Path) -> PathBuf {
    if let Ok(real) = fs::canonicalize(output) {
        return real;
    }
    let mut real = output.to_path_buf();
    for _ in 0..MAX_LINKS {
        let Ok(target) = fs::read_link(&real) else {
            break;
        };
        real = folder_of(&real).join(target);
    }
    real
}

/// The file that a path leads to.
///
/// # Errors
/// When it is a folder, or no file can have its name.
fn file_at(output: &Path) -> io::Result<PathBuf> {
    let is_folder = output.is_dir() || output.as_os_str().as_encoded_bytes().ends_with(b"/");
    if is_folder {
        return Err(io::ErrorKind::IsADirectory.into());
    }
    let real = real(output);
    match fs::symlink_metadata(&real) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(real),
    }
}

/// Whether this is written into: a pipe, a device, standard output.
fn is_stream(path: &Path) -> bool {
    let is_other = fs::metadata(path).is_ok_and(|of| !of.is_file() && !of.is_dir());
    is_other || standard_output(path).is_some()
}

/// Standard output, when a path leads to what that is: a pipe, or a file that it was redirected
/// into. Others may write there too, before and after: opened anew it would not go on behind them.
#[must_use]
pub fn standard_output(path: &Path) -> Option<File> {
    let own = File::from(io::stdout().as_fd().try_clone_to_owned().ok()?);
    let place = |of: fs::Metadata| (of.dev(), of.ino());
    let is_it = place(fs::metadata(path).ok()?) == place(own.metadata().ok()?);
    is_it.then_some(own)
}

/// Checks that a file can be written, before anything is made for it.
///
/// # Errors
/// When it is a folder, or no file can have its name, or its own folder is missing or takes no
/// file.
pub fn try_output(output: &Path) -> io::Result<()> {
    if is_stream(output) {
        return Ok(());
    }
    // A temporary file has another name than it.
    temporary_beside(&file_at(output)?).map(drop)
}

/// Writes an SPM file: to a temporary file beside it, renamed when whole. Returns its length.
///
/// # Errors
/// When the folder cannot be written to.
pub fn write_spm_file(parts: &SpmParts, output: &Path) -> io::Result<u64> {
    write_atomically(output, |out| write_spm(parts, out))
}

/// How the names of temporary files begin.
const TEMPORARY_PREFIX: &str = ".ve-station-";
/// How the names of files begin that are whole and could not be renamed.
const UNRENAMED_PREFIX: &str = "unrenamed-";
/// Links that a path leads through at the most, as for the kernel.
const MAX_LINKS: usize = 40;
/// Age from which one that nobody has locked is left of a process that was killed: whoever makes
/// one locks it at once.
const LEFT_AGE: Duration = Duration::from_secs(60);

/// Writes a file through a temporary one in the same folder, renamed when whole; a pipe, a device
/// or standard output is written into, since a renamed file would take its place. Of a link, what
/// it leads to is written. What killed processes left in the folder is removed.
///
/// # Errors
/// When the folder takes no file, or the output fails. What is whole and cannot be renamed is kept
/// until the next time: the error says where.
pub fn write_atomically<T>(
    output: &Path,
    write: impl FnOnce(&mut io::BufWriter<&File>) -> io::Result<T>,
) -> io::Result<T> {
    if let Some(own) = standard_output(output) {
        return write_into(&own, write);
    }
    if is_stream(output) {
        return write_into(&File::options().write(true).open(output)?, write);
    }
    let output = &file_at(output)?;
    let temporary = temporary_beside(output)?;
    // Who cleans up leaves alone what is locked, and everything where there are no locks; who looks
    // whether it is holds it for a moment.
    let _ = temporary.as_file().lock();
    let written = write_into(temporary.as_file(), write)?;
    temporary.as_file().sync_all()?;
    let renamed = temporary.persist(output);
    renamed.map_err(|failed| keep(failed, output))?;
    Ok(written)
}

/// Keeps what was made, by a name that is not cleaned up, and says where it is. One for each
/// output, in place of the one before: where it fails at every start, that takes no more room.
fn keep(failed: PersistError, output: &Path) -> io::Error {
    let PersistError { error, file } = failed;
    let mut name = OsString::from(UNRENAMED_PREFIX);
    name.push(output.file_name().unwrap_or_default());
    let path = output.with_file_name(name);
    match file.persist(&path) {
        Ok(_) => io::Error::new(
            error.kind(),
            format!("{error}; what was made is in {}", path.display()),
        ),
        Err(_) => error,
    }
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
    let folder = folder_of(output);
    remove_left(folder);
    let made = tempfile::Builder::new()
        .prefix(TEMPORARY_PREFIX)
        .permissions(readable_by_all())
        .tempfile_in(folder);
    // Its own sentence names a file that nobody asked for, behind the reason.
    made.map_err(|error| {
        let (folder, said) = (folder.display(), error.to_string());
        let why = said.split(" at path ").next().unwrap_or_default();
        io::Error::new(
            error.kind(),
            format!("the folder {folder} takes no file ({why}): name one that is there, has room and that you may write to"),
        )
    })
}

/// Removes the temporary files that killed processes left in a folder. What cannot be removed
/// stays: it is only room.
fn remove_left(folder: &Path) {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    for entry in entries {
        let name = entry.file_name();
        let is_temporary = name.to_string_lossy().starts_with(TEMPORARY_PREFIX);
        if is_temporary && is_left(&entry.path()) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Whether nobody has a temporary file locked, as who writes it has, and it is no new one.
fn is_left(path: &Path) -> bool {
    // Over NFS only what is open for writing is locked alone.
    let opened = File::options().read(true).write(true).open(path);
    opened.is_ok_and(|file| is_old(&file) && file.try_lock().is_ok())
}

fn is_old(file: &File) -> bool {
    let modified = file.metadata().and_then(|of| of.modified());
    let age = modified.ok().and_then(|at| at.elapsed().ok());
    age.is_some_and(|age| age > LEFT_AGE)
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
    use std::os::unix::fs::{FileTypeExt, symlink};
    use std::time::{SystemTime, UNIX_EPOCH};

    #[test]
    fn a_folder_that_is_not_there_is_named_and_no_temporary_file() {
        let folder = tempfile::tempdir().unwrap();
        let error = try_output(&folder.path().join("none/a.spm")).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::NotFound);
        let said = error.to_string();
        assert!(said.contains("none takes no file"), "{said}");
        assert!(!said.contains(TEMPORARY_PREFIX), "{said}");
    }

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
    fn of_a_link_what_it_leads_to_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["far", "near"] {
            fs::create_dir(at(name)).unwrap();
        }
        fs::write(at("far/old"), b"old").unwrap();
        // From its own folder, before it is there, and over another link.
        let links = [
            ("../far/old", "near/old"),
            ("../far/new", "near/new"),
            ("next", "near/twice"),
        ];
        symlink("../far/next", at("near/next")).unwrap();
        for (target, link) in links {
            symlink(target, at(link)).unwrap();
            try_output(&at(link)).unwrap();
            write_atomically(&at(link), |out| out.write_all(b"whole")).unwrap();
            assert_eq!(fs::read_link(at(link)).unwrap(), Path::new(target));
            assert_eq!(fs::read(at(link)).unwrap(), b"whole");
        }
        assert!(fs::read_link(at("near/next")).is_ok());
        for (name, files) in [("far", 3), ("near", 4)] {
            assert_eq!(fs::read_dir(at(name)).unwrap().count(), files, "{name}");
        }
    }

    #[test]
    fn a_name_that_no_file_can_have_is_refused_before_anything_is_made() {
        let folder = tempfile::tempdir().unwrap();
        let long = format!("{}.spm", "n".repeat(260));
        for name in ["out.spm/", &long] {
            assert!(try_output(&folder.path().join(name)).is_err(), "{name}");
        }
        assert!(try_output(&folder.path().join("out.spm")).is_ok());
    }

    #[test]
    fn what_cannot_be_renamed_is_kept_once_and_the_error_names_it() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("model.spm");
        for work in [b"minutes of work", b"and once again."] {
            let written = write_atomically(&output, |out| {
                fs::create_dir(&output)?;
                out.write_all(work)
            });
            fs::remove_dir(&output).unwrap();
            let sentence = written.unwrap_err().to_string();
            let (_, kept) = sentence.split_once("what was made is in ").unwrap();
            assert_eq!(fs::read(kept).unwrap(), work);
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
            let name = Path::new(kept).file_name().unwrap().to_string_lossy();
            assert!(!name.starts_with('.'), "the next command removes {name}");
            assert!(name.ends_with(".spm"), "{name} is not taken as it is");
        }
    }

    #[test]
    fn what_killed_processes_left_is_removed_and_what_is_written_stays() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(format!("{TEMPORARY_PREFIX}{name}"));
        let make = |name: &str, modified: SystemTime| {
            let file = File::create(at(name)).unwrap();
            file.set_modified(modified).unwrap();
            file
        };
        make("left", UNIX_EPOCH);
        // Not locked yet.
        make("new", SystemTime::now());
        let slow = make("slow", UNIX_EPOCH);
        slow.lock().unwrap();
        let output = folder.path().join("mesh");
        write_atomically(&output, |out| out.write_all(b"whole")).unwrap();
        let are_there = ["left", "new", "slow"].map(|name| at(name).exists());
        assert_eq!(are_there, [false, true, true]);
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
