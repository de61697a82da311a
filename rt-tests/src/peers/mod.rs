//! Libraries that measure what ours is worth; nothing of the product depends on them.

pub mod parry;
