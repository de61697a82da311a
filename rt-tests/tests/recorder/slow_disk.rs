//! A disk that takes nothing for a while: records are lost and marked, and the rest replays.

use super::world::{SCENES, World};
use super::{place, replayed};
use hrtc::recorder::{Entry, RecordingReader};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;

/// Far more ticks than the recorder's queue holds, and those of the time after which it tries
/// again.
const TICKS: usize = 36_000;
/// Ticks between two rests of the run: four times as fast as in real time.
const PACE: usize = 40;

/// A pipe where the first file should be: whoever writes into it waits for a reader.
struct StuckDisk {
    release: Sender<()>,
    /// Gives what was written.
    reader: JoinHandle<Vec<u8>>,
}

impl StuckDisk {
    fn new(path: &Path) -> Self {
        let made = Command::new("mkfifo").arg(path).status();
        assert!(made.unwrap().success());
        let path = path.to_path_buf();
        let (release, released) = channel();
        let reader = std::thread::spawn(move || {
            let mut file = File::open(path).unwrap();
            let _ = released.recv();
            let mut bytes = Vec::new();
            file.read_to_end(&mut bytes).unwrap();
            bytes
        });
        Self { release, reader }
    }

    fn release(&self) {
        let _ = self.release.send(());
    }

    /// Writes all that reached the disk into a file.
    fn save(self, path: &Path) {
        self.release();
        std::fs::write(path, self.reader.join().unwrap()).unwrap();
    }
}

#[test]
fn a_slow_disk_costs_records_that_are_marked_and_the_others_replay() {
    let folder = tempfile::tempdir().unwrap();
    let world = World::run(folder.path(), "ball", SCENES[0].1, TICKS);
    let place = place(folder.path(), 1 << 30);
    let disk = StuckDisk::new(&place.first);
    let mut lost_at = None;
    let kept = world.record_at(PACE, place, None, |recorder, tick| {
        if recorder.has_lost() && lost_at.is_none() {
            lost_at = Some(tick);
            disk.release();
        }
    });
    assert!(lost_at.is_some(), "the queue bridges the whole run");
    let first = folder.path().join("first.mcap");
    disk.save(&first);
    let files: Vec<PathBuf> = [first]
        .into_iter()
        .chain(kept.into_iter().skip(1))
        .collect();
    assert!(files.len() >= 2, "no file after the hole: {files:?}");
    let (recorded, marked) = contents(&files);
    eprintln!("lost at {lost_at:?}: {} of {TICKS} ticks", recorded.len());
    let all = 0..TICKS as u64;
    assert!(
        all.clone()
            .all(|tick| recorded.contains(&tick) || marked.contains(&tick))
    );
    assert!(recorded.len() < TICKS && recorded.last() == Some(&(all.end - 1)));
    for path in &files {
        let found = replayed(path);
        assert!(
            found.equal && found.ticks > 0,
            "{}: {found:?}",
            path.display()
        );
        assert_eq!(
            found.ticks,
            contents(std::slice::from_ref(path)).0.len() as u64
        );
    }
}

/// The ticks that are in some files, and those that they say are missing.
fn contents(files: &[PathBuf]) -> (BTreeSet<u64>, BTreeSet<u64>) {
    let (mut recorded, mut marked) = (BTreeSet::new(), BTreeSet::new());
    for entry in files
        .iter()
        .flat_map(|path| RecordingReader::open(path).unwrap())
    {
        match entry {
            Entry::Tick(record) => _ = recorded.insert(record.tick),
            Entry::Hole(hole) => marked.extend(hole.first..=hole.last),
            _ => {}
        }
    }
    (recorded, marked)
}
