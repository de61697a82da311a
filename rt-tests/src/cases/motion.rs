//! Objects that move: driven onto a probe, and pushed by one.

use super::bench::{Bench, model};
use super::case::{Case, Found, Size, Trial};
use super::device::{DAMPING_NS_PER_M, FreeMass, MASS_KG};
use super::setup::{Departure, Setup};
use super::shapes;
use crate::failure::Failure;
use crate::models::surface::unit;
use geometry::Pose;
use glam::{DQuat, DVec3};
use mutants::Mutant;
use rand_xoshiro::Xoshiro256PlusPlus;
use scene::{DrivenPlan, FreePlan, MassPlan, MovablePlan, RailPlan, SpringDamperPlan};
use spm_builder::generate::{Shape, generate};

/// The cases of this file.
pub const CASES: &[Case] = &[
    Case {
        facts: "1 m/s onto a probe at rest; 10 rad/s; no side change, no gap of 2 ticks",
        runs: "sheets of 0 and 0.5 mm at 1 and 0.2 m/s, a paddle and a relief at 10 rad/s; held",
        departs: &[(
            Departure::Account,
            "of a surface that leaves a probe that nobody moves it takes the force",
        )],
        ..Case::of(
            [
                "moving-object",
                "17",
                "passes or gaps of two ticks, driven at 1 m/s or 10 rad/s",
            ],
            0.0,
            Mutant::Sweep,
            moving_object,
        )
    },
    Case {
        facts: "1 m/s onto a probe at rest; no side change, no gap of 2 ticks",
        runs: "sheets of 0 and 0.5 mm at 1 and 0.2 m/s; a device that gives way",
        ..Case::of(
            ["moving-object-free", "17", "the same of a free device"],
            0.0,
            Mutant::Sweep,
            moving_object_free,
        )
    },
    Case {
        runs: "0.01 to 2 kg, 0.3 to 10 kN/m, hit at 0.1-0.5 m/s; 1400 hits",
        ..Case::of(
            [
                "pushed-energy",
                "",
                "energy of device and body over that in the beginning",
            ],
            1.0 + 1e-9,
            Mutant::Passivity,
            pushed_energy,
        )
    },
    Case {
        runs: "0.01 to 2 kg, 0.3 to 10 kN/m, hit at 0.1-0.5 m/s; 1400 hits",
        departs: &[(
            Departure::Limits,
            "what lingers by the limit of slew is not of the body",
        )],
        ..Case::of(
            ["pushed-momentum", "", "stray of their momentum, relative"],
            1e-9,
            Mutant::Reaction,
            pushed_momentum,
        )
    },
    Case {
        runs: "the same on a rail, beside steps of a 64th of a tick; 1400 hits",
        departs: &[
            (Departure::Account, "the reference has none"),
            (Departure::Limits, "the reference has none"),
        ],
        ..Case::of(
            [
                "pushed-reference",
                "",
                "from 64 times the rate, relative, over the swing in a tick",
            ],
            1.0,
            Mutant::Reaction,
            pushed_reference,
        )
    },
    Case {
        runs: "the same against spring and damper of its own; 140 hits",
        ..Case::of(
            [
                "pushed-rest",
                "",
                "pushed bodies that do not sleep, or change in sleep",
            ],
            0.0,
            Mutant::Restless,
            pushed_rest,
        )
    },
];

/// Nothing of its own: what it is given it keeps.
const LOOSE: SpringDamperPlan = SpringDamperPlan {
    spring: 0.0,
    damping: Some(0.0),
};
/// Steps of the reference in a tick.
const FINER: u32 = 64;
/// Time in which a device that hits a body does so, and leaves it, milliseconds.
const PUSH_MS: u64 = 2000;
/// Seconds within which a body that was left alone is to sleep: ten times what its speed takes to
/// fade to a third, for a ten-thousandth of it, and again for the wait.
const ASLEEP_S: f64 = 12.0;

fn turned(random: &mut Xoshiro256PlusPlus) -> Pose {
    let mut any = || 2.0 * unit(random) - 1.0;
    Pose {
        position: DVec3::new(any(), any(), any()),
        orientation: DQuat::from_scaled_axis(DVec3::new(any(), any(), any()) * 3.0),
    }
}

fn driven(linear: DVec3, angular: DVec3) -> MovablePlan {
    MovablePlan::Driven(DrivenPlan {
        linear_m_per_s: linear,
        angular_rad_per_s: angular,
        anchor_m: DVec3::ZERO,
        period_s: None,
    })
}

/// Counts what a probe at a place of the world must not feel while a plate in z = 0 of its own axes
/// moves.
#[derive(Default)]
struct Watch {
    /// Whether the last tick had no force though one was due.
    gap: bool,
    /// Whether there ever was a force: where nothing is met, nothing is shown.
    touched: bool,
}

impl Watch {
    /// A tick: whether the proxy is on another side of the plate, or no force came for two ticks.
    fn is_wrong(&mut self, bench: &mut Bench, place: DVec3) -> (bool, DVec3) {
        let response = bench.touch(place);
        let pose = bench.pose();
        let radius = bench.setup().radius_m;
        let depth = radius - pose.inverse_transform_point(place).z;
        let out = pose.inverse_transform_point(response.proxy).z;
        // What is no number keeps nothing.
        let keeps = out >= 0.5 * radius;
        // Whatever is due within rounding is due.
        let is_pushed = response.force.dot(pose.orientation * DVec3::Z) > 0.0;
        self.touched |= is_pushed;
        let none = depth > 1e-6 * radius && !is_pushed;
        let gap = std::mem::replace(&mut self.gap, none) && none;
        (!keeps || gap, response.force)
    }
}

/// Case 17 with a device in nobody's hand: it is pushed along.
fn moving_object_free(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for gap in [0.0, 5e-4] {
        let sheet = model(shapes::sheets(gap), true)?;
        met(
            &sheet,
            (defaults, true),
            size.of(12, 2000),
            random,
            &mut found,
        )?;
    }
    Ok(found)
}

/// A plate comes along its normal onto a probe at rest, which is free or held.
fn met(
    sheet: &[u8],
    (defaults, is_free): (Setup, bool),
    count: u64,
    random: &mut Xoshiro256PlusPlus,
    found: &mut Found,
) -> Result<(), Failure> {
    for k in 0..count {
        // The plate comes along its normal, and a little across.
        let home = turned(random);
        let speed = if k % 4 == 3 { 0.2 } else { 1.0 };
        let across = DVec3::new(unit(random) - 0.5, unit(random) - 0.5, 0.0) * 0.2;
        let setup = Setup {
            pose: home,
            movable: Some(driven((DVec3::Z + across) * speed, DVec3::ZERO)),
            ..defaults
        };
        // Far enough to have the model there, which takes some ticks, and then some phase of a
        // tick.
        let ticks = setup.ticks(60) as f64 + unit(random);
        let far = speed / setup.rate_hz * ticks + setup.radius_m;
        met_once(sheet, (setup, is_free), far, found)?;
    }
    Ok(())
}

/// A plate that moves as it is set up, and a probe so far over where it begins, metres.
fn met_once(
    sheet: &[u8],
    (setup, is_free): (Setup, bool),
    far: f64,
    found: &mut Found,
) -> Result<(), Failure> {
    let mut bench = Bench::new(sheet, setup)?;
    let place = setup.pose.transform_point(DVec3::Z * far);
    let mut mass = FreeMass::new(place, DVec3::ZERO, bench.period_s(), 0.0);
    let (mut watch, mut force, mut at) = (Watch::default(), DVec3::ZERO, place);
    for tick in 0..setup.ticks(120) {
        if is_free {
            at = mass.advance(force);
        }
        let (wrong, response) = watch.is_wrong(&mut bench, at);
        force = response;
        if tick > setup.ticks(40) {
            found.right(!wrong);
        }
    }
    found.must(watch.touched);
    Ok(())
}

/// A paddle that turns about an axis in its plane, twice, and a probe that it comes to.
fn paddle(
    sheet: &[u8],
    defaults: Setup,
    random: &mut Xoshiro256PlusPlus,
    found: &mut Found,
) -> Result<(), Failure> {
    let home = turned(random);
    let angle = 6.0 * unit(random);
    let axis = DVec3::new(angle.cos(), angle.sin(), 0.0);
    let setup = Setup {
        pose: home,
        movable: Some(driven(DVec3::ZERO, axis * 10.0)),
        ..defaults
    };
    let mut bench = Bench::new(sheet, setup)?;
    // Ahead of the side that comes up, so that it is met from above.
    let arm = axis.cross(DVec3::Z) * (0.03 + 0.04 * unit(random));
    let up = DQuat::from_axis_angle(axis, 0.6 + 0.4 * unit(random));
    let place = home.transform_point(up * -arm);
    let mut watch = Watch::default();
    let mut above = false;
    for tick in 0..setup.ticks(1250) {
        let (wrong, _) = watch.is_wrong(&mut bench, place);
        let beside = bench.pose().inverse_transform_point(place).z;
        above |= tick > setup.ticks(40) && beside > 2.0 * setup.radius_m;
        found.right(!(wrong && above));
    }
    found.must(watch.touched);
    Ok(())
}

/// Case 17: ticks in which a probe at rest, in nobody's hand or held, is on the other side of a
/// plate that comes at 1 m/s or turns at 10 rad/s, or feels nothing for two ticks in a row, or
/// nothing of a rough body that turns under it.
fn moving_object(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for gap in [0.0, 5e-4] {
        let sheet = model(shapes::sheets(gap), true)?;
        met(
            &sheet,
            (defaults, false),
            size.of(12, 2000),
            random,
            &mut found,
        )?;
        for _ in 0..size.of(6, 1000) {
            paddle(&sheet, defaults, random, &mut found)?;
        }
    }
    let rough = model(generate(Shape::Relief, 20_000, 1), false)?;
    for _ in 0..size.of(2, 100) {
        let setup = Setup {
            pose: turned(random),
            movable: Some(driven(
                DVec3::ZERO,
                turned(random).position.normalize() * 10.0,
            )),
            ..defaults
        };
        let mut bench = Bench::new(&rough, setup)?;
        let place = |share: f64| {
            setup
                .pose
                .transform_point(DVec3::X * (share * setup.size_m))
        };
        for _ in 0..setup.ticks(1000) {
            bench.touch(place(1.0));
        }
        let mut gap = false;
        for tick in 0..setup.ticks(2000) {
            // Well within the smallest radius of the body, so that there is always a force.
            let share = (1.0 - 1e-3 * setup.ms(tick)).max(0.3);
            let force = bench.touch(place(share)).force;
            let none = force == DVec3::ZERO || force.is_nan();
            found.right(!(tick > setup.ticks(700) && none && gap));
            gap = none;
        }
    }
    Ok(found)
}

/// A device in nobody's hand that pushes a body, and what the two have.
struct Push {
    bench: Bench,
    device: FreeMass,
    force: DVec3,
    mass_kg: f64,
    /// Whether it was ever touched.
    touched: bool,
}

impl Push {
    /// A device at a place with a velocity and its damping, N s/m.
    fn new(
        bytes: &[u8],
        setup: Setup,
        mass_kg: f64,
        [place, velocity]: [DVec3; 2],
        damping: f64,
    ) -> Result<Self, Failure> {
        let mut bench = Bench::new(bytes, setup)?;
        bench.settle(place)?;
        let device = FreeMass::of([MASS_KG, damping], place, velocity, bench.period_s());
        Ok(Self {
            bench,
            device,
            force: DVec3::ZERO,
            mass_kg,
            touched: false,
        })
    }

    fn tick(&mut self) {
        let place = self.device.advance(self.force);
        self.force = self.bench.touch(place).force;
        self.touched |= self.force != DVec3::ZERO;
    }

    /// Velocity of the middle of the body.
    fn velocity(&self) -> DVec3 {
        let body = self.bench.body();
        body.map_or(DVec3::ZERO, |body| body.velocity())
    }

    fn momentum(&self) -> DVec3 {
        self.device.velocity() * MASS_KG + self.velocity() * self.mass_kg
    }

    fn energy(&self) -> f64 {
        let of_device = 0.5 * MASS_KG * self.device.velocity().length_squared();
        let of_body = self.bench.body().map_or(0.0, |body| body.kinetic_j());
        of_device + of_body
    }
}

fn free(mass_kg: f64, rest: SpringDamperPlan) -> MovablePlan {
    MovablePlan::Free(FreePlan {
        mass: mass(mass_kg),
        linear: rest,
        angular: rest,
    })
}

fn mass(mass_kg: f64) -> MassPlan {
    MassPlan {
        mass_kg,
        inertia_kgm2: None,
        gravity_m_per_s2: DVec3::ZERO,
    }
}

/// Masses, kg, and stiffnesses, N/m, that are pushed.
const PUSHED: [(f64, f64); 7] = [
    (0.01, 300.0),
    (0.03, 1000.0),
    (0.03, 3000.0),
    (0.2, 300.0),
    (0.2, 3000.0),
    (2.0, 1000.0),
    (2.0, 10_000.0),
];

/// Every free body of [`PUSHED`], a plate, before it is hit somewhere aside of its middle.
fn each_push(
    size: &Size,
    random: &mut Xoshiro256PlusPlus,
    defaults: Setup,
    mut each: impl FnMut(Push),
) -> Result<(), Failure> {
    let bytes = model(shapes::plate(), true)?;
    for (mass_kg, stiffness_n_per_m) in PUSHED {
        for _ in 0..size.of(3, 200) {
            let setup = Setup {
                stiffness_n_per_m: stiffness_n_per_m * defaults.stiffer(),
                pose: turned(random),
                movable: Some(free(mass_kg, LOOSE)),
                ..defaults
            };
            let any = turned(random).position;
            let speed = 0.1 + 0.4 * unit(random);
            let above = DVec3::new(0.05 * any.x, 0.05 * any.y, 5e-3);
            let towards = DVec3::new(0.2 * any.z, 0.2 * any.y, -1.0).normalize();
            let direction = [
                setup.pose.transform_point(above),
                setup.pose.orientation * (towards * speed),
            ];
            each(Push::new(&bytes, setup, mass_kg, direction, 0.0)?);
        }
    }
    Ok(())
}

/// Energy of a device without damping and of a body over that in the beginning, the largest;
/// infinite where nothing was touched.
fn pushed_energy(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    each_push(size, random, defaults, |mut push| {
        let first = push.energy();
        for _ in 0..push.bench.setup().ticks(PUSH_MS) {
            push.tick();
            found.most(push.energy() / first);
        }
        found.must(push.touched);
    })?;
    Ok(found)
}

/// Momentum of a device without damping and of a body: how far it strays from that in the
/// beginning, relative, the largest; infinite where nothing was touched.
fn pushed_momentum(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    each_push(size, random, defaults, |mut push| {
        let first = push.momentum();
        for _ in 0..push.bench.setup().ticks(PUSH_MS) {
            push.tick();
            found.most(push.momentum().distance(first) / first.length());
        }
        found.must(push.touched);
    })?;
    Ok(found)
}

/// The velocity that a body on a rail gets from a device that hits it, beside that of two masses
/// and a spring at 64 times the rate: the difference relative to the latter, over the angle of
/// their swing in a tick, the largest.
fn pushed_reference(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let bytes = model(shapes::plate(), true)?;
    let mut found = Found::new(0.0);
    for (mass_kg, stiffness) in PUSHED {
        let stiffness_n_per_m = stiffness * defaults.stiffer();
        for _ in 0..size.of(3, 200) {
            let setup = Setup {
                stiffness_n_per_m,
                movable: Some(MovablePlan::Rail(RailPlan {
                    mass: mass(mass_kg),
                    axis: DVec3::Z,
                    linear: LOOSE,
                    limits_m: None,
                })),
                ..defaults
            };
            let speed = 0.1 + 0.4 * unit(random);
            let height = 3.0 * speed / setup.rate_hz * (1.0 + unit(random));
            let start = DVec3::Z * (setup.radius_m + height);
            let direction = [start, DVec3::Z * -speed];
            let mut push = Push::new(&bytes, setup, mass_kg, direction, DAMPING_NS_PER_M)?;
            for _ in 0..setup.ticks(PUSH_MS) {
                push.tick();
            }
            let due = after_impact(mass_kg, stiffness_n_per_m, speed, height, setup.rate_hz);
            let swing = (stiffness_n_per_m * (1.0 / MASS_KG + 1.0 / mass_kg)).sqrt();
            let seen = -push.velocity().z;
            found.most((seen / due - 1.0).abs() / (swing / setup.rate_hz));
        }
    }
    Ok(found)
}

/// The speed of a body that stood, after a device with a speed has hit it from a height, by steps
/// of the semi-implicit kind of both, 64 a tick: the spring pushes while it is pressed.
fn after_impact(mass_kg: f64, stiffness: f64, speed: f64, height: f64, rate_hz: f64) -> f64 {
    let dt = 1.0 / (rate_hz * f64::from(FINER));
    let (mut device, mut device_speed) = (-height, speed);
    let (mut body, mut body_speed) = (0.0, 0.0);
    for _ in 0..PUSH_MS * rate_hz as u64 / 1000 * u64::from(FINER) {
        let force = stiffness * f64::max(device - body, 0.0);
        device_speed -= dt / MASS_KG * (force + DAMPING_NS_PER_M * device_speed);
        body_speed += dt / mass_kg * force;
        device += dt * device_speed;
        body += dt * body_speed;
    }
    body_speed
}

/// Bodies that were pushed and do not come to rest and sleep by themselves, or do not keep their
/// bits in sleep.
fn pushed_rest(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    let bytes = model(generate(Shape::Sphere, 4096, 1), true)?;
    for (mass_kg, stiffness_n_per_m) in PUSHED {
        for _ in 0..size.of(1, 20) {
            let rest = SpringDamperPlan {
                spring: 0.0,
                damping: None,
            };
            let setup = Setup {
                stiffness_n_per_m: stiffness_n_per_m * defaults.stiffer(),
                movable: Some(free(mass_kg, rest)),
                ..defaults
            };
            let aside = DVec3::new(unit(random) - 0.5, unit(random) - 0.5, 0.0) * 0.05;
            let start = DVec3::Z * 0.11 + aside;
            let direction = [start, DVec3::Z * -0.3];
            let mut push = Push::new(&bytes, setup, mass_kg, direction, DAMPING_NS_PER_M)?;
            let most = (ASLEEP_S / push.bench.period_s()) as u32;
            let mut ticks = 0;
            while ticks < most && !(push.touched && push.bench.is_asleep()) {
                push.tick();
                ticks += 1;
            }
            let slept = push.touched && push.bench.is_asleep();
            let pose = push.bench.pose();
            push.bench.travel(push.device.position());
            let stayed = (0..200).all(|_| {
                push.bench.touch(push.device.position());
                push.bench.pose() == pose
            });
            found.right(slept && stayed);
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests;
