//! The files of a scene, read from the disk. This is the only place where a scene meets a file
//! system; the crate `scene` itself gets files as values.
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

#![forbid(unsafe_code)]

use std::io;
use std::path::{Path, PathBuf};

/// Files of this machine.
#[derive(Debug, Clone, Copy, Default)]
pub struct DiskFiles;

impl scene::Files for DiskFiles {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        std::fs::read(path)
    }

    fn absolute(&self, path: &Path) -> io::Result<PathBuf> {
        std::path::absolute(path)
    }
}
