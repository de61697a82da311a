//! Controllers, a station, links and hands in one process on a simulated clock.
//!
//! No thread, no transport, no clock: a run goes as fast as the machine can, and the same seeds
//! give the same bits. Tests of `hrtc-core` and the commands of `rt-tests` stand on it.
//!
//! | module | holds |
//! |---|---|
//! | [`simulation`] | [`Simulation`]: one station and its clients; a step is a period of the loop |
//! | [`client`] | [`Client`]: a controller, its inbox, its link and a hand for each probe |
//! | [`link`] | [`Link`]: messages under way both ways; [`LinkModel`]: delay, faults, throughput |
//! | [`hand`] | [`Hand`]: the simulated device, led along a path or held at a place |
//! | [`samples`] | [`SampleModel`]: noise, spikes, nonsense and silence of a device |
//! | [`recording`] | [`InputRecording`]: the inputs of every tick; [`Playback`]: them, replayed |
//! | [`summary`] | [`Summary`]: counts and extremes of a client's run |
//! | [`front`] | the active front by ids of the file |
//! | [`random`] | [`Random`]: a generator that names its seed when a test fails |
//!
//! A controller on a link that loses messages:
//!
//! ```
//! use scene::{NoFiles, Overrides, parse};
//! use simulator::{Client, ClientOptions, LinkModel, STATION, Simulation, station};
//! use spm::{SpmFile, write_spm};
//! use spm_builder::{BuildOptions, NoProgress, build_model};
//! use spm_builder::generate::{Shape, generate};
//! use station_core::station::ServedModel;
//!
//! let mesh = generate(Shape::Relief, 500, 1);
//! let parts = build_model(mesh, &BuildOptions::default(), &NoProgress).unwrap();
//! let mut bytes = Vec::new();
//! write_spm(&parts, &mut bytes).unwrap();
//! let served = ServedModel {
//!     name: "relief.spm".to_string(),
//!     file: SpmFile::open(bytes).unwrap(),
//! };
//!
//! let text = "[[object]]\nmodel = \"relief.spm\"\nsize_m = 0.1\n[[probe]]\n";
//! let plan = parse(text, "example", "".as_ref(), &Overrides::default(), &NoFiles).unwrap();
//! let options = ClientOptions {
//!     link: LinkModel {
//!         loss: 0.01,
//!         ..LinkModel::default()
//!     },
//!     tour_s: 2.0,
//!     ..ClientOptions::default()
//! };
//! let client = Client::new(&plan, options);
//! let station = station(&plan, vec![served], STATION).unwrap();
//! let mut simulation = Simulation::new(station, client);
//! for _ in 0..3000 {
//!     simulation.step_led();
//! }
//! assert!(simulation.client().summary().contact > 0);
//! ```

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

pub mod client;
pub mod front;
pub mod hand;
pub mod link;
mod messages;
pub mod random;
pub mod recording;
pub mod samples;
pub mod simulation;
pub mod summary;

pub use client::{Client, ClientOptions, Drive, INBOX_CHUNKS, new_controller};
pub use front::{front_faces, refined_front};
pub use hand::Hand;
pub use link::{Link, LinkModel};
pub use messages::{LinkCounts, MESSAGES};
pub use random::Random;
pub use recording::{InputRecording, Playback};
pub use samples::{SampleFaults, SampleModel};
pub use simulation::{STATION, Simulation, station};
pub use summary::Summary;
