//! Closest points along a path over the surface: what a tick asks first. Every contender goes
//! through the same points, each once.

use super::full_front::FullFront;
use super::peers::{Peers, take_turn};
use super::questions::{FullMesh, Questions};
use super::row::{Row, Who};
use super::timing::{Caches, Timed, Turns};
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
use std::ops::Range;

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

/// A row for each contender and regime; who is asked by another program answers there.
///
/// # Errors
/// When a region cannot be loaded, or the program fails.
pub fn rows(
    model: &Model,
    asked: &Questions,
    front: &FullFront,
    [f32, f64]: [&dyn Mesh; 2],
    mut peers: Option<&mut Peers<'_>>,
) -> Result<Vec<Row>, Failure> {
    let diagonal = model.file.model_header().diagonal;
    let tips = &asked.tips;
    let mut rows = Vec::new();
    for regime in REGIMES {
        let turns = Turns {
            caches: regime.caches,
            count: tips.len(),
            length: STRETCH,
        };
        let mut local = LocalFront::new(model)?;
        let mut near = |turn: Range<usize>| -> Result<Timed, Failure> {
            refine(&mut local, &tips[turn.clone()], REFINED * diagonal)?;
            let surface = hrtc_core::contact::query::Surface {
                mesh: local.cache().mesh(),
                tree: local.cache().tree(),
            };
            let mut asker = Asker::new(regime);
            Ok(turns.one(turn, &mut |k| asker.ask(surface, tips[k])))
        };
        let mut full = Asker::new(regime);
        let parry = |mesh: &dyn Mesh, last: &mut Option<u32>, k: usize| {
            if regime.has_memory {
                mesh.distance_with_memory(tips[k], last)
            } else {
                mesh.distance(tips[k])
            }
        };
        let (mut of_single, mut of_double) = (None, None);
        let timed = turns.take(
            &mut near,
            &mut [
                &mut |k| full.ask(front.surface(), tips[k]),
                &mut |k| parry(f32, &mut of_single, k),
                &mut |k| parry(f64, &mut of_double, k),
            ],
            &mut |turn| take_turn(&mut peers, regime.task, turn, STRETCH),
        )?;
        let who = [Who::OursLocal, Who::OursFull, Who::ParryF32, Who::ParryF64];
        rows.extend(who.into_iter().zip(timed).map(|(who, timed)| {
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

/// Forms the front as the controller does: refined around some tips, coarse elsewhere.
fn refine(front: &mut LocalFront<'_>, tips: &[DVec3], reach: f64) -> Result<(), Failure> {
    let cells: BTreeSet<_> = tips
        .iter()
        .flat_map(|&tip| front.cells_near(tip, 0.0, reach))
        .collect();
    let cells: Vec<_> = cells.into_iter().collect();
    front.want(&cells)?;
    front.settle()
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
