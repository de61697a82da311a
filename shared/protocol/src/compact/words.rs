//! Chunks as words of 32 bits, each by the same word of the item before.

use super::numbers::{Difference, Number};
use super::range_coder::Code;
use crate::wire::{CHUNK_SLOTS, ChunkSlot};
use bytemuck::Zeroable;

/// Words of a slot.
const SLOT_WORDS: usize = 16;
/// Words of an item: a face or a measured error.
const ITEM_WORDS: usize = SLOT_WORDS / 2;
/// Words of a chunk.
const WORDS: usize = CHUNK_SLOTS * SLOT_WORDS;

/// What is known of words.
#[derive(Debug)]
pub struct WordsModel {
    /// Up to the last that is not zero.
    used: Number,
    differences: Vec<Difference>,
}

impl Default for WordsModel {
    fn default() -> Self {
        Self {
            used: Number::NEW,
            differences: vec![Difference::NEW; ITEM_WORDS],
        }
    }
}

impl WordsModel {
    /// Codes the slots of a chunk.
    pub fn code(
        &mut self,
        code: &mut impl Code,
        given: &[ChunkSlot; CHUNK_SLOTS],
    ) -> [ChunkSlot; CHUNK_SLOTS] {
        let given: &[u32] = bytemuck::cast_slice(given);
        let used = given.iter().rposition(|&word| word != 0);
        let used = self.used.code(code, used.map_or(0, |last| last as u32 + 1));
        let mut slots = [ChunkSlot::zeroed(); CHUNK_SLOTS];
        let words: &mut [u32] = bytemuck::cast_slice_mut(&mut slots);
        for at in 0..(used as usize).min(WORDS) {
            let before = at.checked_sub(ITEM_WORDS).map_or(0, |at| words[at]);
            words[at] = self.differences[at % ITEM_WORDS].code(code, given[at], before);
        }
        slots
    }
}
