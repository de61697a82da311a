//! SPM files: damage anywhere, with the checksums put right again, so that what lies behind them is
//! reached.

use super::check_sentence;
use super::common::build;
use super::memory::most_bytes;
use super::mutate::Mutator;
use super::{keeping, rounds_and_seed, turn};
use geometry::Aabb;
use glam::DVec3;
use spm::{BLOCK_BYTES, FullFace, RegionId, SpmFile, SpmHeader, VspNode, VspRecord, write_spm};
use spm::{BaseFace, BaseVertex, QuarteredFace};
use spm_builder::generate::{Shape, generate};
use station_core::collection::{RegionAt, closure};
use std::ops::Range;
use ve_station::export::{Detail, export};
use xxhash_rust::xxh3::xxh3_64;

/// Bytes of an item of each section, in the order of the table; the sums of the blocks are the
/// fifth.
const ITEM_BYTES: [usize; 12] = [
    size_of::<BaseVertex>(),
    size_of::<BaseFace>(),
    size_of::<RegionId>(),
    4,
    8,
    4,
    size_of::<QuarteredFace>(),
    4,
    size_of::<VspRecord>(),
    size_of::<FullFace>(),
    size_of::<Aabb>(),
    size_of::<VspNode>(),
];
const SUMS: usize = 4;
const SMALL: Range<usize> = 0..7;
const BIG: Range<usize> = 7..12;
const HEAD: usize = size_of::<SpmHeader>();
const TABLE: usize = HEAD - 8 - 24 * ITEM_BYTES.len();

fn word(bytes: &[u8], at: usize) -> u64 {
    bytes
        .get(at..at + 8)
        .map_or(0, |b| u64::from_le_bytes(b.try_into().unwrap()))
}

/// Where a section lies, if it does.
fn section(bytes: &[u8], k: usize) -> Range<usize> {
    let start = word(bytes, TABLE + 24 * k) as usize;
    let length = (word(bytes, TABLE + 24 * k + 8) as usize).saturating_mul(ITEM_BYTES[k]);
    let end = start.saturating_add(length);
    if end <= bytes.len() { start..end } else { 0..0 }
}

/// Checksums of blocks, small sections and the header, in this order: each covers the ones before.
fn put_right(bytes: &mut [u8]) {
    if bytes.len() < HEAD {
        return;
    }
    let sums: Vec<u8> = BIG
        .flat_map(|k| {
            let content = &bytes[section(bytes, k)];
            content
                .chunks(BLOCK_BYTES as usize)
                .flat_map(|block| xxh3_64(block).to_le_bytes())
                .collect::<Vec<u8>>()
        })
        .collect();
    let place = section(bytes, SUMS);
    let length = place.len().min(sums.len());
    bytes[place][..length].copy_from_slice(&sums[..length]);
    for k in SMALL {
        let sum = xxh3_64(&bytes[section(bytes, k)]);
        bytes[TABLE + 24 * k + 16..][..8].copy_from_slice(&sum.to_le_bytes());
    }
    let length = bytes.len() as u64;
    bytes[16..24].copy_from_slice(&length.to_le_bytes());
    let sum = xxh3_64(&bytes[..HEAD - 8]);
    bytes[HEAD - 8..HEAD].copy_from_slice(&sum.to_le_bytes());
}

/// Asks a file everything that the station and the export ask.
fn check(bytes: &[u8]) -> bool {
    // The bytes of a file lie at a multiple of 8, as a map of it does.
    let (opened, most) = most_bytes(|| SpmFile::open(bytes.to_vec()));
    assert!(most <= 2 * bytes.len() + (1 << 16), "opening took {most}");
    let file = match opened {
        Ok(file) => file,
        Err(error) => {
            check_sentence(&error.to_string());
            return false;
        }
    };
    let header = file.model_header();
    // What is wrong is said, and everything else still answers.
    if let Err(error) = file.check_all() {
        check_sentence(&error.to_string());
    }
    let (_, most) = most_bytes(|| {
        let mut asked: Vec<RegionAt> = [0.0, 1e-3, 0.1, f32::INFINITY]
            .into_iter()
            .map(|share| RegionAt::tolerance(RegionId::WHOLE, share * header.diagonal as f32))
            .collect();
        asked.push(RegionAt {
            region: RegionId::PREFIX,
            tolerance_bits: u32::MAX,
        });
        for &region in file.regions().iter().step_by(7) {
            asked.push(RegionAt::full(region));
            asked.push(RegionAt::tolerance(region, header.level_tolerances[1]));
            asked.push(RegionAt::tolerance(region, header.level_tolerances[2]));
        }
        for asked in asked {
            match closure(&file, asked) {
                Ok(closure) => {
                    assert!(closure.windows(2).all(|pair| pair[0] < pair[1]));
                    assert!(closure.last().is_none_or(|&last| last < header.vsps));
                }
                Err(error) => check_sentence(&error.to_string()),
            }
        }
        for k in 0..4 {
            let share = f64::from(k) / 3.0;
            let (lower, upper) = (DVec3::from(header.lower), DVec3::from(header.upper));
            if let Err(error) = file.closest_point(lower.lerp(upper, share)) {
                check_sentence(&error.to_string());
            }
        }
    });
    assert!(most <= 8 * bytes.len() + (1 << 20), "answers took {most}");
    true
}

/// Through a file, as the command does.
fn check_export(bytes: &[u8]) {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().join("a.spm"), folder.path().join("a.spmtxt"));
    std::fs::write(&input, bytes).unwrap();
    for detail in [Detail::Full, Detail::Tolerance(0.01)] {
        if let Err(error) = export(&input, &output, None, detail) {
            check_sentence(&error.to_string());
        }
    }
}

#[test]
fn spm_files_of_any_content_answer_or_are_refused_in_a_sentence() {
    let _turn = turn();
    let (rounds, seed) = rounds_and_seed();
    let models: Vec<Vec<u8>> = [
        (Shape::Torus, 600),
        (Shape::Relief, 1500),
        (Shape::Plate, 200),
    ]
    .into_iter()
    .map(|(shape, faces)| {
        let mut bytes = Vec::new();
        write_spm(&build(&generate(shape, faces, 3), Some(40)), &mut bytes).unwrap();
        let mut again = bytes.clone();
        put_right(&mut again);
        assert!(
            again == bytes,
            "the layout is another one than this test thinks"
        );
        bytes
    })
    .collect();
    let mut mutator = Mutator::new(seed);
    let mut opened = [0u64; ITEM_BYTES.len() + 2];
    let mut tried = opened;
    for _ in 0..rounds {
        let mut bytes = models[mutator.below(models.len())].clone();
        // A section, the header, or anything and its length too.
        let what = mutator.below(tried.len());
        tried[what] += 1;
        if what < ITEM_BYTES.len() {
            let place = section(&bytes, what);
            let mut part = bytes[place.clone()].to_vec();
            mutator.damage(&mut part, &[], false);
            bytes[place].copy_from_slice(&part);
        } else if what == ITEM_BYTES.len() {
            let mut head = bytes[24..HEAD - 8].to_vec();
            mutator.damage(&mut head, &[], false);
            bytes[24..HEAD - 8].copy_from_slice(&head);
        } else {
            mutator.damage(&mut bytes, &[], true);
        }
        if mutator.below(16) > 0 {
            put_right(&mut bytes);
        }
        keeping(&bytes, "spm", || {
            if check(&bytes) {
                opened[what] += 1;
                if opened[what] % 16 == 0 {
                    check_export(&bytes);
                }
            }
        });
    }
    println!("opened {opened:?} of {tried:?}");
    // Damage in the big sections is only seen when they are used.
    assert!(
        BIG.into_iter()
            .all(|k| rounds < 500 || opened[k] * 2 > tried[k])
    );
}
