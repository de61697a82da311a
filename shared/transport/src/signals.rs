//! Signals that end a program: SIGINT (Ctrl-C), SIGTERM and SIGHUP (a closed terminal).
//!
//! The first one asks for a clean end, whichever it is. Only a second Ctrl-C asks for more: a
//! supervisor sends SIGTERM as often as it likes, and a person who wants still more has SIGKILL.

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Status of a process that Ctrl-C has ended: 128 and the number of SIGINT.
pub const INTERRUPTED: u8 = 130;

/// Time within which a SIGINT is the same press as the one before: `timeout -s INT` sends it to the
/// process and to its group.
const SAME_PRESS: Duration = Duration::from_millis(300);
/// Stack of the thread of [`stop_flag`], bytes: it sets a flag only.
const STACK_BYTES: usize = 128 << 10;

/// Counts how often a person has pressed Ctrl-C.
#[derive(Debug, Clone, Copy, Default)]
pub struct Presses {
    count: u32,
    /// When the last one was that counted.
    last: Option<Instant>,
}

impl Presses {
    /// Hears a signal; `true` where it is a press of its own. A SIGINT soon after another that
    /// counted is not, but one soon after that is: who hammers on the keys means it.
    pub fn hear(&mut self, signal: i32, now: Instant) -> bool {
        let is_same = |last: Instant| now.saturating_duration_since(last) <= SAME_PRESS;
        let is_own = signal == SIGINT && !self.last.is_some_and(is_same);
        if is_own {
            self.count += 1;
            self.last = Some(now);
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
/// have what scripts start in the background ignore SIGINT, but whoever sends it wants an end.
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

/// A flag that the first of the signals of [`heard`] sets, for a clean end. A second Ctrl-C ends
/// the process at once, with the status [`INTERRUPTED`].
///
/// # Errors
/// When the handlers cannot be installed, or there is no thread.
pub fn stop_flag() -> io::Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    let told = Arc::clone(&flag);
    let mut signals = Signals::new(heard())?;
    let hear = move || {
        let mut presses = Presses::default();
        for signal in signals.forever() {
            told.store(true, Ordering::Relaxed);
            if presses.hear(signal, Instant::now()) && presses.count() > 1 {
                signal_hook::low_level::exit(INTERRUPTED.into());
            }
        }
    };
    let thread = thread::Builder::new().name("signals".to_owned());
    thread.stack_size(STACK_BYTES).spawn(hear)?;
    Ok(flag)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_signals_are_no_presses_and_one_press_may_arrive_twice() {
        let (mut presses, start) = (Presses::default(), Instant::now());
        for (signal, late_ms, expected) in [
            (SIGTERM, 0, 0),
            (SIGTERM, 1_000, 0),
            (SIGHUP, 2_000, 0),
            (SIGINT, 3_000, 1),
            (SIGINT, 3_000, 1),
            (SIGINT, 3_001, 1),
            (SIGINT, 3_300, 1),
            (SIGTERM, 4_000, 1),
            (SIGINT, 5_000, 2),
        ] {
            let before = presses.count();
            let is_own = presses.hear(signal, start + Duration::from_millis(late_ms));
            assert_eq!(presses.count(), expected, "{signal} at {late_ms} ms");
            assert_eq!(is_own, expected > before, "{signal} at {late_ms} ms");
        }
    }

    #[test]
    fn hammering_on_the_keys_is_more_than_one_press() {
        let (mut presses, start) = (Presses::default(), Instant::now());
        for press in 0..10u32 {
            presses.hear(SIGINT, start + press * Duration::from_millis(200));
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
