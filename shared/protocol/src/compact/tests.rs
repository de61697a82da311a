use super::range_coder::{Bit, BitReader, BitWriter, Code};
use super::*;
use crate::answers::AnswersWriter;
use proptest::prelude::*;
use spm::VspRecord;

type Slots = [ChunkSlot; CHUNK_SLOTS];
const SIZES: Sizes = Sizes {
    base_vertices: 100,
    base_faces: 200,
    vsps: 5000,
    faces: 10_200,
};

fn sealed(kind: u32, object: u32, (epoch, sequence): (u32, u64), slots: &Slots) -> ChunkHeader {
    let mut header = ChunkHeader {
        station: 9,
        kind,
        object,
        epoch,
        sequence,
        ..ChunkHeader::zeroed()
    };
    header.seal(slots);
    header
}

/// Chunks of records that hang together, as many as numbers are given.
fn answers(seeds: &[u32], object: u32, epoch: u32) -> Vec<(ChunkHeader, Slots)> {
    let mut next = 0;
    let chunk = |(sequence, &seed): (usize, &u32)| {
        let mut writer = AnswersWriter::new();
        writer.begin(seed, 0, true);
        let ids: Vec<u32> = (0..seed % 40).map(|k| next + k * (1 + seed % 7)).collect();
        assert!(ids.iter().all(|&id| writer.id(id, true)));
        for &i in &ids {
            let record = VspRecord {
                i,
                vs: 100 + i / 2,
                fn_: [200 + i, 200 + i / 2, spm::NONE, 200 + i / 3],
                leaf_l: i | 1 << 14,
                leaf_r: (i + 1) | 1 << 14,
                pos_t: [i as f32 * 1e-3, 0.5, -1.0 / i as f32],
                pos_u: [i as f32 * 1.1e-3, 0.25, f32::NAN],
                e: (seed % 60_000) as u16,
                ..VspRecord::zeroed()
            };
            assert!(writer.record(&record));
        }
        writer.end(true);
        next = ids.last().map_or(next, |last| last + 1) % 4000;
        let (count, slots) = writer.finish();
        let kind = ChunkKind::Answers as u32;
        let mut header = sealed(kind, object, (epoch, sequence as u64), &slots);
        header.count = count;
        header.seal(&slots);
        (header, slots)
    };
    seeds.iter().enumerate().map(chunk).collect()
}

/// What travels.
fn sent(encoder: &mut ChunkEncoder, (header, slots): &(ChunkHeader, Slots)) -> Vec<ChunkSlot> {
    let compact = encoder.encode(header, slots, Some(SIZES));
    compact.unwrap_or_else(|| slots.to_vec())
}

proptest! {
    #[test]
    fn bits_are_read_as_they_were_written(
        bits in prop::collection::vec((any::<bool>(), 0usize..4, 0u32..33, any::<u32>()), 0..2000),
        skew in any::<bool>(),
    ) {
        let masked = |value: u32, count: u32| (u64::from(value) & ((1u64 << count) - 1)) as u32;
        let mut models = [Bit::NEW; 4];
        let mut writer = BitWriter::new();
        for &(bit, model, count, value) in &bits {
            writer.bit(bit && !skew, &mut models[model]);
            writer.even(masked(value, count), count);
        }
        let bytes = writer.finish();
        let mut models = [Bit::NEW; 4];
        let mut reader = BitReader::new(&bytes);
        for &(bit, model, count, value) in &bits {
            prop_assert_eq!(reader.bit(false, &mut models[model]), bit && !skew);
            prop_assert_eq!(reader.even(0, count), masked(value, count));
        }
    }

    #[test]
    fn any_slots_come_back(
        chunks in prop::collection::vec(
            (0u32..8, any::<u32>(), prop::collection::vec(any::<u32>(), 0..1024), 0u32..4), 1..8),
    ) {
        let (mut encoder, mut decoder) = (ChunkEncoder::default(), ChunkDecoder::default());
        for (sequence, (kind, count, words, nonsense)) in chunks.iter().enumerate() {
            let mut slots = [ChunkSlot::zeroed(); CHUNK_SLOTS];
            let mask = [u32::MAX, 0x0f0f, 0xff, 0][*nonsense as usize];
            for (place, word) in slots.iter_mut().flat_map(|s| &mut s.words).zip(words) {
                *place = word & mask;
            }
            let mut header = sealed(*kind, 3, (1, sequence as u64), &slots);
            header.count = if count % 2 == 0 { *count } else { count % 5000 };
            header.seal(&slots);
            let sent = sent(&mut encoder, &(header, slots));
            prop_assert_eq!(decoder.decode(&header, &sent), Ok(slots));
        }
    }

    #[test]
    fn answers_come_back_smaller(
        seeds in prop::collection::vec(any::<u32>(), 1..20), objects in 1u32..4, epochs in 1u32..3,
    ) {
        let (mut encoder, mut decoder) = (ChunkEncoder::default(), ChunkDecoder::default());
        for epoch in 0..epochs {
            let of: Vec<_> = (0..objects).map(|object| answers(&seeds, object, epoch)).collect();
            for k in 0..seeds.len() {
                for chunks in &of {
                    let is_first = (epoch, chunks[k].0.object, k) == (0, 0, 0);
                    let sent = sent(&mut encoder, &chunks[k]);
                    prop_assert_eq!(sent.len() == CHUNK_SLOTS, is_first);
                    let plain = (chunks[k].0.count as usize).div_ceil(64).max(1);
                    prop_assert!(is_first || sent.len() <= plain);
                    prop_assert_eq!(decoder.decode(&chunks[k].0, &sent), Ok(chunks[k].1));
                }
            }
        }
    }

    #[test]
    fn what_is_lost_damaged_repeated_or_overtaken_is_never_taken_for_another(
        seeds in prop::collection::vec(any::<u32>(), 2..12),
        faults in prop::collection::vec((0u32..6, any::<u32>()), 12),
    ) {
        let (mut encoder, mut decoder) = (ChunkEncoder::default(), ChunkDecoder::default());
        let chunks = answers(&seeds, 1, 1);
        let mut line: Vec<(ChunkHeader, Vec<ChunkSlot>)> = Vec::new();
        for (chunk, &(fault, random)) in chunks.iter().zip(&faults) {
            let (mut header, mut slots) = (chunk.0, sent(&mut encoder, chunk));
            match fault {
                0 => continue,
                1 => {
                    let bit = random as usize % (slots.len() * 512);
                    slots[bit / 512].words[bit / 32 % 16] ^= 1 << (bit % 32);
                }
                2 => {
                    let bytes = bytemuck::bytes_of_mut(&mut header);
                    let bit = random as usize % (bytes.len() * 8);
                    bytes[bit / 8] ^= 1 << (bit % 8);
                }
                3 => slots.truncate(random as usize % slots.len()),
                4 => line.push((header, slots.clone())),
                _ => {}
            }
            line.push((header, slots));
            if fault == 5 && random % 2 == 0 {
                let last = line.len() - 1;
                line.swap(last, last.saturating_sub(1));
            }
        }
        for (header, slots) in &line {
            let decoded = decoder.decode(header, slots);
            let taken = chunks.iter().find(|(_, slots)| decoded == Ok(*slots));
            prop_assert!(decoded.is_err() || taken.is_some_and(|(of, _)| of == header));
        }
        // The next epoch is as if nothing had been.
        for chunk in answers(&seeds, 1, 2) {
            let sent = sent(&mut encoder, &chunk);
            prop_assert_eq!(decoder.decode(&chunk.0, &sent), Ok(chunk.1));
        }
    }

    #[test]
    fn any_bytes_end_in_an_error(
        words in prop::collection::vec(any::<u32>(), 16 * 63), count in 0usize..70,
        kind in 0u32..8, sequence in 0u64..2, low in any::<bool>(),
    ) {
        let mut slots = vec![ChunkSlot::zeroed(); count];
        let mask = if low { 0x0101_0101 } else { u32::MAX };
        for (place, word) in slots.iter_mut().flat_map(|s| &mut s.words).zip(words) {
            *place = word & mask;
        }
        let mut header = sealed(kind, 1, (1, sequence), &[ChunkSlot::zeroed(); CHUNK_SLOTS]);
        header.checksum ^= 1;
        let expected = match count {
            0 | 65.. => CompactError::Length,
            64 => CompactError::Damaged,
            _ if sequence > 0 => CompactError::Gap,
            _ => CompactError::Damaged,
        };
        prop_assert_eq!(ChunkDecoder::default().decode(&header, &slots), Err(expected));
    }
}

#[test]
fn points_of_a_path_come_back_smaller() {
    let (mut encoder, mut decoder) = (ChunkEncoder::default(), ChunkDecoder::default());
    let mut sent_slots = 0;
    for sequence in 0..10 {
        let mut slots = [ChunkSlot::zeroed(); CHUNK_SLOTS];
        for (k, slot) in slots.iter_mut().enumerate() {
            let t = (64 * sequence as usize + k) as f64 * 5e-3;
            let place = [(3.0 * t).sin(), (2.0 * t).cos(), 0.3 * t];
            slot.words = bytemuck::cast([t, place[0], place[1], place[2], 0.8, 0.0, 0.6, 0.0]);
        }
        let header = sealed(ChunkKind::Tour as u32, 1, (1, sequence), &slots);
        let sent = sent(&mut encoder, &(header, slots));
        assert_eq!(decoder.decode(&header, &sent), Ok(slots));
        // The first one is plain.
        sent_slots += if sequence > 0 { sent.len() } else { 0 };
    }
    let bytes = (sent_slots * size_of::<ChunkSlot>()) as f64 / (9.0 * CHUNK_SLOTS as f64);
    println!("{bytes:.1} bytes a point");
    assert!(bytes < 18.0, "{bytes}");
}

#[test]
fn a_gap_is_named_until_a_plain_chunk_or_an_epoch_begins_anew() {
    let (mut encoder, mut decoder) = (ChunkEncoder::default(), ChunkDecoder::default());
    let chunks = answers(&[38, 37, 36, 35, 34], 1, 1);
    let line: Vec<_> = chunks.iter().map(|of| sent(&mut encoder, of)).collect();
    assert_eq!(decoder.decode(&chunks[0].0, &line[0]), Ok(chunks[0].1));
    assert_eq!(decoder.decode(&chunks[1].0, &line[1]), Ok(chunks[1].1));
    for k in [3, 4] {
        let decoded = decoder.decode(&chunks[k].0, &line[k]);
        assert_eq!(decoded, Err(CompactError::Gap));
    }
    // It was only late.
    assert_eq!(decoder.decode(&chunks[2].0, &line[2]), Ok(chunks[2].1));
    let again = decoder.decode(&chunks[2].0, &line[2]);
    assert_eq!(again, Err(CompactError::Repeated));
    let (gap, nothing) = chunks[3].0.of_gap();
    assert!(gap.is_sound(&nothing) && gap.sequence > chunks[4].0.sequence);
    // The station's end begins anew too where it cannot go on.
    let mut encoder = ChunkEncoder::default();
    let plain = sent(&mut encoder, &chunks[3]);
    assert_eq!(plain.len(), CHUNK_SLOTS);
    assert_eq!(decoder.decode(&chunks[3].0, &plain), Ok(chunks[3].1));
    let line = sent(&mut encoder, &chunks[4]);
    assert!(line.len() < CHUNK_SLOTS);
    assert_eq!(decoder.decode(&chunks[4].0, &line), Ok(chunks[4].1));
}

#[test]
fn a_damaged_epoch_of_a_first_chunk_makes_no_later_chunk_a_repeated_one() {
    let (mut encoder, mut decoder) = (ChunkEncoder::default(), ChunkDecoder::default());
    let [before, hit, after] = [0, 1, 2].map(|epoch| answers(&[38, 37], 1, epoch));
    for chunk in &before {
        let sent = sent(&mut encoder, chunk);
        assert_eq!(decoder.decode(&chunk.0, &sent), Ok(chunk.1));
    }
    let line: Vec<_> = hit.iter().map(|of| sent(&mut encoder, of)).collect();
    assert!(line[0].len() < CHUNK_SLOTS);
    let mut damaged = hit[0].0;
    damaged.epoch ^= 1 << 20;
    let decoded = decoder.decode(&damaged, &line[0]);
    assert_eq!(decoded, Err(CompactError::Damaged));
    // What is missing now is named.
    let decoded = decoder.decode(&hit[1].0, &line[1]);
    assert_eq!(decoded, Err(CompactError::Gap));
    for chunk in &after {
        let sent = sent(&mut encoder, chunk);
        assert!(sent.len() < CHUNK_SLOTS);
        assert_eq!(decoder.decode(&chunk.0, &sent), Ok(chunk.1));
    }
}

#[test]
fn sessions_are_bounded() {
    let (mut encoder, mut decoder) = (ChunkEncoder::default(), ChunkDecoder::default());
    for object in 0..100 {
        for chunk in answers(&[38, 37], object, 1) {
            let sent = sent(&mut encoder, &chunk);
            assert_eq!(decoder.decode(&chunk.0, &sent), Ok(chunk.1));
        }
        assert!(encoder.sessions.all.len() <= MAX_SESSIONS);
        assert!(decoder.sessions.all.len() <= MAX_SESSIONS);
    }
}

/// The same chunk as another station sends it.
fn of_station(station: u64, (header, slots): &(ChunkHeader, Slots)) -> (ChunkHeader, Slots) {
    let mut header = ChunkHeader { station, ..*header };
    header.seal(slots);
    (header, *slots)
}

#[test]
fn two_stations_on_one_topic_do_not_disturb_each_other() {
    let mut decoder = ChunkDecoder::default();
    let mut stations = [9, 10].map(|station| (station, ChunkEncoder::default()));
    // The second one is restarted on the way.
    for (epoch, restarted) in [(1, 10), (2, 11)] {
        stations[1] = (restarted, ChunkEncoder::default());
        for (k, chunk) in answers(&[38, 37, 36, 35], 1, epoch).iter().enumerate() {
            for (station, encoder) in &mut stations {
                let chunk = of_station(*station, chunk);
                let sent = sent(encoder, &chunk);
                assert!(k == 0 || sent.len() < CHUNK_SLOTS);
                assert_eq!(decoder.decode(&chunk.0, &sent), Ok(chunk.1));
            }
        }
    }
}

#[test]
fn stations_that_come_and_go_take_the_place_of_none_in_use() {
    let (mut encoder, mut decoder) = (ChunkEncoder::default(), ChunkDecoder::default());
    for (other, chunk) in (100..).zip(answers(&[38; 20], 1, 1)) {
        let sent = sent(&mut encoder, &chunk);
        assert_eq!(decoder.decode(&chunk.0, &sent), Ok(chunk.1));
        for object in 0..2 {
            let nothing = [ChunkSlot::zeroed(); CHUNK_SLOTS];
            let first = sealed(ChunkKind::Model as u32, object, (1, 0), &nothing);
            let (header, slots) = of_station(other, &(first, nothing));
            assert_eq!(decoder.decode(&header, &slots), Ok(slots));
        }
        assert!(decoder.sessions.all.len() <= 2 * MAX_STATIONS);
    }
}
