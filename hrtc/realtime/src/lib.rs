//! Real time on Linux: the period of a loop, the rights and counters of its thread, and an
//! allocator that counts.

pub mod counting_allocator;
pub mod pacer;
pub mod rights;
