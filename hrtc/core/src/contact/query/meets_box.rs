//! Whether a body may meet a box, by the boxes of its faces.

use super::{Body, Stack};
use ab_tree::Child;
use geometry::BoxQuery;
use glam::DVec3;

/// Whether the box of any face of the body meets the box from `lower` to `upper`, in the query's frame. A body of a single
/// face has no boxes and always may.
#[must_use]
pub fn meets_box(body: &impl Body, lower: DVec3, upper: DVec3) -> bool {
    let query = BoxQuery::between(lower, upper);
    let mut next = body.root();
    let mut stack = Stack::new();
    while let Some(child) = next {
        next = match child {
            Child::Face(_) => return true,
            Child::Node(id) => {
                let (children, boxes) = body.children(id);
                stack.descend(boxes.overlap(&query), children)
            }
        };
        if next.is_none() {
            next = stack.pop().map(|(_, child)| child);
        }
    }
    false
}
