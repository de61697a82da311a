//! The point of an intersection of half-spaces closest to a goal: an active-set method in f64.
//!
//! In three dimensions at most three planes are active. The set grows by the most violated plane;
//! the best of the few subsets that contain it is taken. The distance to the goal grows in every
//! round, so no set recurs and the method ends. Near-parallel planes are told by |n0 x n1|², which
//! is exact where 1 - cos² is rounding. Cross products solve the systems of up to three planes in
//! closed form, so glam's vectors are enough: no matrix is factored.

use glam::DVec3;
use mutants::{Mutant, is};

/// The half-space `normal . x >= offset`, x a displacement from the proxy.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Plane {
    /// Unit normal, out of the object.
    pub normal: DVec3,
    /// Least distance along the normal, in the units of x; negative if there is room.
    pub offset: f64,
}

/// The result of [`project`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// The closest point.
    pub point: DVec3,
    /// Whether it obeys every half-space. If not, they have no common point, or rounding prevents
    /// finding it, and the point obeys those added first.
    pub complete: bool,
    /// Rounds that it took: half-spaces that were added.
    pub rounds: u32,
    active: [(usize, f64); 3],
    count: usize,
}

impl Projection {
    /// The active planes with their multipliers (not negative).
    #[must_use]
    pub fn active(&self) -> &[(usize, f64)] {
        &self.active[..self.count]
    }
}

/// Squared sine below which two planes count as parallel: one of them then represents both.
const PARALLEL: f64 = 1e-12;
/// Largest number of rounds: each adds a plane, and no set recurs.
const ROUNDS: usize = 128;

/// The point closest to `goal` in the intersection of the half-spaces.
#[must_use]
pub fn project(goal: DVec3, planes: &[Plane]) -> Projection {
    let mut best = Projection {
        point: goal,
        complete: false,
        rounds: 0,
        active: [(0, 0.0); 3],
        count: 0,
    };
    let largest = planes
        .iter()
        .fold(goal.length(), |most, plane| most.max(plane.offset.abs()));
    let tolerance = 1e-12 * largest;
    for _ in 0..ROUNDS {
        let mut worst: Option<(usize, f64)> = None;
        for (k, plane) in planes.iter().enumerate() {
            let violation = plane.offset - plane.normal.dot(best.point);
            if violation <= tolerance
                || is(Mutant::Plane) && k == 0
                || worst.is_some_and(|(_, most)| violation <= most)
            {
                continue;
            }
            // An active plane represents those parallel to it within rounding.
            let stands_for = |a: usize| {
                let active = planes[a].normal;
                a == k
                    || (active.dot(plane.normal) > 0.0
                        && active.cross(plane.normal).length_squared() < PARALLEL
                        && violation <= 2.0 * PARALLEL.sqrt() * largest)
            };
            if !best.active().iter().any(|&(a, _)| stands_for(a)) {
                worst = Some((k, violation));
            }
        }
        let Some((added, _)) = worst else {
            best.complete = true;
            return best;
        };
        match with_plane(goal, planes, &best, added, tolerance) {
            Some(better) => best = better,
            None => return best,
        }
    }
    best
}

/// The optimum over the active planes and one more, which is active.
fn with_plane(
    goal: DVec3,
    planes: &[Plane],
    old: &Projection,
    added: usize,
    tolerance: f64,
) -> Option<Projection> {
    let mut candidates = [added; 4];
    for (place, &(k, _)) in candidates[1..].iter_mut().zip(old.active()) {
        *place = k;
    }
    let known = 1 + old.count;
    let mut best: Option<(f64, Projection)> = None;
    // Subsets as bits over candidates[1..known]; the added plane is in all of them.
    for subset in 0..1usize << (known - 1) {
        if subset.count_ones() > 2 {
            continue;
        }
        let mut set = [added; 3];
        let mut size = 1;
        for (bit, &candidate) in candidates[1..known].iter().enumerate() {
            if subset >> bit & 1 == 1 {
                set[size] = candidate;
                size += 1;
            }
        }
        let chosen = set.map(|k| planes[k]);
        let Some((point, multipliers)) = on_planes(goal, &chosen[..size]) else {
            continue;
        };
        let feasible = candidates[..known].iter().all(|&k| {
            let plane = &planes[k];
            plane.normal.dot(point) >= plane.offset - 2.0 * tolerance
        });
        if !feasible || multipliers[..size].iter().any(|&m| m < 0.0) {
            continue;
        }
        let distance = point.distance_squared(goal);
        if best.is_none_or(|(least, _)| distance < least) {
            let mut active = [(0, 0.0); 3];
            for k in 0..size {
                active[k] = (set[k], multipliers[k]);
            }
            let projection = Projection {
                point,
                complete: false,
                rounds: old.rounds + 1,
                active,
                count: size,
            };
            best = Some((distance, projection));
        }
    }
    best.map(|(_, projection)| projection)
}

/// The point on one, two or three planes closest to the goal, and the multipliers of
/// `point = goal + sum of multiplier * normal`; `None` when the planes are dependent.
fn on_planes(goal: DVec3, planes: &[Plane]) -> Option<(DVec3, [f64; 3])> {
    let first = planes[0];
    let lift = first.offset - first.normal.dot(goal);
    let on_first = goal + first.normal * lift;
    let Some(second) = planes.get(1) else {
        return Some((on_first, [lift, 0.0, 0.0]));
    };
    let axis = first.normal.cross(second.normal);
    let sine_squared = axis.length_squared();
    if sine_squared < PARALLEL {
        return None;
    }
    // Along the first plane, straight towards the second: n2 . slide = |n1 x n2|².
    let slide = axis.cross(first.normal);
    let along = (second.offset - second.normal.dot(on_first)) / sine_squared;
    let on_both = on_first + slide * along;
    let Some(third) = planes.get(2) else {
        let offset = on_both - goal;
        let m2 = along;
        let m1 = first.normal.dot(offset) - m2 * first.normal.dot(second.normal);
        return Some((on_both, [m1, m2, 0.0]));
    };
    let determinant = axis.dot(third.normal);
    if determinant * determinant < PARALLEL * sine_squared {
        return None;
    }
    let point = on_both + axis * ((third.offset - third.normal.dot(on_both)) / determinant);
    let offset = point - goal;
    let multipliers = [
        offset.dot(second.normal.cross(third.normal)) / determinant,
        offset.dot(third.normal.cross(first.normal)) / determinant,
        offset.dot(axis) / determinant,
    ];
    Some((point, multipliers))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array)
    }

    /// Reference: the best feasible point over every subset of up to three planes.
    fn by_enumeration(goal: DVec3, planes: &[Plane]) -> Option<DVec3> {
        let n = planes.len();
        let feasible = |p: DVec3| planes.iter().all(|q| q.normal.dot(p) >= q.offset - 1e-9);
        let mut best: Option<DVec3> = feasible(goal).then_some(goal);
        let mut consider = |p: Option<(DVec3, [f64; 3])>| {
            if let Some((p, _)) = p
                && feasible(p)
                && best.is_none_or(|b| p.distance(goal) < b.distance(goal))
            {
                best = Some(p);
            }
        };
        for a in 0..n {
            consider(on_planes(goal, &[planes[a]]));
            for b in a + 1..n {
                consider(on_planes(goal, &[planes[a], planes[b]]));
                for c in b + 1..n {
                    consider(on_planes(goal, &[planes[a], planes[b], planes[c]]));
                }
            }
        }
        best
    }

    proptest! {
        #[test]
        fn equals_enumeration_at_any_scale(
            goal in vector(),
            raw in prop::collection::vec((vector(), -0.5..0.3f64), 0..9),
            exponent in -9..6i32,
        ) {
            let s = 10f64.powi(exponent);
            let planes: Vec<Plane> = raw
                .iter()
                .filter_map(|(n, offset)| Some(Plane { normal: n.try_normalize()?, offset: *offset }))
                .collect();
            let scaled: Vec<Plane> =
                planes.iter().map(|p| Plane { normal: p.normal, offset: p.offset * s }).collect();
            let reference = by_enumeration(goal, &planes);
            let ours = project(goal * s, &scaled);
            prop_assert!(ours.point.is_finite());
            // Planes of nearly one axis meet far away: at 1e4 the error of f64 is above what is
            // asked for below, and `project` may say that the numbers do not allow to find it.
            if let Some(reference) = reference.filter(|found| found.distance(goal) < 1e3) {
                prop_assert!(ours.complete, "a solution exists");
                let ours = ours.point / s;
                prop_assert!((ours.distance(goal) - reference.distance(goal)).abs() < 1e-7);
                prop_assert!(planes.iter().all(|p| p.normal.dot(ours) >= p.offset - 1e-7));
            }
        }
    }

    #[test]
    fn a_wedge_of_any_angle_holds_the_point_inside_both_planes() {
        for exponent in 0..=8 {
            let angle = 10f64.powi(-exponent);
            let planes = [
                Plane {
                    normal: DVec3::Z,
                    offset: 0.0,
                },
                Plane {
                    normal: DVec3::new(angle.sin(), 0.0, angle.cos()),
                    offset: 0.0,
                },
            ];
            let p = project(DVec3::new(-0.3, 0.2, -1.0), &planes).point;
            assert!(p.is_finite());
            for plane in &planes {
                assert!(plane.normal.dot(p) >= -1e-6, "angle {angle}: {p}");
            }
        }
    }
}
