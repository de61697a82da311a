//! The flag that Ctrl-C, SIGTERM and a closed terminal set.

use crate::failure::Failure;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit status after a second Ctrl-C: 128 and the number of SIGINT.
const INTERRUPTED: i32 = 130;

/// A flag that the first signal sets, for a clean end; only a second Ctrl-C ends at once. Other
/// signals never do, nor a first Ctrl-C after them: `timeout` and supervisors send theirs more than
/// once, and a person who wants more has SIGKILL.
///
/// # Errors
/// When the handlers cannot be installed.
pub fn stop_flag() -> Result<Arc<AtomicBool>, Failure> {
    let flag = Arc::new(AtomicBool::new(false));
    let pressed = Arc::new(AtomicBool::new(false));
    let install = || -> std::io::Result<()> {
        // First: what a press finds is whether there was one before.
        let before = Arc::clone(&pressed);
        signal_hook::flag::register_conditional_shutdown(SIGINT, INTERRUPTED, before)?;
        signal_hook::flag::register(SIGINT, pressed)?;
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            signal_hook::flag::register(signal, Arc::clone(&flag))?;
        }
        Ok(())
    };
    install()
        .map_err(|error| Failure::Run(format!("the handler of Ctrl-C was refused ({error})")))?;
    Ok(flag)
}

/// Whether a flag is set.
#[must_use]
pub fn is_set(flag: &AtomicBool) -> bool {
    flag.load(Ordering::Relaxed)
}
