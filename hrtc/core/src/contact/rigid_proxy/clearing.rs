//! Whether the tool is clear of the surface, and what happens while it is not: at its start, and
//! where the surface moved into it.

use super::mesh_change::MeshChange;
use super::{FACES_MOVED, State, TESTED, ToolAdvance, ToolProxy};
use crate::contact::motion::Placement;
use crate::contact::query::{Body, Surface, first_pair, winding};
use crate::contact::tool::{RelativePath, for_each_face_near};
use geometry::{Similarity, triangle_pair};
use glam::DVec3;

/// Time for which a tool stays where the surface moved into it, seconds: longer than a place is
/// refined under a hand, and short for somebody who pulls.
const HELD_S: f64 = 1.0;

/// Directions to all sides, none of them along an axis, a diagonal or a plane of a grid: a point
/// within a closed surface is within it along each, and one before an open surface is not.
const OUTWARDS: [DVec3; 4] = [
    DVec3::new(0.871, 0.313, 0.379),
    DVec3::new(-0.732, 0.593, -0.336),
    DVec3::new(-0.217, -0.611, 0.761),
    DVec3::new(0.123, -0.457, -0.881),
];

impl ToolProxy {
    /// Whether the tool meets the surface; `None` if the budget does not suffice.
    fn meets(
        &mut self,
        surface: Surface<'_>,
        at: &Placement,
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> Option<bool> {
        self.put_tool(at);
        answer.spent += self.tool.faces() / FACES_MOVED;
        // Here a node pair costs half; the rest pays for the face pairs below it.
        let most = budget.saturating_sub(answer.spent);
        let (pair, ending, work) = first_pair(&surface, &self.tool, most, None);
        answer.work.add(work);
        answer.spent += work.node_pairs + TESTED * work.faces;
        if pair.is_none() && !ending.is_complete() {
            answer.ending = ending;
            return None;
        }
        Some(pair.is_some())
    }

    /// Whether the tool, clear before, meets a changed face; `None` if the budget does not suffice.
    fn meets_what_changed(
        &mut self,
        surface: Surface<'_>,
        mesh_change: &MeshChange,
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> Option<bool> {
        let (here, to_query) = (self.at, Similarity::new(self.pose_at(&self.at), self.scale));
        let (Some(changed), Some(to_query)) = (mesh_change.changed(), to_query) else {
            return self.meets(surface, &here, budget, answer);
        };
        let path = RelativePath::new([here.centre; 2], [here.rotation(); 2]);
        let (mut is_met, mut tested) = (false, 0);
        for &face in changed.iter().filter(|&&face| surface.has(face)) {
            let corners = surface.corners(face);
            let cost = for_each_face_near(&self.shape.blocks, &path, corners, 0.0, |own| {
                let corners_of_tool = self
                    .tool
                    .triangle(own)
                    .map(|v| self.tool.local_vertices()[v as usize]);
                tested += 1;
                is_met = triangle_pair(corners, corners_of_tool.map(|p| to_query.point(p))).meets();
                !is_met
            });
            answer.spent += cost;
            if is_met {
                break;
            }
        }
        answer.work.faces += tested;
        answer.spent += TESTED * tested;
        Some(is_met)
    }

    /// Moves the tool's mesh to a placement.
    fn put_tool(&mut self, at: &Placement) {
        if let Some(to_query) = Similarity::new(self.pose_at(at), self.scale) {
            self.tool.place(&to_query);
        }
    }

    /// Whether a tool that does not meet the surface is within a closed one, by its first vertex:
    /// a tool is taken to be in one piece. `None` if the budget does not suffice.
    fn is_within(
        &self,
        surface: Surface<'_>,
        at: &Placement,
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> Option<bool> {
        let from = at.centre + at.orientation * self.shape.points[0];
        let aabb = surface.root_box();
        let (lower, upper) = (aabb.lower.as_dvec3(), aabb.upper.as_dvec3());
        // Twice the farthest corner: beyond all of the surface.
        let out = 2.0 * (from - lower).abs().max((upper - from).abs()).length();
        let mut is_within = None;
        for direction in OUTWARDS {
            let most = budget.saturating_sub(answer.spent) / TESTED;
            let to = from + direction * out;
            let (count, work) = winding(surface, from, to, most);
            answer.spent += work.nodes + TESTED * work.faces;
            if work.nodes + work.faces >= most {
                return None;
            }
            // A ray through an edge tells nothing.
            match count {
                Some(count) if count > 0 => is_within = Some(true),
                Some(_) => return Some(false),
                None => {}
            }
        }
        is_within.or(Some(false))
    }

    /// Moves with the device, without force, until the tool is clear of the surface there: it
    /// meets no face and is not within a closed surface.
    pub(super) fn begin_when_clear(
        &mut self,
        surface: Surface<'_>,
        budget: u32,
        answer: &mut ToolAdvance,
    ) {
        self.at = self.goal;
        self.device_travel = 0.0;
        let goal = self.goal;
        let clear = self.meets(surface, &goal, budget, answer) == Some(false)
            && self.is_within(surface, &goal, budget, answer) == Some(false);
        if clear {
            self.set_clear();
        }
    }

    /// Stays where the surface moved into the tool until the surface lets it go, since no motion
    /// from there can be swept: then it follows the device again, from there. After [`HELD_S`] it
    /// begins anew with the device, so that nobody pulls at a tool that is held for good.
    pub(super) fn stay_until_clear(
        &mut self,
        surface: Surface<'_>,
        budget: u32,
        answer: &mut ToolAdvance,
    ) {
        self.stuck_ticks += 1;
        self.stuck_for += 1;
        answer.is_unsettled = true;
        let here = self.at;
        if self.meets(surface, &here, budget, answer) == Some(false) {
            self.set_clear();
        } else if f64::from(self.stuck_for) * self.imperceptible.period_s >= HELD_S {
            self.state = State::Inside;
        }
    }

    /// No face of the tool meets the surface, and nothing else is known.
    fn set_clear(&mut self) {
        self.state = State::Clear;
        self.invalidate();
        self.contacts.clear();
    }

    /// After a change of the surface: if it meets the tool, moves the tool out on its side. False
    /// if the budget does not suffice to decide.
    pub(super) fn depenetrate(
        &mut self,
        surface: Surface<'_>,
        mesh_change: &MeshChange,
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> bool {
        let here = self.at;
        match self.meets_what_changed(surface, mesh_change, budget, answer) {
            Some(true) => {}
            known => return known.is_some(),
        }
        for escape in mesh_change.escapes(self.static_offset(), self.moving_offset) {
            let out = Placement {
                centre: here.centre + escape,
                ..here
            };
            match self.meets(surface, &out, budget, answer) {
                Some(true) => {}
                None => return false,
                Some(false) => {
                    self.near.spend(&out, &here.to(&out), self.shape.radius);
                    self.at = out;
                    return true;
                }
            }
        }
        self.state = State::Stuck;
        self.stuck_for = 0;
        true
    }
}
