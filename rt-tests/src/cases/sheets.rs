//! Nothing is thin, sharp or broken enough to be passed.

use super::bench::{Bench, Fault, Response, Setup, model};
use super::found::{Found, Trial};
use super::shapes;
use crate::failure::Failure;
use crate::models::surface::{Surface, unit};
use geometry::Pose;
use glam::{DQuat, DVec3};
use rand_xoshiro::Xoshiro256PlusPlus;
use spm_builder::generate::{Shape, generate};

/// How deep a pass goes behind the surface, metres.
const DEPTH_M: f64 = 5e-3;

/// Straight from one place to another at a speed, with a look at every tick.
fn pass(bench: &mut Bench, from: DVec3, to: DVec3, speed: f64, mut look: impl FnMut(&Response)) {
    let ticks = (from.distance(to) / (speed * bench.period_s()))
        .ceil()
        .max(1.0) as u32;
    for tick in 1..=ticks {
        look(&bench.touch(from.lerp(to, f64::from(tick) / f64::from(ticks))));
    }
}

/// A random place on a disc around the origin, and a random way down, within 60 degrees.
fn aim(random: &mut Xoshiro256PlusPlus, radius: f64) -> (DVec3, DVec3) {
    let mut on_disc = || {
        let (turn, r) = (std::f64::consts::TAU * unit(random), unit(random).sqrt());
        DVec3::new(turn.cos(), turn.sin(), 0.0) * r
    };
    let place = on_disc() * radius;
    let slope = on_disc() * 3f64.sqrt();
    (place, (slope - DVec3::Z).normalize())
}

/// Case 4: passes through a sheet of 0, 0.1 and 1 mm from either side at 0.05 to 2 m/s: those after
/// which the proxy was beyond it at any tick.
pub fn thin_sheet(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    let speeds = [0.05, 0.5, 1.0, 2.0];
    for thickness in [0.0, 1e-4, 1e-3] {
        let setup = Setup::default();
        // The plates are 2 units long.
        let gap = thickness * 2.0 / setup.size_m;
        let mesh = shapes::sheets(gap, fault == Fault::LostConstraint);
        let bytes = model(mesh, true)?;
        for stiffness_n_per_m in [500.0, 1000.0, 3000.0] {
            for up in [DVec3::Z, DVec3::NEG_Z] {
                let setup = Setup {
                    stiffness_n_per_m,
                    fault,
                    ..setup
                };
                let mut bench = Bench::new(&bytes, setup)?;
                // What is outside on this side.
                let outer = if up.z > 0.0 { 0.0 } else { thickness };
                let home = up * (outer + 0.01);
                bench.settle(home)?;
                for k in 0..size.of(16, 1_000_000 / 18) {
                    let (place, direction) = aim(random, 0.3 * setup.size_m);
                    let direction = direction * up.z;
                    let speed = speeds[k as usize % speeds.len()];
                    let surface = place + up * outer;
                    let start = surface - direction * (4.0 * setup.radius_m);
                    let mut passed = bench.touch(start).proxy.dot(up) <= outer;
                    let end = surface + direction * DEPTH_M;
                    pass(&mut bench, start, end, speed, |response| {
                        passed |= response.proxy.dot(up) <= outer;
                    });
                    found.count(passed);
                    bench.touch(home);
                }
            }
        }
    }
    Ok(found)
}

/// Case 5: passes straight at the edges and vertices of a closed body, turned at random and 1 km
/// away: those after which the proxy was within.
pub fn edges_and_vertices(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    let mut mesh = generate(Shape::Sphere, 400, 1);
    let targets = targets(&mesh.positions, &mesh.triangles);
    let point = |v: u32| DVec3::from_array(mesh.positions[v as usize]);
    // The ball that is surely within: up to the nearest face.
    let within = mesh
        .triangles
        .iter()
        .fold(f64::INFINITY, |least, &[a, b, c]| {
            let [a, b, c] = [a, b, c].map(point);
            least.min((b - a).cross(c - a).normalize().dot(a).abs())
        });
    if fault == Fault::LostConstraint {
        let kept = mesh.triangles.len() / 2;
        mesh.triangles.truncate(kept);
    }
    let bytes = model(mesh, true)?;
    for _ in 0..size.of(4, 40) {
        let axis = aim(random, 1.0).1;
        let setup = Setup {
            pose: Pose {
                position: aim(random, 1.0).1 * 1000.0,
                orientation: DQuat::from_axis_angle(axis, 6.0 * unit(random)),
            },
            ..Setup::with(fault)
        };
        let mut bench = Bench::new(&bytes, setup)?;
        let scale = 0.5 * setup.size_m;
        let least = (within * scale + setup.radius_m) * (1.0 - 1e-5);
        bench.settle(setup.pose.transform_point(DVec3::Z * 1.5 * scale))?;
        for _ in 0..size.of(100, 25_000) {
            let target = targets[(unit(random) * targets.len() as f64) as usize];
            let [start, end] =
                [1.2, 0.9].map(|share| setup.pose.transform_point(target * scale * share));
            bench.touch(start);
            let mut passed = false;
            pass(&mut bench, start, end, 0.5, |response| {
                passed |= response.proxy.distance(setup.pose.position) < least;
            });
            found.count(passed);
            bench.touch(start);
        }
    }
    Ok(found)
}

/// Vertices, and the middles of edges.
fn targets(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Vec<DVec3> {
    let point = |v: u32| DVec3::from_array(positions[v as usize]);
    let middles = triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| (point(a) + point(b)) * 0.5);
    positions
        .iter()
        .map(|&p| DVec3::from_array(p))
        .chain(middles)
        .collect()
}

/// Case 11: passes through a plate with everything wrong that meshes have, but no hole: those after
/// which the proxy was beyond it, and outputs that are no numbers.
pub fn damaged_mesh(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    let setup = Setup::with(fault);
    let mesh = shapes::damaged_plate(fault == Fault::LostConstraint);
    let mut bench = Bench::new(&model(mesh, true)?, setup)?;
    let home = DVec3::Z * 0.02;
    bench.settle(home)?;
    for _ in 0..size.of(300, 100_000) {
        let (place, direction) = aim(random, 0.3 * setup.size_m);
        let start = place - direction * (4.0 * setup.radius_m);
        let mut wrong = false;
        bench.touch(start);
        pass(
            &mut bench,
            start,
            place + direction * DEPTH_M,
            0.5,
            |response| {
                wrong |= !response.force.is_finite()
                    || response.proxy.z.is_nan()
                    || response.proxy.z < 0.0;
            },
        );
        found.count(wrong);
        bench.touch(home);
    }
    Ok(found)
}

/// Case 16: true distance of the contact from the full mesh over its certified bound, the largest,
/// where the probe comes at 1 to 2 m/s on a front that is coarse yet.
pub fn prediction_miss(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = Setup::with(fault);
    let mesh = generate(Shape::Relief, 50_000, 1);
    let corner =
        |v: u32| DVec3::from_array(mesh.positions[v as usize].map(|x| f64::from(x as f32)));
    let full = Surface::new(mesh.triangles.iter().map(|t| t.map(corner)).collect());
    let bytes = model(mesh, false)?;
    let mut bench = Bench::new(&bytes, setup)?;
    bench.settle(DVec3::Z * setup.size_m)?;
    let mut found = Found::new(0.0);
    let mut coarse = 0;
    for _ in 0..size.of(40, 4000) {
        let direction = aim(random, 1.0).1 * if unit(random) < 0.5 { 1.0 } else { -1.0 };
        let speed = 1.0 + unit(random);
        let start = direction * setup.size_m;
        bench.touch(start);
        let ticks = (start.length() / (speed * bench.period_s())) as u32;
        for tick in 0..ticks {
            let place = start * (1.0 - f64::from(tick) / f64::from(ticks));
            let response = bench.touch(place);
            let Some(mut at) = bench.contact() else {
                continue;
            };
            if fault == Fault::LostConstraint {
                at = bench.to_model(place).unwrap_or(at);
            }
            let scale =
                bench.to_model(DVec3::X).unwrap_or(at) - bench.to_model(DVec3::ZERO).unwrap_or(at);
            let bound = response.record.certified_error_m * scale.length();
            coarse += u32::from(bound > 0.0);
            let apart = full.nearest(at, 0).distance;
            // Coordinates are rounded to f32: a bound of 0 holds up to that.
            let rounding = at.abs().max_element() * f64::from(f32::EPSILON);
            found.most((apart - rounding).max(0.0) / bound.max(rounding));
        }
    }
    // Where it was fine everywhere nothing is shown.
    if coarse == 0 {
        found.most(f64::INFINITY);
    }
    Ok(found)
}
