//! What the recorder does when it is late.

use super::*;
use crate::recorder::queue::Sender;
use crate::recorder::{
    Entry, RecordingReader, Replay, replay, sources, stands_alone, write_black_box,
};
use crate::setup::ControllerSetup;
use crate::tuning::{KEYFRAME_PART_BYTES, MAX_FRAME_BYTES, RECORDED_TICKS};
use haptic_device::Capabilities;
use hrtc_core::Controller;
use hrtc_core::streaming::subscriber::Identity;
use mcap::records::ChunkIndex;
use scene::Overrides;
use scene_files::NotingFiles;
use std::ffi::OsStr;
use std::fs::File;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::Command;

/// Time between two ticks, ns: long, so that the black box takes the end of the recording only.
const PERIOD_NS: u64 = 10_000_000;

/// A scene without a station, and the files that make its controller.
fn head(folder: &Path) -> (RecordingHead, KeptFiles) {
    head_with(folder, &Overrides::default(), "64KiB")
}

fn head_with(folder: &Path, overrides: &Overrides, cache: &str) -> (RecordingHead, KeptFiles) {
    let path = folder.join("late.toml");
    let text = format!(
        "[[object]]\nmodel = \"none.spm\"\nsize_m = 0.1\n[cache]\nbytes = \"{cache}\"\n[[probe]]\n"
    );
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
    worker_that_keeps(10 << 20, folder, head, files)
}

fn worker_that_keeps(
    keep_bytes: u64,
    folder: &Path,
    head: RecordingHead,
    files: KeptFiles,
) -> (Worker, Sender<TickRecord>) {
    let (queue, _, ends) = sources();
    let place = RecordingPlace {
        first: folder.join("run.mcap"),
        keep_bytes,
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
    let (head, files) = head_with(&folder, &overrides, "64KiB");
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
    assert!(worker.progress.has_lost.load(Ordering::Relaxed));
    let (_, found) = finish(worker);
    assert!(found[0].equal && !found[0].whole, "{found:?}");
    assert_eq!(found[0].ticks, lost);
    let hole = &found[0].holes[0];
    assert_eq!((hole.first, hole.last), (lost, lost));
    assert_eq!(hole.reason, "they were not handed over in time");
}

/// The state of the twin is the same without it.
#[test]
fn a_request_that_found_no_room_is_told_and_keyframes_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let (head, files) = head(folder.path());
    let mut run = ticks(&head, &files, 10);
    run[5].requests += 1;
    let (mut worker, mut queue) = worker(folder.path(), head, files);
    take(&mut worker, &mut queue, &run[..5]);
    assert!(!worker.progress.has_lost.load(Ordering::Relaxed));
    take(&mut worker, &mut queue, &run[5..]);
    assert!(worker.progress.has_lost.load(Ordering::Relaxed));
    assert!(worker.twin.is_some() && !worker.has_told_loss);
}

/// A recording of two files, of which the first has one tick of a hundred; and the state between
/// them.
fn rotated(folder: &Path) -> (Vec<PathBuf>, Vec<u8>) {
    let (head, files) = head_with(folder, &Overrides::default(), "16MiB");
    let run = ticks(&head, &files, 100);
    let (mut worker, mut queue) = worker_that_keeps(64 << 20, folder, head, files);
    // The first file is full.
    worker.written = worker.place.file_bytes();
    take(&mut worker, &mut queue, &run[..1]);
    let state = worker.twin.as_ref().unwrap().to_bytes().unwrap();
    take(&mut worker, &mut queue, &run[1..]);
    let (kept, found) = finish(worker);
    assert!(found.iter().all(|of| of.equal && of.whole), "{found:?}");
    let ticks: Vec<u64> = found.iter().map(|of| of.ticks).collect();
    assert_eq!(ticks, [1, 99]);
    assert!(state.len() > 3 * KEYFRAME_PART_BYTES, "{}", state.len());
    (kept, state)
}

/// The frames of a file.
fn frames(path: &Path) -> Vec<ChunkIndex> {
    let bytes = std::fs::read(path).unwrap();
    let summary = mcap::read::Summary::read(&bytes).unwrap().unwrap();
    summary.chunk_indexes
}

/// In one message the state would be in memory three times, and the encoder would keep one of them.
#[test]
fn a_keyframe_is_written_in_parts_that_give_the_same_state() {
    let folder = tempfile::tempdir().unwrap();
    let (kept, state) = rotated(folder.path());
    let Some(Entry::Keyframe(read)) = RecordingReader::open(&kept[1]).unwrap().next() else {
        panic!("it begins otherwise");
    };
    assert!(read == state);
    let longest = frames(&kept[1]).iter().map(|of| of.chunk_length).max();
    assert!(longest <= Some(MAX_FRAME_BYTES), "{longest:?}");
    let reader = RecordingReader::open(&kept[1]).unwrap();
    let mut others = reader
        .without_keyframes()
        .filter(|of| !matches!(of, Entry::Tick(_)));
    assert!(others.next().is_none());
}

/// A disk that takes nothing for longer than the queue of ticks bridges: its second file begins all
/// the same, and no tick is lost for it.
#[test]
fn a_keyframe_does_not_wait_for_a_slow_disk_while_ticks_do() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("run.mcap");
    let made = Command::new("mkfifo").arg(&pipe).status();
    assert!(made.unwrap().success());
    let (release, released) = std::sync::mpsc::channel::<()>();
    let reader = std::thread::spawn(move || {
        let mut file = File::open(pipe).unwrap();
        let _ = released.recv();
        std::io::copy(&mut file, &mut std::io::sink()).unwrap()
    });
    let (head, files) = head_with(folder.path(), &Overrides::default(), "4MiB");
    let run = ticks(&head, &files, RECORDED_TICKS / 4 + 2);
    let (mut worker, mut queue) = worker_that_keeps(64 << 20, folder.path(), head, files);
    worker.keyframe_timeout = Duration::from_secs(3600);
    assert!(worker.disk.write(vec![0; 2 * KEYFRAME_QUEUE_BYTES], 0));
    // The first file is full.
    worker.written = worker.place.file_bytes();
    take(&mut worker, &mut queue, &run);
    assert!(worker.twin.is_some() && !worker.has_told_loss);
    assert!(!worker.disk.is_idle(), "nobody has read");
    drop(release);
    assert!(reader.join().unwrap() > 0);
    let files = worker.finish(&Ending {
        level: Level::Info,
        sentence: "the run ended".to_owned(),
    });
    let found = replay(&files[1]).unwrap();
    assert!(found.equal && found.whole, "{found:?}");
    assert_eq!(found.ticks, run.len() as u64 - 1);
}

/// As where the disk is full.
#[test]
fn a_file_that_ends_within_its_keyframe_opens_and_the_black_box_does_without() {
    let folder = tempfile::tempdir().unwrap();
    let (kept, _) = rotated(folder.path());
    let ends = frames(&kept[1]).into_iter();
    let first_end = ends.map(|of| of.chunk_start_offset + of.chunk_length).min();
    let bytes = std::fs::read(&kept[1]).unwrap();
    std::fs::write(&kept[1], &bytes[..first_end.unwrap() as usize]).unwrap();
    assert!(!stands_alone(&kept[1]).unwrap());
    let found = replay(&kept[1]).unwrap();
    assert!(found.equal && !found.whole && found.ticks == 0, "{found:?}");
    let black_box = folder.path().join("fault.mcap");
    write_black_box(&kept, "a test", &black_box).unwrap();
    let found = replay(&black_box).unwrap();
    assert!(found.equal && found.ticks == 1, "{found:?}");
}

/// As after a short run behind a long one: a pattern of its files would name both. What is no later
/// file of a run is another's: one that was recorded by such a name, or no recording.
#[test]
fn a_name_that_is_used_again_leaves_no_later_files_of_the_run_before() {
    let folder = tempfile::tempdir().unwrap();
    let (kept, _) = rotated(folder.path());
    let named = |name: &str| folder.path().join(name);
    for later in ["run-0027.mcap", "run-0028.mcap", "run-12345.mcap"] {
        std::fs::copy(&kept[1], named(later)).unwrap();
    }
    let others = [
        "run-27.mcap",
        "run-0027.csv",
        "run2-0027.mcap",
        "run-fault.mcap",
    ];
    for other in others {
        std::fs::copy(&kept[1], named(other)).unwrap();
    }
    std::fs::copy(&kept[0], named("run-0003.mcap")).unwrap();
    std::fs::write(named("run-0005.mcap"), b"something else").unwrap();
    // Another run has this one.
    let held = File::open(named("run-0028.mcap")).unwrap();
    held.lock_shared().unwrap();
    let (head, files) = head(folder.path());
    let (worker, _queue) = worker(folder.path(), head, files);
    let (again, _) = finish(worker);
    assert_eq!(again, [named("run.mcap")]);
    let left = std::fs::read_dir(folder.path()).unwrap();
    let left = left.map(|of| of.unwrap().file_name().into_string().unwrap());
    let left: std::collections::BTreeSet<String> =
        left.filter(|of| of.starts_with("run")).collect();
    let expected = [
        "run.mcap",
        "run-0028.mcap",
        "run-0003.mcap",
        "run-0005.mcap",
    ];
    let expected = expected.iter().chain(&others).map(|of| (*of).to_owned());
    assert_eq!(left, expected.collect());
}

/// What the process has when it locks its memory is resident as a whole, and that of the twin is
/// as much as the cache. Later it is what the run has used, and so is its state in a keyframe.
#[test]
fn a_twin_is_made_at_the_first_tick_and_is_as_large_as_what_the_run_has_used() {
    let folder = tempfile::tempdir().unwrap();
    let (head, files) = head_with(folder.path(), &Overrides::default(), "16MiB");
    let run = ticks(&head, &files, 2);
    let (mut worker, mut queue) = worker(folder.path(), head, files);
    assert!(worker.twin.is_none() && worker.twin_plan.is_some());
    take(&mut worker, &mut queue, &run[..1]);
    assert!(worker.twin.is_some() && worker.twin_plan.is_none());
    let bytes = worker.twin.as_ref().unwrap().state_bytes().unwrap();
    assert!(bytes < 4 << 20, "{bytes}");
    take(&mut worker, &mut queue, &run[1..]);
    let (_, found) = finish(worker);
    assert!(found[0].equal && found[0].ticks == 2, "{found:?}");
}

/// A tour of ten minutes has 120 000 points of 64 bytes.
#[test]
fn a_twin_has_no_room_for_the_points_of_a_tour() {
    let folder = tempfile::tempdir().unwrap();
    let (mut head, files) = head(folder.path());
    head.setup.tour_seconds = 600.0;
    let room = |controller: &Controller| {
        let all = controller.capacities().into_iter();
        let mut points = all.filter(|of| of.name == "points of the tour");
        points.next().unwrap().capacity
    };
    let controller = head.controller(&files).unwrap();
    assert!(room(&controller) > 100_000);
    let twin = Twin::new(controller);
    assert_eq!(room(twin.controller()), 0);
    let read = Twin::from_bytes(&twin.to_bytes().unwrap()).unwrap();
    assert_eq!(room(read.controller()), 0);
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
