//! How often a closed surface winds around a point.

use super::swept_sphere::misses_box;
use super::{Stack, Surface, Work};
use ab_tree::Child;
use geometry::{BoxQuery, side_of_plane, triangle_is_degenerate};
use glam::DVec3;
use std::cmp::Ordering;

/// Faces that the segment from a point to another leaves through their front, less those that it
/// enters there: where `to` is outside a closed surface, the number of times that this winds around
/// `from`. Exact.
///
/// `None` where the segment meets an edge or a corner, where an end is on a face, or where `most`
/// nodes and faces were examined.
#[must_use]
pub fn winding(surface: Surface<'_>, from: DVec3, to: DVec3, most: u32) -> (Option<i32>, Work) {
    let mut work = Work::default();
    let mut count = 0;
    let path = BoxQuery::between(from.min(to), from.max(to));
    let mut stack = Stack::new();
    let mut next = surface.tree.root();
    while let Some(child) = next {
        if work.nodes + work.faces >= most {
            return (None, work);
        }
        next = match child {
            Child::Face(face) => {
                work.faces += 1;
                let Some(through) = crossing(surface.mesh.corners(face), from, to) else {
                    return (None, work);
                };
                count += through;
                None
            }
            Child::Node(id) => {
                work.nodes += 1;
                let node = surface.tree.node(id);
                let met = node.boxes().overlap(&path);
                let is_in_path =
                    |side: usize| met[side] && !misses_box(&node.boxes().get(side), from, to, 0.0);
                stack.descend([is_in_path(0), is_in_path(1)], node.children())
            }
        };
        if next.is_none() {
            next = stack.pop().map(|(_, child)| child);
        }
    }
    (Some(count), work)
}

/// 1 where a segment leaves through the front of a triangle, -1 where it enters there, 0 where it
/// misses it; `None` where it meets its rim or ends on it.
fn crossing([a, b, c]: [DVec3; 3], from: DVec3, to: DVec3) -> Option<i32> {
    let [start, end] = [from, to].map(|point| side_of_plane(a, b, c, point));
    if start == end && start != Ordering::Equal {
        return Some(0);
    }
    let around = [(a, b), (b, c), (c, a)].map(|(p, q)| side_of_plane(from, to, p, q));
    if around.contains(&Ordering::Greater) && around.contains(&Ordering::Less) {
        return Some(0);
    }
    if triangle_is_degenerate(a, b, c) {
        return Some(0);
    }
    if start == Ordering::Equal || end == Ordering::Equal || around.contains(&Ordering::Equal) {
        return None;
    }
    Some(if start == Ordering::Less { 1 } else { -1 })
}
