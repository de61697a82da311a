//! The accuracy dial: the tolerance that is asked for beside the error that the touch gets.
//!
//! A contact moves over the full mesh as over an object of 0.15 m, a tick a contact. Around it the front is formed
//! as the two processes form it: the controller's predictor names the regions of every ring of its dial,
//! they stay as long as the controller keeps them, the station collects their closures. Only the link is left
//! out: what is asked for is there in the same tick. The touch is the point of that front nearest to the path,
//! its true error its exact distance to the full mesh.

use super::cost::{OBJECT_M, longest_side};
use super::local_front::LocalFront;
use super::path::path;
use super::quantile;
use crate::failure::Failure;
use crate::models::Model;
use crate::surface::Surface;
use glam::DVec3;
use hrtc::cache::RegionKey;
use hrtc::dial::Dial as Rings;
use hrtc::predict::{Motion, Predictor, TURNS};
use hrtc::query;
use rand::Rng;
use serde::Serialize;
use shared::spm::{ErrorScale, VspRecord};
use std::collections::BTreeMap;

/// Tolerances, parts of the diagonal; below [`ALWAYS`] where the mesh has the detail.
const TOLERANCES: [f64; 6] = [1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5];
const ALWAYS: f64 = 3e-4;
/// The mesh has the detail of a tolerance when at most this part of its VSPs that are not on planes exceeds it:
/// beyond, the front is nearly the full mesh and the ratio tells of the mesh's own steps, not of the dial.
const DETAIL: f64 = 0.5;
/// Paths, stretches of a centimetre on each, contacts on each stretch. Contacts that exceed a tolerance come in rows
/// of dozens, where a face sticks out: fewer paths would make the share of them a matter of luck.
const PATHS: usize = 24;
const STRETCHES: usize = 10;
const CONTACTS: usize = 100;
const STRETCH_M: f64 = 0.01;
/// A case with fewer stretches says nothing.
const FEWEST_STRETCHES: usize = 20;
/// Radius of the probe of the bundled scene, m. Its speed, 0.1 m/s, is a contact a tick.
const RADIUS_M: f64 = 1e-3;
/// Ticks for which the controller keeps a region refined after the prediction left it.
const LINGER: u64 = 40;
/// Ticks of rest for each ring before a path: a round of every ring's turns.
const RESTING_TURNS: usize = TURNS;
/// Errors below this part of the diagonal are the rounding of positions to f32.
const PLANE: f64 = 1e-7;

/// What all tolerances together say.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Dial {
    /// Asked tolerance over the largest true error of a stretch: the median of all that count.
    pub asked_over_true_p50: f64,
    /// Part of the contacts on coarse faces whose true error exceeds what was asked, in the cases that count.
    pub exceeded_share: f64,
    /// One a tolerance.
    pub cases: Vec<Case>,
}

/// One tolerance.
#[derive(Debug, Clone, Serialize)]
pub struct Case {
    /// Part of the diagonal.
    pub tolerance: f64,
    /// VSPs whose expected error exceeds it, part of those that are not on planes.
    pub vsps_share: f64,
    /// Whether there are enough stretches, and the mesh has the detail.
    pub counts: bool,
    /// Stretches that are not at full resolution at some contact where the base mesh would exceed the tolerance.
    /// (Asked of one contact: beside a sharp edge that is at full resolution lie planes, coarse and exact.)
    pub stretches: usize,
    /// Stretches left out of these because every touch was exact: on planes, where coarse faces are the full mesh,
    /// there is no error to compare with.
    pub exact_stretches: usize,
    /// Asked tolerance over the largest true error of a stretch, median.
    pub asked_over_true_p50: f64,
    /// The same, exceeded by one stretch in twenty.
    pub asked_over_true_p95: f64,
    /// Contacts.
    pub contacts: usize,
    /// Contacts on faces that are not of the full mesh.
    pub coarse_contacts: usize,
    /// Contacts whose true error exceeds the tolerance.
    pub exceeded: usize,
    /// Largest true error over the tolerance.
    pub worst: f64,
    /// Faces of the front, mean.
    pub faces_mean: f64,
}

/// A touch.
#[derive(Debug, Clone, Copy)]
struct Touch {
    error: f64,
    coarse: bool,
}

/// Turns the dial from coarse to fine.
///
/// # Errors
/// When a region cannot be loaded.
pub fn dial(model: &Model, full: &Surface, random: &mut impl Rng) -> Result<Dial, Failure> {
    let metre = longest_side(model) / OBJECT_M;
    let paths: Vec<_> = (0..PATHS)
        .map(|_| {
            path(
                full,
                STRETCH_M / CONTACTS as f64 * metre,
                (STRETCHES * CONTACTS) as u32,
                random,
            )
        })
        .collect();
    let points: Vec<(DVec3, u32)> = paths
        .into_iter()
        .flatten()
        .map(|n| (n.point, n.triangle))
        .collect();
    let base = LocalFront::new(model)?;
    let of_base: Vec<f64> = points
        .iter()
        .map(|&(point, triangle)| touch(&base, full, point, triangle).error)
        .collect();
    let mut found = Dial::default();
    let mut all = Vec::new();
    let (mut coarse, mut exceeded) = (0, 0);
    for share in TOLERANCES {
        let (case, ratios) = case(model, full, &points, &of_base, share, metre)?;
        if case.counts {
            coarse += case.coarse_contacts;
            exceeded += case.exceeded;
            all.extend(ratios);
        }
        found.cases.push(case);
    }
    all.sort_unstable_by(f64::total_cmp);
    found.asked_over_true_p50 = quantile(&all, 0.5);
    found.exceeded_share = exceeded as f64 / coarse.max(1) as f64;
    Ok(found)
}

fn case(
    model: &Model,
    full: &Surface,
    points: &[(DVec3, u32)],
    of_base: &[f64],
    share: f64,
    metre: f64,
) -> Result<(Case, Vec<f64>), Failure> {
    let header = model.file.model_header();
    let tolerance = (share * header.diagonal) as f32;
    let asked = f64::from(tolerance);
    let scale = ErrorScale::for_diagonal(header.diagonal);
    let beyond = |error: f64| {
        let exceeds = |r: &&VspRecord| scale.decode(r.e) > error;
        model.records.iter().filter(exceeds).count()
    };
    let plane = PLANE * header.diagonal;
    let vsps_share = beyond(asked) as f64 / beyond(plane).max(1) as f64;
    let rings = Rings::new(&header, tolerance, 1.0);
    let mut predictor = Predictor::new();
    let mut needed: BTreeMap<RegionKey, u64> = BTreeMap::new();
    let mut front = LocalFront::new(model)?;
    let mut touches = Vec::with_capacity(points.len());
    let mut faces = 0.0;
    let mut tick = 0;
    for path in points.chunks(STRETCHES * CONTACTS) {
        // The probe rests where a path begins until the predictor has looked all around.
        let rest = rings.rings().len() * RESTING_TURNS;
        let still = std::iter::repeat_n(path[0], rest);
        for (k, (point, triangle)) in still.chain(path.iter().copied()).enumerate() {
            let motion = Motion {
                position: point,
                radius: RADIUS_M * metre,
                clearance: 0.0,
            };
            predictor.predict(&rings, true, point, motion, |region| {
                if region.refine {
                    needed.insert(region.key, tick);
                }
            });
            needed.retain(|_, last| tick <= *last + LINGER);
            tick += 1;
            if k < rest {
                continue;
            }
            let keys: Vec<RegionKey> = needed.keys().copied().collect();
            front.want(&keys)?;
            front.settle()?;
            touches.push(touch(&front, full, point, triangle));
            faces += f64::from(front.cache().mesh().active_faces());
        }
    }
    let mut ratios = Vec::new();
    let mut exact_stretches = 0;
    for (stretch, base) in touches.chunks(CONTACTS).zip(of_base.chunks(CONTACTS)) {
        let both = |(touch, &error): (&Touch, &f64)| touch.coarse && error > asked;
        if stretch.iter().zip(base).any(both) {
            let most = stretch.iter().map(|t| t.error).fold(0.0, f64::max);
            if most > plane {
                ratios.push(asked / most);
            } else {
                exact_stretches += 1;
            }
        }
    }
    ratios.sort_unstable_by(f64::total_cmp);
    let enough = ratios.len() >= FEWEST_STRETCHES;
    let case = Case {
        tolerance: share,
        vsps_share,
        counts: enough && (share >= ALWAYS || vsps_share <= DETAIL),
        stretches: ratios.len(),
        exact_stretches,
        asked_over_true_p50: quantile(&ratios, 0.5),
        asked_over_true_p95: quantile(&ratios, 0.95),
        contacts: touches.len(),
        coarse_contacts: touches.iter().filter(|t| t.coarse).count(),
        exceeded: touches.iter().filter(|t| t.error > asked).count(),
        worst: touches.iter().map(|t| t.error / asked).fold(0.0, f64::max),
        faces_mean: faces / touches.len().max(1) as f64,
    };
    Ok((case, ratios))
}

/// The point of the front nearest to a point of the full mesh, and how far from the full mesh it is.
fn touch(front: &LocalFront<'_>, full: &Surface, point: DVec3, triangle: u32) -> Touch {
    let surface = query::Surface {
        mesh: front.cache().mesh(),
        tree: front.cache().tree(),
    };
    let (nearest, _) = query::closest_point(surface, point, None);
    nearest.map_or(
        Touch {
            error: 0.0,
            coarse: false,
        },
        |nearest| Touch {
            error: full.nearest(nearest.closest.point, triangle).distance,
            coarse: surface.mesh.certified_error(nearest.face) > 0.0,
        },
    )
}
