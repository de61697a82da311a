//! SPM files out: as a plain mesh that any viewer shows, or in the thesis's own text formats.
//!
//! | ending | is |
//! |---|---|
//! | `obj`, `ply`, `stl`, `off` | the mesh of a front, the full mesh by default |
//! | `cdpm` | base mesh and splits as in the thesis's appendix A |
//! | `spmtxt` | base mesh, cells and splits as in its appendix B |
//!
//! A front is given by a number of faces (a prefix of the sequence) or by a tolerance ({E > t}); in
//! a thesis format its splits are all that is written. Memory: 130 B a split of the model.

mod plain;
mod thesis;

use crate::inspect::{InspectError, open};
use glam::DVec3;
use spm::ModelHeader;
use spm::{ActiveMesh, Certified, ErrorScale, FileError, NONE, OperationFaces, SpmFile, VspRecord};
use spm_builder::{try_output, write_atomically};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// The formats that are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExportFormat {
    /// Wavefront OBJ.
    Obj,
    /// PLY, little-endian binary.
    Ply,
    /// STL, binary; text where the model lies far from its origin.
    Stl,
    /// OFF, text.
    Off,
    /// The thesis's CDPM text.
    Cdpm,
    /// The thesis's SPM text.
    SpmText,
}

impl ExportFormat {
    /// All formats, by ending.
    pub const ENDINGS: [(&'static str, Self); 6] = [
        ("obj", Self::Obj),
        ("ply", Self::Ply),
        ("stl", Self::Stl),
        ("off", Self::Off),
        ("cdpm", Self::Cdpm),
        ("spmtxt", Self::SpmText),
    ];

    /// The format of a name or an ending.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let mut known = Self::ENDINGS.iter();
        known
            .find(|(ending, _)| name.eq_ignore_ascii_case(ending))
            .map(|&(_, format)| format)
    }
}

/// Which front is exported.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Detail {
    /// Every split.
    #[default]
    Full,
    /// The splits from the first on, as long as there are at most so many faces.
    Faces(u32),
    /// The splits whose expected error is larger, model units.
    Tolerance(f64),
}

/// Why nothing was exported.
#[derive(Debug, Error)]
pub enum ExportError {
    /// The model cannot be opened.
    #[error("{0}")]
    Open(#[from] InspectError),
    /// A block of the model is damaged.
    #[error("{}: {error}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        error: FileError,
    },
    /// The parts of the model do not fit each other.
    #[error("{}: the vertex split records of this SPM file do not fit its mesh: build it again", .0.display())]
    Inconsistent(PathBuf),
    /// The ending names no format.
    #[error(
        "{}: a model is exported as .obj, .ply, .stl, .off, .cdpm or .spmtxt: give the file one of these endings, or --format",
        .0.display()
    )]
    UnknownFormat(PathBuf),
    /// A tolerance that is none.
    #[error("--tolerance {0} is not possible: give an error in model units, 0 or more")]
    Tolerance(f64),
    /// The operating system says no.
    #[error("{}: {error}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What it says.
        error: io::Error,
    },
}

/// What was exported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Exported {
    /// Vertices of the front.
    pub vertices: u32,
    /// Faces of the front.
    pub faces: u32,
    /// Splits of the front.
    pub vsps: u32,
    /// Length of the file, or of what went into a pipe.
    pub file_bytes: u64,
}

/// Writes a front of an SPM file. The ending of `output` names the format, if `format` does not.
/// The file appears whole or not at all.
///
/// # Errors
/// When the model is refused or damaged, the format unknown, or the file cannot be written.
pub fn export(
    input: &Path,
    output: &Path,
    format: Option<ExportFormat>,
    detail: Detail,
) -> Result<Exported, ExportError> {
    let ending = output.extension().and_then(|ending| ending.to_str());
    let format = format
        .or_else(|| ExportFormat::named(ending.unwrap_or_default()))
        .ok_or_else(|| ExportError::UnknownFormat(output.to_path_buf()))?;
    if let Detail::Tolerance(tolerance) = detail
        && !(tolerance >= 0.0 && tolerance.is_finite())
    {
        return Err(ExportError::Tolerance(tolerance));
    }
    let failed = |error| ExportError::Io {
        path: output.to_path_buf(),
        error,
    };
    // First: the work may be long.
    try_output(output).map_err(failed)?;
    let file = open(input)?;
    let front = Front::new(&file, detail, input)?;
    let written = write_atomically(output, |out| {
        let mut out = Counted { out, bytes: 0 };
        write_front(&front, format, &mut out)?;
        Ok(out.bytes)
    });
    let file_bytes = written.map_err(failed)?;
    Ok(Exported {
        vertices: front.header.base_vertices + front.splits.len() as u32,
        faces: front.faces,
        vsps: front.splits.len() as u32,
        file_bytes,
    })
}

/// Counts what is written: a pipe has no length that could be asked for.
struct Counted<W> {
    out: W,
    bytes: u64,
}

impl<W: Write> Write for Counted<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.out.write(bytes)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// Writes a front in a format.
///
/// # Errors
/// When the output fails.
pub(crate) fn write_front(
    front: &Front,
    format: ExportFormat,
    out: &mut impl Write,
) -> io::Result<()> {
    match format {
        ExportFormat::Cdpm => thesis::write_cdpm(front, out),
        ExportFormat::SpmText => thesis::write_spm_text(front, out),
        ExportFormat::Obj => plain::Surface::of(front).write_obj(out),
        ExportFormat::Ply => plain::Surface::of(front).write_ply(out),
        ExportFormat::Stl => plain::Surface::of(front).write_stl(out),
        ExportFormat::Off => plain::Surface::of(front).write_off(out),
    }
}

/// A front of a model, performed once to see that it fits.
pub(crate) struct Front {
    header: ModelHeader,
    /// The base mesh with the records of the front loaded in the slots of their numbers.
    base: ActiveMesh,
    /// Leaf codes of the base faces.
    base_leaves: Vec<u32>,
    /// The records of the front, ascending.
    splits: Vec<VspRecord>,
    /// Faces of the front.
    faces: u32,
    /// All splits of the front performed.
    refined: ActiveMesh,
}

impl Front {
    fn new<D: AsRef<[u8]>>(
        file: &SpmFile<D>,
        detail: Detail,
        path: &Path,
    ) -> Result<Self, ExportError> {
        let inconsistent = || ExportError::Inconsistent(path.to_path_buf());
        let header = file.model_header();
        let scale = ErrorScale::for_diagonal(header.diagonal);
        let mut base = ActiveMesh::new(header.base_vertices, header.base_faces, header.vsps);
        for (k, vertex) in (0u32..).zip(file.base_vertices()) {
            base.set_base_vertex(k, vertex.position, Certified::EXACT);
        }
        for (k, face) in (0u32..).zip(file.base_faces()) {
            base.set_base_face(k, face.corners, face.neighbours)
                .ok_or_else(inconsistent)?;
        }
        let mut refined = base.clone();
        let mut splits = Vec::new();
        let mut out = OperationFaces::new();
        let mut faces = header.base_faces;
        for i in 0..header.vsps {
            let record = file.record(i).map_err(|error| ExportError::File {
                path: path.to_path_buf(),
                error,
            })?;
            let more = 1 + u32::from(record.has_right_face());
            match detail {
                Detail::Faces(most) if faces + more > most => break,
                Detail::Tolerance(tolerance) if scale.decode(record.e) <= tolerance => continue,
                _ => {}
            }
            for mesh in [&mut base, &mut refined] {
                mesh.load(i, &record, record.vs, record.fn_, [Certified::EXACT; 2]);
            }
            if !refined.split_is_legal(i) {
                return Err(inconsistent());
            }
            refined.split(i, &mut out).map_err(|_| inconsistent())?;
            splits.push(record);
            faces += more;
        }
        Ok(Self {
            header,
            base,
            base_leaves: file.base_faces().iter().map(|face| face.leaf).collect(),
            splits,
            faces,
            refined,
        })
    }

    /// Position of a vertex in the coordinates of the mesh file that the model was built from.
    fn position(&self, vertex: u32) -> [f64; 3] {
        let position = self.refined.position(vertex).as_dvec3();
        (position + DVec3::from_array(self.header.origin)).to_array()
    }

    /// Whether positions are f32, since the model has no origin of its own.
    fn is_single(&self) -> bool {
        self.header.origin == [0.0; 3]
    }

    /// Leaf code of a face of the front.
    fn leaf(&self, face: u32) -> u32 {
        match self.refined.creator_of_face(face) {
            None => self.base_leaves[face as usize],
            Some(slot) => {
                let (left, right) = self.refined.leaves(slot);
                if face == self.header.sizes().fl(slot) {
                    left
                } else {
                    right
                }
            }
        }
    }

    /// For every vertex id whether a split of the front splits it.
    fn is_split(&self) -> Vec<bool> {
        let sizes = self.header.sizes();
        let mut split = vec![false; sizes.vt(sizes.vsps) as usize];
        for record in &self.splits {
            split[record.vs as usize] = true;
        }
        split
    }

    /// For every split of the model its place in the front, [`NONE`] of others.
    fn ranks(&self) -> Vec<u32> {
        let mut ranks = vec![NONE; self.header.vsps as usize];
        for (rank, record) in (0u32..).zip(&self.splits) {
            ranks[record.i as usize] = rank;
        }
        ranks
    }
}
