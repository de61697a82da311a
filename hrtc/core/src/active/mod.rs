//! Which objects are awake.

pub mod broad_phase;
