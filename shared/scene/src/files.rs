//! Access to the files that a scene names.

use std::io;
use std::path::{Path, PathBuf};

/// Files as the host of a scene hands them in. A scene itself opens no file.
pub trait Files {
    /// All bytes of a file.
    ///
    /// # Errors
    /// When the file cannot be read.
    fn read(&self, path: &Path) -> io::Result<Vec<u8>>;

    /// The path from the root of the host's file system.
    ///
    /// # Errors
    /// When the current folder is not known.
    fn absolute(&self, path: &Path) -> io::Result<PathBuf>;
}

/// Host without files: every read fails, every path stays as it is.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoFiles;

impl Files for NoFiles {
    fn read(&self, _: &Path) -> io::Result<Vec<u8>> {
        Err(io::ErrorKind::NotFound.into())
    }

    fn absolute(&self, path: &Path) -> io::Result<PathBuf> {
        Ok(path.to_path_buf())
    }
}

/// A file as text; the error of bytes that are not UTF-8 is that of `std::fs::read_to_string`.
pub(crate) fn read_text(files: &dyn Files, path: &Path) -> io::Result<String> {
    String::from_utf8(files.read(path)?).map_err(|_| {
        io::Error::new(
            io::ErrorKind::InvalidData,
            "stream did not contain valid UTF-8",
        )
    })
}
