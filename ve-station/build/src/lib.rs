//! From a mesh file to a space-partitioned progressive mesh (SPM), and shapes of known geometry.
//!
//! | step | module | does |
//! |---|---|---|
//! | 1 | `import` | reads OBJ, PLY, STL, OFF with positions in f64: [`SoupMesh`] |
//! | 2 | `clean` | drops flat and duplicate faces, counts them; origin; f32 positions |
//! | | `t_junctions` | gives the faces beside flat ones their corners |
//! | 3 | `manifold` | stitches seams, cuts what is not manifold; geometry unchanged |
//! | 4 | `order` | faces in AB-tree order |
//! | 5 | `simplify` | quadric collapses in independent-set rounds: the `history` |
//! | 6 | `model_error` | E of every collapse, and R and C of every vertex: the certified error |
//! | 7 | `ids`, `assemble` | numbers and records: [`spm::SpmParts`] |
//! | 8 | `default_grid`, `regions` | the grid, the seeds of each region, closures |
//! | 9 | `hierarchy` | children of each VSP, bounds of its descendants; tolerance levels |
//! | 10 | `write` | files that appear whole or not at all |
//!
//! `build` runs the steps; [`generate`] makes meshes to build from. The output is deterministic:
//! the same bytes in give the same bytes out, on every machine and for any number of threads.

mod assemble;
mod build;
mod classes;
mod clean;
mod cracks;
mod default_grid;
mod edges;
mod error;
pub mod generate;
mod hierarchy;
mod history;
mod ids;
mod import;
mod locks;
mod manifold;
mod mesh;
mod model_error;
mod order;
mod progress;
mod regions;
mod simplify;
mod t_junctions;
mod tuning;
mod write;

pub use build::{BUILDER_VERSION, BuildOptions, BuildReport, build_file, build_model};
pub use clean::{CleanMesh, clean};
pub use error::{BuildError, MAX_FACES};
pub use import::{MeshFormat, is_mesh_file, read_mesh, read_mesh_bytes};
pub use manifold::{ManifoldMesh, cut_to_manifold};
pub use mesh::SoupMesh;
pub use order::in_tree_order;
pub use progress::{NoProgress, Progress, TerminalProgress};
pub use write::{
    MeshWriteError, check_room, make_mesh_file, max_spm_bytes, standard_output, try_output,
    write_atomically, write_mesh, write_ply, write_spm_file,
};
