//! The bytes of a file, for reading.
//!
//! A file that is overwritten in place, or whose disk fails, kills whoever touches a page of its
//! map (SIGBUS). So files are read into memory, up to a size; what changes on the disk later
//! changes nothing here. Only larger ones, of which the map saves more than it risks, are mapped,
//! and that is said.

use crate::tuning::models::MAX_READ_BYTES;
use memmap2::Mmap;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// All bytes of a file.
#[derive(Debug)]
pub enum FileBytes {
    /// Read; in words, since the records of a model are looked at where they are.
    Read(Vec<u64>, usize),
    /// Mapped: too large to be read.
    Mapped(Mmap),
}

impl FileBytes {
    /// Reads or maps a whole file.
    ///
    /// # Errors
    /// When it is no file, the operating system says no, or the file changes its length while it is
    /// read.
    pub fn open(path: &Path) -> io::Result<Self> {
        Self::open_below(path, MAX_READ_BYTES)
    }

    fn open_below(path: &Path, largest: u64) -> io::Result<Self> {
        // Before it is opened: a pipe would wait for who writes it.
        let metadata = std::fs::metadata(path)?;
        if metadata.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        if !metadata.is_file() {
            let kind = io::ErrorKind::InvalidInput;
            return Err(io::Error::new(kind, "this is no file"));
        }
        let mut file = File::open(path)?;
        let length = file.metadata()?.len();
        if length <= largest {
            let length = length as usize;
            let mut words = vec![0u64; length.div_ceil(8)];
            file.read_exact(&mut bytemuck::cast_slice_mut(&mut words)[..length])?;
            return Ok(Self::Read(words, length));
        }
        tracing::warn!(
            "{} is too large to be read and is mapped: replace it by renaming another file, never overwrite it",
            path.display()
        );
        // SAFETY: the bytes are only read, as plain numbers that are validated at every use, so a
        // change by another program gives a wrong number. A file cut short ends this process: the
        // warning says so.
        Ok(Self::Mapped(unsafe { Mmap::map(&file) }?))
    }
}

impl AsRef<[u8]> for FileBytes {
    fn as_ref(&self) -> &[u8] {
        match self {
            Self::Read(words, length) => &bytemuck::cast_slice(words)[..*length],
            Self::Mapped(map) => map,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_pipe_is_refused_and_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        if !made.is_ok_and(|status| status.success()) {
            println!("skipped: there is no mkfifo");
            return;
        }
        let (sender, opened) = std::sync::mpsc::channel();
        std::thread::spawn(move || sender.send(FileBytes::open(&pipe).map(|_| ())));
        // So long only where it waits for a writer that never comes.
        let error = opened.recv_timeout(Duration::from_secs(60));
        let error = error.expect("it does not wait").unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::InvalidInput);
        assert_eq!(error.to_string(), "this is no file");
    }

    #[test]
    fn a_file_that_is_cut_short_or_overwritten_stays_what_it_was_when_it_was_opened() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model");
        let content: Vec<u8> = (0..100_001u32).map(|k| k as u8).collect();
        std::fs::write(&path, &content).unwrap();
        let bytes = FileBytes::open(&path).unwrap();
        File::options()
            .write(true)
            .open(&path)
            .unwrap()
            .set_len(0)
            .unwrap();
        // A map would end the test here: its pages are gone.
        assert_eq!(bytes.as_ref(), content);
        std::fs::write(&path, vec![7; content.len()]).unwrap();
        assert_eq!(bytes.as_ref(), content);
    }

    #[test]
    fn read_and_mapped_files_are_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model");
        for length in [1usize, 7, 8, 4097] {
            std::fs::write(&path, vec![3; length]).unwrap();
            let (read, mapped) = (
                FileBytes::open(&path).unwrap(),
                FileBytes::open_below(&path, 0).unwrap(),
            );
            assert!(matches!(mapped, FileBytes::Mapped(_)));
            assert_eq!(read.as_ref(), mapped.as_ref());
        }
        assert!(FileBytes::open(folder.path()).is_err());
    }
}
