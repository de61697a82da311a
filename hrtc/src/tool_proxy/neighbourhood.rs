//! The pairs of faces of tool and surface that come near each other on a motion, gathered once and held for as long as
//! the tool strays from that motion by less than the margin.
//!
//! A tool that slides goes far along the surface and hardly towards it: a margin as wide as its way would hold several
//! times the pairs.
//!
//! Each pair keeps a direction along which it is apart: a look at three corners then mostly tells that it does not
//! matter, and along a motion that stays apart in it nothing passes.

use super::corridor::Corridor;
use super::motion::{Placement, Twist};
use super::shape::{ToolShape, is_flat};
use crate::query::{Ending, PairWork, Surface, for_each_near_pair};
use crate::tool::Tool;
use glam::{DMat3, DVec3};
use shared::spm::{ActiveMesh, Handle, NONE};
use std::ops::ControlFlow;

/// Pairs of faces that fit.
pub const MOST_PAIRS: usize = 4096;
/// Faces of the surface that fit.
pub const MOST_SURFACE_FACES: usize = 2048;

/// Times that the margin of a full neighbourhood is halved at once, at the most.
const HALVINGS: usize = 6;

/// A face of the surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct SurfaceFace {
    pub face: Handle,
    pub vertices: [Handle; 3],
    pub corners: [DVec3; 3],
    /// Unit normal; zero without area.
    pub normal: DVec3,
    /// The corner of the neighbour beyond the edge opposite each corner; at a rim one of the edge's own.
    pub beyond: [DVec3; 3],
    /// Which edges it answers for.
    pub owns_edge: [bool; 3],
    /// Which of those are no lines within a plane.
    pub asks_edge: [bool; 3],
    /// Which corners it answers for.
    pub owns: [bool; 3],
}

impl SurfaceFace {
    fn of(mesh: &ActiveMesh, face: Handle) -> Self {
        let corners = mesh.corners(face);
        let [a, b, c] = corners;
        let links = mesh.face(face);
        let mut made = Self {
            face,
            vertices: links.corners,
            corners,
            normal: (b - a).cross(c - a).normalize_or_zero(),
            beyond: corners.map(|_| DVec3::ZERO),
            owns_edge: [true; 3],
            asks_edge: [true; 3],
            owns: [false; 3],
        };
        for k in 0..3 {
            let on_edge = [links.corners[(k + 1) % 3], links.corners[(k + 2) % 3]];
            let across = links.neighbours[k];
            made.beyond[k] = corners[(k + 1) % 3];
            if across != NONE {
                let others = mesh.face(across).corners;
                let beyond = others.iter().position(|v| !on_edge.contains(v));
                if let Some(place) = beyond {
                    made.beyond[k] = mesh.corners(across)[place];
                }
                made.owns_edge[k] = face < across;
                made.asks_edge[k] = made.owns_edge[k] && !is_flat(corners, made.beyond[k]);
            }
        }
        made
    }
}

/// A face of the tool and one of the surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct NearPair {
    pub tool: u32,
    /// Place among the faces of the surface.
    pub surface: u32,
    pub along: Direction,
}

/// A unit direction from the surface to the tool along which two faces are apart.
#[derive(Debug, Clone, Copy)]
pub(super) enum Direction {
    /// It stays as the tool turns, and so does how far the surface reaches along it: good over a face of the surface.
    Still { direction: DVec3, height: f64 },
    /// It turns with the tool and is given in the tool's axes: good under a face of the tool.
    Turning(DVec3),
}

/// How far corners are beyond a height along a direction: the least of three.
#[inline]
pub(super) fn apart(direction: DVec3, height: f64, corners: [DVec3; 3]) -> f64 {
    let [a, b, c] = corners.map(|p| direction.dot(p));
    a.min(b).min(c) - height
}

/// How far corners reach along a direction.
#[inline]
pub(super) fn reach_along(direction: DVec3, corners: [DVec3; 3]) -> f64 {
    let [a, b, c] = corners.map(|p| direction.dot(p));
    a.max(b).max(c)
}

/// A set of handles with their places, by open addressing; never more than half full.
#[derive(Debug, Clone)]
struct Places {
    entries: Vec<(Handle, u32)>,
    /// Entries in use: mostly few, and only these are cleared.
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

    /// Where a handle is, or would be.
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

    /// The place of a handle, and whether it is the one given because it was not there.
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

/// All pairs within the margin of a corridor.
#[derive(Debug, Clone)]
pub struct Neighbourhood {
    pub(super) pairs: Vec<NearPair>,
    pub(super) faces: Vec<SurfaceFace>,
    face_places: Places,
    vertex_places: Places,
    /// Tool vertices that the pairs have, and their positions now, by vertex.
    vertices: Vec<u32>,
    is_listed: Vec<bool>,
    positions: Vec<DVec3>,
    ends: Vec<DVec3>,
    /// The tool's axes, now and at the end of the motion.
    rotation: DMat3,
    end_rotation: DMat3,
    /// Where the pairs are known.
    pub corridor: Corridor,
    /// No point of the tool has moved farther since it was gathered.
    moved: f64,
    /// For each pair: until so much was moved it cannot touch.
    clear_until: Vec<f64>,
    high_water: usize,
}

impl Neighbourhood {
    /// Of nothing, for a tool.
    pub fn new(shape: &ToolShape) -> Self {
        let vertices = shape.points.len();
        Self {
            pairs: Vec::with_capacity(MOST_PAIRS),
            faces: Vec::with_capacity(MOST_SURFACE_FACES),
            face_places: Places::new(MOST_SURFACE_FACES),
            vertex_places: Places::new(3 * MOST_SURFACE_FACES),
            vertices: Vec::with_capacity(vertices),
            is_listed: vec![false; vertices],
            positions: vec![DVec3::ZERO; vertices],
            ends: vec![DVec3::ZERO; vertices],
            rotation: DMat3::IDENTITY,
            end_rotation: DMat3::IDENTITY,
            corridor: Corridor::nowhere(),
            moved: 0.0,
            clear_until: Vec::with_capacity(MOST_PAIRS),
            high_water: 0,
        }
    }

    /// Nothing is known any more.
    pub fn forget(&mut self) {
        self.corridor = Corridor::nowhere();
    }

    /// The most pairs that there ever were.
    pub fn high_water(&self) -> usize {
        self.high_water
    }

    /// Whether nothing is near.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// The place of a face of the surface among those near.
    pub fn place_of(&self, face: Handle) -> Option<u32> {
        self.face_places.find(face)
    }

    /// The surface is nowhere nearer than this.
    pub fn clearance(&self, shape: &ToolShape) -> f64 {
        let gap = |pair: &NearPair| self.apart_now(pair, self.corners(shape, pair.tool));
        let least = self
            .pairs
            .iter()
            .map(gap)
            .fold(self.corridor.left(), f64::min);
        least.max(0.0)
    }

    /// Gathers all pairs of a corridor, along which `tool` was placed. Where there are too many the margin shrinks; where
    /// that does not help, or the budget of node pairs is spent, nothing is known and the ending says so.
    pub fn gather(
        &mut self,
        surface: Surface<'_>,
        tool: &Tool,
        shape: &ToolShape,
        corridor: Corridor,
        budget: u32,
    ) -> (Ending, PairWork) {
        self.clear();
        let [start, end] = corridor.ends();
        self.rotation = start.rotation();
        self.end_rotation = end.rotation();
        let mut margin = corridor.straight_margin();
        let mut held = HeldFace {
            face: NONE,
            corners: [[DVec3::ZERO; 3]; 2],
            own: DVec3::ZERO,
            normal: DVec3::ZERO,
        };
        let (ending, work) =
            for_each_near_pair(&surface, tool, margin, budget, |face, tool_face| {
                if self.pairs.len() == MOST_PAIRS || self.faces.len() == MOST_SURFACE_FACES {
                    for _ in 0..HALVINGS {
                        margin *= 0.5;
                        self.shrink(surface.mesh, margin);
                        if self.has_room() {
                            break;
                        }
                    }
                    if !self.has_room() {
                        return ControlFlow::Break(());
                    }
                }
                if held.face != tool_face {
                    let normal = shape.faces[tool_face as usize].normal;
                    held = HeldFace {
                        face: tool_face,
                        corners: [
                            corners_at(shape, start.centre, self.rotation, tool_face),
                            corners_at(shape, end.centre, self.end_rotation, tool_face),
                        ],
                        own: normal,
                        normal: self.rotation * normal,
                    };
                }
                let place = self.face_place(surface.mesh, face);
                let (gap, along) = held.best_apart(&self.faces[place as usize], margin);
                if gap > margin {
                    return ControlFlow::Continue(margin);
                }
                self.pairs.push(NearPair {
                    tool: tool_face,
                    surface: place,
                    along,
                });
                self.clear_until.push(gap);
                ControlFlow::Continue(margin)
            });
        self.high_water = self.high_water.max(self.pairs.len());
        self.corridor = if ending.is_complete() {
            corridor.narrowed(margin)
        } else {
            Corridor::nowhere()
        };
        for pair in &self.pairs {
            for v in shape.faces[pair.tool as usize].vertices {
                if !self.is_listed[v as usize] {
                    self.is_listed[v as usize] = true;
                    self.vertices.push(v);
                }
            }
        }
        (ending, work)
    }

    /// Whether it is worth while to go on after it was full.
    fn has_room(&self) -> bool {
        4 * self.pairs.len() <= 3 * MOST_PAIRS && 4 * self.faces.len() <= 3 * MOST_SURFACE_FACES
    }

    fn clear(&mut self) {
        self.pairs.clear();
        self.clear_until.clear();
        self.moved = 0.0;
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

    /// The place of a face, which is taken in if it is new.
    fn face_place(&mut self, mesh: &ActiveMesh, face: Handle) -> u32 {
        let (place, is_new) = self.face_places.find_or_add(face, self.faces.len() as u32);
        if is_new {
            let mut made = SurfaceFace::of(mesh, face);
            for k in 0..3 {
                made.owns[k] = self.vertex_places.find_or_add(made.vertices[k], place).1;
            }
            self.faces.push(made);
        }
        place
    }

    /// Keeps only pairs that may be within a margin, and the faces that they have.
    fn shrink(&mut self, mesh: &ActiveMesh, margin: f64) {
        let mut kept = 0;
        for k in 0..self.pairs.len() {
            let pair = self.pairs[k];
            if self.clear_until[k] <= margin {
                let face = self.faces[pair.surface as usize].face;
                self.pairs[kept] = NearPair {
                    // A handle until the faces are counted anew.
                    surface: face,
                    ..pair
                };
                self.clear_until[kept] = self.clear_until[k];
                kept += 1;
            }
        }
        self.clear_until.truncate(kept);
        self.pairs.truncate(kept);
        self.clear_faces();
        for k in 0..kept {
            self.pairs[k].surface = self.face_place(mesh, self.pairs[k].surface);
        }
    }

    /// Puts the listed vertices where the tool is.
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

    /// Puts the ends of a motion where it leads.
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

    /// The tool has moved to a place by a motion.
    pub fn spend(&mut self, place: &Placement, motion: &Twist, radius: f64) {
        self.corridor.follow(place);
        self.moved += motion.farthest(radius);
    }

    /// Whether a pair is farther apart than a distance, by what was seen of it and how far the tool has moved since.
    #[inline]
    pub(super) fn is_known_beyond(&self, pair: usize, distance: f64) -> bool {
        self.clear_until[pair] - self.moved > distance
    }

    /// A pair is at least so far apart now.
    #[inline]
    pub(super) fn saw(&mut self, pair: usize, apart: f64) {
        self.clear_until[pair] = apart + self.moved;
    }

    /// How far the faces of a pair are apart along its direction, given the corners of the tool's; negative where they
    /// overlap along it.
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

    /// The direction of a pair now.
    pub(super) fn direction(&self, pair: &NearPair) -> DVec3 {
        match pair.along {
            Direction::Still { direction, .. } => direction,
            Direction::Turning(direction) => self.rotation * direction,
        }
    }

    /// Corners of a face of the tool now.
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

/// Corners of a face of the tool at a place.
fn corners_at(shape: &ToolShape, centre: DVec3, rotation: DMat3, face: u32) -> [DVec3; 3] {
    let vertices = shape.faces[face as usize].vertices;
    vertices.map(|v| centre + rotation * shape.points[v as usize])
}

fn put(vertices: &[u32], places: &mut [DVec3], shape: &ToolShape, centre: DVec3, rotation: DMat3) {
    for &v in vertices {
        places[v as usize] = centre + rotation * shape.points[v as usize];
    }
}

/// A face of the tool that is gathered for.
struct HeldFace {
    face: u32,
    /// Where its corners are at the start and at the end of the way.
    corners: [[DVec3; 3]; 2],
    /// Its normal in the tool's axes, and in the model's at the start.
    own: DVec3,
    normal: DVec3,
}

impl HeldFace {
    /// Of the two faces' normals and the way between their middles the one along which they stay apart most on the straight
    /// way, and how far; or the first along which they stay farther apart than `enough`.
    fn best_apart(&self, face: &SurfaceFace, enough: f64) -> (f64, Direction) {
        let [start, end] = &self.corners;
        // Both ways of a normal at once: what reaches least one way reaches most the other.
        let either = |normal: DVec3| {
            let [a, b, c] = face.corners.map(|p| normal.dot(p));
            let [p, q, r] = start.map(|p| normal.dot(p));
            let [s, t, u] = end.map(|p| normal.dot(p));
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            let least = p.min(q).min(r).min(s.min(t).min(u));
            let most = p.max(q).max(r).max(s.max(t).max(u));
            let (ahead, behind) = (least - high, low - most);
            if ahead >= behind {
                (ahead, 1.0, high)
            } else {
                (behind, -1.0, -low)
            }
        };
        let still = |normal: DVec3, way: f64, height: f64| {
            let direction = way * normal;
            Direction::Still { direction, height }
        };
        let (over, way, height) = either(face.normal);
        let over_face = still(face.normal, way, height);
        if over > enough {
            return (over, over_face);
        }
        let (under, way, _) = either(self.normal);
        let under_tool = Direction::Turning(way * self.own);
        if under > enough {
            return (under, under_tool);
        }
        let middle = |[a, b, c]: [DVec3; 3]| a + b + c;
        let between = (middle(*start) - middle(face.corners)).normalize_or_zero();
        let (beside, way, height) = either(between);
        if beside > over.max(under) {
            (beside, still(between, way, height))
        } else if over >= under {
            (over, over_face)
        } else {
            (under, under_tool)
        }
    }
}
