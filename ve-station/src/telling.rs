//! Who is connected, told to people on a thread of its own: whoever draws on a terminal that is
//! paused, or writes into a pipe that nobody reads, hangs until that ends, and heartbeats and
//! chunks must go on meanwhile.

use crate::clients::ClientStatus;
use crate::tuning::link::{POLL, TOLD_ENDS};
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::Instant;

/// What is to be warned of when the thread has panicked.
const PANICKED: &str = "who is connected is told no more, by a defect in ve-station: please report what it printed above";

/// The end of the thread that serves: it never waits. The default tells nobody.
#[derive(Debug, Default)]
pub struct Teller {
    told: Option<SyncSender<Vec<ClientStatus>>>,
    thread: Option<JoinHandle<()>>,
}

impl Teller {
    /// Starts the thread, on which `show` gets the statuses.
    pub fn start(mut show: impl FnMut(&[ClientStatus]) + Send + 'static) -> Self {
        // One status waits at the most.
        let (sender, told) = sync_channel::<Vec<ClientStatus>>(1);
        let tell = move || {
            for clients in told {
                show(&clients);
            }
        };
        let thread = thread::Builder::new().name("telling".to_owned());
        match thread.spawn(tell) {
            Ok(thread) => Self {
                told: Some(sender),
                thread: Some(thread),
            },
            Err(error) => {
                tracing::warn!("who is connected is not told, no thread starts: {error}");
                Self::default()
            }
        }
    }

    /// Tells who is connected. A status that finds another waiting is left out: the next one is
    /// newer. Returns what is to be warned of, once.
    #[must_use]
    pub fn status(&mut self, clients: Vec<ClientStatus>) -> Option<&'static str> {
        let sent = self.told.as_ref()?.try_send(clients);
        let has_panicked = matches!(sent, Err(TrySendError::Disconnected(_)));
        if has_panicked {
            self.told = None;
        }
        has_panicked.then_some(PANICKED)
    }

    /// Waits until all is told, at most for [`TOLD_ENDS`]: who hangs then is left to end with the
    /// process, without being dropped. Returns what is to be warned of, unless that was said.
    #[must_use]
    pub fn end(&mut self) -> Option<&'static str> {
        let is_unsaid = self.told.take().is_some();
        let thread = self.thread.take()?;
        let asked = Instant::now();
        while !thread.is_finished() && asked.elapsed() < TOLD_ENDS {
            thread::sleep(POLL);
        }
        let has_panicked = thread.is_finished() && thread.join().is_err();
        (is_unsaid && has_panicked).then_some(PANICKED)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    #[test]
    fn a_status_that_waits_is_the_only_one() {
        let (release, held) = channel::<()>();
        let (seen, statuses) = channel();
        let show = move |_: &[ClientStatus]| {
            // As long as nobody reads.
            let _ = held.recv();
            let _ = seen.send(());
        };
        let mut teller = Teller::start(show);
        for _ in 0..100 {
            assert_eq!(teller.status(Vec::new()), None);
        }
        drop(release);
        assert_eq!(teller.end(), None);
        let shown = statuses.iter().count();
        assert!((1..=2).contains(&shown), "{shown}");
    }

    /// A thread that has panicked at the first status that it got.
    fn panicked() -> Teller {
        let mut teller = Teller::start(|_| panic!("made on purpose while telling"));
        assert_eq!(teller.status(Vec::new()), None);
        // It prints its stack where RUST_BACKTRACE is set, which takes longer than an end waits.
        while !teller.thread.as_ref().is_some_and(JoinHandle::is_finished) {
            thread::sleep(POLL);
        }
        teller
    }

    #[test]
    fn a_thread_that_panics_is_said_once() {
        let mut teller = panicked();
        assert_eq!(teller.status(Vec::new()), Some(PANICKED));
        assert_eq!(teller.status(Vec::new()), None);
        assert_eq!(teller.end(), None);
    }

    #[test]
    fn a_thread_that_panics_at_its_last_status_is_said_at_the_end() {
        let mut teller = panicked();
        assert_eq!(teller.end(), Some(PANICKED));
        assert_eq!(teller.end(), None);
    }

    #[test]
    fn a_service_that_tells_nobody_goes_on() {
        let mut teller = Teller::default();
        assert_eq!(teller.status(Vec::new()), None);
        assert_eq!(teller.end(), None);
    }
}
