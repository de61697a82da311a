//! The iceoryx2 transport of the protocol: where two processes meet, and how each topic is opened.
//!
//! | module | content |
//! |---|---|
//! | `domain` | named domains, their services, ports and quality of service |
//! | [`logging`] | notes of either process on standard error |
//!
//! ```
//! use transport::{Domain, TransportError};
//!
//! let domain = Domain::new("lab-1").unwrap();
//! assert_eq!(domain.config().unwrap().global.root_path().to_string(), "/tmp/hrtc-lab-1/");
//! assert!(matches!(Domain::new("a/b"), Err(TransportError::DomainName(_))));
//! ```

#![forbid(unsafe_code)]

mod domain;
pub mod logging;

pub use domain::{Domain, Heartbeats, IpcNode, MAX_PORTS, MAX_QUEUED, Topic, TransportError};
