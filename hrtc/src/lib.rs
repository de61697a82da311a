//! The haptic real-time controller as a process: the shell around the pure core ([`hrtc_core`]).
//!
//! The shell owns the clock, the threads, the device and the iceoryx2 ports.

pub mod devices;
pub mod link;
pub mod logging;
pub mod recorder;
pub mod result;
pub mod run;
pub mod setup;
pub mod tick_record;
pub mod tuning;
