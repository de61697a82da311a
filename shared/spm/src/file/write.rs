//! Writing: all content is in memory, so checksums are known before the first byte is written.

use super::layout::{
    ALIGNMENT, BLOCK_BYTES, BuildSummary, FORMAT_VERSION, FullFace, MAGIC, Section, SectionEntry,
    SpmHeader, box_count, box_depth, faces_below,
};
use crate::{BaseFace, BaseVertex, ModelHeader, QuarteredFace};
use crate::{RegionId, VspNode, VspRecord};
use bytemuck::Zeroable;
use geometry::Aabb;
use glam::Vec3;
use std::io::{self, Write};
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

/// Content of an SPM file; boxes, checksums and the content hash are derived from it.
#[derive(Debug, Clone, PartialEq)]
pub struct SpmParts {
    /// The header; [`SpmParts::seal`] fills in `model`.
    pub header: ModelHeader,
    /// Counts of the builder.
    pub summary: BuildSummary,
    /// Base vertices.
    pub base_vertices: Vec<BaseVertex>,
    /// Base faces.
    pub base_faces: Vec<BaseFace>,
    /// Faces whose quarters have bounds, ascending.
    pub quartered: Vec<QuarteredFace>,
    /// Records, ascending.
    pub records: Vec<VspRecord>,
    /// Occupied and empty regions, ascending.
    pub regions: Vec<RegionId>,
    /// Start of each region's seeds, and the end of the last one's.
    pub seed_offsets: Vec<u32>,
    /// Seeds of all regions.
    pub seeds: Vec<u32>,
    /// The full mesh in AB-tree order.
    pub full_faces: Vec<FullFace>,
    /// The VSP that splits each base vertex, [`crate::NONE`] where none does.
    pub base_splits: Vec<u32>,
    /// The vertex hierarchy, one node for each VSP.
    pub hierarchy: Vec<VspNode>,
}

impl SpmParts {
    /// Position of a vertex by its id.
    ///
    /// # Panics
    /// When there is no such vertex.
    #[must_use]
    pub fn position(&self, vertex: u32) -> [f32; 3] {
        match self.header.sizes().creator_of_vertex(vertex) {
            None => self.base_vertices[vertex as usize].position,
            Some(i) => {
                let record = &self.records[i as usize];
                if vertex == self.header.sizes().vt(i) {
                    record.pos_t
                } else {
                    record.pos_u
                }
            }
        }
    }

    /// Fills in the content hash, over base mesh, records, full mesh, and the regions with their
    /// seeds: two files that answer otherwise are two models.
    pub fn seal(&mut self) {
        let mut hash = Xxh3Default::new();
        hash.update(bytemuck::bytes_of(&self.header.origin));
        hash.update(bytemuck::bytes_of(&self.header.grid));
        hash.update(bytemuck::bytes_of(&self.header.level_tolerances));
        hash.update(bytemuck::cast_slice(&self.base_vertices));
        hash.update(bytemuck::cast_slice(&self.base_faces));
        hash.update(bytemuck::cast_slice(&self.quartered));
        hash.update(bytemuck::cast_slice(&self.records));
        hash.update(bytemuck::cast_slice(&self.regions));
        hash.update(bytemuck::cast_slice(&self.seed_offsets));
        hash.update(bytemuck::cast_slice(&self.seeds));
        hash.update(bytemuck::cast_slice(&self.full_faces));
        self.header.model = hash.digest();
    }

    /// Boxes over the full mesh, in heap order.
    fn boxes(&self) -> Vec<Aabb> {
        let faces = self.header.faces;
        let depth = box_depth(faces);
        let mut boxes = vec![Aabb::EMPTY; box_count(faces) as usize];
        boxes[0] = Aabb::zeroed();
        for node in (1..boxes.len() as u32).rev() {
            boxes[node as usize] = if ab_tree::depth(node) == depth {
                faces_below(node, faces)
                    .flat_map(|position| self.full_faces[position as usize].corners)
                    .map(|vertex| Vec3::from_array(self.position(vertex)))
                    .fold(Aabb::EMPTY, |b, p| b.union(Aabb { lower: p, upper: p }))
            } else {
                boxes[2 * node as usize].union(boxes[2 * node as usize + 1])
            };
        }
        boxes
    }
}

/// Writes an SPM file; returns its length in bytes.
///
/// To replace a file safely, write to a temporary one and rename it.
///
/// # Errors
/// When `out` fails.
pub fn write_spm(parts: &SpmParts, out: &mut impl Write) -> io::Result<u64> {
    let boxes = parts.boxes();
    let big: [&[u8]; Section::BIG.len()] = [
        bytemuck::cast_slice(&parts.seeds),
        bytemuck::cast_slice(&parts.records),
        bytemuck::cast_slice(&parts.full_faces),
        bytemuck::cast_slice(&boxes),
        bytemuck::cast_slice(&parts.hierarchy),
    ];
    let sums: Vec<u64> = big
        .iter()
        .flat_map(|bytes| bytes.chunks(BLOCK_BYTES as usize).map(xxh3_64))
        .collect();
    let contents: [&[u8]; Section::COUNT] = [
        bytemuck::cast_slice(&parts.base_vertices),
        bytemuck::cast_slice(&parts.base_faces),
        bytemuck::cast_slice(&parts.regions),
        bytemuck::cast_slice(&parts.seed_offsets),
        bytemuck::cast_slice(&sums),
        bytemuck::cast_slice(&parts.base_splits),
        bytemuck::cast_slice(&parts.quartered),
        big[0],
        big[1],
        big[2],
        big[3],
        big[4],
    ];

    let header = header_of(parts, contents);
    out.write_all(bytemuck::bytes_of(&header))?;
    let mut at = size_of::<SpmHeader>() as u64;
    for (entry, bytes) in header.table.iter().zip(contents) {
        let padding = (entry.offset - at) as usize;
        out.write_all(&[0; ALIGNMENT as usize][..padding])?;
        out.write_all(bytes)?;
        at = entry.offset + bytes.len() as u64;
    }
    out.flush()?;
    Ok(header.file_bytes)
}

/// The header of a file with these sections.
fn header_of(parts: &SpmParts, contents: [&[u8]; Section::COUNT]) -> SpmHeader {
    let mut header = SpmHeader::zeroed();
    let mut end = size_of::<SpmHeader>() as u64;
    for section in Section::SMALL.into_iter().chain(Section::BIG) {
        let bytes = contents[section as usize];
        let offset = end.next_multiple_of(ALIGNMENT);
        end = offset + bytes.len() as u64;
        header.table[section as usize] = SectionEntry {
            offset,
            count: bytes.len() as u64 / section.item_bytes(),
            checksum: if Section::SMALL.contains(&section) {
                xxh3_64(bytes)
            } else {
                0
            },
        };
    }
    header.magic = MAGIC;
    header.version = FORMAT_VERSION;
    header.sections = Section::COUNT as u32;
    header.file_bytes = end;
    header.model = parts.header;
    header.summary = parts.summary;
    let head = bytemuck::bytes_of(&header);
    header.checksum = xxh3_64(&head[..head.len() - 8]);
    header
}
