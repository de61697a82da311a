//! The pure core of the haptic real-time controller: values in, values out; no clock, no I/O, no allocation in a tick.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

pub mod active;
pub mod bodies;
pub mod cache;
pub mod contact;
pub mod controller;
pub mod force;
pub mod lod;
pub mod perception;
pub mod record;
pub mod script;
pub mod streaming;
