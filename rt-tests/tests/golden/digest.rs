//! The hash, which is the test's own: a word at a time, the order of the words is what counts.

/// A hash of all words so far.
#[derive(Debug, Clone, Copy, Default)]
pub struct Digest(u64);

impl Digest {
    /// Takes a number in.
    pub fn put(&mut self, number: impl Word) {
        // One round of splitmix64 a word; the constant keeps a row of zeros from being nothing.
        let mut z = (self.0 ^ number.word()).wrapping_add(0x9E37_79B9_7F4A_7C15);
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        self.0 = z ^ z >> 31;
    }

    /// Takes numbers in, one after the other; not how many there are.
    pub fn put_all(&mut self, numbers: impl IntoIterator<Item = impl Word>) {
        for number in numbers {
            self.put(number);
        }
    }

    /// All 64 bits.
    pub fn whole(self) -> u64 {
        self.0
    }

    /// The upper 12 bits, three hexadecimal digits.
    pub fn short(self) -> u64 {
        self.0 >> 52
    }
}

/// A number as 64 bits: of a float its bits, of a whole number the number, of a yes 1.
pub trait Word {
    /// The bits.
    fn word(self) -> u64;
}

impl Word for u64 {
    fn word(self) -> u64 {
        self
    }
}

impl Word for u32 {
    fn word(self) -> u64 {
        u64::from(self)
    }
}

impl Word for usize {
    fn word(self) -> u64 {
        self as u64
    }
}

impl Word for bool {
    fn word(self) -> u64 {
        u64::from(self)
    }
}

impl Word for f64 {
    fn word(self) -> u64 {
        self.to_bits()
    }
}
