//! Fronts that move, and files in any unit: the nearest face is the nearest, and nothing depends on
//! the unit.

use super::bench::{Bench, model};
use super::case::{Case, Found, Trial};
use super::setup::Departure;
use super::shapes;
use crate::failure::Failure;
use crate::models::surface::unit;
use ab_tree::Child;
use geometry::{Aabb, closest_point_on_triangle};
use glam::DVec3;
use hrtc_core::contact::query::{Surface, closest_point};
use mutants::Mutant;
use rand::RngCore;
use spm_builder::generate::{Shape, generate};

/// The cases of this file.
pub const CASES: &[Case] = &[
    Case {
        facts: "after each of 1e4 random splits and collapses: the same nearest hit, boxes enclose",
        runs: "10 000 splits and collapses of a relief by the product's own cache; every corner of every face",
        departs: &[
            (Departure::OneOperation, "a look after each"),
            (Departure::Geomorph, "a change at once"),
        ],
        ..Case::of(
            [
                "refit",
                "14",
                "nearest faces that are not, and faces out of their boxes",
            ],
            0.0,
            Mutant::Box,
            refit,
        )
    },
    Case {
        facts: "s = 1e-4 to 1e4 by the file; equal to 1e-4 in f32",
        runs: "2^-20 to 2^20: single precision holds the very same mesh",
        ..Case::of(
            [
                "units",
                "9",
                "difference in files of units of 1e-6 to 1e6, relative",
            ],
            1e-9,
            Mutant::ShortMotion,
            units,
        )
    },
    Case {
        facts: "s = 1e-4 to 1e4 by the file; equal to 1e-4 in f32",
        runs: "1e-4 to 1e4",
        ..Case::of(
            ["units-decimal", "9", "the same by factors of ten"],
            1e-4,
            Mutant::ShortMotion,
            decimal_units,
        )
    },
];

/// Case 14: places whose nearest face by the tree is not the nearest of all active faces, after
/// every tick in which the product has split or collapsed, while what is asked for changes.
fn refit(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut bench = Bench::new(&model(generate(Shape::Relief, 4000, 1), false)?, defaults)?;
    bench.settle(DVec3::Z * defaults.size_m)?;
    let mut found = Found::new(0.0);
    let operations = size.of(600, 10_000);
    let mut done = 0;
    let mut tick = 0u64;
    let asks = defaults.ticks(40);
    while done < operations && tick < asks * operations {
        let turn = 0.01 * defaults.ms(tick);
        let out = DVec3::new(turn.cos(), turn.sin(), (0.7 * turn).cos()).normalize();
        if tick.is_multiple_of(asks) {
            bench.ask([0.0, 1e-3, 1e-4, 5e-3][(random.next_u32() % 4) as usize]);
        }
        tick += 1;
        let record = bench.touch(out * (0.6 * defaults.size_m)).record;
        let changes = u64::from(record.vsplits + record.ecols);
        if changes == 0 {
            continue;
        }
        done += changes;
        look(&bench, random, &mut found);
    }
    found.must(done >= operations);
    Ok(found)
}

/// One place near the surface by the tree and by all faces; and every face in its boxes.
fn look(bench: &Bench, random: &mut impl rand::Rng, found: &mut Found) {
    let surface = bench.surface();
    let mut faces = Vec::new();
    surface.mesh.for_each_active_face(|face| faces.push(face));
    let face = faces[random.next_u32() as usize % faces.len()];
    let [a, _, _] = surface.mesh.corners(face);
    let aside = DVec3::new(unit(random), unit(random), unit(random)) - 0.5;
    let point = a + aside * (0.1 * a.length());
    let nearest = faces
        .iter()
        .map(|&face| closest_point_on_triangle(surface.mesh.corners(face), point).distance_squared)
        .fold(f64::INFINITY, f64::min);
    let (by_tree, _) = closest_point(surface, point, None);
    found.right(by_tree.is_some_and(|by_tree| by_tree.closest.distance_squared == nearest));
    // A place on a face is found where its boxes enclose it.
    let middle = surface.mesh.corners(face).iter().sum::<DVec3>() / 3.0;
    let (on_face, _) = closest_point(surface, middle, None);
    let rounding = 1e-12 * middle.length_squared();
    found.right(on_face.is_some_and(|of| of.closest.distance_squared <= rounding));
    let (reached, out) = faces_in_boxes(surface);
    found.right(reached == faces.len() && out == 0);
}

/// The faces that the tree leads to; and how many of them have a corner out of their box, with the
/// boxes that are not within the one above them.
fn faces_in_boxes(surface: Surface<'_>) -> (usize, usize) {
    let Surface { mesh, tree } = surface;
    let encloses = |of: &Aabb, points: &[DVec3]| {
        let [lower, upper] = [of.lower, of.upper].map(|corner| corner.as_dvec3());
        let is_within = |point: &DVec3| lower.cmple(*point).all() && point.cmple(upper).all();
        points.iter().all(is_within)
    };
    let root = tree.root().map(|root| (root, *tree.root_box()));
    let mut todo: Vec<(Child, Aabb)> = root.into_iter().collect();
    let (mut reached, mut out) = (0, 0);
    while let Some((child, of)) = todo.pop() {
        match child {
            Child::Face(face) => {
                reached += 1;
                out += usize::from(!encloses(&of, &mesh.corners(face)));
            }
            Child::Node(id) => {
                let node = tree.node(id);
                for (side, below) in node.children().into_iter().enumerate() {
                    let inner = node.boxes().get(side);
                    let ends = [inner.lower, inner.upper].map(|corner| corner.as_dvec3());
                    out += usize::from(!encloses(&of, &ends));
                    todo.push((below, inner));
                }
            }
        }
    }
    (reached, out)
}

/// The unit sweep of collision: difference of forces and places, relative, the largest, where the
/// same object comes in a file of another unit, 1e-6 to 1e6 times as long.
fn units(trial: Trial<'_>) -> Result<Found, Failure> {
    let factors = [-20, -13, -7, 7, 13, 20].map(|exponent| 2f64.powi(exponent));
    in_units(trial, &factors)
}

/// The same by factors of ten: single precision rounds the file anew.
fn decimal_units(trial: Trial<'_>) -> Result<Found, Failure> {
    let factors = [-4, -2, -1, 1, 3, 4].map(|exponent| 10f64.powi(exponent));
    in_units(trial, &factors)
}

fn in_units(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
    factors: &[f64],
) -> Result<Found, Failure> {
    let directions: Vec<DVec3> = (0..size.of(1500, 20_000))
        .map(|_| DVec3::new(unit(random), unit(random), unit(random)) - 0.5)
        .collect();
    let run = |factor: f64| -> Result<Vec<(DVec3, DVec3)>, Failure> {
        let mut mesh = shapes::roof(0.7);
        for place in mesh.positions.iter_mut().flatten() {
            *place *= factor;
        }
        let mut bench = Bench::new(&model(mesh, true)?, defaults)?;
        bench.settle(DVec3::Z * 0.01)?;
        let mut place = DVec3::Z * 2e-3;
        bench.travel(place);
        let response = directions.iter().map(|&direction| {
            // Drawn back to the middle, a little below the surface.
            let step = direction * 1e-3 - (place + DVec3::Z * 3e-4) * 0.1;
            place += step * defaults.jump();
            let response = bench.touch(place);
            (response.force, response.proxy)
        });
        Ok(response.collect())
    };
    let plain = run(1.0)?;
    let most = plain.iter().fold([0.0f64; 2], |[force, place], (f, p)| {
        [force.max(f.length()), place.max(p.length())]
    });
    let mut found = Found::new(0.0);
    for &factor in factors {
        for ((f, p), (g, q)) in plain.iter().zip(&run(factor)?) {
            found.most(f.distance(*g) / most[0]);
            found.most(p.distance(*q) / most[1]);
        }
    }
    Ok(found)
}
