//! All faces of the front within a distance of a point, the nearer part of the tree first.

use super::{Limit, Stack, Surface, Work};
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
    visit: impl FnMut(Handle, ClosestPoint) -> f64,
) -> Work {
    faces_within_limited(surface, point, distance, &mut u32::MAX.into(), visit).1
}

/// The same, but no node or face is begun beyond the limit. Returns as well a lower bound of the
/// distance of those that were not visited for it: infinite if none.
pub fn faces_within_limited(
    surface: Surface<'_>,
    point: DVec3,
    distance: f64,
    limit: &mut Limit<'_>,
    mut visit: impl FnMut(Handle, ClosestPoint) -> f64,
) -> (f64, Work) {
    let mut work = Work::default();
    let mut bound = distance * distance;
    let query = BoxQuery::point(point);
    let mut box_bound = BoxBound::squared(bound);
    let mut stack = Stack::new();
    let mut next = surface.tree.root();
    while let Some(child) = next {
        if limit.is_reached(work.nodes + work.faces) {
            return (stack.distance_squared(surface, child, point).sqrt(), work);
        }
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
    (f64::INFINITY, work)
}
