//! Every face of the front within a distance of a point.

use super::{Stack, Surface, Work};
use glam::DVec3;
use shared::ab_tree::Child;
use shared::geometry::{BoxBound, BoxQuery, ClosestPoint, closest_point_on_triangle};
use shared::spm::Handle;

/// Calls `visit` with every face whose distance to `point` is at most `distance`, in tree order.
pub fn faces_within(
    surface: Surface<'_>,
    point: DVec3,
    distance: f64,
    mut visit: impl FnMut(Handle, ClosestPoint),
) -> Work {
    let mut work = Work::default();
    let bound = distance * distance;
    let (query, box_bound) = (BoxQuery::point(point), BoxBound::squared(bound));
    let mut stack = Stack::new();
    let mut next = surface.tree.root();
    while let Some(child) = next {
        next = match child {
            Child::Face(face) => {
                work.faces += 1;
                let closest = closest_point_on_triangle(surface.mesh.corners(face), point);
                if closest.distance_squared <= bound {
                    visit(face, closest);
                }
                None
            }
            Child::Node(id) => {
                work.nodes += 1;
                let node = surface.tree.node(id);
                let within = node.boxes().within(&query, box_bound);
                stack.descend([within.first(), within.second()], node.children())
            }
        };
        if next.is_none() {
            next = stack.pop().map(|(_, child)| child);
        }
    }
    work
}
