//! What is shown of a recording is what the controller had.

use crate::world::{SCENES, World};
use crate::{place, random};
use hrtc::recorder::{Entry, RecordingReader};
use rand::Rng;
use rt_tests::pictures::moment::{Fineness, Moment};
use rt_tests::pictures::playback::Playback;
use rt_tests::pictures::shots::Shots;
use std::ops::ControlFlow;

/// Ticks of a run.
const TICKS: u64 = 2500;

#[test]
fn every_moment_has_the_controllers_front_and_force() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = random();
    for (name, text) in SCENES {
        let world = World::run(folder.path(), name, text, TICKS as usize);
        // Few bytes, so that a moment lies in a later file too.
        let files = world.record(place(folder.path(), 6 << 20), None);
        assert!(files.len() > 1, "{files:?}");
        let playback = Playback::open(&folder.path().join("run.mcap")).unwrap();
        let [first, last] = playback.ticks;
        assert_eq!(last, TICKS - 1);
        let at = [
            playback.shown_tick(),
            random.random_range(first..=last),
            last,
        ];
        for tick in at {
            let mut seen = None;
            let shown = playback.play(tick, |record, twin| {
                if record.tick < tick {
                    return ControlFlow::Continue(());
                }
                seen = Some((*record, Moment::new(&playback.plan, record, twin)));
                ControlFlow::Break(())
            });
            shown.unwrap();
            let (record, moment) = seen.unwrap_or_else(|| panic!("{name}: tick {tick}"));
            // Until the model is here there is no object.
            let objects = moment.objects.iter();
            let faces: Vec<_> = objects.flat_map(|object| &object.faces).collect();
            assert_eq!(
                faces.len() as u32,
                record.core.active_faces,
                "{name}, {tick}"
            );
            let probe = &moment.probes[0];
            assert_eq!(probe.force, record.wrenches[0].force);
            assert_eq!(probe.touch.is_some(), record.contacts[0].is_some());
            if let Some(touch) = &probe.touch {
                assert!(!touch.contacts.is_empty() && probe.proxy.is_some());
                let is_original = |fineness| fineness == Fineness::Original;
                let originals = faces.iter().filter(|face| is_original(face.fineness));
                assert!(!touch.is_full || originals.count() > 0, "{name}, {tick}");
            }
        }
    }
}

#[test]
fn a_picture_and_a_film_are_drawn_and_times_beyond_the_recording_refused() {
    let folder = tempfile::tempdir().unwrap();
    let world = World::run(folder.path(), "tool", SCENES[1].1, 1200);
    let files = world.record(place(folder.path(), 1 << 30), None);
    let playback = Playback::open(&files[0]).unwrap();
    assert!(playback.strongest.is_some() && playback.force_max_n > 0.1);
    assert!(!playback.lacks_start);
    let shots = Shots::new(&playback);
    let tick = playback.shown_tick();
    let still = shots.still(tick).unwrap();
    assert_eq!(
        still,
        shots.still(tick).unwrap(),
        "drawn twice it is the same"
    );
    let mut count = 0;
    let (shown, film) = shots.film(tick, |_| count += 1).unwrap();
    assert_eq!((shown, still.0), (tick, tick));
    assert!(film.len() == count && count > 5, "{count}");
    assert!(film.windows(2).all(|pair| pair[0] != pair[1]), "it moves");
    for seconds in [-1.0, 1.5, f64::NAN] {
        let refused = playback.tick_at(seconds).unwrap_err();
        assert_eq!(refused.status(), 2);
        assert!(
            refused.to_string().contains("0.000 to 1.199 s"),
            "{refused}"
        );
    }
    assert_eq!(playback.tick_at(0.5), Ok(500));
    let nowhere = Playback::open(&folder.path().join("nowhere.mcap"));
    assert_eq!(nowhere.unwrap_err().status(), 2);
}

/// A longer run into the same folder leaves files with higher numbers behind.
#[test]
fn files_of_an_earlier_run_beside_are_not_shown() {
    let folder = tempfile::tempdir().unwrap();
    let (name, text) = SCENES[0];
    let mut earlier = World::run(folder.path(), name, text, TICKS as usize);
    earlier.head.setup.incarnation += 1;
    let files = earlier.record(place(folder.path(), 6 << 20), None);
    assert!(files.len() > 1, "{files:?}");
    for another_build in ["run-0099.mcap", "run-4000000000.mcap"] {
        let path = folder.path().join(another_build);
        std::fs::write(path, "not a recording of this one").unwrap();
    }
    let world = World::run(folder.path(), name, text, 400);
    assert_eq!(world.record(place(folder.path(), 1 << 30), None).len(), 1);
    let playback = Playback::open(&folder.path().join("run.mcap")).unwrap();
    assert_eq!(playback.ticks, [0, 399]);
}

/// A file that ends early leaves ticks without inputs between it and the next one.
#[test]
fn of_a_tick_that_is_missing_no_other_one_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let (name, text) = SCENES[0];
    let world = World::run(folder.path(), name, text, TICKS as usize);
    let files = world.record(place(folder.path(), 6 << 20), None);
    assert!(files.len() > 1, "{files:?}");
    let bytes = std::fs::read(&files[0]).unwrap();
    std::fs::write(&files[0], &bytes[..bytes.len() * 3 / 4]).unwrap();
    let mut entries = RecordingReader::open(&files[1]).unwrap();
    let next = entries.find_map(|entry| match entry {
        Entry::Tick(record) => Some(record.tick),
        _ => None,
    });
    let next = next.unwrap();
    let playback = Playback::open(&folder.path().join("run.mcap")).unwrap();
    let shots = Shots::new(&playback);
    let refused = shots.still(next - 1).map(|of| of.0).unwrap_err();
    assert!(refused.to_string().contains("are missing"), "{refused}");
    assert_eq!(shots.still(next).map(|of| of.0), Ok(next));
    std::fs::remove_file(&files[0]).unwrap();
    let later = Playback::open(&folder.path().join("run.mcap")).unwrap();
    assert!(later.lacks_start && later.ticks[0] == next);
}
