//! Every face of the front within a distance of a point.

use super::{Stack, Surface, Work};
use glam::DVec3;
use shared::ab_tree::Child;
use shared::geometry::{ClosestPoint, closest_point_on_triangle};
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
    let mut stack = Stack::new();
    if let Some(root) = surface.tree.root() {
        stack.push(0.0, root);
    }
    while let Some((_, child)) = stack.pop() {
        match child {
            Child::Face(face) => {
                work.faces += 1;
                let closest = closest_point_on_triangle(surface.mesh.corners(face), point);
                if closest.distance_squared <= bound {
                    visit(face, closest);
                }
            }
            Child::Node(id) => {
                work.nodes += 1;
                let node = surface.tree.node(id);
                let children = node.children();
                for side in [1, 0] {
                    if node.boxes()[side].distance_squared(point) <= bound {
                        stack.push(0.0, children[side]);
                    }
                }
            }
        }
    }
    work
}
