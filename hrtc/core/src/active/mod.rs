//! Active objects: the objects near a probe.

mod activation;
pub(crate) mod active_set;
pub mod broad_phase;
mod faults;
pub(crate) mod object;
mod places;
mod shares;
mod starts;
