//! Ridges, valleys, tips and corners: where several constraints hold at once, or change.

use super::bench::{Bench, Fault, Setup, model};
use super::found::{Found, Trial};
use super::shapes;
use crate::failure::Failure;
use crate::models::surface::unit;
use glam::DVec3;
use hrtc_core::contact::sphere_proxy::projection::{Plane, project};
use rand_xoshiro::Xoshiro256PlusPlus;

/// How far a reference point may be outside a half-space, in shares of the numbers' size.
const FEASIBLE: f64 = 1e-11;

fn within(random: &mut Xoshiro256PlusPlus) -> DVec3 {
    DVec3::new(unit(random), unit(random), unit(random)) * 2.0 - 1.0
}

/// Slides along a way from -`reach` to `reach`, metres, at a speed, m/s, and lifts off: the change
/// of the force in a tick over the force times what is `allowed`; infinite where there is no force.
fn slide(
    bench: &mut Bench,
    direction: impl Fn(f64) -> DVec3,
    [reach, speed]: [f64; 2],
    allowed: f64,
    found: &mut Found,
) {
    let mut last = bench.touch(direction(-reach)).force;
    let ticks = (2.0 * reach / (speed * bench.period_s())).ceil() as u32;
    for tick in 1..=ticks {
        let at = reach * (2.0 * f64::from(tick) / f64::from(ticks) - 1.0);
        let force = bench.touch(direction(at)).force;
        let larger = last.length().max(force.length());
        found.most(if larger > 0.0 {
            force.distance(last) / (larger * allowed)
        } else {
            f64::INFINITY
        });
        last = force;
    }
    bench.touch(DVec3::Z * 0.02);
}

/// Case 6: the change of the force in a tick over 2 F sin(turn / 2), the largest, where the probe
/// slides over a ridge whose normals turn by 10 to 170 degrees.
pub fn ridge(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for degrees in (10..=170).step_by(20) {
        let turn = f64::from(degrees).to_radians();
        let setup = Setup::with(fault);
        let mut bench = Bench::new(
            &model(shapes::roof(turn, fault == Fault::LostConstraint), true)?,
            setup,
        )?;
        let (sin, cos) = (0.5 * turn).sin_cos();
        bench.settle(DVec3::Z * 0.01)?;
        for _ in 0..size.of(4, 200) {
            let speed = 0.02 + 0.2 * unit(random);
            let depth = setup.radius_m * (0.1 + 0.8 * unit(random));
            // Along both slopes at a depth below where the probe would touch, over the ridge.
            let reach = 0.004;
            let place = |s: f64| {
                let slope = DVec3::new(s * cos, 0.0, -s.abs() * sin);
                let normal = DVec3::new(s.signum() * sin, 0.0, cos);
                slope + normal * (setup.radius_m - depth)
            };
            bench.touch(place(-reach) + DVec3::new(-sin, 0.0, cos) * 0.01);
            let allowed = 2.0 * (0.5 * turn).sin();
            slide(&mut bench, place, [reach, speed], allowed, &mut found);
        }
    }
    Ok(found)
}

/// Case 6, shaded: the change of the force in a tick over the force, the largest, where the probe
/// slides over a ridge whose normals turn by 10 to 50 degrees, and the force is shaded over 5 mm.
pub fn shaded_ridge(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for degrees in (10..=50).step_by(10) {
        let (sin, cos) = (0.5 * f64::from(degrees).to_radians()).sin_cos();
        let mesh = shapes::roof(
            f64::from(degrees).to_radians(),
            fault == Fault::LostConstraint,
        );
        let setup = Setup {
            effects: "{ shading = { radius_m = 0.005, max_turn_deg = 60 } }",
            ..Setup::with(fault)
        };
        let mut bench = Bench::new(&model(mesh, true)?, setup)?;
        bench.settle(DVec3::Z * 0.01)?;
        for _ in 0..size.of(4, 200) {
            let speed = 0.02 + 0.08 * unit(random);
            let depth = setup.radius_m * (0.2 + 0.6 * unit(random));
            let reach = 0.01;
            // At an even depth below where the probe would touch: along a slope, round the edge,
            // along the other slope.
            let off = setup.radius_m - depth;
            let round = 0.5 * f64::from(degrees).to_radians() * off;
            let place = |direction: f64| {
                let along = (direction.abs() - round).max(0.0) * direction.signum();
                let turn = direction.clamp(-round, round) / off;
                DVec3::new(along * cos, 0.0, -along.abs() * sin)
                    + DVec3::new(turn.sin(), 0.0, turn.cos()) * off
            };
            bench.touch(place(-reach) + DVec3::Z * 0.01);
            slide(&mut bench, place, [reach, speed], 1.0, &mut found);
        }
    }
    Ok(found)
}

/// Case 7: how far the proxy is outside one of two planes of a valley, or moves farther than the
/// device, over the numbers' size, the largest; angles of 1e-8 to 1 rad.
pub fn valley(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for exponent in -8..=0 {
        let turn = 10f64.powi(exponent);
        for _ in 0..size.of(200, 50_000) {
            let normal = within(random).normalize_or(DVec3::Z);
            let aside = normal.any_orthonormal_vector();
            let (sin, cos) = (0.5 * turn).sin_cos();
            let planes = [sin, -sin].map(|sin| Plane {
                normal: (normal * cos + aside * sin).normalize(),
                // The proxy stands free of both.
                offset: -0.1 * unit(random),
            });
            let goal = within(random);
            let given = if fault == Fault::LostConstraint {
                &planes[..1]
            } else {
                &planes[..]
            };
            let step = project(goal, given).point;
            let outside = planes
                .iter()
                .fold(0.0, |most, p| f64::max(most, p.offset - p.normal.dot(step)));
            let too_far = (step.length() - goal.length()).max(0.0);
            found.most(if step.is_finite() {
                outside.max(too_far)
            } else {
                f64::INFINITY
            });
        }
    }
    Ok(found)
}

/// Case 8: distance of the step from the exact projection, over the numbers' size, the largest,
/// among 3 to 64 planes around a tip or pit.
pub fn tip(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for count in [3, 4, 5, 8, 16, 32, 64] {
        for _ in 0..size.of(20, 1000) {
            let steep = 0.1 + 2.0 * unit(random);
            let planes: Vec<Plane> = (0..count)
                .map(|k| {
                    let turn = std::f64::consts::TAU * (f64::from(k) + 0.3 * unit(random))
                        / f64::from(count);
                    Plane {
                        normal: DVec3::new(turn.cos(), turn.sin(), steep).normalize(),
                        offset: -0.05 * unit(random),
                    }
                })
                .collect();
            let goal = within(random) - DVec3::Z;
            let lost = usize::from(fault == Fault::LostConstraint);
            let step = project(goal, &planes[lost..]).point;
            found.most(step.distance(exact(goal, &planes)));
        }
    }
    Ok(found)
}

/// The closest point to the goal in an intersection of half-spaces: the best feasible one among the
/// closest points on all single planes, pairs and triples.
fn exact(goal: DVec3, planes: &[Plane]) -> DVec3 {
    let mut best = (f64::INFINITY, goal);
    let mut consider = |point: Option<DVec3>| {
        let Some(point) = point.filter(|p| p.is_finite()) else {
            return;
        };
        let distance = point.distance(goal);
        let feasible = |p: &Plane| p.normal.dot(point) >= p.offset - FEASIBLE;
        if distance < best.0 && planes.iter().all(feasible) {
            best = (distance, point);
        }
    };
    consider(Some(goal));
    for (i, a) in planes.iter().enumerate() {
        consider(Some(goal + a.normal * (a.offset - a.normal.dot(goal))));
        for (j, b) in planes.iter().enumerate().take(i) {
            consider(on_two(goal, a, b));
            for c in &planes[..j] {
                consider(on_three(a, b, c));
            }
        }
    }
    best.1
}

fn on_two(goal: DVec3, a: &Plane, b: &Plane) -> Option<DVec3> {
    // goal + x a + y b on both planes.
    let g = a.normal.dot(b.normal);
    let (p, q) = (a.offset - a.normal.dot(goal), b.offset - b.normal.dot(goal));
    let det = a.normal.cross(b.normal).length_squared();
    (det > 0.0).then(|| goal + a.normal * ((p - g * q) / det) + b.normal * ((q - g * p) / det))
}

fn on_three(a: &Plane, b: &Plane, c: &Plane) -> Option<DVec3> {
    let (bc, ca, ab) = (
        b.normal.cross(c.normal),
        c.normal.cross(a.normal),
        a.normal.cross(b.normal),
    );
    let det = a.normal.dot(bc);
    (det != 0.0).then(|| (bc * a.offset + ca * b.offset + ab * c.offset) / det)
}

/// Ten minutes in a corner of three planes under a noisy encoder: how far the proxy strays from
/// where it belongs, in radii, the largest.
pub fn rest_in_corner(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = Setup::with(fault);
    let mesh = shapes::corner(fault == Fault::LostConstraint);
    let mut bench = Bench::new(&model(mesh, true)?, setup)?;
    let home = DVec3::splat(setup.radius_m);
    bench.settle(home + DVec3::splat(0.005))?;
    let mut found = Found::new(0.0);
    for _ in 0..size.of(20_000, 600_000) {
        let noise = within(random) * 2e-5;
        let response = bench.touch(home - DVec3::splat(2e-3) + noise);
        found.most(response.proxy.distance(home) / setup.radius_m);
    }
    Ok(found)
}
