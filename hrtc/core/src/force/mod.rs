//! From contact to wrench: effects, energy account, limiter.

pub mod effects;
pub mod limiter;
pub mod passivity;
