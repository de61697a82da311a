//! Balls that together hold a tool: what feels the surface change, where the tool may touch it next.

use crate::tool::Tool;
use glam::DVec3;
use shared::spm::Handle;

/// Times that the tool is halved, at the most.
const HALVINGS: u32 = 4;

/// Balls at the most.
pub const MOST_BALLS: usize = 1 << HALVINGS;

/// A ball that holds some of the tool's faces; its own frame and units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ball {
    pub centre: DVec3,
    pub radius: f64,
}

/// The balls around the halves of halves of the tool, each split across its longest side; [`MOST_BALLS`] at the most.
pub(super) fn cover(tool: &Tool) -> Vec<Ball> {
    let mut faces: Vec<Handle> = (0..tool.faces()).collect();
    let mut balls = Vec::with_capacity(MOST_BALLS);
    halve(tool, &mut faces, HALVINGS, &mut balls);
    balls
}

fn halve(tool: &Tool, faces: &mut [Handle], halvings: u32, balls: &mut Vec<Ball>) {
    let corners = |face: Handle| tool.triangle(face).map(|v| tool.rest()[v as usize]);
    let all = || faces.iter().flat_map(|&face| corners(face));
    let lower = all().fold(DVec3::INFINITY, DVec3::min);
    let upper = all().fold(DVec3::NEG_INFINITY, DVec3::max);
    if halvings == 0 || faces.len() == 1 {
        let centre = 0.5 * (lower + upper);
        let radius = all().fold(0.0f64, |most, p| most.max(p.distance(centre)));
        balls.push(Ball { centre, radius });
        return;
    }
    let axis = (upper - lower).max_position();
    let place = |face: Handle| corners(face).iter().sum::<DVec3>()[axis];
    let half = faces.len() / 2;
    faces.select_nth_unstable_by(half, |&a, &b| place(a).total_cmp(&place(b)).then(a.cmp(&b)));
    let (left, right) = faces.split_at_mut(half);
    halve(tool, left, halvings - 1, balls);
    halve(tool, right, halvings - 1, balls);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tool::{ToolMesh, capsule_mesh, cylinder_mesh};

    #[test]
    fn every_corner_is_in_a_ball_with_all_of_its_face() {
        for mesh in [capsule_mesh(1.0, 10.0, 12, 10), cylinder_mesh(1.0, 3.0, 7)] {
            let one = ToolMesh {
                triangles: mesh.triangles[..1].to_vec(),
                ..mesh.clone()
            };
            for mesh in [mesh, one] {
                let tool = Tool::new(&mesh).expect("a tool");
                let balls = cover(&tool);
                assert!((1..=MOST_BALLS).contains(&balls.len()));
                for face in 0..tool.faces() {
                    let corners = tool.triangle(face).map(|v| tool.rest()[v as usize]);
                    let held = balls.iter().any(|ball| {
                        let most = ball.radius * (1.0 + 1e-12);
                        corners.iter().all(|p| p.distance(ball.centre) <= most)
                    });
                    assert!(held, "face {face}");
                }
            }
        }
    }
}
