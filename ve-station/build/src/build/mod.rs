//! From a triangle soup to a space-partitioned progressive mesh.
//!
//! | step | module | does |
//! |---|---|---|
//! | 1 | `import` | reads OBJ, PLY, STL, OFF with positions in f64 |
//! | 2 | `clean` | drops what is no surface, and counts it; origin; f32 positions |
//! | 3 | `manifold` | stitches seams, cuts what is not manifold; geometry unchanged |
//! | 4 | `order` | faces in AB-tree order |
//! | 5 | `simplify` | quadric collapses in independent-set rounds: the history |
//! | 6 | `error` | E of every collapse, meanwhile; R of every vertex: the certified error |
//! | 7 | `assemble` | ids, records: [`spm::SpmParts`] |
//! | 8 | `regions` | the grid, what each region needs, closures |
//! | 9 | `hierarchy` | who splits the children of a VSP, how far it reaches; the ladder of tolerances |
//!
//! Everything is deterministic: the same bytes in give the same bytes out, with any number of threads.

mod assemble;
mod clean;
mod cracks;
mod error;
mod hierarchy;
mod import;
mod manifold;
mod order;
mod progress;
mod regions;
mod simplify;

pub use clean::{CleanMesh, clean};
pub use import::{MeshFormat, SoupMesh, is_mesh_file, read_mesh, read_mesh_bytes};
pub use manifold::{ManifoldMesh, cut_to_manifold};
pub use progress::{NoProgress, Progress, TerminalProgress};

use spm::{ErrorScale, SpmParts, write_spm};
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Counted up whenever the builder makes another file from the same mesh; part of a cache's key.
pub const BUILDER_VERSION: u32 = 6;

/// What the user may set (thesis Table 4.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BuildOptions {
    /// Faces of the base mesh to aim at; by default 300 to 700, growing with the mesh.
    pub base_faces: Option<u32>,
    /// Cells along the longest side, a power of two up to 1024; by default such that an occupied
    /// region owns about 40 to 140 faces at median.
    pub regions: Option<u32>,
}

/// What a build of a file took.
#[derive(Debug, Clone, PartialEq)]
pub struct BuildReport {
    /// What was built.
    pub parts: SpmParts,
    /// Length of the file, bytes.
    pub file_bytes: u64,
}

/// Why no SPM could be built.
#[derive(Debug, Error)]
pub enum BuildError {
    /// Whatever is wrong, it is wrong in this file.
    #[error("{}: {error}", path.display())]
    InFile {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        error: Box<BuildError>,
    },
    /// The operating system says no.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// An ending that names no format.
    #[error(
        "this is no mesh file that can be read: give one that ends in .obj, .ply, .stl, .off, .cdpm or .spmtxt"
    )]
    UnknownFormat,
    /// A folder, a pipe, a device.
    #[error("this is no file: give a mesh file")]
    NoFile,
    /// The text cannot be understood.
    #[error("line {line}: {reason}")]
    Line {
        /// Counted from 1.
        line: u64,
        /// What is wrong with it.
        reason: String,
    },
    /// The file cannot be understood.
    #[error("this cannot be read as a {format} mesh: {reason}")]
    Format {
        /// Name of the format.
        format: &'static str,
        /// What is wrong with it.
        reason: String,
    },
    /// Nothing left to build from.
    #[error("no triangle is left of this mesh: {0}")]
    Empty(String),
    /// More than ids can count.
    #[error(
        "this mesh has {0} triangles, more than the {MAX_FACES} that an SPM can hold: split it"
    )]
    TooLarge(u64),
    /// An option out of range.
    #[error("{0}")]
    Option(String),
    /// The builder contradicts itself.
    #[error("the builder made an SPM that fails its own check ({0}): please report this mesh")]
    Internal(String),
}

/// The most triangles of a mesh: ids of all vertices and faces, made ones too, must fit 32 bits.
pub const MAX_FACES: u64 = 1 << 29;

impl BuildError {
    /// The same error, naming the file that it is about.
    #[must_use]
    pub fn in_file(self, path: &Path) -> Self {
        Self::InFile {
            path: path.to_path_buf(),
            error: Box::new(self),
        }
    }
}

impl BuildOptions {
    /// Checks what was typed.
    ///
    /// # Errors
    /// When a number is out of range.
    pub fn check(&self) -> Result<(), BuildError> {
        if let Some(divisions) = self.regions
            && !(divisions.is_power_of_two() && divisions <= spm::RegionGrid::MAX_DIVISIONS)
        {
            return Err(BuildError::Option(format!(
                "--regions {divisions} is not possible: give a power of two from 1 to {}",
                spm::RegionGrid::MAX_DIVISIONS
            )));
        }
        if self.base_faces == Some(0) {
            return Err(BuildError::Option(
                "--base-faces 0 is not possible: a mesh keeps at least one face".to_string(),
            ));
        }
        Ok(())
    }
}

/// Builds all that an SPM file holds, content hash included.
///
/// # Errors
/// When an option is out of range or nothing of the mesh is left after cleaning.
pub fn build_model(
    mesh: SoupMesh,
    options: &BuildOptions,
    progress: &dyn Progress,
) -> Result<SpmParts, BuildError> {
    options.check()?;
    progress.phase("cleaning", mesh.triangles.len() as u64);
    let cleaned = clean(mesh)?;
    progress.phase("cutting to a manifold", cleaned.triangles.len() as u64);
    let manifold = cut_to_manifold(&cleaned);
    let origin = cleaned.origin;
    drop(cleaned);
    progress.phase("ordering the tree", manifold.triangles.len() as u64);
    let manifold = order::in_tree_order(manifold);
    let target = options
        .base_faces
        .unwrap_or_else(|| (manifold.triangles.len() as u32 / 100).clamp(300, 700));
    let scale = ErrorScale::for_diagonal(assemble::bounds_of(&manifold).diagonal());
    let history = simplify::simplify(&manifold, target, scale, progress);
    assemble::assemble(origin, &manifold, history, options.regions, progress)
}

/// Builds an SPM file from a mesh file. The file appears whole or not at all.
///
/// # Errors
/// When the mesh cannot be read or built, or the file cannot be written; the file is named.
pub fn build_file(
    input: &Path,
    output: &Path,
    options: &BuildOptions,
    progress: &dyn Progress,
) -> Result<BuildReport, BuildError> {
    options.check()?;
    let in_input = |e: BuildError| e.in_file(input);
    progress.phase("reading", 0);
    let mesh = read_mesh(input).map_err(in_input)?;
    let parts = build_model(mesh, options, progress).map_err(in_input)?;
    progress.phase("writing", 0);
    let file_bytes = write_file(&parts, output).map_err(|e| BuildError::Io(e).in_file(output))?;
    Ok(BuildReport { parts, file_bytes })
}

/// Writes an SPM file: to a temporary file beside it, renamed when whole. Returns its length.
///
/// # Errors
/// When the folder cannot be written to.
pub fn write_file(parts: &SpmParts, output: &Path) -> io::Result<u64> {
    write_whole(output, |out| write_spm(parts, out))
}

/// Writes a file through a temporary one in the same folder, renamed when whole.
pub fn write_whole<T>(
    output: &Path,
    write: impl FnOnce(&mut io::BufWriter<&std::fs::File>) -> io::Result<T>,
) -> io::Result<T> {
    let folder = match output.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let temporary = tempfile::Builder::new()
        .prefix(".ve-station-")
        .permissions(readable_by_all())
        .tempfile_in(folder)?;
    let mut out = io::BufWriter::new(temporary.as_file());
    let written = write(&mut out)?;
    io::Write::flush(&mut out)?;
    drop(out);
    temporary.as_file().sync_all()?;
    temporary.persist(output).map_err(|e| e.error)?;
    Ok(written)
}

/// What a plain new file gets before the umask: a temporary one would be private.
fn readable_by_all() -> std::fs::Permissions {
    std::os::unix::fs::PermissionsExt::from_mode(0o666)
}
