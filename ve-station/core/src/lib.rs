//! The pure core of the VE station: closures of regions, and the answers to what controllers ask.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

pub mod collection;
pub mod station;
#[cfg(test)]
mod testing;
pub mod tour;
