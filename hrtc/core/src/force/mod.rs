//! From contact to wrench: effects, then the energy account, then the force limiter.

pub mod device_motion;
pub mod effects;
pub mod limiter;
pub mod paid_coupling;
pub mod passivity;
pub mod positions;
