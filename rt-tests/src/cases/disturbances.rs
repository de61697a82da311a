//! What should not happen and does: jumps, spikes, noise instead of numbers; and what must not
//! matter: the scale, and a second run.

use super::bench::{Bench, Response, model};
use super::case::{Case, Found, ProbeOfCase, Trial};
use super::device::FreeMass;
use super::setup::{Departure, Setup};
use super::shapes;
use crate::failure::Failure;
use crate::models::surface::unit;
use geometry::Pose;
use glam::{DQuat, DVec3};
use hrtc_core::horizons::Horizons;
use hrtc_core::record::max_or_nan;
use mutants::Mutant;
use spm_builder::SoupMesh;
use spm_builder::generate::{Shape, generate};

/// The cases of this file.
pub const CASES: &[Case] = &[
    Case {
        facts: "s = 1e-4 to 1e4 of the same scene; equal to 1e-9",
        runs: "2^-14 to 2^14 times, bit by bit: a hand of 200 N/m over a relief of 20 000 faces; 30 s",
        departs: &[
            (
                Departure::Account,
                "what may fade unfelt is a number of newtons",
            ),
            (
                Departure::Geomorph,
                "what is not felt is a number of newtons",
            ),
            (Departure::Limits, "they are newtons"),
            (Departure::Motion, "a hand of 2 km is none"),
        ],
        ..Case::of(
            [
                "scale",
                "9",
                "difference at 6e-5 to 2e4 times the size, relative",
            ],
            0.0,
            Mutant::DeadZone,
            scale,
        )
    },
    Case {
        runs: "0.5 to 1.5 mm deep in a plate; ten minutes",
        departs: &[(Departure::Account, "the proxy alone is looked at")],
        ..Case::of(
            [
                "rest",
                "10",
                "stray of the force from K times the depth, relative",
            ],
            1e-9,
            Mutant::Sign,
            rest,
        )
    },
    Case {
        runs: "0.5 to 1.5 mm deep in a plate; ten minutes",
        ..Case::of(
            [
                "rest-account",
                "10",
                "stray of the force from K times the depth, relative",
            ],
            1e-9,
            Mutant::Sign,
            rest,
        )
    },
    Case {
        facts: "start inside, teleport of 10 mm in a tick; ramp <= slew",
        runs: "10 mm deep in a ball of 0.1 m; every 25 ticks a jump of 10 mm; 100 starts",
        ..Case::of(
            [
                "jumps",
                "18",
                "change of force in a tick over the slew limit",
            ],
            1.0 + 1e-9,
            Mutant::Slew,
            jumps,
        )
    },
    Case {
        facts: "start inside, teleport of 10 mm in a tick; ramp <= slew",
        runs: "the same, a capsule upright",
        probe: ProbeOfCase::Tool,
        ..Case::of(
            ["jumps-tool", "18", "the same under a tool"],
            1.0 + 1e-9,
            Mutant::Slew,
            jumps,
        )
    },
    Case {
        facts: "encoder spike: rejected and counted",
        runs: "spikes of 3 mm to 2 m, of 1 to 5 ticks, in a slow slide; 10 000 spikes",
        ..Case::of(
            [
                "spikes",
                "18",
                "spikes not rejected, or felt, or motions that were",
            ],
            0.0,
            Mutant::Spike,
            spikes,
        )
    },
    Case {
        facts: "NaN/Inf in pose, mesh, effect parameter; finite, damped hold, counted",
        runs: "NaN, infinite, huge, subnormal poses, a million; a mesh and every effect with NaN or infinity",
        ..Case::of(
            [
                "samples-of-noise",
                "23",
                "outputs that are no numbers, too large, uncounted, or not held",
            ],
            0.0,
            Mutant::NotFinite,
            noise,
        )
    },
    Case {
        facts: "replay of a log: bit-equal forces, same tick count",
        runs: "100 000 ticks of a relief with friction, noise and vibration, recorded and replayed",
        ..Case::of(
            ["repeat", "24", "ticks of a recording that gave other bits"],
            0.0,
            Mutant::WallClock,
            repeat,
        )
    },
    Case {
        facts: "replay of a log: bit-equal forces, same tick count",
        runs: "the same, a capsule upright, 2 MiB and a lossy link",
        probe: ProbeOfCase::Tool,
        departs: &[
            (Departure::SmallCache, "its subject"),
            (Departure::LossyLink, "its subject"),
        ],
        ..Case::of(
            [
                "repeat-tool-small-lossy",
                "24",
                "the same of a tool under 2 MiB and a lossy link",
            ],
            0.0,
            Mutant::WallClock,
            repeat,
        )
    },
];

/// Case 18: change of the force in a tick over what the slew limit allows, the largest: a start
/// inside, and jumps of 10 mm; infinite where a start leads to no force at all.
fn jumps(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let bytes = model(generate(Shape::Sphere, 4096, 1), false)?;
    let radius = 0.5 * defaults.size_m;
    let mut found = Found::new(0.0);
    for _ in 0..size.of(3, 100) {
        let mut bench = Bench::new(&bytes, defaults)?;
        bench.expect_rejections();
        let most_n = bench.plan().safety.force_max_n;
        let (mut last, mut strongest_n) = (DVec3::ZERO, 0.0);
        // It starts inside, a centimetre deep.
        let inside = DVec3::Z * (radius - 0.01);
        let mut place = inside;
        for tick in 0..3000 {
            place = match tick % 50 {
                _ if tick < defaults.ticks(500) => inside,
                0 => DVec3::Z * (radius + 0.02 * (unit(random) - 0.5)),
                25 => place + DVec3::new(0.01, 0.0, 0.0),
                26 => place - DVec3::new(0.01, 0.0, 0.0),
                _ => place,
            };
            let force = bench.touch(place).force;
            found.must(force.length() <= most_n);
            found.most(force.distance(last) / bench.slew_n());
            strongest_n = max_or_nan(strongest_n, force.length());
            last = force;
        }
        // Without a force there is nothing to limit.
        found.must(strongest_n > 0.0);
    }
    Ok(found)
}

/// Case 18: spikes of an encoder that were not rejected, ticks of a spike at which the force is
/// another than without one, and good samples that were rejected, while a probe slides slowly.
fn spikes(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut bench = Bench::new(&model(shapes::plate(), true)?, defaults)?;
    bench.settle(DVec3::Z * 0.01)?;
    bench.expect_rejections();
    let mut found = Found::new(0.0);
    let place = |tick: u64| {
        let turn = 1e-3 * defaults.ms(tick);
        DVec3::new(
            0.02 * turn.cos(),
            0.02 * turn.sin(),
            defaults.radius_m - 1e-3,
        )
    };
    bench.press(place(0), DVec3::Z);
    let mut tick = 0;
    for _ in 0..size.of(200, 10_000) {
        for _ in 0..40 {
            tick += 1;
            found.right(!bench.touch(place(tick)).record.rejected_sample);
        }
        // In n ticks of a millisecond a hand may go n (n + 1) mm: farther is no motion.
        let ticks = 1 + (5.0 * unit(random)) as u32;
        let a_tick = 1.5e-3 * defaults.ms(1) * defaults.ms(1);
        let length = a_tick * f64::from(ticks * (ticks + 1)) * 50f64.powf(unit(random));
        let turn = 6.3 * unit(random);
        let away = DVec3::new(turn.cos(), turn.sin(), unit(random) - 0.5) * length;
        for _ in 0..ticks {
            tick += 1;
            let response = bench.touch(place(tick) + away);
            found.right(response.record.rejected_sample);
            // It is held where it was: a normal force of K times the depth.
            let due = defaults.stiffness_n_per_m * 1e-3;
            found.right((response.force.z - due).abs() <= 1e-9 * due);
        }
    }
    Ok(found)
}

/// Case 23: outputs that are no numbers or beyond the limit, while samples are not numbers,
/// infinite or missing; wrong samples that are not counted; good ones that are rejected, and a
/// force that is not held meanwhile; and a mesh and effects with numbers that are none, which must
/// not begin.
fn noise(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    let bytes = model(generate(Shape::Sphere, 4096, 1), false)?;
    let mut bench = Bench::new(&bytes, defaults)?;
    let most_n = bench.plan().safety.force_max_n;
    let radius = 0.5 * defaults.size_m;
    bench.settle(DVec3::Z * (radius + 0.01))?;
    let good = Pose::at(DVec3::Z * (radius - 5e-3));
    bench.travel(good.position);
    bench.expect_rejections();
    let mut held = HeldForce::new(good, defaults.rate_hz);
    for _ in 0..size.of(20_000, 1_000_000) {
        let pose = odd_sample(good, random);
        let response = bench.sample(pose);
        found.right(response.force.length() <= most_n && response.torque.is_finite());
        let is_wrong = pose.is_some_and(|pose| !pose.is_finite());
        found.right(!is_wrong || response.record.rejected_sample);
        found.right(held.is_kept(pose, &response));
    }
    for (key, effects) in NOT_NUMBERS {
        let setup = Setup {
            effects,
            ..defaults
        };
        found.right(is_refused_for(
            key,
            Bench::new(&bytes, setup).err().as_ref(),
        ));
    }
    let nothing = SoupMesh {
        positions: vec![[f64::NAN; 3]; 3],
        triangles: vec![[0, 1, 2]],
    };
    found.right(model(nothing, true).is_err());
    Ok(found)
}

/// A good sample, or none, or one with a number that is none, huge or subnormal.
fn odd_sample(good: Pose, random: &mut impl rand::Rng) -> Option<Pose> {
    let odd = [
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MAX,
        1e300,
        -0.0,
        5e-324,
    ];
    let any = odd[(unit(random) * odd.len() as f64) as usize];
    match (unit(random) * 8.0) as u32 {
        0 => Some(Pose::at(DVec3::new(any, 0.0, good.position.z))),
        1 => Some(Pose::at(DVec3::splat(any))),
        2 => Some(Pose {
            orientation: DQuat::from_xyzw(any, 0.0, 0.0, 1.0),
            ..good
        }),
        3 => None,
        _ => Some(good),
    }
}

/// How far from where a probe rests a sample is one of another place, metres.
const ELSEWHERE_M: f64 = 1e-6;

/// A probe that rests in a contact which pushes along z, while samples go wrong: its good samples
/// are believed, and its force is held as long as the product bears a silence. (At a low rate a
/// hand may go far in a tick, so that a wrong sample may be a motion: after one nothing is asked
/// for as long.)
struct HeldForce {
    good: Pose,
    /// Ticks of a silence that the product bears.
    bears: u64,
    /// Ticks since it was believed to be elsewhere; 0 while it is.
    there: u64,
    /// Ticks since a sample was believed.
    silent: u64,
}

impl HeldForce {
    fn new(good: Pose, rate_hz: f64) -> Self {
        Self {
            good,
            bears: Horizons::new(rate_hz).max_silence,
            there: u64::MAX,
            silent: 0,
        }
    }

    /// Whether a tick did what is asked.
    fn is_kept(&mut self, pose: Option<Pose>, response: &Response) -> bool {
        let is_rejected = response.record.rejected_sample;
        let believed = pose.filter(|_| !is_rejected);
        let apart = |pose: Pose| pose.position.distance(self.good.position);
        let is_near = believed.is_none_or(|pose| apart(pose) <= ELSEWHERE_M);
        let was_there = self.there > self.bears;
        self.there = if is_near && (self.there > 0 || believed.is_some()) {
            self.there.saturating_add(1)
        } else {
            0
        };
        self.silent = if believed.is_some() {
            0
        } else {
            self.silent + 1
        };
        let is_lost = was_there && pose == Some(self.good) && is_rejected;
        let is_due = was_there && is_near && self.silent <= self.bears;
        !is_lost && (!is_due || response.force.z > 0.0)
    }
}

/// Effects with a number that is none, each kind at least once, and the key of that number.
const NOT_NUMBERS: [(&str, &str); 12] = [
    ("static", "{ friction = { static = nan } }"),
    ("dynamic", "{ friction = { static = 0.4, dynamic = inf } }"),
    ("radius_m", "{ shading = { radius_m = nan } }"),
    (
        "amplitude_m",
        "{ texture = { amplitude_m = nan, noise = { wavelength_m = 2e-3 } } }",
    ),
    (
        "direction",
        "{ texture = { amplitude_m = 1e-4, grating = { wavelength_m = 2e-3, direction = [nan, 0, 1] } } }",
    ),
    ("force_n", "{ magnet = { force_n = inf, reach_m = 0.01 } }"),
    (
        "frequency_hz",
        "{ vibration = { frequency_hz = nan, amplitude_n = 0.5 } }",
    ),
    (
        "damping_ns_per_m",
        "{ viscosity = { damping_ns_per_m = -inf } }",
    ),
    (
        "point_m",
        "{ spring = { point_m = [nan, 0, 0], stiffness_n_per_m = 100 } }",
    ),
    ("mass_kg", "{ gravity = { mass_kg = nan } }"),
    (
        "stiffness_n_per_m",
        "{ inertia = { mass_kg = 0.1, stiffness_n_per_m = inf } }",
    ),
    ("radius_m", "{ boundary = { ball = { radius_m = nan } } }"),
];

/// Whether a scene is refused for the number of this key: the sentence begins with it. One on a key
/// that is unknown names others in its middle.
fn is_refused_for(key: &str, refused: Option<&Failure>) -> bool {
    refused.is_some_and(|failure| failure.to_string().contains(&format!(": {key} ")))
}

/// Case 24: ticks of a recording that gave other bits when they were played back through a
/// controller that had seen nothing yet.
fn repeat(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = Setup {
        effects: "{ friction = { static = 0.4 } }, \
                  { texture = { amplitude_m = 1e-4, noise = { wavelength_m = 2e-3 } } }, \
                  { vibration = { frequency_hz = 100, amplitude_n = 0.1 } }",
        ..defaults
    };
    let bytes = model(generate(Shape::Relief, 20_000, 1), false)?;
    let phase = 6.0 * unit(random);
    let mut bench = Bench::new(&bytes, setup)?;
    bench.record();
    let (mut contacts, mut is_finite) = (0, true);
    let ticks = setup.ticks(size.of(4000, 100_000));
    let place = |tick: u64| {
        let turn = 3e-3 * setup.ms(tick) + phase;
        let out = DVec3::new(turn.cos(), turn.sin(), 0.3 * (0.7 * turn).cos()).normalize();
        out * (0.45 + 0.15 * (0.31 * turn).cos()) * setup.size_m
    };
    for tick in 0..ticks {
        let response = bench.touch(place(tick));
        // What renders nothing repeats, too.
        contacts += u64::from(response.record.contact && response.force != DVec3::ZERO);
        is_finite &= response.force.is_finite();
    }
    let recording = bench.take_recording();
    let replayed = bench.replay(&recording);
    let mut found = Found::new(0.0);
    found.must(is_finite && contacts > 0 && recording.len() as u64 == ticks);
    found.must(replayed.len() == recording.len());
    for is_same in replayed {
        found.right(is_same);
    }
    Ok(found)
}

/// Case 9 and the sweep of units: a hand rubs over a rough body 2^-14 to 2^14 times as large; how
/// far force and path differ from those at 0.2 m once rescaled, relative to their largest.
fn scale(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let bytes = model(generate(Shape::Relief, 20_000, 1), false)?;
    let seed = unit(random);
    let run = |s: f64| -> Result<Vec<(DVec3, DVec3)>, Failure> {
        let setup = Setup {
            radius_m: s * defaults.radius_m,
            size_m: s * defaults.size_m,
            ..defaults
        };
        let mut bench = Bench::new(&bytes, setup)?;
        let above = DVec3::Z * setup.size_m;
        // No way there: it would take a time that depends on the size.
        for _ in 0..setup.ticks(2000) {
            bench.touch(above);
        }
        let mut hand = FreeMass::held(above, DVec3::ZERO, bench.period_s(), 0.0, [200.0, 2.0]);
        let mut force = DVec3::ZERO;
        Ok((0..setup.ticks(size.of(3000, 30_000)))
            .map(|tick| {
                let turn = 1e-3 * setup.ms(tick) + 6.0 * seed;
                let out = DVec3::new(0.3 * turn.cos(), 0.3 * turn.sin(), 1.0);
                hand.intend(out * (0.3 * setup.size_m), DVec3::ZERO);
                let place = hand.advance(force);
                let response: Response = bench.touch(place);
                force = response.force;
                (force / s, place / s)
            })
            .collect())
    };
    let plain = run(1.0)?;
    let largest = plain.iter().fold([0.0f64; 2], |[f, p], (force, place)| {
        [f.max(force.length()), p.max(place.length())]
    });
    let mut found = Found::new(0.0);
    // Without a touch nothing is shown.
    found.must(largest[0] > 0.0);
    // By powers of two no rounding differs, so that a closed loop has none to amplify.
    for exponent in [-14, -10, -7, -3, 3, 7, 10, 14] {
        let other = run(2f64.powi(exponent))?;
        for ((f, p), (g, q)) in plain.iter().zip(&other) {
            found.most(f.distance(*g) / largest[0]);
            found.most(p.distance(*q) / largest[1]);
        }
    }
    Ok(found)
}

/// Case 10 of collision in virtual time: a probe that rests on a plate for long at full depth: how
/// far its force strays from K times the depth, relative, the largest.
fn rest(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = defaults;
    let mut bench = Bench::new(&model(shapes::plate(), false)?, setup)?;
    bench.settle(DVec3::Z * 0.01)?;
    let mut found = Found::new(0.0);
    let depth = setup.radius_m * (0.5 + unit(random));
    let place = DVec3::new(0.01, 0.02, setup.radius_m - depth);
    bench.press(place, DVec3::Z);
    for _ in 0..size.of(5000, 600_000) {
        let force = bench.touch(place).force;
        let due = DVec3::Z * setup.stiffness_n_per_m * depth;
        found.most(force.distance(due) / due.z);
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene::Effect;

    #[test]
    fn every_effect_is_given_a_number_that_is_none() {
        for name in Effect::NAMES {
            let begins = format!("{{ {name} = ");
            assert!(
                NOT_NUMBERS.iter().any(|(_, of)| of.starts_with(&begins)),
                "{name} is given none"
            );
        }
    }

    #[test]
    fn a_scene_is_refused_for_the_number_and_for_nothing_else() {
        let refused = |effects| {
            let setup = Setup {
                effects,
                ..Setup::PRODUCT
            };
            setup.plan(None).err()
        };
        for (key, effects) in NOT_NUMBERS {
            let failure = refused(effects);
            assert!(is_refused_for(key, failure.as_ref()), "{key}: {failure:?}");
        }
        for other in [
            "{ friction = { static = 0.4 } }",
            "{ friction = { statics = nan } }",
            "{ friction = { dynamic = nan } }",
        ] {
            let failure = refused(other);
            assert!(!is_refused_for("static", failure.as_ref()), "{failure:?}");
        }
    }
}
