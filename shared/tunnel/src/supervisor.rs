//! The process of a tunnel as its owner sees it: started, watched, started again, ended.
//!
//! It is this program again, in the role [`SUBCOMMAND`](crate::SUBCOMMAND), so that nothing else
//! need be installed and both are of one build. It ends when its standard input does: with its
//! owner, however that ended.

use crate::address::AddressError;
use crate::arguments::TunnelArgs;
use crate::words::Word;
use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use thiserror::Error;

/// This program, also when its file was replaced meanwhile.
const OWN_PROGRAM: &str = "/proc/self/exe";
/// One thread reads and writes in zenoh. Two of them touch rustls's state of a connection at once
/// (zenoh issue 2557): every few minutes of load the link broke, "handshake not complete".
const ONE_THREAD: [&str; 2] = [
    "ZENOH_RUNTIME",
    "(rx: (handover: tx), tx: (worker_threads: 1))",
];
/// Time in which a tunnel is ready or says why not: it waits for the tunnel before to end (2.5 s),
/// opens a domain and a port, and waits half a second for those that it calls.
const READY_TIMEOUT: Duration = Duration::from_secs(20);
/// Time in which a tunnel ends when asked, and again in which it does when killed.
const END_TIMEOUT: Duration = Duration::from_secs(3);
/// Time between two looks whether it has.
const END_POLL: Duration = Duration::from_millis(5);
/// First and longest time between the end of a tunnel and the next one: each end doubles it.
const PAUSES: [Duration; 2] = [Duration::from_millis(100), Duration::from_secs(5)];
/// A tunnel that lasted so long is no reason to wait longer.
const LASTED: Duration = Duration::from_secs(30);
/// Stack of the thread that watches, bytes: it reads lines. Locked memory commits it whole.
const STACK_BYTES: usize = 256 << 10;

/// Why there is no tunnel: one sentence each.
#[derive(Debug, Error)]
pub enum TunnelError {
    /// The address.
    #[error("{0}")]
    Address(#[from] AddressError),
    /// It said why.
    #[error("{0}")]
    Refused(String),
    /// It ended without a word.
    #[error("the process of the tunnel ended before it was ready ({0})")]
    Ended(String),
    /// It did not become ready.
    #[error("the process of the tunnel did not become ready in {} s", READY_TIMEOUT.as_secs())]
    Silent,
    /// The operating system gave no thread or no process.
    #[error("cannot start the process of the tunnel: {0}")]
    Start(#[from] std::io::Error),
}

/// A running tunnel. Dropping it ends it.
#[derive(Debug)]
pub struct Tunnel {
    process: Arc<Process>,
    thread: Option<JoinHandle<()>>,
}

/// What the owner and the watching thread share.
#[derive(Debug, Default)]
struct Process {
    state: Mutex<State>,
    ending: Condvar,
}

#[derive(Debug, Default)]
struct State {
    is_ending: bool,
    child: Option<Child>,
    /// Open as long as the child shall live.
    input: Option<ChildStdin>,
}

impl Tunnel {
    /// Starts the process and returns when it is ready; `report` gets sentences for the user, from
    /// a thread.
    ///
    /// # Errors
    /// When its address is refused, it cannot be started, or it says why it cannot carry anything.
    pub fn start(
        args: &TunnelArgs,
        report: impl FnMut(&str) + Send + 'static,
    ) -> Result<Self, TunnelError> {
        args.end()?;
        let mut command = Command::new(OWN_PROGRAM);
        if let Some(name) = std::env::args_os().next() {
            command.arg0(name);
        }
        command
            .args(args.typed())
            .env(ONE_THREAD[0], ONE_THREAD[1])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            // Ctrl-C in a terminal is for its owner.
            .process_group(0);
        Self::start_command(command, report)
    }

    fn start_command(
        command: Command,
        report: impl FnMut(&str) + Send + 'static,
    ) -> Result<Self, TunnelError> {
        let process = Arc::<Process>::default();
        let (ready, wait) = sync_channel(1);
        let mut watch = Watch {
            command,
            process: Arc::clone(&process),
            ready: Some(ready),
            failure: None,
            report,
        };
        let thread = std::thread::Builder::new()
            .name("tunnel".to_owned())
            .stack_size(STACK_BYTES)
            .spawn(move || watch.run())?;
        let tunnel = Self {
            process,
            thread: Some(thread),
        };
        match wait.recv_timeout(READY_TIMEOUT) {
            Ok(result) => result.map(|()| tunnel),
            Err(RecvTimeoutError::Timeout) => Err(TunnelError::Silent),
            Err(RecvTimeoutError::Disconnected) => Err(TunnelError::Ended("unwatched".to_owned())),
        }
    }
}

impl Drop for Tunnel {
    fn drop(&mut self) {
        let mut state = self.process.lock();
        state.is_ending = true;
        state.input = None;
        drop(state);
        self.process.ending.notify_all();
        let Some(thread) = self.thread.take() else {
            return;
        };
        if !ends_in_time(&thread) {
            if let Some(child) = &mut self.process.lock().child {
                let _ = child.kill();
            }
            ends_in_time(&thread);
        }
        // One that hangs, in its owner's report for example, ends with the program.
        if thread.is_finished() {
            let _ = thread.join();
        }
    }
}

/// Waits for the end of a thread, at most for [`END_TIMEOUT`]; whether it has ended.
fn ends_in_time(thread: &JoinHandle<()>) -> bool {
    let asked = Instant::now();
    while !thread.is_finished() && asked.elapsed() < END_TIMEOUT {
        std::thread::sleep(END_POLL);
    }
    thread.is_finished()
}

impl Process {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether the owner asks for the end within this time.
    fn ends_within(&self, time: Duration) -> bool {
        let wait = |state: &mut State| !state.is_ending;
        let waited = self.ending.wait_timeout_while(self.lock(), time, wait);
        waited.unwrap_or_else(PoisonError::into_inner).0.is_ending
    }
}

/// The watching thread.
struct Watch<R> {
    command: Command,
    process: Arc<Process>,
    /// Until the first word.
    ready: Option<SyncSender<Result<(), TunnelError>>>,
    /// Why the tunnel could not go on, in its words.
    failure: Option<String>,
    report: R,
}

impl<R: FnMut(&str)> Watch<R> {
    fn run(&mut self) {
        let mut pause = PAUSES[0];
        loop {
            let started = Instant::now();
            let end = self.run_once();
            if self.process.lock().is_ending {
                return;
            }
            let failure = self.failure.take();
            if let Some(ready) = self.ready.take() {
                let error = match (failure, end) {
                    (Some(sentence), _) => TunnelError::Refused(sentence),
                    (None, Ok(status)) => TunnelError::Ended(status.to_string()),
                    (None, Err(error)) => TunnelError::Start(error),
                };
                // Who waited may have given up.
                let _ = ready.send(Err(error));
                return;
            }
            let why = failure.unwrap_or_else(|| match end {
                Ok(status) => status.to_string(),
                Err(error) => error.to_string(),
            });
            (self.report)(&format!(
                "the process of the tunnel ended and is started again ({why})"
            ));
            if started.elapsed() > LASTED {
                pause = PAUSES[0];
            }
            if self.process.ends_within(pause) {
                return;
            }
            pause = PAUSES[1].min(2 * pause);
        }
    }

    /// From the start of a process to its end.
    fn run_once(&mut self) -> std::io::Result<ExitStatus> {
        if let Some(output) = self.spawn()? {
            for line in BufReader::new(output).lines().map_while(Result::ok) {
                self.hear(&line);
            }
        }
        // It closes its output when it ends. Until it has, its owner can kill it.
        loop {
            let mut state = self.process.lock();
            let ended = match &mut state.child {
                Some(child) => child.try_wait()?,
                None => return Err(std::io::Error::other("it was not started")),
            };
            if let Some(status) = ended {
                state.child = None;
                return Ok(status);
            }
            drop(state);
            std::thread::sleep(END_POLL);
        }
    }

    /// Starts a process, unless it shall end already.
    fn spawn(&mut self) -> std::io::Result<Option<ChildStdout>> {
        let mut state = self.process.lock();
        if state.is_ending {
            return Ok(None);
        }
        let mut child = self.command.spawn()?;
        state.input = child.stdin.take();
        let output = child.stdout.take();
        state.child = Some(child);
        Ok(output)
    }

    fn hear(&mut self, line: &str) {
        match Word::read(line) {
            Some(Word::Ready) => {
                if let Some(ready) = self.ready.take() {
                    let _ = ready.send(Ok(()));
                }
            }
            Some(Word::Note(sentence)) => (self.report)(&sentence),
            Some(Word::Failed(sentence)) => self.failure = Some(sentence),
            None => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    /// A stand-in for the process.
    fn shell(script: &str) -> Command {
        let mut command = Command::new("sh");
        command
            .args(["-c", script])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        command
    }

    #[test]
    fn a_tunnel_that_ends_is_started_again_until_its_owner_ends_it() {
        let (sender, heard) = channel();
        let tunnel = Tunnel::start_command(shell("echo ready; exit 3"), move |sentence| {
            let _ = sender.send(sentence.to_owned());
        });
        let tunnel = tunnel.unwrap();
        for _ in 0..3 {
            let sentence = heard.recv().unwrap();
            assert!(sentence.contains("started again"), "{sentence}");
            assert!(sentence.contains("exit status: 3"), "{sentence}");
        }
        drop(tunnel);
        assert!(heard.iter().count() < 3, "it goes on");
    }

    #[test]
    fn a_tunnel_ends_with_its_owner() {
        let folder = tempfile::tempdir().unwrap();
        let ended = folder.path().join("ended");
        let script = format!("echo ready; cat; echo note end; touch {}", ended.display());
        let tunnel = Tunnel::start_command(shell(&script), |_| {}).unwrap();
        assert!(!ended.exists());
        drop(tunnel);
        assert!(ended.exists());
    }

    /// Starts a tunnel and drops it at its first sentence; whether that ends.
    fn drops(script: &str, mut report: impl FnMut() + Send + 'static) -> bool {
        let (begun, begins) = channel();
        let tunnel = Tunnel::start_command(shell(script), move |_| {
            let _ = begun.send(());
            report();
        });
        let tunnel = tunnel.unwrap();
        begins.recv().unwrap();
        let (dropped, ends) = channel();
        std::thread::spawn(move || {
            drop(tunnel);
            let _ = dropped.send(());
        });
        // A minute is a hang, not a measurement.
        ends.recv_timeout(Duration::from_secs(60)).is_ok()
    }

    /// As one that writes to a terminal that is paused.
    #[test]
    fn an_owner_whose_report_hangs_drops_its_tunnel_all_the_same() {
        let script = "echo ready; echo note x; cat";
        assert!(drops(script, || loop {
            std::thread::park();
        }));
    }

    #[test]
    fn a_tunnel_that_closed_its_output_and_goes_on_is_killed() {
        let script = "echo ready; echo note x; exec sleep 600 >&-";
        assert!(drops(script, || ()));
    }

    #[test]
    fn why_there_is_no_tunnel_is_what_it_said_last() {
        let failed = |script: &str| {
            let refused = Tunnel::start_command(shell(script), |_| {});
            refused.unwrap_err().to_string()
        };
        assert_eq!(failed("echo failed no key; exit 2"), "no key");
        assert!(failed("exit 7").contains("exit status: 7"));
        let missing = Tunnel::start_command(Command::new("/nonexistent"), |_| {});
        assert!(matches!(missing, Err(TunnelError::Start(_))));
    }
}
