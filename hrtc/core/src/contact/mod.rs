//! Queries on an active front, and the proxies that stand on them.

pub mod coupling;
pub mod motion;
pub mod query;
pub mod rigid_proxy;
pub mod sphere_proxy;
pub mod tool;
