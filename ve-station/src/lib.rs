//! The VE station: builds space-partitioned progressive meshes and serves them.
//!
//! | module | is |
//! |---|---|
//! | [`build`] | mesh file to SPM file |
//! | [`generate`] | shapes of known geometry as meshes of any size |
//! | [`export`] | an SPM file as a plain mesh, or in the thesis's text formats |
//! | [`inspect`] | what an SPM file holds, for people and scripts |
//! | [`database`] | the models of a scene, mapped |
//! | [`collection`], [`station`] | the pure core: closures and answers |
//! | [`connection`], [`serve`] | the iceoryx2 ports around it, and the command |
//! | [`tour`] | scripted paths over a mesh |

pub mod build;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod collection;
pub mod connection;
pub mod database;
pub mod export;
pub mod generate;
pub mod inspect;
pub mod serve;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod station;
#[deny(clippy::disallowed_methods, clippy::disallowed_types)]
pub mod tour;

#[cfg(test)]
mod testing;
