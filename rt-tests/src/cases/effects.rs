//! Effects: friction dissipates and holds, fields gain nothing on a closed path, what the loop
//! cannot render is gone, and what is switched, or not listed, is not felt.

use super::bench::{Bench, model};
use super::case::{Case, Found, Trial};
use super::device::{DAMPING_NS_PER_M, FreeMass};
use super::setup::{Departure, Setup};
use super::shapes;
use super::walls::{PUSHED_SHARE, wall};
use crate::failure::Failure;
use crate::models::surface::unit;
use geometry::Pose;
use glam::DVec3;
use hrtc_core::record::max_or_nan;
use mutants::Mutant;
use std::f64::consts::TAU;

/// The cases of this file.
pub const CASES: &[Case] = &[
    Case {
        facts: "closed loop paths; dissipation >= 0 a loop",
        runs: "0-20 mm and within the cone, 1-2 mm deep, one to three lobes, twice around; 4000 loops",
        ..Case::of(
            [
                "friction-loop",
                "19",
                "energy that friction puts out on a loop, of its work",
            ],
            1e-12,
            Mutant::Passivity,
            friction_loop,
        )
    },
    Case {
        facts: "ten minutes' sticking; drift 0",
        runs: "ten minutes under noise of a step of an encoder of 10 um",
        departs: &[(Departure::Account, "friction alone is looked at")],
        ..Case::of(
            [
                "friction-stick",
                "19",
                "stray of the force after ten minutes' sticking, relative",
            ],
            1e-9,
            Mutant::FrictionCreep,
            friction_stick,
        )
    },
    Case {
        facts: "ten minutes' sticking; drift 0",
        runs: "ten minutes under noise of a step of an encoder of 10 um",
        ..Case::of(
            [
                "friction-stick-account",
                "19",
                "stray of the force after ten minutes' sticking, relative",
            ],
            1e-9,
            Mutant::FrictionCreep,
            friction_stick,
        )
    },
    Case {
        facts: "two probes on one surface: states independent",
        runs: "100 000 ticks, one sticks while the other slides",
        ..Case::of(
            [
                "friction-apart",
                "19",
                "ticks at which two probes feel each other's friction",
            ],
            0.0,
            Mutant::FrictionShared,
            friction_apart,
        )
    },
    Case {
        facts: "closed paths, 1e4 loops, bounded by the account",
        runs: "noise, grating, shading over an edge; 10 000 loops",
        ..Case::of(
            [
                "texture-loop",
                "20",
                "energy that texture and shading put out, of their work",
            ],
            1e-12,
            Mutant::Passivity,
            texture_loop,
        )
    },
    Case {
        facts: "v < lambda/(2T); nothing above half the rate",
        runs: "grating and noise of 1 mm at 0.5-2.5 mm a tick; the stray bounds the spectrum",
        ..Case::of(
            [
                "texture-alias",
                "20",
                "force of waves too fine for the loop, of K A",
            ],
            1e-9,
            Mutant::Alias,
            texture_alias,
        )
    },
    Case {
        runs: "closed paths in the nearer half of its reach; 4000 loops",
        ..Case::of(
            [
                "magnet-loop",
                "",
                "energy a magnet puts out over K T/2 times that of v²",
            ],
            1.1,
            Mutant::LateForce,
            magnet_loop,
        )
    },
    Case {
        runs: "the most that a scene may list of springs, drag and mass; 1000 swings",
        ..Case::of(
            [
                "fields",
                "",
                "swing at the end over the first, springs and drags",
            ],
            MAX_SWING,
            Mutant::LateForce,
            fields,
        )
    },
    Case {
        facts: "any K up to 10 kN/m with the account",
        runs: "ball and box of 1 to 10 kN/m at 0.05-0.5 m/s; 6000 bounces",
        ..Case::of(
            [
                "boundary",
                "2",
                "energy put out less what the device damps, J",
            ],
            0.0,
            Mutant::Passivity,
            boundary,
        )
    },
];

/// Swing that may be left of a device on the fields that a scene may list. A mode of mass m that
/// is damped by d fades with d/2m, and there are 5.3 s from the end of the first window to the
/// start of the last. The slowest is the device of 0.1 kg and 1 N s/m against the 0.5 kg on 1050
/// N/m: of the reduced mass 0.083 kg, damped by the device's (0.83² of 1) and the effect's (0.1),
/// less what the hold puts out, K T/2 = 0.53. At 1 kHz it fades by 1.6 a second, which leaves 2e-4;
/// at 250 Hz (0.025 of the effect) by 1.2, which leaves 2e-3. Fifteen times that: the first window
/// may see a part of a swing only, and 1.9e-2 is left at 250 Hz.
const MAX_SWING: f64 = 0.03;
/// Coefficients of the friction of these cases.
const STATIC: f64 = 0.4;
const FRICTION: &str = "{ friction = { static = 0.4, dynamic = 0.3 } }";
/// Where every boundary of these cases is above the origin, metres.
const BOUNDARY_M: f64 = 0.15;

/// What a way cost.
struct Way {
    /// Energy that the rendering put out, joules.
    energy: f64,
    /// All work that was done, to or fro, joules.
    work: f64,
}

/// Goes a way, from 0 to 1, in so many milliseconds, rounded to ticks.
fn along(bench: &mut Bench, path: impl Fn(f64) -> DVec3, ticks: u64) -> Way {
    let ticks = bench.setup().ticks(ticks);
    let place = |tick: u64| path(tick as f64 / ticks as f64);
    bench.travel(place(0));
    let before = bench.work_j();
    let (mut work, mut last) = (0.0, before);
    for tick in 1..=ticks {
        bench.touch(place(tick));
        work += (bench.work_j() - last).abs();
        last = bench.work_j();
    }
    Way {
        energy: last - before,
        work,
    }
}

/// Case 19: energy that friction puts out on a closed path along a plate over all work that was
/// done, the largest, with the energy account: within its cone it is a spring, whose hold leaks.
fn friction_loop(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = Setup {
        effects: FRICTION,
        ..defaults
    };
    let mut bench = wall(setup)?;
    let mut found = Found::new(f64::NEG_INFINITY);
    for k in 0..size.of(40, 4000) {
        let depth = 1e-3 + 1e-3 * unit(random);
        // Every other loop stays within the cone, where friction is a spring.
        let radius = [0.02, 0.2 * depth][k as usize % 2] * unit(random);
        let lobes = 1.0 + (3.0 * unit(random)).floor();
        let path = |t: f64| {
            let turn = TAU * t;
            let around = DVec3::new(turn.cos(), (lobes * turn).sin(), 0.0);
            around * radius + DVec3::Z * (setup.radius_m - depth)
        };
        // Down, twice around, and up again: a closed path that begins and ends without a touch.
        let ticks = 200 + (400.0 * unit(random)) as u64;
        let start = path(0.0);
        let above = |t: f64| start + DVec3::Z * (3e-3 * t);
        let directions = [
            along(&mut bench, |t| above(1.0 - t), 100),
            along(&mut bench, path, ticks),
            along(&mut bench, path, ticks),
            along(&mut bench, above, 100),
        ];
        let [energy, work] = directions.iter().fold([0.0, 0.0], |[e, w], direction| {
            [e + direction.energy, w + direction.work]
        });
        found.most(energy / work);
    }
    found.must(bench.effect_calls() > 0);
    Ok(found)
}

/// Case 19: how far the force of a probe that sticks strays from stiffness times displacement,
/// relative, at the end of ten minutes under a noisy encoder.
fn friction_stick(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = Setup {
        effects: FRICTION,
        encoder_m: 1e-5,
        ..defaults
    };
    let mut bench = wall(setup)?;
    // With a force well within its limit.
    let depth = 2e-3 / setup.stiffer().max(1.0);
    let pressed = DVec3::Z * (setup.radius_m - depth);
    bench.press(pressed, DVec3::Z);
    // Well inside the cone.
    let aside = DVec3::new(0.5, 0.3, 0.0) * (STATIC * depth);
    let due = (DVec3::Z * depth - aside) * setup.stiffness_n_per_m;
    let mut found = Found::new(0.0);
    for _ in 0..size.of(60_000, 600_000) {
        let noise = DVec3::new(unit(random), unit(random), unit(random)) - 0.5;
        bench.touch(pressed + aside + (noise * 2.0).round() * 1e-5);
    }
    let force = bench.touch(pressed + aside).force;
    found.most(force.distance(due) / due.length());
    Ok(found)
}

/// Case 19: ticks at which a probe that sticks to a surface feels something else when another one
/// slides there too.
fn friction_apart(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let pressed = |setup: &Setup, x: f64| Some(Pose::at(DVec3::new(x, 0.0, setup.radius_m - 1e-3)));
    let ticks = size.of(2000, 100_000);
    let most = 4e-4 * defaults.jump();
    let directions: Vec<f64> = (0..ticks).map(|_| most * unit(random)).collect();
    let run = |beside: bool| -> Result<Vec<DVec3>, Failure> {
        let setup = Setup {
            effects: FRICTION,
            probes: 2,
            ..defaults
        };
        let mut bench = Bench::new(&model(shapes::plate(), true)?, setup)?;
        bench.settle(DVec3::Z * 0.01)?;
        let first = pressed(&setup, 0.0);
        bench.press(first.map_or(DVec3::ZERO, |pose| pose.position), DVec3::Z);
        let forces = directions.iter().enumerate().map(|(tick, &direction)| {
            let own = 1e-4 * (1e-2 * defaults.ms(tick as u64)).sin();
            let other = if beside {
                pressed(&setup, 0.01 + direction)
            } else {
                None
            };
            bench.sample_each(&[pressed(&setup, own), other]).force
        });
        Ok(forces.collect())
    };
    let alone = run(false)?;
    let together = run(true)?;
    let mut found = Found::new(0.0);
    for (a, b) in alone.iter().zip(&together) {
        found.right(a == b);
    }
    // Without friction nothing is shown.
    found.must(alone.iter().any(|force| force.x.abs() > 0.0));
    Ok(found)
}

/// Case 20: energy that texture and shading put out on closed paths over an edge, over all work
/// that was done, the largest, with the energy account. Below 1 kHz no farther a tick than there:
/// what the hold of a wall puts out is for the device to damp.
fn texture_loop(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(f64::NEG_INFINITY);
    for effects in [
        "{ texture = { amplitude_m = 1e-4, noise = { wavelength_m = 2e-3 } } }",
        "{ texture = { amplitude_m = 1e-4, grating = { wavelength_m = 2e-3, direction = [1, 1, 0] } } }",
        "{ shading = { radius_m = 0.01 } }",
    ] {
        let setup = Setup {
            effects,
            ..defaults
        };
        let mut bench = Bench::new(&model(shapes::roof(0.5), true)?, setup)?;
        bench.settle(DVec3::Z * 0.05)?;
        for k in 0..size.of(10, 3334) {
            // Into the surface, along it, out, and back: a closed path that begins without a touch.
            // Every other one stays on one side of the edge.
            let side = if k % 2 == 0 { -1.0 } else { 1.0 };
            let (a, b) = (0.02 * unit(random), 0.02 * side * unit(random));
            let depth = 1e-3 * (0.2 + unit(random));
            let corners = [
                DVec3::new(a, 0.003, 0.01),
                DVec3::new(a, 0.001, -depth - 0.25 * a),
                DVec3::new(b, -0.002, -depth - 0.25 * b.abs()),
                DVec3::new(b, 0.0, 0.01),
                DVec3::new(a, 0.003, 0.01),
            ];
            let path = |t: f64| {
                let piece = ((4.0 * t) as usize).min(3);
                corners[piece].lerp(corners[piece + 1], 4.0 * t - piece as f64)
            };
            let ms = (400.0 + (800.0 * unit(random)).floor()) / setup.stiffer().min(1.0);
            let direction = along(&mut bench, path, ms as u64);
            found.most(direction.energy / direction.work);
        }
        found.must(bench.effect_calls() > 0);
    }
    Ok(found)
}

/// Case 20: what is felt of a texture that is finer than the loop can render at the speed of the
/// probe, over stiffness times amplitude, the largest: how far the force is from that of the
/// surface without it.
fn texture_alias(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for effects in [
        "{ texture = { amplitude_m = 2e-5, grating = { wavelength_m = 1e-3 } } }",
        "{ texture = { amplitude_m = 2e-5, noise = { wavelength_m = 1e-3 } } }",
    ] {
        let setup = Setup {
            effects,
            ..defaults.with_motions_of_a_tick()
        };
        let slow = alias(setup, size.of(10, 400), random, &mut found)?;
        // At a tenth of that speed it is there: noise at least in part.
        found.must(slow > 0.3);
    }
    Ok(found)
}

/// Slides too fast for the texture of a plate: the stray of the force from that of the surface in
/// the middle of the texture, over K A. Returns the same at a speed that is slow enough.
fn alias(
    setup: Setup,
    count: u64,
    random: &mut impl rand::Rng,
    found: &mut Found,
) -> Result<f64, Failure> {
    let (amplitude, wavelength, depth) = (2e-5, 1e-3, 1e-3);
    let mut bench = wall(setup)?;
    let due = DVec3::Z * setup.stiffness_n_per_m * (depth - amplitude);
    let full = setup.stiffness_n_per_m * amplitude;
    let place = |x: f64| DVec3::new(x, 0.0, setup.radius_m - depth);
    let mut slow = 0.0f64;
    for _ in 0..count {
        let step = wavelength * (0.5 + 2.0 * unit(random));
        let start = -0.02 * unit(random);
        // Up to speed within what a hand may do.
        bench.press(place(start - 2.5 * step), DVec3::Z);
        bench.touch(place(start - 2.0 * step));
        bench.touch(place(start - step));
        for tick in 0..20 {
            let force = bench.touch(place(start + step * f64::from(tick))).force;
            found.most(force.distance(due) / full);
        }
        bench.travel(place(start + step * 20.0));
        for tick in 0..50 {
            let at = place(start + step * 20.0 + 1e-4 * setup.jump() * f64::from(tick));
            slow = max_or_nan(slow, bench.touch(at).force.distance(due) / full);
        }
        bench.travel(DVec3::Z * 0.01);
    }
    Ok(slow)
}

/// Energy that a magnet puts out on closed paths near its surface over K T / 2 times the integral
/// of v², the largest.
fn magnet_loop(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = Setup {
        effects: "{ magnet = { force_n = 1.0, reach_m = 0.01 } }",
        ..defaults
    };
    let mut bench = wall(setup)?;
    let (force, reach) = (1.0, 0.01);
    let mut found = Found::new(0.0);
    for _ in 0..size.of(40, 4000) {
        // In the nearer half of its reach, where it holds; in the other it gives way.
        let middle = setup.radius_m + 2.5e-3;
        let (across, high) = (0.02 * unit(random), 2.4e-3 * (0.2 + 0.8 * unit(random)));
        let path = |t: f64| {
            let (sine, cosine) = (TAU * t).sin_cos();
            DVec3::new(across * sine, 0.0, middle + high * cosine)
        };
        let time = 100 + (300.0 * unit(random)) as u64;
        let ticks = setup.ticks(time);
        let direction = along(&mut bench, path, time);
        // Half the period times stiffness times the squared speed, which is a half of stiffness
        // times the squared step.
        let leak = (1..=ticks).map(|tick| {
            let [a, b] = [tick - 1, tick].map(|tick| path(tick as f64 / ticks as f64).z);
            let share = (0.5 * (a + b) - setup.radius_m) / reach;
            0.5 * (4.0 * force * setup.stiffer() / reach * (1.0 - 2.0 * share)) * (b - a) * (b - a)
        });
        found.most(direction.energy / leak.sum::<f64>());
        // Down and up again; the mean of the force is at least two thirds of the whole.
        found.must(direction.work >= force * setup.stiffer() * high);
    }
    Ok(found)
}

/// The most springs, drags and masses of a scene: swing at the end over that at first, the largest.
fn fields(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for effects in [
        "{ spring = { point_m = [0, 0, 0.1], stiffness_n_per_m = 1000, force_max_n = 8 } }",
        "{ spring = { point_m = [0, 0, 0.1], stiffness_n_per_m = 6000, damping_ns_per_m = 10, force_max_n = 8 } }",
        "{ viscosity = { damping_ns_per_m = 50 } }",
        "{ inertia = { mass_kg = 0.05, stiffness_n_per_m = 2000, damping_ns_per_m = 2 } }",
        "{ inertia = { mass_kg = 0.5, stiffness_n_per_m = 1050, damping_ns_per_m = 0.1 } }",
    ] {
        for encoder_m in [0.0, 1e-6] {
            // The stiffest would be faster than the slew limit.
            let setup = Setup {
                effects,
                encoder_m,
                ..defaults.with_motions_of_a_tick()
            };
            let a_millisecond = setup.ticks(1);
            let mut bench = wall(setup)?;
            let period = bench.period_s();
            for _ in 0..size.of(2, 100) {
                let middle = DVec3::Z * 0.1;
                let start =
                    middle + 1e-3 * (DVec3::new(unit(random), unit(random), unit(random)) - 0.5);
                let speed = 0.05 * (unit(random) - 0.5);
                bench.travel(start);
                let mut mass = FreeMass::new(start, DVec3::X * speed, period, encoder_m);
                let mut force = DVec3::ZERO;
                let (mut first, mut last, mut before) = (0.0, 0.0, start);
                for tick in 0..setup.ticks(6000) {
                    let place = mass.advance(force);
                    force = bench.touch(place).force;
                    if !tick.is_multiple_of(a_millisecond) {
                        continue;
                    }
                    let moved = place.distance(before);
                    before = place;
                    if tick < setup.ticks(200) {
                        first = max_or_nan(first, moved);
                    } else if tick >= setup.ticks(5500) {
                        last = max_or_nan(last, moved);
                    }
                }
                // Without a force the device's own damping ends the swing, too.
                found.must(last.is_finite() && before.is_finite() && mass.work_j() != 0.0);
                // A step of the encoder to and fro is none.
                let left = f64::max(last - 2.0 * encoder_m, 0.0) / first;
                found.most(left);
                found.log(effects, left);
            }
        }
    }
    Ok(found)
}

/// The largest force of a bounce, and the largest that was due, newtons.
#[derive(Default)]
struct Push {
    peak_n: f64,
    due_n: f64,
}

impl Push {
    fn add(&mut self, force_n: f64, due_n: f64) {
        self.peak_n = max_or_nan(self.peak_n, force_n);
        self.due_n = max_or_nan(self.due_n, due_n);
    }

    /// Whether it had about what was due: what pushes by less puts nothing out.
    fn is_whole(&self) -> bool {
        self.due_n > 0.0 && self.peak_n >= PUSHED_SHARE * self.due_n
    }
}

/// Energy that the end of the workspace puts out when a device is thrown at it, less what the
/// device damps, joules, the largest, at 1 to 10 kN/m.
fn boundary(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(f64::NEG_INFINITY);
    for (effects, stiffness) in [
        (
            "{ boundary = { ball = { radius_m = 0.15 }, stiffness_n_per_m = 1000 } }",
            1e3,
        ),
        (
            "{ boundary = { ball = { radius_m = 0.15 }, stiffness_n_per_m = 10000 } }",
            1e4,
        ),
        (
            "{ boundary = { box = { lower_m = [-1, -1, -1], upper_m = [1, 1, 0.15] }, stiffness_n_per_m = 5000 } }",
            5e3,
        ),
    ] {
        let setup = Setup {
            effects,
            ..defaults
        };
        let mut bench = wall(setup)?;
        let period = bench.period_s();
        let most_n = bench.plan().safety.force_max_n;
        for _ in 0..size.of(20, 2000) {
            let start = DVec3::Z * (BOUNDARY_M - 1e-3 - 1e-3 * unit(random));
            let speed = 0.05 + 0.45 * unit(random);
            bench.travel(start);
            let mut mass = FreeMass::new(start, DVec3::Z * speed, period, 0.0);
            let (mut force, mut last) = (DVec3::ZERO, start);
            let (mut travel, mut touched, mut push) = (0.0, false, Push::default());
            for _ in 0..setup.ticks(2000) {
                let place = mass.advance(force);
                if force != DVec3::ZERO {
                    travel += place.distance_squared(last) / period;
                }
                last = place;
                force = bench.touch(place).force;
                touched |= force != DVec3::ZERO;
                let due_n = stiffness * setup.stiffer() * (place.z - BOUNDARY_M);
                push.add(force.length(), due_n.min(most_n));
                // Beyond the boundary a force that is withheld may come again.
                if touched && force == DVec3::ZERO && place.z <= BOUNDARY_M {
                    break;
                }
            }
            found.must(push.is_whole());
            found.most(mass.work_j() - DAMPING_NS_PER_M * travel);
            bench.travel(DVec3::Z * 0.05);
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests;
