//! Level of detail: what to refine, and how far.

pub mod lod_controller;
pub mod predict;
