//! Small damage, drawn at random.

use rand::{RngCore, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Draws and damages.
pub struct Mutator(Xoshiro256PlusPlus);

/// Words that readers stumble over.
const WORDS: [&[u8]; 32] = [
    b"nan",
    b"-inf",
    b"1e999",
    b"0",
    b"-1",
    b"4294967295",
    b"4294967296",
    b"-9223372036854775808",
    b"18446744073709551615",
    b"1e-320",
    b"0.1",
    b"\n",
    b"\r",
    b"\r\n",
    b"\\\n",
    b"#",
    b" ",
    b"\0",
    b"\xff",
    b"\xef\xbb\xbf",
    b"f 1 2 3\n",
    b"v 0 0 0\n",
    b"3 0 1 2\n",
    b"& ",
    b"v* 1 ",
    b"solid ",
    b"vertex ",
    b"endloop\n",
    b"end_header\n",
    b"element vertex 4000000000\n",
    b"OFF\n",
    b"property list uint double vertex_indices\n",
];
/// Numbers that readers stumble over, as bytes of either order.
const NUMBERS: [u32; 8] = [
    0,
    1,
    0x7fff_ffff,
    0x8000_0000,
    u32::MAX,
    u32::MAX - 1,
    0x7fc0_0000,
    0x7f80_0000,
];

impl Mutator {
    pub fn new(seed: u64) -> Self {
        Self(Xoshiro256PlusPlus::seed_from_u64(seed))
    }

    /// A number below `limit`.
    pub fn below(&mut self, limit: usize) -> usize {
        (self.0.next_u64() % limit.max(1) as u64) as usize
    }

    /// One to four changes; `other` lends its bytes.
    pub fn damage(&mut self, bytes: &mut Vec<u8>, other: &[u8], may_grow: bool) {
        for _ in 0..=self.below(4) {
            let at = self.below(bytes.len() + 1);
            let end = at + self.below(bytes.len() - at + 1).min(1 << self.below(8));
            match self.below(if may_grow { 9 } else { 4 }) {
                0 if at < bytes.len() => bytes[at] ^= 1 << self.below(8),
                1 if at < bytes.len() => bytes[at] = self.below(256) as u8,
                2 if at + 4 <= bytes.len() => {
                    let number = NUMBERS[self.below(NUMBERS.len())];
                    let number = if self.below(2) == 0 {
                        number.to_le_bytes()
                    } else {
                        number.to_be_bytes()
                    };
                    bytes[at..at + 4].copy_from_slice(&number);
                }
                3 if at + 4 <= bytes.len() => {
                    // A neighbour of a number that makes sense.
                    let at = at / 4 * 4;
                    let word: [u8; 4] = [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
                    let changed = u32::from_le_bytes(word)
                        .wrapping_add(self.below(5) as u32)
                        .wrapping_sub(2);
                    bytes[at..at + 4].copy_from_slice(&changed.to_le_bytes());
                }
                4 => {
                    bytes.drain(at..end);
                }
                5 => {
                    let copy = bytes[at..end].to_vec();
                    let to = self.below(bytes.len() + 1);
                    bytes.splice(to..to, copy);
                }
                6 => {
                    let word = WORDS[self.below(WORDS.len())];
                    bytes.splice(at..end.min(at + 4), word.iter().copied());
                }
                7 => {
                    let from = self.below(other.len() + 1);
                    let to = from + self.below(other.len() - from + 1);
                    bytes.splice(at..end, other[from..to].iter().copied());
                }
                8 => bytes.truncate(at.max(1)),
                _ => {}
            }
        }
    }
}
