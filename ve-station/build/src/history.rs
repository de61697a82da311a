//! How a mesh was simplified: collapses, rounds and what they left.

pub use crate::tuning::simplify::MAX_FACES_ROUND_A_VERTEX;

/// One collapse, in ids of the history: vertices and faces of the full mesh keep their numbers, and
/// collapse k makes vertex `full_vertices + k`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Collapse {
    /// First vertex of the edge; fl runs from it to `vu`.
    pub vt: u32,
    /// Second vertex of the edge.
    pub vu: u32,
    /// Face left of the edge.
    pub fl: u32,
    /// Face right of it, `NONE` at a boundary.
    pub fr: u32,
    /// Neighbours as in [`spm::VspRecord::fn_`].
    pub fn_: [u32; 4],
}

/// The collapses of a round: no two touch the same face, so any order of them is as good. They are
/// in the order of their faces in the AB-tree: what is near in space is near in the file.
#[derive(Debug, Default)]
pub struct Round {
    /// The collapses.
    pub made: Vec<Made>,
    /// Faces round the vertices made.
    pub fans: Vec<FanFace>,
}

/// A collapse, and the surface that it left.
#[derive(Debug)]
pub struct Made {
    /// The collapse.
    pub collapse: Collapse,
    /// Where it put the vertex that it made.
    pub point: [f32; 3],
    /// That vertex's slot.
    pub slot: u32,
    /// Its faces among those of the round.
    pub fan: std::ops::Range<u32>,
}

/// A face round the vertex that a collapse made.
#[derive(Debug, Clone, Copy)]
pub struct FanFace {
    /// Its number in the full mesh.
    pub face: u32,
    /// The two corners that follow the vertex counterclockwise.
    pub from: [f32; 3],
    /// The second of them.
    pub to: [f32; 3],
    /// Whether the edge between the vertex and `to` lies on a boundary.
    pub is_last: bool,
}

impl Round {
    /// Faces round the vertex that a collapse made; each spoke but one at a boundary is the `from`
    /// of one.
    pub fn fan(&self, made: &Made) -> &[FanFace] {
        &self.fans[made.fan.start as usize..made.fan.end as usize]
    }
}

/// A mesh and how it was simplified.
#[derive(Debug, Clone)]
pub struct History {
    /// Vertices of the full mesh.
    pub full_vertices: u32,
    /// Positions of the full mesh's vertices, then of those that the collapses made.
    pub positions: Vec<[f32; 3]>,
    /// Collapses in the order in which they were done.
    pub collapses: Vec<Collapse>,
    /// Code of the expected error of each collapse.
    pub expected: Vec<u16>,
    /// R of each vertex that a collapse made, model units.
    pub radius: Vec<f64>,
    /// C of each vertex, model units.
    pub close: Vec<f64>,
    /// What is left: the base mesh, ascending by face.
    pub base: Vec<LeftFace>,
    /// Bounds of the quarters of some faces of fronts {E > t}.
    pub quarters: Vec<QuarterBounds>,
}

/// Bounds of the quarters of a face (see [`spm::QuarteredFace`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QuarterBounds {
    /// Its number in the full mesh.
    pub face: u32,
    /// The first code of t for which its corners are others; `u16::MAX` in the base mesh.
    pub end: u16,
    /// The part of it that is cut in four.
    pub part: u16,
    /// Model units; in the order of the corners in a file.
    pub bounds: [f64; 4],
}

/// A face that simplification left, in ids of the history.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LeftFace {
    /// Its number in the full mesh.
    pub face: u32,
    /// Corners, counterclockwise.
    pub corners: [u32; 3],
    /// The face across the edge opposite each corner, `NONE` at a boundary.
    pub neighbours: [u32; 3],
}
