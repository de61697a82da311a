//! Refinement that cannot be felt: what a probe allows the surface under it to do in a tick.
//!
//! Splits and collapses that a probe can feel do not happen at once: their vertices fly (see [`spm::Geomorph`]).
//! A step of a vertex raises or lowers the surface nowhere by more than its displacement along the normals of the
//! faces around it, before or after the step; that height is limited by two allowances:
//!
//! - *force*: the spring between probe and proxy changes by K times the height, so K h is a share of 0.05 N or 7 % of
//!   the force, whichever is more: below what a hand can tell (facts of haptics, section 2);
//! - *energy*: a surface that rises h at depth p puts K p h + K h²/2 into the spring (F8). That is paid from what
//!   the probe's account has taken in beyond what the spring holds; what is not is spread out: the energy in the spring grows by
//!   48 times itself a second at the most (F9), slowly enough for a hand to follow.
//!
//! The rest of the force allowance is left to the proxy, which may slide along the surface that turns under it.

use geometry::closest_point_on_triangle;
use glam::DVec3;
use spm::{ActiveMesh, Geomorph, Handle, OperationFaces, Slot};

/// A change of force in a tick that is not felt, newtons.
pub const STEP_N: f64 = 0.05;
/// The same as a share of the force.
pub const STEP_SHARE: f64 = 0.07;
/// The share of that which the surface may do.
const OF_SURFACE: f64 = 0.25;
/// The share which the proxy may do beyond the device's motion.
pub const OF_PROXY: f64 = 0.8;
/// What an unpaid rise may add to the energy in the spring a second, as a multiple of it; see the module.
const GROWTH_PER_S: f64 = 48.0;
/// What a probe that touches feels beyond its own radius, as a fraction of it. Where it comes next is left to the prediction:
/// there the surface is at rest when it comes.
pub const AROUND: f64 = 0.25;
/// How many times as far no face is turned over.
pub const NEAR_FACTOR: f64 = 2.0;
/// A step as a fraction of the probe's radius, at the most: so that none passes over its centre.
const OF_RADIUS: f64 = 0.125;
/// Times that a step is made smaller before it is made as small as it is surely allowed.
const TRIES: usize = 4;
/// What is taken off beyond proportion then: the normals after the step turn with it.
const SMALLER: f64 = 1.125;

/// What a touching probe feels and allows; model frame and units but where it says otherwise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PerceptionLimit {
    centre: DVec3,
    reach: f64,
    is_contact: bool,
    /// Away from the surface; zero where nothing tells.
    up: DVec3,
    /// The most that the surface may move in a tick, and rise.
    step: f64,
    rise: f64,
    /// How far the proxy may go in a tick beyond the device's motion.
    proxy_step: f64,
}

/// How far a proxy goes in a tick beyond the device's motion, model units: no farther than is said as long as the surface
/// under it moves, and until it has caught up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepLimit {
    max_step: f64,
    is_set: bool,
}

impl StepLimit {
    /// As far as it likes.
    pub const FREE: Self = Self {
        max_step: f64::INFINITY,
        is_set: false,
    };

    /// So far in this tick, model units; the least of what is said in one.
    pub fn tighten(&mut self, max_step: f64) {
        self.max_step = if self.is_set {
            self.max_step.min(max_step)
        } else {
            max_step
        };
        self.is_set = true;
    }

    /// How far it may go; infinite where nothing moves.
    #[must_use]
    pub fn max_step(&self) -> f64 {
        self.max_step
    }

    /// The same where it is limited, else nothing.
    #[must_use]
    pub fn limit(&self) -> f64 {
        if self.is_limited() {
            self.max_step
        } else {
            0.0
        }
    }

    /// Whether the surface moves, or it has not caught up since.
    #[must_use]
    pub fn is_limited(&self) -> bool {
        self.max_step.is_finite()
    }

    /// The tick is over; whether it has caught up.
    pub fn end_tick(&mut self, has_caught_up: bool) {
        if !std::mem::take(&mut self.is_set) && has_caught_up {
            *self = Self::FREE;
        }
    }
}

/// What tells a feeler's allowances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactConditions {
    /// Where the proxy is, model units.
    pub centre: DVec3,
    /// Radius of what touches around it, model units.
    pub radius: f64,
    /// From the device to the proxy: model frame, any length.
    pub up: DVec3,
    /// Metres a model unit.
    pub metres_per_unit: f64,
    /// Stiffness of the surface, N/m.
    pub stiffness_n_per_m: f64,
    /// Whether it touches; else it only feels what would touch it.
    pub is_contact: bool,
    /// Force, newtons.
    pub force_n: f64,
    /// Depth of the device behind the proxy, metres.
    pub depth_m: f64,
    /// Energy that the account has taken in beyond what the spring holds, joules.
    pub reserve_j: f64,
    /// Seconds a tick.
    pub period_s: f64,
}

impl PerceptionLimit {
    /// What a probe feels and allows.
    #[must_use]
    pub fn new(conditions: &ContactConditions) -> Self {
        let &ContactConditions {
            radius,
            metres_per_unit,
            stiffness_n_per_m: stiffness,
            depth_m,
            ..
        } = conditions;
        let allowed_n = STEP_N.max(STEP_SHARE * conditions.force_n);
        let spring = |depth_m: f64| 0.5 * stiffness * depth_m * depth_m;
        let growing = spring(depth_m).max(spring(STEP_N / stiffness));
        let energy = conditions
            .reserve_j
            .max(GROWTH_PER_S * conditions.period_s * growing);
        // K p h + K h²/2 = energy, without cancellation.
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

    /// How far the proxy may go in a tick beyond the device's motion, while the surface under it moves.
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

    /// Whether a tetrahedron, of any orientation and flat too, is within reach.
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

    /// Whether something within a box may be felt.
    #[must_use]
    pub fn reaches(&self, [lower, upper]: [DVec3; 2]) -> bool {
        let outside = (lower - self.centre)
            .max(self.centre - upper)
            .max(DVec3::ZERO);
        outside.length_squared() <= self.reach * self.reach
    }
}

/// Whether a point is inside a tetrahedron: on the inner side of every face. Where rounding decides it is on a face.
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

/// Whether a split or collapse that is to be performed is felt: if what the surface sweeps over on a straight way from where
/// it is to where it will be is within reach of a probe. Both ends of that way may be out of reach on either side of
/// the probe. `patch` holds the faces that it deforms, `places` are the vertices that they get for corners.
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

/// Whether what a split or collapse that is to be performed does to the faces of its patch may come to a probe, though it is not
/// felt where they are: where a corner of them has a face beside a probe, or is in flight. A flight of that corner brings
/// them along.
#[must_use]
pub fn may_come_near(
    mesh: &ActiveMesh,
    patch: &OperationFaces,
    places: &[Handle],
    limits: &[(usize, PerceptionLimit)],
) -> bool {
    let beside = |limit: &PerceptionLimit| PerceptionLimit {
        reach: NEAR_FACTOR * limit.reach,
        ..*limit
    };
    let space = space_of(mesh, patch, places);
    let is_beside = |face: Handle| {
        let corners = mesh.corners(face);
        let mut limits = limits.iter().map(|(_, limit)| beside(limit));
        limits.any(|limit| {
            limit.reaches(box_around(corners)) && limit.distance(corners) <= limit.reach
        })
    };
    limits.iter().any(|(_, limit)| beside(limit).reaches(space))
        || mesh.any_in_flight(patch.deformed())
        || patch.deformed().iter().any(|&face| {
            let corners = mesh.face(face).corners;
            corners
                .into_iter()
                .any(|corner| mesh.any_around(face, corner, is_beside))
        })
}

/// The box that a split or collapse happens within.
#[must_use]
pub fn space_of(mesh: &ActiveMesh, patch: &OperationFaces, places: &[Handle]) -> [DVec3; 2] {
    let places = places.iter();
    let places = places.map(|&vertex| mesh.position(vertex).as_dvec3());
    box_of(mesh, patch.deformed(), places)
}

/// Box of some faces and places.
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

/// A vertex in flight and the faces around it.
pub type Step<'a> = (Geomorph, &'a OperationFaces);

/// How far a step of a vertex moves and raises the surface at the most where the feeler feels it: the displacement
/// along the normals of the faces around it, before the step and after it, times the share of the vertex in the places
/// within reach. A face that sweeps over what is within reach counts, wherever it begins and ends. `place` says where
/// vertices are before the step.
fn height(
    mesh: &ActiveMesh,
    (flight, around): &Step<'_>,
    step: DVec3,
    place: impl Fn(Handle) -> DVec3,
    limit: &PerceptionLimit,
) -> (f64, f64) {
    let (mut moved, mut raised) = (0.0f64, 0.0f64);
    for &face in around.deformed() {
        let corners = mesh.face(face).corners;
        let Some(k) = corners.iter().position(|&c| c == flight.vertex()) else {
            continue;
        };
        let [at, b, c] = [k, (k + 1) % 3, (k + 2) % 3].map(|k| place(corners[k]));
        if !limit.is_within([at, b, c, at + step]) {
            continue;
        }
        for at in [at, at + step] {
            // A face without area is an edge, which other faces have too.
            let Some(normal) = (b - at).cross(c - at).try_normalize() else {
                continue;
            };
            // A place moves by the vertex's share in it: its height over the edge bc over that of the vertex.
            let inwards = normal.cross(c - b);
            let height = |p: DVec3| (p - b).dot(inwards);
            let farthest = height(limit.centre) + limit.reach * inwards.length();
            let share = (farthest / height(at)).clamp(0.0, 1.0);
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
    }
    (moved, raised)
}

/// How much of what a probe allows in a tick it takes that some vertices in flight go a share of their ways, one step after
/// the other; beyond 1 it is not allowed.
#[must_use]
pub fn excess(mesh: &ActiveMesh, steps: &[Step<'_>], limit: &PerceptionLimit, share: f64) -> f64 {
    let heights = (0..steps.len()).map(|k| {
        // Those before it have done their steps.
        let done = &steps[..k];
        let place = |vertex: Handle| {
            let before = done.iter().find(|(flight, _)| flight.vertex() == vertex);
            let moved = before.map(|(flight, _)| mesh.way(flight) * share);
            mesh.position(vertex).as_dvec3() + moved.unwrap_or(DVec3::ZERO)
        };
        let step = mesh.way(&steps[k].0) * share;
        let (moved, raised) = height(mesh, &steps[k], step, place, limit);
        (moved / limit.step).max(raised / limit.rise)
    });
    heights.fold(0.0, f64::max)
}

/// The share of their ways that a probe that feels them allows some vertices in flight in a tick, one step after the other.
#[must_use]
pub fn allowed_share(mesh: &ActiveMesh, steps: &[Step<'_>], limit: &PerceptionLimit) -> f64 {
    let ways = steps.iter().map(|(flight, _)| mesh.way(flight).length());
    let longest = ways.fold(0.0, f64::max);
    if longest == 0.0 {
        return 1.0;
    }
    let excess = |share: f64| excess(mesh, steps, limit, share);
    // A surface moves nowhere by more than its vertices; and it may come to the reach at once.
    let faces = steps.iter().flat_map(|(_, around)| around.deformed());
    let nearest = faces.fold(f64::INFINITY, |least, &face| {
        least.min(limit.distance(mesh.corners(face)))
    });
    let surely = limit.step.min(limit.rise).max(nearest - limit.reach);
    let surely = (surely / longest).min(1.0);
    // What is left of the way, if that is allowed.
    let left = steps.iter().map(|(flight, _)| 1.0 - flight.done());
    let mut share = left.fold(0.0, f64::max);
    for _ in 0..TRIES {
        let excess = excess(share);
        if excess <= 1.0 {
            return share.max(surely);
        }
        share /= excess * SMALLER;
    }
    surely
}

/// Whether a split or collapse that is to be performed would turn a face over: a deformed one whose normal would point
/// the other way, or one that opens against all faces beside it. `patch` holds the faces that it deforms.
///
/// Where a corner of these faces is in flight, that holds wherever it is on the rest of its way: a normal changes in proportion
/// to the way of one corner, so that both ends tell.
#[must_use]
pub fn turns_over(mesh: &ActiveMesh, slot: Slot, patch: &OperationFaces) -> bool {
    let ends: &[bool] = if mesh.any_in_flight(patch.deformed()) {
        &[false, true]
    } else {
        &[false]
    };
    let mut pairs = ends.iter().flat_map(|&a| ends.iter().map(move |&b| [a, b]));
    pairs.any(|at_ends| turns_over_at(mesh, slot, patch, at_ends))
}

/// The same, with what is in flight where it is, or at the end of its way, before the operation and after it.
fn turns_over_at(
    mesh: &ActiveMesh,
    slot: Slot,
    patch: &OperationFaces,
    [before, after]: [bool; 2],
) -> bool {
    let place = |vertex: Handle, at_end: bool| {
        let place = if at_end {
            mesh.destination(vertex)
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
        // The pair has no face before.
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
    let pair = mesh.thirds(slot).into_iter().zip([u - t, t - u]);
    pair.filter_map(|(third, along)| Some((third?, along)))
        .any(|(third, along)| {
            let against = |normal_of_pair: DVec3| {
                // A face without area, as one that opens too, says nothing.
                let beside = patch.deformed().iter();
                let beside = beside.filter(|&&face| mesh.face(face).corners.contains(&third));
                let along = beside.map(|&face| normal_before(face).dot(normal_of_pair));
                let [least, most] = along.fold([0.0f64; 2], |[least, most], dot| {
                    [least.min(dot), most.max(dot)]
                });
                least < 0.0 && most <= 0.0
            };
            let third = place(third, after);
            // As it opens, and when it is open.
            against(along.cross(third - parent)) || against(along.cross(third - t))
        })
}
