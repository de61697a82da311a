//! Requests to the station and what comes back.

pub mod chunk;
pub(crate) mod ingest;
pub mod subscriber;
