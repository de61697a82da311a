//! A process and what it said so far.

use super::process::{Event, Process};
use super::stop::is_set;
use super::surroundings::Surroundings;
use hrtc::result::{Finished, Status, SupervisedLine};
use realtime::rights::monotonic_ns;
use std::ffi::OsString;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

/// Time that a start, an end or a first touch may take: many times what it does take, on any
/// machine; beyond it the process counts as blocked.
pub const PATIENCE: Duration = Duration::from_secs(30);
/// Time between two looks at a process.
const LOOK: Duration = Duration::from_millis(2);

/// A process and what it said.
pub struct Watched {
    name: &'static str,
    /// The process.
    pub process: Process,
    events: Receiver<Event>,
    /// Lines on standard error.
    pub said: Vec<String>,
    /// The controller's newest status.
    pub status: Option<Status>,
    /// The controller's result.
    pub finished: Option<Box<Finished>>,
    /// When the station said that it is ready, on CLOCK_MONOTONIC, ns.
    pub ready_ns: Option<u64>,
}

impl Watched {
    /// Starts a role.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn start(
        name: &'static str,
        arguments: &[OsString],
        around: Surroundings,
    ) -> Result<Self, String> {
        let (sender, events) = channel();
        let process = Process::start_in(name, arguments, around, &sender);
        Ok(Self::of(
            name,
            process.map_err(|error| error.to_string())?,
            events,
        ))
    }

    /// Starts another program.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn start_program(
        name: &'static str,
        program: &Path,
        arguments: &[OsString],
        around: Surroundings,
    ) -> Result<Self, String> {
        let (sender, events) = channel();
        let process = Process::start_program(name, program, arguments, around, &sender);
        Ok(Self::of(
            name,
            process.map_err(|error| error.to_string())?,
            events,
        ))
    }

    fn of(name: &'static str, process: Process, events: Receiver<Event>) -> Self {
        Self {
            name,
            process,
            events,
            said: Vec::new(),
            status: None,
            finished: None,
            ready_ns: None,
        }
    }

    /// Takes what it said.
    pub fn listen(&mut self) {
        while let Ok(event) = self.events.try_recv() {
            match event {
                Event::Line(_, line) => match serde_json::from_str(&line) {
                    Ok(SupervisedLine::Status { status }) => self.status = Some(status),
                    Ok(SupervisedLine::Finished(finished)) => self.finished = Some(finished),
                    Err(_) => {}
                },
                Event::Said(_, line) => {
                    if line == "ready" {
                        self.ready_ns.get_or_insert_with(monotonic_ns);
                    }
                    self.said.push(line);
                }
            }
        }
    }

    /// Waits until something is so.
    ///
    /// # Errors
    /// One sentence when the process ends before, or it takes too long.
    pub fn wait_for(
        &mut self,
        what: &str,
        stop: &AtomicBool,
        mut so: impl FnMut(&Self) -> bool,
    ) -> Result<(), String> {
        let start = Instant::now();
        loop {
            self.listen();
            if so(self) {
                return Ok(());
            }
            if self.process.ended().is_some() {
                // All that it said is taken before its end is judged.
                let status = self.process.wait(Duration::ZERO);
                self.listen();
                if so(self) {
                    return Ok(());
                }
                return Err(self.process.failure(status).to_string());
            }
            if is_set(stop) {
                return Err("ended early on request".to_string());
            }
            if start.elapsed() > PATIENCE {
                let (name, s) = (self.name, PATIENCE.as_secs());
                return Err(format!("{what} of the {name} did not come in {s} s"));
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Waits for its own end and takes its last words; it is asked to end once `stop` is set.
    ///
    /// # Errors
    /// One sentence when it does not end in time (it is ended by force then), or not well.
    pub fn wait_for_end(&mut self, longest: Duration, stop: &AtomicBool) -> Result<(), String> {
        let deadline = Instant::now() + longest;
        while self.process.ended().is_none() && !is_set(stop) && Instant::now() < deadline {
            std::thread::sleep(LOOK);
        }
        if is_set(stop) {
            return self.end();
        }
        self.ended_within(deadline.saturating_duration_since(Instant::now()))
    }

    fn ended_within(&mut self, longest: Duration) -> Result<(), String> {
        let status = self.process.wait(longest);
        self.listen();
        match status {
            Some(status) if status.success() => Ok(()),
            status => Err(self.process.failure(status).to_string()),
        }
    }

    /// Asks it to end, and waits.
    ///
    /// # Errors
    /// See [`Watched::wait_for_end`].
    pub fn end(&mut self) -> Result<(), String> {
        self.process.terminate();
        self.ended_within(PATIENCE)
    }

    /// Ends it by SIGKILL.
    pub fn kill(&mut self) {
        self.process.signal(libc::SIGKILL);
        let _ = self.process.wait(PATIENCE);
        self.listen();
    }

    /// Whether a line on standard error holds these words.
    #[must_use]
    pub fn has_said(&self, words: &str) -> bool {
        self.said.iter().any(|line| line.contains(words))
    }

    /// Whether the controller touches.
    #[must_use]
    pub fn is_touching(&self) -> bool {
        self.status.is_some_and(|status| status.contact)
    }
}

/// Sleeps, unless an early end is asked for.
pub fn pause(seconds: f64, stop: &AtomicBool) {
    let end = Instant::now() + Duration::from_secs_f64(seconds.max(0.0));
    while Instant::now() < end && !is_set(stop) {
        std::thread::sleep(LOOK);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::Ordering;

    fn started(program: &str, arguments: &[&str]) -> Watched {
        let arguments: Vec<OsString> = arguments.iter().map(OsString::from).collect();
        let around = Surroundings::default();
        Watched::start_program("program", Path::new(program), &arguments, around)
            .expect("the program is there")
    }

    #[test]
    fn what_a_process_said_last_is_why_it_ended() {
        // The end of the shell comes before the last words of what it started.
        let script = "(sleep 0.2; echo 'error: why' >&2) & exit 2";
        let stop = AtomicBool::new(false);
        let ended = started("sh", &["-c", script]).wait_for("a word", &stop, |_| false);
        assert_eq!(ended, Err("why".to_string()));
        let script = "(sleep 0.2; echo ready >&2) & exit 0";
        let mut ready = started("sh", &["-c", script]);
        let came = ready.wait_for("the start", &stop, |of| of.ready_ns.is_some());
        assert_eq!(came, Ok(()));
    }

    #[test]
    fn a_process_is_asked_to_end_once_its_own_end_is_not_waited_for() {
        let stop = AtomicBool::new(true);
        let ended = started("sleep", &["600"]).wait_for_end(PATIENCE, &stop);
        // By SIGTERM; SIGKILL would mean that the whole time was waited.
        let said = ended.expect_err("it was ended by a signal");
        assert!(said.contains("ended by signal 15"), "{said}");
        stop.store(false, Ordering::Relaxed);
        let by_itself = started("true", &[]).wait_for_end(PATIENCE, &stop);
        assert_eq!(by_itself, Ok(()));
    }
}
