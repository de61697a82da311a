//! Requests to the station and what comes back.

pub mod chunk;
pub mod subscriber;
