use super::*;
use crate::{CertifiedCode, ErrorScale, QuarterCodes, QuarteredFace};
use crate::{LEVELS, RegionGrid};
use ab_tree::leaf_key;
use bytemuck::Zeroable;
use geometry::closest_point_on_triangle;
use glam::{DVec3, UVec3, Vec3};
use proptest::prelude::*;
use std::collections::BTreeSet;

/// A file whose references are valid; its geometry is arbitrary, which the file does not mind.
fn parts(base: u32, vsps: u32) -> SpmParts {
    // A small generator: the numbers need only look random.
    let mut state = 1u64;
    let mut random = move |below: u32| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 33) as u32 % below
    };
    let mut position = {
        let mut random = random;
        move || [0; 3].map(|_: u32| random(1000) as f32 / 1000.0)
    };
    let faces = base + 2 * vsps;
    let grid = RegionGrid::new(DVec3::ZERO, DVec3::ONE, 4).unwrap();
    let mut header = ModelHeader {
        diagonal: 3f64.sqrt(),
        upper: [1.0; 3],
        grid,
        base_vertices: base + 2,
        base_faces: base,
        vsps,
        faces,
        ..ModelHeader::zeroed()
    };
    header.closure_max = 3;
    header.quartered = 2 * base;
    header.level_tolerances = level_tolerances_for_tests();
    let regions: Vec<RegionId> = (0..4)
        .map(|x| RegionId::of_cell(UVec3::new(x, 1, 0)))
        .collect();
    let seeds_each = vsps / 8;
    SpmParts {
        header,
        summary: BuildSummary {
            read_vertices: 77,
            ..BuildSummary::default()
        },
        base_vertices: (0..base + 2)
            .map(|_| BaseVertex {
                position: position(),
                certified: certified(5),
                reserved: 0,
            })
            .collect(),
        base_faces: (0..base)
            .map(|k| BaseFace {
                corners: [k, k + 1, k + 2],
                leaf: leaf_key(k, faces),
                neighbours: [NONE; 3],
                reserved: 0,
            })
            .collect(),
        quartered: quartered(base),
        records: (0..vsps)
            .map(|i| VspRecord {
                i,
                vs: random(base + 2 + 2 * i),
                fn_: [random(base + 2 * i), NONE, NONE, random(base + 2 * i)],
                leaf_l: leaf_key(base + 2 * i, faces),
                leaf_r: leaf_key(base + 2 * i + 1, faces),
                pos_t: position(),
                pos_u: position(),
                certified: [1, 2].map(certified),
                e: u16::MAX,
            })
            .collect(),
        seed_offsets: (0..=4).map(|k| k * seeds_each).collect(),
        seeds: (0..4 * seeds_each).collect(),
        regions,
        full_faces: (0..faces)
            .map(|k| FullFace {
                corners: [0; 3].map(|_: u32| random(base + 2 + 2 * vsps)),
                face: k,
            })
            .collect(),
        base_splits: (0..base + 2)
            .map(|v| if v < vsps { v } else { NONE })
            .collect(),
        hierarchy: (0..vsps)
            .map(|i| VspNode {
                children: [i + 1, i + 2].map(|child| if child < vsps { child } else { NONE }),
                bounds: [0, 1, 2, 30, 40, i as u16],
            })
            .collect(),
    }
}

/// Two to a face of the base mesh.
fn quartered(base: u32) -> Vec<QuarteredFace> {
    let of = |k: u32| QuarteredFace {
        face: k / 2,
        end: u16::MAX,
        part: 3 * (k as u16 % 2),
        quarters: QuarterCodes::new(ErrorScale::for_diagonal(1.0), [0.1, 0.2, 0.3, 0.01]),
    };
    (0..2 * base).map(of).collect()
}

fn certified(radius: u8) -> CertifiedCode {
    CertifiedCode {
        radius,
        ..CertifiedCode::default()
    }
}

/// For a grid of four cells: three levels.
fn level_tolerances_for_tests() -> [f32; LEVELS] {
    let mut tolerances = [f32::INFINITY; LEVELS];
    tolerances[..3].copy_from_slice(&[0.0, 0.02, 0.04]);
    tolerances
}

/// Bytes at a multiple of eight, as a map's are.
#[derive(Clone)]
struct Aligned {
    words: Vec<u64>,
    length: usize,
}

impl Aligned {
    fn new(bytes: &[u8]) -> Self {
        let mut words = vec![0u64; bytes.len().div_ceil(8)];
        bytemuck::cast_slice_mut(&mut words)[..bytes.len()].copy_from_slice(bytes);
        Self {
            words,
            length: bytes.len(),
        }
    }
}

impl AsRef<[u8]> for Aligned {
    fn as_ref(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.words)[..self.length]
    }
}

fn bytes_of(parts: &SpmParts) -> Vec<u8> {
    let mut bytes = Vec::new();
    let length = write_spm(parts, &mut bytes).unwrap();
    assert_eq!(length, bytes.len() as u64);
    bytes
}

/// Everything that a file says, or the first error.
fn read_all(bytes: &[u8]) -> Result<SpmParts, FileError> {
    let file = SpmFile::open(Aligned::new(bytes))?;
    let header = file.model_header();
    let mut seed_offsets = vec![0];
    let mut seeds = Vec::new();
    for &region in file.regions() {
        seeds.extend(file.seeds(region)?.expect("an occupied region has a list"));
        seed_offsets.push(seeds.len() as u32);
    }
    file.check_all()?;
    Ok(SpmParts {
        header,
        summary: file.summary(),
        base_vertices: file.base_vertices().to_vec(),
        base_faces: file.base_faces().to_vec(),
        quartered: file.quartered_faces().to_vec(),
        records: (0..header.vsps)
            .map(|i| file.record(i))
            .collect::<Result<_, _>>()?,
        regions: file.regions().to_vec(),
        seed_offsets,
        seeds,
        full_faces: (0..header.faces)
            .map(|p| file.full_face(p))
            .collect::<Result<_, _>>()?,
        base_splits: file.base_splits().to_vec(),
        hierarchy: (0..header.vsps)
            .map(|i| file.node(i))
            .collect::<Result<_, _>>()?,
    })
}

#[test]
fn written_parts_are_read_back() {
    for (base, vsps) in [(1, 0), (1, 8), (40, 64), (100, 3000)] {
        let mut parts = parts(base, vsps);
        parts.seal();
        assert_ne!(parts.header.model, 0);
        let bytes = bytes_of(&parts);
        assert_eq!(read_all(&bytes), Ok(parts));
    }
}

#[test]
fn whatever_a_file_answers_with_makes_it_another_model() {
    let model = |change: fn(&mut SpmParts)| {
        let mut parts = parts(40, 64);
        change(&mut parts);
        parts.seal();
        parts.header.model
    };
    let changes: [fn(&mut SpmParts); 9] = [
        |_| {},
        |p| p.base_vertices[3].position[1] += 1.0,
        |p| p.base_faces[3].corners.swap(0, 1),
        |p| p.quartered[3].part = 2,
        |p| p.records[3].e -= 1,
        |p| p.full_faces[3].corners.swap(0, 1),
        |p| p.regions[3] = RegionId::of_cell(UVec3::new(3, 2, 0)),
        |p| p.seeds[3] = 4,
        // The last of the first region is the first of the next.
        |p| p.seed_offsets[1] -= 1,
    ];
    let models: BTreeSet<u64> = changes.into_iter().map(model).collect();
    assert_eq!(models.len(), changes.len());
}

#[test]
fn sections_start_on_cache_lines_and_absent_regions_are_none() {
    let bytes = bytes_of(&parts(40, 64));
    let file = SpmFile::open(Aligned::new(&bytes)).unwrap();
    for entry in file.header.table {
        assert_eq!(entry.offset % 64, 0);
    }
    assert_eq!(file.seeds(RegionId::of_cell(UVec3::new(3, 3, 3))), Ok(None));
    assert_eq!(file.seeds(RegionId(u32::MAX)), Ok(None));
    assert!(matches!(
        file.record(64),
        Err(FileError::NoSuchItem { item: 64, .. })
    ));
}

#[test]
fn other_files_and_other_versions_are_named() {
    let bytes = bytes_of(&parts(1, 0));
    assert_eq!(read_all(b""), Err(FileError::NotSpm));
    assert_eq!(read_all(b"v 0 0 0\nv 1 0 0\n"), Err(FileError::NotSpm));
    let mut other = bytes.clone();
    other[8] = 9;
    assert_eq!(read_all(&other), Err(FileError::OtherVersion(9)));
}

#[test]
fn a_damaged_block_is_named_and_the_others_still_serve() {
    let parts = parts(100, 3000);
    let mut bytes = bytes_of(&parts);
    let sound = SpmFile::open(Aligned::new(&bytes)).unwrap();
    let offset = sound.header.table[Section::Records as usize].offset as usize;
    // Record 1500 lies in the second block of 1024 records.
    bytes[offset + 1500 * 64 + 20] ^= 4;
    let file = SpmFile::open(Aligned::new(&bytes)).unwrap();
    assert_eq!(file.record(1023), Ok(parts.records[1023]));
    let damaged = FileError::DamagedBlock {
        section: Section::Records,
        block: 1,
    };
    assert_eq!(file.record(1024), Err(damaged.clone()));
    assert_eq!(file.record(1024), Err(damaged.clone()));
    assert_eq!(file.record(2048), Ok(parts.records[2048]));
    assert!(
        damaged
            .to_string()
            .contains("block 1 of the section \"records\"")
    );
}

#[test]
fn impossible_content_is_refused_in_spite_of_a_right_checksum() {
    let sound = parts(40, 64);
    let expect = |change: fn(&mut SpmParts), error: FileError| {
        let mut parts = sound.clone();
        change(&mut parts);
        assert_eq!(read_all(&bytes_of(&parts)), Err(error));
    };
    let inconsistent = FileError::Inconsistent;
    expect(
        |p| p.base_faces[3].corners[1] = 4000,
        inconsistent(Section::BaseFaces),
    );
    expect(
        |p| p.base_faces[3].neighbours[1] = 4,
        inconsistent(Section::BaseFaces),
    );
    expect(
        |p| p.base_vertices[3].reserved = 1,
        inconsistent(Section::BaseVertices),
    );
    expect(
        |p| p.base_faces[3].reserved = 1,
        inconsistent(Section::BaseFaces),
    );
    let quartered: [fn(&mut SpmParts); 4] = [
        |p| p.quartered[7].face = 40 + 2 * 64,
        |p| p.quartered[7].part = 21,
        |p| p.quartered.swap(6, 7),
        |p| p.quartered[7] = p.quartered[6],
    ];
    for change in quartered {
        expect(change, inconsistent(Section::Quartered));
    }
    expect(|p| p.header.quartered = 79, FileError::DamagedHeader);
    expect(
        |p| {
            p.header.quartered = QuarteredFace::MAX + 1;
            p.quartered = vec![p.quartered[0]; QuarteredFace::MAX as usize + 1];
        },
        FileError::DamagedHeader,
    );
    expect(|p| p.regions.swap(0, 1), inconsistent(Section::Regions));
    expect(
        |p| p.seed_offsets[1] = 30,
        inconsistent(Section::SeedOffsets),
    );
    expect(|p| p.seeds[1] = 63, inconsistent(Section::Seeds));
    expect(
        |p| p.full_faces[9].face = 5000,
        inconsistent(Section::FullFaces),
    );
    expect(
        |p| p.records[5].vs = 500,
        FileError::Record(RecordError::Reference(5)),
    );
    expect(
        |p| p.records[5].pos_t[0] = f32::NAN,
        FileError::Record(RecordError::Position(5)),
    );
    expect(
        |p| p.hierarchy[5].children[1] = 5,
        inconsistent(Section::Hierarchy),
    );
    expect(|p| p.base_splits[2] = 64, inconsistent(Section::BaseSplits));
    expect(|p| p.header.diagonal = f64::NAN, FileError::DamagedHeader);
    expect(
        |p| p.header.level_tolerances[2] = 0.01,
        FileError::DamagedHeader,
    );
    expect(
        |p| p.header.level_tolerances[1] = f32::NAN,
        FileError::DamagedHeader,
    );
    expect(
        |p| p.header.level_tolerances[3] = 0.5,
        FileError::DamagedHeader,
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn a_flipped_bit_is_an_error_or_padding(at in any::<prop::sample::Index>(), bit in 0..8u32) {
        let parts = parts(40, 64);
        let mut bytes = bytes_of(&parts);
        let at = at.index(bytes.len());
        bytes[at] ^= 1 << bit;
        if let Ok(read) = read_all(&bytes) {
            prop_assert_eq!(read, parts);
        }
    }

    #[test]
    fn a_cut_or_overwritten_file_is_an_error(
        at in any::<prop::sample::Index>(), fill in any::<u8>(), length in 1usize..200,
    ) {
        let parts = parts(40, 64);
        let bytes = bytes_of(&parts);
        let at = at.index(bytes.len());
        prop_assert!(read_all(&bytes[..at]).is_err());
        let mut longer = bytes.clone();
        longer.push(fill);
        prop_assert!(read_all(&longer).is_err());
        let mut torn = bytes.clone();
        let end = bytes.len().min(at + length);
        torn[at..end].fill(fill);
        if let Ok(read) = read_all(&torn) {
            prop_assert_eq!(read, parts);
        }
    }

    #[test]
    fn the_closest_point_equals_brute_force(
        query in prop::array::uniform3(-0.5..1.5f64), size in 0usize..5,
    ) {
        let (base, vsps) = [(1, 0), (3, 1), (7, 0), (40, 64), (17, 1000)][size];
        let parts = parts(base, vsps);
        let file = SpmFile::open(Aligned::new(&bytes_of(&parts))).unwrap();
        let query = DVec3::from_array(query);
        let (position, found) = file.closest_point(query).unwrap();
        let at = |v: u32| Vec3::from_array(parts.position(v)).as_dvec3();
        let distance = |p: usize| {
            closest_point_on_triangle(parts.full_faces[p].corners.map(at), query).distance_squared
        };
        let best = (0..parts.full_faces.len()).map(distance).fold(f64::INFINITY, f64::min);
        prop_assert_eq!(found.distance_squared, best);
        prop_assert_eq!(distance(position as usize), best);
        prop_assert_eq!(file.closest_point(query * f64::NAN), Err(FileError::Query));
    }

    #[test]
    fn the_leaves_of_the_box_tree_hold_every_face_once(faces in 1u32..300) {
        let depth = layout::box_depth(faces);
        let mut next = 0;
        for node in 1u32 << depth..2 << depth {
            let below = layout::faces_below(node, faces);
            prop_assert_eq!(below.start, next);
            prop_assert!(faces < 4 || (4..=8).contains(&below.len()));
            next = below.end;
        }
        prop_assert_eq!(next, faces);
    }
}

#[test]
fn the_bytes_of_a_file_of_this_version_do_not_change() {
    let bytes = bytes_of(&SpmParts::hexagon());
    let header = &bytes[..size_of::<SpmHeader>()];
    assert_eq!(&header[..8], b"hrtc-spm");
    assert_eq!(header[8..16], [7, 0, 0, 0, 12, 0, 0, 0]);
    assert_eq!(header[16..24], (bytes.len() as u64).to_le_bytes());
    // Another hash means another layout, or another id: count FORMAT_VERSION up for the first.
    assert_eq!(xxh3_64(&bytes), 0x16f5_3e26_c95f_0057);
    let file = SpmFile::open(Aligned::new(&bytes)).unwrap();
    file.check_all().unwrap();
}
