//! Level of detail: what to refine, and how far.

mod front;
pub(crate) mod geomorph;
pub mod lod_controller;
pub mod predict;
pub(crate) mod refine;
