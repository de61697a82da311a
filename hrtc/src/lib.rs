//! The haptic real-time controller.
//!
//! The core ([`controller`] and what it owns) is pure: a tick takes values and gives values. The shell
//! around it owns the clock, the threads, the device and the iceoryx2 ports.

#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod broad_phase;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod cache;
pub mod connection;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod controller;
pub mod counting_allocator;
pub mod device;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod dial;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod effects;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod energy;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod gate;
pub mod inbox;
pub mod logging;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod morph;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod movable;
pub mod pacer;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod predict;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod proxy;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod query;
pub mod realtime;
pub mod recorder;
pub mod result;
pub mod run;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod subscriber;
pub mod tick_record;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod tool;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod tool_proxy;
