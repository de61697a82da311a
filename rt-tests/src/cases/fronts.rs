//! Fronts that move, and files in any unit: the nearest face is the nearest, and nothing depends on
//! the unit.

use super::bench::{Bench, Fault, Setup, model};
use super::found::{Found, Trial};
use super::shapes;
use crate::failure::Failure;
use crate::models::Model;
use crate::models::front_walk::WalkWithTree;
use crate::models::surface::unit;
use geometry::closest_point_on_triangle;
use glam::DVec3;
use hrtc_core::contact::query::{Surface, closest_point};
use rand::RngCore;
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress};

/// Case 14: points whose nearest face by the tree is not the nearest of all active faces, after
/// each of many splits and collapses.
pub fn refit(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mesh = generate(Shape::Relief, 4000, 1);
    let model = Model::build(
        "relief".to_string(),
        mesh,
        &BuildOptions::default(),
        &NoProgress,
    )
    .map_err(|error| Failure::Run(format!("a case's mesh: {error}")))?;
    let mut walked = WalkWithTree::new(&model);
    walked.refit();
    let mut found = Found::new(0.0);
    let operations = size.of(600, 10_000);
    let diagonal = model.file.model_header().diagonal;
    for k in 0..operations {
        // Up, to and fro, down.
        let splits_of_ten = [9, 8, 5, 2][(k * 4 / operations) as usize];
        let up = random.next_u32() % 10 < splits_of_ten;
        walked.step(up, &mut || random.next_u32());
        // The fault: boxes stay as they were.
        if fault != Fault::LostConstraint {
            walked.refit();
        }
        let WalkWithTree { walk, tree } = &walked;
        let mut faces = Vec::new();
        walk.mesh.for_each_active_face(|face| faces.push(face));
        let face = faces[random.next_u32() as usize % faces.len()];
        let [a, _, _] = walk.mesh.corners(face);
        let aside = DVec3::new(unit(random), unit(random), unit(random)) - 0.5;
        let point = a + aside * (0.1 * diagonal);
        let nearest = faces
            .iter()
            .map(|&face| closest_point_on_triangle(walk.mesh.corners(face), point).distance_squared)
            .fold(f64::INFINITY, f64::min);
        let surface = Surface {
            mesh: &walk.mesh,
            tree,
        };
        let (by_tree, _) = closest_point(surface, point, None);
        found.count(by_tree.is_none_or(|by_tree| by_tree.closest.distance_squared != nearest));
    }
    Ok(found)
}

/// The unit sweep of collision: difference of forces and places, relative, the largest, where the
/// same object comes in a file of another unit, 1e-6 to 1e6 times as long.
pub fn units(
    Trial {
        size,
        random,
        fault,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let directions: Vec<DVec3> = (0..size.of(1500, 20_000))
        .map(|_| DVec3::new(unit(random), unit(random), unit(random)) - 0.5)
        .collect();
    let run = |exponent: i32| -> Result<Vec<(DVec3, DVec3)>, Failure> {
        // Powers of two: single precision holds the very same mesh.
        let factor = 2f64.powi(exponent);
        let mut mesh = shapes::roof(0.7, false);
        for place in mesh.positions.iter_mut().flatten() {
            *place *= factor;
        }
        let setup = Setup {
            fault: if exponent == 0 { Fault::None } else { fault },
            ..Setup::default()
        };
        let mut bench = Bench::new(&model(mesh, true)?, setup)?;
        bench.settle(DVec3::Z * 0.01)?;
        let mut place = DVec3::Z * 2e-3;
        let response = directions.iter().map(|&direction| {
            // Drawn back to the middle, a little below the surface.
            place += direction * 1e-3 - (place + DVec3::Z * 3e-4) * 0.1;
            let response = bench.touch(place);
            (response.force, response.proxy)
        });
        Ok(response.collect())
    };
    let plain = run(0)?;
    let most = plain.iter().fold([0.0f64; 2], |[force, place], (f, p)| {
        [force.max(f.length()), place.max(p.length())]
    });
    let mut found = Found::new(0.0);
    for exponent in [-20, -13, -7, 7, 13, 20] {
        for ((f, p), (g, q)) in plain.iter().zip(&run(exponent)?) {
            found.most((f.distance(*g) / most[0]).max(p.distance(*q) / most[1]));
        }
    }
    Ok(found)
}
