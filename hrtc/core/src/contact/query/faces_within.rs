//! All faces of the front within a distance of a point, the nearer part of the tree first.

use super::{Stack, Surface, Work};
use ab_tree::Child;
use geometry::{BoxBound, BoxQuery, ClosestPoint, closest_point_on_triangle};
use glam::DVec3;
use spm::Handle;

/// Calls `visit` with every face at most `distance` from `point`. `visit` returns the distance from
/// then on, not larger than before.
pub fn faces_within(
    surface: Surface<'_>,
    point: DVec3,
    distance: f64,
    mut visit: impl FnMut(Handle, ClosestPoint) -> f64,
) -> Work {
    let mut work = Work::default();
    let mut bound = distance * distance;
    let query = BoxQuery::point(point);
    let mut box_bound = BoxBound::squared(bound);
    let mut stack = Stack::new();
    let mut next = surface.tree.root();
    while let Some(child) = next {
        next = match child {
            Child::Face(face) => {
                work.faces += 1;
                let closest = closest_point_on_triangle(surface.mesh.corners(face), point);
                if closest.distance_squared <= bound {
                    let distance = visit(face, closest);
                    if distance * distance < bound {
                        bound = distance * distance;
                        box_bound = BoxBound::squared(bound);
                    }
                }
                None
            }
            Child::Node(id) => {
                work.nodes += 1;
                let node = surface.tree.node(id);
                let within = node.boxes().within(&query, box_bound);
                let met = [within.first(), within.second()];
                stack.descend_nearer(met, within.squared(), node.children())
            }
        };
        while next.is_none()
            && let Some((squared, child)) = stack.pop()
        {
            // The bound may have decreased since.
            next = box_bound.includes(squared).then_some(child);
        }
    }
    work
}
