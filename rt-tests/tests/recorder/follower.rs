//! A recording that is read to its end, or behind the run: all its ticks, over all its files.

use crate::place;
use crate::world::{SCENES, World};
use hrtc::recorder::{Entry, Recorder, RecordingReader, Taps, Twin};
use hrtc::tick_record::TickRecord;
use hrtc::tuning::RECORDING_RETRY_NS;
use rt_tests::failure::Failure;
use rt_tests::pictures::course::{Screen, send};
use rt_tests::pictures::follower::{Follower, LOOK, Reach};
use rt_tests::pictures::pace::{Medium, Pace};
use scene::ScenePlan;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Ticks of a run.
const TICKS: u64 = 4000;
/// Bytes at the end of a file without which it has no end of its own: less than its footer.
const FOOTER_BYTES: usize = 20;

/// A run's files, at least three.
fn recorded(folder: &Path) -> Vec<PathBuf> {
    let (name, text) = SCENES[0];
    let world = World::run(folder, name, text, TICKS as usize);
    let files = world.record(place(folder, 6 << 20), None);
    assert!(files.len() >= 3, "{files:?}");
    files
}

/// The ticks in a file.
fn ticks_of(path: &Path) -> Vec<u64> {
    let entries = RecordingReader::open(path).unwrap();
    let ticks = entries.filter_map(|entry| match entry {
        Entry::Tick(record) => Some(record.tick),
        _ => None,
    });
    ticks.collect()
}

/// Leaves out the end of a file, as a disk does that refused it.
fn cut(path: &Path, bytes: usize) {
    let all = std::fs::read(path).unwrap();
    std::fs::write(path, &all[..all.len() - bytes]).unwrap();
}

/// Leaves of a later file what it has before its first tick.
fn cut_to_keyframe(path: &Path) {
    let all = std::fs::read(path).unwrap();
    let (mut low, mut high) = (0, all.len());
    while low + 1 < high {
        let middle = usize::midpoint(low, high);
        std::fs::write(path, &all[..middle]).unwrap();
        if RecordingReader::open(path).is_ok_and(|mut of| of.next().is_some()) {
            high = middle;
        } else {
            low = middle;
        }
    }
    std::fs::write(path, &all[..high]).unwrap();
    let entries: Vec<Entry> = RecordingReader::open(path).unwrap().collect();
    assert!(matches!(entries[..], [Entry::Keyframe(_)]), "{entries:?}");
}

/// Reads what is there now, with its ticks after those of before.
fn look(follower: &mut Follower, ticks: &mut Vec<u64>) -> Reach {
    let reach = follower.read(|_, record, _| {
        ticks.push(record.tick);
        Ok(())
    });
    reach.unwrap()
}

#[test]
fn a_recording_with_a_file_that_has_no_end_is_read_on_in_the_next_one() {
    let folder = tempfile::tempdir().unwrap();
    let files = recorded(folder.path());
    let all: Vec<u64> = files.iter().flat_map(|path| ticks_of(path)).collect();
    let bytes = std::fs::metadata(&files[0]).unwrap().len() as usize;
    for cut_bytes in [FOOTER_BYTES, bytes / 4] {
        cut(&files[0], cut_bytes);
        let left: Vec<u64> = files.iter().flat_map(|path| ticks_of(path)).collect();
        let missing = all.len() - left.len();
        assert_eq!(missing > 0, cut_bytes > FOOTER_BYTES);
        let mut follower = Follower::open(&folder.path().join("run.mcap")).unwrap();
        let mut ticks = Vec::new();
        while look(&mut follower, &mut ticks) == Reach::Now {
            std::thread::sleep(LOOK);
        }
        assert_eq!(ticks, left, "{cut_bytes} bytes less");
        assert_eq!(follower.passed_over(), missing as u64);
    }
}

/// The next file comes only when the disk is tried again, and who reads may look late.
#[test]
fn a_file_that_comes_late_is_not_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let files = recorded(folder.path());
    cut(&files[0], FOOTER_BYTES);
    cut_to_keyframe(&files[2]);
    let aside = |k: usize| folder.path().join(format!("aside {k}"));
    for (k, path) in files.iter().enumerate().skip(1) {
        std::fs::rename(path, aside(k)).unwrap();
    }
    let mut follower = Follower::open(&folder.path().join("run.mcap")).unwrap();
    let mut ticks = Vec::new();
    assert_eq!(look(&mut follower, &mut ticks), Reach::Now);
    assert_eq!(ticks, ticks_of(&files[0]));
    // Longer than is waited for a file that nobody writes.
    std::thread::sleep(2 * Duration::from_nanos(RECORDING_RETRY_NS));
    std::fs::rename(aside(1), &files[1]).unwrap();
    let mut later = Vec::new();
    assert_eq!(look(&mut follower, &mut later), Reach::Now);
    assert_eq!(later, ticks_of(&files[1]));
    // One without a tick yet leaves the last one to be shown.
    std::fs::rename(aside(2), &files[2]).unwrap();
    assert_eq!(look(&mut follower, &mut later), Reach::Now);
    let (record, twin) = follower.last().unwrap();
    assert_eq!(Some(&record.tick), later.last());
    assert_eq!(twin.outputs().record.replay_hash, record.core.replay_hash);
    assert_eq!(follower.passed_over(), 0);
}

/// The greatest force of each stretch that was sent, and the ticks of all pictures.
#[derive(Default)]
struct Noted {
    force_n: f64,
    points: Vec<f64>,
    frames: Vec<u64>,
}

impl Screen for Noted {
    fn take(&mut self, record: &TickRecord) {
        self.force_n = self.force_n.max(record.largest_force());
    }

    fn point(&mut self, _: f64) -> Result<(), Failure> {
        self.points.push(std::mem::take(&mut self.force_n));
        Ok(())
    }

    fn frame(&mut self, _: &ScenePlan, record: &TickRecord, twin: &Twin) -> Result<usize, Failure> {
        assert_eq!(twin.outputs().record.replay_hash, record.core.replay_hash);
        self.frames.push(record.tick);
        Ok(0)
    }
}

#[test]
fn the_last_tick_is_sent_though_nothing_is_due_then() {
    const SPIKE_N: f64 = 1000.0;
    let folder = tempfile::tempdir().unwrap();
    let (name, text) = SCENES[0];
    let world = World::run(folder.path(), name, text, 1000);
    let mut pace = Pace::new(Medium::File);
    let is_between = |tick: &u64| {
        let seconds = *tick as f64 / 1000.0;
        [pace.is_point_due(seconds), pace.is_frame_due(seconds)] == [false; 2]
    };
    let last = (0..1000).filter(is_between).last().unwrap();
    let place = place(folder.path(), 1 << 30);
    let first = place.first.clone();
    let (head, files) = (world.head.clone(), world.files.clone());
    let (mut recorder, taps) = Recorder::start(head, files, place).unwrap();
    let Taps {
        mut outputs,
        mut chunks,
    } = taps;
    world.play(|record, made, arrived| {
        if record.tick > last {
            return;
        }
        let mut record = *record;
        if record.tick == last {
            record.wrenches[0].force.z = SPIKE_N;
        }
        for chunk in arrived {
            chunks(chunk);
        }
        outputs.push(record.tick, made);
        recorder.push(&record);
        if record.tick % 10 == 0 {
            std::thread::sleep(Duration::from_millis(12));
        }
    });
    assert_eq!(recorder.finish(None).len(), 1);
    let mut follower = Follower::open(&first).unwrap();
    let (mut noted, stop, mut told_s) = (Noted::default(), AtomicBool::new(false), 0.0);
    let sent = send(&mut follower, Medium::File, &mut noted, &stop, |seconds| {
        told_s = seconds;
    });
    let sent = sent.unwrap();
    assert_eq!((sent.ticks, sent.passed_over), (last + 1, 0));
    assert_eq!(sent.seconds, last as f64 / 1000.0);
    assert_eq!(told_s, sent.seconds);
    assert!(noted.points.last().is_some_and(|&force| force >= SPIKE_N));
    assert_eq!(noted.points.iter().filter(|&&n| n >= SPIKE_N).count(), 1);
    assert_eq!(noted.frames.last(), Some(&last));
    assert_eq!(noted.frames.len() as u64, sent.frames);
    assert!(noted.frames.is_sorted_by(|a, b| a < b));
}
