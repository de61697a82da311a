//! The VE station as a process: it builds SPM files and serves them.
//!
//! | module | is |
//! |---|---|
//! | [`export`] | an SPM file as a plain mesh, or in the thesis's text formats |
//! | [`inspect`] | what an SPM file holds, for people and scripts |
//! | [`database`] | the models of a scene, and the cache of built ones |
//! | `file_bytes` | the bytes of a file, safe from whoever overwrites it |
//! | [`connection`], [`serve`] | the iceoryx2 ports around the pure core ([`station_core`]), and the command |

pub mod connection;
pub mod database;
pub mod export;
mod file_bytes;
pub mod inspect;
pub mod serve;
mod tuning;

pub use file_bytes::FileBytes;
