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
//! | [`follower`] | a recording that is read while it is written |
//! | [`pace`] | how much of a run is sent to a viewer |
//! | [`course`] | which of its ticks, up to the last one |
//! | `viewer` | a recording, or a run behind it, for the viewer rerun (feature `view`) |

pub mod course;
pub mod follower;
pub mod legend;
pub mod moment;
pub mod pace;
pub mod playback;
pub mod shots;
pub mod sight;
pub mod touch_picture;
pub mod trail;
#[cfg(feature = "view")]
pub mod viewer;

use crate::failure::Failure;

/// Whether this build has the viewer.
///
/// # Errors
/// One sentence that says how to get it, where it has not.
pub fn check_viewer() -> Result<(), Failure> {
    if cfg!(feature = "view") {
        return Ok(());
    }
    Err(Failure::Input(
        "this build is without the viewer; build it with cargo build --release -p rt-tests --features view"
            .to_owned(),
    ))
}
