//! Splits and collapses under the probe cannot be felt.

use super::bench::{Bench, Fault, Setup, model, parts, spm};
use super::found::{Found, Size, Trial};
use crate::failure::Failure;
use crate::models::surface::unit;
use geometry::closest_point_on_triangle;
use glam::{DQuat, DVec3};
use rand_xoshiro::Xoshiro256PlusPlus;
use spm::SpmParts;
use spm_builder::generate::{Shape, generate};
use std::collections::HashSet;

/// Faces of the ball that is touched.
const FACES: u32 = 60_000;
/// How deep the probe is pressed, metres.
const DEPTH_M: f64 = 1e-3;
/// Ticks for which it is looked at what it does then.
const LOOK_TICKS: u32 = 2000;
/// Ticks within which a contact comes to full resolution, folds or not.
const MAX_FOLD_TICKS: u32 = 10_000;
/// How fast it comes down and leaves, metres a tick.
const STEP_M: f64 = 5e-5;
/// Of a height that is computed from a place, relative.
const ROUNDING: f64 = 1e-12;
/// A change of force below the just noticeable one, newtons, and as a share of the force.
const STEP_N: f64 = 0.05;
const STEP_SHARE: f64 = 0.07;

/// A random direction.
fn direction(random: &mut Xoshiro256PlusPlus) -> DVec3 {
    let (turn, z) = (
        std::f64::consts::TAU * unit(random),
        2.0 * unit(random) - 1.0,
    );
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * turn.cos(), r * turn.sin(), z)
}

/// A ball of 0.2 m with faces of 2 mm.
fn ball(fault: Fault) -> Result<(Vec<u8>, Setup), Failure> {
    let mesh = generate(Shape::Sphere, FACES, 1);
    let setup = Setup {
        geomorph: true,
        fault,
        ..Setup::default()
    };
    Ok((model(mesh, false)?, setup))
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
    while bench.touch(up * height).record.depth_m < DEPTH_M && height > 0.0 {
        height -= STEP_M;
    }
    height
}

/// Case 12: a probe is pressed 1 mm into a ball while the front under it goes from coarse to fine
/// and back; or it is pressed into the base mesh and the records come late. The largest change of
/// force in a tick over what is not felt; infinite where the proxy is on the other side.
pub fn under_contact(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let (bytes, setup) = ball(fault)?;
    under(&bytes, setup, size, random)
}

/// The same under a tool that is pressed in upright.
pub fn under_tool(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let (bytes, setup) = ball(fault)?;
    under(&bytes, with_tool(setup), size, random)
}

/// The same with a tool in place of the ball.
fn with_tool(setup: Setup) -> Setup {
    let length_m = Some(10.0 * setup.radius_m);
    Setup { length_m, ..setup }
}

fn under(
    bytes: &[u8],
    setup: Setup,
    size: &Size,
    random: &mut Xoshiro256PlusPlus,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for k in 0..size.of(4, 400) {
        refined_and_back(bytes, setup, k, direction(random), &mut found)?;
    }
    Ok(found)
}

/// The press of this number, along `up`.
fn refined_and_back(
    bytes: &[u8],
    setup: Setup,
    k: u64,
    up: DVec3,
    found: &mut Found,
) -> Result<(), Failure> {
    let coarse_m = coarse(k);
    let (mut bench, height) = over(bytes, setup, up, coarse_m)?;
    bench.mute(k % 2 == 1);
    let down = press(&mut bench, up, height);
    bench.mute(false);
    let mut before = bench.touch(up * down).force;
    let mut splits = 0;
    for tolerance_m in [0.0, coarse_m, 0.0] {
        bench.ask(tolerance_m);
        for _ in 0..LOOK_TICKS {
            let response = bench.touch(up * down);
            let allowed = STEP_N.max(STEP_SHARE * before.length());
            // A proxy that is free is at the device, but for rounding.
            let is_above = response.proxy.dot(up) >= down * (1.0 - ROUNDING);
            let is_outside = is_above && response.force.dot(up) >= 0.0;
            let change = response.force.distance(before) / allowed;
            found.most(if is_outside { change } else { f64::INFINITY });
            splits += response.record.vsplits;
            before = response.force;
        }
    }
    // Where nothing changes nothing is shown.
    if splits == 0 {
        found.most(f64::INFINITY);
    }
    Ok(())
}

/// The energy of a cycle: the probe presses into the coarse front, the surface rises under it by s,
/// the probe leaves the fine front, which goes coarse again. Without an account that is K p s + K
/// s²/2, with one nothing.
pub fn cycle_energy(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let (bytes, mut setup) = ball(fault)?;
    setup.passivity = true;
    let mut found = Found::new(f64::NEG_INFINITY);
    for k in 0..size.of(4, 400) {
        let (up, coarse_m) = (direction(random), coarse(k));
        let (mut bench, mut height) = over(&bytes, setup, up, coarse_m)?;
        let start = bench.touch(up * height).record.energy_j;
        let down = press(&mut bench, up, height);
        let depth = bench.settle(up * down)?.proxy.dot(up) - down;
        bench.ask(0.0);
        let rise = bench.settle(up * down)?.proxy.dot(up) - down - depth;
        height = down;
        while height < setup.size_m {
            height += STEP_M;
            bench.touch(up * height);
        }
        bench.ask(coarse_m);
        let end = bench.settle(up * height)?.record.energy_j;
        let of_f8 = setup.stiffness_n_per_m * (depth * rise + 0.5 * rise * rise);
        // Where the surface has sunk, energy is lost in any case.
        if rise > 0.0 {
            found.most((end - start) / of_f8);
        }
    }
    Ok(found)
}

/// Case 13: a model whose splits fold the surface over on the way, though its full mesh is whole,
/// is refined under a pressing probe until the contact is at full resolution. Splits that would
/// turn a face over are refused while any other may come first, and counted; what is left passes as
/// a geomorph, and is not felt either. The largest change of force in a tick over what is not felt;
/// infinite where a face at the contact is turned over before any fold had to pass, or at the end,
/// or the contact stays coarse.
pub fn fold_over(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let (bytes, setup) = folded_ball(fault)?;
    let mut found = Found::new(0.0);
    let mut refused = 0;
    for _ in 0..size.of(4, 400) {
        refused += refined_over_folds(&bytes, setup, direction(random), &mut found)?;
    }
    // Where nothing would fold, nothing is shown.
    if refused == 0 {
        found.most(f64::INFINITY);
    }
    Ok(found)
}

/// The ball with folds, see [`fold`].
fn folded_ball(fault: Fault) -> Result<(Vec<u8>, Setup), Failure> {
    let setup = Setup {
        geomorph: true,
        fault,
        ..Setup::default()
    };
    let mut parts = parts(generate(Shape::Sphere, FACES, 1), false)?;
    fold(&mut parts);
    Ok((spm(&parts)?, setup))
}

/// A press along `up`, until its contact is at full resolution. Returns the splits that were
/// refused.
fn refined_over_folds(
    bytes: &[u8],
    setup: Setup,
    up: DVec3,
    found: &mut Found,
) -> Result<u32, Failure> {
    let (mut bench, height) = over(bytes, setup, up, setup.size_m)?;
    let down = press(&mut bench, up, height);
    let mut before = bench.touch(up * down).force;
    bench.ask(0.0);
    let (mut refused, mut passed) = (0, 0);
    for _ in 0..MAX_FOLD_TICKS {
        let response = bench.touch(up * down);
        let allowed = STEP_N.max(STEP_SHARE * before.length());
        found.most(response.force.distance(before) / allowed);
        before = response.force;
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
mod tests {
    use super::*;
    use rand::SeedableRng;

    /// The direction of a press in the run of a seed.
    fn direction_of(seed: u64, press: u64) -> DVec3 {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut up = direction(&mut random);
        for _ in 0..press {
            up = direction(&mut random);
        }
        up
    }

    fn is_not_felt(presses: &[(u64, u64)]) {
        let (bytes, setup) = ball(Fault::None).unwrap();
        is_not_felt_in(&bytes, setup, presses);
    }

    fn is_not_felt_by_a_tool(presses: &[(u64, u64)]) {
        let (bytes, setup) = ball(Fault::None).unwrap();
        is_not_felt_in(&bytes, with_tool(setup), presses);
    }

    fn is_not_felt_in(bytes: &[u8], setup: Setup, presses: &[(u64, u64)]) {
        for &(seed, k) in presses {
            let mut found = Found::new(0.0);
            refined_and_back(bytes, setup, k, direction_of(seed, k), &mut found).unwrap();
            assert!(
                found.value <= 1.0,
                "seed {seed}, press {k}: {}",
                found.value
            );
        }
    }

    fn folds_nothing(presses: &[(u64, u64)]) {
        let (bytes, setup) = folded_ball(Fault::None).unwrap();
        for &(seed, k) in presses {
            let mut found = Found::new(0.0);
            let up = direction_of(seed, k);
            refined_over_folds(&bytes, setup, up, &mut found).unwrap();
            assert!(
                found.value <= 1.0,
                "seed {seed}, press {k}: {}",
                found.value
            );
        }
    }

    /// Below and out of reach before, above and out of reach after: it was said not to be felt.
    #[test]
    fn a_face_that_passes_over_a_free_probe_is_felt() {
        is_not_felt(&[(1, 11), (1, 303), (2, 83), (3, 219), (5, 155)]);
    }

    /// Neither step came within reach alone.
    #[test]
    fn both_vertices_of_a_pair_together_make_no_force_discontinuity() {
        is_not_felt(&[(3, 344), (4, 296), (5, 396)]);
    }

    /// It met the tool from where it rested, and put it out by as much as anything near had
    /// changed.
    #[test]
    fn what_has_met_a_tool_puts_it_out_by_no_more_than_that() {
        is_not_felt_by_a_tool(&[(1, 109)]);
    }

    /// What was gathered was not known any more in the next tick, so that the tool never came to a
    /// step.
    #[test]
    fn a_tool_goes_on_while_the_surface_changes_in_every_tick() {
        is_not_felt_by_a_tool(&[(1, 279)]);
    }

    /// Where it could go by the contacts known so far was taken for where it will be held.
    #[test]
    fn a_tool_that_is_stopped_early_keeps_its_force() {
        is_not_felt_by_a_tool(&[(2, 31), (2, 343)]);
    }

    #[test]
    fn a_slow_rise_is_no_force_discontinuity() {
        is_not_felt(&[(4, 175)]);
    }

    /// It was made out of reach, where nobody minds, and a vertex in flight brought it to the
    /// probe.
    #[test]
    fn no_flight_brings_a_face_that_is_turned_over() {
        folds_nothing(&[(1, 30), (1, 236), (2, 136), (2, 148), (2, 149)]);
    }

    #[test]
    fn nothing_is_turned_over_beside_a_free_probe() {
        folds_nothing(&[(3, 325)]);
    }

    /// By splits beside a flight, of which none turned it over by itself.
    #[test]
    fn nothing_is_turned_over_by_and_by_while_a_corner_flies() {
        folds_nothing(&[(2, 63), (2, 66), (2, 88), (2, 192), (5, 139)]);
    }
}
