//! The haptic real-time controller as a process: the shell around the pure core ([`hrtc_core`]).
//!
//! The shell owns the clock, the threads, the devices and the iceoryx2 ports.
//!
//! | module | contents |
//! |---|---|
//! | [`cli`] | the command line, signals and exit statuses of a program that ticks |
//! | [`run`] | a run from start to result: threads, rings, messages |
//! | [`devices`] | [`DeviceRegistry`](devices::DeviceRegistry): devices by the name in a scene |
//! | [`setup`] | identity of a controller and limits of its devices |
//! | [`fetch`] | the station's scene, for a run without one of its own |
//! | [`link`] | connection agent: one thread with every iceoryx2 port |
//! | [`tick_record`] | numbers of one tick for the log |
//! | [`result`] | result fields, series and histograms of a run |
//! | [`recorder`] | recording of all inputs, and its replay |
//! | [`tuning`] | sizes of rings and stacks, waiting times |
//!
//! A station on another machine is called by `hrtc run --station`, which needs no file of the
//! scene: see the page of `ve-station`.
//!
//! # Example
//! The program `hrtc` with a driver of one's own, which is named `fixed` in the scene or in a file
//! of `--device`. A contact needs a station in the same domain (`ve-station serve`).
//! ```no_run
//! use haptic_device::{Capabilities, Device, Pose, Sample, TickTime, WrenchCommand};
//! use hrtc::devices::DeviceRegistry;
//! use std::process::ExitCode;
//!
//! /// A handle that is fixed 50 mm above the origin.
//! struct Fixed;
//!
//! impl Device for Fixed {
//!     fn capabilities(&self) -> Capabilities {
//!         Capabilities::translational("fixed", 5.0)
//!     }
//!     fn read(&mut self, time: TickTime) -> Option<Sample> {
//!         let pose = Pose::at(glam::DVec3::Z * 0.05);
//!         Some(Sample { time_ns: time.start_ns, ..Sample::at(pose) })
//!     }
//!     fn write(&mut self, _command: WrenchCommand) {}
//!     fn safe_off(&mut self) {}
//! }
//!
//! fn main() -> ExitCode {
//!     let devices = DeviceRegistry::new().with("fixed", |_request| Ok(Box::new(Fixed)));
//!     hrtc::cli::main(&devices)
//! }
//! ```
//! [`run::run_until`] is a run without a command line. Its caller has to hear the signals: one that
//! ends the process under a force ends it without the ramp.

pub mod calibration;
pub mod cli;
pub mod devices;
pub mod fetch;
pub mod link;
mod message;
pub mod recorder;
pub mod result;
pub mod run;
pub mod setup;
mod station_heard;
mod station_link;
pub mod tick_record;
pub mod time_answers;
pub mod traffic;
pub mod tuning;
