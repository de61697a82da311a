//! Whether the tool meets the surface, and how it gets out of what a change of the surface moved
//! over it.

use super::contacts::{PASSED, PLACED};
use super::look_ahead_tube::LookAheadTube;
use super::mesh_change::MeshChange;
use super::{State, ToolAdvance, ToolProxy};
use crate::contact::motion::{Placement, Twist};
use crate::contact::query::{Body, Ending, Surface};
use crate::contact::tool::{RelativePath, for_each_face_near};
use geometry::{Similarity, triangle_pair};

/// Cost of a pair of faces tested, in node pairs (measured).
const TESTED: u32 = 3;

impl ToolProxy {
    /// Moves to the device if the tool is clear of the surface there.
    pub(super) fn jump_when_clear(
        &mut self,
        surface: Surface<'_>,
        budget: u32,
        answer: &mut ToolAdvance,
    ) {
        let goal = self.goal;
        // Changes of the surface are not noted meanwhile.
        self.near.invalidate();
        let clear = self.meets(surface, &goal, budget, answer) == Some(false);
        if clear || self.state == State::Inside {
            self.at = goal;
            self.device_travel = 0.0;
        }
        if clear {
            self.state = State::Clear;
            self.invalidate();
            self.contacts.clear();
        }
    }

    /// After a change of the surface: if it meets the tool, moves the tool out on its side. False
    /// if the budget does not suffice to decide. `first_changed`: where the candidate pairs of
    /// changed faces begin, if all candidates are known.
    pub(super) fn depenetrate(
        &mut self,
        surface: Surface<'_>,
        (mesh_change, first_changed): (&MeshChange, Option<usize>),
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> bool {
        let here = self.at;
        let is_met = match first_changed {
            Some(first) => Some(self.meets_candidates(first, &here, answer)),
            None => self.meets_what_changed(surface, mesh_change, budget, answer),
        };
        match is_met {
            Some(true) => {}
            known => return known.is_some(),
        }
        let held_by = self
            .contacts
            .all()
            .iter()
            .map(|contact| contact.normal)
            .sum();
        let offsets = (self.static_offset(), self.moving_offset);
        for escape in mesh_change.escapes(offsets.0, offsets.1, held_by) {
            let out = Placement {
                centre: here.centre + escape,
                ..here
            };
            let path = here.to(&out);
            let is_met = if self.near.tube.covers(&here, &path, 0.0) {
                Some(self.meets_candidates(0, &out, answer))
            } else {
                self.meets(surface, &out, budget, answer)
            };
            match is_met {
                Some(true) => {}
                None => return false,
                Some(false) => {
                    self.near.spend(&out, &path, self.shape.radius);
                    self.at = out;
                    return true;
                }
            }
        }
        self.state = State::Stuck;
        true
    }

    /// Whether the tool at a placement that the candidates cover meets one of them, from `first`
    /// on.
    fn meets_candidates(&mut self, first: usize, at: &Placement, answer: &mut ToolAdvance) -> bool {
        self.near.place(&self.shape, at);
        let (mut passed, mut tested) = (0, 0);
        let is_met = self.near.pairs[first..].iter().any(|pair| {
            passed += 1;
            let own = self.near.corners(&self.shape, pair.tool);
            if self.near.apart_now(pair, own) > 0.0 {
                return false;
            }
            tested += 1;
            let face = &self.near.faces[pair.surface as usize];
            triangle_pair(face.corners, own).meets()
        });
        answer.work.faces += tested;
        answer.spent += self.near.vertex_count() / PLACED + PASSED * passed + TESTED * tested;
        is_met
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
        let mut is_met = false;
        for &face in changed.iter().filter(|&&face| surface.has(face)) {
            let corners = surface.corners(face);
            let mut tested = 0;
            let cost = for_each_face_near(&self.shape.blocks, &path, corners, 0.0, |own| {
                let corners_of_tool = self
                    .tool
                    .triangle(own)
                    .map(|v| self.tool.local_vertices()[v as usize]);
                tested += 1;
                is_met = triangle_pair(corners, corners_of_tool.map(|p| to_query.point(p))).meets();
                !is_met
            });
            answer.work.faces += tested;
            answer.spent += cost + TESTED * tested;
            if is_met {
                return Some(true);
            }
            if answer.spent > budget {
                return None;
            }
        }
        Some(false)
    }

    /// Whether the tool meets the surface at a placement, whose candidates it collects; `None` if
    /// the budget does not suffice. The next tick continues if it asks for the same placement.
    fn meets(
        &mut self,
        surface: Surface<'_>,
        at: &Placement,
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> Option<bool> {
        let still = Twist::default();
        let margin = self.static_offset();
        let tube = LookAheadTube::along(*at, still, 0.0, margin, &self.shape);
        // What the candidates cost, too, once they are known.
        let most = budget.saturating_sub(answer.spent) / 2;
        let (ending, work) = self.near.collect(surface, &self.shape, tube, most);
        answer.work.add(work);
        answer.spent += work.cost();
        if self.near.tube.left() <= 0.0 {
            answer.ending = match ending {
                Ending::Complete => Ending::Stopped { unvisited: 0 },
                other => other,
            };
            return None;
        }
        Some(self.meets_candidates(0, at, answer))
    }
}
