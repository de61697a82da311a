//! Numbers as bits: a class, which is the number of its bits, by a tree of models, then the bits
//! behind the highest, the first of them by models too.

use super::range_coder::{Bit, Code};

/// Bits behind the highest of a number that have models.
const MODELLED: u32 = 3;

/// A value of `1 << BITS`, each bit by what those before it were.
#[derive(Debug, Clone)]
pub struct Tree<const LEAVES: usize> {
    nodes: [Bit; LEAVES],
}

impl<const LEAVES: usize> Tree<LEAVES> {
    const BITS: u32 = LEAVES.ilog2();
    /// Nothing is known.
    pub const NEW: Self = Self {
        nodes: [Bit::NEW; LEAVES],
    };

    /// Codes a value below the number of leaves, which is a power of two.
    pub fn code(&mut self, code: &mut impl Code, value: u32) -> u32 {
        let mut node = 1;
        for at in (0..Self::BITS).rev() {
            let bit = code.bit(value >> at & 1 == 1, &mut self.nodes[node]);
            node = node << 1 | usize::from(bit);
        }
        (node - LEAVES) as u32
    }
}

/// A number of 32 bits.
#[derive(Debug, Clone)]
pub struct Number {
    class: Tree<64>,
    behind: [Tree<{ 1 << MODELLED }>; 33],
}

impl Number {
    /// Nothing is known.
    pub const NEW: Self = Self {
        class: Tree::NEW,
        behind: [Tree::NEW; 33],
    };

    /// Codes a number.
    pub fn code(&mut self, code: &mut impl Code, value: u32) -> u32 {
        let class = self.class.code(code, u32::BITS - value.leading_zeros());
        // A reader may find any class of six bits.
        let class = class.min(32);
        if class < 2 {
            return class;
        }
        let rest = class - 1;
        let low = rest.saturating_sub(MODELLED);
        // Fewer bits than the tree has stand at its upper end.
        let spare = MODELLED - (rest - low);
        let high = (value >> low & ((1 << (rest - low)) - 1)) << spare;
        let high = self.behind[class as usize].code(code, high) >> spare;
        let low_bits = code.even(value & ((1 << low) - 1), low);
        1 << rest | high << low | low_bits
    }
}

/// A difference of two numbers of 32 bits that wraps around.
#[derive(Debug, Clone)]
pub struct Difference {
    number: Number,
}

impl Difference {
    /// Nothing is known.
    pub const NEW: Self = Self {
        number: Number::NEW,
    };

    /// Codes a value by its difference to another one.
    pub fn code(&mut self, code: &mut impl Code, value: u32, to: u32) -> u32 {
        let difference = value.wrapping_sub(to);
        // Zigzag: small ones of both signs are small.
        let folded = difference << 1 ^ if difference >> 31 == 1 { u32::MAX } else { 0 };
        let folded = self.number.code(code, folded);
        let difference = folded >> 1 ^ if folded & 1 == 1 { u32::MAX } else { 0 };
        to.wrapping_add(difference)
    }
}
