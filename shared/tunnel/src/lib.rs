//! The link between two machines: the topics of a domain cross to the domain of another machine.
//!
//! It is iceoryx2's own tunnel over zenoh, in a process of its own: neither the tick nor the
//! station holds a thread of the network, and what happens there ends no program. The process is
//! the program itself, started again with the hidden subcommand [`SUBCOMMAND`]; a [`Tunnel`] is its
//! owner's hold on it.
//!
//! | module | content |
//! |---|---|
//! | `address` | where a side listens, or whom it calls; what may go unencrypted |
//! | `settings` | the settings of zenoh, generated whole |
//! | `key_files` | the files of a side's keys |
//! | `arguments` | what the process is told |
//! | `supervisor` | the process as its owner sees it: started, watched, ended |
//! | `words` | what it tells its owner |
//! | `named` | words for refused certificates and lost links |
//! | `process` | the process itself (feature `engine`, as all below) |
//! | `notes`, `refusals` | its sentences, and those made of zenoh's log |
//! | `keys`, `authority` | keys checked, keys made |
//!
//! Off the loopback a link is encrypted, and both sides show certificates of one authority. The
//! settings name the role of the other side too, so that a controller's keys make no station.
//!
//! # What the feature adds
//! Some 255 crates to the 221 of the default build, which has none of them (`rt-tests`' tests of
//! the house): zenoh (EPL-2.0 or Apache-2.0, at the user's choice), tokio, rustls with ring, rcgen
//! and webpki, iceoryx2's link. All are permissive: MIT, Apache-2.0, ISC, BSD, Zlib, BSL-1.0,
//! Unicode-3.0 and CDLA-Permissive-2.0 (the list of public authorities). The list, with licences:
//! ```sh
//! list() { cargo tree --workspace --edges normal,build --prefix none --format '{p} {l}' "$@" |
//!     sed 's/ (\*)//' | sort -u; }
//! comm -13 <(list) <(list --features ve-station/tunnel,hrtc/tunnel)
//! ```
//!
//! ```
//! use tunnel::Address;
//!
//! assert!(Address::to_listen("tls/0.0.0.0:7447").is_ok());
//! assert!(Address::to_listen("tcp/127.0.0.1:7447").is_ok());
//! let refused = Address::to_listen("tcp/0.0.0.0:7447").unwrap_err();
//! assert!(refused.to_string().contains("ve-station keys"));
//! ```

#![forbid(unsafe_code)]

mod address;
mod arguments;
#[cfg(feature = "engine")]
mod authority;
mod key_files;
#[cfg(feature = "engine")]
mod keys;
pub mod named;
#[cfg(feature = "engine")]
mod notes;
#[cfg(feature = "engine")]
mod process;
#[cfg(feature = "engine")]
mod refusals;
mod settings;
#[cfg(all(test, feature = "engine"))]
mod strangers;
mod supervisor;
mod words;

pub use address::{Address, AddressError, Carriage, DEFAULT_PORT};
pub use arguments::{SUBCOMMAND, TunnelArgs};
#[cfg(feature = "engine")]
pub use authority::{MadeKeys, MakeKeysError, make_keys};
pub use key_files::{KeyFiles, Role};
#[cfg(feature = "engine")]
pub use keys::{KeysError, keys_folder};
#[cfg(feature = "engine")]
pub use process::run;
pub use settings::{End, zenoh_settings};
pub use supervisor::{Tunnel, TunnelError};
