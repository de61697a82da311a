//! Files of other machines, kept in the user's cache folder by the hash of their content.

use crate::MAX_SCENE_BYTES;
use protocol::FileHash;
use scene::FileKind;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// How the names of temporary files begin.
const TEMPORARY_PREFIX: &str = ".hrtc-file-";
/// Age from which one that nobody has locked is left of a process that was killed: whoever makes
/// one locks it at once.
const LEFT_AGE: Duration = Duration::from_secs(60);
/// Bytes that all files may have together: two of the largest scenes.
const MAX_KEPT_BYTES: u64 = 2 * MAX_SCENE_BYTES;

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

/// Kept files, at most 2 GiB of them: beyond, those go that were not used for longest. A content is
/// checked whenever it is read, so a damaged or foreign file is none.
#[derive(Debug, Clone)]
pub struct FileCache {
    folder: PathBuf,
    max_bytes: u64,
}

impl FileCache {
    /// The files in a folder, which need not exist.
    #[must_use]
    pub fn new(folder: &Path) -> Self {
        Self {
            folder: folder.to_owned(),
            max_bytes: MAX_KEPT_BYTES,
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
        let path = self.path(kind, hash);
        let content = fs::read(&path).ok()?;
        if FileHash::of(&content) != hash {
            return None;
        }
        note_use(&path);
        Some(content)
    }

    /// Keeps a content, with room made for it. It appears whole or not at all.
    ///
    /// # Errors
    /// When the folder cannot be written.
    pub fn put(&self, kind: FileKind, hash: FileHash, content: &[u8]) -> io::Result<()> {
        fs::create_dir_all(&self.folder)?;
        remove_left(&self.folder);
        let most = self.max_bytes.saturating_sub(content.len() as u64);
        make_room(&self.folder, most, Duration::ZERO, is_kept_file);
        let mut file = tempfile::Builder::new()
            .prefix(TEMPORARY_PREFIX)
            .tempfile_in(&self.folder)?;
        // Who makes room leaves alone what is locked, and everything where there are no locks; who
        // looks whether it is holds it for a moment.
        let _ = file.as_file().lock();
        file.write_all(content)?;
        file.persist(self.path(kind, hash)).map_err(|e| e.error)?;
        Ok(())
    }
}

/// Notes that a file is used, for [`make_room`]. Where that cannot be noted, it goes earlier.
pub fn note_use(path: &Path) {
    let opened = File::options().write(true).open(path);
    let _ = opened.and_then(|file| file.set_modified(SystemTime::now()));
}

/// Removes files of a folder whose name is ours, those first that were not used for longest, until
/// the rest has at most so many bytes; none that was used within this time. What cannot be removed
/// stays: it is only room.
pub fn make_room(folder: &Path, max_bytes: u64, unused: Duration, is_ours: impl Fn(&str) -> bool) {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let ours = entries.filter(|entry| is_ours(&entry.file_name().to_string_lossy()));
    let with_use = ours.filter_map(|entry| {
        let of = entry.metadata().ok()?;
        Some((of.modified().unwrap_or(UNIX_EPOCH), of.len(), entry.path()))
    });
    let mut files: Vec<(SystemTime, u64, PathBuf)> = with_use.collect();
    files.sort();
    let mut all: u64 = files.iter().map(|of| of.1).sum();
    for (used, bytes, path) in files {
        // By a clock that was set back since, it is used now.
        let is_used = used.elapsed().unwrap_or_default() < unused;
        if all <= max_bytes || is_used {
            break;
        }
        if fs::remove_file(path).is_ok() {
            all -= bytes;
        }
    }
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

/// Whether a file is named as [`FileCache::path`] names them: other files of the folder are not
/// ours.
fn is_kept_file(name: &str) -> bool {
    let kinds = [FileKind::Tool, FileKind::Trajectory, FileKind::HeightMap];
    let parts = name.split_once('.');
    parts.is_some_and(|(hash, ending)| {
        hash.parse::<FileHash>().is_ok() && kinds.iter().any(|kind| kind.ending() == ending)
    })
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

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<String> = names.collect();
        names.sort();
        names
    }

    #[test]
    fn what_a_killed_put_left_is_removed_and_what_is_written_stays() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let temporary = ["left", "new", "written"].map(|of| format!("{TEMPORARY_PREFIX}{of}"));
        let [left, new, written] = &temporary;
        for name in [left.as_str(), new, written, "notes.txt"] {
            fs::write(at(name), b"0,0").unwrap();
        }
        let long_ago = |name: &str| {
            let file = File::options().write(true).open(at(name)).unwrap();
            file.set_modified(UNIX_EPOCH).unwrap();
            file
        };
        long_ago(left);
        // Another one is new: whoever made it is about to lock it.
        let writer = long_ago(written);
        writer.lock().unwrap();
        let cache = FileCache::new(folder.path());
        let (kind, content) = (FileKind::Trajectory, b"0,0,0,0\n".as_slice());
        let hash = FileHash::of(content);
        cache.put(kind, hash, content).unwrap();
        let file = format!("{hash}.csv");
        let expected = [new.as_str(), written, &file, "notes.txt"];
        assert_eq!(names(folder.path()), expected);
        assert_eq!(cache.get(kind, hash).as_deref(), Some(content));
    }

    #[test]
    fn of_too_many_bytes_those_go_that_were_not_used_for_longest() {
        let folder = tempfile::tempdir().unwrap();
        let cache = FileCache {
            max_bytes: 10,
            ..FileCache::new(folder.path())
        };
        let kind = FileKind::HeightMap;
        let contents = [b"1111", b"2222", b"3333"];
        let hashes = contents.map(|content| FileHash::of(content));
        // A model that the station has built, and what somebody else keeps.
        for other in ["ball-0123456789abcdef-b18f7.spm", "notes.png"] {
            fs::write(folder.path().join(other), [0; 100]).unwrap();
        }
        for (seconds, (hash, content)) in (1..).zip(hashes.into_iter().zip(contents)).take(2) {
            cache.put(kind, hash, content).unwrap();
            let file = File::options().write(true).open(cache.path(kind, hash));
            let long_ago = UNIX_EPOCH + std::time::Duration::from_secs(seconds);
            file.unwrap().set_modified(long_ago).unwrap();
        }
        assert!(cache.get(kind, hashes[0]).is_some());
        cache.put(kind, hashes[2], contents[2]).unwrap();
        let kept = hashes.map(|hash| cache.get(kind, hash).is_some());
        assert_eq!(kept, [true, false, true]);
        assert_eq!(names(folder.path()).len(), 4);
    }

    #[test]
    fn what_was_used_of_late_stays_however_much_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["a", "b", "c"] {
            fs::write(at(name), [0; 10]).unwrap();
        }
        let file = File::options().write(true).open(at("b")).unwrap();
        file.set_modified(UNIX_EPOCH).unwrap();
        let hour = Duration::from_secs(3600);
        make_room(folder.path(), 5, hour, |name| name != "c");
        assert_eq!(names(folder.path()), ["a", "c"]);
        make_room(folder.path(), 5, Duration::ZERO, |name| name != "c");
        assert_eq!(names(folder.path()), ["c"]);
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
