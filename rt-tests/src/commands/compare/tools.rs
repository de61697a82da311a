//! A tool mesh that touches: all pairs of its faces and the surface's that meet.

use super::full_front::FullFront;
use super::peers::{Peers, take_turn};
use super::questions::{Questions, ToolQuestions};
use super::row::{Row, Who};
use super::timing::{Caches, Timed, Turns};
use crate::failure::Failure;
use crate::models::local_front::LocalFront;
use crate::models::{Model, active_triangles};
use crate::peers::parry::{Mesh, ToolPose};
use geometry::{Pose, Similarity, triangle_pair};
use glam::{DQuat, DVec3};
use hrtc_core::contact::query::{FacePair, Surface, all_pairs};
use hrtc_core::contact::tool::{Tool, ToolMesh, capsule_mesh};
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::ops::Range;

/// Radius and length of the capsule, and how deep its tip is, in parts of the diagonal.
const RADIUS: f64 = 0.015;
const LENGTH: f64 = 0.1;
const DEPTH: f64 = 0.003;
/// Poses after which the local front is formed anew, and how far around the tip it is refined,
/// parts of the diagonal.
pub const STRETCH: usize = 10;
const REFINED: f64 = 0.03;
/// Pairs that an answer may have.
pub const MAX_PAIRS: usize = 4096;

/// The tools by task: faces around and circles.
pub const TOOLS: [(&str, usize, usize); 2] = [("tool240_pairs", 12, 10), ("tool960_pairs", 24, 20)];

/// A pose of a tool at which it touches.
pub struct Touch {
    /// The point of the surface.
    pub point: DVec3,
    /// The pose.
    pub pose: Pose,
    /// The same, to the frame of the model.
    pub to_query: Similarity,
}

impl Touch {
    /// Of a tool along z with its end so deep in the surface.
    pub fn new((point, normal): (DVec3, DVec3), length: f64, depth: f64) -> Option<Self> {
        let pose = Pose {
            position: point + normal * (0.5 * length - depth),
            orientation: DQuat::from_rotation_arc(DVec3::Z, normal),
        };
        let to_query = Similarity::new(pose, 1.0)?;
        Some(Self {
            point,
            pose,
            to_query,
        })
    }
}

/// How far around a touch a front is refined.
pub fn refined_reach(model: &Model) -> f64 {
    REFINED * model.file.model_header().diagonal
}

/// Forms a front that is refined so far around some touches.
///
/// # Errors
/// When a region cannot be loaded.
pub fn refine(touches: &[Touch], reach: f64, front: &mut LocalFront<'_>) -> Result<(), Failure> {
    let cells: BTreeSet<_> = touches
        .iter()
        .flat_map(|touch| front.cells_near(touch.point, 0.0, reach))
        .collect();
    let cells: Vec<_> = cells.into_iter().collect();
    front.want(&cells)?;
    front.settle()
}

/// The mesh of a tool of [`TOOLS`], its length, and how deep it touches.
pub fn capsule(model: &Model, (_, around, circles): (&str, usize, usize)) -> (ToolMesh, f64, f64) {
    let diagonal = model.file.model_header().diagonal;
    let length = LENGTH * diagonal;
    let mesh = capsule_mesh(RADIUS * diagonal, length, around, circles);
    (mesh, length, DEPTH * diagonal)
}

/// A row for each contender and tool; who is asked by another program answers there.
///
/// # Errors
/// When a region cannot be loaded, parry refuses a tool, or the program fails.
pub fn rows(
    model: &Model,
    asked: &Questions,
    front: &FullFront,
    [single, double]: [&mut dyn Mesh; 2],
    mut peers: Option<&mut Peers<'_>>,
) -> Result<Vec<Row>, Failure> {
    let mut rows = Vec::new();
    for ToolQuestions {
        task,
        mesh,
        poses,
        expected,
    } in &asked.tools
    {
        let turns = Turns {
            caches: Caches::AsLeft,
            count: poses.len(),
            length: STRETCH,
        };
        let mut tool = new_tool(model, mesh)?;
        let mut near = NearFront::new(model, mesh)?;
        single.take_tool(&mesh.positions, &mesh.triangles);
        double.take_tool(&mesh.positions, &mesh.triangles);
        let mut out = vec![FacePair::NONE; MAX_PAIRS];
        // One mesh answers for two.
        let (single, double) = (RefCell::new(&mut *single), RefCell::new(&mut *double));
        let timed = turns.take(
            &mut |turn| near.turn(turns, poses, turn),
            &mut [
                &mut |k| ours(front.surface(), &mut tool, &poses[k].to_query, &mut out),
                &mut |k| theirs(&single, &poses[k].pose, ToolPose::Given),
                &mut |k| theirs(&single, &poses[k].pose, ToolPose::Moved),
                &mut |k| theirs(&double, &poses[k].pose, ToolPose::Given),
                &mut |k| theirs(&double, &poses[k].pose, ToolPose::Moved),
            ],
            &mut |turn| take_turn(&mut peers, task, turn, STRETCH),
        )?;
        for (who, timed) in Who::ALL.into_iter().zip(timed) {
            let expected = match who {
                Who::OursLocal => &near.expected,
                _ => expected,
            };
            let differ = timed.differ(expected, 0.0);
            rows.push(Row::new(task, model, who, timed.ns, differ));
        }
    }
    Ok(rows)
}

pub fn new_tool(model: &Model, mesh: &ToolMesh) -> Result<Tool, Failure> {
    Tool::new(mesh).map_err(|error| Failure::Run(format!("{}: the tool: {error}", model.name)))
}

/// A tool on the front as the controller forms it.
struct NearFront<'a> {
    front: LocalFront<'a>,
    reach: f64,
    tool: Tool,
    out: Vec<FacePair>,
    /// What is expected of the poses so far, found on that front as well.
    expected: Vec<f64>,
}

impl<'a> NearFront<'a> {
    fn new(model: &'a Model, mesh: &ToolMesh) -> Result<Self, Failure> {
        Ok(Self {
            front: LocalFront::new(model)?,
            reach: refined_reach(model),
            tool: new_tool(model, mesh)?,
            out: vec![FacePair::NONE; MAX_PAIRS],
            expected: Vec::new(),
        })
    }

    /// Refines around the poses of a turn, searches for what is expected, and asks ours.
    fn turn(
        &mut self,
        turns: Turns,
        poses: &[Touch],
        turn: Range<usize>,
    ) -> Result<Timed, Failure> {
        refine(&poses[turn.clone()], self.reach, &mut self.front)?;
        let surface = Surface {
            mesh: self.front.cache().mesh(),
            tree: self.front.cache().tree(),
        };
        let (handles, corners) = active_triangles(surface.mesh);
        let faces: Vec<_> = handles.into_iter().zip(corners).collect();
        for touch in &poses[turn.clone()] {
            self.tool.place(&touch.to_query);
            self.expected.push(by_search(&faces, &self.tool));
        }
        let (tool, out) = (&mut self.tool, &mut self.out);
        let mut ask = |k: usize| ours(surface, tool, &poses[k].to_query, out);
        Ok(turns.one(turn, &mut ask))
    }
}

/// Moves the tool and finds all pairs.
pub fn ours(surface: Surface<'_>, tool: &mut Tool, pose: &Similarity, out: &mut [FacePair]) -> f64 {
    tool.place(pose);
    let found = all_pairs(&surface, &*tool, u32::MAX, out);
    if !found.ending.is_complete() {
        return f64::NAN;
    }
    let pairs = out[..found.count].iter();
    pairs
        .fold(Digest::default(), |digest, pair| {
            digest.with(pair.a, pair.b)
        })
        .number()
}

fn theirs(mesh: &RefCell<&mut (dyn Mesh + '_)>, pose: &Pose, how: ToolPose) -> f64 {
    let mut digest = Digest::default();
    mesh.borrow_mut()
        .tool_pairs(pose, how, &mut |face, of_tool| {
            digest = digest.with(face, of_tool)
        });
    digest.number()
}

/// Every face of the surface with every face of the tool whose boxes overlap, by exact predicates.
pub fn by_search(faces: &[(u32, [DVec3; 3])], tool: &Tool) -> f64 {
    let around = |corners: [DVec3; 3]| {
        let [a, b, c] = corners;
        (a.min(b).min(c), a.max(b).max(c))
    };
    let apart = |(low, high): (DVec3, DVec3), (l, h): (DVec3, DVec3)| {
        low.cmpgt(h).any() || high.cmplt(l).any()
    };
    let of_tool: Vec<_> = (0..tool.faces())
        .map(|face| {
            let corners = tool.triangle(face).map(|v| tool.vertices().nth(v as usize));
            corners.map(|corner| corner.unwrap_or(DVec3::NAN))
        })
        .map(|corners| (corners, around(corners)))
        .collect();
    let whole = tool
        .vertices()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
            (low.min(p), high.max(p))
        });
    let mut digest = Digest::default();
    for &(face, corners) in faces {
        let of_face = around(corners);
        if apart(of_face, whole) {
            continue;
        }
        for (k, &(other, of_other)) in (0u32..).zip(&of_tool) {
            if !apart(of_face, of_other) && triangle_pair(corners, other).meets() {
                digest = digest.with(face, k);
            }
        }
    }
    digest.number()
}

/// A set of pairs as one number, whatever their order.
#[derive(Debug, Clone, Copy, Default)]
pub struct Digest(u64);

impl Digest {
    fn with(self, a: u32, b: u32) -> Self {
        // One round of splitmix64 a pair; sums do not ask for the order.
        let mut z = (u64::from(a) << 32 | u64::from(b)).wrapping_add(0x9E37_79B9_7F4A_7C15);
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        Self(self.0.wrapping_add(z ^ z >> 31))
    }

    /// All that a f64 holds exactly of it.
    fn number(self) -> f64 {
        (self.0 >> 11) as f64
    }
}
