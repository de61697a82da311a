//! What both processes agree on, and both use.
//!
//! | module | holds |
//! |---|---|
//! | [`geometry`] | poses and wrenches, boxes rounded outwards, triangles, exact predicates |
//! | [`spm`] | the space-partitioned progressive mesh: record, active mesh, regions, error codes, file |
//! | [`ab_tree`] | the active bounding tree of thesis chapter 3.3 |
//! | [`protocol`] | requests, chunks, credit and heartbeat between `hrtc` and `ve-station` |
//! | [`scene`] | the scene file as typed, and the validated plan |
//!
//! Everything here is pure: no clock, no file, no thread.

pub mod ab_tree;
pub mod geometry;
pub mod protocol;
pub mod scene;
pub mod spm;
