//! A capsule that is moved onto the surface: how far it gets.

use super::closest::touches;
use super::full_front::FullFront;
use super::timing::{Timed, time};
use super::tools::{STRETCH, Touch, refine, refined_reach};
use super::{Row, Who};
use crate::failure::Failure;
use crate::fronts::local_front::LocalFront;
use crate::models::{Model, active_triangles};
use crate::peers::parry::Mesh;
use crate::surface::Surface as Full;
use geometry::closest_points_of_segment_and_triangle;
use glam::{DQuat, DVec3};
use hrtc_core::contact::query::{Capsule, Surface, swept_capsule};
use rand::Rng;

/// The task.
pub const TASK: &str = "swept_capsule";
/// Radius and length of the capsule, how high it starts and how deep it would end, in parts of the diagonal.
const RADIUS: f64 = 0.015;
const LENGTH: f64 = 0.07;
const HEIGHT: f64 = 0.01;
const DEPTH: f64 = 0.005;
/// How far apart the places of two touches may be that count as the same, parts of the diagonal. Ours and what is expected
/// are within rounding but where a face is grazed; GJK in single precision is not.
const TOLERANCE: f64 = 1e-6;

/// A capsule and its way.
#[derive(Debug, Clone, Copy)]
struct Sweep {
    capsule: Capsule,
    motion: DVec3,
}

impl Sweep {
    /// Of a capsule that leans by up to a radian, down along the normal and to the side.
    fn new(touch: &Touch, diagonal: f64, lean: f64) -> Self {
        let out = touch.pose.orientation * DVec3::Z;
        let aside = touch.pose.orientation * DVec3::X;
        let along = DQuat::from_axis_angle(touch.pose.orientation * DVec3::Y, lean) * out;
        let tip = touch.point + out * ((HEIGHT + RADIUS) * diagonal);
        Self {
            capsule: Capsule {
                axis: [tip, tip + along * (LENGTH * diagonal)],
                radius: RADIUS * diagonal,
            },
            motion: (aside * HEIGHT - out * (HEIGHT + DEPTH)) * diagonal,
        }
    }

    /// The way until the first of some faces is touched, by halving the time until each is as near as the radius.
    fn by_search(&self, faces: &[[DVec3; 3]]) -> f64 {
        let Capsule { axis, radius } = self.capsule;
        let ends = axis.map(|end| end + self.motion);
        let all = [axis[0], axis[1], ends[0], ends[1]];
        let low = all.iter().fold(DVec3::INFINITY, |low, p| low.min(*p)) - radius;
        let high = all.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p)) + radius;
        let mut first: f64 = 1.0;
        for &[a, b, c] in faces {
            let (lower, upper) = (a.min(b).min(c), a.max(b).max(c));
            if lower.cmpgt(high).any() || upper.cmplt(low).any() {
                continue;
            }
            let distance = |t: f64| {
                let moved = axis.map(|end| end + self.motion * t);
                closest_points_of_segment_and_triangle(moved, [a, b, c])
                    .distance_squared
                    .sqrt()
            };
            if let Some(t) = first_root(&distance, radius, first) {
                first = t;
            }
        }
        first * self.motion.length()
    }

    fn ours(&self, surface: Surface<'_>) -> f64 {
        let answer = swept_capsule(surface, self.capsule, self.motion, u32::MAX);
        answer.free * self.motion.length()
    }

    fn theirs(&self, mesh: &dyn Mesh) -> f64 {
        let Capsule { axis, radius } = self.capsule;
        mesh.sweep_capsule(axis, radius, self.motion) * self.motion.length()
    }
}

/// First time before `limit` at which a convex distance is no more than the radius, if it comes down to it.
fn first_root(distance: &impl Fn(f64) -> f64, radius: f64, limit: f64) -> Option<f64> {
    // Between thirds until it is found near, then between halves.
    let mut touched = None;
    let (mut low, mut high) = (0.0, limit);
    for _ in 0..60 {
        if distance(high) <= radius {
            touched = Some(high);
            break;
        }
        let (one, other) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        let (at_one, at_other) = (distance(one), distance(other));
        if let Some((t, _)) = [(one, at_one), (other, at_other)]
            .into_iter()
            .find(|(_, at)| *at <= radius)
        {
            touched = Some(t);
            break;
        }
        if at_one <= at_other {
            high = other;
        } else {
            low = one;
        }
    }
    let (mut free, mut touched) = (0.0, touched?);
    let at_start = distance(0.0);
    if at_start <= radius {
        // It may leave what it is in, but not what its axis meets.
        return (at_start == 0.0 || distance(1e-9) < at_start).then_some(0.0);
    }
    for _ in 0..60 {
        let middle = 0.5 * (free + touched);
        if distance(middle) > radius {
            free = middle;
        } else {
            touched = middle;
        }
    }
    Some(touched)
}

/// A row for each contender, at every so many points of the path.
///
/// # Errors
/// When a region cannot be loaded.
pub fn rows(
    model: &Model,
    full: &Full,
    front: &FullFront,
    [single, double]: [&dyn Mesh; 2],
    every: usize,
    random: &mut impl Rng,
) -> Result<Vec<Row>, Failure> {
    let diagonal = model.file.model_header().diagonal;
    let touching: Vec<Touch> = touches(model, full, random)
        .into_iter()
        .step_by(every)
        .filter_map(|at| Touch::new(at, LENGTH * diagonal, 0.0))
        .collect();
    let sweeps: Vec<Sweep> = touching
        .iter()
        .enumerate()
        .map(|(k, touch)| Sweep::new(touch, diagonal, (k % 21) as f64 / 20.0))
        .collect();
    let mut ours = |k: usize| sweeps[k].ours(front.surface());
    let mut of_single = |k: usize| sweeps[k].theirs(single);
    let mut of_double = |k: usize| sweeps[k].theirs(double);
    let mut timed = time(
        sweeps.len(),
        &mut [&mut ours, &mut of_single, &mut of_double],
    );
    let faces = model.full_triangles();
    let expected: Vec<f64> = sweeps.iter().map(|s| s.by_search(&faces)).collect();
    let (near, near_expected) = local(model, &touching, &sweeps)?;
    timed.insert(0, near);
    let who = [Who::OursLocal, Who::OursFull, Who::ParryF32, Who::ParryF64];
    let expected = [&near_expected, &expected, &expected, &expected];
    Ok(who
        .into_iter()
        .zip(timed)
        .zip(expected)
        .map(|((who, timed), expected)| {
            let differ = timed.differ(expected, TOLERANCE * diagonal);
            Row::new(TASK, model, who, timed.ns, differ)
        })
        .collect())
}

/// On the front as the controller forms it; what is expected is found on that front as well.
fn local(
    model: &Model,
    touching: &[Touch],
    sweeps: &[Sweep],
) -> Result<(Timed, Vec<f64>), Failure> {
    let mut front = LocalFront::new(model)?;
    let reach = refined_reach(model);
    let (mut all, mut expected) = (Timed::default(), Vec::new());
    for (touching, sweeps) in touching.chunks(STRETCH).zip(sweeps.chunks(STRETCH)) {
        refine(touching, reach, &mut front)?;
        let surface = Surface {
            mesh: front.cache().mesh(),
            tree: front.cache().tree(),
        };
        let (_, faces) = active_triangles(surface.mesh);
        expected.extend(sweeps.iter().map(|sweep| sweep.by_search(&faces)));
        let timed = time(sweeps.len(), &mut [&mut |k| sweeps[k].ours(surface)]);
        timed.into_iter().for_each(|timed| all.extend(timed));
    }
    Ok((all, expected))
}
