//! Whether the tool meets the surface, and how it gets out of what a change of the surface moved
//! into it or over it.
//!
//! A tool that the surface met has no free way out, since it meets faces along all of it. What
//! tells on which side it belongs is one point of it, its anchor. The surface takes the anchor
//! along when it passes over it. Where a straight way from the anchor to its place in the tool
//! elsewhere passes through no face, and the tool meets none there, the tool is on its side as a
//! whole. Where no such place is known the tool is stuck: it stays, and the next ticks ask for the
//! device's.

use super::contacts::PASSED;
use super::look_ahead_tube::LookAheadTube;
use super::mesh_change::MeshChange;
use super::neighbourhood::PLACED;
use super::{State, ToolAdvance, ToolProxy};
use crate::contact::carried::carried;
use crate::contact::motion::{Placement, Twist};
use crate::contact::query::{Body, Ending, Surface, swept_sphere_budget};
use crate::contact::tool::{RelativePath, for_each_face_near};
use crate::tuning::probe::PAIRS_A_UNIT;
use geometry::{Similarity, triangle_pair};
use glam::DVec3;
use spm::{ActiveMesh, OperationFaces};

/// Cost of a pair of faces tested, in node pairs (measured).
const TESTED: u32 = 3;
/// Distance beyond a surface that has passed over the anchor, and the distance from faces that its
/// way keeps, as fractions of the contact offset. A tool that meets nothing keeps half of it.
const ANCHOR_BEYOND: f64 = 0.1;
const ANCHOR_RADIUS: f64 = 0.01;

/// Escapes that were tried for a tool that meets the surface, as long as the surface stays.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub(super) struct EscapesTried {
    count: usize,
    /// [`ToolProxy::moving_offset`] when they began: it decays, and they are as long as it was.
    moving_offset: f64,
    /// The side on which the tool belongs, as known when they began.
    side: DVec3,
}

impl ToolProxy {
    /// Takes the anchor along with a split or collapse if that passed over it.
    pub(super) fn carry_anchor(&mut self, mesh: &ActiveMesh, operation: &OperationFaces) -> bool {
        let beyond = ANCHOR_BEYOND * self.static_offset();
        let carried = carried(mesh, operation, self.anchor(), beyond);
        self.carried_anchor = carried.or(self.carried_anchor);
        carried.is_some()
    }

    fn anchor(&self) -> DVec3 {
        let at_tool = || self.anchor_at(&self.at);
        self.carried_anchor.unwrap_or_else(at_tool)
    }

    /// The anchor's place in the tool at a placement.
    fn anchor_at(&self, at: &Placement) -> DVec3 {
        at.centre + at.orientation * self.shape.points[self.shape.anchor as usize]
    }

    /// The normal of a face on the side of the anchor; zero for a face without one.
    fn side_of_anchor(&self, [a, b, c]: [DVec3; 3]) -> DVec3 {
        let normal = (b - a).cross(c - a).normalize_or_zero();
        normal * normal.dot(self.anchor() - a).signum()
    }

    /// Whether a way of the anchor to its place in the tool at a placement passes through no face:
    /// straight, or by the tool's centre here and there. `None` if the budget does not suffice.
    fn reaches(
        &self,
        surface: Surface<'_>,
        there: &Placement,
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> Option<bool> {
        if *there == self.at && self.carried_anchor.is_none() {
            return Some(true);
        }
        let [start, end] = [self.anchor(), self.anchor_at(there)];
        let by_centre = [start, self.at.centre, there.centre, end];
        for path in [&[start, end][..], &by_centre] {
            if self.is_free(surface, path, budget, answer)? {
                return Some(true);
            }
        }
        Some(false)
    }

    /// Whether a path through these points passes through no face; `None` if the budget does not
    /// suffice.
    fn is_free(
        &self,
        surface: Surface<'_>,
        path: &[DVec3],
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> Option<bool> {
        let radius = ANCHOR_RADIUS * self.static_offset();
        for ends in path.windows(2) {
            let motion = ends[1] - ends[0];
            let most = budget.saturating_sub(answer.spent) / PAIRS_A_UNIT;
            let (hit, free, work) = swept_sphere_budget(surface, (ends[0], motion), radius, most);
            answer.spent += PAIRS_A_UNIT * (work.nodes + work.faces);
            match hit {
                Some(_) => return Some(false),
                None if free < 1.0 => return answer.run_out(),
                None => {}
            }
        }
        Some(true)
    }

    /// Begins where the tool was placed if it is clear of the surface there, else at the device,
    /// also where no tick could decide. False if a later tick may.
    pub(super) fn begin_where_placed(
        &mut self,
        surface: Surface<'_>,
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> bool {
        let start = self.at;
        let was_known = self.near.tube.left() > 0.0;
        let is_met = self.meets(surface, &start, budget, answer);
        if is_met == Some(false) {
            self.come_out_at(&start);
            self.contacts.clear();
        }
        // Candidates that a tick has collected are tested by the next one, with all of its budget.
        let is_new = !was_known && self.near.tube.left() > 0.0;
        let goes_on = self.near.has_partial_collection() || is_new;
        if is_met.is_none() && goes_on {
            return false;
        }
        self.is_placed_anew = false;
        self.near.invalidate_all();
        self.has_unused_collection = false;
        true
    }

    /// Moves to the device if the tool is clear of the surface there, and if it is on its side.
    pub(super) fn jump_when_clear(
        &mut self,
        surface: Surface<'_>,
        budget: u32,
        answer: &mut ToolAdvance,
    ) {
        let goal = self.goal;
        let is_held = self.state == State::Stuck
            && self.reaches(surface, &goal, budget, answer) != Some(true);
        // A collection that the last tick began is gone on with while the device rests. Around a
        // tool that is stuck elsewhere, changes would not be noted.
        if self.state == State::Stuck || !self.near.has_partial_collection() {
            self.near.invalidate_all();
        }
        let clear = !is_held && self.meets(surface, &goal, budget, answer) == Some(false);
        if clear || self.state == State::Inside {
            self.at = goal;
            self.device_travel = 0.0;
        }
        if clear {
            self.come_out_at(&goal);
            self.contacts.clear();
        }
        if self.state != State::Inside || !self.near.has_partial_collection() {
            self.near.invalidate_all();
        }
        self.has_unused_collection = false;
    }

    /// After a change of the surface: if it meets the tool or has passed over it, moves the tool
    /// out on its side. False if the budget does not suffice to decide. `first_changed`: where the
    /// candidate pairs of changed faces begin, if all candidates are known.
    pub(super) fn depenetrate(
        &mut self,
        surface: Surface<'_>,
        (mesh_change, first_changed): (&MeshChange, Option<usize>),
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> bool {
        let here = self.at;
        let tried = match self.escapes_tried.take() {
            Some(tried) => tried,
            None => {
                // Not only what changed where an earlier tick could not decide.
                let first = |first| if mesh_change.is_undecided() { 0 } else { first };
                let is_met = match first_changed.map(first) {
                    Some(first) => self.meets_candidates(first, &here, budget, answer),
                    // It met other faces, too.
                    None if self.state == State::Stuck => {
                        self.meets(surface, &here, budget, answer)
                    }
                    None => self.meets_what_changed(surface, mesh_change, budget, answer),
                };
                let is_out = match is_met {
                    Some(false) => self.reaches(surface, &here, budget, answer),
                    Some(true) => Some(false),
                    None => None,
                };
                match is_out {
                    Some(true) => {
                        self.come_out_at(&here);
                        return true;
                    }
                    Some(false) => EscapesTried {
                        count: 0,
                        moving_offset: self.moving_offset,
                        side: self.side(),
                    },
                    None => return false,
                }
            }
        };
        self.escape(surface, (mesh_change, tried), budget, answer)
    }

    /// The side on which the tool belongs: that of its contacts, else where the surface has carried
    /// its anchor, else of the face that it meets.
    fn side(&self) -> DVec3 {
        let normals = self.contacts.all().iter().map(|contact| contact.normal);
        let held_by: DVec3 = normals.sum();
        let carried = self.anchor() - self.anchor_at(&self.at);
        let sides = [held_by, carried].map(|side| side.try_normalize());
        sides[0].or(sides[1]).unwrap_or(self.met_on)
    }

    /// Moves the tool, which meets the surface or is beyond it, out on its side: as far as needed,
    /// by the escapes that no tick has tried. Stuck where none remains; false if the budget does
    /// not suffice for all.
    fn escape(
        &mut self,
        surface: Surface<'_>,
        (mesh_change, tried): (&MeshChange, EscapesTried),
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> bool {
        let here = self.at;
        let offsets = [self.static_offset(), tried.moving_offset];
        let escapes = mesh_change.escapes(offsets, tried.side);
        for (count, escape) in escapes.enumerate().skip(tried.count) {
            let out = Placement {
                centre: here.centre + escape,
                ..here
            };
            let path = here.to(&out);
            let is_held = match self.reaches(surface, &out, budget, answer) {
                Some(true) if self.near.tube.covers(&here, &path, 0.0) => {
                    self.meets_candidates(0, &out, budget, answer)
                }
                Some(true) => self.meets(surface, &out, budget, answer),
                other => other.map(|reaches| !reaches),
            };
            match is_held {
                Some(false) => {
                    self.near.spend(&out, &path, self.shape.radius);
                    self.come_out_at(&out);
                    return true;
                }
                Some(true) => {}
                None => {
                    self.escapes_tried = Some(EscapesTried { count, ..tried });
                    // The pairs may be those around an escape; the tool stays here.
                    self.near.move_to(&here);
                    return false;
                }
            }
        }
        self.state = State::Stuck;
        true
    }

    fn come_out_at(&mut self, at: &Placement) {
        self.at = *at;
        self.state = State::Clear;
        self.carried_anchor = None;
    }

    /// Whether the tool at a placement that the candidates cover meets one of them, from `first`
    /// on; `None` if the budget does not suffice.
    fn meets_candidates(
        &mut self,
        first: usize,
        at: &Placement,
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> Option<bool> {
        let placed = self.near.vertex_count() / PLACED;
        if answer.spent + placed > budget {
            return answer.run_out();
        }
        answer.spent += placed;
        self.near.place(&self.shape, at);
        for pair in &self.near.pairs[first..] {
            if answer.spent + PASSED + TESTED > budget {
                return answer.run_out();
            }
            answer.spent += PASSED;
            let own = self.near.corners(&self.shape, pair.tool);
            if self.near.apart_now(pair, own) > 0.0 {
                continue;
            }
            answer.spent += TESTED;
            answer.work.faces += 1;
            let face = self.near.faces[pair.surface as usize].corners;
            if triangle_pair(face, own).meets() {
                self.met_on = self.side_of_anchor(face);
                return Some(true);
            }
        }
        Some(false)
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
        let changed = mesh_change
            .changed()
            .filter(|_| !mesh_change.is_undecided());
        let (Some(changed), Some(to_query)) = (changed, to_query) else {
            return self.meets(surface, &here, budget, answer);
        };
        let path = RelativePath::new([here.centre; 2], [here.rotation(); 2]);
        let mut is_met = false;
        for &face in changed.iter().filter(|&&face| surface.has(face)) {
            let corners = surface.corners(face);
            let limits = [budget.saturating_sub(answer.spent), TESTED];
            let meets = |own| {
                let corners_of_tool = self
                    .tool
                    .triangle(own)
                    .map(|v| self.tool.local_vertices()[v as usize]);
                answer.work.faces += 1;
                let own = corners_of_tool.map(|p| to_query.point(p));
                is_met = triangle_pair(corners, own).meets();
                !is_met
            };
            let blocks = &self.shape.blocks;
            let (cost, is_all) = for_each_face_near(blocks, &path, corners, 0.0, limits, meets);
            answer.spent += cost;
            if is_met {
                self.met_on = self.side_of_anchor(corners);
                return Some(true);
            }
            if !is_all {
                return answer.run_out();
            }
        }
        Some(false)
    }

    /// Whether the tool meets the surface at a placement, whose candidates it collects; `None` if
    /// the budget does not suffice. The next tick continues if it asks for the same placement and
    /// the pairs are not invalidated.
    fn meets(
        &mut self,
        surface: Surface<'_>,
        at: &Placement,
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> Option<bool> {
        let still = Twist::default();
        let margin = self.static_offset();
        if !self.near.tube.covers(at, &still, 0.0) {
            let tube = LookAheadTube::along(*at, still, 0.0, margin, &self.shape);
            // What the candidates cost, too, once they are known.
            let most = budget.saturating_sub(answer.spent) / 2;
            let (ending, work) = self
                .near
                .collect(surface, &self.shape, tube, &mut most.into());
            answer.work.add(work);
            answer.spent += work.cost();
            if self.near.tube.left() <= 0.0 {
                answer.ending = match ending {
                    Ending::Complete => Ending::Stopped { unvisited: 0 },
                    other => other,
                };
                return None;
            }
        }
        self.meets_candidates(0, at, budget, answer)
    }
}
