//! Effects that come and go, and effects that must not be felt at all.

use super::case::{Case, Found, Trial};
use super::setup::{Departure, Setup};
use super::walls::wall;
use crate::failure::Failure;
use crate::models::surface::unit;
use glam::DVec3;
use mutants::Mutant;
use std::f64::consts::TAU;

/// The cases of this file.
pub const CASES: &[Case] = &[
    Case {
        facts: "|dF| a tick <= slew while an effect is toggled in contact",
        runs: "all kinds but a boundary come and go, each alone; fades of the default; 50 rounds",
        departs: &[(
            Departure::Limits,
            "the fade is looked at, not the gate behind it",
        )],
        ..Case::of(
            [
                "effects-toggled",
                "22",
                "change of force in a tick over the slew limit",
            ],
            1.0 + 1e-9,
            Mutant::Switch,
            toggled,
        )
    },
    Case {
        facts: "|dF| a tick <= slew while an effect is toggled in contact",
        runs: "the same of a boundary",
        departs: &[(
            Departure::Limits,
            "the fade is looked at, not the gate behind it",
        )],
        ..Case::of(
            [
                "boundary-toggled",
                "22",
                "change of force in a tick over the slew limit",
            ],
            1.0 + 1e-9,
            Mutant::Switch,
            boundary_toggled,
        )
    },
    Case {
        facts: "an unused effect: 0 calls, the force equal bit by bit; friction of 0 too",
        runs: "all ten kinds listed and off; 50 000 places",
        ..Case::of(
            [
                "effects-unlisted",
                "22",
                "ticks at which an effect that is off changes a bit",
            ],
            0.0,
            Mutant::Unlisted,
            unlisted,
        )
    },
];

/// What is toggled: each effect alone, from 0.5 to 0.8 s, by the default fade.
const TOGGLED: [&str; 10] = [
    "{ friction = { static = 1.0 }, from_s = 0.5, until_s = 0.8 }",
    "{ texture = { amplitude_m = 3e-4, noise = { wavelength_m = 2e-3 } }, from_s = 0.5, until_s = 0.8 }",
    "{ texture = { amplitude_m = 1e-4, grating = { wavelength_m = 2e-3 } }, from_s = 0.5, until_s = 0.8 }",
    "{ shading = { radius_m = 0.005 }, from_s = 0.5, until_s = 0.8 }",
    "{ magnet = { force_n = 1, reach_m = 0.01 }, from_s = 0.5, until_s = 0.8 }",
    "{ vibration = { frequency_hz = 100, amplitude_n = 0.5 }, from_s = 0.5, until_s = 0.8 }",
    "{ viscosity = { damping_ns_per_m = 20 }, from_s = 0.5, until_s = 0.8 }",
    "{ spring = { point_m = [0, 0, 0.003], stiffness_n_per_m = 1000 }, from_s = 0.5, until_s = 0.8 }",
    "{ gravity = { mass_kg = 0.5 }, from_s = 0.5, until_s = 0.8 }",
    "{ inertia = { mass_kg = 0.1, stiffness_n_per_m = 2000, damping_ns_per_m = 2 }, from_s = 0.5, until_s = 0.8 }",
];

/// Case 22: change of the force in a tick over the product's slew limit, the largest, while an
/// effect comes and goes under a pressing probe (of a magnet: one that hovers).
fn toggled(trial: Trial<'_>) -> Result<Found, Failure> {
    each_toggled(trial, &TOGGLED)
}

/// The same of a boundary, which the probe is beyond.
fn boundary_toggled(trial: Trial<'_>) -> Result<Found, Failure> {
    each_toggled(
        trial,
        &["{ boundary = { ball = { radius_m = 0.001 } }, from_s = 0.5, until_s = 0.8 }"],
    )
}

fn each_toggled(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
    toggled: &[&'static str],
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for &effects in toggled {
        let setup = Setup {
            effects,
            ..defaults
        };
        let height = if effects.contains("magnet") {
            setup.radius_m + 5e-3
        } else {
            setup.radius_m - 1e-3
        };
        for _ in 0..size.of(1, 50) {
            let mut bench = wall(setup)?;
            let phase = TAU * unit(random);
            let place = |tick: u64| {
                let turn = 0.01 * setup.ms(tick) + phase;
                let aside = DVec3::new(turn.sin(), (1.3 * turn).cos(), 0.0) * 0.01;
                aside + DVec3::Z * height
            };
            let slew_n = 2000.0 * bench.period_s();
            bench.press(place(0), DVec3::Z);
            let mut last = bench.touch(place(0)).force;
            for tick in 1..setup.ticks(1000) {
                let force = bench.touch(place(tick)).force;
                let step = force.distance(last) / slew_n;
                found.most(step);
                found.log(effects.split(' ').nth(1).unwrap_or(effects), step);
                last = force;
            }
            // Without a call nothing is shown.
            found.must(bench.effect_calls() > 0);
        }
    }
    Ok(found)
}

/// Cases 19 and 22: ticks at which effects that are listed but do not act, and friction of 0,
/// change a bit of the force, or are called.
fn unlisted(trial: Trial<'_>) -> Result<Found, Failure> {
    let later = "{ friction = { static = 0.4 }, from_s = 1e6 }, { shading = { radius_m = 0.01 }, from_s = 1e6 }, \
                 { texture = { amplitude_m = 1e-4, noise = { wavelength_m = 2e-3 } }, from_s = 1e6 }, \
                 { magnet = { force_n = 1, reach_m = 0.01 }, from_s = 1e6 }, { gravity = { mass_kg = 0.1 }, from_s = 1e6 }, \
                 { vibration = { frequency_hz = 100, amplitude_n = 0.5 }, from_s = 1e6 }, \
                 { viscosity = { damping_ns_per_m = 20 }, from_s = 1e6 }, \
                 { spring = { point_m = [0, 0, 0], stiffness_n_per_m = 100 }, from_s = 1e6 }, \
                 { inertia = { mass_kg = 0.1, stiffness_n_per_m = 500, damping_ns_per_m = 1 }, from_s = 1e6 }, \
                 { boundary = { ball = { radius_m = 0.001 } }, from_s = 1e6 }";
    let mut found = Found::new(0.0);
    for effects in [later, "{ friction = { static = 0, dynamic = 0 } }"] {
        let again = Trial {
            random: &mut *trial.random,
            ..trial
        };
        let (beside, calls) = beside_none(again, effects)?;
        found.value += beside.value + calls as f64;
        found.passes += beside.passes;
    }
    Ok(found)
}

/// Ticks at which effects change a bit of the force of a plate, beside none; and their calls.
fn beside_none(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
    effects: &'static str,
) -> Result<(Found, u64), Failure> {
    let ticks = size.of(2000, 50_000);
    let directions: Vec<f64> = (0..ticks).map(|_| unit(random)).collect();
    let run = |effects| -> Result<(Vec<[u64; 3]>, u64), Failure> {
        let mut bench = wall(Setup {
            effects,
            ..defaults
        })?;
        bench.travel(DVec3::Z * defaults.radius_m);
        let forces = directions.iter().map(|&direction| {
            let depth = 1e-3 * (defaults.jump() * direction - 0.3);
            let aside = 1e-3 * defaults.jump() * direction;
            let place = DVec3::new(aside, 0.0, defaults.radius_m - depth);
            bench.touch(place).force.to_array().map(f64::to_bits)
        });
        let forces = forces.collect();
        Ok((forces, bench.effect_calls()))
    };
    let (plain, _) = run("")?;
    let (listed, calls) = run(effects)?;
    let mut found = Found::new(0.0);
    for (a, b) in plain.iter().zip(&listed) {
        found.right(a == b);
    }
    Ok((found, calls))
}
