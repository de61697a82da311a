//! The iceoryx2 transport of the protocol: where two processes meet, and how each topic is opened.
//!
//! | module | content |
//! |---|---|
//! | `domain` | named domains, their services and quality of service |
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

pub use domain::{Domain, MAX_PORTS, MAX_QUEUED, TransportError};
