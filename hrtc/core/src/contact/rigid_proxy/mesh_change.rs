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
    /// Largest push, and sum of the displacements, of the ticks before, which could not decide.
    of_before: [f64; 2],
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

/// The box of the changed faces after an operation.
fn box_of(mesh: &ActiveMesh, operation: &OperationFaces) -> [DVec3; 2] {
    let (mut lower, mut upper) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for &face in changed_by(operation).filter(|&&face| mesh.is_active(face)) {
        for corner in mesh.corners(face) {
            (lower, upper) = (lower.min(corner), upper.max(corner));
        }
    }
    [lower, upper]
}

/// Whether changed faces may be within a ball after an operation.
pub(super) fn operation_meets_ball(
    mesh: &ActiveMesh,
    operation: &OperationFaces,
    centre: DVec3,
    radius: f64,
) -> bool {
    let [lower, upper] = box_of(mesh, operation);
    let outside = (lower - centre).max(centre - upper).max(DVec3::ZERO);
    outside.length_squared() <= radius * radius
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
            of_before: [0.0; 2],
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
            push: 0.0,
            displacement: 0.0,
            of_before: self.moved(),
            count: 0,
            ..self
        }
    }

    /// How far a face has come towards the tool in a tick at the most, and how far the surface near
    /// it may have moved, since a tick could decide; model units. Mostly another face comes in each
    /// tick, or the same to and fro: with the sum of what came a tool in a slot would not look at
    /// the room that there is.
    fn moved(&self) -> [f64; 2] {
        let [push, displacement] = self.of_before;
        [push.max(self.push), displacement + self.displacement]
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
        let is_near = near.may_reach_box(shape, centre, box_of(mesh, operation));
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
    ) -> impl Iterator<Item = DVec3> + Clone + use<> {
        let [push, displacement] = self.moved();
        let side = self.side.try_normalize();
        let side = side.unwrap_or_else(|| held_by.normalize_or_zero());
        let push = push.max(offset) + offset;
        let shorter = (0..SHORT_ESCAPES).map(move |k| most * 0.25 * f64::from(1 << k));
        let shorter = shorter.filter(move |&escape| offset < escape && escape < push);
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
    use super::super::look_ahead_tube::LookAheadTube;
    use super::super::{State, ToolProxy};
    use super::*;
    use crate::contact::motion::Twist;
    use crate::contact::query::{Limit, Surface};
    use crate::contact::tool::{Tool, ToolMesh, capsule_mesh};
    use ab_tree::{AbTree, leaf_key};
    use geometry::Pose;
    use glam::DQuat;
    use spm::{Certified, CertifiedCode, VspRecord};

    /// A plate of squares of side 1 / `SIDE`, each of two faces that know no neighbour.
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

    /// Moves the plate to a height.
    fn move_plate_to(mesh: &mut ActiveMesh, tree: &mut AbTree, height: f32) {
        for v in 0..(SIDE + 1) * (SIDE + 1) {
            let at = mesh.position(v);
            mesh.set_base_vertex(v, [at.x, at.y, height], Certified::EXACT);
        }
        (0..2 * SIDE * SIDE).for_each(|face| tree.deform(face));
        tree.refit(|face| mesh.face_box(face));
    }

    /// A capsule that lies at rest on the middle of the plate, and its pose.
    fn lying(surface: Surface<'_>) -> (ToolProxy, Pose) {
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
        (proxy, pose)
    }

    /// A face beside the tool is new.
    fn change_a_face_beside(proxy: &mut ToolProxy) {
        proxy.mesh_change.is_new = true;
        proxy.mesh_change.faces[0] = SIDE * SIDE;
        proxy.mesh_change.count += 1;
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
        let (mut proxy, pose) = lying(surface);
        proxy.near.invalidate_all();
        let found = MeshChange {
            is_there: true,
            may_have_met: true,
            ..MeshChange::new()
        };
        proxy.mesh_change = found.kept();
        for tick in 1..200 {
            if goes_on {
                change_a_face_beside(&mut proxy);
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

    /// Ticks until a tool into which the plate has come gets out by one of the later escapes, with
    /// a budget for few of them: while nothing changes any more, or a face in each tick.
    fn ticks_to_escape(goes_on: bool) -> u32 {
        const BUDGET: u32 = 1500;
        const RISEN: f64 = 20.0;
        let (mut mesh, mut tree) = plate();
        let surface = Surface {
            mesh: &mesh,
            tree: &tree,
        };
        let (mut proxy, pose) = lying(surface);
        assert!(!proxy.contacts.all().is_empty(), "they tell the side");
        let risen = RISEN * proxy.static_offset();
        move_plate_to(&mut mesh, &mut tree, risen as f32);
        let surface = Surface {
            mesh: &mesh,
            tree: &tree,
        };
        proxy.near.invalidate_all();
        let found = MeshChange {
            is_there: true,
            may_have_met: true,
            displacement: risen,
            ..MeshChange::new()
        };
        proxy.mesh_change = found.kept();
        for tick in 1..LONGEST {
            if goes_on {
                change_a_face_beside(&mut proxy);
            }
            let _ = proxy.advance(surface, &pose, BUDGET);
            if !proxy.mesh_change.is_there() {
                let height = proxy.pose().position.z - pose.position.z;
                assert!(
                    proxy.state == State::Clear && height > 0.9 * risen,
                    "{height}"
                );
                return tick;
            }
        }
        LONGEST
    }

    const LONGEST: u32 = 1000;

    #[test]
    fn the_later_escapes_are_tried_while_the_surface_changes() {
        let [alone, beside] = [false, true].map(ticks_to_escape);
        println!("{alone} ticks, {beside} while faces change");
        assert!(alone > 2 && beside < LONGEST, "{alone}, {beside}");
    }

    /// A surface that goes on in each tick in which nobody can decide has moved by the sum at the
    /// most. The first escape is none from the sum: it is as long as what a tick has pushed.
    #[test]
    fn escapes_reach_as_far_as_the_surface_has_moved_in_all_ticks() {
        let mut change = MeshChange::new();
        for _ in 0..40 {
            (change.push, change.displacement) = (3.0, 3.0);
            change = change.kept();
        }
        let escapes = change.escapes([1.0, 0.0], DVec3::Z);
        let first = escapes.clone().next().map(DVec3::length);
        assert!(first.is_some_and(|first| first <= 5.0), "{first:?}");
        let longest = escapes.fold(0.0, |longest: f64, escape| longest.max(escape.length()));
        assert!(longest > 120.0, "{longest}");
        assert_eq!(change.take().moved(), [3.0, 120.0]);
        assert_eq!(change.moved(), [0.0; 2], "a tick has decided");
    }

    /// A split of a small fan at the plate's height: it changes eight faces, the first ones of any
    /// mesh, and passes over nothing beside that height.
    fn split_of_first_faces() -> OperationFaces {
        let mut mesh = ActiveMesh::new(7, 6, 1);
        for k in 0..7 {
            let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_3 * f64::from(k));
            let out = if k == 0 { 0.0 } else { 0.1 };
            let at = (turn * DVec3::new(out, 0.0, 0.0)).as_vec3().to_array();
            mesh.set_base_vertex(k, at, Certified::EXACT);
        }
        for k in 0..6 {
            let corners = [0, 1 + k, 1 + (k + 1) % 6];
            let set = mesh.set_base_face(k, corners, [NONE, (k + 1) % 6, (k + 5) % 6]);
            set.expect("a fan");
        }
        let record = VspRecord {
            i: 0,
            vs: 0,
            fn_: [0, 5, 2, 3],
            leaf_l: leaf_key(6, 8),
            leaf_r: leaf_key(7, 8),
            pos_t: [0.0, 0.01, 0.0],
            pos_u: [0.0, -0.01, 0.0],
            certified: [CertifiedCode::default(); 2],
            e: 0,
        };
        mesh.load(0, &record, record.vs, record.fn_, [Certified::EXACT; 2]);
        let mut out = OperationFaces::new();
        mesh.split(0, &mut out).expect("the fan is there");
        out
    }

    /// Flat over much of the plate and clear of it, with a budget for a part of what is near: ticks
    /// until a tool that was placed there begins there, while nothing changes or some near faces do
    /// in each tick.
    fn ticks_to_begin(goes_on: bool) -> u32 {
        const ROW: u32 = 16;
        let (mesh, tree) = plate();
        let surface = Surface {
            mesh: &mesh,
            tree: &tree,
        };
        let place = |v: u32| [v % (ROW + 1), v / (ROW + 1)].map(|k| 0.5 * f64::from(k) / 16.0);
        let points = (0..(ROW + 1) * (ROW + 1)).map(place);
        let squares = (0..ROW * ROW).map(|square| square / ROW * (ROW + 1) + square % ROW);
        let faces = squares.flat_map(|a| {
            let [b, c, d] = [a + 1, a + ROW + 1, a + ROW + 2];
            [[a, b, d], [a, d, c]]
        });
        let tool = Tool::new(&ToolMesh {
            positions: points.map(|[x, y]| DVec3::new(x, y, 0.0)).collect(),
            triangles: faces.collect(),
        });
        let tool = tool.expect("it is a tool");
        let mut proxy = ToolProxy::new(tool, 1.0).expect("it has an extent");
        let above = 0.5 * proxy.static_offset();
        let pose = Pose::at(DVec3::new(0.013, 0.017, above));
        proxy.place(&pose);
        // Half of the budget is for the collection, which then takes two ticks or more.
        let margin = proxy.static_offset();
        let tube = LookAheadTube::along(proxy.at, Twist::default(), 0.0, margin, &proxy.shape);
        let mut no_limit = Limit::from(u32::MAX);
        let near = &mut proxy.near;
        let (_, work) = near.collect(surface, &proxy.shape, tube, &mut no_limit);
        let budget = work.cost();
        assert!(proxy.near.tube.left() > 0.0, "there is room");
        proxy.near.invalidate_all();
        let operation = split_of_first_faces();
        for tick in 1..100 {
            if goes_on {
                proxy.carry(&mesh, &operation);
                assert!(proxy.is_placed_anew, "it is on its side");
            }
            let _ = proxy.advance(surface, &pose, budget);
            if !proxy.is_placed_anew || proxy.state != State::Inside {
                assert_eq!(proxy.state, State::Clear, "it begins at the device");
                return tick;
            }
        }
        100
    }

    #[test]
    fn what_was_placed_begins_while_the_surface_changes() {
        let [alone, beside] = [false, true].map(ticks_to_begin);
        println!("{alone} ticks, {beside} while faces change");
        assert!(alone > 1 && beside < 20, "{alone}, {beside}");
    }
}
