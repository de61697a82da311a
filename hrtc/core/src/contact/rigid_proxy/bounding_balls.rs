//! Balls that together bound a tool. Perception and prediction use them for the parts of a tool.

use crate::contact::tool::Tool;
use glam::DVec3;

/// Depth of the bisection of the tool.
const HALVINGS: u32 = 4;

/// Largest number of balls.
pub const MAX_BALLS: usize = 1 << HALVINGS;

/// Largest number of pieces into which faces are cut.
const MAX_PIECES: usize = 1 << 16;

/// A ball around a part of the tool's surface; the tool's own frame and units.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct Ball {
    pub centre: DVec3,
    pub radius: f64,
}

/// Balls around the parts of a recursive bisection across the longest side; at most [`MAX_BALLS`].
pub(super) fn bounding_balls(tool: &Tool) -> Vec<Ball> {
    let mut pieces = pieces(tool);
    let mut balls = Vec::with_capacity(MAX_BALLS);
    halve(&mut pieces, HALVINGS, &mut balls);
    balls
}

/// The tool's faces, with long ones cut: a ball around a face as long as a bar would hold mostly
/// air.
fn pieces(tool: &Tool) -> Vec<[DVec3; 3]> {
    let faces = (0..tool.faces()).map(|face| {
        tool.triangle(face)
            .map(|v| tool.local_vertices()[v as usize])
    });
    let mut left: Vec<[DVec3; 3]> = faces.collect();
    let (lower, upper) = box_of(&left);
    let longest = (upper - lower).max_element() / MAX_BALLS as f64;
    let mut pieces = Vec::with_capacity(left.len());
    while let Some([a, b, c]) = left.pop() {
        // ab is the longest edge.
        let edges = [(a, b, c), (b, c, a), (c, a, b)];
        let length = |&(a, b, _): &(DVec3, DVec3, DVec3)| a.distance_squared(b);
        let by_length = |p: &_, q: &_| f64::total_cmp(&length(p), &length(q));
        let (a, b, c) = edges.into_iter().max_by(by_length).unwrap_or((a, b, c));
        let has_room = pieces.len() + left.len() + 2 <= MAX_PIECES;
        if has_room && a.distance(b) > longest {
            let middle = a.midpoint(b);
            left.extend([[a, middle, c], [middle, b, c]]);
        } else {
            pieces.push([a, b, c]);
        }
    }
    pieces
}

fn box_of(pieces: &[[DVec3; 3]]) -> (DVec3, DVec3) {
    let corners = pieces.iter().flatten();
    corners.fold(
        (DVec3::INFINITY, DVec3::NEG_INFINITY),
        |(lower, upper), &p| (lower.min(p), upper.max(p)),
    )
}

fn halve(pieces: &mut [[DVec3; 3]], halvings: u32, balls: &mut Vec<Ball>) {
    let (lower, upper) = box_of(pieces);
    if halvings == 0 || pieces.len() == 1 {
        let centre = 0.5 * (lower + upper);
        let corners = pieces.iter().flatten();
        let radius = corners.fold(0.0f64, |most, p| most.max(p.distance(centre)));
        balls.push(Ball { centre, radius });
        return;
    }
    let axis = (upper - lower).max_position();
    let place = |[a, b, c]: &[DVec3; 3]| (a + b + c)[axis];
    let half = pieces.len() / 2;
    pieces.select_nth_unstable_by(half, |a, b| place(a).total_cmp(&place(b)));
    let (left, right) = pieces.split_at_mut(half);
    halve(left, halvings - 1, balls);
    halve(right, halvings - 1, balls);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::tool::{ToolMesh, capsule_mesh, cylinder_mesh};

    #[test]
    fn every_place_of_a_face_is_in_a_ball() {
        for mesh in [capsule_mesh(1.0, 10.0, 12, 10), cylinder_mesh(1.0, 3.0, 7)] {
            let one = ToolMesh {
                triangles: mesh.triangles[..1].to_vec(),
                ..mesh.clone()
            };
            for mesh in [mesh, one] {
                let tool = Tool::new(&mesh).expect("a tool");
                let balls = bounding_balls(&tool);
                assert!((1..=MAX_BALLS).contains(&balls.len()));
                for face in 0..tool.faces() {
                    let [a, b, c] = tool
                        .triangle(face)
                        .map(|v| tool.local_vertices()[v as usize]);
                    for (k, l) in (0..=20).flat_map(|k| (0..=20 - k).map(move |l| (k, l))) {
                        let place =
                            a + (b - a) * (0.05 * f64::from(k)) + (c - a) * (0.05 * f64::from(l));
                        let is_inside = balls
                            .iter()
                            .any(|ball| place.distance(ball.centre) <= ball.radius * (1.0 + 1e-9));
                        assert!(is_inside, "face {face}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_bar_is_held_by_balls_all_along() {
        let tool = Tool::new(&capsule_mesh(1.0, 40.0, 12, 10)).expect("a tool");
        for ball in bounding_balls(&tool) {
            assert!(ball.radius < 3.0, "{ball:?}");
        }
    }
}
