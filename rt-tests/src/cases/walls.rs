//! A wall: the energy that it puts out, how its force begins, and what an encoder makes of it. What
//! missed ticks make of it is in `missed`.

use super::bench::{Bench, model};
use super::case::{Case, Found, ProbeOfCase, Trial};
use super::device::{DAMPING_NS_PER_M, DryMass, FreeMass, MASS_KG};
use super::setup::{Departure, Setup};
use super::shapes;
use crate::failure::Failure;
use crate::models::surface::unit;
use geometry::Pose;
use glam::{DQuat, DVec3};
use hrtc_core::record::max_or_nan;
use mutants::Mutant;

/// The cases of this file.
pub const CASES: &[Case] = &[
    Case {
        facts: "0.05-0.5 m/s, K = 1 kN/m, b = 1 N s/m, 0.1 kg, 1 kHz",
        runs: "0.05, 0.1, 0.2, 0.5 m/s; 0.5, 1, 2, 4 kHz; 16 000 bounces",
        departs: &[(Departure::Account, "it would make up for a hidden tick")],
        ..Case::of(
            [
                "head-on-wall",
                "1",
                "energy put out over K T/2 times the integral of v²",
            ],
            1.1,
            Mutant::LateForce,
            head_on,
        )
    },
    Case {
        facts: "K up to 0.9 times 2 b/T",
        runs: "K = 0.9 times 2 b/T; 0.05-0.5 m/s; 0.5 to 4 kHz; 8000 bounces",
        departs: &[
            (Departure::Account, "the theory is of the hold alone"),
            (Departure::Limits, "the theory has none"),
        ],
        ..Case::of(
            [
                "net-passivity",
                "2",
                "energy put out less what the device damps, J",
            ],
            0.0,
            Mutant::LateForce,
            net_passivity,
        )
    },
    Case {
        facts: "any K up to 10 kN/m with the account",
        runs: "0.1, 1, 3, 10 kN/m; 0.05-0.5 m/s; 8000 bounces",
        ..Case::of(
            [
                "passivity",
                "2",
                "the same at 0.1 to 10 kN/m, with the energy account, J",
            ],
            0.0,
            Mutant::Passivity,
            passivity,
        )
    },
    Case {
        facts: "any K up to 10 kN/m with the account",
        runs: "the same",
        departs: &[(Departure::Limits, UNLIMITED)],
        ..Case::of(
            [
                "passivity-unlimited",
                "2",
                "the same without limits of force and slew, J",
            ],
            0.0,
            Mutant::Passivity,
            passivity,
        )
    },
    Case {
        facts: "any K up to 10 kN/m with the account",
        runs: "the same, a capsule upright",
        probe: ProbeOfCase::Tool,
        departs: &[(Departure::Limits, UNLIMITED)],
        ..Case::of(
            ["passivity-unlimited-tool", "2", "the same under a tool, J"],
            0.0,
            Mutant::Passivity,
            passivity,
        )
    },
    Case {
        facts: "1-10 mm/s",
        runs: "1-10 mm/s; faces of 16 and 1 mm, turned at random; 10 000 onsets",
        ..Case::of(
            ["slow-onset", "10", "first force over K v T"],
            1.05,
            Mutant::DeadZone,
            onset,
        )
    },
    Case {
        facts: "1e-9 to 1e-6 m a tick",
        runs: "1e-9, 1e-8, 1e-7, 1e-6 m a tick; faces of 16 and 1 mm, turned at random",
        ..Case::of(
            [
                "creep",
                "10",
                "force along a smooth plate, of K times the size",
            ],
            1e-9,
            Mutant::ShortMotion,
            creep,
        )
    },
    Case {
        facts: "D = 1-50 um, K <= 2 f_c/D",
        runs: "D = 1, 5, 10, 50 um; K = 0.5, 1, 1.9 kN/m; f_c = 0 and K D/1.8",
        departs: &[(Departure::Account, "the quantum alone is looked at")],
        ..Case::of(
            ["encoder", "21", "amplitude of the force over K D"],
            1.0 + 1e-9,
            Mutant::Sign,
            encoder_force,
        )
    },
    Case {
        facts: "D = 1-50 um, K <= 2 f_c/D",
        runs: "D = 1, 5, 10, 50 um; K = 0.5, 1, 1.9 kN/m; f_c = 0 and K D/1.8",
        ..Case::of(
            [
                "encoder-account",
                "21",
                "amplitude of the force over K D, and of the position over D",
            ],
            1.0 + 1e-9,
            Mutant::Sign,
            encoder,
        )
    },
];

/// Why a case runs without limits of force and slew beside one that has them.
pub const UNLIMITED: &str = "the account alone, without what the limits of force and slew take";

/// Ticks of a bounce at the most.
const BOUNCE_TICKS: u32 = 4000;
/// Share of the force that is due at the deepest which a bounce must have had: the limit of slew
/// and the energy account leave 0.74 of it at 40 kN/m and 4 kHz, and more elsewhere.
pub(super) const PUSHED_SHARE: f64 = 0.5;

/// What a bounce off a wall did.
pub struct Bounce {
    /// Energy that the wall put out, joules.
    pub energy_j: f64,
    /// The integral of the squared speed over the contact, m²/s.
    pub travel: f64,
    /// The largest force over what was due at the deepest: stiffness times depth, within the limit
    /// of the force. 0 where nothing was due.
    pub pushed: f64,
    /// Whether the device has left the wall.
    pub has_left: bool,
}

impl Bounce {
    /// Whether a wall did it: what renders nothing puts nothing out.
    fn is_off_wall(&self) -> bool {
        self.has_left && self.pushed >= PUSHED_SHARE
    }
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
    let stiffness = bench.setup().stiffness_n_per_m;
    let most_n = bench.plan().safety.force_max_n;
    let start = DVec3::Z * (surface + speed * period * (1.0 + phase));
    bench.travel(start);
    let mut mass = FreeMass::of(device, start, DVec3::Z * -speed, period);
    let (mut travel, mut force, mut last) = (0.0, DVec3::ZERO, start);
    let (mut was_pushed, mut has_left) = (false, false);
    let (mut peak_n, mut due_n) = (0.0, 0.0f64);
    for _ in 0..BOUNCE_TICKS {
        let place = mass.advance(force);
        let moved = place - last;
        // Of the period in which it touches only the part behind the surface is contact; in that in
        // which it leaves the force acts to the end. Where a force is withheld later on, the device
        // pays for nothing.
        let share = if force != DVec3::ZERO {
            1.0
        } else if was_pushed {
            0.0
        } else {
            let behind = (surface - place.z) / moved.z.abs();
            behind.clamp(0.0, 1.0)
        };
        travel += share * moved.length_squared() / period;
        last = place;
        force = bench.touch(place).force;
        was_pushed |= force != DVec3::ZERO;
        peak_n = max_or_nan(peak_n, force.length());
        due_n = due_n.max((stiffness * (surface - place.z)).min(most_n));
        // Behind the surface a force that is withheld may come again.
        if travel > 0.0 && force == DVec3::ZERO && place.z >= surface {
            has_left = true;
            break;
        }
    }
    Bounce {
        energy_j: mass.work_j(),
        travel,
        pushed: if due_n > 0.0 { peak_n / due_n } else { 0.0 },
        has_left,
    }
}

/// A plate that is there as a whole.
///
/// # Errors
/// One sentence when it cannot be served.
pub fn wall(setup: Setup) -> Result<Bench, Failure> {
    let mut bench = Bench::new(&model(shapes::plate(), true)?, setup)?;
    bench.settle(setup.pose.transform_point(DVec3::Z * 0.01))?;
    Ok(bench)
}

/// Case 1: energy put out over K T / 2 times the integral of v², the largest; 1 is what a hold
/// without delay costs.
fn head_on(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for &rate_hz in defaults.rates() {
        let setup = Setup {
            rate_hz,
            ..defaults
        };
        let mut bench = wall(setup)?;
        for speed in [0.05, 0.1, 0.2, 0.5] {
            for _ in 0..size.of(8, 1000) {
                let bounce = bounce(&mut bench, speed, unit(random));
                let held = 0.5 * setup.stiffness_n_per_m * bench.period_s() * bounce.travel;
                found.most(bounce.energy_j / held);
                found.must(bounce.is_off_wall());
            }
        }
    }
    Ok(found)
}

/// Case 2: energy put out less what the device's damping takes, joules, the largest, at 0.9 of the
/// stiffness that it can take: 2 b / T.
fn net_passivity(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(f64::NEG_INFINITY);
    for &rate_hz in defaults.rates() {
        let setup = Setup {
            rate_hz,
            stiffness_n_per_m: 0.9 * 2.0 * DAMPING_NS_PER_M * rate_hz,
            ..defaults
        };
        bounces(setup, size.of(24, 2000), random, &mut found)?;
    }
    Ok(found)
}

/// Case 2, any stiffness to 10 kN/m with the energy account: energy put out, joules, the largest.
fn passivity(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(f64::NEG_INFINITY);
    for stiffness in [100.0, 1000.0, 3000.0, 10_000.0] {
        let setup = Setup {
            stiffness_n_per_m: stiffness * defaults.stiffer(),
            ..defaults
        };
        bounces(setup, size.of(50, 2000), random, &mut found)?;
        if stiffness == 3000.0 {
            found.log("up to 3 kN/m, J", found.value);
        }
    }
    Ok(found)
}

/// Bounces at 0.05 to 0.5 m/s.
fn bounces(
    setup: Setup,
    count: u64,
    random: &mut impl rand::Rng,
    found: &mut Found,
) -> Result<(), Failure> {
    let mut bench = wall(setup)?;
    for _ in 0..count {
        let speed = 0.05 + 0.45 * unit(random);
        let bounce = bounce(&mut bench, speed, unit(random));
        found.most(bounce.energy_j - DAMPING_NS_PER_M * bounce.travel);
        found.must(bounce.travel > 0.0 && bounce.is_off_wall());
    }
    Ok(())
}

/// A plate of this size, turned at random, and a way to its own axes; the probe is over it.
fn turned_wall(
    setup: Setup,
    size_m: f64,
    random: &mut impl rand::Rng,
) -> Result<(Bench, Pose), Failure> {
    let mut any = || 2.0 * unit(random) - 1.0;
    let turn = DVec3::new(any(), any(), any()) * 3.0;
    let pose = Pose {
        position: DVec3::new(any(), any(), any()),
        orientation: DQuat::from_scaled_axis(turn),
    };
    let bench = wall(Setup {
        size_m,
        pose,
        ..setup
    })?;
    Ok((bench, pose))
}

/// Case 10, the onset: the first force past the surface over K v T, the largest; none at all is
/// infinite.
fn onset(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    let setup = defaults;
    for size_m in [0.2, 0.012] {
        let (mut bench, pose) = turned_wall(setup, size_m, random)?;
        let over = |height: f64| pose.transform_point(DVec3::Z * height);
        for _ in 0..size.of(50, 5000) {
            let speed = 1e-3 + 9e-3 * unit(random);
            let step = speed * bench.period_s();
            let mut height = setup.radius_m + step * (3.0 + unit(random));
            bench.travel(over(height));
            while height >= setup.radius_m {
                height -= step;
                let force = bench.touch(over(height)).force;
                let due = setup.stiffness_n_per_m * (setup.radius_m - height);
                // Whatever is due within rounding is due.
                if due > 1e-6 * setup.stiffness_n_per_m * step {
                    let along = force.dot(pose.orientation * DVec3::Z);
                    found.must(along >= 0.99 * due);
                    found.most(force.length() / (setup.stiffness_n_per_m * step));
                }
            }
            bench.travel(over(0.005));
        }
    }
    Ok(found)
}

/// Case 10, the creep: force along a plate without friction over K times its size, the largest,
/// while the probe creeps 1e-9 to 1e-6 m a tick.
fn creep(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    let setup = defaults;
    for size_m in [0.2, 0.012] {
        let (mut bench, pose) = turned_wall(setup, size_m, random)?;
        let full = setup.stiffness_n_per_m * size_m;
        for exponent in [-9, -8, -7, -6] {
            let step = 10f64.powi(exponent);
            let mut aside = || 0.25 * size_m * (unit(random) - 0.5);
            let mut place = DVec3::new(aside(), aside(), 0.005);
            bench.travel(pose.transform_point(place));
            place.z = 0.0;
            bench.press(pose.transform_point(place), pose.orientation * DVec3::Z);
            for tick in 0..size.of(300, 30_000) {
                let turn = 1e-3 * setup.ms(tick);
                place += DVec3::new(turn.cos(), turn.sin(), 0.0) * step;
                let force = bench.touch(pose.transform_point(place)).force;
                let force = pose.orientation.inverse() * force;
                found.most(force.truncate().length() / full);
                // It lies a millimetre deep and must feel it.
                found.must(force.z >= 0.5 * setup.stiffness_n_per_m * setup.radius_m);
            }
            bench.travel(pose.transform_point(place + DVec3::Z * 0.005));
        }
    }
    Ok(found)
}

/// Case 21: amplitude of the force over K D, the largest.
fn encoder_force(trial: Trial<'_>) -> Result<Found, Failure> {
    rests(trial, |[force, _], _| force)
}

/// Case 21: amplitude of the force over K D and of the position over D, the larger, when a hand
/// rests on a wall through an encoder of step D, by a device without dry friction, and by one with
/// as much as the stiffness needs: K = 0.9 times 2 f_c / D.
fn encoder(trial: Trial<'_>) -> Result<Found, Failure> {
    // Without dry friction the facts have no limit of the position.
    rests(trial, |[force, position], dry| {
        if dry > 0.0 {
            max_or_nan(force, position)
        } else {
            force
        }
    })
}

/// A measure of the amplitudes of force and position, over K D and D, and of the dry friction, in
/// newtons, when a hand rests on a wall through an encoder.
fn rests(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
    measure: fn([f64; 2], f64) -> f64,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for step in [1e-6, 5e-6, 1e-5, 5e-5] {
        for stiffness in [500.0, 1000.0, 1900.0] {
            let stiffness_n_per_m = stiffness * defaults.stiffer();
            let setup = Setup {
                encoder_m: step,
                stiffness_n_per_m,
                ..defaults
            };
            let mut bench = wall(setup)?;
            for k in 0..size.of(2, 60) {
                let dry = [0.0, stiffness_n_per_m * step / 1.8][k as usize % 2];
                let depth = 1e-3 * (1.0 + unit(random));
                let swings = rest_on(&mut bench, dry, setup.radius_m - depth, &mut found);
                let swings = [swings[0] / (stiffness_n_per_m * step), swings[1] / step];
                found.most(measure(swings, dry));
                found.log("position, D", swings[1]);
            }
        }
    }
    Ok(found)
}

/// A hand comes down to a height and rests there for a second: amplitudes of force and position in
/// its last half.
fn rest_on(bench: &mut Bench, dry_n: f64, height: f64, found: &mut Found) -> [f64; 2] {
    let setup = *bench.setup();
    let (step, above) = (setup.encoder_m, 2.0 * setup.radius_m);
    bench.travel(DVec3::Z * above);
    // As deep as at 1 kHz.
    let mut hand = DryMass::new(above, [200.0 * setup.stiffer(), 2.0], dry_n);
    let mut force = 0.0;
    let mut range = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for tick in 0..setup.ticks(2000) {
        let share = (setup.ms(tick) / 500.0).min(1.0);
        hand.advance(above + (height - above) * share, force, bench.period_s());
        let read = (hand.height / step).round() * step;
        force = bench.touch(DVec3::Z * read).force.z;
        if tick >= setup.ticks(1500) {
            // Without a force there is nothing to be seen.
            found.must(force > 0.0);
            for (range, x) in range.iter_mut().zip([force, hand.height]) {
                *range = [range[0].min(x), range[1].max(x)];
            }
        }
    }
    bench.travel(DVec3::Z * above);
    range.map(|[low, high]| 0.5 * (high - low))
}

#[cfg(test)]
mod tests {
    use super::super::case::Size;
    use super::*;
    use rand::SeedableRng;
    use rand_xoshiro::Xoshiro256PlusPlus;

    /// A wall that is far below: every force is zero, and nothing is put out.
    const NO_WALL: Setup = Setup {
        pose: Pose {
            position: DVec3::new(0.0, 0.0, -1000.0),
            orientation: DQuat::IDENTITY,
        },
        rate_hz: 500.0,
        ..Setup::PRODUCT
    };

    #[test]
    fn a_wall_that_renders_nothing_does_not_pass() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
        let mut found = Found::new(f64::NEG_INFINITY);
        bounces(NO_WALL, 2, &mut random, &mut found).unwrap();
        assert_eq!(found.value, f64::INFINITY);
        assert!(found.measured() < 0.0, "{}", found.measured());
        let found = head_on(Trial {
            size: &Size {
                full: false,
                rate_hz: NO_WALL.rate_hz,
            },
            random: &mut random,
            defaults: NO_WALL,
        })
        .unwrap();
        assert_eq!((found.value, found.measured()), (f64::INFINITY, 0.0));
    }

    #[test]
    fn a_bounce_off_the_product_has_its_force_and_ends() {
        let mut bench = wall(Setup::default()).unwrap();
        for speed in [0.05, 0.5] {
            let bounce = bounce(&mut bench, speed, 0.3);
            assert!(bounce.is_off_wall(), "{speed}: {}", bounce.pushed);
            assert!(bounce.pushed <= 1.0 + 1e-9, "{speed}: {}", bounce.pushed);
        }
    }
}
