//! Fronts of built models: legal, within their certified error, and the same on every way to them.

#[path = "../common/mod.rs"]
mod common;

mod ab_tree_on_fronts;
mod certified_faces;
mod flights;
mod fronts_at_tolerances;
mod large_fans;
mod loaded_cells_are_the_full_mesh;
mod quartered_faces;
mod swept_over;
mod theorem_4;
