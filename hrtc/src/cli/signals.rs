//! Signals that end a run: SIGINT (Ctrl-C), SIGTERM and SIGHUP (a closed terminal).

use crate::run::StopFlags;
use crate::tuning::SIGNALS_STACK_BYTES;
use realtime::rights::monotonic_ns;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::sync::atomic::{AtomicBool, Ordering};

/// Status of a process that Ctrl-C has ended: 128 and the number of SIGINT.
pub const INTERRUPTED: u8 = 130;

/// Time within which a SIGINT is the same press as the one before, ns: `timeout -s INT` sends it to
/// the process and to its group.
const SAME_PRESS_NS: u64 = 300_000_000;

/// The first signal ends the run with its ramp, the second Ctrl-C at once.
static WITH_RAMP: AtomicBool = AtomicBool::new(false);
static AT_ONCE: AtomicBool = AtomicBool::new(false);

/// Counts how often a person has pressed Ctrl-C.
#[derive(Debug, Clone, Copy, Default)]
pub struct Presses {
    count: u32,
    /// When the last one was that counted, on CLOCK_MONOTONIC.
    last_ns: u64,
}

impl Presses {
    /// Hears a SIGINT at a time on CLOCK_MONOTONIC, ns; `true` where it is a press of its own. One
    /// soon after another that counted is not, but one soon after that is: who hammers on the keys
    /// means it.
    pub fn hear(&mut self, now_ns: u64) -> bool {
        let is_own = self.count == 0 || now_ns.saturating_sub(self.last_ns) > SAME_PRESS_NS;
        if is_own {
            self.count += 1;
            self.last_ns = now_ns;
        }
        is_own
    }

    /// Presses so far.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.count
    }
}

/// The signals that ask this process for its end. Where SIGHUP was ignored at its start, it stays
/// so: `nohup` means the process to outlive the terminal. The others are heard all the same: shells
/// have what scripts start in the background ignore SIGINT, but whoever sends it wants the force to
/// end.
#[must_use]
pub fn heard() -> Vec<i32> {
    let status = std::fs::read_to_string("/proc/self/status");
    heard_with(&status.unwrap_or_default())
}

/// The same by what the kernel says of the process.
fn heard_with(status: &str) -> Vec<i32> {
    let mut heard = vec![SIGINT, SIGTERM];
    if !is_ignored(status, SIGHUP) {
        heard.push(SIGHUP);
    }
    heard
}

fn is_ignored(status: &str, signal: i32) -> bool {
    let mask = status
        .lines()
        .find_map(|line| line.strip_prefix("SigIgn:"))
        .and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

/// What a signal asks for.
#[derive(Debug, PartialEq, Eq)]
enum End {
    WithRamp,
    AtOnce,
    /// Whatever still runs.
    WithoutWaiting,
}

/// Only what a person presses asks for more when it comes again: a supervisor sends SIGTERM as
/// often as it likes, and the force needs its ramp.
fn asked(signal: i32, presses: &mut Presses, now_ns: u64) -> End {
    let is_press = signal == SIGINT && presses.hear(now_ns);
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
            match asked(signal, &mut presses, monotonic_ns()) {
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

    const S: u64 = 1_000_000_000;

    #[test]
    fn only_a_second_press_of_ctrl_c_cuts_the_ramp() {
        let (mut presses, mut now_ns) = (Presses::default(), 100 * S);
        let mut hear = |signal| {
            now_ns += S;
            asked(signal, &mut presses, now_ns)
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
        // `timeout` may be as fast as the clock's step; a machine has just started.
        for start_ns in [0, 1, 5 * S] {
            let mut presses = Presses::default();
            for late_ns in [0, 0, 1_000, 20_000_000, SAME_PRESS_NS] {
                let end = asked(SIGINT, &mut presses, start_ns + late_ns);
                assert_eq!(end, End::WithRamp, "{start_ns} {late_ns}");
            }
            let later_ns = start_ns + SAME_PRESS_NS + 1;
            assert_eq!(asked(SIGINT, &mut presses, later_ns), End::AtOnce);
        }
    }

    #[test]
    fn hammering_on_the_keys_is_more_than_one_press() {
        let mut presses = Presses::default();
        for press in 0..10 {
            presses.hear(5 * S + press * S / 5);
        }
        assert!(presses.count() >= 3, "{presses:?}");
    }

    #[test]
    fn nohup_stays_in_force_and_nothing_else_is_left_unheard() {
        let ignoring =
            |mask: &str| heard_with(&format!("Name:\thrtc\nSigIgn:\t{mask}\nNext:\t1\n"));
        assert_eq!(ignoring("0000000000000001"), [SIGINT, SIGTERM]);
        assert_eq!(ignoring("0000000000001000"), [SIGINT, SIGTERM, SIGHUP]);
        // As in the background of a script.
        assert_eq!(ignoring("0000000000000006"), [SIGINT, SIGTERM, SIGHUP]);
        assert_eq!(heard_with(""), [SIGINT, SIGTERM, SIGHUP]);
    }
}
