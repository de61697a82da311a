//! Maps a file into memory, for reading.

use memmap2::Mmap;
use std::fs::File;
use std::io;
use std::path::Path;

/// Maps a whole file; a folder is an error.
pub(crate) fn map(path: &Path) -> io::Result<Mmap> {
    let file = File::open(path)?;
    if file.metadata()?.is_dir() {
        return Err(io::ErrorKind::IsADirectory.into());
    }
    // SAFETY: the bytes are only read, as plain numbers that are validated at every use, so a
    // change by another program gives a wrong number at worst. Files are replaced by rename, never
    // cut short.
    unsafe { Mmap::map(&file) }
}
