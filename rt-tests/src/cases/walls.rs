//! A wall: the energy that it puts out, how its force begins, and what an encoder makes of it.

use super::bench::{Bench, DAMPING_NS_PER_M, FreeMass, MASS_KG, Setup, model};
use super::found::{Found, Trial};
use super::shapes;
use crate::failure::Failure;
use crate::models::surface::unit;
use glam::DVec3;

/// Ticks of a bounce at the most.
const BOUNCE_TICKS: u32 = 4000;

/// What a bounce off a wall did.
pub struct Bounce {
    /// Energy that the wall put out, joules.
    pub energy_j: f64,
    /// The integral of the squared speed over the contact, m²/s.
    pub travel: f64,
}

/// A free mass falls on the wall at a speed, anywhere within a period of touching, and leaves
/// again.
fn bounce(bench: &mut Bench, speed: f64, phase: f64) -> Bounce {
    bounce_of(bench, [MASS_KG, DAMPING_NS_PER_M], speed, phase)
}

/// The same of a device of this mass, kg, and damping, N s/m.
pub fn bounce_of(bench: &mut Bench, device: [f64; 2], speed: f64, phase: f64) -> Bounce {
    let period = bench.period_s();
    let surface = bench.setup().radius_m;
    let start = DVec3::Z * (surface + speed * period * (1.0 + phase));
    let mut mass = FreeMass::of(device, start, DVec3::Z * -speed, period);
    let mut bounce = Bounce {
        energy_j: 0.0,
        travel: 0.0,
    };
    let (mut force, mut last) = (DVec3::ZERO, start);
    for tick in 0..BOUNCE_TICKS {
        let place = mass.advance(force);
        let moved = place - last;
        bounce.energy_j += force.dot(moved);
        // Of the period in which it touches only the part behind the surface is contact; in that in
        // which it leaves the force acts to the end.
        let behind = (surface - place.z) / moved.z.abs();
        let share = if force == DVec3::ZERO {
            behind.clamp(0.0, 1.0)
        } else {
            1.0
        };
        bounce.travel += share * moved.length_squared() / period;
        last = place;
        force = bench.touch(place).force;
        if tick > 4 && force == DVec3::ZERO && bounce.travel > 0.0 {
            break;
        }
    }
    bounce
}

/// A plate that is there as a whole.
///
/// # Errors
/// One sentence when it cannot be served.
pub fn wall(setup: Setup) -> Result<Bench, Failure> {
    let mut bench = Bench::new(&model(shapes::plate(false), true)?, setup)?;
    bench.settle(DVec3::Z * 0.01)?;
    Ok(bench)
}

/// Case 1: energy put out over K T / 2 times the integral of v², the largest; 1 is what a hold
/// without delay costs.
pub fn head_on(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for rate_hz in [500.0, 1000.0, 2000.0, 4000.0] {
        let setup = Setup {
            rate_hz,
            ..Setup::with(fault)
        };
        let mut bench = wall(setup)?;
        for speed in [0.05, 0.1, 0.2, 0.5] {
            for _ in 0..size.of(8, 500) {
                let bounce = bounce(&mut bench, speed, unit(random));
                let held = 0.5 * setup.stiffness_n_per_m * bench.period_s() * bounce.travel;
                found.most(bounce.energy_j / held);
            }
        }
    }
    Ok(found)
}

/// Case 2: energy put out less what the device's damping takes, joules, the largest, at 0.9 of the
/// stiffness that it can take: 2 b / T.
pub fn net_passivity(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(f64::NEG_INFINITY);
    for rate_hz in [500.0, 1000.0, 2000.0, 4000.0] {
        let setup = Setup {
            rate_hz,
            stiffness_n_per_m: 0.9 * 2.0 * DAMPING_NS_PER_M * rate_hz,
            ..Setup::with(fault)
        };
        let mut bench = wall(setup)?;
        for _ in 0..size.of(24, 2000) {
            let speed = 0.05 + 0.45 * unit(random);
            let bounce = bounce(&mut bench, speed, unit(random));
            found.most(bounce.energy_j - DAMPING_NS_PER_M * bounce.travel);
        }
    }
    Ok(found)
}

/// Case 2, any stiffness to 10 kN/m with the energy account: energy put out, joules, the largest.
pub fn passivity(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(f64::NEG_INFINITY);
    for stiffness_n_per_m in [100.0, 1000.0, 3000.0, 10_000.0] {
        let setup = Setup {
            stiffness_n_per_m,
            passivity: true,
            ..Setup::with(fault)
        };
        let mut bench = wall(setup)?;
        for _ in 0..size.of(50, 2000) {
            let speed = 0.05 + 0.45 * unit(random);
            let bounce = bounce(&mut bench, speed, unit(random));
            found.most(bounce.energy_j - DAMPING_NS_PER_M * bounce.travel);
        }
    }
    Ok(found)
}

/// Case 3: energy put out 20 ticks after a miss, joules, the largest, while a hand presses more and
/// less and one period of a hundred is missed, or five in a row.
pub fn missed_ticks(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = Setup {
        force_limits: Some([8.0, 2000.0]),
        passivity: true,
        ..Setup::with(fault)
    };
    let mut found = Found::new(f64::NEG_INFINITY);
    for missed in [1, 5] {
        let mut bench = wall(setup)?;
        let period = bench.period_s();
        let above = DVec3::Z * (2.0 * setup.radius_m);
        let mut hand = FreeMass::held(above, DVec3::ZERO, period, 0.0, [200.0, 2.0]);
        let (mut force, mut last) = (DVec3::ZERO, above);
        let (mut energy, mut since) = (0.0, 0);
        for tick in 0..size.of(5000, 500_000) {
            let turn = 6.0 * period * tick as f64;
            hand.intend(DVec3::Z * (3e-3 * turn.cos() - 4e-3), DVec3::ZERO);
            let miss = tick % 100 == 50 + (unit(random) * 2.0) as u64;
            if miss {
                bench.miss(missed);
                since = 0;
            }
            let mut place = last;
            for _ in 0..=if miss { missed } else { 0 } {
                place = hand.advance(force);
            }
            energy += force.dot(place - last);
            last = place;
            force = bench.touch(place).force;
            since += 1;
            if since == 20 && tick > 500 {
                found.most(energy);
            }
        }
    }
    Ok(found)
}

/// Case 10, the onset: the first force past the surface over K v T, the largest; none at all is
/// infinite.
pub fn onset(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = Setup::with(fault);
    let mut bench = wall(setup)?;
    let mut found = Found::new(0.0);
    for _ in 0..size.of(100, 10_000) {
        let speed = 1e-3 + 9e-3 * unit(random);
        let step = speed * bench.period_s();
        let mut height = setup.radius_m + step * (3.0 + unit(random));
        bench.touch(DVec3::Z * height);
        while height >= setup.radius_m {
            height -= step;
            let force = bench.touch(DVec3::Z * height).force;
            let due = setup.stiffness_n_per_m * (setup.radius_m - height);
            // Whatever is due within rounding is due.
            if due > 1e-6 * setup.stiffness_n_per_m * step {
                let late = force.z < 0.99 * due;
                found.most(if late {
                    f64::INFINITY
                } else {
                    force.length() / (setup.stiffness_n_per_m * step)
                });
            }
        }
        bench.touch(DVec3::Z * 0.01);
    }
    Ok(found)
}

/// Case 10, the creep: force along a plate without friction over K times its size, the largest,
/// while the probe creeps 1e-9 to 1e-6 m a tick.
pub fn creep(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = Setup::with(fault);
    let mut bench = wall(setup)?;
    let mut found = Found::new(0.0);
    let full = setup.stiffness_n_per_m * setup.size_m;
    for exponent in [-9, -8, -7, -6] {
        let step = 10f64.powi(exponent);
        let mut place = DVec3::new(0.05 * unit(random), 0.05 * unit(random), 0.01);
        bench.touch(place);
        place.z = 0.0;
        for tick in 0..size.of(300, 30_000) {
            let turn = 1e-3 * tick as f64;
            place += DVec3::new(turn.cos(), turn.sin(), 0.0) * step;
            let force = bench.touch(place).force;
            found.most(force.truncate().length() / full);
            // It lies a millimetre deep and must feel it.
            if force.z < 0.99 * setup.stiffness_n_per_m * setup.radius_m {
                found.most(f64::INFINITY);
            }
        }
        bench.touch(place + DVec3::Z * 0.01);
    }
    Ok(found)
}

/// Case 21: amplitude of the force over K D, the largest, when a hand rests on a wall through an
/// encoder of step D.
pub fn encoder(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for step in [1e-6, 5e-6, 1e-5, 5e-5] {
        let setup = Setup {
            encoder_m: step,
            ..Setup::with(fault)
        };
        let mut bench = wall(setup)?;
        let period = bench.period_s();
        for _ in 0..size.of(3, 100) {
            let rest = DVec3::Z * (setup.radius_m - 1e-3 * (1.0 + unit(random)));
            let above = DVec3::Z * (2.0 * setup.radius_m);
            let mut hand = FreeMass::held(above, DVec3::ZERO, period, step, [200.0, 2.0]);
            let mut force = DVec3::ZERO;
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for tick in 0..2000 {
                let share = (f64::from(tick) / 500.0).min(1.0);
                hand.intend(above.lerp(rest, share), DVec3::ZERO);
                force = bench.touch(hand.advance(force)).force;
                if tick >= 1500 {
                    (low, high) = (low.min(force.z), high.max(force.z));
                }
            }
            // Without a force there is nothing to be seen.
            let amplitude = if high > 0.0 {
                0.5 * (high - low)
            } else {
                f64::INFINITY
            };
            found.most(amplitude / (setup.stiffness_n_per_m * step));
            bench.touch(above * 2.0);
        }
    }
    Ok(found)
}
