//! Pictures of a touch, from its recording alone.
//!
//! A recording replays bit by bit, so the controller's own refined front is had from it at any
//! tick, and nothing is added to the controller's process. A tick that does not replay is an
//! error: no other front than the controller's is ever shown.
//!
//! | module | holds |
//! |---|---|
//! | [`playback`] | a recording, and the controller at any tick of it |
//! | [`moment`] | what there is to see in a tick |
//! | [`trail`] | the paths of the probes up to it |
//! | [`sight`] | from where a touch is seen |
//! | [`touch_picture`] | the picture of a moment |
//! | [`legend`] | its colours and what they mean |
//! | [`shots`] | a still picture of a recording, and a film |

pub mod legend;
pub mod moment;
pub mod playback;
pub mod shots;
pub mod sight;
pub mod touch_picture;
pub mod trail;
