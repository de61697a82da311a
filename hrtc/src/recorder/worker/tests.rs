//! What the recorder does when it is late.

use super::*;
use crate::recorder::{Replay, replay, rings, write_black_box};
use crate::setup::ControllerSetup;
use crate::tuning::RECORDED_TICKS;
use haptic_device::Capabilities;
use hrtc_core::streaming::subscriber::Identity;
use scene::Overrides;
use scene_files::NotingFiles;
use std::path::Path;

/// Time between two ticks, ns: long, so that the black box takes the end of the recording only.
const PERIOD_NS: u64 = 10_000_000;

/// A scene without a station, and the files that make its controller.
fn head(folder: &Path) -> (RecordingHead, KeptFiles) {
    let path = folder.join("late.toml");
    let text =
        "[[object]]\nmodel = \"none.spm\"\nsize_m = 0.1\n[cache]\nbytes = \"64KiB\"\n[[probe]]\n";
    std::fs::write(&path, text).unwrap();
    let (files, overrides) = (NotingFiles::default(), Overrides::default());
    let _ = scene::load(&path, &overrides, &files).unwrap();
    let files = files.into_kept();
    let identity = Identity {
        client: 1,
        incarnation: 1,
    };
    let device = Capabilities::translational("none", 5.0);
    let setup = ControllerSetup::new(identity, [device].iter(), 1.0);
    let head = RecordingHead::new(&path, &overrides, &setup, &files, 0);
    (head, files)
}

/// Ticks of a run, one of them left out.
fn ticks(head: &RecordingHead, files: &KeptFiles, without: Option<u64>) -> Vec<TickRecord> {
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
    let all = (0..RECORDED_TICKS as u64).map(tick);
    all.filter(|record| Some(record.tick) != without).collect()
}

/// Records ticks that wait already when the recorder begins; its files.
fn recorded(
    folder: &Path,
    head: RecordingHead,
    files: KeptFiles,
    run: &[TickRecord],
) -> Vec<PathBuf> {
    let (mut ring, _taps, ends) = rings();
    for record in run {
        ring.push(*record).unwrap();
    }
    let place = RecordingPlace {
        first: folder.join("run.mcap"),
        keep_bytes: 8 << 20,
        owns_folder: false,
    };
    let worker = Worker::new(ends, head, files, place, Arc::default()).unwrap();
    let ending = OnceLock::new();
    ending
        .set(Ending {
            level: Level::Info,
            sentence: "the run ended".to_owned(),
        })
        .unwrap();
    worker.run(&ending)
}

fn replays(files: &[PathBuf]) -> Vec<Replay> {
    files.iter().map(|path| replay(path).unwrap()).collect()
}

#[test]
fn a_late_recorder_gives_up_keyframes_before_ticks_and_the_black_box_replays() {
    let folder = tempfile::tempdir().unwrap();
    let (head, files) = head(folder.path());
    let run = ticks(&head, &files, None);
    let kept = recorded(folder.path(), head, files, &run);
    let found = replays(&kept);
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
fn a_tick_that_found_no_room_is_marked_and_those_before_it_replay() {
    let folder = tempfile::tempdir().unwrap();
    let (head, files) = head(folder.path());
    let lost = RECORDED_TICKS as u64 / 16;
    let run = ticks(&head, &files, Some(lost));
    let run = &run[..RECORDED_TICKS / 8];
    let kept = recorded(folder.path(), head, files, run);
    let found = replays(&kept);
    assert!(found[0].equal && !found[0].whole, "{found:?}");
    assert_eq!(found[0].ticks, lost);
    let hole = &found[0].holes[0];
    assert_eq!((hole.first, hole.last), (lost, lost));
}
