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
use std::path::Path;
use ve_station::output::check_output;

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

/// Checks what a recording is shown in: "viewer", an address of one (with "://"), or a file, which
/// must not be one of a recording.
///
/// # Errors
/// One sentence for a file that is no .rrd, or the recording itself.
pub fn check_target(target: &str, recording: &Path) -> Result<(), Failure> {
    if target == "viewer" || target.contains("://") {
        return Ok(());
    }
    let checked = check_output(Path::new(target), recording, "rrd");
    checked.map_err(|error| Failure::Input(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_is_shown_in_a_viewer_or_a_file_of_the_viewer() {
        let recording = Path::new("run.mcap");
        for target in ["viewer", "rerun+http://127.0.0.1:9876/proxy", "a/run.rrd"] {
            assert_eq!(check_target(target, recording), Ok(()), "{target}");
        }
        for target in ["run-0001.mcap", "127.0.0.1:9876", "Viewer", ""] {
            let refused = check_target(target, recording).expect_err(target);
            assert_eq!(refused.status(), 2, "{target}");
        }
    }
}
