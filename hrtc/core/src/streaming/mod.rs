//! Session with the station: requests out, chunks in (the Mesh Subscriber of thesis Figure 5.15).

mod answers;
mod base_mesh;
pub mod chunk;
mod fault;
pub(crate) mod link_meter;
mod outbox;
mod questions;
pub(crate) mod session;
pub mod subscriber;

pub use fault::Fault;
pub use outbox::Outbox;
pub(crate) use outbox::turn_of;
