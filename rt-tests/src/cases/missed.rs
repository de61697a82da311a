//! Ticks that a loop misses while a hand beats on a wall: the force of the last one goes on.

use super::bench::Bench;
use super::case::{Case, Found, ProbeOfCase, Trial, positive};
use super::device::FreeMass;
use super::setup::Setup;
use super::walls::wall;
use crate::failure::Failure;
use crate::models::surface::unit;
use glam::DVec3;
use hrtc_core::record::max_or_nan;
use mutants::Mutant;

/// Parameters of missed ticks in the list of facts.
const MISSED: &str = "1 of 100 missed, bursts of 5; E <= 0 within 20 ticks, F <= clamp";

/// The cases of this file.
pub const CASES: &[Case] = &[
    Case {
        facts: MISSED,
        runs: "the same; hand 200 N/m, swings of 1 to 9 mm about the surface, B = 0.5 N s/m; 500 s each; catch-up \
               and count are the pacer's",
        ..Case::of(
            [
                "missed-ticks",
                "3",
                "energy put out since the contact began, 20 ticks after a miss, beyond the miss itself, J",
            ],
            0.0,
            Mutant::Passivity,
            missed_ticks,
        )
    },
    Case {
        facts: MISSED,
        runs: "the same, a capsule upright",
        probe: ProbeOfCase::Tool,
        ..Case::of(
            ["missed-ticks-tool", "3", "the same under a tool, J"],
            0.0,
            Mutant::Passivity,
            missed_ticks,
        )
    },
    Case {
        facts: MISSED,
        runs: "the same; energy from the miss on",
        open: "on the way out the damper hides B v of the spring, and the account a part. At 0.27 m/s 2.4 N are \
               felt of 2.7 N held: that is 7e-4 J, and up to 6e-4 J are put out beyond what is felt",
        known: HIDDEN_J,
        ..Case::of(
            [
                "missed-ticks-from-miss",
                "3",
                "energy put out in 20 ticks from a miss on, beyond what was stored and the miss itself, J",
            ],
            0.0,
            Mutant::Passivity,
            missed_from_miss,
        )
    },
];

/// Energy that the spring of the wall holds beyond what is felt of it, joules: at 1 kHz, 2.4 N of
/// 2.7 N, `(2.7² - 2.4²) / 2 K` = 7.7e-4. Twice that, since it goes with the depth and the speed at
/// the miss: both are drawn, and a wall of a slower loop is softer.
const HIDDEN_J: f64 = 1.5e-3;
/// Ticks after a miss within which nothing is put out.
const MISS_TICKS: u32 = 20;
/// One tick is missed of so many, or a burst.
const EVERY: u64 = 100;
/// Of these it is one of the first so many, so that the next miss comes after [`MISS_TICKS`].
const DRAWN: f64 = 80.0;
/// Where the hand wants the device, about the place where it touches: how far it swings in the
/// mean, metres, and by how much more and less. At 1 kHz the device touches at up to 0.45 m/s, and
/// leaves in every swing, mostly at 0.08 to 0.19 m/s.
const SWING_M: [f64; 2] = [5e-3, 4e-3];
/// How fast it swings, and grows and shrinks, rad/s; the period is no multiple of [`EVERY`] ticks.
const SWING_RAD_PER_S: [f64; 2] = [37.0, 0.7];
/// Seconds after which it swings as it will go on to.
const BEGUN_S: f64 = 1.0;

/// Case 3: energy put out 20 ticks after a miss since the contact of the miss began, joules, the
/// largest.
fn missed_ticks(trial: Trial<'_>) -> Result<Found, Failure> {
    missed(trial, |since| since.contact_j)
}

/// Case 3: the same from the miss on, beyond what the spring of the wall held before it.
fn missed_from_miss(trial: Trial<'_>) -> Result<Found, Failure> {
    missed(trial, |since| since.miss_j - since.stored_j)
}

/// Energy put out so far, joules.
struct Since {
    /// Since the contact began.
    contact_j: f64,
    /// Since the miss.
    miss_j: f64,
    /// In the spring of the wall before the miss.
    stored_j: f64,
}

/// What is looked at, joules.
type Measure = fn(&Since) -> f64;

/// A miss, until [`MISS_TICKS`] after it.
struct Watch {
    ticks: u32,
    /// Work done on the device before the contact, and before the miss, joules.
    before_j: [f64; 2],
    /// See [`Since`].
    stored_j: f64,
    /// Ticks after which a controller can have answered: the force of a tick acts for a period, and
    /// falls by the limit of slew.
    answered: u32,
    /// The most that was put out until then beyond what had been at the miss, joules: the force
    /// went on while nobody looked, and a controller cannot know that beforehand.
    of_miss_j: f64,
}

impl Watch {
    /// A tick later, with so much work done on the device so far: 20 ticks after the miss, what the
    /// measure is beyond that of the miss itself.
    fn tick(&mut self, work_j: f64, measure: Measure) -> Option<f64> {
        self.ticks += 1;
        let measured = |work_j: f64| {
            measure(&Since {
                contact_j: work_j - self.before_j[0],
                miss_j: work_j - self.before_j[1],
                stored_j: self.stored_j,
            })
        };
        let put_out_j = measured(work_j);
        if self.ticks <= self.answered {
            // What the contact had put out before is the controller's.
            let grown_j = put_out_j - positive(measured(self.before_j[1]));
            self.of_miss_j = max_or_nan(self.of_miss_j, grown_j);
        }
        (self.ticks == MISS_TICKS).then_some(put_out_j - self.of_miss_j)
    }
}

/// Where the hand wants the device after so many seconds, metres above the surface; with no more
/// force than at 1 kHz.
fn wanted(setup: &Setup, seconds: f64) -> f64 {
    let [turn, swell] = SWING_RAD_PER_S.map(|of| of * seconds);
    let swing = SWING_M[0] + SWING_M[1] * swell.sin();
    setup.radius_m + swing / setup.stiffer().max(1.0) * turn.cos()
}

/// A hand beats on a wall, while one period of a hundred is missed, or five in a row; the largest
/// of a measure, 20 ticks after each.
fn missed(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
    measure: Measure,
) -> Result<Found, Failure> {
    let setup = Setup {
        damping_ns_per_m: 0.5,
        ..defaults
    };
    let mut found = Found::new(f64::NEG_INFINITY);
    for missed in [1, 5] {
        let mut bench = wall(setup)?;
        let ticks = setup.ticks(size.of(20_000, 500_000));
        beat(&mut bench, (ticks, missed), measure, random, &mut found);
    }
    Ok(found)
}

/// The same for so many ticks, with so many missed at once.
fn beat(
    bench: &mut Bench,
    (ticks, missed): (u64, u64),
    measure: Measure,
    random: &mut impl rand::Rng,
    found: &mut Found,
) {
    let setup = *bench.setup();
    let most_n = bench.plan().safety.force_max_n * (1.0 + 1e-9);
    let (slew_n, period) = (bench.slew_n(), bench.period_s());
    let above = DVec3::Z * (2.0 * setup.radius_m);
    bench.travel(above);
    let mut hand = FreeMass::held(above, DVec3::ZERO, period, 0.0, [200.0, 2.0]);
    let (mut force, mut place, mut free_j) = (DVec3::ZERO, above, 0.0);
    let mut watch: Option<Watch> = None;
    let (mut missed_at, mut free, mut left) = (0, 0, 0);
    // A force that is withheld behind the surface does not end the contact.
    let is_free = |force: DVec3, place: DVec3| force == DVec3::ZERO && place.z >= setup.radius_m;
    for tick in 0..ticks {
        let seconds = period * tick as f64;
        hand.intend(DVec3::Z * wanted(&setup, seconds), DVec3::ZERO);
        if tick.is_multiple_of(EVERY) {
            missed_at = tick + (unit(random) * DRAWN) as u64;
        }
        if is_free(force, place) {
            free_j = hand.work_j();
            free += u32::from(seconds > BEGUN_S);
        }
        if tick == missed_at && force != DVec3::ZERO {
            // The spring behind the force that is felt, at most that of the whole depth.
            let whole = setup.stiffness_n_per_m * positive(setup.radius_m - place.z);
            let felt = if force.z < whole { force.z } else { whole };
            watch = Some(Watch {
                ticks: 0,
                before_j: [free_j, hand.work_j()],
                stored_j: 0.5 * felt * felt / setup.stiffness_n_per_m,
                answered: 1 + (force.length() / slew_n).ceil() as u32,
                of_miss_j: 0.0,
            });
        }
        let skipped = if tick == missed_at { missed } else { 0 };
        bench.miss(skipped);
        for _ in 0..=skipped {
            place = hand.advance(force);
        }
        force = bench.touch(place).force;
        found.must(force.length() <= most_n);
        let put_out_j = watch
            .as_mut()
            .and_then(|of| of.tick(hand.work_j(), measure));
        if let Some(put_out_j) = put_out_j {
            watch = None;
            found.most(put_out_j);
            left += u32::from(is_free(force, place));
        }
    }
    // Where the device never leaves, what a miss has put out is hidden behind what is stored.
    found.must(free > 0 && left > 0);
}

#[cfg(test)]
mod tests {
    use super::super::case::Size;
    use super::super::setup::Departure;
    use super::*;
    use rand::SeedableRng;
    use rand_xoshiro::Xoshiro256PlusPlus;

    fn of(seed: u64, defaults: Setup) -> Found {
        missed_ticks(Trial {
            size: &Size {
                full: false,
                rate_hz: defaults.rate_hz,
            },
            random: &mut Xoshiro256PlusPlus::seed_from_u64(seed),
            defaults,
        })
        .unwrap()
    }

    /// At 30 and 65 a hand that never left the wall hid it.
    #[test]
    fn without_the_account_misses_put_energy_out_whatever_the_seed() {
        let without = Setup {
            departs: &[(Departure::Account, "what it does is shown")],
            ..Setup::default()
        };
        for seed in [1, 30, 65] {
            let found = of(seed, without);
            let value = found.value;
            assert!(value > 1e-5 && value.is_finite(), "{seed}: {value}");
            let value = of(seed, Setup::default()).value;
            assert!(value <= 0.0, "{seed}: {value}");
        }
    }

    /// The force of the miss is of the miss; what comes later is not.
    #[test]
    fn what_is_put_out_before_a_controller_can_answer_is_of_the_miss() {
        let mut watch = Watch {
            ticks: 0,
            before_j: [1.0, 2.0],
            stored_j: 0.0,
            answered: 2,
            of_miss_j: 0.0,
        };
        for work_j in [1.5, 3.0, 3.5] {
            assert_eq!(watch.tick(work_j, |since| since.contact_j), None);
        }
        for _ in 3..MISS_TICKS - 1 {
            assert_eq!(watch.tick(3.25, |since| since.contact_j), None);
        }
        // A joule was put out before the miss, and a quarter after the answer; one is of the miss.
        assert_eq!(watch.tick(3.25, |since| since.contact_j), Some(1.25));
    }
}
