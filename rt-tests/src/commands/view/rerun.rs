//! `rt-tests view --rerun`.

use crate::failure::Failure;
use std::path::Path;

/// Sends a recording to rerun.
///
/// # Errors
/// Those of the viewer.
#[cfg(feature = "view")]
pub fn view(recording: &Path, target: &str) -> Result<(), Failure> {
    use crate::pictures::viewer::show;
    use crate::processes::stop::stop_flag;
    use crate::report::output::{print, status_line};
    use crate::report::units::grouped;

    // Where the run still goes on, it comes first; where the kernel refuses, no harm is done.
    let _ = realtime::rights::set_nice(LAST);
    let stop = stop_flag()?;
    let line = status_line();
    let sent = show(recording, target, &stop, |seconds| {
        line.set_message(format!("{seconds:.1} s of the run"));
    });
    line.finish_and_clear();
    let sent = sent?;
    let left_out = match sent.left_out {
        0 => String::new(),
        count => format!(" ({} more left out to bound its size)", grouped(count)),
    };
    let passed_over = match sent.passed_over {
        0 => String::new(),
        count => format!(
            "; {} more cannot be shown, since they or their inputs are not in the recording",
            grouped(count)
        ),
    };
    print(&format!(
        "{:.2} s in {target}: {} pictures{left_out}; each of {} ticks gave the controller's outputs again{passed_over}\n",
        sent.seconds,
        grouped(sent.frames),
        grouped(sent.ticks),
    ))
}

/// After everything else that runs.
#[cfg(feature = "view")]
const LAST: i32 = 19;

/// Refuses.
///
/// # Errors
/// Always.
#[cfg(not(feature = "view"))]
pub fn view(_: &Path, _: &str) -> Result<(), Failure> {
    crate::pictures::check_viewer()
}
