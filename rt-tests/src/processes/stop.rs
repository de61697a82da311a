//! The flag that Ctrl-C, SIGTERM and a closed terminal set.

use crate::failure::Failure;
use hrtc::cli::signals::{INTERRUPTED, Presses, heard};
use hrtc::tuning::SIGNALS_STACK_BYTES;
use realtime::rights::monotonic_ns;
use signal_hook::consts::SIGINT;
use signal_hook::iterator::Signals;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that the first signal sets, for a clean end; only a second Ctrl-C ends at once, and one
/// press may arrive twice. Other signals never do, nor a first Ctrl-C after them: `timeout` and
/// supervisors send theirs more than once, and a person who wants more has SIGKILL. Under `nohup`
/// a closed terminal is no signal.
///
/// # Errors
/// When the handlers cannot be installed.
pub fn stop_flag() -> Result<Arc<AtomicBool>, Failure> {
    let flag = Arc::new(AtomicBool::new(false));
    let told = Arc::clone(&flag);
    let listen = || -> std::io::Result<()> {
        let mut signals = Signals::new(heard())?;
        let hear = move || {
            let mut presses = Presses::default();
            for signal in signals.forever() {
                told.store(true, Ordering::Relaxed);
                if ends_at_once(signal, &mut presses, monotonic_ns()) {
                    signal_hook::low_level::exit(INTERRUPTED.into());
                }
            }
        };
        let thread = std::thread::Builder::new().name("signals".to_owned());
        thread.stack_size(SIGNALS_STACK_BYTES).spawn(hear)?;
        Ok(())
    };
    listen()
        .map_err(|error| Failure::Run(format!("the handler of Ctrl-C was refused ({error})")))?;
    Ok(flag)
}

/// Whether a signal at a time on CLOCK_MONOTONIC, ns, is a second press of Ctrl-C.
fn ends_at_once(signal: i32, presses: &mut Presses, now_ns: u64) -> bool {
    signal == SIGINT && presses.hear(now_ns) && presses.count() > 1
}

/// Whether a flag is set.
#[must_use]
pub fn is_set(flag: &AtomicBool) -> bool {
    flag.load(Ordering::Relaxed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use signal_hook::consts::{SIGHUP, SIGTERM};

    #[test]
    fn only_a_second_press_ends_at_once_and_one_may_arrive_twice() {
        const S: u64 = 1_000_000_000;
        let mut presses = Presses::default();
        for (signal, now_ns, expected) in [
            (SIGTERM, S, false),
            (SIGTERM, 2 * S, false),
            (SIGINT, 3 * S, false),
            (SIGINT, 3 * S + 1_000_000, false),
            (SIGHUP, 4 * S, false),
            (SIGINT, 5 * S, true),
        ] {
            let ends = ends_at_once(signal, &mut presses, now_ns);
            assert_eq!(ends, expected, "{signal} at {now_ns}");
        }
    }
}
