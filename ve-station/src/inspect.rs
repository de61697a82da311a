//! What an SPM file holds: counts, dependencies, closures, the tables of errors, and how fast a
//! probe may go.

mod file_units;
mod model_picture;
mod seams;
mod tolerance_table;

pub use model_picture::{Axis, model_picture};
pub use seams::{Seam, Seams};
pub use tolerance_table::{ToleranceRow, tolerance_table};

use crate::file_bytes::FileBytes;
use crate::tuning::inspect::{ERROR_SHARES, LEAD_S, MAX_AREAS, RADII_AROUND};
pub use crate::tuning::inspect::{OPERATIONS_A_TICK, PERIOD_S, PROBE_RADIUS_M};
use file_units::rounded;
use picture::PictureError;
use serde::Serialize;
use spm::ModelHeader;
use spm::{BuildSummary, ErrorScale, FileError, SpmFile};
use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why a file could not be inspected.
#[derive(Debug, Error)]
pub enum InspectError {
    /// The operating system says no.
    #[error("{}: {error}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What it says.
        error: io::Error,
    },
    /// The file is refused.
    #[error("{}: {error}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        error: FileError,
    },
    /// There is no picture of it.
    #[error("{}: {error}", path.display())]
    Picture {
        /// The file.
        path: PathBuf,
        /// Why.
        error: PictureError,
    },
    /// A size that is none.
    #[error("--size {0} is not possible: give the longest side in metres, more than 0")]
    Size(f64),
}

/// Opens an SPM file.
///
/// # Errors
/// When the file cannot be opened or is refused; the file is named.
pub fn open(path: &Path) -> Result<SpmFile<FileBytes>, InspectError> {
    let bytes = FileBytes::open(path).map_err(|error| InspectError::Io {
        path: path.to_path_buf(),
        error,
    })?;
    SpmFile::open(bytes).map_err(|error| InspectError::File {
        path: path.to_path_buf(),
        error,
    })
}

/// Vertices and triangles of a mesh file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Read {
    /// Vertices.
    pub vertices: u64,
    /// Triangles; polygons count as the triangles of their fan.
    pub faces: u64,
}

/// What cleaning dropped.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Dropped {
    /// Vertices with a coordinate that is not finite.
    pub not_finite_vertices: u64,
    /// Faces with such a corner.
    pub not_finite_faces: u64,
    /// Faces that name a vertex that does not exist.
    pub out_of_range_faces: u64,
    /// Faces without area.
    pub zero_area_faces: u64,
    /// Copies of a face, same orientation.
    pub duplicate_faces: u64,
    /// Vertices that no face uses.
    pub unreferenced_vertices: u64,
}

/// The fields of `build --json` and `inspect --json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Facts {
    /// Vertices after cleaning and cutting.
    pub vertices: u64,
    /// Faces after cleaning.
    pub faces: u32,
    /// As read.
    pub read: Read,
    /// Dropped by cleaning.
    pub dropped: Dropped,
    /// Faces added where an edge took in the corner of a face without area.
    pub split_faces: u64,
    /// Vertices that became one along seams.
    pub stitched_vertices: u64,
    /// Vertices added by the cut.
    pub cut_vertices: u64,
    /// Vertices that never collapse, because a cut touches them.
    pub locked_vertices: u64,
    /// Vertices of the base mesh.
    pub base_vertices: u32,
    /// Faces of the base mesh.
    pub base_faces: u32,
    /// Vertex split records.
    pub vsps: u32,
    /// VSPs in the longest chain of dependencies.
    pub chain: u32,
    /// Occupied regions: those that own a face of the full mesh.
    pub regions: u64,
    /// Regions without a face, kept clear of coarse ones.
    #[serde(rename = "cleared_regions")]
    pub empty_regions: u64,
    /// Cells along the longest side.
    pub divisions: u32,
    /// Mean closure of a region, VSPs.
    pub closure_mean: f64,
    /// Largest closure of a region, VSPs.
    pub closure_max: u32,
    /// Widest gap along a cut on any front, model units.
    pub cracks_max: f64,
    /// A question about the unit of the file, where its size is implausible in metres; else empty.
    pub question: String,
}

impl Facts {
    /// Collects the fields; `regions` counts all, empty ones too.
    #[must_use]
    pub fn new(header: &ModelHeader, summary: &BuildSummary, regions: usize) -> Self {
        let dropped_faces = summary.out_of_range_faces
            + summary.not_finite_faces
            + summary.zero_area_faces
            + summary.duplicate_faces;
        let kept_faces = summary.read_faces.saturating_sub(dropped_faces);
        Self {
            vertices: summary.vertices,
            faces: header.faces,
            read: Read {
                vertices: summary.read_vertices,
                faces: summary.read_faces,
            },
            dropped: Dropped {
                not_finite_vertices: summary.not_finite_vertices,
                not_finite_faces: summary.not_finite_faces,
                out_of_range_faces: summary.out_of_range_faces,
                zero_area_faces: summary.zero_area_faces,
                duplicate_faces: summary.duplicate_faces,
                unreferenced_vertices: summary.unreferenced_vertices,
            },
            split_faces: u64::from(header.faces).saturating_sub(kept_faces),
            stitched_vertices: summary.stitched_vertices,
            cut_vertices: summary.cut_vertices,
            locked_vertices: summary.locked_vertices,
            base_vertices: header.base_vertices,
            base_faces: header.base_faces,
            vsps: header.vsps,
            chain: header.dependency_depth,
            regions: (regions as u64).saturating_sub(summary.empty_regions),
            empty_regions: summary.empty_regions,
            divisions: header.grid.divisions,
            closure_mean: finite(summary.closure_mean),
            closure_max: header.closure_max,
            cracks_max: finite(summary.cracks_max),
            question: file_units::question(longest_side(header)),
        }
    }

    /// The summary as lines of text.
    #[must_use]
    pub fn to_text(&self) -> String {
        let Self { read, dropped, .. } = self;
        let mut text = String::new();
        let mut line = |label: &str, value: String| {
            let _ = writeln!(text, "{label:<12} {value}");
        };
        let mesh = |vertices: u64, faces: u32| format!("{vertices} vertices, {faces} faces");
        line(
            "read",
            format!("{} vertices, {} triangles", read.vertices, read.faces),
        );
        let dropped = [
            (dropped.not_finite_vertices, "vertices not finite"),
            (dropped.not_finite_faces, "faces with such a corner"),
            (dropped.out_of_range_faces, "faces that name no vertex"),
            (dropped.zero_area_faces, "faces without area"),
            (dropped.duplicate_faces, "copies of a face"),
            (dropped.unreferenced_vertices, "vertices that no face uses"),
        ];
        line("dropped", list(&dropped));
        let changed = [
            (self.split_faces, "faces added beside faces without area"),
            (self.stitched_vertices, "vertices stitched along seams"),
            (self.cut_vertices, "vertices added by cutting to a manifold"),
            (self.locked_vertices, "vertices locked beside cuts"),
        ];
        line("changed", list(&changed));
        if self.cracks_max > 0.0 {
            line(
                "cracks",
                format!(
                    "along cuts on coarse meshes: at most {:.3e} wide, both sides within the certified error",
                    self.cracks_max
                ),
            );
        }
        line("full mesh", mesh(self.vertices, self.faces));
        let base_vertices = self.base_vertices.into();
        line("base mesh", mesh(base_vertices, self.base_faces));
        line(
            "splits",
            format!(
                "{}, longest chain of dependencies {}",
                self.vsps, self.chain
            ),
        );
        line(
            "regions",
            format!(
                "{} occupied, {} cleared, {} cells along the longest side",
                self.regions, self.empty_regions, self.divisions
            ),
        );
        line(
            "closures",
            format!(
                "mean {:.1}, largest {} splits",
                self.closure_mean, self.closure_max
            ),
        );
        if !self.question.is_empty() {
            line("unit?", self.question.clone());
        }
        text
    }
}

/// The counts that are not zero, in words.
fn list(counts: &[(u64, &str)]) -> String {
    let parts: Vec<String> = counts
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
        .collect();
    if parts.is_empty() {
        "nothing".to_string()
    } else {
        parts.join(", ")
    }
}

/// JSON has no NaN and no infinity.
fn finite(x: f64) -> f64 {
    if x.is_finite() { x } else { 0.0 }
}

/// One row of the error table.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ErrorRow {
    /// Certified error, share of the diagonal.
    pub share_of_diagonal: f64,
    /// Certified error, model units.
    pub error: f64,
    /// VSPs of the smallest front in which no vertex with a larger R is left.
    pub vsps: u32,
}

/// What `inspect` finds beyond the header.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Inspection {
    /// The header's fields.
    #[serde(flatten)]
    pub facts: Facts,
    /// Length of the file, bytes.
    pub file_bytes: u64,
    /// Content hash, hexadecimal.
    pub model: String,
    /// Longest side of the model's box, model units.
    pub longest_side: f64,
    /// Area of the full mesh, square model units.
    pub area: f64,
    /// Certified error against VSPs.
    pub errors: Vec<ErrorRow>,
    /// The tolerance levels: expected error against VSPs, and what its regions hold.
    #[serde(rename = "dial")]
    pub tolerances: Vec<ToleranceRow>,
    /// Longest side in the world, metres: as asked, or 0.15.
    pub size_m: f64,
    /// Greatest speed at full resolution at that size, m/s: see [`greatest_speed`].
    pub greatest_speed_m_per_s: f64,
}

/// Inspects a file, every block of it checked.
///
/// # Errors
/// When the file is missing, refused or damaged anywhere, or `size_m` is no length.
pub fn inspect(path: &Path, size_m: f64) -> Result<Inspection, InspectError> {
    if !(size_m.is_finite() && size_m > 0.0) {
        return Err(InspectError::Size(size_m));
    }
    let file = open(path)?;
    let refused = |error| InspectError::File {
        path: path.to_path_buf(),
        error,
    };
    file.check_all().map_err(refused)?;
    let header = file.model_header();
    let longest_side = longest_side(&header);
    let area = area(&file).map_err(refused)?;
    let motion = Motion {
        metres_per_unit: size_m / longest_side,
        probe_radius_m: PROBE_RADIUS_M,
        operations: OPERATIONS_A_TICK,
        period_s: PERIOD_S,
    };
    Ok(Inspection {
        facts: Facts::new(&header, &file.summary(), file.regions().len()),
        file_bytes: file.file_bytes(),
        model: format!("{:016x}", header.model),
        longest_side,
        area,
        errors: error_table(&file).map_err(refused)?,
        tolerances: tolerance_table(&file, motion.metres_per_unit).map_err(refused)?,
        size_m,
        greatest_speed_m_per_s: greatest_speed(&header, area, motion),
    })
}

/// Longest side of a model's box, model units.
#[must_use]
pub fn longest_side(header: &ModelHeader) -> f64 {
    (0..3)
        .map(|k| header.upper[k] - header.lower[k])
        .fold(0.0, f64::max)
}

/// Area of the full mesh, square model units; of large meshes from some faces, evenly spread in
/// tree order.
///
/// # Errors
/// When a block is damaged.
pub fn area<D: AsRef<[u8]>>(file: &SpmFile<D>) -> Result<f64, FileError> {
    let faces = file.model_header().faces;
    let step = faces.div_ceil(MAX_AREAS).max(1);
    let mut area = 0.0;
    let mut counted = 0u32;
    for position in (0..faces).step_by(step as usize) {
        let [a, b, c] = file.leaf_corners(position)?;
        area += 0.5 * (b - a).cross(c - a).length();
        counted += 1;
    }
    Ok(area * f64::from(faces) / f64::from(counted.max(1)))
}

/// Who touches a model, and at which size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Size of the model, metres a unit.
    pub metres_per_unit: f64,
    /// Radius of the probe, metres.
    pub probe_radius_m: f64,
    /// Mesh operations a tick.
    pub operations: f64,
    /// Period of the tick, seconds.
    pub period_s: f64,
}

/// The greatest speed at full resolution, m/s: K / (faces a square metre x width of the patch x
/// period), where the patch is as wide as what is refined around the probe, a cell, and on both
/// sides a lead that grows with the speed. As the controller counts it, but by the area of the full
/// mesh: by that of the base mesh, which is smaller, it comes to less.
#[must_use]
pub fn greatest_speed(header: &ModelHeader, area: f64, motion: Motion) -> f64 {
    let metres = motion.metres_per_unit;
    let density = f64::from(header.faces) / (area * metres * metres);
    let width = 2.0 * RADII_AROUND * motion.probe_radius_m + header.grid.cell * metres;
    // speed * (width + 2 lead speed) = product
    let product = motion.operations / (density * motion.period_s);
    let root = (width * width + 8.0 * LEAD_S * product).sqrt();
    finite(2.0 * product / (width + root))
}

/// For each certified error the size of the smallest front that keeps it.
fn error_table<D: AsRef<[u8]>>(file: &SpmFile<D>) -> Result<Vec<ErrorRow>, FileError> {
    let header = file.model_header();
    let sizes = header.sizes();
    let scale = ErrorScale::for_diagonal(header.diagonal);
    let mut rows = Vec::new();
    for share in ERROR_SHARES {
        let error = share * header.diagonal;
        let mut needed = vec![false; sizes.vsps as usize];
        for i in (0..sizes.vsps).rev() {
            let record = file.record(i)?;
            let certified = match sizes.creator_of_vertex(record.vs) {
                None => {
                    let vertex = file.base_vertices().get(record.vs as usize);
                    vertex.map(|vertex| scale.certified_of_base(vertex))
                }
                Some(creator) => {
                    let [t, u] = scale.certified(&file.record(creator)?);
                    Some(if record.vs == sizes.vt(creator) { t } else { u })
                }
            };
            let radius = certified.map_or(f32::INFINITY, |certified| certified.radius);
            if needed[i as usize] || f64::from(radius) > error {
                needed[i as usize] = true;
                for dependency in record.dependencies(sizes) {
                    needed[dependency as usize] = true;
                }
            }
        }
        rows.push(ErrorRow {
            share_of_diagonal: share,
            error,
            vsps: needed.iter().filter(|&&n| n).count() as u32,
        });
    }
    Ok(rows)
}

impl Inspection {
    /// Everything as text.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut text = self.facts.to_text();
        let _ = writeln!(
            text,
            "{:<12} {} bytes, content {}",
            "file", self.file_bytes, self.model
        );
        let _ = writeln!(
            text,
            "{:<12} the longest side is {} in the file's unit",
            "size",
            rounded(self.longest_side)
        );
        let _ = writeln!(
            text,
            "\ncertified error, file's unit   share of diagonal   splits needed"
        );
        for row in &self.errors {
            let share = f64::from(row.vsps) / f64::from(self.facts.vsps.max(1));
            let _ = writeln!(
                text,
                "{:>28} {:>17.1} % {:>8} ({:.1} %)",
                rounded(row.error),
                100.0 * row.share_of_diagonal,
                row.vsps,
                100.0 * share
            );
        }
        let _ = writeln!(
            text,
            "\nlevel   tolerance, file's unit   at {} m, mm   splits needed     regions   closure mean   largest",
            self.size_m
        );
        for row in &self.tolerances {
            let share = f64::from(row.vsps) / f64::from(self.facts.vsps.max(1));
            let _ = writeln!(
                text,
                "{:>5} {:>24} {:>14} {:>8} ({:>5.1} %) {:>9} {:>14.1} {:>9}",
                row.level,
                rounded(row.tolerance),
                rounded(1e3 * row.tolerance_m),
                row.vsps,
                100.0 * share,
                row.regions,
                row.closure_mean,
                row.closure_max
            );
        }
        let _ = writeln!(
            text,
            "\nAt {} m a probe of 1 mm radius can move at {:.3} m/s at full resolution \
             ({OPERATIONS_A_TICK} operations a tick of 1 ms);\nabove that resolution follows speed.",
            self.size_m, self.greatest_speed_m_per_s
        );
        text
    }
}
