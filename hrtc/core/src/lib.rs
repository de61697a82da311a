//! The pure core of the haptic controller: values in, values out. No file, thread, clock or hash
//! map, and no allocation in a tick; the same inputs give the same bits.
//!
//! ```text
//! sample > activate > receive > predict > refine > refit > contact > render > limit > record
//!    ^         |         ^         |         |                |                  |
//! samples  ActiveSet   chunks  requests    Front           Contacts           wrenches
//! ```
//!
//! [`Controller::tick`] is this line, one call a step. An active object has three parts, and only
//! it knows all three: the *session* with the station, the *front* with cache and refinement, the
//! *contacts* with the probes.
//!
//! | room | does | name in the thesis (Figures 5.15, 5.17) |
//! |---|---|---|
//! | `tick`, `controller` | order of the algorithm; state | Haptic Controller |
//! | [`active`] | objects near a probe, broad phase | |
//! | [`streaming`] | session with the station: requests, chunks | Mesh Subscriber |
//! | [`lod`] | prediction, front, refinement, geomorphs | Cache Agent |
//! | [`governor`], [`policy`] | the time of a tick; how fine it may be | 4.1.2 |
//! | [`cache`] | base mesh, records, regions in a fixed number of bytes | Cache |
//! | `probe` | probes; pairs of a probe and an object | Physics Engine |
//! | [`contact`] | queries and proxies | Physics Engine |
//! | [`force`], [`bodies`] | effects, energy account, limiter; movable objects | Physics Engine |
//! | [`perception`] | bound of the force's rate while a surface changes under a probe | |
//! | `tuning` | every tuned number, by room | |
//! | [`record`], [`script`] | numbers of a tick; intended motion of a simulated hand | |
//!
//! Rooms import only rooms to the right: `tick` → `controller` → `active` → `streaming` → `lod` →
//! `probe` → `bodies` → `force` → `contact` → `perception` → `tuning`; `streaming` and `lod`
//! import `cache` too, `lod` also `policy`.
//!
//! # Two walks
//! - Device sample to force: `tick`, `probe/mod`, `active/object`, `probe/contacts`, `probe/pair`,
//!   `probe/proxy_kind`, `contact/sphere_proxy/mod`, `contact/query/near_faces`,
//!   `force/effects/mod`, `force/passivity`, `force/limiter`.
//! - Prediction to refined face: `tick`, `active/object`, `lod/prediction`, `lod/predict`,
//!   `streaming/session`, `streaming/subscriber`, `streaming/answers`, `cache/mod`, `cache/unload`,
//!   `cache/region`, `lod/refine`, `lod/geomorph`, `cache/operations`.
//!
//! # Glossary
//! | word | meaning |
//! |---|---|
//! | active object | an object near a probe, with session, front and contacts; at most `active_objects` of the plan |
//! | object instance | an object of the scene: model, pose, size, surface |
//! | pair | one probe and one active object: proxy, contact state, rendered forces |
//! | proxy | the probe as it would be if it could not enter the object |
//! | patch | the ball of surface that a probe touches at once |
//! | VSP | vertex split record; a *closure* is what a region needs, in order |
//! | front | the active faces of a model |
//! | region | a cell of the model's grid at a tolerance; requested, loaded and performed as a whole |
//! | resident, wanted, refined | its closure is loaded; is to be performed; is performed |
//! | ring | regions of one tolerance around the contact; the finest ring follows speed and memory pressure |
//! | memory pressure | steps by which less is asked for while the cache is too small |
//! | geomorph | a split or collapse whose vertices move within the perception limit |
//! | transition | immediate, geomorph, deferred, rejected |
//! | perception limit | how far the surface under a probe may move in a tick, by a bound of the force's rate |
//! | energy account | Hannaford's passivity observer and controller, by scaling the force (Hannaford 2002) |
//! | twist | displacement of a centre and rotation vector; a velocity only where a name says so |
//! | epoch | a numbered sequence of chunks; it ends where a chunk is lost |
//! | expected error, certified error | what a tolerance promises on average; a bound |
//!
//! # Example
//! A controller asks for its model in the first tick that has a station:
//!
//! ```
//! use hrtc_core::streaming::subscriber::Identity;
//! use hrtc_core::{Controller, ControllerOptions, NoObserver, TickInputs, WrenchLimits};
//! use scene::{NoFiles, Overrides, parse};
//!
//! let text = "[[object]]\nmodel = \"ball.spm\"\nsize_m = 0.1\n[[probe]]\n";
//! let plan = parse(text, "ball", "".as_ref(), &Overrides::default(), &NoFiles).unwrap();
//! let identity = Identity { client: 7, incarnation: 1 };
//! let options = ControllerOptions {
//!     limits: &[WrenchLimits::of_force(10.0)],
//!     tour_seconds: 0.0,
//! };
//! let mut controller = Controller::new(&plan, identity, options);
//! let mut outputs = controller.new_outputs();
//! let inputs = TickInputs {
//!     tick: 0,
//!     samples: &[None],
//!     station: 1,
//!     chunks: [&[], &[]],
//!     stopping: false,
//! };
//! controller.tick(&inputs, &mut outputs, &mut NoObserver);
//! assert_eq!(outputs.outbox.requests().len(), 1);
//! assert_eq!(outputs.wrenches[0].force.length(), 0.0);
//! ```
//!
//! `examples/embed_tick.rs` answers the requests with a station in the same process, and tells the
//! controller what a device needs to be safe: its limits, the costs of the machine, the deadline of
//! a tick, and forces that have expired.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

pub mod active;
pub mod bodies;
mod budget;
pub mod cache;
mod capacity;
pub mod contact;
mod controller;
mod costs;
pub mod force;
pub mod governor;
pub mod horizons;
mod inspect;
mod instance;
pub mod lod;
mod observer;
pub mod perception;
pub mod policy;
mod probe;
pub mod record;
pub mod script;
pub mod streaming;
mod summary;
mod tick;
mod tuning;
mod work;

pub use active::object::ActiveObject;
pub use capacity::Capacity;
pub use controller::{Controller, ControllerOptions, WrenchLimits};
pub use instance::ModelFrame;
pub use observer::{NoObserver, Stage, StageObserver, Timed, ToolBefore};
pub use streaming::Fault;
pub use tick::{ProbeContact, TickInputs, TickOutputs};
