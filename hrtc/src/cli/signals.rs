//! What signals ask of a run: an end with the ramp of the force, or at once.

use crate::run::StopFlags;
use crate::tuning::SIGNALS_STACK_BYTES;
use signal_hook::iterator::Signals;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use transport::signals::{INTERRUPTED, Presses, heard};

/// The first signal ends the run with its ramp, the second Ctrl-C at once.
static WITH_RAMP: AtomicBool = AtomicBool::new(false);
static AT_ONCE: AtomicBool = AtomicBool::new(false);

/// What a signal asks for.
#[derive(Debug, PartialEq, Eq)]
enum End {
    WithRamp,
    AtOnce,
    /// Whatever still runs.
    WithoutWaiting,
}

/// Only what a person presses asks for more when it comes again: the force needs its ramp.
fn asked(signal: i32, presses: &mut Presses, now: Instant) -> End {
    let is_press = presses.hear(signal, now);
    match presses.count() {
        2 if is_press => End::AtOnce,
        3.. if is_press => End::WithoutWaiting,
        _ => End::WithRamp,
    }
}

/// Hears the signals of [`heard`] on a thread of its own from now on; where it tells them.
///
/// # Errors
/// When the handlers cannot be installed, or there is no thread.
pub(super) fn listen() -> std::io::Result<StopFlags<'static>> {
    let mut signals = Signals::new(heard())?;
    let hear = move || {
        let mut presses = Presses::default();
        for signal in signals.forever() {
            match asked(signal, &mut presses, Instant::now()) {
                End::WithRamp => WITH_RAMP.store(true, Ordering::Relaxed),
                End::AtOnce => AT_ONCE.store(true, Ordering::Relaxed),
                End::WithoutWaiting => std::process::exit(INTERRUPTED.into()),
            }
        }
    };
    let thread = std::thread::Builder::new().name("hrtc-signals".to_owned());
    thread.stack_size(SIGNALS_STACK_BYTES).spawn(hear)?;
    Ok(StopFlags {
        with_ramp: &WITH_RAMP,
        at_once: &AT_ONCE,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    use std::time::Duration;

    #[test]
    fn only_a_second_press_of_ctrl_c_cuts_the_ramp() {
        let (mut presses, mut now) = (Presses::default(), Instant::now());
        let mut hear = |signal| {
            now += Duration::from_secs(1);
            asked(signal, &mut presses, now)
        };
        for signal in [SIGTERM, SIGTERM, SIGHUP, SIGTERM, SIGINT, SIGTERM, SIGHUP] {
            assert_eq!(hear(signal), End::WithRamp, "signal {signal}");
        }
        assert_eq!(hear(SIGINT), End::AtOnce);
        assert_eq!(hear(SIGTERM), End::WithRamp, "it has ended at once already");
        assert_eq!(hear(SIGINT), End::WithoutWaiting);
    }

    #[test]
    fn one_press_that_arrives_twice_keeps_the_ramp() {
        // `timeout` may be as fast as the clock's step.
        let (mut presses, start) = (Presses::default(), Instant::now());
        for late_ms in [0, 0, 1, 20, 300] {
            let end = asked(SIGINT, &mut presses, start + Duration::from_millis(late_ms));
            assert_eq!(end, End::WithRamp, "{late_ms}");
        }
        let later = start + Duration::from_millis(301);
        assert_eq!(asked(SIGINT, &mut presses, later), End::AtOnce);
    }
}
