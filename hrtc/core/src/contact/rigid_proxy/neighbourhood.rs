//! The candidate pairs: faces of tool and surface that come near each other along a path. They are
//! collected once and reused while the tool deviates from the path by less than the margin (Verlet
//! list).
//!
//! The margin is around a path, not around a placement: a sliding tool moves far along the surface
//! and hardly towards it, and a margin as wide as its motion would hold several times the pairs.
//!
//! Each pair keeps a separating direction. Mostly three products with it show that the pair does
//! not matter, and a motion that keeps the pair separated along it is free.

mod collect;
mod face_pair;
mod surface_face;

use super::look_ahead_tube::LookAheadTube;
use super::shape::{ToolEdge, ToolShape};
use crate::contact::motion::{Placement, Twist};
use crate::contact::tool::RelativePath;
use collect::PartialCollection;
pub(super) use collect::Updated;
use face_pair::TurnedFaces;
use geometry::{Aabb, BoxPair};
use glam::{DMat3, DVec3};
use spm::{ActiveMesh, Handle, NONE};
use surface_face::normal_of;
pub(super) use surface_face::{MAX_AROUND, SurfaceFace};

/// Vertices of the tool whose placing costs as much as one node pair (measured).
pub(super) const PLACED: u32 = 2;
/// Capacity for pairs of faces.
pub const MAX_PAIRS: usize = 4096;
/// Capacity for faces of the surface.
pub const MAX_SURFACE_FACES: usize = 2048;

/// A candidate pair.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub(super) struct NearPair {
    pub tool: u32,
    /// Index of the face of the surface.
    pub surface: u32,
    pub along: Direction,
}

/// Unit direction from the surface to the tool that separates two faces.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub(super) enum Direction {
    /// Fixed in the model, as is the extent `height` of the surface face along it: for the normal
    /// of a surface face.
    Still { direction: DVec3, height: f64 },
    /// Fixed in the tool's axes: for the normal of a tool face.
    Turning(DVec3),
}

/// Separation of corners from a height along a direction: the least of three.
#[inline]
pub(super) fn apart(direction: DVec3, height: f64, corners: [DVec3; 3]) -> f64 {
    let [a, b, c] = corners.map(|p| direction.dot(p));
    a.min(b).min(c) - height
}

/// Extent of corners along a direction.
#[inline]
pub(super) fn reach_along(direction: DVec3, corners: [DVec3; 3]) -> f64 {
    let [a, b, c] = corners.map(|p| direction.dot(p));
    a.max(b).max(c)
}

/// A hash table from handles to indices, by open addressing; at most half full.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
struct Places {
    entries: Vec<(Handle, u32)>,
    /// Entries in use; only these are cleared.
    used: Vec<u32>,
}

impl Places {
    fn new(most: usize) -> Self {
        Self {
            entries: vec![(NONE, 0); (2 * most).next_power_of_two()],
            used: Vec::with_capacity(most),
        }
    }

    fn clear(&mut self) {
        for &at in &self.used {
            self.entries[at as usize] = (NONE, 0);
        }
        self.used.clear();
    }

    /// The slot of a handle, present or not.
    fn slot(&self, key: Handle) -> usize {
        let mask = self.entries.len() - 1;
        // Fibonacci hashing: the upper bits of the product are the mixed ones.
        let mut at = (u64::from(key).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32) as usize & mask;
        while self.entries[at].0 != NONE && self.entries[at].0 != key {
            at = (at + 1) & mask;
        }
        at
    }

    fn find(&self, key: Handle) -> Option<u32> {
        let (found, place) = self.entries[self.slot(key)];
        (found == key).then_some(place)
    }

    /// The index of a handle, and whether it was added now.
    fn find_or_add(&mut self, key: Handle, place: u32) -> (u32, bool) {
        let at = self.slot(key);
        if self.entries[at].0 == key {
            return (self.entries[at].1, false);
        }
        self.entries[at] = (key, place);
        self.used.push(at as u32);
        (place, true)
    }
}

/// All pairs within the margin of the look-ahead tube.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Neighbourhood {
    pub(super) pairs: Vec<NearPair>,
    pub(super) faces: Vec<SurfaceFace>,
    face_places: Places,
    vertex_places: Places,
    /// Vertices of the tool that pairs use, and their current positions, by vertex.
    vertices: Vec<u32>,
    is_listed: Vec<bool>,
    positions: Vec<DVec3>,
    ends: Vec<DVec3>,
    /// The tool's axes now and at the end of the motion.
    rotation: DMat3,
    end_rotation: DMat3,
    /// What a collection computes once per face of the tool: no part of the state.
    #[serde(skip)]
    turned: TurnedFaces,
    /// The tube for which the pairs are known, and the surface's path as seen from the tool.
    pub tube: LookAheadTube,
    path: RelativePath,
    /// The state of an unfinished collection.
    partial: Option<PartialCollection>,
    /// For each pair, a lower bound of its separation on the straight lines of the tube.
    gaps: Vec<f64>,
    /// Counts changes of the list of pairs.
    generation: u64,
    /// Largest numbers of pairs and of faces of the surface.
    high_water: [usize; 2],
}

impl Neighbourhood {
    /// No pairs.
    pub fn new(shape: &ToolShape) -> Self {
        let vertices = shape.points.len();
        Self {
            pairs: Vec::with_capacity(MAX_PAIRS),
            faces: Vec::with_capacity(MAX_SURFACE_FACES),
            face_places: Places::new(MAX_SURFACE_FACES),
            vertex_places: Places::new(3 * MAX_SURFACE_FACES),
            vertices: Vec::with_capacity(vertices),
            is_listed: vec![false; vertices],
            positions: vec![DVec3::ZERO; vertices],
            ends: vec![DVec3::ZERO; vertices],
            rotation: DMat3::IDENTITY,
            end_rotation: DMat3::IDENTITY,
            turned: TurnedFaces::new(shape.faces.len()),
            tube: LookAheadTube::nowhere(),
            path: RelativePath::new([DVec3::ZERO; 2], [DMat3::IDENTITY; 2]),
            partial: None,
            gaps: Vec::with_capacity(MAX_PAIRS),
            generation: 0,
            high_water: [0; 2],
        }
    }

    /// Invalidates all pairs.
    pub fn invalidate(&mut self) {
        self.tube = LookAheadTube::nowhere();
        self.partial = None;
    }

    /// Invalidates all pairs with their directions, which are those of another placement.
    pub fn invalidate_all(&mut self) {
        self.invalidate();
        self.clear();
    }

    /// Largest numbers of pairs and of faces of the surface so far.
    pub fn high_water(&self) -> [usize; 2] {
        self.high_water
    }

    fn note_high_water(&mut self) {
        let [pairs, faces] = self.high_water;
        self.high_water = [pairs.max(self.pairs.len()), faces.max(self.faces.len())];
    }

    /// Number of vertices of the tool that pairs use.
    pub fn vertex_count(&self) -> u32 {
        self.vertices.len() as u32
    }

    /// Index of a face of the surface.
    pub fn place_of(&self, face: Handle) -> Option<u32> {
        self.face_places.find(face)
    }

    /// The faces of the pairs: of the surface and of the tool.
    pub fn handles(&self) -> impl Iterator<Item = (Handle, u32)> + '_ {
        let pair = |p: &NearPair| (self.faces[p.surface as usize].face, p.tool);
        self.pairs.iter().map(pair)
    }

    /// Lower bound of the distance to the surface.
    pub fn clearance(&self, shape: &ToolShape) -> f64 {
        let gap = |pair: &NearPair| self.apart_now(pair, self.corners(shape, pair.tool));
        let least = self.pairs.iter().map(gap).fold(self.tube.left(), f64::min);
        least.max(0.0)
    }

    /// Whether a collection is unfinished.
    pub fn has_partial_collection(&self) -> bool {
        self.partial.is_some()
    }

    /// The tube of the pairs or of the unfinished collection.
    fn looked_at(&self) -> &LookAheadTube {
        self.partial.as_ref().map_or(&self.tube, |b| &b.tube)
    }

    /// Upper bound of the motion of a point from the tube's start to any place within it; 0 if
    /// nothing is known.
    pub fn reach(&self) -> f64 {
        self.looked_at().reach().max(0.0)
    }

    /// The same as [`Self::may_reach`] for a box given by its corners. Mostly two balls tell: that
    /// of all points within the tube, and that of the tool, of which nothing may be known, around
    /// its centre.
    pub fn may_reach_box(
        &self,
        shape: &ToolShape,
        centre: DVec3,
        [lower, upper]: [DVec3; 2],
    ) -> bool {
        let meets = |centre: DVec3, radius: f64| {
            let outside = (lower - centre).max(centre - upper).max(DVec3::ZERO);
            outside.length_squared() <= radius * radius
        };
        let (start, reach) = (self.looked_at().ends()[0].centre, self.reach());
        let is_near =
            meets(centre, shape.radius) || reach > 0.0 && meets(start, shape.radius + reach);
        is_near && {
            let around = BoxPair::twice_widened(lower.as_vec3a(), upper.as_vec3a());
            self.may_reach(shape, &around.get(0))
        }
    }

    /// Whether a change in a box may be within the margin of the tube; true if nothing is known.
    pub fn may_reach(&self, shape: &ToolShape, aabb: &Aabb) -> bool {
        let tube = self.looked_at();
        let margin = tube.straight_margin();
        let margin = margin + tube.bend_seen(margin);
        tube.left() <= 0.0 || self.path.any(&shape.blocks, aabb, margin)
    }

    /// Stays the same as long as the pairs do.
    pub fn generation(&self) -> u64 {
        self.generation
    }

    fn clear(&mut self) {
        self.generation += 1;
        self.pairs.clear();
        self.gaps.clear();
        self.clear_faces();
        for &v in &self.vertices {
            self.is_listed[v as usize] = false;
        }
        self.vertices.clear();
    }

    fn clear_faces(&mut self) {
        self.faces.clear();
        self.face_places.clear();
        self.vertex_places.clear();
    }

    /// The pairs of a face of the surface.
    pub(super) fn pairs_of(&self, place: u32) -> impl Iterator<Item = &NearPair> {
        let face = &self.faces[place as usize];
        let pairs = self.pairs[face.first_pair as usize..].iter();
        let own = pairs.filter(move |pair| pair.surface == place);
        own.take(face.pairs as usize)
    }

    /// Counts a pair for its face of the surface.
    fn count_pair(&mut self, pair: usize, place: u32) {
        let face = &mut self.faces[place as usize];
        if face.pairs == 0 {
            face.first_pair = pair as u32;
        }
        face.pairs += 1;
    }

    /// Index of a face, which is added if it is new.
    fn face_place(&mut self, mesh: &ActiveMesh, face: Handle) -> u32 {
        let (place, is_new) = self.face_places.find_or_add(face, self.faces.len() as u32);
        if is_new {
            let made = SurfaceFace::of(mesh, face);
            let owns = self.owns_corners(&made, place);
            self.faces.push(made.relisted(owns));
        }
        place
    }

    /// The corners that a face owns as the first one listed at them.
    fn owns_corners(&mut self, face: &SurfaceFace, place: u32) -> [bool; 3] {
        let first = |vertex| self.vertex_places.find_or_add(vertex, place).1;
        face.vertices.map(first)
    }

    /// Places the tool's vertices.
    pub fn place(&mut self, shape: &ToolShape, at: &Placement) {
        self.rotation = at.rotation();
        put(
            &self.vertices,
            &mut self.positions,
            shape,
            at.centre,
            self.rotation,
        );
    }

    /// Places the tool's vertices at the end of a motion.
    pub fn place_ends(&mut self, shape: &ToolShape, at: &Placement) {
        self.end_rotation = at.rotation();
        put(
            &self.vertices,
            &mut self.ends,
            shape,
            at.centre,
            self.end_rotation,
        );
    }

    /// Notes where the tool is, after pairs were collected for another placement.
    pub fn move_to(&mut self, place: &Placement) {
        if self.tube.left() > 0.0 {
            self.tube.move_to(place);
        }
    }

    /// Pairs with a larger gap than this stay farther apart than `distance` on a motion of the tool
    /// from where it is; infinite if nothing is known.
    pub(super) fn gap_beyond(&self, motion: &Twist, from: &Placement, distance: f64) -> f64 {
        if self.tube.left() > 0.0 {
            distance + self.tube.deviation_on(from, motion)
        } else {
            f64::INFINITY
        }
    }

    /// Whether the gap of a pair is larger than what [`Self::gap_beyond`] has told.
    #[inline]
    pub(super) fn is_beyond(&self, pair: usize, gap: f64) -> bool {
        self.gaps[pair] > gap
    }

    /// Whether a search for contacts may find one at a pair, and whether that had to be found out:
    /// where the surface is flat only corners of the tool ask.
    pub(super) fn asks(&mut self, mesh: &ActiveMesh, shape: &ToolShape, pair: usize) -> [bool; 2] {
        let pair = &self.pairs[pair];
        let tool = &shape.faces[pair.tool as usize];
        if tool.owns != [false; 3] {
            return [true, false];
        }
        let face = &mut self.faces[pair.surface as usize];
        let is_asked = |edge: &ToolEdge| edge.is_asked;
        if face.asks_edge != [false; 3] && tool.edges.iter().any(is_asked) {
            return [true, false];
        }
        let (asks, is_new) = face.asks_corner(mesh);
        [asks, is_new]
    }

    /// Separation of a pair along its direction, given the corners of the tool's face; negative if
    /// they overlap along it.
    #[inline]
    pub(super) fn apart_now(&self, pair: &NearPair, corners: [DVec3; 3]) -> f64 {
        self.apart_under(pair, self.rotation, corners)
    }

    /// The same at the end of the motion.
    #[inline]
    pub(super) fn apart_then(&self, pair: &NearPair, corners: [DVec3; 3]) -> f64 {
        self.apart_under(pair, self.end_rotation, corners)
    }

    #[inline]
    fn apart_under(&self, pair: &NearPair, rotation: DMat3, corners: [DVec3; 3]) -> f64 {
        match pair.along {
            Direction::Still { direction, height } => apart(direction, height, corners),
            Direction::Turning(direction) => {
                let direction = rotation * direction;
                let surface = self.faces[pair.surface as usize].corners;
                apart(direction, reach_along(direction, surface), corners)
            }
        }
    }

    /// From the tool's axes to the model's at the end of the motion.
    pub(super) fn end_rotation(&self) -> DMat3 {
        self.end_rotation
    }

    /// Current direction of a pair.
    pub(super) fn direction(&self, pair: &NearPair) -> DVec3 {
        match pair.along {
            Direction::Still { direction, .. } => direction,
            Direction::Turning(direction) => self.rotation * direction,
        }
    }

    /// The normals of both faces of a pair, towards the tool.
    #[inline]
    pub(super) fn normals(
        &self,
        shape: &ToolShape,
        pair: &NearPair,
        corners: [DVec3; 3],
    ) -> [Direction; 2] {
        let face = &self.faces[pair.surface as usize];
        let over = face.normal;
        let between = corners[0] + corners[1] + corners[2]
            - face.corners[0]
            - face.corners[1]
            - face.corners[2];
        let direction = over * over.dot(between).signum();
        let own = shape.faces[pair.tool as usize].normal;
        let under = own * (self.rotation * own).dot(between).signum();
        let height = reach_along(direction, face.corners);
        [
            Direction::Still { direction, height },
            Direction::Turning(under),
        ]
    }

    /// Current corners of a face of the tool.
    #[inline]
    pub(super) fn corners(&self, shape: &ToolShape, face: u32) -> [DVec3; 3] {
        shape.faces[face as usize]
            .vertices
            .map(|v| self.positions[v as usize])
    }

    /// Corners of a face of the tool at the end of the motion.
    #[inline]
    pub(super) fn end_corners(&self, shape: &ToolShape, face: u32) -> [DVec3; 3] {
        shape.faces[face as usize]
            .vertices
            .map(|v| self.ends[v as usize])
    }
}

fn put(vertices: &[u32], places: &mut [DVec3], shape: &ToolShape, centre: DVec3, rotation: DMat3) {
    for &v in vertices {
        places[v as usize] = centre + rotation * shape.points[v as usize];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::tool::{Tool, capsule_mesh};
    use glam::DQuat;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array)
    }

    proptest! {
        /// Whatever comes within the margin of any placement that the tube covers is noticed,
        /// wherever within the tube the tool is now.
        #[test]
        fn what_may_touch_on_a_covered_motion_is_noticed(
            way in vector(), twist in vector(), length in 0.01..0.2f64, here in vector(),
            is_behind in any::<bool>(),
        ) {
            let tool = Tool::new(&capsule_mesh(0.3, 2.0, 8, 6)).expect("it is a tool");
            let shape = ToolShape::new(&tool, 1.0);
            let mut near = Neighbourhood::new(&shape);
            // The tool's tip is ahead.
            let way = way.normalize_or(DVec3::X);
            let orientation = DQuat::from_rotation_arc(DVec3::Z, way);
            let start = Placement { centre: DVec3::X, orientation };
            let path = Twist { linear: way * length, angular: twist * (0.02 * length) };
            let (distance, skin) = (0.002, 0.02);
            near.tube = LookAheadTube::along(start, path, distance, skin, &shape);
            let ends = near.tube.ends();
            near.path = RelativePath::new(ends.map(|at| at.centre), ends.map(|at| at.rotation()));
            let beside = |off: DVec3| Twist {
                linear: off.clamp_length_max(1.0) * (0.9 * skin),
                ..Twist::default()
            };
            // Behind the start or beside it, on a way beyond the end.
            let at = start.moved(&beside(if is_behind { -way } else { here }));
            let end = ends[1].moved(&beside(way));
            near.tube.move_to(&at);
            prop_assert!(near.tube.covers(&at, &at.to(&end), distance));
            for arm in &shape.points {
                let corner = end.centre + end.rotation() * *arm + way * (0.99 * distance);
                prop_assert!(near.may_reach_box(&shape, at.centre, [corner; 2]), "{corner}");
            }
        }
    }
}
