//! A spring to a point, or to the nearest point c of a path: `F = k (c - x) - b v`, up to a
//! maximum.
//!
//! The nearest point on a path is tracked along it from the last one. Where another part of the
//! path comes near, the force does not jump to it.

use glam::DVec3;
use scene::SpringPlan;

/// A spring and its place on the path.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Spring {
    plan: SpringPlan,
    /// Segment of the path with the last nearest point; `None` before the first tick.
    piece: Option<usize>,
}

impl Spring {
    /// The first tick attaches it to the nearest point of the whole path. A point that is repeated
    /// counts once: its segment without length is no nearer than the one before, and would hold the
    /// spring.
    #[must_use]
    pub fn new(mut plan: SpringPlan) -> Self {
        plan.path_m.dedup();
        Self { plan, piece: None }
    }

    /// The next position attaches it anew.
    pub fn go_to_new_place(&mut self) {
        self.piece = None;
    }

    /// Force (newtons) at a position (metres) with a velocity (m/s), world.
    pub fn force(&mut self, position: DVec3, velocity: DVec3) -> DVec3 {
        let force = (self.nearest(position) - position) * self.plan.stiffness_n_per_m
            - velocity * self.plan.damping_ns_per_m;
        force.clamp_length_max(self.plan.force_max_n)
    }

    fn nearest(&mut self, position: DVec3) -> DVec3 {
        let path = &self.plan.path_m;
        let last = path.len().saturating_sub(2);
        let on = |piece: usize| {
            let (a, b) = (path[piece], path[(piece + 1).min(path.len() - 1)]);
            let along = b - a;
            let share = (position - a).dot(along) / along.length_squared();
            // A path of a single point is one segment without length.
            let share = if share.is_finite() { share } else { 0.0 };
            a + along * share.clamp(0.0, 1.0)
        };
        let squared = |piece: usize| on(piece).distance_squared(position);
        let mut piece = self.piece.unwrap_or(0);
        let mut least = squared(piece);
        if self.piece.is_none() {
            for other in 1..=last {
                let there = squared(other);
                if there < least {
                    (piece, least) = (other, there);
                }
            }
        }
        // A path that ends where it begins goes on there.
        let is_closed = path.len() > 2 && path.first() == path.last();
        let beside = |piece: usize, is_ahead: bool| match (is_closed, is_ahead) {
            (true, false) => (piece + last) % (last + 1),
            (true, true) => (piece + 1) % (last + 1),
            (false, false) => piece.saturating_sub(1),
            (false, true) => (piece + 1).min(last),
        };
        let from = piece;
        for is_ahead in [false, true] {
            // Each is nearer, so none comes twice: what was passed is looked at once, at the most
            // all of the path.
            for _ in 0..last {
                let next = beside(piece, is_ahead);
                let there = squared(next);
                if there >= least {
                    break;
                }
                (piece, least) = (next, there);
            }
            if piece != from {
                // The other side is where it came from.
                break;
            }
        }
        self.piece = Some(piece);
        on(piece)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spring(path_m: Vec<DVec3>) -> Spring {
        Spring::new(SpringPlan {
            path_m,
            stiffness_n_per_m: 100.0,
            damping_ns_per_m: 0.0,
            force_max_n: 5.0,
        })
    }

    #[test]
    fn the_force_is_proportional_up_to_its_maximum() {
        let mut to_point = spring(vec![DVec3::X]);
        let near = to_point.force(DVec3::X * 0.99, DVec3::ZERO);
        assert!(near.distance(DVec3::X) < 1e-9);
        let far = to_point.force(DVec3::ZERO, DVec3::ZERO);
        assert!(far.distance(DVec3::X * 5.0) < 1e-9);
    }

    #[test]
    fn the_nearest_point_is_tracked_along_the_path() {
        // A hairpin of short segments; its two legs are near each other.
        let leg = |y: f64| (0..=50).map(move |k| DVec3::new(0.01 * f64::from(k), y, 0.0));
        let path: Vec<DVec3> = leg(0.0)
            .chain(leg(0.01).collect::<Vec<_>>().into_iter().rev())
            .collect();
        let mut held = spring(path);
        held.force(DVec3::ZERO, DVec3::ZERO);
        // The position is nearer to the second leg, but the spring stays on the first.
        let mut force = DVec3::ZERO;
        for k in 0..200 {
            let x = 0.001 * f64::from(k);
            force = held.force(DVec3::new(x, 0.008, 0.0), DVec3::ZERO);
        }
        assert!((force.y + 0.8).abs() < 1e-9, "{force}");
    }

    /// A path of 4096 points, 0.05 mm apart, and a hand that passes 24 of them in a tick, and
    /// thousands of them after a stall.
    #[test]
    fn a_fine_path_does_not_hold_back_a_hand_that_follows_it() {
        let path = (0..4096).map(|k| DVec3::X * (5e-5 * f64::from(k)));
        let mut held = spring(path.collect());
        for k in (0..=170).chain([3, 160]) {
            let force = held.force(DVec3::X * (1.2e-3 * f64::from(k)), DVec3::ZERO);
            assert!(force.length() < 1e-9, "{k}: {force}");
        }
    }

    #[test]
    fn at_a_new_place_it_is_attached_to_the_nearest_point() {
        // The other leg of a hairpin is 10 mm away.
        let turn = [
            DVec3::ZERO,
            DVec3::X,
            DVec3::new(1.0, 0.01, 0.0),
            DVec3::Y * 0.01,
        ];
        let mut held = spring(turn.to_vec());
        held.force(DVec3::ZERO, DVec3::ZERO);
        held.go_to_new_place();
        let force = held.force(DVec3::new(0.1, 0.01, 0.0), DVec3::ZERO);
        assert!(force.length() < 1e-9, "{force}");
    }

    #[test]
    fn a_closed_path_has_no_seam() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::ONE, DVec3::Y, DVec3::ZERO];
        let mut held = spring(corners.map(|of| of.with_z(0.0) * 0.1).to_vec());
        // Twice around, and back.
        let at = |k: i32| {
            let along = f64::from(k.rem_euclid(400)) / 100.0;
            let (side, share) = (along as usize, along.fract());
            corners[side].lerp(corners[side + 1], share).with_z(0.0) * 0.1
        };
        for k in (0..=800).chain((-800..800).rev()) {
            let force = held.force(at(k), DVec3::ZERO);
            assert!(force.length() < 1e-9, "{k}: {force}");
        }
    }

    #[test]
    fn a_repeated_point_does_not_hold_the_spring() {
        let mut twice = spring(vec![DVec3::ONE, DVec3::ONE]);
        assert!(twice.force(DVec3::ZERO, DVec3::ZERO).is_finite());
        let point = |k: i32| DVec3::X * (0.01 * f64::from(k / 3));
        let mut held = spring((0..30).map(point).collect());
        for k in 0..=90 {
            let position = DVec3::new(0.001 * f64::from(k), 0.001, 0.0);
            let force = held.force(position, DVec3::ZERO);
            assert!(force.distance(DVec3::NEG_Y * 0.1) < 1e-9, "{k}: {force}");
        }
    }
}
