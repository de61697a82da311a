//! The closest point of the front to a point: depth first, the nearer child first.

use super::{Stack, Surface, Work};
use glam::DVec3;
use shared::ab_tree::Child;
use shared::geometry::{ClosestPoint, closest_point_on_triangle};
use shared::spm::Handle;

/// The answer of [`closest_point`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// The face.
    pub face: Handle,
    /// The point on it.
    pub closest: ClosestPoint,
}

/// The closest point of the front, exact in f64; `None` only for an empty front.
///
/// `hint`, an active face, gives the first bound: on a coarse front the loose boxes of base faces would
/// otherwise cost up to 2.5 times (facts of collision).
#[must_use]
pub fn closest_point(
    surface: Surface<'_>,
    point: DVec3,
    hint: Option<Handle>,
) -> (Option<Nearest>, Work) {
    let mut work = Work::default();
    let mut best: Option<Nearest> = None;
    let mut bound = f64::INFINITY;
    let mut try_face = |face: Handle, bound: &mut f64, work: &mut Work| {
        work.faces += 1;
        let closest = closest_point_on_triangle(surface.mesh.corners(face), point);
        if closest.distance_squared < *bound {
            *bound = closest.distance_squared;
            best = Some(Nearest { face, closest });
        }
    };
    if let Some(face) = hint {
        try_face(face, &mut bound, &mut work);
    }
    let mut stack = Stack::new();
    if let Some(root) = surface.tree.root() {
        stack.push(0.0, root);
    }
    while let Some((distance, child)) = stack.pop() {
        if distance >= bound {
            continue;
        }
        match child {
            Child::Face(face) => {
                if hint != Some(face) {
                    try_face(face, &mut bound, &mut work);
                }
            }
            Child::Node(id) => {
                work.nodes += 1;
                let node = surface.tree.node(id);
                let [left, right] = node.boxes().map(|b| b.distance_squared(point));
                let [left_child, right_child] = node.children();
                let (near, far) = if left <= right {
                    ((left, left_child), (right, right_child))
                } else {
                    ((right, right_child), (left, left_child))
                };
                if far.0 < bound {
                    stack.push(far.0, far.1);
                }
                if near.0 < bound {
                    stack.push(near.0, near.1);
                }
            }
        }
    }
    (best, work)
}
