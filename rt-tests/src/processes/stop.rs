//! The flag that Ctrl-C, SIGTERM and a closed terminal set.

use crate::failure::Failure;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that the first signal sets, for a clean end; only a second Ctrl-C ends at once.
///
/// # Errors
/// When the handlers cannot be installed.
pub fn stop_flag() -> Result<Arc<AtomicBool>, Failure> {
    transport::signals::stop_flag()
        .map_err(|error| Failure::Run(format!("the handler of Ctrl-C was refused ({error})")))
}

/// Whether a flag is set.
#[must_use]
pub fn is_set(flag: &AtomicBool) -> bool {
    flag.load(Ordering::Relaxed)
}
