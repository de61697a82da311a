//! Why no SPM could be built.

use crate::tuning::input::MAX_CORNERS;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

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
    /// A polygon that takes too long to cut.
    #[error(
        "face {face} of this mesh is a polygon of {corners} corners that is not convex, more than the {MAX_CORNERS} that are cut into triangles: cut it into smaller ones"
    )]
    LargePolygon {
        /// The polygon, counted from 1 among the faces of the file.
        face: usize,
        /// Its corners.
        corners: usize,
    },
    /// The disk is too full.
    #[error(
        "a model of {faces} faces may need {needed} bytes in {}, where only {free} are free: make room there, or choose another folder (-o of build, HRTC_CACHE of a scene)",
        folder.display()
    )]
    NoRoom {
        /// The folder of the file.
        folder: PathBuf,
        /// Faces of the mesh.
        faces: u64,
        /// Bytes that are needed at the most.
        needed: u64,
        /// Bytes that are free.
        free: u64,
    },
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
