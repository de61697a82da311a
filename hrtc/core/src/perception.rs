//! Limits of change under a probe: the motion of the surface that a probe in contact allows in a
//! tick. They bound the rate (slew) of the force, at any rate of the loop by the same amount a
//! second.
//!
//! A split or collapse that a probe could perceive is a geomorph (see [`spm::Geomorph`]): its
//! vertex moves over several ticks. A step of a vertex raises or lowers the surface by at most the
//! vertex's displacement along the normals of its faces, before or after the step. Two limits hold
//! for this height h, with stiffness K and depth p:
//!
//! - *force*: the coupling's force changes by K h, at most a share of 50 N/s or of 70 times the
//!   force F a second, whichever is more: `max(50 N/s, 70/s F) T` in a tick of the period T;
//! - *energy*: a surface that rises by h adds K p h + K h²/2 to the coupling. The reserve of the
//!   probe's energy account pays for it. Beyond the reserve, the energy in the coupling grows by at
//!   most 48 times itself per second, slowly enough for a hand to follow.
//!
//! The proxy may use the rest of the force limit, to slide along a surface that turns under it.
//!
//! At 1 kHz a tick has 0.05 N or 7 % of the force, a step that is not noticed. The bound is that of
//! the rate: at 250 Hz a tick has 0.2 N or 28 %, which may be noticed, at 4 kHz 12.5 mN or 1.75 %.
//! "Imperceptible" is said of the step at 1 kHz.

use geometry::closest_point_on_triangle;
use glam::DVec3;
use mutants::{Mutant, is};
use spm::{ActiveMesh, Geomorph, Handle, NONE, OperationFaces, Slot};

/// Imperceptible force, newtons.
pub const IMPERCEPTIBLE_N: f64 = 0.05;
/// Bound of the rate of change of a force, newtons a second: [`IMPERCEPTIBLE_N`] in a millisecond.
pub const STEP_N_PER_S: f64 = 50.0;
/// The same as a share of the force, 1/s: 7 % in a millisecond.
pub const STEP_SHARE_PER_S: f64 = 70.0;
/// Share of that limit for the motion of the surface.
const OF_SURFACE: f64 = 0.25;
/// Share of that limit for the proxy's motion beyond the device's.
pub const OF_PROXY: f64 = 0.8;
/// Largest unpaid growth of the energy in the coupling, as a multiple of it per second.
pub const GROWTH_PER_S: f64 = 48.0;
/// Range of perception of a probe in contact beyond its radius, as a fraction of it. Farther away
/// the prediction refines the surface before the probe arrives.
pub const AROUND: f64 = 0.25;
/// Factor of that range within which no face may turn over.
pub const NEAR_FACTOR: f64 = 2.0;
/// Largest step of the surface, as a fraction of the probe's radius, so that no step passes over
/// its centre.
const OF_RADIUS: f64 = 0.125;
/// Reductions of a step before the step that is certainly allowed is taken.
const TRIES: usize = 4;
/// Reduction beyond proportion: the normals after the step turn with it.
const SMALLER: f64 = 1.125;

/// The limits of a probe in a tick; frame and units of the model unless stated.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PerceptionLimit {
    centre: DVec3,
    reach: f64,
    is_contact: bool,
    /// Direction away from the surface; zero if unknown.
    up: DVec3,
    /// Largest motion of the surface in a tick, and largest rise.
    step: f64,
    rise: f64,
    /// Largest motion of the proxy in a tick beyond the device's.
    proxy_step: f64,
}

/// The conditions of a contact from which the limits follow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactConditions {
    /// Position of the proxy, model units.
    pub centre: DVec3,
    /// Radius of the probe around it, model units.
    pub radius: f64,
    /// From the device to the proxy: model frame, any length.
    pub up: DVec3,
    /// Metres per model unit.
    pub metres_per_unit: f64,
    /// Stiffness of the surface, N/m.
    pub stiffness_n_per_m: f64,
    /// Whether the probe is in contact; otherwise its range is its radius.
    pub is_contact: bool,
    /// Force, newtons.
    pub force_n: f64,
    /// Depth of the device behind the proxy, metres.
    pub depth_m: f64,
    /// Energy that the account has absorbed beyond that in the coupling, joules.
    pub reserve_j: f64,
    /// Seconds per tick.
    pub period_s: f64,
}

impl PerceptionLimit {
    /// The limits of a probe under these conditions.
    #[must_use]
    pub fn new(conditions: &ContactConditions) -> Self {
        let &ContactConditions {
            radius,
            metres_per_unit,
            stiffness_n_per_m: stiffness,
            depth_m,
            ..
        } = conditions;
        let period_s = conditions.period_s;
        let step_share = STEP_SHARE_PER_S * period_s;
        let allowed_n = (STEP_N_PER_S * period_s).max(step_share * conditions.force_n);
        let spring = |depth_m: f64| 0.5 * stiffness * depth_m * depth_m;
        let growing = spring(depth_m).max(spring(IMPERCEPTIBLE_N / stiffness));
        let energy = conditions
            .reserve_j
            .max(GROWTH_PER_S * conditions.period_s * growing);
        // K p h + K h²/2 = energy, solved for h without cancellation.
        let twice = 2.0 * energy / stiffness;
        let rise_m = twice / (depth_m + (depth_m * depth_m + twice).sqrt());
        let in_units = |metres: f64| (metres / metres_per_unit).min(OF_RADIUS * radius);
        let step = in_units(OF_SURFACE * allowed_n / stiffness);
        let around = if conditions.is_contact { AROUND } else { 0.0 };
        Self {
            centre: conditions.centre,
            reach: radius * (1.0 + around),
            is_contact: conditions.is_contact,
            up: conditions.up.normalize_or_zero(),
            step,
            rise: in_units(rise_m).min(step),
            proxy_step: OF_PROXY * allowed_n / stiffness / metres_per_unit,
        }
    }

    /// Largest motion of the proxy in a tick beyond the device's while the surface moves.
    #[must_use]
    pub fn proxy_step(&self) -> f64 {
        self.proxy_step
    }

    /// Distance of a triangle from the centre.
    fn distance(&self, corners: [DVec3; 3]) -> f64 {
        closest_point_on_triangle(corners, self.centre)
            .distance_squared
            .sqrt()
    }

    /// Whether a tetrahedron, of any orientation or flat, is within reach.
    fn is_within(&self, corners: [DVec3; 4]) -> bool {
        let [a, b, c, d] = corners;
        if !self.reaches(box_around(corners)) {
            return false;
        }
        let faces = [[a, b, c], [a, b, d], [a, c, d], [b, c, d]];
        faces
            .into_iter()
            .any(|face| self.distance(face) <= self.reach)
            || is_inside(corners, self.centre)
    }

    /// Whether a change within a box may be perceptible.
    #[must_use]
    pub fn reaches(&self, [lower, upper]: [DVec3; 2]) -> bool {
        let outside = (lower - self.centre)
            .max(self.centre - upper)
            .max(DVec3::ZERO);
        outside.length_squared() <= self.reach * self.reach
    }
}

/// Whether a point is strictly inside a tetrahedron: on the inner side of every face.
fn is_inside([a, b, c, d]: [DVec3; 4], p: DVec3) -> bool {
    let volume = |a: DVec3, b: DVec3, c: DVec3, d: DVec3| (b - a).cross(c - a).dot(d - a);
    let whole = volume(a, b, c, d);
    let parts = [
        volume(p, b, c, d),
        volume(a, p, c, d),
        volume(a, b, p, d),
        volume(a, b, c, p),
    ];
    parts
        .iter()
        .all(|&part| part != 0.0 && (part > 0.0) == (whole > 0.0))
}

/// Whether a split or collapse to be performed is perceptible: whether the volume that the surface
/// sweeps is within reach of a probe. Both ends of the motion may be out of reach on either side of
/// the probe. `patch`: the deformed faces; `places`: their new corner vertices.
#[must_use]
pub fn is_perceptible(
    mesh: &ActiveMesh,
    slot: Slot,
    patch: &OperationFaces,
    places: &[Handle],
    limits: &[(usize, PerceptionLimit)],
) -> bool {
    let space = space_of(mesh, patch, places);
    let mut near = limits.iter().filter(|(_, limit)| limit.reaches(space));
    near.any(|(_, limit)| mesh.any_swept(slot, patch, |tetrahedron| limit.is_within(tetrahedron)))
}

/// Whether a split or collapse, imperceptible itself, may bring its faces to a probe: if a corner
/// of them has a face near a probe, or is geomorphing and may carry them along.
#[must_use]
pub fn may_come_near(
    mesh: &ActiveMesh,
    patch: &OperationFaces,
    places: &[Handle],
    limits: &[(usize, PerceptionLimit)],
) -> bool {
    let surroundings = |limit: &PerceptionLimit| PerceptionLimit {
        reach: NEAR_FACTOR * limit.reach,
        ..*limit
    };
    let space = space_of(mesh, patch, places);
    let is_near = |face: Handle| {
        let corners = mesh.corners(face);
        let mut limits = limits.iter().map(|(_, limit)| surroundings(limit));
        limits.any(|limit| {
            limit.reaches(box_around(corners)) && limit.distance(corners) <= limit.reach
        })
    };
    let mut looked_at = 0;
    // Of very large fans it is not looked for: it may be.
    let mut is_near_or_unknown = |face: Handle| {
        looked_at += 1;
        looked_at > OperationFaces::MAX_FACES || is_near(face)
    };
    // Faces that follow each other in a fan share all corners but one.
    let mut before = [NONE; 3];
    limits
        .iter()
        .any(|(_, limit)| surroundings(limit).reaches(space))
        || mesh.any_geomorphing(patch.deformed())
        || patch.deformed().iter().any(|&face| {
            let corners = mesh.face(face).corners;
            let seen = std::mem::replace(&mut before, corners);
            let new = corners.into_iter().filter(|corner| !seen.contains(corner));
            new.into_iter()
                .any(|corner| mesh.any_around(face, corner, &mut is_near_or_unknown))
        })
}

/// Bounding box of a split or collapse.
#[must_use]
pub fn space_of(mesh: &ActiveMesh, patch: &OperationFaces, places: &[Handle]) -> [DVec3; 2] {
    let places = places.iter();
    let places = places.map(|&vertex| mesh.position(vertex).as_dvec3());
    box_of(mesh, patch.deformed(), places)
}

/// Bounding box of faces and positions.
pub fn box_of(
    mesh: &ActiveMesh,
    faces: &[Handle],
    places: impl IntoIterator<Item = DVec3>,
) -> [DVec3; 2] {
    let corners = faces.iter().flat_map(|&face| mesh.corners(face));
    box_around(corners.chain(places))
}

fn box_around(places: impl IntoIterator<Item = DVec3>) -> [DVec3; 2] {
    places.into_iter().fold(
        [DVec3::INFINITY, DVec3::NEG_INFINITY],
        |[lower, upper], p| [lower.min(p), upper.max(p)],
    )
}

/// A geomorphing vertex and the faces around it.
pub type Step<'a> = (Geomorph, &'a OperationFaces);

/// Largest motion and rise of the surface within reach by a step of a vertex: the displacement
/// along the normals of the faces around it, before and after the step, times the vertex's weight
/// at the points within reach. A face that sweeps through the reach counts, wherever it starts and
/// ends. Where the surface turns back at a ridge, or a face turns over in the step, the ridge may
/// come at the probe edge on: there the whole displacement counts. `place`: positions of vertices
/// before the step.
fn height(
    mesh: &ActiveMesh,
    (geomorph, around): &Step<'_>,
    step: DVec3,
    place: impl Fn(Handle) -> DVec3,
    limit: &PerceptionLimit,
) -> (f64, f64) {
    let (mut moved, mut raised) = (0.0f64, 0.0f64);
    // Normals before and after the step of the first face within reach, and of the one before.
    let mut others: [Option<[DVec3; 2]>; 2] = [None; 2];
    for &face in around.deformed() {
        let corners = mesh.face(face).corners;
        let Some(k) = corners.iter().position(|&c| c == geomorph.vertex()) else {
            continue;
        };
        let [at, b, c] = [k, (k + 1) % 3, (k + 2) % 3].map(|k| place(corners[k]));
        if !limit.is_within([at, b, c, at + step]) {
            continue;
        }
        let places = [at, at + step];
        let normals = places.map(|at| (b - at).cross(c - at));
        let turns_over = normals[0].dot(normals[1]) < 0.0;
        for k in 0..2 {
            // A face without area is an edge, which other faces share.
            let Some(normal) = normals[k].try_normalize() else {
                continue;
            };
            // A point moves by the vertex's weight in it: its height over the edge bc, divided by
            // the vertex's.
            let inwards = normal.cross(c - b);
            let height = |p: DVec3| (p - b).dot(inwards);
            let farthest = height(limit.centre) + limit.reach * inwards.length();
            let share = (farthest / height(places[k])).clamp(0.0, 1.0);
            let turns_back = |other: &[DVec3; 2]| other[k].dot(normal) < 0.0;
            if turns_over || others.iter().flatten().any(turns_back) {
                moved = moved.max(share * step.length());
                raised = raised.max(share * step.length());
                continue;
            }
            let along = share * step.dot(normal);
            moved = moved.max(along.abs());
            let towards = normal.dot(limit.up);
            let rise = if towards == 0.0 {
                along.abs()
            } else {
                along * towards.signum()
            };
            raised = raised.max(rise);
        }
        others = [others[0].or(Some(normals)), Some(normals)];
    }
    (moved, raised)
}

/// The use of a probe's limits by geomorphing vertices that advance by a share of their paths, one
/// after the other. Above 1 it is not allowed.
#[must_use]
pub fn excess(mesh: &ActiveMesh, steps: &[Step<'_>], limit: &PerceptionLimit, share: f64) -> f64 {
    let heights = (0..steps.len()).map(|k| {
        // The vertices before this one have moved.
        let done = &steps[..k];
        let place = |vertex: Handle| {
            let before = done
                .iter()
                .find(|(geomorph, _)| geomorph.vertex() == vertex);
            let moved = before.map(|(geomorph, _)| mesh.geomorph_displacement(geomorph) * share);
            mesh.position(vertex).as_dvec3() + moved.unwrap_or(DVec3::ZERO)
        };
        let step = mesh.geomorph_displacement(&steps[k].0) * share;
        let (moved, raised) = height(mesh, &steps[k], step, place, limit);
        (moved / limit.step).max(raised / limit.rise)
    });
    heights.fold(0.0, f64::max)
}

/// The share of their paths by which geomorphing vertices may advance in a tick, one after the
/// other.
#[must_use]
pub fn allowed_share(mesh: &ActiveMesh, steps: &[Step<'_>], limit: &PerceptionLimit) -> f64 {
    let lengths = steps
        .iter()
        .map(|(geomorph, _)| mesh.geomorph_displacement(geomorph).length());
    let longest = lengths.fold(0.0, f64::max);
    if longest == 0.0 {
        return 1.0;
    }
    // The remaining path, if that is allowed.
    let left = steps.iter().map(|(geomorph, _)| 1.0 - geomorph.done());
    let left = left.fold(0.0, f64::max);
    let surely = || (surely_allowed(mesh, steps, limit) / longest).min(1.0);
    let mut share = left;
    for _ in 0..TRIES {
        let excess = excess(mesh, steps, limit, share);
        if excess > 1.0 {
            share /= excess * SMALLER;
        } else if share == left {
            return left;
        } else {
            return share.max(surely());
        }
    }
    surely()
}

/// The length by which vertices may move whatever moves with them: the surface moves nowhere by
/// more than they, and it may come to the reach at once.
fn surely_allowed(mesh: &ActiveMesh, steps: &[Step<'_>], limit: &PerceptionLimit) -> f64 {
    let allowed = limit.step.min(limit.rise);
    // The faces are no farther than the moving vertices, their corners; where those are near, the
    // distance of the faces adds nothing.
    let mut vertices = steps.iter().map(|(geomorph, _)| geomorph.vertex());
    let is_near = vertices.any(|vertex| {
        let at = mesh.position(vertex).as_dvec3();
        at.distance(limit.centre) <= limit.reach + allowed
    });
    if is_near {
        return allowed;
    }
    let faces = steps.iter().flat_map(|(_, around)| around.deformed());
    let nearest = faces.fold(f64::INFINITY, |least, &face| {
        least.min(limit.distance(mesh.corners(face)))
    });
    allowed.max(nearest - limit.reach)
}

/// Whether a split or collapse to be performed would turn a face over: reverse the normal of a
/// deformed face, or open a new face against all its neighbours. `patch`: the deformed faces.
///
/// If a corner of these faces is geomorphing, the test holds for all its remaining path: a normal
/// changes linearly with one corner, so that both ends suffice.
#[must_use]
pub fn turns_over(mesh: &ActiveMesh, slot: Slot, patch: &OperationFaces) -> bool {
    let ends: &[bool] = if mesh.any_geomorphing(patch.deformed()) {
        &[false, true]
    } else {
        &[false]
    };
    let mut pairs = ends.iter().flat_map(|&a| ends.iter().map(move |&b| [a, b]));
    !is(Mutant::Folds) && pairs.any(|at_ends| turns_over_at(mesh, slot, patch, at_ends))
}

/// The same, with geomorphing vertices at their current positions or at the end of their paths,
/// before and after the operation.
fn turns_over_at(
    mesh: &ActiveMesh,
    slot: Slot,
    patch: &OperationFaces,
    [before, after]: [bool; 2],
) -> bool {
    let place = |vertex: Handle, at_end: bool| {
        let place = if at_end {
            mesh.final_position(vertex)
        } else {
            mesh.position(vertex)
        };
        place.as_dvec3()
    };
    let normal = |corners: [Handle; 3], at_end: bool| {
        let [a, b, c] = corners.map(|vertex| place(vertex, at_end));
        (b - a).cross(c - a)
    };
    let normal_before = |face: Handle| normal(mesh.face(face).corners, before);
    let over = |face: Option<Handle>, corners: [Handle; 3]| {
        // The new pair has no face before.
        face.is_some_and(|face| normal_before(face).dot(normal(corners, after)) < 0.0)
    };
    if mesh.any_after(slot, patch, over) {
        return true;
    }
    if mesh.is_performed(slot) {
        return false;
    }
    let parent = place(mesh.parent(slot), before);
    let [t, u] = mesh.children(slot).map(|vertex| place(vertex, after));
    let pair = mesh.third_corners(slot).into_iter().zip([u - t, t - u]);
    pair.filter_map(|(third, along)| Some((third?, along)))
        .any(|(third, along)| {
            let against = |normal_of_pair: DVec3| {
                // A face without area, as one that opens too, decides nothing.
                let adjacent = patch.deformed().iter();
                let adjacent = adjacent.filter(|&&face| mesh.face(face).corners.contains(&third));
                let along = adjacent.map(|&face| normal_before(face).dot(normal_of_pair));
                let [least, most] = along.fold([0.0f64; 2], |[least, most], dot| {
                    [least.min(dot), most.max(dot)]
                });
                least < 0.0 && most <= 0.0
            };
            let third = place(third, after);
            // While it opens, and when it is open.
            against(along.cross(third - parent)) || against(along.cross(third - t))
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A surface that changes as fast as is allowed changes the force as fast at every rate.
    #[test]
    fn an_imperceptible_change_is_as_fast_at_every_rate() {
        for force_n in [0.0, 0.3, 5.0] {
            let speeds = [100.0, 1000.0, 10_000.0].map(|rate_hz| {
                let limit = PerceptionLimit::new(&ContactConditions {
                    centre: DVec3::ZERO,
                    radius: 1.0,
                    up: DVec3::Z,
                    metres_per_unit: 1.0,
                    stiffness_n_per_m: 800.0,
                    is_contact: true,
                    force_n,
                    depth_m: 1e-3,
                    reserve_j: 0.0,
                    period_s: 1.0 / rate_hz,
                });
                [limit.step, limit.proxy_step].map(|step| step * rate_hz)
            });
            for speed in speeds {
                for (of, expected) in speed.iter().zip(speeds[1]) {
                    assert!((of / expected - 1.0).abs() < 1e-12, "{of} {expected}");
                }
            }
        }
    }
}
