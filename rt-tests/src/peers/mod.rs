//! Libraries that measure what ours is worth; nothing of the product depends on them.
//!
//! | module | asks |
//! |---|---|
//! | [`parry`] | parry for closest points and pairs |
//! | [`ball`] | programs with a ball's proxy of their own, CHAI3D's: `rt-tests/peers` |

pub mod ball;
pub mod parry;
