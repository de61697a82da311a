//! Closest points along a path over the surface: what a tick asks first.

use super::full_front::FullFront;
use super::timing::{ONCE, ROUNDS, Timed, time};
use super::{Row, Who};
use crate::failure::Failure;
use crate::models::Model;
use crate::models::local_front::LocalFront;
use crate::models::path::path;
use crate::models::surface::Surface;
use crate::peers::parry::{Mesh, ParryF32, ParryF64};
use glam::DVec3;
use hrtc_core::contact::query::closest_point;
use rand::Rng;
use std::collections::BTreeSet;

/// Points of the path, and their distance in parts of the diagonal: 50 mm/s at 1 kHz on an object
/// of 100 mm.
const POINTS: u32 = 10_000;
const STEP: f64 = 5e-4;
/// The tip goes up and down between these heights over the surface, parts of the diagonal, in so
/// many points.
const HEIGHTS: [f64; 2] = [-0.002, 0.006];
const WAVE: usize = 400;
/// Points after which the local front is formed anew, and how far around them it is refined, parts
/// of the diagonal.
const STRETCH: usize = 50;
const REFINED: f64 = 0.02;
/// How far answers may lie apart, parts of the diagonal: rounding in double and in single
/// precision.
pub const TOLERANCES: [f64; 2] = [1e-12, 2e-6];

/// Points of the surface, with the normals of their faces: where the path goes.
pub fn touches(model: &Model, full: &Surface, random: &mut impl Rng) -> Vec<(DVec3, DVec3)> {
    let diagonal = model.file.model_header().diagonal;
    let normal_of = |triangle: u32| {
        let [a, b, c] = full.triangles()[triangle as usize];
        (b - a).cross(c - a).normalize_or_zero()
    };
    path(full, STEP * diagonal, POINTS, random)
        .iter()
        .map(|near| (near.point, normal_of(near.triangle)))
        .collect()
}

/// The positions of the tip.
fn tips(model: &Model, full: &Surface, random: &mut impl Rng) -> Vec<DVec3> {
    let diagonal = model.file.model_header().diagonal;
    touches(model, full, random)
        .into_iter()
        .enumerate()
        .map(|(k, (point, normal))| {
            let wave = (2.0 * (k % WAVE) as f64 / WAVE as f64 - 1.0).abs();
            let height = HEIGHTS[0] + (HEIGHTS[1] - HEIGHTS[0]) * wave;
            point + normal * (height * diagonal)
        })
        .collect()
}

/// A row for each contender.
///
/// # Errors
/// When a region cannot be loaded.
pub fn rows(
    model: &Model,
    full: &Surface,
    front: &FullFront,
    [f32, f64]: [&dyn Mesh; 2],
    random: &mut impl Rng,
) -> Result<Vec<Row>, Failure> {
    let tips = tips(model, full, random);
    let diagonal = model.file.model_header().diagonal;
    let surface = front.surface();
    let mut hint = None;
    let mut ours = |k: usize| {
        let (nearest, _) = closest_point(surface, tips[k], hint);
        hint = nearest.map(|nearest| nearest.face);
        nearest.map_or(f64::NAN, |nearest| nearest.closest.distance_squared.sqrt())
    };
    let mut single = |k: usize| f32.distance(tips[k]);
    let mut double = |k: usize| f64.distance(tips[k]);
    let mut timed = time(
        tips.len(),
        ROUNDS,
        &mut [&mut ours, &mut single, &mut double],
    );
    let expected: Vec<f64> = {
        let mut near = 0;
        let mut search = |&tip: &DVec3| {
            let found = full.nearest(tip, near);
            near = found.triangle;
            found.distance
        };
        tips.iter().map(&mut search).collect()
    };
    timed.insert(0, local(model, &tips)?);
    Ok(
        [Who::OursLocal, Who::OursFull, Who::ParryF32, Who::ParryF64]
            .into_iter()
            .zip(timed)
            .map(|(who, timed)| {
                let tolerance = TOLERANCES[usize::from(who == Who::ParryF32)] * diagonal;
                let differ = timed.differ(&expected, tolerance);
                Row::new("closest_path", model, who, timed.ns, differ)
            })
            .collect(),
    )
}

/// On the front as the controller forms it: refined around where the tip is, coarse elsewhere.
fn local(model: &Model, tips: &[DVec3]) -> Result<Timed, Failure> {
    let diagonal = model.file.model_header().diagonal;
    let mut front = LocalFront::new(model)?;
    let mut all = Timed::default();
    for start in (0..tips.len()).step_by(STRETCH) {
        let stretch = &tips[start..(start + STRETCH).min(tips.len())];
        let cells: BTreeSet<_> = stretch
            .iter()
            .flat_map(|&tip| front.cells_near(tip, 0.0, REFINED * diagonal))
            .collect();
        let cells: Vec<_> = cells.into_iter().collect();
        front.want(&cells)?;
        front.settle()?;
        let surface = hrtc_core::contact::query::Surface {
            mesh: front.cache().mesh(),
            tree: front.cache().tree(),
        };
        let mut hint = None;
        let mut ask = |tip: DVec3| {
            let (nearest, _) = closest_point(surface, tip, hint);
            hint = nearest.map(|nearest| nearest.face);
            nearest.map_or(f64::NAN, |nearest| nearest.closest.distance_squared.sqrt())
        };
        // As for the others, the query before was for the point before.
        ask(tips[start.saturating_sub(1)]);
        let timed = time(stretch.len(), ONCE, &mut [&mut |k| ask(stretch[k])]);
        timed.into_iter().for_each(|timed| all.extend(timed));
    }
    Ok(all)
}

/// Parry's mesh in single precision.
///
/// # Errors
/// What parry says.
pub fn single(model: &Model) -> Result<ParryF32, Failure> {
    ParryF32::new(&model.positions, &model.full_faces).map_err(|error| refused(model, &error))
}

/// Parry's mesh in double precision.
///
/// # Errors
/// What parry says.
pub fn double(model: &Model) -> Result<ParryF64, Failure> {
    ParryF64::new(&model.positions, &model.full_faces).map_err(|error| refused(model, &error))
}

fn refused(model: &Model, error: &str) -> Failure {
    Failure::Run(format!("{}: parry: {error}", model.name))
}
