//! Every face of the front within a distance of a point.

use super::{Stack, Surface, Work, not_below};
use glam::DVec3;
use shared::ab_tree::Child;
use shared::geometry::{BoxQuery, ClosestPoint, closest_point_on_triangle};
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
    let (query, box_bound) = (BoxQuery::point(point), not_below(bound));
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
                let [left, right] = node.boxes().distances_squared(&query);
                let [left_child, right_child] = node.children();
                if left <= box_bound {
                    if right <= box_bound {
                        stack.push(right, right_child);
                    }
                    Some(left_child)
                } else {
                    (right <= box_bound).then_some(right_child)
                }
            }
        };
        if next.is_none() {
            next = stack.pop().map(|(_, child)| child);
        }
    }
    work
}
