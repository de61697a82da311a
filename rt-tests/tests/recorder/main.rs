//! The flight recorder: what is recorded replays, from whatever is left of it.

mod follower;
mod pictures;
mod slow_disk;
#[cfg(feature = "view")]
mod viewer;
mod world;

use hrtc::recorder::{
    Entry, RecordingPlace, RecordingReader, Replay, Twin, replay, write_black_box,
};
use rand::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use world::{SCENES, World};

/// Bytes of the mark that closes an MCAP file.
const CLOSING_MARK_BYTES: usize = 8;

/// A seed that differs at every run, printed for a repetition with `HRTC_SEED`.
fn random() -> Xoshiro256PlusPlus {
    let given = std::env::var("HRTC_SEED")
        .ok()
        .and_then(|of| of.parse().ok());
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let seed = given.unwrap_or(now.unwrap().as_nanos() as u64);
    eprintln!("HRTC_SEED={seed}");
    Xoshiro256PlusPlus::seed_from_u64(seed)
}

fn place(folder: &Path, keep_bytes: u64) -> RecordingPlace {
    RecordingPlace {
        first: folder.join("run.mcap"),
        keep_bytes,
        owns_folder: false,
    }
}

fn replayed(path: &Path) -> Replay {
    replay(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

#[test]
fn a_controller_from_a_keyframe_goes_on_with_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = random();
    for (name, text) in SCENES {
        let world = World::run(folder.path(), name, text, 1200);
        let at: Vec<u64> = (0..6).map(|_| random.random_range(1..1200)).collect();
        let mut twins = vec![Twin::new(world.controller())];
        let mut index = 0;
        world.play(|record, outputs, arrived| {
            for twin in &mut twins {
                for (k, chunk) in arrived.iter().enumerate() {
                    twin.arrive(index + k as u64, chunk).unwrap();
                }
                twin.tick(record).unwrap();
                let requests = outputs.outbox.requests();
                let difference = twin.difference(record, requests, &outputs.reports);
                assert_eq!(difference, None, "{name}, tick {}, {at:?}", record.tick);
            }
            index += arrived.len() as u64;
            if at.contains(&record.tick) {
                let state = twins[0].to_bytes().unwrap();
                twins.truncate(2);
                twins.push(Twin::from_bytes(&state).unwrap());
            }
        });
        let states = twins.iter().map(|twin| twin.to_bytes().unwrap());
        let states: Vec<_> = states.collect();
        assert!(
            states.iter().all(|state| *state == states[0]),
            "{name}: states"
        );
        eprintln!("{name}: a keyframe has {} bytes", states[0].len());
    }
}

#[test]
fn every_kept_file_replays_by_itself_and_all_of_them_are_bounded() {
    let folder = tempfile::tempdir().unwrap();
    let world = World::run(folder.path(), "ball", SCENES[0].1, 3000);
    let whole = world.record(place(folder.path(), 1 << 30), None);
    let [file] = &whole[..] else {
        panic!("{whole:?}")
    };
    let found = replayed(file);
    assert!(found.equal && found.whole, "{found:?}");
    assert_eq!((found.ticks, found.first_tick), (3000, 0));
    let bytes = std::fs::metadata(file).unwrap().len();
    eprintln!("{} bytes a tick", bytes / 3000);

    let keep = 6 << 20;
    let kept = world.record(place(folder.path(), keep), None);
    assert!(kept.len() >= 2, "{kept:?}");
    let total: u64 = kept
        .iter()
        .map(|path| std::fs::metadata(path).unwrap().len())
        .sum();
    assert!(total <= keep, "{total} bytes in {kept:?}");
    let mut next = None;
    for path in &kept {
        let found = replayed(path);
        assert!(found.equal && found.whole && found.ticks > 0, "{found:?}");
        assert!(
            next.is_none_or(|next| found.first_tick == next),
            "{found:?}"
        );
        next = Some(found.first_tick + found.ticks as i64);
    }
    assert_eq!(next, Some(3000));
}

#[test]
fn a_recording_that_is_cut_at_any_byte_opens_and_replays_to_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let world = World::run(folder.path(), "ball", SCENES[0].1, 150);
    let files = world.record(place(folder.path(), 1 << 30), None);
    let bytes = std::fs::read(&files[0]).unwrap();
    let ticks_of = |path: &Path| {
        let entries = RecordingReader::open(path).unwrap();
        entries.filter(|of| matches!(of, Entry::Tick(_))).count() as u64
    };
    assert_eq!(ticks_of(&files[0]), 150);
    let cut_path = folder.path().join("cut.mcap");
    // Before this there is no head: what a run writes before its first tick.
    let head = first_message(&bytes, &cut_path);
    let mut random = random();
    let mut last = (0, 0);
    // Of the file's closing mark nothing is missed: the footer before it is the end.
    let end = bytes.len() - CLOSING_MARK_BYTES;
    for _ in 0..1000 {
        let cut = random.random_range(head..end);
        std::fs::write(&cut_path, &bytes[..cut]).unwrap();
        let found = replayed(&cut_path);
        assert!(found.equal && !found.whole, "cut at {cut}: {found:?}");
        assert_eq!(found.ticks, ticks_of(&cut_path), "cut at {cut}");
        if cut > last.0 {
            assert!(
                found.ticks >= last.1,
                "cut at {cut} has fewer than at {}",
                last.0
            );
            last = (cut, found.ticks);
        }
    }
    assert!(last.1 > 140, "{last:?}");
}

/// The first byte from which on a cut file opens.
fn first_message(bytes: &[u8], path: &PathBuf) -> usize {
    let opens = |cut: usize| {
        std::fs::write(path, &bytes[..cut]).unwrap();
        RecordingReader::open(path).is_ok()
    };
    let (mut low, mut high) = (0, bytes.len());
    while low + 1 < high {
        let middle = usize::midpoint(low, high);
        if opens(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    assert!(
        high < bytes.len() / 4,
        "the head takes {high} of {} bytes",
        bytes.len()
    );
    high
}

#[test]
fn a_changed_byte_is_found_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let world = World::run(folder.path(), "ball", SCENES[0].1, 400);
    let files = world.record(place(folder.path(), 1 << 30), None);
    let bytes = std::fs::read(&files[0]).unwrap();
    let changed_path = folder.path().join("changed.mcap");
    // The height of a sample, as it lies in the file.
    let mut samples = Vec::new();
    world.play(|record, _, _| samples.extend(record.samples[0].map(|of| (record.tick, of))));
    let bits = |k: usize| samples[k].1.pose.position.to_array().map(f64::to_bits);
    // Reports of every tenth tick hold it too.
    let is_alone = |&k: &usize| samples[k].0 % 10 != 0;
    let is_new = |k: &usize| (0..*k).all(|before| bits(before) != bits(*k)) && is_alone(k);
    let k = (samples.len() / 2..samples.len()).find(is_new).unwrap();
    let (tick, wanted) = (samples[k].0, bits(k).map(u64::to_le_bytes).concat());
    let of_tick = bytes.windows(24).position(|at| at == wanted).unwrap();
    let mut changed = bytes.clone();
    changed[of_tick + 3] ^= 1;
    std::fs::write(&changed_path, &changed).unwrap();
    let found = replayed(&changed_path);
    assert_eq!(found.first_difference, tick as i64, "{found:?}");
    assert!(found.field.contains("/replay/tick"), "{found:?}");

    // Whatever byte is changed, it is found, or it was of no message for the replay.
    let mut random = random();
    let mut named = 0;
    for _ in 0..40 {
        let at = random.random_range(0..bytes.len());
        let mut changed = bytes.clone();
        changed[at] ^= 1 << random.random_range(0..8);
        std::fs::write(&changed_path, &changed).unwrap();
        let Ok(found) = replay(&changed_path) else {
            continue;
        };
        named += u32::from(!found.equal);
        let complete = found.equal && found.whole && found.ticks == 400;
        let told = !found.equal && !found.field.is_empty() || !found.whole;
        assert!(complete || told, "byte {at}: {found:?}");
    }
    assert!(named > 0);
}

#[test]
fn another_input_gives_another_output_whose_field_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let world = World::run(folder.path(), "ball", SCENES[0].1, 800);
    let mut twin = Twin::new(world.controller());
    let mut index = 0;
    let mut found = None;
    world.play(|record, outputs, arrived| {
        for chunk in arrived {
            twin.arrive(index, chunk).unwrap();
            index += 1;
        }
        let mut other = *record;
        if let (Some(sample), true) = (&mut other.samples[0], record.core.contact) {
            sample.pose.position.z += 1e-6;
        }
        if found.is_none() {
            twin.tick(&other).unwrap();
            let requests = outputs.outbox.requests();
            let difference = twin.difference(record, requests, &outputs.reports);
            found = difference.map(|field| (record.core.contact, field));
        }
    });
    let (is_in_contact, field) = found.unwrap();
    let is_of_touch = field.starts_with("wrenches[0]") || field.starts_with("contacts[0]");
    assert!(is_in_contact && is_of_touch, "{field}");
}

#[test]
fn a_full_disk_costs_the_recording_and_not_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let world = World::run(folder.path(), "ball", SCENES[0].1, 200);
    let full = RecordingPlace {
        first: "/dev/full".into(),
        keep_bytes: 1 << 30,
        owns_folder: false,
    };
    if !full.first.exists() {
        let _ = writeln!(std::io::stderr(), "skipped: there is no /dev/full");
        return;
    }
    let _ = world.record(full.clone(), None);
    assert!(full.first.exists(), "a device is not removed");
}

#[test]
fn the_black_box_is_the_end_of_a_recording_and_replays_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    let world = World::run(folder.path(), "tool", SCENES[1].1, 11_000);
    let kept = world.record(place(folder.path(), 24 << 20), Some("a test"));
    assert!(kept.len() >= 2, "{kept:?}");
    let file = folder.path().join("fault.mcap");
    write_black_box(&kept, "a test", &file).unwrap();
    let found = replayed(&file);
    assert!(found.equal && found.whole, "{found:?}");
    assert_eq!(found.first_tick + found.ticks as i64, 11_000);
    // Ten seconds, and the tick at their beginning.
    assert_eq!(found.ticks, 10_001);
    let bytes = std::fs::read(&file).unwrap();
    let told = b"the run ended by a fault: a test";
    assert!(bytes.windows(told.len()).any(|at| at == told));
}
