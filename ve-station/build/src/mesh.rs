//! The mesh that goes in.

/// A triangle soup as read: nothing checked.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SoupMesh {
    /// Positions, model units; may be anything.
    pub positions: Vec<[f64; 3]>,
    /// Corners, counterclockwise; may name no vertex ([`u32::MAX`] when the file's number is beyond
    /// u32).
    pub triangles: Vec<[u32; 3]>,
}
