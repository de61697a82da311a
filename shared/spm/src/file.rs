//! The SPM file: versioned, little-endian, used directly from a memory map.
//!
//! | section | items | checked |
//! |---|---|---|
//! | header | sizes, grid, what the builder did, table of sections | on open |
//! | base vertices, base faces, quartered faces | 16, 32, 12 B | on open |
//! | regions, seed offsets, base splits | 4 B each | on open |
//! | seeds, records, full faces | 4, 64, 16 B | a 64-KiB block, when first used |
//! | boxes, hierarchy | 24, 20 B | a 64-KiB block, when first used |
//!
//! Sections start at multiples of 64 bytes. Every size is checked against the length of the data
//! first; opening allocates one byte for each block and nothing else.

mod hexagon;
mod layout;
mod query;
#[cfg(test)]
mod tests;
mod write;

pub use layout::{BLOCK_BYTES, BuildSummary, FORMAT_VERSION, FullFace, Section, SpmHeader};
pub use write::{SpmParts, write_spm};

use crate::{BaseFace, BaseVertex, ModelHeader, QuarteredFace};
use crate::{NONE, RecordError, RegionId, VspNode, VspRecord};
use bytemuck::{AnyBitPattern, Pod};
use layout::{ALIGNMENT, MAGIC, box_count};
use std::ops::Range;
use std::sync::atomic::{AtomicU8, Ordering};
use thiserror::Error;
use xxhash_rust::xxh3::xxh3_64;

/// Errors of reading an SPM file.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum FileError {
    /// Other magic bytes.
    #[error("this is not an SPM file: build one with `ve-station build MESH -o FILE.spm`")]
    NotSpm,
    /// Another format version.
    #[error(
        "this SPM file has format version {0}, this program reads version {FORMAT_VERSION}: build it again"
    )]
    OtherVersion(u32),
    /// Another length than in the header.
    #[error("this SPM file is {found} bytes long instead of {expected}: copy or build it again")]
    Truncated {
        /// Length by the header, or the length of a header, bytes.
        expected: u64,
        /// Actual length, bytes.
        found: u64,
    },
    /// Wrong checksum or impossible numbers of the header.
    #[error("the header of this SPM file is damaged: copy or build it again")]
    DamagedHeader,
    /// Wrong checksum of a small section.
    #[error("the section \"{0}\" of this SPM file is damaged: copy or build it again")]
    DamagedSection(Section),
    /// Wrong checksum of a block.
    #[error(
        "block {block} of the section \"{section}\" of this SPM file is damaged: copy or build it again"
    )]
    DamagedBlock {
        /// The section.
        section: Section,
        /// Index of its 64-KiB block.
        block: u64,
    },
    /// Impossible content in spite of a right checksum.
    #[error("the section \"{0}\" of this SPM file holds something impossible: build it again")]
    Inconsistent(Section),
    /// A record that cannot belong to this model.
    #[error("{0} of this SPM file: build it again")]
    Record(RecordError),
    /// An item that the file does not have.
    #[error("this SPM file has no item {item} in its section \"{section}\"")]
    NoSuchItem {
        /// The section.
        section: Section,
        /// The item.
        item: u64,
    },
    /// A point that is not finite.
    #[error("the point asked about is not finite")]
    Query,
    /// Bytes that do not start at a multiple of 8.
    #[error(
        "the bytes of an SPM file must lie at a multiple of 8 in memory, as a map of the file does"
    )]
    Misaligned,
}

/// Not checked yet.
const UNCHECKED: u8 = 0;
/// Checksum right.
const SOUND: u8 = 1;
/// Checksum wrong.
const DAMAGED: u8 = 2;

/// An open SPM file over any bytes: a memory map, a buffer.
#[derive(Debug)]
pub struct SpmFile<D> {
    data: D,
    header: SpmHeader,
    /// State of each block of each big section.
    blocks: [Vec<AtomicU8>; Section::BIG.len()],
}

impl<D: AsRef<[u8]>> SpmFile<D> {
    /// Opens a file: checks header, base mesh and index. The big sections are checked when used.
    /// The bytes must start at a multiple of 8 in memory.
    ///
    /// # Errors
    /// When the bytes are no SPM file of this version, or a checked part is damaged.
    ///
    /// ```
    /// use spm::{FileError, SpmFile};
    ///
    /// let refused = SpmFile::open(b"not an SPM file").unwrap_err();
    /// assert_eq!(refused, FileError::NotSpm);
    /// ```
    pub fn open(data: D) -> Result<Self, FileError> {
        let bytes = data.as_ref();
        let found = bytes.len() as u64;
        let too_short = || FileError::Truncated {
            expected: size_of::<SpmHeader>() as u64,
            found,
        };
        if !bytes.starts_with(&MAGIC) {
            return Err(FileError::NotSpm);
        }
        let version = bytes.get(8..12).ok_or_else(too_short)?;
        let version = u32::from_le_bytes(version.try_into().map_err(|_| too_short())?);
        if version != FORMAT_VERSION {
            return Err(FileError::OtherVersion(version));
        }
        let head = bytes.get(..size_of::<SpmHeader>()).ok_or_else(too_short)?;
        let header: SpmHeader = bytemuck::pod_read_unaligned(head);
        if xxh3_64(&head[..head.len() - 8]) != header.checksum {
            return Err(FileError::DamagedHeader);
        }
        if header.file_bytes != found {
            return Err(FileError::Truncated {
                expected: header.file_bytes,
                found,
            });
        }
        if bytes.as_ptr().align_offset(8) != 0 {
            return Err(FileError::Misaligned);
        }
        if !header_is_sound(&header) {
            return Err(FileError::DamagedHeader);
        }
        let blocks = Section::BIG.map(|section| {
            let count = block_count(&header, section);
            (0..count).map(|_| AtomicU8::new(UNCHECKED)).collect()
        });
        let file = Self {
            data,
            header,
            blocks,
        };
        for section in Section::SMALL {
            if xxh3_64(file.section_bytes(section)) != header.table[section as usize].checksum {
                return Err(FileError::DamagedSection(section));
            }
        }
        file.check_base()?;
        file.check_index()?;
        Ok(file)
    }

    /// The header of the model.
    #[must_use]
    pub fn model_header(&self) -> ModelHeader {
        self.header.model
    }

    /// Counts of the builder.
    #[must_use]
    pub fn summary(&self) -> BuildSummary {
        self.header.summary
    }

    /// Length of the file, bytes.
    #[must_use]
    pub fn file_bytes(&self) -> u64 {
        self.header.file_bytes
    }

    /// Vertices of the base mesh; checked on open.
    #[must_use]
    pub fn base_vertices(&self) -> &[BaseVertex] {
        self.small(Section::BaseVertices)
    }

    /// Faces of the base mesh; checked on open.
    #[must_use]
    pub fn base_faces(&self) -> &[BaseFace] {
        self.small(Section::BaseFaces)
    }

    /// The faces whose quarters have bounds, ascending; checked on open.
    #[must_use]
    pub fn quartered_faces(&self) -> &[QuarteredFace] {
        self.small(Section::Quartered)
    }

    /// The occupied and the empty regions, ascending; checked on open.
    #[must_use]
    pub fn regions(&self) -> &[RegionId] {
        self.small(Section::Regions)
    }

    /// The VSPs that create the faces of a region and their corners, and those that keep coarse
    /// faces out of its cell; ascending. Their closure under [`VspRecord::dependencies`] is the
    /// closure of the region at tolerance 0.
    ///
    /// `None` when no face of the base or the full mesh overlaps the cell, or the grid has no such
    /// cell.
    ///
    /// # Errors
    /// When a block of the list is damaged.
    pub fn seeds(&self, region: RegionId) -> Result<Option<&[u32]>, FileError> {
        let Ok(at) = self.regions().binary_search(&region) else {
            return Ok(None);
        };
        let offsets: &[u32] = self.small(Section::SeedOffsets);
        let (Some(&first), Some(&end)) = (offsets.get(at), offsets.get(at + 1)) else {
            return Err(FileError::Inconsistent(Section::SeedOffsets));
        };
        let bytes = self.checked(Section::Seeds, 4 * u64::from(first)..4 * u64::from(end))?;
        let seeds: &[u32] = bytemuck::try_cast_slice(bytes).map_err(|_| FileError::Misaligned)?;
        let ascending = seeds.windows(2).all(|w| w[0] < w[1]);
        let within = seeds
            .last()
            .is_none_or(|&last| last < self.header.model.vsps);
        if ascending && within {
            Ok(Some(seeds))
        } else {
            Err(FileError::Inconsistent(Section::Seeds))
        }
    }

    /// Record i, valid for this model.
    ///
    /// # Errors
    /// When there is no such record, its block is damaged or it cannot belong to this model.
    pub fn record(&self, i: u32) -> Result<VspRecord, FileError> {
        let record: VspRecord = self.item(Section::Records, u64::from(i))?;
        record
            .validate(i, self.header.model.sizes())
            .map_err(FileError::Record)?;
        Ok(record)
    }

    /// The VSP that splits each base vertex, [`NONE`] where none does; in range, checked on open.
    #[must_use]
    pub fn base_splits(&self) -> &[u32] {
        self.small(Section::BaseSplits)
    }

    /// VSP i in the vertex hierarchy; its children are in range and come after it.
    ///
    /// # Errors
    /// When there is no such VSP, its block is damaged or its children cannot be.
    pub fn node(&self, i: u32) -> Result<VspNode, FileError> {
        let node: VspNode = self.item(Section::Hierarchy, u64::from(i))?;
        if node.is_valid(i, self.header.model.vsps) {
            Ok(node)
        } else {
            Err(FileError::Inconsistent(Section::Hierarchy))
        }
    }

    /// Checks every block and every record.
    ///
    /// # Errors
    /// The first fault.
    pub fn check_all(&self) -> Result<(), FileError> {
        for section in Section::BIG {
            let bytes = self.section_bytes(section).len() as u64;
            self.checked(section, 0..bytes)?;
        }
        for &region in self.regions() {
            self.seeds(region)?;
        }
        for i in 0..self.header.model.vsps {
            self.record(i)?;
            self.node(i)?;
        }
        for position in 0..self.header.model.faces {
            self.full_face(position)?;
        }
        for node in 1..box_count(self.header.model.faces) {
            self.node_box(node as u32)?;
        }
        Ok(())
    }

    /// One item of a big section, its blocks checked.
    fn item<T: AnyBitPattern>(&self, section: Section, item: u64) -> Result<T, FileError> {
        if item >= self.header.table[section as usize].count {
            return Err(FileError::NoSuchItem { section, item });
        }
        let size = section.item_bytes();
        let bytes = self.checked(section, item * size..(item + 1) * size)?;
        Ok(bytemuck::pod_read_unaligned(bytes))
    }

    /// Bytes of a big section; each of their blocks is checked once.
    fn checked(&self, section: Section, range: Range<u64>) -> Result<&[u8], FileError> {
        let bytes = self.section_bytes(section);
        let wanted = bytes
            .get(range.start as usize..range.end as usize)
            .ok_or(FileError::Inconsistent(section))?;
        let first = range.start / BLOCK_BYTES;
        for block in first..range.end.div_ceil(BLOCK_BYTES) {
            self.check_block(section, bytes, block)?;
        }
        Ok(wanted)
    }

    fn check_block(&self, section: Section, bytes: &[u8], block: u64) -> Result<(), FileError> {
        let damaged = FileError::DamagedBlock { section, block };
        let place = Section::BIG.iter().position(|&s| s == section);
        let states = place.and_then(|p| self.blocks.get(p));
        let Some(state) = states.and_then(|s| s.get(block as usize)) else {
            return Err(damaged);
        };
        // Two threads may check a block at the same time; both get the same answer.
        match state.load(Ordering::Relaxed) {
            SOUND => return Ok(()),
            DAMAGED => return Err(damaged),
            _ => {}
        }
        let before: u64 = Section::BIG
            .iter()
            .take_while(|&&s| s != section)
            .map(|&s| block_count(&self.header, s))
            .sum();
        let sums: &[u64] = self.small(Section::BlockSums);
        let start = (block * BLOCK_BYTES) as usize;
        let end = bytes.len().min(start + BLOCK_BYTES as usize);
        let sound = sums
            .get((before + block) as usize)
            .is_some_and(|&sum| bytes.get(start..end).is_some_and(|b| xxh3_64(b) == sum));
        state.store(if sound { SOUND } else { DAMAGED }, Ordering::Relaxed);
        if sound { Ok(()) } else { Err(damaged) }
    }

    /// Bytes of a section. The table was checked against the length on open.
    fn section_bytes(&self, section: Section) -> &[u8] {
        let entry = self.header.table[section as usize];
        let start = entry.offset as usize;
        let length = entry.bytes(section).unwrap_or(0) as usize;
        self.data
            .as_ref()
            .get(start..start + length)
            .unwrap_or_default()
    }

    fn small<T: Pod>(&self, section: Section) -> &[T] {
        // Aligned, since the data (checked on open) and the sections are.
        bytemuck::try_cast_slice(self.section_bytes(section)).unwrap_or_default()
    }

    fn check_base(&self) -> Result<(), FileError> {
        let header = &self.header.model;
        let vertices_sound = self
            .base_vertices()
            .iter()
            .all(|v| v.position.iter().all(|x| x.is_finite()) && v.reserved == 0);
        if !vertices_sound {
            return Err(FileError::Inconsistent(Section::BaseVertices));
        }
        let faces = self.base_faces();
        let faces_sound = (0u32..).zip(faces).all(|(own, f)| {
            let [a, b, c] = f.corners;
            a != b
                && b != c
                && c != a
                && a.max(b).max(c) < header.base_vertices
                && ab_tree::is_leaf_key(f.leaf, header.faces)
                && f.reserved == 0
                && (0..3).all(|k| links_back(faces, own, k))
        });
        if !faces_sound {
            return Err(FileError::Inconsistent(Section::BaseFaces));
        }
        let mut before = None;
        let quartered_sound = self.quartered_faces().iter().all(|face| {
            let before = before.replace(face.key());
            face.is_valid(header.sizes(), before)
        });
        if !quartered_sound {
            return Err(FileError::Inconsistent(Section::Quartered));
        }
        let split_ok = |&split: &u32| split == NONE || split < header.vsps;
        if !self.base_splits().iter().all(split_ok) {
            return Err(FileError::Inconsistent(Section::BaseSplits));
        }
        Ok(())
    }

    fn check_index(&self) -> Result<(), FileError> {
        let grid = self.header.model.grid;
        let regions = self.regions();
        let ascending = regions.windows(2).all(|w| w[0] < w[1]);
        if !ascending || !regions.iter().all(|&r| grid.contains(r)) {
            return Err(FileError::Inconsistent(Section::Regions));
        }
        let offsets: &[u32] = self.small(Section::SeedOffsets);
        let seeds = self.header.table[Section::Seeds as usize].count;
        let sound = offsets.first() == Some(&0)
            && offsets.windows(2).all(|w| w[0] <= w[1])
            && offsets.last().is_some_and(|&end| u64::from(end) == seeds);
        if sound {
            Ok(())
        } else {
            Err(FileError::Inconsistent(Section::SeedOffsets))
        }
    }
}

/// Whether the base face across the edge opposite corner k has the same edge, the other way round,
/// and links back across it.
fn links_back(faces: &[BaseFace], own: u32, k: usize) -> bool {
    let face = &faces[own as usize];
    let across = face.neighbours[k];
    if across == NONE {
        return true;
    }
    let edge = (face.corners[(k + 2) % 3], face.corners[(k + 1) % 3]);
    faces.get(across as usize).is_some_and(|other| {
        (0..3).any(|j| {
            other.neighbours[j] == own
                && (other.corners[(j + 1) % 3], other.corners[(j + 2) % 3]) == edge
        })
    })
}

fn block_count(header: &SpmHeader, section: Section) -> u64 {
    header.table[section as usize]
        .bytes(section)
        .unwrap_or(0)
        .div_ceil(BLOCK_BYTES)
}

/// Whether the numbers of a header fit each other and the length of the file.
fn header_is_sound(header: &SpmHeader) -> bool {
    let model = &header.model;
    if header.sections as usize != Section::COUNT || !model.is_valid() {
        return false;
    }
    let mut end = size_of::<SpmHeader>() as u64;
    for section in Section::SMALL.into_iter().chain(Section::BIG) {
        let entry = header.table[section as usize];
        let section_end = entry
            .bytes(section)
            .and_then(|bytes| bytes.checked_add(entry.offset));
        let Some(section_end) = section_end else {
            return false;
        };
        if !entry.offset.is_multiple_of(ALIGNMENT) || entry.offset < end {
            return false;
        }
        end = section_end;
    }
    let count = |section: Section| header.table[section as usize].count;
    let blocks: u64 = Section::BIG.map(|s| block_count(header, s)).iter().sum();
    end == header.file_bytes
        && count(Section::BaseVertices) == u64::from(model.base_vertices)
        && count(Section::BaseFaces) == u64::from(model.base_faces)
        && count(Section::SeedOffsets) == count(Section::Regions) + 1
        && count(Section::BlockSums) == blocks
        && count(Section::BaseSplits) == u64::from(model.base_vertices)
        && count(Section::Quartered) == u64::from(model.quartered)
        && count(Section::Hierarchy) == u64::from(model.vsps)
        && count(Section::Records) == u64::from(model.vsps)
        && count(Section::FullFaces) == u64::from(model.faces)
        && count(Section::Boxes) == box_count(model.faces)
}
