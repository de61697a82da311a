//! The VE station as a process: it builds SPM files and serves them.
//!
//! | module | is |
//! |---|---|
//! | [`export`] | an SPM file as a plain mesh, or in the thesis's text formats |
//! | [`inspect`] | what an SPM file holds, for people and scripts |
//! | [`database`] | the models of a scene, mapped |
//! | [`connection`], [`serve`] | the iceoryx2 ports around the pure core ([`station_core`]), and the command |

pub mod connection;
pub mod database;
pub mod export;
pub mod inspect;
mod map;
pub mod serve;
