//! Layout of an SPM file.

use crate::{BaseFace, BaseVertex, ModelHeader, QuarteredFace};
use crate::{RegionId, VspNode, VspRecord};
use bytemuck::{Pod, Zeroable};
use geometry::Aabb;

/// The first eight bytes of every SPM file.
pub(super) const MAGIC: [u8; 8] = *b"hrtc-spm";

/// Version of the layout; other versions are refused with their number.
pub const FORMAT_VERSION: u32 = 7;

/// Bytes under one checksum of a big section.
pub const BLOCK_BYTES: u64 = 1 << 16;

/// Sections start at multiples of this, bytes: a record is one cache line.
pub(super) const ALIGNMENT: u64 = 64;

/// The sections, in the order of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
pub enum Section {
    /// Vertices of the base mesh ([`crate::BaseVertex`]).
    BaseVertices = 0,
    /// Faces of the base mesh ([`crate::BaseFace`]).
    BaseFaces = 1,
    /// Occupied and empty regions, ascending ([`crate::RegionId`]).
    Regions = 2,
    /// Start of each region's seeds; one entry more than regions (u32).
    SeedOffsets = 3,
    /// Checksums of the blocks of the big sections, section after section (u64).
    BlockSums = 4,
    /// The VSP that splits each base vertex, [`crate::NONE`] for a vertex of the full mesh (u32).
    BaseSplits = 5,
    /// The faces whose quarters have bounds, ascending ([`crate::QuarteredFace`]).
    Quartered = 6,
    /// The VSPs that create the faces of a region and their corners, and those that keep coarse
    /// faces out of its cell; ascending in each region (u32).
    Seeds = 7,
    /// Vertex split records ([`crate::VspRecord`]).
    Records = 8,
    /// The full mesh in AB-tree order ([`FullFace`]).
    FullFaces = 9,
    /// Boxes over the full mesh, in heap order ([`geometry::Aabb`]).
    Boxes = 10,
    /// The vertex hierarchy, one node for each VSP ([`crate::VspNode`]).
    Hierarchy = 11,
}

impl Section {
    /// Number of sections.
    pub(super) const COUNT: usize = 12;
    /// Checked whole when the file is opened.
    pub(super) const SMALL: [Self; 7] = [
        Self::BaseVertices,
        Self::BaseFaces,
        Self::Regions,
        Self::SeedOffsets,
        Self::BlockSums,
        Self::BaseSplits,
        Self::Quartered,
    ];
    /// Checked block by block when first used, in the order of their checksums.
    pub(super) const BIG: [Self; 5] = [
        Self::Seeds,
        Self::Records,
        Self::FullFaces,
        Self::Boxes,
        Self::Hierarchy,
    ];

    /// Bytes of one item.
    pub(super) const fn item_bytes(self) -> u64 {
        let bytes = match self {
            Self::BaseVertices => size_of::<BaseVertex>(),
            Self::BaseFaces => size_of::<BaseFace>(),
            Self::Regions => size_of::<RegionId>(),
            Self::SeedOffsets | Self::Seeds | Self::BaseSplits => size_of::<u32>(),
            Self::BlockSums => size_of::<u64>(),
            Self::Records => size_of::<VspRecord>(),
            Self::FullFaces => size_of::<FullFace>(),
            Self::Boxes => size_of::<Aabb>(),
            Self::Hierarchy => size_of::<VspNode>(),
            Self::Quartered => size_of::<QuarteredFace>(),
        };
        bytes as u64
    }

    /// The name in messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::BaseVertices => "base vertices",
            Self::BaseFaces => "base faces",
            Self::Regions => "regions",
            Self::SeedOffsets => "seed offsets",
            Self::BlockSums => "block checksums",
            Self::Seeds => "seeds",
            Self::Records => "records",
            Self::FullFaces => "full faces",
            Self::Boxes => "boxes",
            Self::BaseSplits => "base splits",
            Self::Hierarchy => "hierarchy",
            Self::Quartered => "quartered faces",
        }
    }
}

impl std::fmt::Display for Section {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// A face of the full mesh.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct FullFace {
    /// Corners, counterclockwise, vertex ids (base vertex or child of a VSP).
    pub corners: [u32; 3],
    /// Face id: below F0 a base face, otherwise created by VSP (id - F0) / 2.
    pub face: u32,
}

/// Counts of the builder, for `inspect`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
pub struct BuildSummary {
    /// Vertices in the mesh file.
    pub read_vertices: u64,
    /// Triangles in the mesh file (polygons triangulated).
    pub read_faces: u64,
    /// Vertices of the cleaned mesh, which is the full mesh.
    pub vertices: u64,
    /// Dropped: vertices with a coordinate that is not finite or beyond f32.
    pub not_finite_vertices: u64,
    /// Dropped: faces with such a corner.
    pub not_finite_faces: u64,
    /// Dropped: faces that name a vertex that does not exist.
    pub out_of_range_faces: u64,
    /// Dropped: faces without area, or with a corner twice.
    pub zero_area_faces: u64,
    /// Dropped: second and later copies of a face with the same orientation.
    pub duplicate_faces: u64,
    /// Dropped: vertices that no face uses (after all else was dropped).
    pub unreferenced_vertices: u64,
    /// Vertices merged with another of the same position along a seam.
    pub stitched_vertices: u64,
    /// Vertices added by the cut to a manifold.
    pub cut_vertices: u64,
    /// Vertices that are never collapsed, so no crack opens along a cut.
    pub locked_vertices: u64,
    /// Empty regions: they own no face, but keep coarse faces out of their cells.
    pub empty_regions: u64,
    /// Mean closure of an occupied region, VSPs.
    pub closure_mean: f64,
    /// Widest gap along a cut on any front, model units.
    pub cracks_max: f64,
}

/// Place of a section.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
pub(super) struct SectionEntry {
    /// From the start of the file, bytes; a multiple of 64.
    pub offset: u64,
    /// Items.
    pub count: u64,
    /// xxh3 of the whole section (small ones); zero for the big ones.
    pub checksum: u64,
}

impl SectionEntry {
    /// Bytes of the section, `None` beyond u64.
    pub fn bytes(&self, section: Section) -> Option<u64> {
        self.count.checked_mul(section.item_bytes())
    }
}

/// The first bytes of the file.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct SpmHeader {
    pub(super) magic: [u8; 8],
    pub(super) version: u32,
    pub(super) sections: u32,
    pub(super) file_bytes: u64,
    pub(super) model: ModelHeader,
    pub(super) summary: BuildSummary,
    pub(super) table: [SectionEntry; Section::COUNT],
    /// xxh3 of everything before it.
    pub(super) checksum: u64,
}

/// Depth of the box tree over `faces` faces; its leaves hold four to eight (or all, when fewer).
pub(super) fn box_depth(faces: u32) -> u32 {
    (faces / 4).max(1).ilog2()
}

/// Boxes in the file: heap order from 1, slot 0 unused.
pub(super) fn box_count(faces: u32) -> u64 {
    2 << box_depth(faces)
}

/// Positions in tree order of the faces below a node (a heap index) of the AB-tree's fixed shape.
pub(super) fn faces_below(node: u32, faces: u32) -> std::ops::Range<u32> {
    let (mut first, mut count) = (0, faces);
    for bit in (0..ab_tree::depth(node)).rev() {
        let left = count.div_ceil(2);
        if node >> bit & 1 == 0 {
            count = left;
        } else {
            first += left;
            count -= left;
        }
    }
    first..first + count
}

// The layout of the file: a change needs a new [`FORMAT_VERSION`].
const _: () = {
    use std::mem::offset_of;
    assert!(FORMAT_VERSION == 7);
    assert!(size_of::<SpmHeader>() == 648);
    assert!(offset_of!(SpmHeader, version) == 8 && offset_of!(SpmHeader, sections) == 12);
    assert!(offset_of!(SpmHeader, file_bytes) == 16 && offset_of!(SpmHeader, model) == 24);
    assert!(offset_of!(SpmHeader, summary) == 232 && offset_of!(SpmHeader, table) == 352);
    assert!(offset_of!(SpmHeader, checksum) == 640);
    assert!(size_of::<BuildSummary>() == 120 && size_of::<SectionEntry>() == 24);
    assert!(size_of::<FullFace>() == 16 && offset_of!(FullFace, face) == 12);
    assert!(size_of::<Aabb>() == 24);
};
