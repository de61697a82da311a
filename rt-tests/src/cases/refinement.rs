//! Splits and collapses under the probe cannot be felt.
//!
//! Of the ball the radius is known, so that a proxy which fell through it shows: whatever holds it,
//! it is outside of the full mesh where that is there.

use super::bench::{Bench, Response, model, parts, spm};
use super::case::{Case, Found, ProbeOfCase, Trial};
use super::changes::Changes;
use super::device::FreeMass;
use super::setup::{Departure, Setup};
use crate::failure::Failure;
use crate::models::surface::unit;
use geometry::closest_point_on_triangle;
use glam::{DQuat, DVec3};
use hrtc_core::contact::query::closest_point;
use mutants::Mutant;
use rand_xoshiro::Xoshiro256PlusPlus;
use spm::SpmParts;
use spm_builder::generate::{Shape, generate};
use std::collections::HashSet;
use std::sync::LazyLock;

/// Why geomorphs are looked at alone.
const ALONE: &str = "the geomorph alone is looked at";

/// The cases of this file.
pub const CASES: &[Case] = &[
    Case {
        facts: "each split and collapse keeps the side; |dF| a tick <= max(0.05 N, 7 %)",
        runs: "ball of 60 000 faces and relief of 50 000, fronts of 0.2 to 2 mm; held and in a hand; 400 presses",
        departs: &[(Departure::Account, ALONE)],
        ..Case::of(
            [
                "refine-under-contact",
                "12",
                "change of force in a tick over max(0.05 N, 7 %)",
            ],
            1.0,
            Mutant::Geomorph,
            under_contact,
        )
    },
    Case {
        facts: "each split and collapse keeps the side; |dF| a tick <= max(0.05 N, 7 %)",
        runs: "ball of 60 000 faces and relief of 50 000, fronts of 0.2 to 2 mm; held and in a hand; 400 presses",
        ..Case::of(
            [
                "refine-under-contact-account",
                "12",
                "change of force in a tick over max(0.05 N, 7 %)",
            ],
            1.0,
            Mutant::Geomorph,
            under_contact,
        )
    },
    Case {
        facts: "each split and collapse keeps the side; |dF| a tick <= max(0.05 N, 7 %)",
        runs: "the same, a capsule upright",
        probe: ProbeOfCase::Tool,
        departs: &[(Departure::Account, ALONE)],
        ..Case::of(
            ["refine-under-tool", "12", "the same under a tool"],
            1.0,
            Mutant::Geomorph,
            under_contact,
        )
    },
    Case {
        facts: "each split and collapse keeps the side; |dF| a tick <= max(0.05 N, 7 %)",
        runs: "the same, a capsule upright",
        probe: ProbeOfCase::Tool,
        ..Case::of(
            ["refine-under-tool-account", "12", "the same under a tool"],
            1.0,
            Mutant::Geomorph,
            under_contact,
        )
    },
    Case {
        facts: "each split and collapse keeps the side; |dF| a tick <= max(0.05 N, 7 %)",
        runs: "the same, a cache of 2 MiB, 20 to 40 ms, 2 % lost",
        departs: &[
            (Departure::SmallCache, "its subject"),
            (Departure::LossyLink, "its subject"),
            (Departure::Account, ALONE),
        ],
        ..Case::of(
            [
                "refine-small-lossy",
                "12",
                "the same under 2 MiB and a lossy link",
            ],
            1.0,
            Mutant::Geomorph,
            under_contact,
        )
    },
    Case {
        facts: "each split and collapse keeps the side; |dF| a tick <= max(0.05 N, 7 %)",
        runs: "the same, a capsule upright",
        probe: ProbeOfCase::Tool,
        departs: &[
            (Departure::SmallCache, "its subject"),
            (Departure::LossyLink, "its subject"),
            (Departure::Account, ALONE),
        ],
        ..Case::of(
            ["refine-tool-small-lossy", "12", "the same under a tool"],
            1.0,
            Mutant::Geomorph,
            under_contact,
        )
    },
    Case {
        facts: "coarse-fine-coarse E <= 0; E beside K p s + K s²/2",
        runs: "ball of 60 000 faces, 1 mm deep, fronts of 0.2 to 2 mm; 400 cycles",
        ..Case::of(
            [
                "refine-cycle-energy",
                "12",
                "energy of coarse-fine-coarse over K p s + K s²/2",
            ],
            1e-12,
            Mutant::Passivity,
            cycle_energy,
        )
    },
    Case {
        facts: "no flipped face at the contact, or the split refused and counted",
        runs: "every eighth split folds; 60 000 faces; 400 presses",
        departs: &[(Departure::Account, ALONE)],
        ..Case::of(
            [
                "fold-over",
                "13",
                "change of force in a tick over it, while folds are passed",
            ],
            1.0,
            Mutant::Folds,
            fold_over,
        )
    },
    Case {
        facts: "no flipped face at the contact, or the split refused and counted",
        runs: "every eighth split folds; 60 000 faces; 400 presses",
        ..Case::of(
            [
                "fold-over-account",
                "13",
                "change of force in a tick over it, while folds are passed",
            ],
            1.0,
            Mutant::Folds,
            fold_over,
        )
    },
];

/// Faces of the ball that is touched.
const FACES: u32 = 60_000;
/// How deep the probe is pressed, metres.
const DEPTH_M: f64 = 1e-3;
/// Time for which it is looked at what it does then, milliseconds.
const LOOK_MS: u64 = 2000;
/// Time within which a contact comes to full resolution, folds or not, milliseconds.
const MAX_FOLD_MS: u64 = 10_000;
/// How fast it comes down and leaves, metres a millisecond.
const STEP_M: f64 = 5e-5;
/// Of a height that is computed from a place, relative.
const ROUNDING: f64 = 1e-12;
/// Time without a change of the front after which a proxy has come to rest on it, milliseconds.
const STILL_MS: u64 = 100;
/// Share of its radius that a ball keeps away from the planes of the full mesh: it may rest on an
/// edge to a face that is still coarse, which is tilted by up to 8 degrees.
const BALL_SHARE: f64 = 0.99;
/// The same of a tool, whose cap has 10 sides and 6 rings: cos 18° times cos 7.5°.
const TOOL_SHARE: f64 = 0.94;

/// Least distance of a face's plane from the middle of the ball, file units: its facets cut into
/// the sphere of radius 1 by no more.
static INNER_RADIUS: LazyLock<f64> = LazyLock::new(|| {
    let mesh = generate(Shape::Sphere, FACES, 1);
    let point = |v: u32| DVec3::from_array(mesh.positions[v as usize]);
    let faces = mesh.triangles.iter().map(|face| face.map(point));
    faces.fold(f64::INFINITY, |least, [a, b, c]| {
        least.min((b - a).cross(c - a).normalize().dot(a).abs())
    })
});

/// A random direction.
fn direction(random: &mut Xoshiro256PlusPlus) -> DVec3 {
    let (turn, z) = (
        std::f64::consts::TAU * unit(random),
        2.0 * unit(random) - 1.0,
    );
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * turn.cos(), r * turn.sin(), z)
}

/// A ball of 0.2 m with faces of 2 mm, and a rough body.
fn bodies() -> Result<[Vec<u8>; 2], Failure> {
    Ok([
        model(generate(Shape::Sphere, FACES, 1), false)?,
        model(generate(Shape::Relief, 50_000, 1), false)?,
    ])
}

/// How coarse the front is in the pass of this number, metres.
fn coarse(pass: u64) -> f64 {
    [2e-3, 1e-3, 5e-4, 2e-4][pass as usize % 4]
}

/// A bench with the probe far over the ball, along `up`, where a coarse front is asked for; and its
/// height.
fn over(bytes: &[u8], setup: Setup, up: DVec3, coarse_m: f64) -> Result<(Bench, f64), Failure> {
    let mut bench = Bench::new(bytes, setup)?;
    let height = setup.size_m;
    bench.turn(DQuat::from_rotation_arc(DVec3::Z, up));
    bench.ask(coarse_m);
    bench.settle(up * height)?;
    Ok((bench, height))
}

/// Comes down until the probe is [`DEPTH_M`] deep in the front as it is; the height of the device
/// then.
fn press(bench: &mut Bench, up: DVec3, mut height: f64) -> f64 {
    // With no more force than at 1 kHz.
    let depth_m = DEPTH_M / bench.setup().stiffer().max(1.0);
    while height > 0.0 {
        if bench.touch(up * height).record.depth_m >= depth_m {
            break;
        }
        height -= STEP_M * bench.setup().ms(1);
    }
    height
}

/// Case 12: a probe is pressed 1 mm into a body while the front under it goes from coarse to fine
/// and back; or it is pressed into the base mesh and the records come late; the device is held, or
/// is in a hand. The largest change of force in a tick over what is not felt; infinite where the
/// proxy is on the other side, or within the full ball. Logged: the largest change of torque.
fn under_contact(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let bodies = bodies()?;
    let (mut found, mut looks) = (Found::new(0.0), 0);
    for k in 0..size.of(4, 400) {
        let press = Press {
            coarse_m: coarse(k / 4),
            is_late: k % 3 == 1,
            is_rough: k % 2 == 1,
            is_in_hand: k % 4 >= 2,
        };
        let bytes = &bodies[usize::from(press.is_rough)];
        looks += refined_and_back(bytes, defaults, press, direction(random), &mut found)?;
    }
    found.log("looks at the full ball", looks as f64);
    // In a small cache the front may never be full.
    found.must(looks > 0 || defaults.departs_in(Departure::SmallCache));
    Ok(found)
}

/// Whether a proxy is out of the ball at full resolution.
struct FullBall {
    /// How near to the middle it may be, metres.
    least_m: f64,
    /// Ticks without a change of the front.
    still: u64,
    /// Looks so far.
    looks: u64,
}

impl FullBall {
    fn new(setup: &Setup) -> Self {
        let share = match setup.length_m {
            None => BALL_SHARE,
            Some(_) => TOOL_SHARE,
        };
        // The longest side of the ball is its diameter.
        let inner_m = 0.5 * setup.size_m * *INNER_RADIUS;
        Self {
            least_m: inner_m + share * setup.radius_m,
            still: 0,
            looks: 0,
        }
    }

    /// After a tick: looks now and then, while nothing changes.
    fn tick(&mut self, bench: &Bench, response: &Response, found: &mut Found) {
        let record = &response.record;
        let changes = record.vsplits + record.ecols + record.geomorphing;
        self.still = if changes == 0 { self.still + 1 } else { 0 };
        let is_time = self.still.is_multiple_of(bench.setup().ticks(STILL_MS));
        if self.still > 0 && is_time {
            self.look(bench, response, found);
        }
    }

    /// Looks, if the front is full where the proxy is. One that fell through touches nothing, so
    /// that only the nearest face tells.
    fn look(&mut self, bench: &Bench, response: &Response, found: &mut Found) {
        let is_full = if response.record.contact {
            response.record.contact_full
        } else {
            let place = bench.to_model(response.proxy);
            let near = place.and_then(|place| closest_point(bench.surface(), place, None).0);
            near.is_some_and(|near| bench.mesh().certified_error(near.face) == 0.0)
        };
        if is_full {
            self.looks += 1;
            found.must(response.proxy.length() >= self.least_m);
        }
    }
}

/// What moves the device while it is looked at.
enum Holder {
    /// It is held at a place.
    Held(DVec3),
    /// A hand presses, and gives way.
    Hand(Box<FreeMass>),
}

impl Holder {
    fn tick(&mut self, bench: &mut Bench, force: DVec3) -> (DVec3, Response) {
        let place = match self {
            Self::Held(place) => *place,
            Self::Hand(hand) => hand.advance(force),
        };
        (place, bench.touch(place))
    }
}

/// How a press is made.
#[derive(Clone, Copy)]
struct Press {
    /// How coarse the front is at first, metres.
    coarse_m: f64,
    /// Whether the records come late.
    is_late: bool,
    /// Whether the body is rough.
    is_rough: bool,
    /// Whether the device is in a hand.
    is_in_hand: bool,
}

/// A press along `up`. Returns how often the proxy was looked at on the full ball.
fn refined_and_back(
    bytes: &[u8],
    setup: Setup,
    how: Press,
    up: DVec3,
    found: &mut Found,
) -> Result<u64, Failure> {
    let coarse_m = how.coarse_m;
    let (mut bench, height) = over(bytes, setup, up, coarse_m)?;
    bench.mute(how.is_late);
    let down = press(&mut bench, up, height);
    bench.mute(false);
    let mut before = bench.touch(up * down);
    found.must(before.pushes(&setup));
    // As deep as it is now the hand holds it: 200 N/m.
    let wanted = up * down - before.force / 200.0;
    let mut holder = if how.is_in_hand {
        let hand = [200.0, 2.0];
        let mut mass = FreeMass::held(up * down, DVec3::ZERO, bench.period_s(), 0.0, hand);
        mass.intend(wanted, DVec3::ZERO);
        Holder::Hand(Box::new(mass))
    } else {
        Holder::Held(up * down)
    };
    let kind = match (how.is_rough, how.is_in_hand) {
        (false, false) => "ball, held",
        (false, true) => "ball, in a hand",
        (true, false) => "relief, held",
        (true, true) => "relief, in a hand",
    };
    let (mut splits, mut last) = (0, up * down);
    let mut changes = Changes::new(&setup, before.force);
    let mut ball = FullBall::new(&setup);
    for tolerance_m in [0.0, coarse_m, 0.0] {
        bench.ask(tolerance_m);
        for _ in 0..setup.ticks(LOOK_MS) {
            let (place, response) = holder.tick(&mut bench, before.force);
            // A proxy that is free is at the device, but for rounding.
            let is_above = response.proxy.dot(up) >= place.dot(up) * (1.0 - ROUNDING);
            let is_outside = is_above && response.force.dot(up) >= 0.0;
            found.must(is_outside);
            if tolerance_m == 0.0 && !how.is_rough {
                ball.tick(&bench, &response, found);
            }
            // What the device's own motion changes is its hand's.
            let own = setup.stiffness_n_per_m * place.distance(last);
            last = place;
            let step = changes.add(response.force, own);
            found.most(step);
            found.log(kind, step);
            found.log("torque step, N m", response.torque.distance(before.torque));
            splits += response.record.vsplits;
            before = response;
        }
    }
    // Where nothing changes nothing is shown.
    found.must(splits > 0);
    Ok(ball.looks)
}

/// The energy of a cycle, measured at the device: the probe presses into the coarse front, the
/// surface rises under it by s, the probe leaves the fine front, which goes coarse again. Without
/// an account that is K p s + K s²/2, with one nothing; infinite where the proxy is within the full
/// ball.
fn cycle_energy(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let [bytes, _] = bodies()?;
    let mut found = Found::new(f64::NEG_INFINITY);
    let (mut rises, mut ball) = (0, FullBall::new(&defaults));
    for k in 0..size.of(4, 400) {
        let (up, coarse_m) = (direction(random), coarse(k));
        let (mut bench, mut height) = over(&bytes, defaults, up, coarse_m)?;
        bench.touch(up * height);
        let start = bench.work_j();
        let down = press(&mut bench, up, height);
        let coarse = bench.settle(up * down)?;
        found.must(coarse.pushes(&defaults));
        let depth = coarse.proxy.dot(up) - down;
        bench.ask(0.0);
        let fine = bench.settle(up * down)?;
        ball.look(&bench, &fine, &mut found);
        let rise = fine.proxy.dot(up) - down - depth;
        height = down;
        while height < defaults.size_m {
            height += STEP_M * defaults.ms(1);
            bench.touch(up * height);
        }
        bench.ask(coarse_m);
        bench.settle(up * height)?;
        let of_f8 = defaults.stiffness_n_per_m * (depth * rise + 0.5 * rise * rise);
        found.must(rise.is_finite());
        // Where the surface has sunk, energy is lost in any case.
        if rise > 0.0 {
            found.most((bench.work_j() - start) / of_f8);
            rises += 1;
        }
    }
    found.must(rises > 0 && ball.looks > 0);
    Ok(found)
}

/// Case 13: a model whose splits fold the surface over on the way, though its full mesh is whole,
/// is refined under a pressing probe until the contact is at full resolution. Splits that would
/// turn a face over are refused while any other may come first, and counted; what is left passes as
/// a geomorph, and is not felt either. The largest change of force in a tick over what is not felt;
/// infinite where a face at the contact is turned over before any fold had to pass, or at the end,
/// or the contact stays coarse.
fn fold_over(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let bytes = folded_ball()?;
    let mut found = Found::new(0.0);
    let mut refused = 0;
    for _ in 0..size.of(4, 400) {
        refused += refined_over_folds(&bytes, defaults, direction(random), &mut found)?;
    }
    // Where nothing would fold, nothing is shown.
    found.must(refused > 0);
    Ok(found)
}

/// The ball with folds, see [`fold`].
fn folded_ball() -> Result<Vec<u8>, Failure> {
    let mut parts = parts(generate(Shape::Sphere, FACES, 1), false)?;
    fold(&mut parts);
    spm(&parts)
}

/// A press along `up`, until its contact is at full resolution, that follows a surface which sinks
/// by more than its depth. Returns the splits that were refused.
fn refined_over_folds(
    bytes: &[u8],
    setup: Setup,
    up: DVec3,
    found: &mut Found,
) -> Result<u32, Failure> {
    let (mut bench, height) = over(bytes, setup, up, setup.size_m)?;
    let mut down = press(&mut bench, up, height);
    let before = bench.touch(up * down);
    found.must(before.pushes(&setup));
    bench.ask(0.0);
    let (mut refused, mut passed) = (0, 0);
    let mut changes = Changes::new(&setup, before.force);
    let step = STEP_M * setup.ms(1);
    let mut own = 0.0;
    // A force that changes by no more than is not felt moves a stiffer surface more slowly.
    let most = setup.ticks(MAX_FOLD_MS) as f64 * setup.stiffer().max(1.0);
    for _ in 0..most as u64 {
        let response = bench.touch(up * down);
        found.most(changes.add(response.force, own));
        own = 0.0;
        if !response.record.contact {
            down -= step;
            own = setup.stiffness_n_per_m * step;
        }
        refused += response.record.rejected_folds;
        passed += response.record.passed_folds;
        let is_full = response.record.contact_full && response.record.geomorphing == 0;
        let may_be_turned = passed > 0 && !is_full;
        if !may_be_turned && is_turned_over(&bench, response.proxy, setup.radius_m * 1.1) {
            found.most(f64::INFINITY);
        }
        if is_full {
            return Ok(refused);
        }
    }
    found.most(f64::INFINITY);
    Ok(refused)
}

/// Exchanges the places of vt and vu where both are split again, in every eighth such record: the
/// faces between them are turned over until then.
fn fold(parts: &mut SpmParts) {
    let split: HashSet<u32> = parts.records.iter().map(|record| record.vs).collect();
    let base = parts.header.base_vertices;
    let mut count = 0;
    for record in &mut parts.records {
        let vt = base + 2 * record.i;
        if split.contains(&vt) && split.contains(&(vt + 1)) {
            count += 1;
            if count % 8 == 0 {
                std::mem::swap(&mut record.pos_t, &mut record.pos_u);
            }
        }
    }
}

/// Whether a face of the ball within some distance of a place points inwards.
fn is_turned_over(bench: &Bench, place: DVec3, distance_m: f64) -> bool {
    let (Some(centre), Some(place_in)) = (bench.to_model(DVec3::ZERO), bench.to_model(place))
    else {
        return false;
    };
    let unit = (place_in - centre).length() / place.length();
    let mesh = bench.mesh();
    let mut turned = false;
    mesh.for_each_active_face(|face| {
        let corners = mesh.corners(face);
        let near = closest_point_on_triangle(corners, place_in)
            .distance_squared
            .sqrt();
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a);
        turned |= near <= distance_m * unit && normal.dot(a - centre) < 0.0;
    });
    turned
}

#[cfg(test)]
mod tests;
