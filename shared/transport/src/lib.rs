//! The iceoryx2 transport of the protocol: where two processes meet, and how each topic is opened.
//!
//! | module | content |
//! |---|---|
//! | `domain` | named domains, their services, ports and quality of service |
//! | `turns` | receiving from many senders, each in its turn |
//! | [`logging`] | lines of either process on standard error, which nobody waits for |
//! | [`signals`] | what ends either process, and when Ctrl-C counts as pressed again |
//!
//! ```
//! use transport::{Domain, TransportError};
//!
//! let domain = Domain::new("lab-1").unwrap();
//! assert!(domain.root().to_string_lossy().ends_with("-lab-1"));
//! assert!(matches!(Domain::new("a/b"), Err(TransportError::DomainName(_))));
//! ```

#![forbid(unsafe_code)]

mod domain;
pub mod logging;
pub mod signals;
mod turns;

pub use domain::{
    CARRIED_TOPICS, Domain, Heartbeats, IpcNode, MAX_PORTS, MAX_QUEUED, RequestSender, Topic,
    TransportError,
};
pub use turns::receive_in_turn;
