//! Chunks of points of a path: each number of a slot by the line through the same number of the two
//! points before, also across chunks.

use super::numbers::Number;
use super::range_coder::Code;
use crate::wire::{CHUNK_SLOTS, ChunkSlot};
use bytemuck::Zeroable;

/// Numbers of a point.
const NUMBERS: usize = size_of::<ChunkSlot>() / size_of::<f64>();
/// The numbers of a point, as bits.
type Point = [u64; NUMBERS];

/// What is known of the points of an epoch.
#[derive(Debug)]
pub struct PointsModel {
    /// Slots up to the last that is not zero.
    used: Number,
    numbers: Vec<WideDifference>,
    /// The last point, and the one before it.
    last: [Point; 2],
}

impl Default for PointsModel {
    fn default() -> Self {
        Self {
            used: Number::NEW,
            numbers: vec![WideDifference::NEW; NUMBERS],
            last: [[0; NUMBERS]; 2],
        }
    }
}

impl PointsModel {
    /// Codes the slots of a chunk.
    pub fn code(
        &mut self,
        code: &mut impl Code,
        given: &[ChunkSlot; CHUNK_SLOTS],
    ) -> [ChunkSlot; CHUNK_SLOTS] {
        let zero = ChunkSlot::zeroed();
        let used = given.iter().rposition(|slot| *slot != zero);
        let used = self.used.code(code, used.map_or(0, |last| last as u32 + 1));
        let mut slots = [zero; CHUNK_SLOTS];
        for (slot, given) in slots.iter_mut().zip(given).take(used as usize) {
            let given: &Point = bytemuck::cast_ref(&given.words);
            let point: &mut Point = bytemuck::cast_mut(&mut slot.words);
            for (k, number) in self.numbers.iter_mut().enumerate() {
                let [one, two] = self.last.map(|point| f64::from_bits(point[k]));
                let line = one + (one - two);
                // The bits of what is not a number differ between processors.
                let line = if line.is_finite() { line } else { 0.0 };
                point[k] = number.code(code, given[k], line.to_bits());
            }
            self.last = [*point, self.last[0]];
        }
        slots
    }
}

/// A difference of two numbers of 64 bits that wraps around.
#[derive(Debug, Clone)]
struct WideDifference {
    high: Number,
    /// The lower half where the upper half is zero.
    low: Number,
}

impl WideDifference {
    /// Nothing is known.
    const NEW: Self = Self {
        high: Number::NEW,
        low: Number::NEW,
    };

    /// Codes a value by its difference to another one.
    fn code(&mut self, code: &mut impl Code, value: u64, to: u64) -> u64 {
        let difference = value.wrapping_sub(to);
        // Zigzag: small ones of both signs are small.
        let folded = difference << 1 ^ if difference >> 63 == 1 { u64::MAX } else { 0 };
        let high = self.high.code(code, (folded >> 32) as u32);
        let low = if high == 0 {
            self.low.code(code, folded as u32)
        } else {
            code.even(folded as u32, u32::BITS)
        };
        let folded = u64::from(high) << 32 | u64::from(low);
        let difference = folded >> 1 ^ if folded & 1 == 1 { u64::MAX } else { 0 };
        to.wrapping_add(difference)
    }
}
