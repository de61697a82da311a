//! What the viewer rerun is sent: all of a run, also while it is recorded, and nothing else.

use crate::place;
use crate::world::{SCENES, World};
use hrtc::recorder::{Recorder, Taps};
use rerun::{ChunkStore, ChunkStoreConfig};
use rt_tests::failure::Failure;
use rt_tests::pictures::course::Sent;
use rt_tests::pictures::viewer::show;
use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Ticks of a run.
const TICKS: u64 = 2500;

fn shown(recording: &Path, target: &Path) -> Result<Sent, Failure> {
    let stop = AtomicBool::new(false);
    show(recording, target.to_str().unwrap(), &stop, |_| {})
}

/// Entities of a file for rerun, and in how many rows each has something.
fn rows(file: &Path) -> BTreeMap<String, u64> {
    let config = ChunkStoreConfig::default();
    let stores = ChunkStore::from_rrd_reader(&config, &mut File::open(file).unwrap()).unwrap();
    let mut rows = BTreeMap::new();
    for chunk in stores.values().flat_map(ChunkStore::iter_physical_chunks) {
        *rows.entry(chunk.entity_path().to_string()).or_default() += chunk.num_rows() as u64;
    }
    rows
}

#[test]
fn a_recording_is_sent_whole_with_every_entity() {
    let folder = tempfile::tempdir().unwrap();
    // Rows of what is only there in a touch; not every scene touches when it is seen.
    let mut touching = [0; 3];
    for (name, text) in SCENES {
        let folder = folder.path().join(name);
        std::fs::create_dir(&folder).unwrap();
        let world = World::run(&folder, name, text, TICKS as usize);
        // Few bytes, so that there are later files.
        let files = world.record(place(&folder, 6 << 20), None);
        assert!(files.len() > 1, "{files:?}");
        let target = folder.join("run.rrd");
        let sent = shown(&files[0], &target).unwrap();
        assert!(sent.ticks <= TICKS && sent.frames > 20, "{name}: {sent:?}");
        let rows = rows(&target);
        let at_least = |entity: &str, least: u64| {
            let found = rows.get(entity).copied().unwrap_or(0);
            assert!(found >= least, "{name}: {found} rows of {entity}; {rows:?}");
        };
        for entity in ["object_0/mesh", "object_0/predicted", "object_0/subscribed"] {
            at_least(&format!("/world/{entity}"), 2);
        }
        let frames = sent.frames;
        for root in ["/world/probe_0", "/touch/axes"] {
            at_least(&format!("{root}/device"), frames / 2);
            for (part, sum) in ["proxy", "force", "normal"].iter().zip(&mut touching) {
                *sum += rows.get(&format!("{root}/{part}")).copied().unwrap_or(0);
            }
        }
        at_least("/touch/axes/surface", frames);
        for plot in ["force", "resolution", "work", "period", "energy", "cache"] {
            at_least(&format!("/plots/{plot}/0"), 2 * frames);
        }
        at_least("/plots/error/0", 1);
    }
    assert!(touching.iter().all(|&rows| rows > 0), "{touching:?}");
}

#[test]
fn a_run_is_sent_while_it_is_recorded_without_files_of_an_earlier_one() {
    let folder = tempfile::tempdir().unwrap();
    let mut world = World::run(folder.path(), "ball", SCENES[0].1, TICKS as usize);
    world.head.setup.incarnation += 1;
    let earlier = world.record(place(folder.path(), 6 << 20), None);
    assert!(earlier.len() > 1, "{earlier:?}");
    world.head.setup.incarnation -= 1;
    let place = place(folder.path(), 1 << 30);
    let first = place.first.clone();
    let target = folder.path().join("run.rrd");
    std::thread::scope(|scope| {
        let mut viewer = None;
        world.record_at(10, place, None, |_, _| {
            viewer.get_or_insert_with(|| scope.spawn(|| shown(&first, &target)));
        });
        let sent = viewer.unwrap().join().unwrap().unwrap();
        let counts = [sent.ticks, sent.passed_over, sent.left_out];
        assert_eq!(counts, [TICKS, 0, 0]);
    });
    assert!(rows(&target).len() > 20);
}

#[test]
fn a_front_with_another_hash_than_the_controllers_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let world = World::run(folder.path(), "ball", SCENES[0].1, TICKS as usize);
    let place = place(folder.path(), 1 << 30);
    let first = place.first.clone();
    let (head, files) = (world.head.clone(), world.files.clone());
    let (mut recorder, taps) = Recorder::start(head, files, place).unwrap();
    let Taps {
        mut outputs,
        mut chunks,
    } = taps;
    const WRONG: u64 = 1234;
    world.play(|record, made, arrived| {
        let mut record = *record;
        arrived.iter().for_each(|chunk| chunks(chunk));
        outputs.push(record.tick, made);
        record.core.replay_hash ^= u64::from(record.tick == WRONG);
        recorder.push(&record);
        if record.tick % 10 == 0 {
            std::thread::sleep(std::time::Duration::from_millis(12));
        }
    });
    let kept = recorder.finish(None);
    assert_eq!(kept.len(), 1);
    let target = folder.path().join("run.rrd");
    let refused = shown(&first, &target).unwrap_err();
    assert_eq!(refused.status(), 1);
    let sentence = refused.to_string();
    assert!(
        sentence.starts_with(&format!("tick {WRONG} ")),
        "{sentence}"
    );
}

#[test]
fn what_is_no_recording_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let nowhere = folder.path().join("nowhere.mcap");
    let refused = shown(&nowhere, &folder.path().join("run.rrd")).unwrap_err();
    assert_eq!(refused.status(), 2);
}
