//! What the service tells people, on a thread of its own: whoever writes to a terminal that is
//! paused, or into a pipe that nobody reads, hangs until that ends, and heartbeats and chunks must
//! go on meanwhile.

use crate::clients::ClientStatus;
use crate::tuning::link::{MAX_UNTOLD, POLL, TOLD_ENDS};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::Instant;

/// Something to tell.
#[derive(Debug)]
enum Told {
    Status(Vec<ClientStatus>),
    Warning(String),
}

/// The end of the thread that serves: it never waits. The default tells nobody.
#[derive(Debug, Default)]
pub struct Teller {
    told: Option<SyncSender<Told>>,
    thread: Option<JoinHandle<()>>,
    /// Whether a status waits: only one does, since the next one is newer.
    status_waits: Arc<AtomicBool>,
    /// Warnings that found no room, until that is told.
    left_out: u64,
}

impl Teller {
    /// Starts the thread, on which `show` gets the statuses and `warn` the warnings.
    pub fn start(
        show: impl FnMut(&[ClientStatus]) + Send + 'static,
        warn: impl FnMut(&str) + Send + 'static,
    ) -> Self {
        let (sender, told) = sync_channel(MAX_UNTOLD);
        let status_waits = Arc::new(AtomicBool::new(false));
        let waits = Arc::clone(&status_waits);
        let thread = thread::Builder::new().name("telling".to_owned());
        match thread.spawn(move || tell(&told, &waits, show, warn)) {
            Ok(thread) => Self {
                told: Some(sender),
                thread: Some(thread),
                status_waits,
                left_out: 0,
            },
            Err(error) => {
                tracing::warn!("nothing is told of this service, no thread starts: {error}");
                Self::default()
            }
        }
    }

    /// Tells who is connected, unless the status before waits still.
    pub fn status(&mut self, clients: Vec<ClientStatus>) {
        self.warn_of_left_out();
        if !self.status_waits.swap(true, Ordering::Relaxed) && !self.send(Told::Status(clients)) {
            self.status_waits.store(false, Ordering::Relaxed);
        }
    }

    /// Tells a sentence; where too many wait, only later that some are left out.
    pub fn warn(&mut self, sentence: String) {
        self.warn_of_left_out();
        if !self.send(Told::Warning(sentence)) {
            self.left_out += 1;
        }
    }

    /// Waits until all is told, at most for [`TOLD_ENDS`]: who hangs then is left to end with the
    /// process, without being dropped.
    pub fn end(&mut self) {
        self.warn_of_left_out();
        self.told = None;
        let Some(thread) = self.thread.take() else {
            return;
        };
        let asked = Instant::now();
        while !thread.is_finished() && asked.elapsed() < TOLD_ENDS {
            thread::sleep(POLL);
        }
    }

    fn warn_of_left_out(&mut self) {
        if self.left_out > 0 {
            let count = self.left_out;
            let sentence = format!("warnings that nobody read in time, left out here: {count}");
            if self.send(Told::Warning(sentence)) {
                self.left_out = 0;
            }
        }
    }

    /// Whether there was room.
    fn send(&self, told: Told) -> bool {
        let sender = self.told.as_ref();
        sender.is_some_and(|sender| sender.try_send(told).is_ok())
    }
}

/// The thread.
fn tell(
    told: &Receiver<Told>,
    status_waits: &AtomicBool,
    mut show: impl FnMut(&[ClientStatus]),
    mut warn: impl FnMut(&str),
) {
    for told in told {
        match told {
            Told::Status(clients) => {
                status_waits.store(false, Ordering::Relaxed);
                show(&clients);
            }
            Told::Warning(sentence) => warn(&sentence),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    #[test]
    fn what_nobody_reads_in_time_is_left_out_and_that_is_told_later() {
        let (release, held) = channel::<()>();
        let (begun, begins) = channel();
        let (heard, all) = channel();
        let warn = move |sentence: &str| {
            let _ = begun.send(());
            // As long as nobody reads.
            let _ = held.recv();
            let _ = heard.send(sentence.to_owned());
        };
        let mut teller = Teller::start(|_| (), warn);
        teller.warn("0".to_owned());
        begins.recv().unwrap();
        // One is being told, and so many wait.
        let (fit, left_out) = (1 + MAX_UNTOLD, 2 * MAX_UNTOLD);
        for k in 1..fit + left_out {
            teller.warn(k.to_string());
        }
        drop(release);
        let told: Vec<String> = all.iter().take(fit).collect();
        assert!(told.into_iter().eq((0..fit).map(|k| k.to_string())));
        teller.warn("later".to_owned());
        teller.end();
        let told: Vec<String> = all.iter().collect();
        assert_eq!(told.len(), 2, "{told:?}");
        assert!(
            told[0].ends_with(&format!("left out here: {left_out}")),
            "{told:?}"
        );
        assert_eq!(told[1], "later");
    }

    #[test]
    fn a_status_that_waits_is_the_only_one_and_leaves_room_for_warnings() {
        let (release, held) = channel::<()>();
        let (heard, warnings) = channel();
        let (seen, statuses) = channel();
        let show = move |_: &[ClientStatus]| {
            let _ = held.recv();
            let _ = seen.send(());
        };
        let mut teller = Teller::start(show, move |of: &str| {
            let _ = heard.send(of.to_owned());
        });
        for _ in 0..3 * MAX_UNTOLD {
            teller.status(Vec::new());
        }
        teller.warn("told".to_owned());
        drop(release);
        teller.end();
        assert_eq!(warnings.iter().collect::<Vec<_>>(), ["told"]);
        let shown = statuses.iter().count();
        assert!((1..=2).contains(&shown), "{shown}");
    }

    #[test]
    fn a_service_that_tells_nobody_goes_on() {
        let mut teller = Teller::default();
        teller.warn("unheard".to_owned());
        teller.status(Vec::new());
        teller.end();
        assert_eq!(teller.left_out, 1);
    }
}
