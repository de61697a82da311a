//! Two objects that touch: a model, and a copy of it in another pose (thesis chapter 4).

use crate::clocks::Clocks;
use crate::commands::compare::full_front::FullFront;
use crate::commands::compare::tools::new_tool;
use crate::failure::Failure;
use crate::models::surface::unit;
use crate::models::{Model, active_triangles};
use crate::report::quantile::{quantile, sort};
use geometry::{Pose, Similarity};
use glam::{DQuat, DVec3};
use hrtc_core::contact::query::{FacePair, PairWork, Surface, all_pairs};
use hrtc_core::contact::tool::{Tool, ToolMesh};
use rand::Rng;
use std::f64::consts::TAU;

/// Poses of the copy.
const POSES: usize = 24;
/// Times that each query is put: the least counts.
const REPEATS: usize = 3;
/// Halvings of the interval in which the copy begins to touch: to a ten-thousandth.
const HALVINGS: u32 = 14;
/// How much nearer than that it is, as a share of the distance.
const DEPTH: f64 = 0.02;
/// Pairs that an answer may have.
const MAX_PAIRS: usize = 1 << 16;

/// The copy: the faces of a front as a mesh of their own, with a tree built anew.
///
/// # Errors
/// When the front has no faces.
pub fn copy_of(model: &Model, surface: Surface<'_>) -> Result<Tool, Failure> {
    let (_, corners) = active_triangles(surface.mesh);
    let faces = corners.len() as u32;
    let mesh = ToolMesh {
        positions: corners.into_iter().flatten().collect(),
        triangles: (0..faces).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(),
    };
    new_tool(model, &mesh)
}

/// Poses in which a copy of the full mesh lies a little in the full mesh.
///
/// # Errors
/// When the mesh has no faces.
pub fn touching(
    model: &Model,
    full: &FullFront,
    random: &mut impl Rng,
) -> Result<Vec<Similarity>, Failure> {
    let mut copy = copy_of(model, full.surface())?;
    let header = model.file.model_header();
    let centre = 0.5 * (DVec3::from_array(header.lower) + DVec3::from_array(header.upper));
    let mut poses = Vec::with_capacity(POSES);
    while poses.len() < POSES {
        let orientation = DQuat::from_axis_angle(direction(random), TAU * unit(random));
        let toward = direction(random);
        let at = |distance: f64| {
            let position = centre + toward * distance - orientation * centre;
            Similarity::new(
                Pose {
                    position,
                    orientation,
                },
                1.0,
            )
        };
        let (mut near, mut far) = (0.0, 2.0 * header.diagonal);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (near + far);
            let Some(pose) = at(middle) else { break };
            copy.place(&pose);
            let found = all_pairs(&full.surface(), &copy, u32::MAX, &mut [FacePair::NONE]);
            if found.count > 0 {
                near = middle;
            } else {
                far = middle;
            }
        }
        poses.extend(at(near * (1.0 - DEPTH)));
    }
    Ok(poses)
}

/// An even random direction.
fn direction(random: &mut impl Rng) -> DVec3 {
    let (z, turn) = (2.0 * unit(random) - 1.0, TAU * unit(random));
    let around = (1.0 - z * z).sqrt();
    DVec3::new(around * turn.cos(), around * turn.sin(), z)
}

/// What the queries of all poses took and found.
#[derive(Debug, Clone, Copy, Default)]
pub struct Queries {
    /// Median, nanoseconds.
    pub p50_ns: f64,
    /// Sum over the poses, nanoseconds.
    pub sum_ns: f64,
    /// What was tested, over all poses.
    pub work: PairWork,
    /// Pairs of faces that meet, over all poses.
    pub pairs: u64,
}

/// Puts the query at every pose to each of the surfaces in turn, the same copy against all.
#[must_use]
pub fn ask(surfaces: &[Surface<'_>], copy: &mut Tool, poses: &[Similarity]) -> Vec<Queries> {
    let clocks = Clocks::new();
    let mut out = vec![FacePair::NONE; MAX_PAIRS];
    let mut found = vec![Queries::default(); surfaces.len()];
    let mut times = vec![Vec::new(); surfaces.len()];
    for pose in poses {
        copy.place(pose);
        let mut least = vec![f64::INFINITY; surfaces.len()];
        for repeat in 0..REPEATS {
            for (k, surface) in surfaces.iter().enumerate() {
                let query = || all_pairs(surface, &*copy, u32::MAX, &mut out);
                let (ns, answer) = clocks.time(query);
                least[k] = least[k].min(ns);
                if repeat == 0 {
                    found[k].work.add(answer.work);
                    found[k].pairs += answer.count as u64;
                }
            }
        }
        for (times, ns) in times.iter_mut().zip(least) {
            times.push(ns);
        }
    }
    for (found, mut ns) in found.iter_mut().zip(times) {
        found.sum_ns = ns.iter().sum();
        sort(&mut ns);
        found.p50_ns = quantile(&ns, 0.5);
    }
    found
}
