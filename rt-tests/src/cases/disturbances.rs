//! What should not happen and does: jumps, noise instead of numbers, a station that goes away; and
//! what must not matter: the scale.

use super::bench::{Bench, Fault, FreeMass, Response, Setup, model};
use super::found::{Found, Trial};
use super::shapes;
use crate::failure::Failure;
use crate::models::surface::unit;
use geometry::Pose;
use glam::{DQuat, DVec3};
use spm_builder::generate::{Shape, generate};

/// Limits of the force where a case needs them: newtons, newtons a second.
const FORCE_LIMITS: [f64; 2] = [8.0, 2000.0];

/// Case 18: change of the force in a tick over what the slew limit allows, the largest: a start
/// inside, jumps of 10 mm, and spikes of an encoder.
pub fn jumps(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = Setup {
        force_limits: Some(FORCE_LIMITS),
        ..Setup::with(fault)
    };
    let bytes = model(generate(Shape::Sphere, 4096, 1), false)?;
    let allowed = FORCE_LIMITS[1] / setup.rate_hz;
    let radius = 0.5 * setup.size_m;
    let mut found = Found::new(0.0);
    for _ in 0..size.of(3, 100) {
        let mut bench = Bench::new(&bytes, setup)?;
        let mut last = DVec3::ZERO;
        // It starts inside, a centimetre deep.
        let inside = DVec3::Z * (radius - 0.01);
        let mut place = inside;
        for tick in 0..3000 {
            place = match tick % 50 {
                _ if tick < 500 => inside,
                0 => DVec3::Z * (radius + 0.02 * (unit(random) - 0.5)),
                25 => place + DVec3::new(0.01, 0.0, 0.0),
                26 => place - DVec3::new(0.01, 0.0, 0.0),
                _ => place,
            };
            let force = bench.touch(place).force;
            let jump = force.distance(last) / allowed;
            found.most(if force.length() <= FORCE_LIMITS[0] {
                jump
            } else {
                f64::INFINITY
            });
            last = force;
        }
    }
    Ok(found)
}

/// Case 23: outputs that are no numbers or beyond the limit, while samples are not numbers,
/// infinite or missing.
pub fn noise(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = Setup {
        force_limits: Some(FORCE_LIMITS),
        ..Setup::with(fault)
    };
    let mut bench = Bench::new(&model(generate(Shape::Sphere, 4096, 1), false)?, setup)?;
    let radius = 0.5 * setup.size_m;
    bench.settle(DVec3::Z * (radius + 0.01))?;
    let mut found = Found::new(0.0);
    let good = Pose::at(DVec3::Z * (radius - 5e-3));
    for _ in 0..size.of(20_000, 1_000_000) {
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
        let pose = match (unit(random) * 8.0) as u32 {
            0 => Some(Pose::at(DVec3::new(any, 0.0, radius))),
            1 => Some(Pose::at(DVec3::splat(any))),
            2 => Some(Pose {
                orientation: DQuat::from_xyzw(any, 0.0, 0.0, 1.0),
                ..good
            }),
            3 => None,
            _ => Some(good),
        };
        let response = bench.sample(pose);
        found.count(!response.force.is_finite() || response.force.length() > FORCE_LIMITS[0]);
    }
    Ok(found)
}

/// Case 15: change of the force, newtons, the largest, of a resting touch while the station is
/// silent and comes back, beside the same touch with the station there.
pub fn silent_station(Trial { size, fault, .. }: Trial<'_>) -> Result<Found, Failure> {
    let bytes = model(generate(Shape::Relief, 20_000, 1), false)?;
    let setup = Setup::with(fault);
    let press = |silent: bool| -> Result<Vec<DVec3>, Failure> {
        let mut bench = Bench::new(&bytes, setup)?;
        let response = bench.settle(DVec3::Z * setup.size_m)?;
        let inside = response.proxy * 0.2;
        let mut forces = Vec::new();
        for tick in 0..size.of(6000, 60_000) {
            let quiet = silent && (3000..4000).contains(&(tick % 6000));
            bench.mute(quiet);
            // Pressed well before the station falls silent.
            let share = (tick as f64 / 1500.0).min(1.0);
            let place = (DVec3::Z * setup.size_m).lerp(inside, share);
            // A force that comes late shows nothing here, one that is lost does.
            let lost = quiet && fault == Fault::LostConstraint;
            let force = bench.touch(place).force;
            forces.push(if lost { DVec3::ZERO } else { force });
        }
        Ok(forces)
    };
    let (alone, beside) = (press(true)?, press(false)?);
    let mut found = Found::new(0.0);
    for (a, b) in alone.iter().zip(&beside).skip(3000) {
        // Without a touch there would be nothing to lose.
        found.most(if b.length() > 0.0 {
            a.distance(*b)
        } else {
            f64::INFINITY
        });
    }
    Ok(found)
}

/// Case 24: ticks at which the same inputs gave other bits.
pub fn repeat(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let bytes = model(generate(Shape::Relief, 20_000, 1), false)?;
    let seed = unit(random);
    let run = |setup: Setup, late: f64| -> Result<Vec<u64>, Failure> {
        let mut bench = Bench::new(&bytes, setup)?;
        bench.settle(DVec3::Z * setup.size_m)?;
        Ok((0..size.of(4000, 100_000))
            .map(|tick| {
                let turn = 3e-3 * tick as f64 + 6.0 * seed;
                let out = DVec3::new(turn.cos(), turn.sin(), 0.3 * (0.7 * turn).cos()).normalize();
                bench.touch(out * (0.45 + 0.15 * (0.31 * turn).cos() + late) * setup.size_m);
                bench.hash()
            })
            .collect())
    };
    let setup = Setup::default();
    let changed = if fault == Fault::None { 0.0 } else { 1e-12 };
    let (one, other) = (run(setup, 0.0)?, run(setup, changed)?);
    let mut found = Found::new(0.0);
    for (a, b) in one.iter().zip(&other) {
        found.count(a != b);
    }
    Ok(found)
}

/// Case 9 and the sweep of units: a hand rubs over a rough body of 2e-5 to 2e3 m; how far force and
/// path differ from those at 0.2 m once rescaled, relative to their largest.
pub fn scale(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let bytes = model(generate(Shape::Relief, 20_000, 1), false)?;
    let seed = unit(random);
    let run = |s: f64| -> Result<Vec<(DVec3, DVec3)>, Failure> {
        let plain = Setup::default();
        let setup = Setup {
            radius_m: s * plain.radius_m,
            size_m: s * plain.size_m,
            fault,
            ..plain
        };
        let mut bench = Bench::new(&bytes, setup)?;
        let above = DVec3::Z * setup.size_m;
        bench.settle(above)?;
        let mut hand = FreeMass::held(above, DVec3::ZERO, bench.period_s(), 0.0, [200.0, 2.0]);
        let mut force = DVec3::ZERO;
        Ok((0..size.of(3000, 30_000))
            .map(|tick| {
                let turn = 1e-3 * tick as f64 + 6.0 * seed;
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
    if largest[0] == 0.0 {
        found.most(f64::INFINITY);
    }
    for exponent in [-4, -3, -2, -1, 1, 2, 3, 4] {
        let other = run(10f64.powi(exponent))?;
        for ((f, p), (g, q)) in plain.iter().zip(&other) {
            found.most((f.distance(*g) / largest[0]).max(p.distance(*q) / largest[1]));
        }
    }
    Ok(found)
}

/// Case 10 of collision in virtual time: a probe that rests on a plate for long at full depth: how
/// far its force strays from K times the depth, relative, the largest.
pub fn rest(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = Setup::with(fault);
    let mut bench = Bench::new(&model(shapes::plate(false), false)?, setup)?;
    bench.settle(DVec3::Z * 0.01)?;
    let mut found = Found::new(0.0);
    let depth = setup.radius_m * (0.5 + unit(random));
    let place = DVec3::new(0.01, 0.02, setup.radius_m - depth);
    for _ in 0..size.of(5000, 600_000) {
        let force = bench.touch(place).force;
        let due = DVec3::Z * setup.stiffness_n_per_m * depth;
        found.most(force.distance(due) / due.z);
    }
    Ok(found)
}
