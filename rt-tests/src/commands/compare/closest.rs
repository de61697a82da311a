//! Closest points along a path over the surface: what a tick asks first. Every contender goes
//! through the same points, each once.

use super::full_front::FullFront;
use super::questions::{FullMesh, Questions};
use super::row::{Row, Who};
use super::timing::{Caches, Timed, time_stretch, time_with};
use crate::failure::Failure;
use crate::models::Model;
use crate::models::local_front::LocalFront;
use crate::models::path::path;
use crate::models::surface::Surface;
use crate::peers::parry::{Mesh, ParryF32, ParryF64};
use glam::DVec3;
use hrtc_core::contact::query::closest_point;
use rand::Rng;
use spm::Handle;
use std::collections::BTreeSet;

/// Without any memory of the last answer.
pub const PATH: &str = "closest_path";
/// With it: ours and parry begin with the face of the last answer, Embree with its distance.
pub const MEMORY: &str = "closest_path_memory";
/// With it, and the core's own caches swept before each query.
pub const COLD: &str = "closest_path_cold";

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
pub fn tips(model: &Model, touches: &[(DVec3, DVec3)]) -> Vec<DVec3> {
    let diagonal = model.file.model_header().diagonal;
    let lifted = |(k, &(point, normal)): (usize, &(DVec3, DVec3))| {
        let wave = (2.0 * (k % WAVE) as f64 / WAVE as f64 - 1.0).abs();
        let height = HEIGHTS[0] + (HEIGHTS[1] - HEIGHTS[0]) * wave;
        point + normal * (height * diagonal)
    };
    touches.iter().enumerate().map(lifted).collect()
}

/// What a contender may know and what the caches hold.
#[derive(Debug, Clone, Copy)]
struct Regime {
    task: &'static str,
    has_memory: bool,
    caches: Caches,
}

const REGIMES: [Regime; 3] = [
    Regime {
        task: PATH,
        has_memory: false,
        caches: Caches::AsLeft,
    },
    Regime {
        task: MEMORY,
        has_memory: true,
        caches: Caches::AsLeft,
    },
    Regime {
        task: COLD,
        has_memory: true,
        caches: Caches::Swept,
    },
];

/// A row for each contender and regime.
///
/// # Errors
/// When a region cannot be loaded.
pub fn rows(
    model: &Model,
    asked: &Questions,
    front: &FullFront,
    [f32, f64]: [&dyn Mesh; 2],
) -> Result<Vec<Row>, Failure> {
    let mut rows = Vec::new();
    for regime in REGIMES {
        let tips = &asked.tips;
        let mut full = Asker::new(regime);
        let mut ours = |k: usize| full.ask(front.surface(), tips[k]);
        let parry = |mesh: &dyn Mesh, last: &mut Option<u32>, k: usize| {
            if regime.has_memory {
                mesh.distance_with_memory(tips[k], last)
            } else {
                mesh.distance(tips[k])
            }
        };
        let (mut of_single, mut of_double) = (None, None);
        let mut timed = time_with(
            regime.caches,
            tips.len(),
            &mut [
                &mut ours,
                &mut |k| parry(f32, &mut of_single, k),
                &mut |k| parry(f64, &mut of_double, k),
            ],
        );
        timed.insert(0, local(model, tips, regime)?);
        let who = [Who::OursLocal, Who::OursFull, Who::ParryF32, Who::ParryF64];
        rows.extend(who.into_iter().zip(timed).map(|(who, timed)| {
            let diagonal = model.file.model_header().diagonal;
            let tolerance = TOLERANCES[usize::from(who == Who::ParryF32)] * diagonal;
            let differ = timed.differ(&asked.expected, tolerance);
            Row::new(regime.task, model, who, timed.ns, differ)
        }));
    }
    Ok(rows)
}

/// Asks ours, with the memory that the regime allows.
struct Asker {
    has_memory: bool,
    hint: Option<Handle>,
}

impl Asker {
    fn new(regime: Regime) -> Self {
        Self {
            has_memory: regime.has_memory,
            hint: None,
        }
    }

    fn ask(&mut self, surface: hrtc_core::contact::query::Surface<'_>, tip: DVec3) -> f64 {
        let (nearest, _) = closest_point(surface, tip, self.hint);
        if self.has_memory {
            self.hint = nearest.map(|nearest| nearest.face);
        }
        nearest.map_or(f64::NAN, |nearest| nearest.closest.distance_squared.sqrt())
    }
}

/// On the front as the controller forms it: refined around where the tip is, coarse elsewhere.
fn local(model: &Model, tips: &[DVec3], regime: Regime) -> Result<Timed, Failure> {
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
        let mut asker = Asker::new(regime);
        let places = start..start + stretch.len();
        let mut ask = |k: usize| asker.ask(surface, tips[k]);
        all.extend(time_stretch(regime.caches, places, STRETCH, &mut ask));
    }
    Ok(all)
}

/// Parry's mesh in single precision.
///
/// # Errors
/// What parry says.
pub fn single(model: &Model, mesh: &FullMesh) -> Result<ParryF32, Failure> {
    ParryF32::new(&mesh.positions, &mesh.faces).map_err(|error| refused(model, &error))
}

/// Parry's mesh in double precision.
///
/// # Errors
/// What parry says.
pub fn double(model: &Model, mesh: &FullMesh) -> Result<ParryF64, Failure> {
    ParryF64::new(&mesh.positions, &mesh.faces).map_err(|error| refused(model, &error))
}

fn refused(model: &Model, error: &str) -> Failure {
    Failure::Run(format!("{}: parry: {error}", model.name))
}
