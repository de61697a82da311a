//! The status lines of a supervised run, written by a thread of their own: who writes into a pipe
//! that nobody reads hangs until that ends, and the log must be drained meanwhile.

use super::outcome::RunError;
use crate::result::{Status, SupervisedLine};
use std::io::Write;
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};

/// Stack of the thread, bytes: it only writes.
const STACK_BYTES: usize = 128 << 10;

/// The end of the thread that drains: it never waits. The default tells nobody.
#[derive(Debug, Default)]
pub(super) struct StatusLines {
    lines: Option<SyncSender<String>>,
    thread: Option<JoinHandle<std::io::Result<()>>>,
}

impl StatusLines {
    /// Starts the thread.
    ///
    /// # Errors
    /// When the operating system gives none.
    pub fn start(mut out: impl Write + Send + 'static) -> Result<Self, RunError> {
        // One line waits at the most.
        let (lines, waiting) = sync_channel::<String>(1);
        let write = move || -> std::io::Result<()> {
            for line in waiting {
                writeln!(out, "{line}")?;
                out.flush()?;
            }
            Ok(())
        };
        let thread = thread::Builder::new()
            .name("hrtc-status".to_owned())
            .stack_size(STACK_BYTES)
            .spawn(write)
            .map_err(|error| RunError::Thread("hrtc-status", error))?;
        Ok(Self {
            lines: Some(lines),
            thread: Some(thread),
        })
    }

    /// Hands a status over. One that finds another waiting is left out: the next one is newer.
    ///
    /// # Errors
    /// When an earlier one could not be written; said once.
    pub fn tell(&mut self, status: Status) -> Result<(), RunError> {
        let Some(lines) = &self.lines else {
            return Ok(());
        };
        let line = serde_json::to_string(&SupervisedLine::Status { status });
        let line = line.map_err(|error| RunError::Print(error.into()))?;
        match lines.try_send(line) {
            Err(TrySendError::Disconnected(_)) => self.finish(),
            Ok(()) | Err(TrySendError::Full(_)) => Ok(()),
        }
    }

    /// Waits until all are written: for the end of a run, when nothing else is left to do.
    ///
    /// # Errors
    /// When they could not be written; said once.
    pub fn finish(&mut self) -> Result<(), RunError> {
        self.lines = None;
        let Some(thread) = self.thread.take() else {
            return Ok(());
        };
        let panicked = |_| Err(std::io::Error::other("the thread that writes panicked"));
        thread
            .join()
            .unwrap_or_else(panicked)
            .map_err(RunError::Print)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::ErrorKind;
    use std::sync::mpsc::{Receiver, Sender, channel};

    /// An output that nobody reads until it is released.
    struct Unread {
        held: Receiver<()>,
        lines: Sender<String>,
    }

    impl Write for Unread {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            let _ = self.held.recv();
            let _ = self.lines.send(String::from_utf8_lossy(bytes).into_owned());
            Ok(bytes.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn whoever_tells_a_status_never_waits_for_its_reader() {
        let (release, held) = channel();
        let (lines, written) = channel();
        let mut told = StatusLines::start(Unread { held, lines }).expect("a thread");
        for _ in 0..100 {
            told.tell(Status::default()).expect("it is not refused");
        }
        drop(release);
        told.finish().expect("it is written");
        drop(told);
        let text: String = written.iter().collect();
        // The one that was being written, and the one that waited.
        let count = text.lines().count();
        assert!((1..=2).contains(&count), "{text}");
        assert!(text.lines().all(|line| line.starts_with("{\"status\":{")));
    }

    /// A pipe whose reader is gone.
    struct Closed;

    impl Write for Closed {
        fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
            Err(ErrorKind::BrokenPipe.into())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn an_output_that_cannot_be_written_is_said_once() {
        let mut told = StatusLines::start(Closed).expect("a thread");
        let mut refused = None;
        while refused.is_none() {
            refused = told.tell(Status::default()).err();
        }
        assert!(matches!(refused, Some(RunError::Print(_))), "{refused:?}");
        assert!(told.tell(Status::default()).is_ok());
        assert!(told.finish().is_ok());
    }
}
