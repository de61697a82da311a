//! The active mesh: the surface of a front, changed by one split or collapse at a time.
//!
//! Storage is in *slots*, one for each loaded VSP, so memory follows the loaded front, not the full
//! mesh. A *handle* names a vertex or a face: the first V0 (F0) are those of the base mesh, then
//! two a slot. Where slots are VSP numbers (tests, station), handles are the ids of the file.
//!
//! | array | entry | bytes | entries |
//! |---|---|---|---|
//! | vertices | position, what is certified | 24 | V0 + 2 a slot |
//! | faces | corners, neighbours | 24 | F0 + 2 a slot |
//! | links | i, vs, fn, leaf codes | 32 | 1 a slot |
//! | states | performed, moving, dependents | 4 | 1 a slot |
//! | quarters | what is certified of those of some faces | 12 | as many as there is room for |
//!
//! Legality is a property of the front: a split is legal when its dependencies are performed, a
//! collapse when no performed VSP depends on it. (`rt-tests fronts` compares with the adjacency
//! tests of thesis 5.2.3: no mismatch in 3 million checks.) Vertices may be between two fronts
//! ([`Geomorph`]). No operation allocates or recurses. A record that does not fit the mesh (a
//! damaged file) is refused before anything changes; an operation on more faces than
//! [`OperationFaces`] holds is too: it waits until other operations have made them fewer, and the
//! front stays legal without it.

mod adjacency;
mod base_mesh;
mod bounds;
mod check;
mod fans;
mod geomorphs;
mod operation_faces;
mod swept;
mod walk;

pub use geomorphs::Geomorph;
pub use operation_faces::OperationFaces;
pub use walk::FrontWalk;

use super::certified::Certified;
use super::quarters::QuarterTable;
use super::record::VspRecord;
use ab_tree::{Handle, NONE};
use base_mesh::BaseLinks;
use geometry::Aabb;
use glam::{DVec3, Vec3};
use std::ops::Range;
use thiserror::Error;

/// Storage place of a loaded VSP.
pub type Slot = u32;

/// A face: corners counterclockwise, and the neighbour across the edge opposite each corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Face {
    /// Corners, vertex handles.
    pub corners: [Handle; 3],
    /// Neighbours, face handles; [`NONE`] at a boundary.
    pub neighbours: [Handle; 3],
}

impl Face {
    const UNUSED: Self = Self {
        corners: [NONE; 3],
        neighbours: [NONE; 3],
    };

    fn index_of(&self, vertex: Handle) -> Option<usize> {
        self.corners.iter().position(|&c| c == vertex)
    }
}

/// Position of a vertex, and what is certified of it. (R is that of its current position, the rest
/// that of its own.)
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct Vertex {
    position: Vec3,
    certified: Certified,
}

/// A record in handles instead of ids.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct Links {
    i: u32,
    vs: Handle,
    fn_: [Handle; 4],
    leaf_l: u32,
    leaf_r: u32,
}

impl Vertex {
    const UNUSED: Self = Self {
        position: Vec3::ZERO,
        certified: Certified::EXACT,
    };
}

impl Links {
    const UNUSED: Self = Self {
        i: NONE,
        vs: NONE,
        fn_: [NONE; 4],
        leaf_l: NONE,
        leaf_r: NONE,
    };
}

/// Lengthens a list up to an index. Within its room nothing is allocated.
fn reach<T: Clone>(list: &mut Vec<T>, index: u32, unused: T) {
    let length = index as usize + 1;
    if list.len() < length {
        list.resize(length, unused);
    }
}

/// Whether a VSP is performed, and whether a vertex of it has a geomorph.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
enum Performed {
    #[default]
    No,
    AtRest,
    Moving,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct State {
    /// Performed VSPs that depend on this one, counted with repetition.
    dependents: u16,
    loaded: bool,
    performed: Performed,
}

/// One for every slot of a cache: there is no room for more.
const _: () = assert!(size_of::<State>() == 4);

/// Why a split or collapse is not performed. Nothing has changed then.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum OperationError {
    /// The record does not fit its mesh.
    #[error("vertex split record {0} does not fit the mesh: the file is damaged")]
    Damaged(u32),
    /// The record is sound, but the fan of its vertex on this front has more faces than an
    /// operation may change. It waits: the fan shrinks when its ring is coarser.
    #[error(
        "vertex split {0} would change more than {limit} faces of this front: it has to wait",
        limit = OperationFaces::MAX_FACES
    )]
    TooManyFaces(u32),
}

/// The mesh of a front.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ActiveMesh {
    base_vertices: u32,
    base_faces: u32,
    /// Vertices and faces that there may be; links as many as states.
    room: [u32; 2],
    // Up to the last that was ever set, so that the room for the others is not written.
    #[cfg_attr(feature = "serde", serde(with = "crate::reserved"))]
    vertices: Vec<Vertex>,
    #[cfg_attr(feature = "serde", serde(with = "crate::reserved"))]
    faces: Vec<Face>,
    #[cfg_attr(feature = "serde", serde(with = "crate::reserved"))]
    links: Vec<Links>,
    states: Vec<State>,
    quarters: QuarterTable,
    #[cfg_attr(feature = "serde", serde(with = "crate::reserved"))]
    geomorphs: Vec<Geomorph>,
    active_faces: u32,
    performed: u32,
    base_links: BaseLinks,
}

impl ActiveMesh {
    /// Bytes of one slot.
    pub const BYTES_PER_SLOT: usize =
        2 * size_of::<Vertex>() + 2 * size_of::<Face>() + size_of::<Links>() + size_of::<State>();
    /// Bytes of one base vertex.
    pub const BYTES_PER_BASE_VERTEX: usize = size_of::<Vertex>();
    /// Bytes of one base face.
    pub const BYTES_PER_BASE_FACE: usize = size_of::<Face>();

    /// Allocates room for a base mesh and `slots` VSPs; nothing is allocated later. Most of it
    /// takes memory as it is used, unless the process has locked its memory.
    #[must_use]
    pub fn new(base_vertices: u32, base_faces: u32, slots: u32) -> Self {
        let room = [base_vertices, base_faces].map(|base| base + 2 * slots);
        let mut vertices = Vec::with_capacity(room[0] as usize);
        let mut faces = Vec::with_capacity(room[1] as usize);
        vertices.resize(base_vertices as usize, Vertex::UNUSED);
        faces.resize(base_faces as usize, Face::UNUSED);
        Self {
            base_vertices,
            base_faces,
            room,
            vertices,
            faces,
            links: Vec::with_capacity(slots as usize),
            states: vec![State::default(); slots as usize],
            quarters: QuarterTable::with_room(0),
            geomorphs: Vec::new(),
            active_faces: 0,
            performed: 0,
            base_links: BaseLinks::default(),
        }
    }

    /// Empties the mesh as a whole: no face is active. [`ActiveMesh::forget_slots`] and
    /// [`ActiveMesh::forget_base_faces`] of all that were in use must follow, in as many steps as
    /// the caller likes, before [`ActiveMesh::reshape`]. Nothing is freed or allocated.
    pub fn begin_clear(&mut self) {
        self.cancel_geomorphs();
        self.active_faces = 0;
        self.performed = 0;
        self.base_links = BaseLinks::default();
    }

    /// Makes slots unused, after [`ActiveMesh::begin_clear`]. Returns their faces.
    pub fn forget_slots(&mut self, slots: Range<Slot>) -> Range<Handle> {
        self.states[slots.start as usize..slots.end as usize].fill(State::default());
        let faces = self.base_faces + 2 * slots.start..self.base_faces + 2 * slots.end;
        self.forget_faces(faces.clone());
        faces
    }

    /// Makes faces unused; those that were never set are.
    fn forget_faces(&mut self, faces: Range<Handle>) {
        let end = self.faces.len().min(faces.end as usize);
        if let Some(faces) = self.faces.get_mut(faces.start as usize..end) {
            faces.fill(Face::UNUSED);
        }
    }

    /// Makes base faces unused, after [`ActiveMesh::begin_clear`].
    pub fn forget_base_faces(&mut self, faces: Range<Handle>) {
        self.forget_faces(faces);
    }

    /// Divides the storage for another model; the mesh must be empty, so that base faces which have
    /// not arrived yet are marked as unused.
    ///
    /// Returns the number of slots, `None` when the base mesh alone does not fit.
    pub fn reshape(&mut self, base_vertices: u32, base_faces: u32) -> Option<u32> {
        let [vertices, faces] = self.room;
        let room = |total: u32, base: u32| Some(total.checked_sub(base)? / 2);
        let slots = room(vertices, base_vertices)?
            .min(room(faces, base_faces)?)
            .min(self.states.len() as u32);
        self.base_vertices = base_vertices;
        self.base_faces = base_faces;
        self.quarters.clear();
        assert!(
            self.active_faces == 0 && self.performed == 0,
            "storage is divided while it is empty"
        );
        Some(slots)
    }

    /// vt of a slot; vu is the next handle.
    #[inline]
    #[must_use]
    pub fn vt(&self, slot: Slot) -> Handle {
        self.base_vertices + 2 * slot
    }

    /// fl of a slot; fr is the next handle.
    #[inline]
    #[must_use]
    pub fn fl(&self, slot: Slot) -> Handle {
        self.base_faces + 2 * slot
    }

    /// Slot of the VSP that creates a vertex, `None` for a base vertex.
    #[inline]
    #[must_use]
    pub fn creator_of_vertex(&self, vertex: Handle) -> Option<Slot> {
        vertex.checked_sub(self.base_vertices).map(|k| k / 2)
    }

    /// Slot of the VSP that creates a face, `None` for a base face.
    #[inline]
    #[must_use]
    pub fn creator_of_face(&self, face: Handle) -> Option<Slot> {
        face.checked_sub(self.base_faces).map(|k| k / 2)
    }

    /// Loads a record into a slot, not performed; `vs` and `fn_` are handles, `certified` is
    /// that of vt and vu.
    pub fn load(
        &mut self,
        slot: Slot,
        record: &VspRecord,
        vs: Handle,
        fn_: [Handle; 4],
        certified: [Certified; 2],
    ) {
        let state = &mut self.states[slot as usize];
        assert!(!state.loaded, "a slot is loaded twice");
        *state = State {
            loaded: true,
            ..State::default()
        };
        let links = Links {
            i: record.i,
            vs,
            fn_,
            leaf_l: record.leaf_l,
            leaf_r: record.leaf_r,
        };
        reach(&mut self.links, slot, Links::UNUSED);
        self.links[slot as usize] = links;
        let vu = self.vt(slot) + 1;
        reach(&mut self.vertices, vu, Vertex::UNUSED);
        let fr = self.fl(slot) + 1;
        reach(&mut self.faces, fr, Face::UNUSED);
        let vt = self.vt(slot) as usize;
        for (k, (position, certified)) in [record.pos_t, record.pos_u]
            .into_iter()
            .zip(certified)
            .enumerate()
        {
            self.vertices[vt + k] = Vertex {
                position: Vec3::from_array(position),
                certified,
            };
        }
    }

    /// Frees a slot that is not performed.
    pub fn unload(&mut self, slot: Slot) {
        let state = &mut self.states[slot as usize];
        assert!(
            state.loaded && state.performed == Performed::No,
            "only a loaded record that is not performed is unloaded"
        );
        *state = State::default();
    }

    /// The VSP number in a slot.
    #[inline]
    #[must_use]
    pub fn id(&self, slot: Slot) -> u32 {
        self.links[slot as usize].i
    }

    /// The AB-tree leaf codes of a slot's faces; the second is [`NONE`] at a boundary.
    #[inline]
    #[must_use]
    pub fn leaves(&self, slot: Slot) -> (u32, u32) {
        let links = self.links[slot as usize];
        (links.leaf_l, links.leaf_r)
    }

    /// A neighbour of each face that a slot's VSP creates, active when the split is legal; [`NONE`]
    /// for the second where the VSP creates one face only.
    #[inline]
    #[must_use]
    pub fn neighbours_of_new_faces(&self, slot: Slot) -> (Handle, Handle) {
        let [fn0, fn1, fn2, fn3] = self.links[slot as usize].fn_;
        let either = |a: Handle, b: Handle| if a == NONE { b } else { a };
        (either(fn0, fn1), either(fn2, fn3))
    }

    /// The slots that a slot's VSP depends on, with repetition, at most five.
    pub fn dependencies(&self, slot: Slot) -> impl Iterator<Item = Slot> + use<> {
        let links = self.links[slot as usize];
        let (base_vertices, base_faces) = (self.base_vertices, self.base_faces);
        let of_vertex = links.vs.checked_sub(base_vertices).map(|k| k / 2);
        of_vertex.into_iter().chain(
            links
                .fn_
                .into_iter()
                .filter(|&f| f != NONE)
                .filter_map(move |f| f.checked_sub(base_faces).map(|k| k / 2)),
        )
    }

    /// Whether a slot's VSP is performed.
    #[inline]
    #[must_use]
    pub fn is_performed(&self, slot: Slot) -> bool {
        self.states[slot as usize].performed != Performed::No
    }

    /// Whether the split is legal now.
    #[must_use]
    pub fn split_is_legal(&self, slot: Slot) -> bool {
        self.states[slot as usize].loaded
            && !self.is_performed(slot)
            && self.dependencies(slot).all(|d| self.is_performed(d))
    }

    /// Whether the collapse is legal now.
    #[must_use]
    pub fn collapse_is_legal(&self, slot: Slot) -> bool {
        self.is_performed(slot) && self.states[slot as usize].dependents == 0
    }

    /// Number of active faces.
    #[must_use]
    pub fn active_faces(&self) -> u32 {
        self.active_faces
    }

    /// Number of performed VSPs.
    #[must_use]
    pub fn performed(&self) -> u32 {
        self.performed
    }

    /// Whether a face is active.
    #[inline]
    #[must_use]
    pub fn is_active(&self, face: Handle) -> bool {
        match self.creator_of_face(face) {
            None => true,
            Some(slot) => {
                self.is_performed(slot)
                    && (face == self.fl(slot) || self.links[slot as usize].leaf_r != NONE)
            }
        }
    }

    /// A face.
    #[inline]
    #[must_use]
    pub fn face(&self, face: Handle) -> &Face {
        &self.faces[face as usize]
    }

    /// Current position of a vertex, model units: the f32 of the file, unless it has a geomorph.
    #[inline]
    #[must_use]
    pub fn position(&self, vertex: Handle) -> Vec3 {
        self.vertices[vertex as usize].position
    }

    /// R of a vertex at its current position, model units.
    #[inline]
    #[must_use]
    pub fn radius(&self, vertex: Handle) -> f32 {
        self.vertices[vertex as usize].certified.radius
    }

    /// Corners of a face in f64.
    #[inline]
    #[must_use]
    pub fn corners(&self, face: Handle) -> [DVec3; 3] {
        self.faces[face as usize]
            .corners
            .map(|v| self.position(v).as_dvec3())
    }

    /// Corners of a face, model units.
    #[inline]
    #[must_use]
    pub fn triangle(&self, face: Handle) -> [Vec3; 3] {
        self.faces[face as usize].corners.map(|v| self.position(v))
    }

    /// Box of a face, exact.
    #[inline]
    #[must_use]
    pub fn face_box(&self, face: Handle) -> Aabb {
        Aabb::of_triangle(self.triangle(face))
    }

    /// Performs the split of a slot; legal splits only.
    ///
    /// # Errors
    /// When the record does not fit the mesh, or its fan is too large; nothing has changed then.
    pub fn split(&mut self, slot: Slot, out: &mut OperationFaces) -> Result<(), OperationError> {
        assert!(self.split_is_legal(slot), "an illegal split");
        let links = self.links[slot as usize];
        let damaged = OperationError::Damaged(links.i);
        let [fn0, fn1, fn2, fn3] = links.fn_;
        let has_right = links.leaf_r != NONE;
        let vs = links.vs;
        let vl = self.across(vs, fn0, fn1).ok_or(damaged)?;
        let vr = if has_right {
            // Mirrored: fn3 has the edge vs -> vr, like fn0 has vs -> vl.
            self.across(vs, fn3, fn2).ok_or(damaged)?
        } else {
            NONE
        };
        if vl == vr {
            return Err(damaged);
        }
        self.patch(slot, out)?;
        out.from = [self.position(vs); 2];
        out.radius = self.radius(vs);
        self.cancel_geomorph(vs);
        let (vt, fl) = (self.vt(slot), self.fl(slot));
        let (vu, fr) = (vt + 1, fl + 1);
        out.moved = [vt, vu];
        for k in 0..out.count {
            let vertex = if k < out.of_t { vt } else { vu };
            let face = &mut self.faces[out.deformed[k] as usize];
            match face.index_of(vs) {
                Some(corner) => face.corners[corner] = vertex,
                None => unreachable!("the fan was collected by this corner"),
            }
        }
        self.faces[fl as usize] = Face {
            corners: [vt, vu, vl],
            neighbours: [fn1, fn0, if has_right { fr } else { NONE }],
        };
        self.set_neighbour(fn0, vt, 2, fl);
        self.set_neighbour(fn1, vu, 1, fl);
        if has_right {
            self.faces[fr as usize] = Face {
                corners: [vu, vt, vr],
                neighbours: [fn2, fn3, fl],
            };
            self.set_neighbour(fn2, vt, 1, fr);
            self.set_neighbour(fn3, vu, 2, fr);
        }
        self.finish(slot, true, out);
        Ok(())
    }

    /// Undoes the split of a slot; legal collapses only.
    ///
    /// # Errors
    /// When its fans are too large; nothing has changed then.
    pub fn collapse(&mut self, slot: Slot, out: &mut OperationFaces) -> Result<(), OperationError> {
        assert!(self.collapse_is_legal(slot), "an illegal collapse");
        let links = self.links[slot as usize];
        let [fn0, fn1, fn2, fn3] = links.fn_;
        let (vt, fl) = (self.vt(slot), self.fl(slot));
        let vu = vt + 1;
        debug_assert_eq!(self.faces[fl as usize].neighbours[..2], [fn1, fn0]);
        self.patch(slot, out)?;
        out.moved = [links.vs; 2];
        out.from = [vt, vu].map(|vertex| self.position(vertex));
        self.cancel_geomorph(vt);
        self.cancel_geomorph(vu);
        for k in 0..out.count {
            let vertex = if k < out.of_t { vt } else { vu };
            let face = &mut self.faces[out.deformed[k] as usize];
            match face.index_of(vertex) {
                Some(corner) => face.corners[corner] = links.vs,
                None => unreachable!("the fan was collected by this corner"),
            }
        }
        self.set_neighbour(fn0, links.vs, 2, fn1);
        self.set_neighbour(fn1, links.vs, 1, fn0);
        self.set_neighbour(fn2, links.vs, 1, fn3);
        self.set_neighbour(fn3, links.vs, 2, fn2);
        self.finish(slot, false, out);
        Ok(())
    }

    /// Shared end of both operations: the pair of faces, the counters.
    fn finish(&mut self, slot: Slot, performed: bool, out: &mut OperationFaces) {
        let links = self.links[slot as usize];
        let fl = self.fl(slot);
        out.pair = [fl, fl + 1];
        out.pair_count = 1 + usize::from(links.leaf_r != NONE);
        out.leaves = [links.leaf_l, links.leaf_r];
        out.made = performed;
        self.states[slot as usize].performed = if performed {
            Performed::AtRest
        } else {
            Performed::No
        };
        for dependency in self.dependencies(slot) {
            let count = &mut self.states[dependency as usize].dependents;
            *count = if performed { *count + 1 } else { *count - 1 };
        }
        if performed {
            self.active_faces += out.pair_count as u32;
            self.performed += 1;
        } else {
            self.active_faces -= out.pair_count as u32;
            self.performed -= 1;
        }
    }
}

#[cfg(test)]
mod tests;
