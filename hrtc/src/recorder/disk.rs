//! The thread that writes a recording's files, so that a disk that stalls holds up nothing else.

use super::RecordingError;
use super::reader::RecordingReader;
use crate::tuning::{DISK_STACK_BYTES, RECORDING_JOBS, RECORDING_QUEUE_BYTES, RECORDING_TIMEOUT};
use std::collections::VecDeque;
use std::ffi::OsStr;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant, UNIX_EPOCH};

/// Where a run's recording lies, and how much may.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordingPlace {
    /// The first file; later ones have a number before the extension.
    pub first: PathBuf,
    /// Bytes that all files may have together.
    pub keep_bytes: u64,
    /// Whether the folder is hrtc's own, so that recordings of earlier runs in it count and are
    /// deleted too.
    pub owns_folder: bool,
}

impl RecordingPlace {
    /// Bytes after which a file ends: four of them fit, with room for the end of each.
    #[must_use]
    pub fn file_bytes(&self) -> u64 {
        self.keep_bytes / 4 - self.keep_bytes / 64
    }

    /// Bytes to keep that give files of so many bytes, rounded up to whole MiB.
    pub(super) fn keep_for(file_bytes: u64) -> u64 {
        // The inverse of `file_bytes`: a file has 15 of 64 parts.
        (file_bytes * 64).div_ceil(15 << 20) << 20
    }

    /// Path of a file of the run, from 0.
    #[must_use]
    pub fn path(&self, number: u32) -> PathBuf {
        if number == 0 {
            return self.first.clone();
        }
        let stem = self.first.file_stem().unwrap_or_default();
        let mut name = stem.to_os_string();
        name.push(format!("-{number:04}"));
        if let Some(extension) = self.first.extension() {
            name.push(".");
            name.push(extension);
        }
        self.first.with_file_name(name)
    }

    /// Removes the later files of an earlier run of the same name: beside those of this one they
    /// would be taken for its own. What a running process holds stays, and what is no later file of
    /// a run by its own word.
    fn remove_later_files(&self) {
        let folder = self.first.parent().filter(|of| !of.as_os_str().is_empty());
        let entries = std::fs::read_dir(folder.unwrap_or(Path::new(".")));
        for entry in entries.into_iter().flatten().flatten() {
            let is_file = entry.file_type().is_ok_and(|of| of.is_file());
            let is_named = is_file && self.number_of(&entry.file_name()).is_some();
            if is_named && is_free(&entry.path()) && is_later_file(&entry.path()) {
                remove(&entry.path());
            }
        }
    }

    /// Number of a later file of the run, by its name.
    fn number_of(&self, name: &OsStr) -> Option<u32> {
        let stem = self.first.file_stem()?.as_encoded_bytes();
        let rest = name.as_encoded_bytes().strip_prefix(stem)?;
        let digits = rest.strip_prefix(b"-")?;
        let end = digits.iter().position(|of| !of.is_ascii_digit());
        let (digits, _) = digits.split_at(end.unwrap_or(digits.len()));
        let number: u32 = std::str::from_utf8(digits).ok()?.parse().ok()?;
        // Its own path only: no other number of digits, nor another extension.
        let is_later = number > 0 && self.path(number).file_name() == Some(name);
        is_later.then_some(number)
    }
}

/// Work of the thread, each with the first tick that is lost where it cannot be done.
enum Job {
    /// Begin the file of this number.
    Begin(u32, u64),
    /// Add bytes to it.
    Bytes(Vec<u8>, u64),
}

/// Tries to lock a file that another one looks at, and the pause between two.
const LOCK_TRIES: u32 = 10;
const LOCK_PAUSE: Duration = Duration::from_millis(5);

/// No tick is lost.
const NOTHING: u64 = u64::MAX;

/// News of the thread.
#[derive(Debug)]
struct News {
    /// Bytes that wait.
    queued: AtomicUsize,
    /// Whether the present file takes no more bytes.
    failed: AtomicBool,
    /// The first tick whose bytes are in no file, or [`NOTHING`].
    lost_from: AtomicU64,
    /// Why.
    reason: Mutex<String>,
}

/// The recorder's end of the thread.
pub(super) struct Disk {
    jobs: SyncSender<Job>,
    news: Arc<News>,
    done: Receiver<Vec<PathBuf>>,
}

impl Disk {
    /// Starts the thread with the first file, which is opened here so that a bad path is told.
    ///
    /// # Errors
    /// When the first file cannot be created or there is no thread.
    pub(super) fn start(place: RecordingPlace) -> Result<Self, RecordingError> {
        let (jobs, work) = sync_channel(RECORDING_JOBS);
        let (report, done) = sync_channel(1);
        let news = Arc::new(News {
            queued: AtomicUsize::new(0),
            failed: AtomicBool::new(false),
            lost_from: AtomicU64::new(NOTHING),
            reason: Mutex::default(),
        });
        let mut files = Files::new(place, Arc::clone(&news));
        let first = files.place.path(0);
        files
            .begin(0)
            .map_err(|e| RecordingError::NewFile(first.display().to_string(), e))?;
        if !files.place.owns_folder {
            files.place.remove_later_files();
        }
        std::thread::Builder::new()
            .name("hrtc-disk".to_owned())
            .stack_size(DISK_STACK_BYTES)
            .spawn(move || {
                for job in work {
                    files.take(job);
                }
                drop(files.file.take());
                files.locks.clear();
                files.drop_empty();
                let _ = report.send(files.own.into_iter().map(|(path, _)| path).collect());
            })
            .map_err(RecordingError::Thread)?;
        Ok(Self { jobs, news, done })
    }

    /// Begins another file, whose keyframe is that before a tick.
    pub(super) fn begin(&self, number: u32, tick: u64) -> bool {
        // That of a file before says nothing of the bytes that follow now.
        self.news.failed.store(false, Ordering::Release);
        self.jobs.try_send(Job::Begin(number, tick)).is_ok()
    }

    /// Hands over bytes that begin with a tick; `false` when they are lost, since the disk is slow
    /// or refuses.
    pub(super) fn write(&self, bytes: Vec<u8>, tick: u64) -> bool {
        let length = bytes.len();
        let queued = self.news.queued.load(Ordering::Acquire);
        // Not the length added: the files of a scene, which each file of a recording begins with,
        // may be longer than all that may wait before them.
        if queued > RECORDING_QUEUE_BYTES || self.news.failed.load(Ordering::Acquire) {
            return false;
        }
        self.news.queued.fetch_add(length, Ordering::AcqRel);
        let sent = self.jobs.try_send(Job::Bytes(bytes, tick)).is_ok();
        if !sent {
            self.news.queued.fetch_sub(length, Ordering::AcqRel);
        }
        sent
    }

    /// Whether nothing waits.
    pub(super) fn is_idle(&self) -> bool {
        self.news.queued.load(Ordering::Acquire) == 0
    }

    /// Why the present file takes no more bytes.
    pub(super) fn failure(&self) -> Option<String> {
        let failed = self.news.failed.load(Ordering::Acquire);
        failed.then(|| self.reason())
    }

    /// Whether bytes that were handed over are in no file.
    pub(super) fn has_lost(&self) -> bool {
        self.news.lost_from.load(Ordering::Acquire) != NOTHING
    }

    /// The first tick of such bytes since this was asked: what waited behind them is lost, too.
    pub(super) fn take_lost(&self) -> Option<u64> {
        let tick = self.news.lost_from.swap(NOTHING, Ordering::AcqRel);
        (tick != NOTHING).then_some(tick)
    }

    /// Why the disk took no bytes the last time.
    pub(super) fn reason(&self) -> String {
        self.news
            .reason
            .lock()
            .map_or_else(|_| String::new(), |of| of.clone())
    }

    /// Waits for the last byte; the files that are kept, oldest first. A disk that hangs is left
    /// behind after [`RECORDING_TIMEOUT`]: `None`.
    pub(super) fn finish(self) -> Option<Vec<PathBuf>> {
        drop(self.jobs);
        self.done.recv_timeout(RECORDING_TIMEOUT).ok()
    }

    /// Waits until nothing waits any more, for this time at the most.
    pub(super) fn wait(&self, most: Duration) {
        self.wait_until(|queued| queued == 0, Instant::now() + most);
    }

    /// Waits until it is enough, by the number of bytes that wait, and no longer than until a time.
    pub(super) fn wait_until(&self, is_enough: impl Fn(usize) -> bool, end: Instant) {
        let is_over = || is_enough(self.news.queued.load(Ordering::Acquire));
        // By the clock: on a busy core a sleep is longer than asked for.
        while !is_over() && self.failure().is_none() && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

/// The files of the thread.
struct Files {
    place: RecordingPlace,
    news: Arc<News>,
    file: Option<File>,
    /// Files of this run that are kept, and their bytes; the last one is being written.
    own: VecDeque<(PathBuf, u64)>,
    /// Kept files of a name that another run may have too, held open: their locks last as long.
    locks: Vec<(PathBuf, File)>,
}

impl Files {
    fn new(place: RecordingPlace, news: Arc<News>) -> Self {
        Self {
            place,
            news,
            file: None,
            own: VecDeque::new(),
            locks: Vec::new(),
        }
    }

    fn take(&mut self, job: Job) {
        let (done, tick) = match &job {
            Job::Begin(number, tick) => (self.begin(*number), tick),
            Job::Bytes(bytes, tick) => (self.write(bytes), tick),
        };
        if let Err(error) = done {
            self.fail(&error, *tick);
        }
        if let Job::Bytes(bytes, _) = job {
            self.news.queued.fetch_sub(bytes.len(), Ordering::AcqRel);
        }
    }

    fn begin(&mut self, number: u32) -> io::Result<()> {
        self.file = None;
        self.drop_empty();
        self.make_room()?;
        let own = &self.own;
        self.locks
            .retain(|(path, _)| own.iter().any(|of| of.0 == *path));
        let path = self.place.path(number);
        let mut options = OpenOptions::new();
        let file = options
            .create(true)
            // Over NFS only what is open for reading takes a shared lock; a pipe has one reader.
            .read(!path.metadata().is_ok_and(|of| !of.is_file()))
            .write(true)
            // Only once it is known to be nobody else's.
            .truncate(false)
            .open(&path)?;
        take_over(&file)?;
        // A copy shares the lock; one of a pipe would keep its reader from the end.
        if !self.place.owns_folder && file.metadata()?.is_file() {
            self.locks.push((path.clone(), file.try_clone()?));
        }
        self.own.push_back((path, 0));
        self.file = Some(file);
        self.news.failed.store(false, Ordering::Release);
        Ok(())
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        let (Some(file), Some((_, written))) = (&mut self.file, self.own.back_mut()) else {
            return Ok(());
        };
        file.write_all(bytes)?;
        *written += bytes.len() as u64;
        Ok(())
    }

    /// No more bytes into this file, from a tick on.
    fn fail(&mut self, error: &io::Error, tick: u64) {
        self.file = None;
        self.drop_empty();
        if let Ok(mut reason) = self.news.reason.lock() {
            *reason = error.to_string();
        }
        self.news.lost_from.fetch_min(tick, Ordering::AcqRel);
        self.news.failed.store(true, Ordering::Release);
    }

    /// Removes the last file if nothing came into it: it is no recording.
    fn drop_empty(&mut self) {
        if let Some((path, 0)) = self.own.back() {
            remove(path);
            self.own.pop_back();
        }
    }

    /// Deletes the oldest files until another one fits.
    fn make_room(&mut self) -> io::Result<()> {
        let room = self.place.keep_bytes - self.place.file_bytes();
        let mut others = VecDeque::new();
        if self.place.owns_folder {
            others = earlier_runs(&self.place.first)?;
            // Those of this run that are closed are nobody else's.
            others.retain(|(path, _)| !self.own.iter().any(|(own, _)| own == path));
        }
        let used = |files: &VecDeque<(PathBuf, u64)>| files.iter().map(|of| of.1).sum::<u64>();
        while used(&self.own) + used(&others) > room {
            let oldest = others.pop_front().or_else(|| self.own.pop_front());
            let Some((path, _)) = oldest else { break };
            remove(&path);
        }
        Ok(())
    }
}

/// Empties a file and shares its lock as long as it or a copy of it is open, which another run of
/// hrtc must neither write nor delete then; where there are no locks, it may.
///
/// # Errors
/// When another run writes it: both would spoil each other's recording.
fn take_over(file: &File) -> io::Result<()> {
    // Devices and pipes take the bytes of whoever writes.
    if file.metadata()?.is_file() {
        if matches!(tried(|| file.try_lock()), Err(TryLockError::WouldBlock)) {
            return Err(io::Error::other("another run is writing it"));
        }
        file.set_len(0)?;
    }
    let _ = tried(|| file.try_lock_shared());
    Ok(())
}

/// The answer to who locks a file: who looks whether it is free holds it for a moment.
fn tried(lock: impl Fn() -> Result<(), TryLockError>) -> Result<(), TryLockError> {
    for _ in 1..LOCK_TRIES {
        match lock() {
            Err(TryLockError::WouldBlock) => std::thread::sleep(LOCK_PAUSE),
            locked => return locked,
        }
    }
    lock()
}

/// Removes a file of ours; never a device such as /dev/full.
fn remove(path: &Path) {
    if std::fs::symlink_metadata(path).is_ok_and(|of| of.is_file()) {
        let _ = std::fs::remove_file(path);
    }
}

/// What Linux answers where a server has no locks.
const ENOLCK: i32 = 37;

/// Whether a running process may hold a file, by the answer to who would lock it: where the file
/// system has no locks, nobody does.
fn is_held(locked: &Result<(), TryLockError>) -> bool {
    match locked {
        Ok(()) => false,
        Err(TryLockError::WouldBlock) => true,
        Err(TryLockError::Error(error)) => {
            error.kind() != io::ErrorKind::Unsupported && error.raw_os_error() != Some(ENOLCK)
        }
    }
}

/// Whether a recording says that it is a file behind the first one of a run.
fn is_later_file(path: &Path) -> bool {
    RecordingReader::open(path).is_ok_and(|reader| reader.head().segment > 0)
}

/// Whether no running process holds a file that can be opened.
fn is_free(path: &Path) -> bool {
    // Over NFS only what is open for writing is locked alone.
    let opened = OpenOptions::new().read(true).write(true).open(path);
    opened.is_ok_and(|file| !is_held(&file.try_lock()))
}

/// Recordings beside this one that no running process holds, the oldest first.
fn earlier_runs(first: &Path) -> io::Result<VecDeque<(PathBuf, u64)>> {
    let Some(folder) = first.parent() else {
        return Ok(VecDeque::new());
    };
    std::fs::create_dir_all(folder)?;
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let path = entry.path();
        // Another run may have deleted it.
        let Ok(metadata) = entry.metadata() else {
            continue;
        };
        let is_recording = path.extension().is_some_and(|of| of == "mcap");
        if !is_recording || !metadata.is_file() {
            continue;
        }
        if is_free(&path) {
            found.push((
                metadata.modified().unwrap_or(UNIX_EPOCH),
                path,
                metadata.len(),
            ));
        }
    }
    found.sort();
    Ok(found.into_iter().map(|of| (of.1, of.2)).collect())
}

#[cfg(test)]
mod tests;
