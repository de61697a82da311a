//! Level of detail: what to refine, and how far.

pub mod dial;
pub mod predict;
