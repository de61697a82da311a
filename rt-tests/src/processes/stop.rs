//! The flag that Ctrl-C, SIGTERM and a closed terminal set.

use crate::failure::Failure;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit status after a second signal: 128 and the number of SIGINT.
const INTERRUPTED: i32 = 130;

/// A flag that the first signal sets, for a clean end; a second signal ends at once.
///
/// # Errors
/// When the handlers cannot be installed.
pub fn stop_flag() -> Result<Arc<AtomicBool>, Failure> {
    let flag = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        let install = || -> std::io::Result<()> {
            signal_hook::flag::register_conditional_shutdown(
                signal,
                INTERRUPTED,
                Arc::clone(&flag),
            )?;
            signal_hook::flag::register(signal, Arc::clone(&flag))?;
            Ok(())
        };
        install().map_err(|error| {
            Failure::Run(format!("the handler of Ctrl-C was refused ({error})"))
        })?;
    }
    Ok(flag)
}

/// Whether a flag is set.
#[must_use]
pub fn is_set(flag: &AtomicBool) -> bool {
    flag.load(Ordering::Relaxed)
}
