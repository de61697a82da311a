//! Golden hashes: every tick of ten scripted scenes gives the same bits as on the day when the
//! hashes were written.
//!
//! A file `NAME.txt` a scene holds a line a tick: three hexadecimal digits of each of
//! [`outputs::PARTS`], in that order. A part is a hash of its numbers of *all* ticks so far, of
//! which the upper 12 bits are shown: what differs once differs to the end, and the last line has
//! all 64 bits of each. Which numbers, in which order: see [`outputs`]; how a number becomes a word
//! and a word a hash: see [`digest`].
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
use run::{Orders, Scene, TICKS, folder, run};

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
fn check(scene: &Scene, enough: impl Fn(&Tally) -> bool) {
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
    let always = tally.requests > 10 && tally.regions > 2 && tally.reports > 200;
    assert!(
        always && tally.measured > 10 && tally.force_n > 0.5 && enough(&tally),
        "{}: too little happens: {tally:?}",
        scene.name
    );
    if is_written {
        std::fs::write(&path, now).expect("the folder can be written to");
    }
}

fn nothing(_: u64, _: &mut Orders) {}

/// A ball of 1 mm strokes a relief, everything by default. Twice another accuracy is asked for
/// under it; at the end the force ramps down.
#[test]
fn ball() {
    let scene = Scene {
        name: "ball",
        text: r#"
[[object]]
model = "relief.spm"
size_m = 0.15
[[probe]]
"#,
        flipped: &[],
        before: |tick, orders| {
            orders.tolerance_m = match tick {
                1000 | 2000 => Some(1e-3),
                1200 | 2200 => Some(0.0),
                _ => None,
            };
            orders.is_stopping = tick >= 2900;
        },
    };
    check(&scene, |t| {
        t.contact > 2000
            && t.full < t.contact
            && t.splits > 1000
            && t.collapses > 500
            && t.flying > 200
    });
}

/// A capsule along a tour, with a cache that is too small for the object.
#[test]
fn capsule() {
    let scene = Scene {
        name: "capsule",
        text: r#"
[cache]
bytes = "256KiB"
[[object]]
model = "relief.spm"
size_m = 0.12
pose = { position_m = [0.3, -0.2, 0.1], orientation_wxyz = [0.8, 0.4, -0.3, 0.2] }
[[probe]]
shape = { capsule = { radius_m = 0.003, length_m = 0.02, faces = 480 } }
trajectory = { tour = { seed = 3, speed_m_per_s = 0.3 } }
"#,
        flipped: &[],
        before: nothing,
    };
    check(&scene, |t| {
        t.contact > 1000
            && t.torque > 1000
            && t.splits > 1000
            && t.collapses > 1000
            && t.evicted > 1000
    });
}

/// A ring as a mesh of its own is laid on land, pushed over it, tilted and turned.
#[test]
fn mesh_tool() {
    let scene = Scene {
        name: "mesh_tool",
        text: r#"
[cache]
bytes = "512KiB"
[[object]]
model = "terrain.spm"
size_m = 0.2
[[probe]]
shape = { mesh = { file = "torus.spm", size_m = 0.03, faces = 480 } }
trajectory = { csv = "mesh_tool.csv" }
"#,
        flipped: &[],
        before: nothing,
    };
    check(&scene, |t| {
        t.contact > 2000
            && t.torque > 2000
            && t.splits > 1000
            && t.collapses > 1000
            && t.evicted > 0
    });
}

/// Every effect at once.
#[test]
fn effects() {
    let scene = Scene {
        name: "effects",
        text: r#"
effects = [
    { viscosity = { damping_ns_per_m = 0.2 } },
    { spring = { point_m = [0.0, 0.0, 0.05], stiffness_n_per_m = 2.0, force_max_n = 0.2 } },
    { vibration = { frequency_hz = 120.0, amplitude_n = 0.03, direction = [0, 0, 1] } },
    { gravity = { mass_kg = 0.01, direction = [0, 0, -1], centre_m = [0, 0, 0.03] }, from_s = 1.0, until_s = 2.0, fade_s = 0.2 },
    { inertia = { mass_kg = 0.05 } },
    { boundary = { ball = { radius_m = 0.075 }, stiffness_n_per_m = 800.0 } },
]
[cache]
bytes = "512KiB"
[[object]]
model = "relief.spm"
size_m = 0.15
effects = [
    { friction = { static = 0.4, dynamic = 0.3 } },
    { shading = { radius_m = 0.001, max_turn_deg = 45 } },
    { texture = { amplitude_m = 2e-5, noise = { wavelength_m = 0.001, seed = 1 } } },
    { magnet = { force_n = 0.2, reach_m = 0.003 } },
]
[[object]]
model = "sphere.spm"
size_m = 0.05
pose = { position_m = [0.12, 0.0, 0.0] }
effects = [
    { friction = { static = 0.5, dynamic = 0.2 } },
    { texture = { amplitude_m = 3e-5, grating = { wavelength_m = 0.002, direction = [1, 1, 0] } } },
    { vibration = { frequency_hz = 80.0, amplitude_n = 0.05 } },
]
[[probe]]
trajectory = { tour = { seed = 2 } }
[[probe]]
shape = { capsule = { radius_m = 0.003, length_m = 0.02, faces = 240 } }
trajectory = { tour = { object = 1, seed = 5, speed_m_per_s = 0.05 } }
"#,
        flipped: &[],
        before: nothing,
    };
    check(&scene, |t| {
        t.contact > 2000
            && t.all_touch > 1000
            && t.torque > 1000
            && t.splits > 1000
            && t.evicted > 0
    });
}

/// A button, a door and a puck are pushed, a turntable turns under the fourth probe.
#[test]
fn movable() {
    let scene = Scene {
        name: "movable",
        text: r#"
[cache]
bytes = "4MiB"
[[object]]
model = "sphere.spm"
size_m = 0.1
movable = { rail = { axis = [0, 0, 1], mass_kg = 0.2, spring_n_per_m = 150.0, limits_m = [-0.01, 0.0] } }
[[object]]
model = "relief.spm"
size_m = 0.1
pose = { position_m = [0.2, 0, 0] }
movable = { hinge = { axis = [0, 1, 0], anchor_m = [-0.06, 0, 0], mass_kg = 0.3, spring_nm_per_rad = 0.05, limits_deg = [-10, 40] } }
[[object]]
model = "sphere.spm"
size_m = 0.1
pose = { position_m = [0.4, 0, 0] }
movable = { free = { mass_kg = 0.5 } }
[[object]]
model = "torus.spm"
size_m = 0.1
pose = { position_m = [0.6, 0, 0] }
movable = { driven = { angular_rad_per_s = [0, 0, 3], period_s = 2.0 } }
[[probe]]
trajectory = { csv = "movable_button.csv" }
[[probe]]
trajectory = { csv = "movable_door.csv" }
[[probe]]
shape = { cylinder = { radius_m = 0.004, length_m = 0.03, faces = 240 } }
trajectory = { csv = "movable_puck.csv" }
[[probe]]
trajectory = { csv = "movable_turntable.csv" }
"#,
        flipped: &[],
        before: nothing,
    };
    check(&scene, |t| {
        t.contact > 2000
            && t.moving > 2000
            && t.all_touch > 100
            && t.torque > 100
            && t.splits > 1000
    });
}

/// Three probes over sixteen objects, of which seven may be awake.
#[test]
fn many_objects() {
    let scene = Scene {
        name: "many_objects",
        text: r#"
[cache]
bytes = "2MiB"
[[object]]
model = "sphere.spm"
size_m = 0.06
grid = { counts = [4, 3, 1], spacing_m = 0.07 }
[[object]]
name = "ridge"
model = "wedge.spm"
size_m = 0.06
pose = { position_m = [0.0, 0.4, 0.0], orientation_wxyz = [0.9, 0.1, 0.1, 0.4] }
grid = { counts = [4, 1, 1], spacing_m = 0.08 }
[[probe]]
trajectory = { csv = "many_spheres.csv" }
[[probe]]
trajectory = { csv = "many_wedges.csv" }
[[probe]]
trajectory = { tour = { object = "ridge", seed = 4 } }
"#,
        flipped: &[],
        before: nothing,
    };
    check(&scene, |t| {
        t.contact > 2000
            && t.all_touch > 100
            && t.splits > 1000
            && t.collapses > 1000
            && t.awake == 7
    });
}

/// The whole model to a tolerance, which is then asked for coarser and as fine as the cache holds.
#[test]
fn global_refinement() {
    let scene = Scene {
        name: "global_refinement",
        text: r#"
[cache]
bytes = "3MiB"
[accuracy]
tolerance_m = 5e-5
refinement = "global"
[[object]]
model = "relief.spm"
size_m = 0.15
[[probe]]
"#,
        flipped: &[],
        before: |tick, orders| {
            orders.tolerance_m = match tick {
                1400 => Some(5e-4),
                2200 => Some(0.0),
                _ => None,
            }
        },
    };
    check(&scene, |t| {
        t.contact > 2000 && t.full > 1000 && t.splits > 5000 && t.collapses > 2000 && t.flying > 100
    });
}

/// A ball, a larger ball, a capsule and a cylinder at once, on two objects, with a small cache.
#[test]
fn four_probes() {
    let scene = Scene {
        name: "four_probes",
        text: r#"
[cache]
bytes = "640KiB"
[[object]]
model = "relief.spm"
size_m = 0.15
[[object]]
model = "terrain.spm"
size_m = 0.15
pose = { position_m = [0.05, 0.0, -0.08] }
[[probe]]
trajectory = { tour = { seed = 1 } }
[[probe]]
shape = { sphere = { radius_m = 0.003 } }
trajectory = { tour = { seed = 2, speed_m_per_s = 0.2 } }
[[probe]]
shape = { capsule = { radius_m = 0.002, length_m = 0.02, faces = 240 } }
trajectory = { tour = { seed = 3 } }
[[probe]]
shape = { cylinder = { radius_m = 0.003, length_m = 0.02, faces = 240 } }
trajectory = { tour = { object = 1, seed = 4 } }
"#,
        flipped: &[],
        before: nothing,
    };
    check(&scene, |t| {
        t.contact > 2000
            && t.all_touch > 1000
            && t.torque > 2000
            && t.flying > 50
            && t.evicted > 1000
    });
}

/// The link loses, doubles and reorders, is silent for a while, and the device misses samples or
/// gives what is none.
#[test]
fn lossy_link() {
    let scene = Scene {
        name: "lossy_link",
        text: r#"
[cache]
bytes = "512KiB"
[[object]]
model = "relief.spm"
size_m = 0.15
[[probe]]
trajectory = { tour = { seed = 1, speed_m_per_s = 0.15 } }
"#,
        flipped: &[],
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
    };
    check(&scene, |t| {
        t.contact > 2000 && t.epochs > 5 && t.splits > 1000 && t.flying > 50 && t.rejected > 3
    });
}

/// A file is damaged where some of its finest records lie; for a while records are damaged on their
/// way, too.
#[test]
fn damaged_region() {
    let scene = Scene {
        name: "damaged_region",
        text: r#"
[cache]
bytes = "1MiB"
[[object]]
model = "relief.spm"
size_m = 0.15
[[object]]
model = "terrain.spm"
size_m = 0.15
pose = { position_m = [0.3, 0.0, 0.0] }
[[probe]]
trajectory = { csv = "damaged_region.csv" }
[[probe]]
trajectory = { tour = { object = 1, seed = 2 } }
"#,
        // Among the last 153 records, which lie in a block of their own.
        flipped: &[("relief.spm", 320_232)],
        before: |tick, orders| {
            orders.damaged_every = if (600..1400).contains(&tick) { 5 } else { 0 };
        },
    };
    check(&scene, |t| {
        t.contact > 2000 && t.full < t.contact && t.refused > 50 && t.epochs > 0 && t.splits > 1000
    });
}
