//! Starts this program again in the role of a process, watches it and ends it.
//!
//! `cargo run -p rt-tests` builds no other binary, so both processes are roles of this one: they
//! are always of the same build. Each gets its own process group (Ctrl-C in a terminal reaches only
//! the supervisor) and ends with it: a supervisor that is killed leaves a SIGTERM, on which the
//! controller ramps its force down and both clean up.

use super::surroundings::Surroundings;
use crate::failure::Failure;
use realtime::rights::pin_to_core;
use std::collections::VecDeque;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What a process said.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Event {
    /// A line on standard output, of the process of this name.
    Line(&'static str, String),
    /// A line on standard error.
    Said(&'static str, String),
}

/// Lines of standard error that are kept for the last words.
const KEPT_LINES: usize = 8;
/// Longest line that is taken from a process, bytes; a final result has some 400 kB.
const LONGEST_LINE: u64 = 64 << 20;

/// A process in one of this program's roles.
pub struct Process {
    name: &'static str,
    child: Child,
    said: Arc<Mutex<VecDeque<String>>>,
    readers: Vec<JoinHandle<()>>,
}

impl Process {
    /// Starts this program with these arguments, on one core if one is given.
    ///
    /// # Errors
    /// When the system refuses to start it.
    pub fn start(
        name: &'static str,
        arguments: &[OsString],
        core: Option<usize>,
        events: &Sender<Event>,
    ) -> Result<Self, Failure> {
        let around = Surroundings {
            core,
            ..Surroundings::default()
        };
        Self::start_in(name, arguments, around, events)
    }

    /// Starts this program with these arguments, in these surroundings.
    ///
    /// # Errors
    /// When the system refuses to start it, or one of the surroundings.
    pub fn start_in(
        name: &'static str,
        arguments: &[OsString],
        around: Surroundings,
        events: &Sender<Event>,
    ) -> Result<Self, Failure> {
        let program = std::env::current_exe().map_err(|error| not_started(name, &error))?;
        Self::start_program(name, &program, arguments, around, events)
    }

    /// Starts another program with these arguments, in these surroundings.
    ///
    /// # Errors
    /// See [`Process::start_in`].
    pub fn start_program(
        name: &'static str,
        program: &Path,
        arguments: &[OsString],
        around: Surroundings,
        events: &Sender<Event>,
    ) -> Result<Self, Failure> {
        let mut command = Command::new(program);
        command
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .process_group(0)
            .envs(around.variables.iter().map(|(name, value)| (name, value)));
        let parent = std::process::id();
        // SAFETY: between fork and exec only async-signal-safe system calls are made (prctl,
        // getppid, sched_setaffinity, setrlimit, unshare, setns, chdir, mount), on values
        // that live in this closure; nothing is allocated.
        unsafe {
            command.pre_exec(move || prepare_child(parent, &around));
        }
        let mut child = command.spawn().map_err(|error| not_started(name, &error))?;
        let said = Arc::new(Mutex::new(VecDeque::with_capacity(KEPT_LINES + 1)));
        let mut readers = Vec::new();
        if let Some(out) = child.stdout.take() {
            let events = events.clone();
            readers.push(each_line(out, move |line| {
                let _ = events.send(Event::Line(name, line));
            }));
        }
        if let Some(out) = child.stderr.take() {
            let (events, said) = (events.clone(), Arc::clone(&said));
            readers.push(each_line(out, move |line| {
                if let Ok(mut said) = said.lock() {
                    said.push_back(line.clone());
                    if said.len() > KEPT_LINES {
                        said.pop_front();
                    }
                }
                let _ = events.send(Event::Said(name, line));
            }));
        }
        Ok(Self {
            name,
            child,
            said,
            readers,
        })
    }

    /// Process id.
    #[must_use]
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// How it ended, once it did.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().ok().flatten()
    }

    /// Asks it to end (SIGTERM).
    pub fn terminate(&mut self) {
        self.signal(libc::SIGTERM);
    }

    /// Sends it a signal, unless it has ended.
    pub fn signal(&mut self, number: libc::c_int) {
        if self.ended().is_none() {
            signal(self.child.id(), number);
        }
    }

    /// Sends its own children a signal.
    pub fn signal_children(&mut self, number: libc::c_int) {
        if self.ended().is_some() {
            return;
        }
        let threads = std::fs::read_dir(format!("/proc/{}/task", self.child.id()));
        for thread in threads.into_iter().flatten().flatten() {
            let children = std::fs::read_to_string(thread.path().join("children"));
            for child in children.unwrap_or_default().split_whitespace() {
                child.parse().into_iter().for_each(|id| signal(id, number));
            }
        }
    }

    /// Waits for its end and all its output; ends it by force when the time is over.
    pub fn wait(&mut self, patience: Duration) -> Option<ExitStatus> {
        let deadline = Instant::now() + patience;
        while self.ended().is_none() {
            if Instant::now() >= deadline {
                let _ = self.child.kill();
                break;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let status = self.child.wait().ok();
        for reader in self.readers.drain(..) {
            let _ = reader.join();
        }
        status
    }

    /// Why it ended, in one sentence: what it said last on standard error.
    #[must_use]
    pub fn failure(&self, status: Option<ExitStatus>) -> Failure {
        let name = self.name;
        let lines: Vec<String> = self
            .said
            .lock()
            .map(|said| said.iter().cloned().collect())
            .unwrap_or_default();
        let code = status.and_then(|status| status.code());
        // A role has already said in one sentence why it failed.
        let said = lines
            .iter()
            .rev()
            .find_map(|line| line.strip_prefix("error: "));
        if code == Some(2) {
            let sentence = said.or(lines.last().map(String::as_str));
            return Failure::Input(sentence.unwrap_or("bad input").to_string());
        }
        if let (Some(1), Some(sentence)) = (code, said) {
            return Failure::Run(sentence.to_string());
        }
        let how = match status.map(|status| (status.code(), status.signal())) {
            Some((Some(code), _)) => format!("with status {code}"),
            Some((_, Some(signal))) => format!("by signal {signal}"),
            _ => "in an unknown way".to_string(),
        };
        let words = match lines.as_slice() {
            [] => "it said nothing".to_string(),
            lines => format!("its last words: {}", lines.join(" | ")),
        };
        Failure::Run(format!("the {name} ended {how}; {words}"))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if self.ended().is_none() {
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}

fn not_started(name: &str, error: &std::io::Error) -> Failure {
    Failure::Run(format!("the {name} could not be started ({error})"))
}

fn signal(process: u32, number: libc::c_int) {
    if let Ok(process) = libc::pid_t::try_from(process) {
        // SAFETY: kill takes plain numbers; the process is a child that was not waited for, so its
        // id is still its own, or was that of a child of one just now.
        unsafe {
            libc::kill(process, number);
        }
    }
}

/// In the child, before it becomes the role.
fn prepare_child(parent: u32, around: &Surroundings) -> std::io::Result<()> {
    // SAFETY: prctl with PR_SET_PDEATHSIG takes a signal number and touches no memory of ours.
    if unsafe { libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGTERM) } != 0 {
        return Err(std::io::Error::last_os_error());
    }
    // SAFETY: getppid has no arguments and cannot fail.
    let now = unsafe { libc::getppid() };
    if u32::try_from(now) != Ok(parent) {
        // The parent died before the signal was set.
        return Err(std::io::Error::from_raw_os_error(libc::ESRCH));
    }
    around.enter_host()?;
    around.take_rights()?;
    around.mount_small_disk()?;
    if let Some(core) = around.core {
        // Best effort: without the core the run is still right, only noisier.
        let _ = pin_to_core(core);
    }
    Ok(())
}

/// Hands on every line of a stream until it ends.
fn each_line(
    stream: impl Read + Send + 'static,
    mut hand_on: impl FnMut(String) + Send + 'static,
) -> JoinHandle<()> {
    std::thread::spawn(move || {
        let mut stream = BufReader::new(stream);
        let mut bytes = Vec::new();
        loop {
            bytes.clear();
            match stream
                .by_ref()
                .take(LONGEST_LINE)
                .read_until(b'\n', &mut bytes)
            {
                Ok(0) | Err(_) => return,
                Ok(_) => hand_on(String::from_utf8_lossy(&bytes).trim_end().to_string()),
            }
        }
    })
}
