//! An adaptive binary range coder (Martin 1979, in the form of LZMA's): each bit costs what its
//! model makes it cost, and the model learns from it.
//!
//! What is coded is described once, for both directions: [`Code::bit`] writes the bit that it is
//! given, or reads one whatever it is given, and returns it.

/// Fractional bits of a probability.
const PROBABILITY_BITS: u32 = 16;
/// Bits of a probability that the coder uses.
const USED_BITS: u32 = 14;
/// Bits that a model has seen when it stops to learn faster: from then on each changes it by a
/// share of one in so many and two. Between the usual shifts of 5 and 6 bits.
const SLOWEST: u16 = 40;
/// The range is at least this before every bit.
const MIN_RANGE: u32 = 1 << 24;

/// What is known of a bit of some meaning.
#[derive(Debug, Clone, Copy)]
pub struct Bit {
    /// Probability of a zero, of 2^16.
    zero: u16,
    /// Bits seen, up to [`SLOWEST`].
    seen: u16,
}

impl Bit {
    /// Nothing is known.
    pub const NEW: Self = Self {
        zero: 1 << (PROBABILITY_BITS - 1),
        seen: 0,
    };

    /// Probability of a zero in [`USED_BITS`], never 0 nor 1.
    fn used(self) -> u32 {
        let zero = u32::from(self.zero) >> (PROBABILITY_BITS - USED_BITS);
        zero.clamp(1, (1 << USED_BITS) - 1)
    }

    fn update(&mut self, bit: bool) {
        // The mean of what was seen, as long as that is little.
        let share = u32::from(self.seen) + 2;
        if bit {
            self.zero -= (u32::from(self.zero) / share) as u16;
        } else {
            let rest = u32::from(u16::MAX - self.zero);
            self.zero += (rest / share) as u16;
        }
        self.seen = (self.seen + 1).min(SLOWEST);
    }
}

impl Default for Bit {
    fn default() -> Self {
        Self::NEW
    }
}

/// One direction of a coder.
pub trait Code {
    /// Codes a bit with its model.
    fn bit(&mut self, bit: bool, model: &mut Bit) -> bool;

    /// Codes so many low bits of a value without a model, each as likely as not; at most 32.
    fn even(&mut self, value: u32, bits: u32) -> u32;
}

/// Writes bits into bytes.
#[derive(Debug)]
pub struct BitWriter {
    bytes: Vec<u8>,
    low: u64,
    range: u32,
}

impl BitWriter {
    /// Has written nothing yet.
    pub fn new() -> Self {
        Self {
            bytes: Vec::new(),
            low: 0,
            range: u32::MAX,
        }
    }

    /// Takes the part of the range from `start` on.
    fn narrow(&mut self, start: u32, range: u32) {
        self.low += u64::from(start);
        self.range = range;
        while self.range < MIN_RANGE {
            self.shift();
            self.range <<= 8;
        }
    }

    /// Moves the highest byte of `low` out, and its carry into the bytes before it.
    fn shift(&mut self) {
        if self.low >> 32 != 0 {
            for byte in self.bytes.iter_mut().rev() {
                *byte = byte.wrapping_add(1);
                if *byte != 0 {
                    break;
                }
            }
        }
        self.bytes.push((self.low >> 24) as u8);
        self.low = (self.low & 0x00ff_ffff) << 8;
    }

    /// The bytes. A reader takes zeros for what follows them.
    pub fn finish(mut self) -> Vec<u8> {
        // Of the numbers in the range, the one with most zeros at its end.
        let last = self.low + u64::from(self.range) - 1;
        let ends = [32, 24, 16, 8].map(|bits| last >> bits << bits);
        let end = ends.into_iter().find(|&end| end >= self.low);
        self.low = end.unwrap_or(self.low);
        for _ in 0..4 {
            self.shift();
        }
        let used = self.bytes.iter().rposition(|&byte| byte != 0);
        self.bytes.truncate(used.map_or(0, |last| last + 1));
        self.bytes
    }
}

impl Code for BitWriter {
    fn bit(&mut self, bit: bool, model: &mut Bit) -> bool {
        let zeros = (self.range >> USED_BITS) * model.used();
        if bit {
            self.narrow(zeros, self.range - zeros);
        } else {
            self.narrow(0, zeros);
        }
        model.update(bit);
        bit
    }

    fn even(&mut self, value: u32, bits: u32) -> u32 {
        for at in (0..bits).rev() {
            let half = self.range >> 1;
            if value >> at & 1 == 1 {
                self.narrow(half, self.range - half);
            } else {
                self.narrow(0, half);
            }
        }
        value
    }
}

/// Reads what a [`BitWriter`] wrote; something from any bytes.
#[derive(Debug)]
pub struct BitReader<'a> {
    bytes: &'a [u8],
    /// Offset into the range.
    offset: u32,
    range: u32,
}

impl<'a> BitReader<'a> {
    /// A reader before the first bit.
    pub fn new(bytes: &'a [u8]) -> Self {
        let mut reader = Self {
            bytes,
            offset: 0,
            range: u32::MAX,
        };
        for _ in 0..4 {
            reader.shift();
        }
        reader
    }

    fn shift(&mut self) {
        let (byte, rest) = self.bytes.split_first().unwrap_or((&0, &[]));
        self.bytes = rest;
        self.offset = self.offset << 8 | u32::from(*byte);
    }

    /// Whether the bit is a one, where zeros have the first part of the range.
    fn read(&mut self, zeros: u32) -> bool {
        let bit = self.offset >= zeros;
        if bit {
            self.offset -= zeros;
            self.range -= zeros;
        } else {
            self.range = zeros;
        }
        while self.range < MIN_RANGE {
            self.shift();
            self.range <<= 8;
        }
        bit
    }
}

impl Code for BitReader<'_> {
    fn bit(&mut self, _: bool, model: &mut Bit) -> bool {
        let bit = self.read((self.range >> USED_BITS) * model.used());
        model.update(bit);
        bit
    }

    fn even(&mut self, _: u32, bits: u32) -> u32 {
        (0..bits).fold(0, |value, _| {
            value << 1 | u32::from(self.read(self.range >> 1))
        })
    }
}
