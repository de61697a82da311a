//! Level of detail: which regions the probes will need, and the front that refines them.

pub(crate) mod approach;
pub mod cells;
pub(crate) mod forecast;
pub(crate) mod front;
pub(crate) mod geomorph;
pub mod lod_controller;
pub(crate) mod memory_pressure;
pub mod predict;
mod prediction;
pub(crate) mod predictions;
pub(crate) mod refine;
mod room;
