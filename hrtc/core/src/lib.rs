//! The pure core of the controller: values in, values out. No file, thread, clock or hash map.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

pub mod active;
pub mod bodies;
mod budget;
pub mod cache;
mod capacity;
pub mod contact;
mod controller;
pub mod force;
mod inspect;
mod instance;
pub mod lod;
pub mod perception;
mod probe;
pub mod record;
pub mod script;
pub mod streaming;
mod summary;
mod tick;

pub use active::object::ActiveObject;
pub use capacity::Capacity;
pub use controller::Controller;
pub use instance::ModelFrame;
pub use streaming::Fault;
pub use tick::{NoObserver, ProbeContact, Stage, StageObserver, TickInputs, TickOutputs};
