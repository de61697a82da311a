//! Files of other machines, kept in the user's cache folder by the hash of their content.

use protocol::FileHash;
use scene::FileKind;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// The folder of what can be made or fetched again: `$HRTC_CACHE`, else `hrtc/models` in the user's
/// cache. `None` when neither that nor a home is known.
#[must_use]
pub fn cache_folder() -> Option<PathBuf> {
    match std::env::var_os("HRTC_CACHE") {
        Some(folder) if !folder.is_empty() => Some(folder.into()),
        _ => dirs::cache_dir().map(|folder| folder.join("hrtc").join("models")),
    }
}

/// The folder of recordings whose place nobody named: `hrtc/recordings` in the user's folder of
/// state. `None` when no home is known.
#[must_use]
pub fn recordings_folder() -> Option<PathBuf> {
    let state = dirs::state_dir().or_else(dirs::data_local_dir)?;
    Some(state.join("hrtc").join("recordings"))
}

/// Kept files. A content is checked whenever it is read, so a damaged or foreign file is none.
#[derive(Debug, Clone)]
pub struct FileCache {
    folder: PathBuf,
}

impl FileCache {
    /// The files in a folder, which need not exist.
    #[must_use]
    pub fn new(folder: &Path) -> Self {
        Self {
            folder: folder.to_owned(),
        }
    }

    /// The folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Where a file lies, if it is there.
    #[must_use]
    pub fn path(&self, kind: FileKind, hash: FileHash) -> PathBuf {
        self.folder.join(format!("{hash}.{}", kind.ending()))
    }

    /// The content of a hash; `None` when it is not kept, or damaged.
    #[must_use]
    pub fn get(&self, kind: FileKind, hash: FileHash) -> Option<Vec<u8>> {
        let content = fs::read(self.path(kind, hash)).ok()?;
        (FileHash::of(&content) == hash).then_some(content)
    }

    /// Keeps a content. It appears whole or not at all.
    ///
    /// # Errors
    /// When the folder cannot be written.
    pub fn put(&self, kind: FileKind, hash: FileHash, content: &[u8]) -> io::Result<()> {
        fs::create_dir_all(&self.folder)?;
        let mut file = tempfile::NamedTempFile::new_in(&self.folder)?;
        file.write_all(content)?;
        file.persist(self.path(kind, hash)).map_err(|e| e.error)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_found_again_unless_it_is_damaged() {
        let folder = tempfile::tempdir().unwrap();
        let cache = FileCache::new(&folder.path().join("of").join("files"));
        let (kind, content) = (FileKind::Trajectory, b"0,0,0,0\n".as_slice());
        let hash = FileHash::of(content);
        assert_eq!(cache.get(kind, hash), None);
        cache.put(kind, hash, content).unwrap();
        assert_eq!(cache.get(kind, hash).as_deref(), Some(content));
        assert_eq!(fs::read_dir(cache.folder()).unwrap().count(), 1);
        fs::write(cache.path(kind, hash), b"0,0,0,1\n").unwrap();
        assert_eq!(cache.get(kind, hash), None);
        cache.put(kind, hash, content).unwrap();
        assert_eq!(cache.get(kind, hash).as_deref(), Some(content));
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let cache = FileCache::new(&file);
        assert!(cache.put(FileKind::Tool, FileHash(1), b"").is_err());
    }
}
