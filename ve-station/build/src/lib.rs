//! From a mesh file to a space-partitioned progressive mesh, and shapes of known geometry to make one from.

pub mod build;
pub mod generate;
