//! The certified error beside sampled distances, on random fronts, on those of tolerances and on
//! local ones.

use super::legality::ancestors;
use crate::failure::Failure;
use crate::models::local_front::LocalFront;
use crate::models::surface::{Surface, inside};
use crate::models::{Model, active_triangles};
use crate::report::quantile::sort;
use hrtc_core::record::max_or_nan;
use rand::Rng;
use spm::{ActiveMesh, OperationFaces};

/// Points of active faces, and points of the full mesh, on each front.
const SAMPLES: usize = 6_000;
/// Points on a face: enough that the largest distance found is near the largest there is.
const SAMPLES_A_FACE: usize = 6;
/// Local fronts.
const LOCAL_FRONTS: u32 = 6;
/// Shares of the VSPs that the fronts of tolerances leave out.
const SHARES: [f64; 4] = [0.3, 0.7, 0.95, 0.99];
/// What distances in f64 lose, in parts of the diagonal. A model lies at most 64 diagonals from its
/// origin.
const ROUNDING: f64 = 1e-13;
/// Sampled errors below this part of the diagonal are the rounding of positions to f32: no ratio is
/// taken.
const PLANE: f64 = 1e-7;

/// What the samples say.
#[derive(Debug, Clone, Default)]
pub struct Certified {
    /// The bound of each sampled face over the largest distance found on it, ascending.
    pub ratios: Vec<f64>,
    /// Distances measured.
    pub samples: u64,
    /// Distances beyond their bound.
    pub violations: u64,
}

/// Samples fronts of a model.
///
/// # Errors
/// When a region cannot be collected.
pub fn certified(
    model: &Model,
    full: &Surface,
    random: &mut impl Rng,
) -> Result<Certified, Failure> {
    let mut found = Certified::default();
    if model.records.is_empty() {
        return Ok(found);
    }
    // Parts of the way up, and of the way down.
    for (chance, down) in [
        (0, false),
        (80, false),
        (97, false),
        (10, true),
        (50, true),
        (90, true),
    ] {
        let mesh = random_front(model, random, chance, down);
        sample(model, full, &mesh, &mut found, random);
    }
    let mut codes: Vec<u16> = model.records.iter().map(|record| record.e).collect();
    codes.sort_unstable();
    for share in SHARES {
        let code = codes[((codes.len() - 1) as f64 * share) as usize];
        let above = model.records.iter().filter(|record| record.e > code);
        let mut mesh = model.active_mesh();
        perform(&mut mesh, &above.map(|record| record.i).collect::<Vec<_>>());
        sample(model, full, &mesh, &mut found, random);
    }
    let mut local = LocalFront::new(model)?;
    for _ in 0..LOCAL_FRONTS {
        let Some(&(_, point)) = full.spread(1, random).first() else {
            break;
        };
        let cells = local.cells_near(point, 0.0, model.file.model_header().grid.cell);
        local.want(&cells)?;
        local.settle()?;
        let mut mesh = model.active_mesh();
        perform(&mut mesh, &local.performed());
        sample(model, full, &mesh, &mut found, random);
    }
    sort(&mut found.ratios);
    Ok(found)
}

/// Each legal split in ascending order with a chance in percent; or, `down`, each legal collapse
/// from the full mesh. (A walk of single random steps hardly leaves the base mesh: few splits are
/// legal there.)
fn random_front(model: &Model, random: &mut impl Rng, chance: u32, down: bool) -> ActiveMesh {
    let mut mesh = model.active_mesh();
    let mut out = OperationFaces::new();
    let vsps = model.records.len() as u32;
    let mut front = Vec::new();
    for i in 0..vsps {
        if mesh.split_is_legal(i) && (down || random.next_u32() % 100 < chance) {
            front.push(i);
            perform(&mut mesh, &[i]);
        }
    }
    for i in (0..vsps).rev().filter(|_| down) {
        if mesh.collapse_is_legal(i) && random.next_u32() % 100 < chance {
            // Where the fans are too large for an operation it stays performed: any front will do.
            let _ = mesh.collapse(i, &mut out);
        }
    }
    mesh
}

/// # Panics
/// When the ids are no ascending front.
fn perform(mesh: &mut ActiveMesh, ids: &[u32]) {
    let mut out = OperationFaces::new();
    for &i in ids {
        let done = mesh.split(i, &mut out);
        assert!(done.is_ok(), "{done:?}");
    }
}

fn sample(
    model: &Model,
    full: &Surface,
    mesh: &ActiveMesh,
    found: &mut Certified,
    random: &mut impl Rng,
) {
    let diagonal = model.file.model_header().diagonal;
    let (handles, triangles) = active_triangles(mesh);
    let mut judge = |distance: f64, bound: f64| {
        found.samples += 1;
        // What is no number is within nothing.
        let is_within = distance <= bound * (1.0 + 1e-12) + ROUNDING * diagonal;
        found.violations += u64::from(!is_within);
    };
    // From the front to the full mesh. Faces of the full mesh (R = 0) are taken too: they must lie
    // on it.
    let every = (handles.len() * SAMPLES_A_FACE).div_ceil(SAMPLES).max(1);
    let mut hint = 0;
    for (&face, triangle) in handles.iter().zip(&triangles).step_by(every) {
        let bound = f64::from(mesh.certified_error(face));
        let mut most: f64 = 0.0;
        for k in 0..SAMPLES_A_FACE {
            let point = match k {
                0 => triangle[random.next_u32() as usize % 3],
                1 => (triangle[0] + triangle[1] + triangle[2]) / 3.0,
                _ => inside(triangle, random),
            };
            let near = full.nearest(point, hint);
            hint = near.triangle;
            most = max_or_nan(most, near.distance);
            judge(
                near.distance,
                f64::from(mesh.certified_distance(face, point)),
            );
        }
        if most > PLANE * diagonal {
            found.ratios.push(bound / most);
        }
    }
    // From the full mesh to the front: no point moves farther to its image than R of its corners'
    // ancestors.
    let front = Surface::new(triangles);
    let ancestor = ancestors(model, mesh);
    let every = (model.full_faces.len() * 2).div_ceil(SAMPLES).max(1);
    let mut hint = 0;
    for corners in model.full_faces.iter().step_by(every) {
        let radius = corners.map(|v| f64::from(mesh.radius(ancestor[v as usize])));
        let triangle = corners.map(|v| model.positions[v as usize]);
        let all = radius[0].max(radius[1]).max(radius[2]);
        let k = random.next_u32() as usize % 3;
        for (point, bound) in [(triangle[k], radius[k]), (inside(&triangle, random), all)] {
            let near = front.nearest(point, hint);
            hint = near.triangle;
            judge(near.distance, bound);
        }
    }
}
