//! The files of a scene, read from the disk. This is the only place where a scene meets a file
//! system; the crate `scene` itself gets files as values.
//!
//! | module | content |
//! |---|---|
//! | `package` | a scene and its files for a machine that has none of them |
//! | `cache` | files of other machines, kept in the user's cache folder |
//!
//! ```
//! use scene::Overrides;
//! use scene_files::DiskFiles;
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("touch.toml");
//! std::fs::write(&path, "[[object]]\nmodel = \"m.spm\"\nsize_m = 0.1\n[[probe]]\n")?;
//! let plan = scene::load(&path, &Overrides::default(), &DiskFiles)?;
//! assert_eq!(plan.name, "touch");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`NotingFiles`] keeps what it read, so that [`KeptFiles`] can serve the same scene without a
//! disk.

#![forbid(unsafe_code)]

mod cache;
mod package;

pub use cache::{FileCache, cache_folder, make_room, note_use, recordings_folder};
pub use package::{
    MAX_FILE_BYTES, MAX_MANIFEST_BYTES, MAX_SCENE_BYTES, Manifest, ManifestFile, Package,
    PackageError,
};

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

/// Files of this machine. A pipe or a device is refused: it might never end.
#[derive(Debug, Clone, Copy, Default)]
pub struct DiskFiles;

impl scene::Files for DiskFiles {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        // Before it is opened: a pipe would wait for who writes it.
        let of = std::fs::metadata(path)?;
        if !of.is_file() && !of.is_dir() {
            let kind = io::ErrorKind::InvalidInput;
            return Err(io::Error::new(kind, "this is no file"));
        }
        std::fs::read(path)
    }

    fn absolute(&self, path: &Path) -> io::Result<PathBuf> {
        std::path::absolute(path)
    }
}

/// Files by their content: what a scene read once, to be read again on any machine.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct KeptFiles {
    /// Content by the path that was asked for.
    pub contents: BTreeMap<PathBuf, Vec<u8>>,
    /// Paths from the root by the path that was asked for.
    pub absolute: BTreeMap<PathBuf, PathBuf>,
}

impl scene::Files for KeptFiles {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        let content = self.contents.get(path).cloned();
        content.ok_or_else(|| io::ErrorKind::NotFound.into())
    }

    fn absolute(&self, path: &Path) -> io::Result<PathBuf> {
        let absolute = self.absolute.get(path).cloned();
        absolute.ok_or_else(|| io::ErrorKind::NotFound.into())
    }
}

/// Files of this machine, of which everything that was read is kept.
#[derive(Debug, Default)]
pub struct NotingFiles {
    kept: RefCell<KeptFiles>,
}

impl NotingFiles {
    /// Everything that was read so far.
    #[must_use]
    pub fn into_kept(self) -> KeptFiles {
        self.kept.into_inner()
    }
}

impl scene::Files for NotingFiles {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        let bytes = DiskFiles.read(path)?;
        let mut kept = self.kept.borrow_mut();
        kept.contents.insert(path.to_path_buf(), bytes.clone());
        Ok(bytes)
    }

    fn absolute(&self, path: &Path) -> io::Result<PathBuf> {
        let absolute = DiskFiles.absolute(path)?;
        let mut kept = self.kept.borrow_mut();
        kept.absolute.insert(path.to_path_buf(), absolute.clone());
        Ok(absolute)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene::{Files as _, Overrides};
    use std::time::Duration;

    /// A station that waited in it would hear no signal.
    #[test]
    fn a_pipe_is_refused_and_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("path.csv");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        if !made.is_ok_and(|status| status.success()) {
            println!("skipped: there is no mkfifo");
            return;
        }
        let scene = folder.path().join("touch.toml");
        let text = "[[object]]\nmodel = \"m.spm\"\nsize_m = 0.1\n[[probe]]\n\
                    trajectory = { csv = \"path.csv\" }\n";
        std::fs::write(&scene, text).unwrap();
        let (sender, loaded) = std::sync::mpsc::channel();
        let load = move || scene::load(&scene, &Overrides::default(), &DiskFiles);
        std::thread::spawn(move || sender.send(load().map(|_| ())));
        // So long only where it waits for a writer that never comes.
        let refused = loaded.recv_timeout(Duration::from_secs(60));
        let refused = refused.expect("it does not wait").unwrap_err().0;
        assert!(
            refused.contains("line 5: the trajectory") && refused.contains("this is no file"),
            "{refused}"
        );
        let folder = DiskFiles.read(folder.path()).unwrap_err();
        assert_eq!(folder.kind(), io::ErrorKind::IsADirectory);
    }

    #[test]
    fn a_scene_is_the_same_from_the_files_that_it_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("touch.toml");
        let text = "[[object]]\nmodel = \"m.spm\"\nsize_m = 0.1\n[[probe]]\n\
                    trajectory = { csv = \"path.csv\" }\n";
        std::fs::write(&path, text).unwrap();
        let points = "0,0,0,0.1,1,0,0,0\n1,0,0,0.2,1,0,0,0\n";
        std::fs::write(folder.path().join("path.csv"), points).unwrap();
        let overrides = Overrides {
            model: Some("other.spm".into()),
            ..Overrides::default()
        };
        let noting = NotingFiles::default();
        let plan = scene::load(&path, &overrides, &noting).unwrap();
        let kept = noting.into_kept();
        drop(folder);
        assert_eq!(kept.contents.len(), 2);
        assert_eq!(scene::load(&path, &overrides, &kept), Ok(plan));
        let nothing = KeptFiles::default();
        assert!(scene::load(&path, &overrides, &nothing).is_err());
    }
}
