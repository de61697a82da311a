//! Long walks over fronts: legal, certified, and independent of how they came about.

mod moving_blocks;
mod walks;
