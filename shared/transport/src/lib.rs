//! The iceoryx2 side of the protocol: where two processes meet, and how each topic is opened.

#![forbid(unsafe_code)]

mod domain;

pub use domain::{BUFFER, Domain, MAX_PORTS, TransportError};
