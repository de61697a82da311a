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
use crate::contact::query::{Body, Ending, Limit, Surface, swept_sphere_budget};
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

/// Escapes that were tried for a tool that meets the surface, and the one that is next.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub(super) struct EscapesTried {
    /// Number of the next one, from the first on again after the last.
    next: usize,
    /// How many were held since the surface has changed: that of all is a full round.
    held: usize,
    /// The next one, if a tick has begun to look around there: its length may change with the
    /// surface, but what is collected is around this place.
    looking_at: Option<DVec3>,
    /// [`ToolProxy::moving_offset`] when they began: it decays, and they are as long as it was.
    moving_offset: f64,
    /// The side on which the tool belongs, as known when they began.
    side: DVec3,
}

impl EscapesTried {
    /// The surface has changed: what was held may be free now. The next ones still come first,
    /// since otherwise the later ones would have to wait until it rests.
    pub(super) fn begin_round(&mut self) {
        self.held = 0;
    }
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
        limit: &mut Limit<'_>,
        answer: &mut ToolAdvance,
    ) -> bool {
        let start = self.at;
        let was_known = self.near.tube.left() > 0.0;
        let is_met = self.meets(surface, &start, limit, answer);
        if is_met == Some(false) {
            self.come_out_at(&start);
            self.contacts.clear();
        }
        if is_met.is_none() && self.goes_on(was_known) {
            return false;
        }
        self.is_placed_anew = false;
        self.near.invalidate_all();
        self.has_unused_collection = false;
        true
    }

    /// Whether the next tick may tell what this one could not: a collection is unfinished, or new,
    /// so that its candidates are tested by the next tick, with all of its budget.
    fn goes_on(&self, was_known: bool) -> bool {
        let is_new = !was_known && self.near.tube.left() > 0.0;
        self.near.has_partial_collection() || is_new
    }

    /// Moves to the device if the tool is clear of the surface there, and if it is on its side.
    /// Where that takes several ticks, to where the device was when they began: it may move.
    pub(super) fn jump_when_clear(
        &mut self,
        surface: Surface<'_>,
        limit: &mut Limit<'_>,
        answer: &mut ToolAdvance,
    ) {
        let earlier = self.jump_to.take();
        if let Some(there) = &earlier {
            self.near.tube.move_to(there);
        }
        let is_known = self.near.tube.left() > 0.0 || self.near.has_partial_collection();
        let earlier = earlier.filter(|_| is_known);
        let there = earlier.unwrap_or(self.goal);
        let is_held = self.state == State::Stuck
            && self.reaches(surface, &there, limit.max_work(), answer) != Some(true);
        if is_held || earlier.is_none() {
            self.near.invalidate_all();
        }
        let was_known = self.near.tube.left() > 0.0;
        let is_met = if is_held {
            Some(true)
        } else {
            self.meets(surface, &there, limit, answer)
        };
        if is_met == Some(false) {
            self.come_out_at(&there);
            self.contacts.clear();
            self.device_travel = there.to(&self.goal).farthest(self.shape.radius);
        } else if self.state == State::Inside {
            self.at = self.goal;
            self.device_travel = 0.0;
        }
        if is_met.is_none() && self.goes_on(was_known) {
            self.jump_to = Some(there);
            self.near.move_to(&self.at);
        } else {
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
        limit: &mut Limit<'_>,
        answer: &mut ToolAdvance,
    ) -> bool {
        let here = self.at;
        self.jump_to = None;
        let tried = match self.escapes_tried.take() {
            Some(tried) => tried,
            None => {
                // Not only what changed where an earlier tick could not decide.
                let first = |first| if mesh_change.is_undecided() { 0 } else { first };
                let is_met = match first_changed.map(first) {
                    Some(first) => self.meets_candidates(first, &here, limit.max_work(), answer),
                    // It met other faces, too.
                    None if self.state == State::Stuck => self.meets(surface, &here, limit, answer),
                    None => self.meets_what_changed(surface, mesh_change, limit, answer),
                };
                let is_out = match is_met {
                    Some(false) => self.reaches(surface, &here, limit.max_work(), answer),
                    Some(true) => Some(false),
                    None => None,
                };
                match is_out {
                    Some(true) => {
                        self.come_out_at(&here);
                        return true;
                    }
                    Some(false) => EscapesTried {
                        next: 0,
                        held: 0,
                        looking_at: None,
                        moving_offset: self.moving_offset,
                        side: self.side(),
                    },
                    None => return false,
                }
            }
        };
        self.escape(surface, (mesh_change, tried), limit, answer)
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
    /// by the escapes that no tick has tried since the surface has changed. Stuck where none
    /// remains; false if budget or time do not suffice for all. Each tick tries one at least.
    fn escape(
        &mut self,
        surface: Surface<'_>,
        (mesh_change, mut tried): (&MeshChange, EscapesTried),
        limit: &mut Limit<'_>,
        answer: &mut ToolAdvance,
    ) -> bool {
        let here = self.at;
        let offsets = [self.static_offset(), tried.moving_offset];
        let escapes = mesh_change.escapes(offsets, tried.side);
        let count = escapes.clone().count();
        let begin = tried.next % count.max(1);
        let around = escapes.clone().skip(begin).chain(escapes.take(begin));
        for (k, escape) in around.take(count.saturating_sub(tried.held)).enumerate() {
            let is_late = k > 0 && limit.is_out_of_time(answer.spent);
            let escape = tried.looking_at.take().unwrap_or(escape);
            let out = Placement {
                centre: here.centre + escape,
                ..here
            };
            // Where a tick has collected there, all that is near is known again.
            self.near.tube.move_to(&out);
            let is_held = if is_late {
                answer.run_out()
            } else {
                self.is_held_at(surface, &out, limit, answer)
            };
            match is_held {
                Some(false) => {
                    self.near.move_to(&out);
                    self.come_out_at(&out);
                    return true;
                }
                Some(true) => {
                    tried.next = (begin + k + 1) % count;
                    tried.held += 1;
                }
                None => {
                    tried.looking_at = Some(escape);
                    self.escapes_tried = Some(tried);
                    // The pairs may be those around an escape; the tool stays here.
                    self.near.tube.move_to(&here);
                    return false;
                }
            }
        }
        self.state = State::Stuck;
        true
    }

    /// Whether the tool may not go to a placement: its anchor does not get there, or the tool meets
    /// the surface there. `None` if the budget does not suffice.
    fn is_held_at(
        &mut self,
        surface: Surface<'_>,
        out: &Placement,
        limit: &mut Limit<'_>,
        answer: &mut ToolAdvance,
    ) -> Option<bool> {
        let (here, budget) = (self.at, limit.max_work());
        if !self.reaches(surface, out, budget, answer)? {
            return Some(true);
        }
        if self.near.tube.covers(&here, &here.to(out), 0.0) {
            self.meets_candidates(0, out, budget, answer)
        } else {
            self.meets(surface, out, limit, answer)
        }
    }

    fn come_out_at(&mut self, at: &Placement) {
        self.at = *at;
        self.state = State::Clear;
        self.carried_anchor = None;
        (self.escapes_tried, self.jump_to) = (None, None);
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
        limit: &mut Limit<'_>,
        answer: &mut ToolAdvance,
    ) -> Option<bool> {
        let (here, to_query) = (self.at, Similarity::new(self.pose_at(&self.at), self.scale));
        let changed = mesh_change
            .changed()
            .filter(|_| !mesh_change.is_undecided());
        let (Some(changed), Some(to_query)) = (changed, to_query) else {
            return self.meets(surface, &here, limit, answer);
        };
        let budget = limit.max_work();
        let path = RelativePath::new([here.centre; 2], [here.rotation(); 2]);
        let mut is_met = false;
        for &face in changed.iter().filter(|&&face| surface.has(face)) {
            // Where time is over, the next ticks collect instead, in parts.
            if limit.is_reached(answer.spent) {
                return answer.run_out();
            }
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
    /// budget or time do not suffice. The next tick continues if it asks for the same placement and
    /// the pairs are not invalidated. More faces within the contact offset than there is room for
    /// count as met: no tick could tell.
    fn meets(
        &mut self,
        surface: Surface<'_>,
        at: &Placement,
        limit: &mut Limit<'_>,
        answer: &mut ToolAdvance,
    ) -> Option<bool> {
        let still = Twist::default();
        let margin = self.static_offset();
        if !self.near.tube.covers(at, &still, 0.0) {
            let tube = LookAheadTube::along(*at, still, 0.0, margin, &self.shape);
            // What the candidates cost, too, once they are known.
            let most = limit.max_work().saturating_sub(answer.spent) / 2;
            let part = &mut limit.part(answer.spent, most);
            let (ending, work) = self.near.collect(surface, &self.shape, tube, part);
            answer.work.add(work);
            answer.spent += work.cost();
            if self.near.tube.left() <= 0.0 {
                answer.ending = match ending {
                    Ending::Complete => Ending::Stopped { unvisited: 0 },
                    other => other,
                };
                let is_full = !self.near.has_partial_collection();
                return is_full.then_some(true);
            }
            // Without time for the tests, too, the next tick begins with them.
            let tests = self.near.vertex_count() / PLACED + PASSED * self.near.pairs.len() as u32;
            if limit.is_out_of_time(answer.spent + tests) {
                return answer.run_out();
            }
        }
        self.meets_candidates(0, at, limit.max_work(), answer)
    }
}
