//! Effects: friction dissipates and holds, fields gain nothing on a closed path, what the loop
//! cannot render is gone, and what is switched, or not listed, is not felt.

use super::bench::{Bench, DAMPING_NS_PER_M, Fault, FreeMass, Setup, model};
use super::found::{Found, Trial};
use super::shapes;
use super::walls::wall;
use crate::failure::Failure;
use crate::models::surface::unit;
use geometry::Pose;
use glam::DVec3;
use std::f64::consts::TAU;

/// Coefficients of the friction of these cases.
const STATIC: f64 = 0.4;
const FRICTION: &str = "{ friction = { static = 0.4, dynamic = 0.3 } }";

/// What a way cost.
struct Way {
    /// Energy that the rendering put out, joules.
    energy: f64,
    /// All work that was done, to or fro, joules.
    work: f64,
}

/// Goes a way, from 0 to 1, in so many ticks.
fn along(bench: &mut Bench, path: impl Fn(f64) -> DVec3, ticks: u64) -> Way {
    let place = |tick: u64| path(tick as f64 / ticks as f64);
    let mut last = place(0);
    let mut force = bench.touch(last).force;
    let mut direction = Way {
        energy: 0.0,
        work: 0.0,
    };
    for tick in 1..=ticks {
        let now = place(tick);
        let moved = now - last;
        direction.energy += force.dot(moved);
        direction.work += force.dot(moved).abs();
        force = bench.touch(now).force;
        last = now;
    }
    direction
}

/// Case 19: energy that friction puts out on a closed path along a plate over all work that was
/// done, the largest, with the energy account: within its cone it is a spring, whose hold leaks.
pub fn friction_loop(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = Setup {
        passivity: true,
        effects: FRICTION,
        ..Setup::with(fault)
    };
    let mut bench = wall(setup)?;
    let mut found = Found::new(f64::NEG_INFINITY);
    for _ in 0..size.of(40, 4000) {
        let radius = 0.02 * unit(random);
        let depth = 2e-3 * unit(random);
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
    Ok(found)
}

/// Case 19: how far the force of a probe that sticks strays from stiffness times displacement,
/// relative, at the end of ten minutes under a noisy encoder.
pub fn friction_stick(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = Setup {
        effects: FRICTION,
        ..Setup::with(fault)
    };
    let mut bench = wall(setup)?;
    let depth = 2e-3;
    let pressed = DVec3::Z * (setup.radius_m - depth);
    bench.touch(pressed);
    // Well inside the cone.
    let aside = DVec3::new(0.5, 0.3, 0.0) * (STATIC * depth);
    let due = (DVec3::Z * depth - aside) * setup.stiffness_n_per_m;
    let mut found = Found::new(0.0);
    for _ in 0..size.of(60_000, 600_000) {
        let noise = DVec3::new(unit(random), unit(random), unit(random)) - 0.5;
        bench.touch(pressed + aside + noise * 2e-5);
    }
    let force = bench.touch(pressed + aside).force;
    found.most(force.distance(due) / due.length());
    Ok(found)
}

/// Case 19: ticks at which a probe that sticks to a surface feels something else when another one
/// slides there too.
pub fn friction_apart(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let pressed = |setup: &Setup, x: f64| Some(Pose::at(DVec3::new(x, 0.0, setup.radius_m - 1e-3)));
    let ticks = size.of(2000, 100_000);
    let directions: Vec<f64> = (0..ticks).map(|_| 0.02 * unit(random)).collect();
    let run = |beside: bool, fault: Fault| -> Result<Vec<DVec3>, Failure> {
        let setup = Setup {
            effects: FRICTION,
            probes: 2,
            ..Setup::with(fault)
        };
        let mut bench = Bench::new(&model(shapes::plate(false), true)?, setup)?;
        bench.settle(DVec3::Z * 0.01)?;
        let forces = directions.iter().enumerate().map(|(tick, &direction)| {
            let own = 1e-4 * (1e-2 * tick as f64).sin();
            let other = if beside {
                pressed(&setup, 0.01 + direction)
            } else {
                None
            };
            bench.sample_each(&[pressed(&setup, own), other]).force
        });
        Ok(forces.collect())
    };
    let alone = run(false, Fault::None)?;
    let together = run(true, fault)?;
    let mut found = Found::new(0.0);
    for (a, b) in alone.iter().zip(&together) {
        found.count(a != b);
    }
    // Without friction nothing is shown.
    if alone.iter().all(|force| force.x == 0.0) {
        found.most(f64::INFINITY);
    }
    Ok(found)
}

/// Case 20: energy that texture and shading put out on closed paths over an edge, over all work
/// that was done, the largest, with the energy account.
pub fn texture_loop(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(f64::NEG_INFINITY);
    for effects in [
        "{ texture = { amplitude_m = 1e-4, noise = { wavelength_m = 2e-3 } } }",
        "{ texture = { amplitude_m = 1e-4, grating = { wavelength_m = 2e-3, direction = [1, 1, 0] } } }",
        "{ shading = { radius_m = 0.01 } }",
    ] {
        let setup = Setup {
            passivity: true,
            effects,
            ..Setup::with(fault)
        };
        let mut bench = Bench::new(&model(shapes::roof(0.5, false), true)?, setup)?;
        bench.settle(DVec3::Z * 0.05)?;
        for _ in 0..size.of(10, 3334) {
            // Into the surface, along it, out, and back: a closed path that begins without a touch.
            let (a, b) = (0.02 * unit(random), -0.02 * unit(random));
            let depth = 1e-3 * (0.2 + unit(random));
            let corners = [
                DVec3::new(a, 0.003, 0.01),
                DVec3::new(a, 0.001, -depth - 0.25 * a),
                DVec3::new(b, -0.002, -depth + 0.25 * b),
                DVec3::new(b, 0.0, 0.01),
                DVec3::new(a, 0.003, 0.01),
            ];
            let path = |t: f64| {
                let piece = ((4.0 * t) as usize).min(3);
                corners[piece].lerp(corners[piece + 1], 4.0 * t - piece as f64)
            };
            let direction = along(&mut bench, path, 400 + (800.0 * unit(random)) as u64);
            found.most(direction.energy / direction.work);
        }
    }
    Ok(found)
}

/// Case 20: what is felt of a texture that is finer than the loop can render at the speed of the
/// probe, over stiffness times amplitude, the largest: how far the force is from that of the
/// surface without it.
pub fn texture_alias(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let (amplitude, wavelength) = (2e-5, 1e-3);
    let setup = Setup {
        effects: "{ texture = { amplitude_m = 2e-5, grating = { wavelength_m = 1e-3 } } }",
        ..Setup::with(fault)
    };
    let mut bench = wall(setup)?;
    let depth = 1e-3;
    let due = DVec3::Z * setup.stiffness_n_per_m * (depth - amplitude);
    let full = setup.stiffness_n_per_m * amplitude;
    let place = |x: f64| DVec3::new(x, 0.0, setup.radius_m - depth);
    let mut found = Found::new(0.0);
    let mut slow = 0.0f64;
    for _ in 0..size.of(20, 400) {
        let step = wavelength * (0.5 + 2.0 * unit(random));
        let start = -0.02 * unit(random);
        bench.touch(place(start - step));
        for tick in 0..20 {
            let force = bench.touch(place(start + step * f64::from(tick))).force;
            found.most(force.distance(due) / full);
        }
        // ... and at a tenth of that speed it is there.
        for tick in 0..50 {
            let force = bench.touch(place(start + 1e-4 * f64::from(tick))).force;
            slow = slow.max(force.distance(due) / full);
        }
        bench.touch(DVec3::Z * 0.01);
    }
    if slow < 0.9 {
        found.most(f64::INFINITY);
    }
    Ok(found)
}

/// Energy that a magnet puts out on closed paths near its surface over K T / 2 times the integral
/// of v², the largest.
pub fn magnet_loop(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = Setup {
        effects: "{ magnet = { force_n = 1.0, reach_m = 0.01 } }",
        ..Setup::with(fault)
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
        let ticks = 100 + (300.0 * unit(random)) as u64;
        let direction = along(&mut bench, path, ticks);
        // Half the period times stiffness times the squared speed, which is a half of stiffness
        // times the squared step.
        let leak = (1..=ticks).map(|tick| {
            let [a, b] = [tick - 1, tick].map(|tick| path(tick as f64 / ticks as f64).z);
            let share = (0.5 * (a + b) - setup.radius_m) / reach;
            0.5 * (4.0 * force / reach * (1.0 - 2.0 * share)) * (b - a) * (b - a)
        });
        found.most(direction.energy / leak.sum::<f64>());
    }
    Ok(found)
}

/// The springs, drags and masses that are the most a scene may list on this device: how far it
/// still swings at the end over how far at first, the largest.
pub fn fields(
    Trial {
        size,
        random,
        fault,
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
            let setup = Setup {
                effects,
                encoder_m,
                force_limits: Some([8.0, 1e9]),
                ..Setup::with(fault)
            };
            let mut bench = wall(setup)?;
            let period = bench.period_s();
            for _ in 0..size.of(2, 100) {
                let middle = DVec3::Z * 0.1;
                let start =
                    middle + 1e-3 * (DVec3::new(unit(random), unit(random), unit(random)) - 0.5);
                let speed = 0.05 * (unit(random) - 0.5);
                let mut mass = FreeMass::new(start, DVec3::X * speed, period, encoder_m);
                let mut force = DVec3::ZERO;
                let (mut first, mut last) = (0.0f64, 0.0f64);
                let mut before = start;
                for tick in 0..6000 {
                    let place = mass.advance(force);
                    let moved = place.distance(before);
                    before = place;
                    if tick < 200 {
                        first = first.max(moved);
                    } else if tick >= 5500 {
                        last = last.max(moved);
                    }
                    force = bench.touch(place).force;
                }
                // A step of the encoder to and fro is no swing.
                found.most((last - 2.0 * encoder_m).max(0.0) / first);
            }
        }
    }
    Ok(found)
}

/// Energy that the end of the workspace puts out when a device is thrown at it, less what the
/// device damps, joules, the largest, at 1 to 10 kN/m.
pub fn boundary(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(f64::NEG_INFINITY);
    for effects in [
        "{ boundary = { ball = { radius_m = 0.15 }, stiffness_n_per_m = 1000 } }",
        "{ boundary = { ball = { radius_m = 0.15 }, stiffness_n_per_m = 10000 } }",
        "{ boundary = { box = { lower_m = [-1, -1, -1], upper_m = [1, 1, 0.15] }, stiffness_n_per_m = 5000 } }",
    ] {
        let setup = Setup {
            effects,
            passivity: true,
            ..Setup::with(fault)
        };
        let mut bench = wall(setup)?;
        let period = bench.period_s();
        for _ in 0..size.of(20, 2000) {
            let start = DVec3::Z * (0.149 - 1e-3 * unit(random));
            let speed = 0.05 + 0.45 * unit(random);
            let mut mass = FreeMass::new(start, DVec3::Z * speed, period, 0.0);
            let (mut force, mut last) = (DVec3::ZERO, start);
            let (mut energy, mut travel, mut touched) = (0.0, 0.0, false);
            for _ in 0..2000 {
                let place = mass.advance(force);
                let moved = place - last;
                if force != DVec3::ZERO {
                    energy += force.dot(moved);
                    travel += moved.length_squared() / period;
                }
                last = place;
                force = bench.touch(place).force;
                touched |= force != DVec3::ZERO;
                if touched && force == DVec3::ZERO {
                    break;
                }
            }
            found.most(if touched {
                energy - DAMPING_NS_PER_M * travel
            } else {
                f64::INFINITY
            });
            bench.touch(DVec3::ZERO + DVec3::Z * 0.05);
        }
    }
    Ok(found)
}

/// Case 22: change of the force in a tick over the slew limit, the largest, while every effect
/// comes and goes, some at once, under a pressing probe.
pub fn toggled(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    const FORCE_LIMITS: [f64; 2] = [8.0, 100.0];
    let setup = Setup {
        effects: "{ friction = { static = 3.0 }, from_s = 0.6, until_s = 0.9, fade_s = 0.001 }, \
                  { texture = { amplitude_m = 3e-4, noise = { wavelength_m = 2e-3 } }, from_s = 0.5, until_s = 0.8, fade_s = 0.001 }, \
                  { viscosity = { damping_ns_per_m = 20 }, from_s = 0.7, until_s = 1.0, fade_s = 0.001 }, \
                  { gravity = { mass_kg = 0.5 }, from_s = 1.0, until_s = 1.2, fade_s = 0.001 }, \
                  { boundary = { ball = { radius_m = 0.001 } }, from_s = 0.9, until_s = 1.1, fade_s = 0.001 }",
        force_limits: Some(FORCE_LIMITS),
        ..Setup::with(fault)
    };
    let mut found = Found::new(0.0);
    let allowed = FORCE_LIMITS[1] / setup.rate_hz;
    for _ in 0..size.of(2, 50) {
        let mut bench = wall(setup)?;
        let mut last = DVec3::ZERO;
        let phase = TAU * unit(random);
        for tick in 0..1500 {
            let turn = 0.01 * f64::from(tick) + phase;
            let aside = DVec3::new(turn.sin(), (1.3 * turn).cos(), 0.0) * 0.01;
            let force = bench
                .touch(aside + DVec3::Z * (setup.radius_m - 1e-3))
                .force;
            found.most(force.distance(last) / allowed);
            last = force;
        }
        // Without a call nothing is shown.
        if bench.effect_calls() == 0 {
            found.most(f64::INFINITY);
        }
    }
    Ok(found)
}

/// Case 22: ticks at which effects that are listed but do not act change a bit of the force, or are
/// called.
pub fn unlisted(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let ticks = size.of(2000, 50_000);
    let directions: Vec<f64> = (0..ticks).map(|_| unit(random)).collect();
    let run = |effects, fault| -> Result<(Vec<DVec3>, u64), Failure> {
        let setup = Setup {
            effects,
            ..Setup::with(fault)
        };
        let mut bench = wall(setup)?;
        let forces = directions.iter().map(|&direction| {
            let place = DVec3::new(
                0.01 * direction,
                0.0,
                setup.radius_m - 1e-3 * (direction - 0.3),
            );
            bench.touch(place).force
        });
        let forces = forces.collect();
        Ok((forces, bench.effect_calls()))
    };
    let (plain, no_calls) = run("", Fault::None)?;
    let later = "{ friction = { static = 0.4 }, from_s = 1e6 }, { shading = { radius_m = 0.01 }, from_s = 1e6 }, \
                 { magnet = { force_n = 1, reach_m = 0.01 }, from_s = 1e6 }, { gravity = { mass_kg = 0.1 }, from_s = 1e6 }";
    let (listed, calls) = run(later, fault)?;
    let mut found = Found::new((no_calls + calls) as f64);
    for (a, b) in plain.iter().zip(&listed) {
        found.count(a.to_array().map(f64::to_bits) != b.to_array().map(f64::to_bits));
    }
    Ok(found)
}
