//! Changes of the surface near the tool, by splits and collapses since the last tick.

use super::neighbourhood::{Neighbourhood, apart, reach_along};
use super::shape::ToolShape;
use glam::DVec3;
use spm::{ActiveMesh, Handle, NONE, OperationFaces};
use std::iter;

/// How much longer each escape is than the one before: room for the tool is not passed over if its
/// far end is half as far again as its near one.
const LONGER: f64 = 1.5;
/// Escapes from the push of the known faces to as far as the surface has moved, at most: from the
/// least push, two contact offsets, to 2 to 22 times the tool's radius of gyration.
const ESCAPES: usize = 24;
/// Escapes from there on, to five times as long: several operations may have moved the surface.
const LONG_ESCAPES: usize = 5;
/// Shorter escapes before those, up to twice the motion of the surface in a tick if that is
/// limited: mostly the surface has not moved far.
const SHORT_ESCAPES: i32 = 4;

/// Capacity of the list of changed faces.
const MAX_LISTED: usize = 512;

/// Changes of the surface near the tool.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MeshChange {
    is_there: bool,
    /// Whether some of it came since the last tick.
    is_new: bool,
    /// Whether an earlier tick could not decide face by face: a collection does, over several
    /// ticks, and the changed faces are those since.
    is_undecided: bool,
    may_have_met: bool,
    /// Sum of the directions from changed faces to the tool.
    side: DVec3,
    /// Largest advance of a changed face towards the tool, model units.
    push: f64,
    /// Largest displacement of the surface near the tool, model units.
    displacement: f64,
    /// Changed faces near the tool, some of them inactive by now. If `count` is larger than the
    /// array, some are missing.
    #[serde(with = "serde_big_array::BigArray")]
    faces: [Handle; MAX_LISTED],
    count: usize,
}

/// The faces that an operation has changed.
fn changed_by(operation: &OperationFaces) -> impl Iterator<Item = &Handle> {
    let deformed = operation.deformed().iter();
    deformed.chain(operation.made_or_removed())
}

/// Whether faces may be near the tool, or where candidates are collected, after an operation.
fn is_near_now(
    near: &Neighbourhood,
    shape: &ToolShape,
    centre: DVec3,
    mesh: &ActiveMesh,
    operation: &OperationFaces,
) -> bool {
    let (mut lower, mut upper) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for &face in changed_by(operation).filter(|&&face| mesh.is_active(face)) {
        for corner in mesh.corners(face) {
            (lower, upper) = (lower.min(corner), upper.max(corner));
        }
    }
    near.may_reach_box(shape, centre, [lower, upper])
}

/// Whether an operation changes what is collected, or may.
pub(super) fn operation_is_near(
    near: &Neighbourhood,
    shape: &ToolShape,
    centre: DVec3,
    mesh: &ActiveMesh,
    operation: &OperationFaces,
) -> bool {
    let mut changed = changed_by(operation);
    changed.any(|&face| near.place_of(face).is_some())
        || is_near_now(near, shape, centre, mesh, operation)
}

impl MeshChange {
    /// No change.
    pub fn new() -> Self {
        Self {
            is_there: false,
            is_new: false,
            is_undecided: false,
            may_have_met: false,
            side: DVec3::ZERO,
            push: 0.0,
            displacement: 0.0,
            faces: [NONE; MAX_LISTED],
            count: 0,
        }
    }

    /// Takes the noted changes and clears them.
    pub fn take(&mut self) -> Self {
        std::mem::replace(self, Self::new())
    }

    /// The same for a later tick, where this one could not decide.
    pub fn kept(self) -> Self {
        Self {
            is_new: false,
            is_undecided: true,
            count: 0,
            ..self
        }
    }

    /// Whether an earlier tick could not decide: not only the changed faces matter.
    pub fn is_undecided(&self) -> bool {
        self.is_undecided
    }

    /// Whether there is a change since the last tick.
    pub fn is_new(&self) -> bool {
        self.is_new
    }

    /// The surface's advance towards the tool that is expected in a tick, at most `most`: twice
    /// that of this tick, since a geomorph's steps differ and several may move one face. `most`
    /// where too many faces have changed to know.
    pub fn expected_push(&self, most: f64) -> f64 {
        if !self.is_undecided && self.changed().is_some() {
            most.min(2.0 * self.push)
        } else {
            most
        }
    }

    /// Whether a face near the tool has changed.
    pub fn is_there(&self) -> bool {
        self.is_there
    }

    /// Whether the surface may meet the tool.
    pub fn may_have_met(&self) -> bool {
        self.may_have_met
    }

    /// Changed faces near the tool since the last tick, some of them inactive by now; `None` if
    /// they were too many.
    pub fn changed(&self) -> Option<&[Handle]> {
        self.faces.get(..self.count)
    }

    /// Notes an operation. Candidate pairs tell which changed faces were near; balls and the tool's
    /// boxes along the collected path tell which are near now, its bounding ball alone if nothing
    /// is collected.
    pub fn note(
        &mut self,
        near: &mut Neighbourhood,
        shape: &ToolShape,
        centre: DVec3,
        mesh: &ActiveMesh,
        operation: &OperationFaces,
    ) {
        let changed = || changed_by(operation);
        let is_near = is_near_now(near, shape, centre, mesh, operation);
        let mut was_near = false;
        for &face in changed() {
            let Some(place) = near.place_of(face) else {
                continue;
            };
            was_near = true;
            if !mesh.is_active(face) {
                continue;
            }
            let corners = mesh.corners(face);
            let before = std::mem::replace(&mut near.faces[place as usize].corners, corners);
            for pair in near.pairs_of(place) {
                let direction = near.direction(pair);
                let height = reach_along(direction, corners);
                self.push = self.push.max(height - reach_along(direction, before));
                self.side += direction;
                let tool = near.corners(shape, pair.tool);
                self.may_have_met |= apart(direction, height, tool) <= 0.0;
            }
        }
        if is_near || was_near {
            self.displacement = self.displacement.max(mesh.displacement(operation));
            self.is_there = true;
            self.is_new = true;
            for &face in changed().filter(|&&face| mesh.is_active(face)) {
                if let Some(place) = self.faces.get_mut(self.count) {
                    *place = face;
                }
                self.count += 1;
            }
        }
        // A face that was not near before has no separating direction.
        self.may_have_met |= is_near;
    }

    /// The surface has passed over the tool's anchor, by so much at the most, near the tool or not.
    pub fn passed_over_anchor(&mut self, displacement: f64) {
        self.displacement = self.displacement.max(displacement);
        (self.is_there, self.is_new, self.may_have_met) = (true, true, true);
    }

    /// Displacements out of the surface on the side of the tool, the shortest first. `offset`:
    /// contact offset; `most`: motion of the surface in a tick if limited, else 0. `held_by`: the
    /// direction in which the last contacts push, or else off the face that is met, for changed
    /// faces that were no candidates.
    pub fn escapes(
        &self,
        [offset, most]: [f64; 2],
        held_by: DVec3,
    ) -> impl Iterator<Item = DVec3> + use<> {
        let side = self.side.try_normalize();
        let side = side.unwrap_or_else(|| held_by.normalize_or_zero());
        let push = self.push.max(offset) + offset;
        let shorter = (0..SHORT_ESCAPES).map(move |k| most * 0.25 * f64::from(1 << k));
        let shorter = shorter.filter(move |&escape| offset < escape && escape < push);
        let displacement = self.displacement;
        let longer = |first: f64| {
            let factors = iter::successors(Some(1.0), |factor| Some(LONGER * factor));
            factors.map(move |factor| first * factor)
        };
        let known = longer(push).take(ESCAPES);
        let known = known.take_while(move |&escape| escape == push || escape < displacement);
        let moved = longer(displacement + push).take(LONG_ESCAPES);
        let all = shorter.chain(known).chain(moved);
        all.map(move |escape| side * escape)
    }
}

#[cfg(test)]
mod tests {
    use super::super::ToolProxy;
    use super::*;
    use crate::contact::query::Surface;
    use crate::contact::tool::{Tool, capsule_mesh};
    use ab_tree::{AbTree, leaf_key};
    use geometry::Pose;
    use glam::DQuat;
    use spm::Certified;

    /// A plate of squares of side 1 / `SIDE`, each of two faces.
    const SIDE: u32 = 24;

    fn plate() -> (ActiveMesh, AbTree) {
        let (row, faces) = (SIDE + 1, 2 * SIDE * SIDE);
        let mut mesh = ActiveMesh::new(row * row, faces, 0);
        for v in 0..row * row {
            let at = [v % row, v / row].map(|k| k as f32 / SIDE as f32);
            mesh.set_base_vertex(v, [at[0], at[1], 0.0], Certified::EXACT);
        }
        let mut tree = AbTree::new(faces);
        tree.preconstruct(faces);
        for square in 0..SIDE * SIDE {
            let a = square / SIDE * row + square % SIDE;
            let [b, c, d] = [a + 1, a + row, a + row + 1];
            for (k, corners) in (0..).zip([[a, b, c], [d, c, b]]) {
                let face = 2 * square + k;
                let set = mesh.set_base_face(face, corners, [NONE; 3]);
                set.expect("all are there");
                tree.insert(face, leaf_key(face, faces));
            }
        }
        tree.refit(|face| mesh.face_box(face));
        (mesh, tree)
    }

    /// Ticks until a tool whose surface has changed knows whether it meets it, with a budget for a
    /// part of what is near: while nothing changes any more, or a face in each tick.
    fn ticks_to_decide(goes_on: bool) -> u32 {
        const BUDGET: u32 = 500;
        let (mesh, tree) = plate();
        let surface = Surface {
            mesh: &mesh,
            tree: &tree,
        };
        let tool = Tool::new(&capsule_mesh(0.1, 0.6, 40, 30)).expect("it is a tool");
        let orientation = DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2);
        let heights = tool.local_vertices().iter().map(|&v| (orientation * v).z);
        let lowest = heights.fold(f64::INFINITY, f64::min);
        let mut proxy = ToolProxy::new(tool, 1.0).expect("it has an extent");
        let above = 0.1 * proxy.static_offset();
        let pose = Pose {
            position: DVec3::new(0.5, 0.5, above - lowest),
            orientation,
        };
        proxy.place(&pose);
        let _ = proxy.advance(surface, &pose, u32::MAX);
        proxy.near.invalidate_all();
        let found = MeshChange {
            is_there: true,
            may_have_met: true,
            ..MeshChange::new()
        };
        proxy.mesh_change = found.kept();
        for tick in 1..200 {
            if goes_on {
                proxy.mesh_change.is_new = true;
                proxy.mesh_change.faces[0] = SIDE * SIDE;
                proxy.mesh_change.count += 1;
            }
            let _ = proxy.advance(surface, &pose, BUDGET);
            if !proxy.mesh_change.is_there() {
                return tick;
            }
        }
        200
    }

    #[test]
    fn what_several_ticks_decide_is_decided_while_the_surface_changes() {
        let [alone, beside] = [false, true].map(ticks_to_decide);
        println!("{alone} ticks, {beside} while faces change");
        assert!(alone > 3 && beside < 2 * alone, "{alone}, {beside}");
    }
}
