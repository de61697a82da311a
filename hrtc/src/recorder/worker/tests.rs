//! What the recorder does when it is late.

use super::*;
use crate::recorder::queue::Sender;
use crate::recorder::{RecordingReader, Replay, replay, sources, write_black_box};
use crate::setup::ControllerSetup;
use crate::tuning::RECORDED_TICKS;
use haptic_device::Capabilities;
use hrtc_core::streaming::subscriber::Identity;
use scene::Overrides;
use scene_files::NotingFiles;
use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

/// Time between two ticks, ns: long, so that the black box takes the end of the recording only.
const PERIOD_NS: u64 = 10_000_000;

/// A scene without a station, and the files that make its controller.
fn head(folder: &Path) -> (RecordingHead, KeptFiles) {
    head_with(folder, &Overrides::default())
}

fn head_with(folder: &Path, overrides: &Overrides) -> (RecordingHead, KeptFiles) {
    let path = folder.join("late.toml");
    let text =
        "[[object]]\nmodel = \"none.spm\"\nsize_m = 0.1\n[cache]\nbytes = \"64KiB\"\n[[probe]]\n";
    std::fs::write(&path, text).unwrap();
    let files = NotingFiles::default();
    let _ = scene::load(&path, overrides, &files).unwrap();
    let files = files.into_kept();
    let identity = Identity {
        client: 1,
        incarnation: 1,
    };
    let device = Capabilities::translational("none", 5.0);
    let setup = ControllerSetup::new(identity, [device].iter(), 1.0);
    let head = RecordingHead::new(&path, overrides, &setup, &files, 0);
    (head, files)
}

/// The first ticks of a run.
fn ticks(head: &RecordingHead, files: &KeptFiles, count: usize) -> Vec<TickRecord> {
    let mut twin = Twin::new(head.controller(files).unwrap());
    let tick = |tick: u64| {
        let mut record = TickRecord {
            tick,
            start_ns: tick * PERIOD_NS,
            ..TickRecord::default()
        };
        twin.tick(&record).unwrap();
        let outputs = twin.outputs();
        record.core = outputs.record;
        record.wrenches[..outputs.wrenches.len()].copy_from_slice(&outputs.wrenches);
        record
    };
    (0..count as u64).map(tick).collect()
}

/// A worker, and the queue of ticks that it takes. It keeps all ticks of these runs (some 700 bytes
/// each), and a full queue fills more than one file.
fn worker(folder: &Path, head: RecordingHead, files: KeptFiles) -> (Worker, Sender<TickRecord>) {
    let (queue, _, ends) = sources();
    let place = RecordingPlace {
        first: folder.join("run.mcap"),
        keep_bytes: 10 << 20,
        owns_folder: false,
    };
    let worker = Worker::new(ends, head, files, place, Arc::default());
    (worker.unwrap(), queue)
}

/// Gives ticks that the worker takes all at once.
fn take(worker: &mut Worker, queue: &mut Sender<TickRecord>, run: &[TickRecord]) {
    for record in run {
        assert!(queue.push(*record));
    }
    worker.take();
}

fn finish(worker: Worker) -> (Vec<PathBuf>, Vec<Replay>) {
    let files = worker.finish(&Ending {
        level: Level::Info,
        sentence: "the run ended".to_owned(),
    });
    let found = files.iter().map(|path| replay(path).unwrap()).collect();
    (files, found)
}

/// Each file of the recording begins with the scene's.
#[test]
fn files_of_a_scene_that_leave_no_room_for_ticks_are_refused_with_what_they_need() {
    let folder = tempfile::tempdir().unwrap();
    let (head, mut files) = head(folder.path());
    let start = |files: &KeptFiles, keep_bytes: u64| {
        let place = RecordingPlace {
            first: folder.path().join("run.mcap"),
            keep_bytes,
            owns_folder: false,
        };
        let (_, _, ends) = sources();
        Worker::new(ends, head.clone(), files.clone(), place, Arc::default()).map(|_| ())
    };
    assert!(start(&files, 16 << 20).is_ok());
    let height_map = folder.path().join("large.png");
    files.contents.insert(height_map, vec![0; 5 << 20]);
    let Err(RecordingError::Room(needed)) = start(&files, 16 << 20) else {
        panic!("it begins");
    };
    assert!(start(&files, (needed - 2) << 20).is_err());
    assert!(start(&files, needed << 20).is_ok());
}

/// A path is bytes; JSON and the names of attachments are not.
#[test]
fn a_scene_in_a_folder_whose_name_is_not_utf_8_is_recorded_and_replays() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join(OsStr::from_bytes(b"\xff"));
    std::fs::create_dir(&folder).unwrap();
    let device = folder.join("own.toml");
    std::fs::write(&device, "device = { simulated = {} }\n").unwrap();
    let overrides = Overrides {
        model: Some(folder.join("other.spm")),
        devices: vec![device],
        ..Overrides::default()
    };
    let (head, files) = head_with(&folder, &overrides);
    let run = ticks(&head, &files, 100);
    let (mut worker, mut queue) = worker(&folder, head.clone(), files.clone());
    take(&mut worker, &mut queue, &run);
    let (kept, found) = finish(worker);
    assert!(found[0].equal && found[0].whole, "{found:?}");
    assert_eq!(found[0].ticks, 100);
    let black_box = folder.join("fault.mcap");
    write_black_box(&kept, "a test", &black_box).unwrap();
    for path in [&kept[0], &black_box] {
        let reader = RecordingReader::open(path).unwrap();
        assert_eq!(reader.files().contents, files.contents);
        let read = reader.head();
        assert_eq!(read.scene, head.scene);
        assert_eq!(read.overrides, overrides);
        assert_eq!(read.absolute, head.absolute);
    }
}

#[test]
fn a_late_recorder_loses_keyframes_before_ticks_and_the_black_box_replays() {
    let folder = tempfile::tempdir().unwrap();
    let (head, files) = head(folder.path());
    let run = ticks(&head, &files, RECORDED_TICKS);
    let (mut worker, mut queue) = worker(folder.path(), head, files);
    take(&mut worker, &mut queue, &run);
    let (kept, found) = finish(worker);
    assert!(found.len() >= 2, "{found:?}");
    assert!(found.iter().all(|of| of.equal && of.whole), "{found:?}");
    assert!(found[0].ticks > 0 && found[1].ticks == 0, "{found:?}");
    let black_box = folder.path().join("fault.mcap");
    write_black_box(&kept, "a test", &black_box).unwrap();
    let found = replay(&black_box).unwrap();
    // Ten seconds, and the tick at their beginning.
    assert!(found.equal && found.ticks == 1001, "{found:?}");
}

#[test]
fn a_recorder_that_was_late_catches_up_from_its_files_and_the_next_one_replays() {
    let folder = tempfile::tempdir().unwrap();
    let (head, files) = head(folder.path());
    let run = ticks(&head, &files, 9 * RECORDED_TICKS / 4);
    let (mut worker, mut queue) = worker(folder.path(), head, files);
    let (late, on_time) = run.split_at(RECORDED_TICKS);
    take(&mut worker, &mut queue, late);
    assert!(worker.twin.is_none() && worker.late.is_some());
    while worker.late.is_some() {
        worker.take();
    }
    assert!(worker.twin.is_some(), "it gave up");
    for run in on_time.chunks(RECORDED_TICKS / 8) {
        take(&mut worker, &mut queue, run);
    }
    let (_, found) = finish(worker);
    assert!(found.iter().all(|of| of.equal && of.whole), "{found:?}");
    assert_eq!(found[1].ticks, 0, "it began late: {found:?}");
    let last = found.last().unwrap();
    assert!(found.len() >= 3 && last.ticks > 0, "{found:?}");
    let end = last.first_tick + last.ticks as i64;
    assert_eq!(end, run.len() as i64);
}

#[test]
fn a_tick_that_found_no_room_is_marked_and_those_before_it_replay() {
    let folder = tempfile::tempdir().unwrap();
    let (head, files) = head(folder.path());
    let mut run = ticks(&head, &files, RECORDED_TICKS / 8);
    let lost = run.remove(RECORDED_TICKS / 16).tick;
    let (mut worker, mut queue) = worker(folder.path(), head, files);
    take(&mut worker, &mut queue, &run);
    assert!(worker.twin.is_none() && worker.late.is_none());
    assert!(worker.has_told_loss && !worker.has_told_late);
    let (_, found) = finish(worker);
    assert!(found[0].equal && !found[0].whole, "{found:?}");
    assert_eq!(found[0].ticks, lost);
    let hole = &found[0].holes[0];
    assert_eq!((hole.first, hole.last), (lost, lost));
}

/// A disk that stays full over the beginning of another file: the hole is that of all of it.
#[test]
fn what_is_lost_is_marked_from_its_first_tick_on_however_often_a_file_begins() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["run.mcap", "run-0001.mcap"] {
        std::os::unix::fs::symlink("/dev/full", folder.path().join(name)).unwrap();
    }
    let (head, files) = head(folder.path());
    let run = ticks(&head, &files, 700);
    let (mut worker, mut queue) = worker(folder.path(), head, files);
    for part in run.chunks(100) {
        take(&mut worker, &mut queue, part);
        // Time passes: a frame ends, the disk has it, and a retry is due.
        worker.flushed_ns = 0;
        worker.flush();
        worker.disk.wait(Duration::from_secs(10));
        worker.retry_ns = 0;
        worker.take();
    }
    assert!(worker.told.is_none(), "the third file has its beginning");
    let (files, found) = finish(worker);
    assert_eq!(files, [folder.path().join("run-0002.mcap")]);
    let first = &found[0];
    assert!(first.equal && !first.whole && first.ticks > 0, "{first:?}");
    let hole = &first.holes[0];
    assert_eq!(hole.first, 0);
    assert_eq!(hole.last as i64 + 1, first.first_tick, "{first:?}");
}

/// After a hole the black box goes on from the keyframe of the file that follows.
#[test]
fn a_black_box_over_a_hole_replays_to_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let (head, files) = head(folder.path());
    let run = ticks(&head, &files, 700);
    let (mut worker, mut queue) = worker(folder.path(), head, files);
    take(&mut worker, &mut queue, &run[..200]);
    worker.flushed_ns = 0;
    worker.flush();
    worker.stop("a test".to_owned());
    take(&mut worker, &mut queue, &run[200..400]);
    worker.disk.wait(Duration::from_secs(10));
    worker.retry_ns = 0;
    worker.resume();
    take(&mut worker, &mut queue, &run[400..]);
    let (kept, found) = finish(worker);
    assert_eq!(found.len(), 2);
    let black_box = folder.path().join("fault.mcap");
    write_black_box(&kept, "a test", &black_box).unwrap();
    let found = replay(&black_box).unwrap();
    assert!(found.equal && !found.whole, "{found:?}");
    assert_eq!((found.ticks, found.holes[0].first), (500, 200), "{found:?}");
}
