//! Golden hashes: every tick of ten scripted scenes gives the same bits as on the day when the
//! hashes were written.
//!
//! `NAME.toml` is a scene, and `least.toml` says how often something must happen in it. `NAME.txt`
//! holds a line a tick: three hexadecimal digits of each of [`outputs::PARTS`], in that order. A
//! part is a hash of its numbers of *all* ticks so far, of which the upper 12 bits are shown: a
//! difference in one tick stays to the end, and the last line has all 64 bits of each. The numbers
//! and their order: see [`outputs`]; how a number becomes a word and a word a hash: see [`digest`].
//!
//! The SPM files beside this one are kept as they are: nothing here builds one, so that the builder
//! may change. They are generated shapes (`ve-station generate`, `ve-station build`): `relief` of
//! 9000 faces and `terrain` of 4000, with 250 of the base; `sphere` of 1500, `wedge` of 700 and
//! `torus` of 600, with 100.
//!
//! Whoever means to change what is felt writes the hashes anew, and says why in the commit:
//! `GOLDEN_WRITE=1 cargo test --release -p rt-tests --test golden`

mod digest;
mod outputs;
mod run;

use digest::Digest;
use outputs::{PARTS, Tally};
use run::{Scene, TICKS, folder, run};

type Digests = [Digest; PARTS.len()];

const REWRITE: &str =
    "if it is meant: GOLDEN_WRITE=1 cargo test --release -p rt-tests --test golden";

/// The file of a run.
fn written(scene: &str, after: &[Digests]) -> String {
    let mut text = format!(
        "# {scene}: a line a tick, three digits each of {}; see main.rs\n",
        PARTS.join(", ")
    );
    for parts in after {
        for part in parts {
            text += &format!("{:03x}", part.short());
        }
        text.push('\n');
    }
    let last = after.last().copied().unwrap_or_default();
    let whole: Vec<String> = PARTS
        .iter()
        .zip(last)
        .map(|(name, part)| format!("{name} {:016x}", part.whole()))
        .collect();
    text + "# " + &whole.join(", ") + "\n"
}

/// What differs between two files of a scene, in one sentence.
fn difference(scene: &str, kept: &str, now: &str) -> Option<String> {
    if kept == now {
        return None;
    }
    let lines = |text: &str| text.lines().map(str::to_owned).collect::<Vec<_>>();
    let (kept, now) = (lines(kept), lines(now));
    let differing = kept.iter().zip(&now).position(|(kept, now)| kept != now);
    let Some(line) = differing.filter(|_| kept.len() == now.len()) else {
        return Some(format!(
            "{scene}: {} lines instead of {}; {REWRITE}",
            kept.len(),
            now.len()
        ));
    };
    let (kept, now) = (&kept[line], &now[line]);
    if line == 0 || line as u64 > TICKS {
        return Some(format!(
            "{scene}: \"{now}\" instead of \"{kept}\"; {REWRITE}"
        ));
    }
    let digits = |text: &str, part: usize| text.get(3 * part..3 * part + 3).map(str::to_owned);
    let parts: Vec<&str> = (0..PARTS.len())
        .filter(|&part| digits(kept, part) != digits(now, part))
        .map(|part| PARTS[part])
        .collect();
    Some(format!(
        "{scene}: from tick {} on other bits in {}; {REWRITE}",
        line - 1,
        parts.join(", ")
    ))
}

/// Runs a scene and compares; what is a hash of nothing is neither written nor accepted.
fn check(scene: &Scene) -> Tally {
    let (after, tally) = run(scene);
    println!("{}: {tally:?}", scene.name);
    let now = written(scene.name, &after);
    let path = folder().join(format!("{}.txt", scene.name));
    let is_written = std::env::var_os("GOLDEN_WRITE").is_some();
    if !is_written {
        let kept = std::fs::read_to_string(&path).unwrap_or_default();
        if let Some(sentence) = difference(scene.name, &kept, &now) {
            panic!("{sentence}");
        }
    }
    let missing = tally.missing(scene.name);
    assert!(
        missing.is_empty(),
        "{}: too little happens: {missing:?}",
        scene.name
    );
    if is_written {
        std::fs::write(&path, now).expect("the folder can be written to");
    }
    tally
}

#[test]
fn ball() {
    check(&Scene {
        before: |tick, orders| {
            orders.tolerance_m = match tick {
                1000 | 2000 => Some(1e-3),
                1200 | 2200 => Some(0.0),
                _ => None,
            };
            orders.is_stopping = tick >= 2900;
        },
        ..Scene::new("ball")
    });
}

#[test]
fn capsule() {
    check(&Scene::new("capsule"));
}

#[test]
fn mesh_tool() {
    check(&Scene::new("mesh_tool"));
}

#[test]
fn effects() {
    check(&Scene::new("effects"));
}

#[test]
fn movable() {
    check(&Scene::new("movable"));
}

#[test]
fn many_objects() {
    let tally = check(&Scene::new("many_objects"));
    assert_eq!(tally.awake, 7, "many_objects: objects awake");
}

#[test]
fn global_refinement() {
    check(&Scene {
        before: |tick, orders| {
            orders.tolerance_m = match tick {
                1400 => Some(5e-4),
                2200 => Some(0.0),
                _ => None,
            }
        },
        ..Scene::new("global_refinement")
    });
}

#[test]
fn four_probes() {
    check(&Scene::new("four_probes"));
}

#[test]
fn lossy_link() {
    check(&Scene {
        before: |tick, orders| {
            orders.faults = if (200..2400).contains(&tick) {
                [0.03, 0.05, 0.1]
            } else {
                [0.0; 3]
            };
            orders.is_silent = (1600..1900).contains(&tick);
            orders.is_blind = tick % 97 == 96;
            orders.is_mad = tick % 501 == 500;
        },
        ..Scene::new("lossy_link")
    });
}

#[test]
fn damaged_region() {
    check(&Scene {
        // Among the last 153 records, which lie in a block of their own.
        flipped: &[("relief.spm", 332_904)],
        before: |tick, orders| {
            orders.damaged_every = if (600..1400).contains(&tick) { 2 } else { 0 };
        },
        ..Scene::new("damaged_region")
    });
}
