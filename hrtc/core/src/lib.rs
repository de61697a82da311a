//! The pure core of the haptic real-time controller: values in, values out; no clock, no I/O, no allocation in a tick.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

pub mod active;
pub mod bodies;
pub mod cache;
mod capacity;
pub mod contact;
mod controller;
pub mod force;
mod frame;
mod inspect;
pub mod lod;
pub mod perception;
mod probe;
pub mod record;
pub mod script;
pub mod streaming;
mod summary;

pub use active::object::ActiveObject;
pub use capacity::Capacity;
pub use controller::{
    Controller, Fault, NoObserver, ProbeContact, Stage, StageObserver, TickInputs, TickOutputs,
};
pub use frame::ModelFrame;
