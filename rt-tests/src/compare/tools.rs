//! A tool mesh that touches: all pairs of its faces and the surface's that meet.

use super::closest::touches;
use super::full_front::FullFront;
use super::timing::{Timed, time};
use super::{Row, Who};
use crate::failure::Failure;
use crate::fronts::local_front::LocalFront;
use crate::models::{Model, active_triangles};
use crate::peers::parry::Mesh;
use crate::surface::Surface as Full;
use glam::{DQuat, DVec3};
use hrtc::query::{FacePair, Surface, all_pairs};
use hrtc::tool::{Tool, ToolMesh, capsule_mesh};
use rand::Rng;
use shared::geometry::{Pose, Similarity, triangle_pair};
use std::collections::BTreeSet;

/// Radius and length of the capsule, and how deep its tip is, in parts of the diagonal.
const RADIUS: f64 = 0.015;
const LENGTH: f64 = 0.1;
const DEPTH: f64 = 0.003;
/// Points of the path from one pose to the next.
const EVERY: usize = 5;
/// Poses after which the local front is formed anew, and how far around the tip it is refined, parts of the diagonal.
const STRETCH: usize = 10;
const REFINED: f64 = 0.03;
/// Pairs that an answer may have.
const MOST_PAIRS: usize = 4096;

/// The tools by task: faces around and circles.
pub const TOOLS: [(&str, usize, usize); 2] = [("tool240_pairs", 12, 10), ("tool960_pairs", 24, 20)];

/// A row for each contender and tool.
///
/// # Errors
/// When a region cannot be loaded, or parry refuses a tool.
pub fn rows(
    model: &Model,
    full: &Full,
    front: &FullFront,
    [single, double]: [&mut dyn Mesh; 2],
    random: &mut impl Rng,
) -> Result<Vec<Row>, Failure> {
    let diagonal = model.file.model_header().diagonal;
    let poses: Vec<(DVec3, Similarity)> = touches(model, full, random)
        .into_iter()
        .step_by(EVERY)
        .filter_map(|(point, normal)| {
            let pose = Pose {
                position: point + normal * ((0.5 * LENGTH - DEPTH) * diagonal),
                orientation: DQuat::from_rotation_arc(DVec3::Z, normal),
            };
            Some((point, Similarity::new(pose, 1.0)?))
        })
        .collect();
    let (handles, corners) = active_triangles(front.mesh());
    let by_handle: Vec<_> = handles.into_iter().zip(corners).collect();
    let by_place: Vec<_> = (0u32..).zip(model.full_triangles()).collect();
    let mut rows = Vec::new();
    for (task, around, circles) in TOOLS {
        let mesh = capsule_mesh(RADIUS * diagonal, LENGTH * diagonal, around, circles);
        let mut tool = new_tool(model, &mesh)?;
        let mut expect = |faces: &[(u32, [DVec3; 3])]| -> Vec<f64> {
            let mut answer = |(_, pose): &(DVec3, Similarity)| {
                tool.place(pose);
                by_search(faces, &tool)
            };
            poses.iter().map(&mut answer).collect()
        };
        let (of_handles, of_places) = (expect(&by_handle), expect(&by_place));
        single.take_tool(&mesh.positions, &mesh.triangles);
        double.take_tool(&mesh.positions, &mesh.triangles);
        let mut out = vec![FacePair::NONE; MOST_PAIRS];
        let mut ours = |k: usize| ours(front.surface(), &mut tool, &poses[k].1, &mut out);
        let mut of_single = |k: usize| theirs(single, &poses[k].1);
        let mut of_double = |k: usize| theirs(double, &poses[k].1);
        let mut timed = time(
            poses.len(),
            &mut [&mut ours, &mut of_single, &mut of_double],
        );
        let (near, near_expected) = local(model, &mesh, &poses)?;
        timed.insert(0, near);
        let expected = [&near_expected, &of_handles, &of_places, &of_places];
        let who = [Who::OursLocal, Who::OursFull, Who::ParryF32, Who::ParryF64];
        for ((who, timed), expected) in who.into_iter().zip(timed).zip(expected) {
            let differ = timed.differ(expected, 0.0);
            rows.push(Row::new(task, model, who, timed.ns, differ));
        }
    }
    Ok(rows)
}

fn new_tool(model: &Model, mesh: &ToolMesh) -> Result<Tool, Failure> {
    Tool::new(mesh).map_err(|error| Failure::Run(format!("{}: the tool: {error}", model.name)))
}

/// On the front as the controller forms it; what is expected is found on that front as well.
fn local(
    model: &Model,
    mesh: &ToolMesh,
    poses: &[(DVec3, Similarity)],
) -> Result<(Timed, Vec<f64>), Failure> {
    let diagonal = model.file.model_header().diagonal;
    let mut tool = new_tool(model, mesh)?;
    let mut out = vec![FacePair::NONE; MOST_PAIRS];
    let mut front = LocalFront::new(model)?;
    let (mut all, mut expected) = (Timed::default(), Vec::new());
    for stretch in poses.chunks(STRETCH) {
        let cells: BTreeSet<_> = stretch
            .iter()
            .flat_map(|&(point, _)| front.cells_near(point, 0.0, REFINED * diagonal))
            .collect();
        let cells: Vec<_> = cells.into_iter().collect();
        front.want(&cells)?;
        front.settle()?;
        let surface = Surface {
            mesh: front.cache().mesh(),
            tree: front.cache().tree(),
        };
        let (handles, corners) = active_triangles(surface.mesh);
        let faces: Vec<_> = handles.into_iter().zip(corners).collect();
        for (_, pose) in stretch {
            tool.place(pose);
            expected.push(by_search(&faces, &tool));
        }
        let mut query = |k: usize| ours(surface, &mut tool, &stretch[k].1, &mut out);
        let timed = time(stretch.len(), &mut [&mut query]);
        timed.into_iter().for_each(|timed| all.extend(timed));
    }
    Ok((all, expected))
}

/// Moves the tool and finds all pairs.
fn ours(surface: Surface<'_>, tool: &mut Tool, pose: &Similarity, out: &mut [FacePair]) -> f64 {
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

fn theirs(mesh: &mut dyn Mesh, pose: &Similarity) -> f64 {
    let mut digest = Digest::default();
    mesh.tool_pairs(pose, &mut |face, of_tool| {
        digest = digest.with(face, of_tool)
    });
    digest.number()
}

/// Every face of the surface with every face of the tool whose boxes overlap, by exact predicates.
fn by_search(faces: &[(u32, [DVec3; 3])], tool: &Tool) -> f64 {
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
struct Digest(u64);

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
