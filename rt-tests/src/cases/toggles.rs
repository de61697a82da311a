//! Effects that come and go, and effects that must not be felt at all.

use super::bench::{Bench, model};
use super::case::{Case, Found, Trial};
use super::setup::{Departure, Setup};
use super::shapes;
use super::walls::wall;
use crate::failure::Failure;
use crate::models::surface::unit;
use glam::DVec3;
use hrtc_core::record::max_or_nan;
use mutants::Mutant;
use std::f64::consts::TAU;

/// The cases of this file.
pub const CASES: &[Case] = &[
    Case {
        facts: "|dF| a tick <= slew while an effect is toggled in contact",
        runs: "all kinds but a boundary come and go, each alone; fades of the default; 50 rounds at \
               0.1 m/s beside the slew limit, and as many at 0.05 m/s and less, without the energy \
               account, beside the fade",
        departs: &[(
            Departure::Limits,
            "the fade is looked at, not the gate behind it",
        )],
        ..Case::of(
            [
                "effects-toggled",
                "22",
                "change of force in a tick over the slew limit, and over 4 times its fade's",
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

/// Where a probe is while an effect comes and goes.
#[derive(Clone, Copy)]
enum Place {
    /// In a plate.
    Plate,
    /// Above a plate, where a magnet pulls.
    Above,
    /// In a slope beside a ridge, and along it: on a plate shading turns nothing.
    Ridge,
}

/// How deep the probe is in a surface, metres.
const DEPTH_M: f64 = 1e-3;
/// How far above it, metres.
const ABOVE_M: f64 = 5e-3;
/// Angle between the slopes beside a ridge, radians, and how far from it the contact is, metres.
const RIDGE_RAD: f64 = 0.3;
const BESIDE_M: f64 = 5e-4;
/// How many times what its fade takes of an effect a force may change by in a tick. The probe is
/// led so that no effect changes faster by its motion than by its fade. What is deflected or
/// carried along while it fades in (friction, inertia) changes by up to two and a half times that.
const OF_FADE: f64 = 4.0;
/// Smallest force of an effect that shows anything, of that of the surface.
const SHOWN: f64 = 0.03;
/// What the fade alone is looked at without.
const FADE_ALONE: &[(Departure, &str)] = &[
    (Departure::Limits, "a jump would be a ramp"),
    (Departure::Account, "what it withholds is its own"),
];

/// An effect that acts from 1 to 1.3 s, and fades as by default.
#[derive(Clone, Copy)]
struct Toggled {
    name: &'static str,
    effects: &'static str,
    place: Place,
    /// Radius of the circle on which its fade is looked at, metres: small beside what the effect
    /// changes over.
    slow_m: f64,
}

impl Toggled {
    const fn of(name: &'static str, effects: &'static str) -> Self {
        Self {
            name,
            effects,
            place: Place::Plate,
            slow_m: 0.01,
        }
    }

    /// What is touched.
    fn bench(&self, setup: Setup) -> Result<Bench, Failure> {
        if !matches!(self.place, Place::Ridge) {
            return wall(setup);
        }
        let mut bench = Bench::new(&model(shapes::roof(RIDGE_RAD), true)?, setup)?;
        bench.settle(DVec3::Z * 0.01)?;
        Ok(bench)
    }

    /// The place of the device, `aside` along x and y, metres.
    fn at(&self, setup: &Setup, aside: [f64; 2]) -> DVec3 {
        let [x, y] = aside;
        match self.place {
            Place::Plate => DVec3::new(x, y, setup.radius_m - DEPTH_M),
            Place::Above => DVec3::new(x, y, setup.radius_m + ABOVE_M),
            Place::Ridge => {
                let (sin, cos) = (0.5 * RIDGE_RAD).sin_cos();
                let on_slope = DVec3::new(BESIDE_M * cos, y, -BESIDE_M * sin);
                on_slope + DVec3::new(sin, 0.0, cos) * (setup.radius_m - DEPTH_M)
            }
        }
    }

    /// The forces, newtons, and the ticks of the fade, where the device goes so, by the
    /// milliseconds.
    fn forces(
        &self,
        setup: Setup,
        aside: impl Fn(f64) -> [f64; 2],
        found: &mut Found,
    ) -> Result<(Vec<DVec3>, f64), Failure> {
        let setup = Setup {
            effects: self.effects,
            ..setup
        };
        let mut bench = self.bench(setup)?;
        let plan = bench.plan();
        let mut listed = plan.effects.iter().chain(plan.objects[0].effects.iter());
        let fade_s = listed.next().map_or(f64::NAN, |listed| listed.fade_s);
        let at = |tick: u64| self.at(&setup, aside(setup.ms(tick)));
        bench.press(at(0), DVec3::Z);
        let mut forces = vec![bench.touch(at(0)).force];
        // It comes while it is looked at: without a call nothing is shown.
        found.must(bench.effect_calls() == 0);
        forces.extend((1..setup.ticks(1500)).map(|tick| bench.touch(at(tick)).force));
        found.must(bench.effect_calls() > 0);
        Ok((forces, fade_s * setup.rate_hz))
    }

    /// Changes of the force in a tick over the product's slew limit, while the probe turns and
    /// turns back.
    fn beside_slew(&self, setup: Setup, phase: f64, found: &mut Found) -> Result<(), Failure> {
        let aside = |ms: f64| {
            let turn = 0.01 * ms + phase;
            [0.01 * turn.sin(), 0.01 * (1.3 * turn).cos()]
        };
        let (forces, _) = self.forces(setup, aside, found)?;
        let slew_n = 2000.0 * 1e-3 * setup.ms(1);
        for pair in forces.windows(2) {
            let step = pair[1].distance(pair[0]) / slew_n;
            found.most(step);
            found.log(self.name, step);
        }
        Ok(())
    }

    /// The largest change in a tick over [`OF_FADE`] times what the fade takes of the effect, on a
    /// slow circle.
    fn beside_fade(&self, setup: Setup, phase: f64, found: &mut Found) -> Result<(), Failure> {
        let setup = Setup {
            departs: FADE_ALONE,
            ..setup
        };
        let aside = |ms: f64| {
            let turn = 5e-3 * ms + phase;
            [self.slow_m * turn.cos(), self.slow_m * turn.sin()]
        };
        let (forces, fade_ticks) = self.forces(setup, aside, found)?;
        let step = over_fade(
            &forces,
            fade_ticks,
            SHOWN * setup.stiffness_n_per_m * DEPTH_M,
        );
        found.must(step.is_some());
        if let Some(step) = step {
            found.most(step);
            found.log(self.name, step);
        }
        Ok(())
    }
}

/// The largest change of forces in a tick over [`OF_FADE`] times what a fade of so many ticks takes
/// of an effect, of which the first force knows nothing; none where it is weaker than `least_n`.
fn over_fade(forces: &[DVec3], fade_ticks: f64, least_n: f64) -> Option<f64> {
    let first = *forces.first()?;
    let of_effect = forces.iter().map(|force| force.distance(first));
    let effect_n = of_effect.fold(0.0, max_or_nan);
    let steps = forces.windows(2).map(|pair| pair[1].distance(pair[0]));
    let step_n = steps.fold(0.0, max_or_nan);
    // What is no number shows that it is none.
    let is_weak = effect_n < least_n;
    (!is_weak).then(|| step_n * fade_ticks / (OF_FADE * effect_n))
}

/// What is toggled.
const TOGGLED: [Toggled; 10] = [
    Toggled::of(
        "friction",
        "{ friction = { static = 1.0 }, from_s = 1, until_s = 1.3 }",
    ),
    Toggled {
        slow_m: 2e-4,
        ..Toggled::of(
            "noise",
            "{ texture = { amplitude_m = 3e-4, noise = { wavelength_m = 2e-3 } }, from_s = 1, until_s = 1.3 }",
        )
    },
    Toggled {
        slow_m: 2e-4,
        ..Toggled::of(
            "grating",
            "{ texture = { amplitude_m = 1e-4, grating = { wavelength_m = 2e-3 } }, from_s = 1, until_s = 1.3 }",
        )
    },
    Toggled {
        place: Place::Ridge,
        ..Toggled::of(
            "shading",
            "{ shading = { radius_m = 0.005 }, from_s = 1, until_s = 1.3 }",
        )
    },
    Toggled {
        place: Place::Above,
        ..Toggled::of(
            "magnet",
            "{ magnet = { force_n = 1, reach_m = 0.01 }, from_s = 1, until_s = 1.3 }",
        )
    },
    // A quarter of a wave until it comes.
    Toggled::of(
        "vibration",
        "{ vibration = { frequency_hz = 0.25, amplitude_n = 1 }, from_s = 1, until_s = 1.3 }",
    ),
    Toggled::of(
        "viscosity",
        "{ viscosity = { damping_ns_per_m = 20 }, from_s = 1, until_s = 1.3 }",
    ),
    Toggled::of(
        "spring",
        "{ spring = { point_m = [0, 0, 0.003], stiffness_n_per_m = 1000 }, from_s = 1, until_s = 1.3 }",
    ),
    Toggled::of(
        "gravity",
        "{ gravity = { mass_kg = 0.5 }, from_s = 1, until_s = 1.3 }",
    ),
    // So heavy that it is carried along no sooner than it comes.
    Toggled::of(
        "inertia",
        "{ inertia = { mass_kg = 2, stiffness_n_per_m = 10, damping_ns_per_m = 20 }, from_s = 1, until_s = 1.3 }",
    ),
];

/// What the probe is beyond.
const BOUNDARY: Toggled = Toggled::of(
    "boundary",
    "{ boundary = { ball = { radius_m = 0.001 } }, from_s = 1, until_s = 1.3 }",
);

/// Case 22: change of the force in a tick, the largest, while an effect comes and goes under a
/// pressing probe (of a magnet: one that hovers): over the product's slew limit, and over four
/// times what its fade takes of it. Logged: the larger of both for each effect, so that each has a
/// verdict of its own.
fn toggled(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for of in &TOGGLED {
        for _ in 0..size.of(1, 50) {
            let phase = TAU * unit(random);
            of.beside_slew(defaults, phase, &mut found)?;
            of.beside_fade(defaults, phase, &mut found)?;
        }
    }
    Ok(found)
}

/// The same of a boundary beside the slew limit alone: it pushes by and by, whatever its fade.
fn boundary_toggled(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for _ in 0..size.of(1, 50) {
        BOUNDARY.beside_slew(defaults, TAU * unit(random), &mut found)?;
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
        beside_none(again, effects, &mut found)?;
    }
    Ok(found)
}

/// Ticks at which effects change a bit of the force of a plate, beside none; and whether they are
/// called.
fn beside_none(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
    effects: &'static str,
    found: &mut Found,
) -> Result<(), Failure> {
    let ticks = size.of(2000, 50_000);
    let directions: Vec<f64> = (0..ticks).map(|_| unit(random)).collect();
    // A coordinate of places in a range of half a millimetre has a second difference of a
    // millimetre at the most, both of 1.4: 1400 m/s² at 1 kHz, where a hand may do 2000. At no
    // rate it is more.
    let range = 5e-4 * defaults.jump();
    let run = |effects| -> Result<(Vec<DVec3>, u64), Failure> {
        let mut bench = wall(Setup {
            effects,
            ..defaults
        })?;
        bench.travel(DVec3::Z * defaults.radius_m);
        let forces = directions.iter().map(|&direction| {
            let depth = range * (direction - 0.3);
            let place = DVec3::new(range * direction, 0.0, defaults.radius_m - depth);
            bench.touch(place).force
        });
        let forces = forces.collect();
        Ok((forces, bench.effect_calls()))
    };
    let (plain, _) = run("")?;
    let (listed, calls) = run(effects)?;
    compare(&plain, &listed, found);
    found.right(calls == 0);
    Ok(())
}

/// Counts ticks at which forces are not the same numbers, bit by bit: what is no number is none.
/// Without a force nothing is shown.
fn compare(plain: &[DVec3], listed: &[DVec3], found: &mut Found) {
    let bits = |force: DVec3| force.to_array().map(f64::to_bits);
    for (&a, &b) in plain.iter().zip(listed) {
        found.right(a.is_finite() && bits(a) == bits(b));
    }
    found.must(plain.iter().any(|force| force.length() > 0.0));
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene::Effect;

    #[test]
    fn every_effect_is_toggled() {
        let toggled = TOGGLED.iter().chain([&BOUNDARY]);
        let toggled: Vec<&str> = toggled.map(|of| of.effects).collect();
        for name in Effect::NAMES {
            let begins = format!("{{ {name} = ");
            assert!(
                toggled.iter().any(|of| of.starts_with(&begins)),
                "{name} is not toggled"
            );
        }
    }

    #[test]
    fn every_effect_that_comes_or_goes_at_once_is_beyond_its_fade() {
        for of in &TOGGLED {
            for fade_s in [0.1, 1e-3] {
                let fades = format!("fade_s = {fade_s}, from_s");
                let effects: &str = of.effects.replace("from_s", &fades).leak();
                let setup = Setup {
                    departs: FADE_ALONE,
                    ..Setup::PRODUCT
                };
                let mut found = Found::new(0.0);
                let aside = |ms: f64| {
                    let turn = 5e-3 * ms + 1.0;
                    [of.slow_m * turn.cos(), of.slow_m * turn.sin()]
                };
                let of = Toggled { effects, ..*of };
                let (forces, _) = of.forces(setup, aside, &mut found).expect("it is served");
                let step = over_fade(&forces, 100.0, 0.03).expect("it is felt");
                // Beside the fade of the product.
                assert_eq!(
                    step <= 1.0,
                    fade_s == 0.1,
                    "{}: {fade_s} s: {step}",
                    of.name
                );
                assert!(step <= 1.0 || step > 5.0, "{}: {step}", of.name);
                assert_eq!(found.value, 0.0, "{}", of.name);
            }
        }
    }

    #[test]
    fn what_is_no_number_in_both_runs_is_not_the_same_and_no_force_shows_nothing() {
        let of = |a: [DVec3; 2], b: [DVec3; 2]| {
            let mut found = Found::new(0.0);
            compare(&a, &b, &mut found);
            found.value
        };
        let forces = [DVec3::Z, DVec3::ZERO];
        assert_eq!(of(forces, forces), 0.0);
        assert_eq!(of(forces, [DVec3::Z, DVec3::Z * 1e-300]), 1.0);
        let no_number = [DVec3::Z, DVec3::NAN];
        assert_eq!(of(no_number, no_number), 1.0);
        assert_eq!(of([DVec3::ZERO; 2], [DVec3::ZERO; 2]), f64::INFINITY);
    }

    #[test]
    fn what_is_hardly_felt_shows_no_fade() {
        let forces = [DVec3::Z, DVec3::Z * 1.02, DVec3::Z];
        assert_eq!(over_fade(&forces, 100.0, 0.03), None);
        let jump = [DVec3::Z, DVec3::Z * 2.0, DVec3::Z * 2.0];
        assert_eq!(over_fade(&jump, 100.0, 0.03), Some(25.0));
        let no_number = [DVec3::Z, DVec3::NAN, DVec3::Z];
        assert!(over_fade(&no_number, 100.0, 0.03).is_some_and(f64::is_nan));
    }
}
