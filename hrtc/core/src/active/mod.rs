//! Which objects are awake.

pub(crate) mod active_set;
pub mod broad_phase;
mod moving;
pub(crate) mod object;
