//! Lines on standard error: sentences of the program, events of tracing, and panics. What iceoryx2
//! says of itself, which is errors only, is not among them.
//!
//! Whoever writes to a terminal that is paused, or into a pipe that nobody reads, hangs until that
//! ends. Who holds a [`Queue`] never does: lines wait for one thread then, which alone writes them,
//! and those that find no room are left out, which is told in their place. Without one a line is
//! written at once.
//!
//! ```
//! let queue = transport::logging::queue();
//! transport::logging::line(format_args!("hrtc: {}", "read or not, this takes no time"));
//! // What waits is written first, where somebody reads it.
//! drop(queue);
//! ```

use std::fmt;
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread;
use std::time::Duration;
use tracing_subscriber::filter::LevelFilter;

/// Lines that wait at the most, while as many are written: one for each object of a large scene.
const MAX_WAITING: usize = 256;
/// Stack of the thread, bytes: it only writes. Locked memory commits it whole.
const STACK_BYTES: usize = 128 << 10;
/// How long the end waits until all is written.
const END_TIMEOUT: Duration = Duration::from_secs(1);

/// Those that wait for standard error, from the first [`Queue`] on; `None` without a thread.
static LINES: OnceLock<Option<Lines>> = OnceLock::new();
/// Queues that are held.
static HELD: AtomicUsize = AtomicUsize::new(0);

/// Shows tracing's events as lines: warnings, or up to the level that the variable HRTC_LOG names
/// (off, error, warn, info, debug, trace); and panics. Called once, from `main`.
pub fn start() {
    say_panics();
    let asked = std::env::var("HRTC_LOG").ok();
    let level: Option<LevelFilter> = asked.as_ref().and_then(|level| level.parse().ok());
    if let (Some(asked), None) = (asked, level) {
        line(format_args!(
            "HRTC_LOG={asked} is no level: write off, error, warn, info, debug or trace"
        ));
    }
    tracing_subscriber::fmt()
        .with_max_level(level.unwrap_or(LevelFilter::WARN))
        .with_writer(|| Events)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .without_time()
        .init();
}

/// Has panics be lines too while somebody holds a [`Queue`]: the usual report is written by the
/// thread that panicked, which hangs where nobody reads it. Who asks for a backtrace gets that one.
fn say_panics() {
    if std::env::var_os("RUST_BACKTRACE").is_some() {
        return;
    }
    let print = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if HELD.load(Ordering::Relaxed) == 0 {
            return print(panic);
        }
        let thread = thread::current();
        let name = thread.name().unwrap_or("without a name");
        line(format_args!("thread {name:?} {panic}"));
    }));
}

/// As long as it lives, no thread that says a line waits for whoever reads it. Dropping it waits
/// until what was said is written, at most a second: who hangs then is left to end with the
/// process.
#[derive(Debug)]
#[must_use]
pub struct Queue(());

/// Has lines wait for a thread of their own, started from the first caller's: see [`Queue`].
pub fn queue() -> Queue {
    HELD.fetch_add(1, Ordering::Relaxed);
    // Without a thread they are written at once.
    let _ = LINES.get_or_init(|| Lines::start(std::io::stderr()).ok());
    Queue(())
}

impl Drop for Queue {
    fn drop(&mut self) {
        // What is said from here on may be the last that is said.
        HELD.fetch_sub(1, Ordering::Relaxed);
        if let Some(lines) = lines() {
            lines.flush(END_TIMEOUT);
        }
    }
}

/// Says a line; nobody may be left to read it.
pub fn line(text: fmt::Arguments<'_>) {
    tell(format!("{text}\n").into_bytes());
}

fn lines() -> Option<&'static Lines> {
    LINES.get().and_then(Option::as_ref)
}

fn tell(line: Vec<u8>) {
    match lines().filter(|_| HELD.load(Ordering::Relaxed) > 0) {
        Some(lines) => lines.push(line),
        None => {
            let _ = std::io::stderr().write_all(&line);
        }
    }
}

/// Where tracing writes its events: each in one piece, with the end of its line.
struct Events;

impl Write for Events {
    fn write(&mut self, event: &[u8]) -> std::io::Result<usize> {
        tell(event.to_vec());
        Ok(event.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// The lines of an output, and the thread that writes them.
struct Lines(Arc<Shared>);

struct Shared {
    waiting: Mutex<Waiting>,
    /// There is one more, or all are written.
    changed: Condvar,
}

struct Waiting {
    lines: Vec<Vec<u8>>,
    /// Those that came after them and found no room.
    left_out: u64,
    /// Whether the thread has some that are not written yet.
    is_writing: bool,
}

impl Lines {
    fn start(out: impl Write + Send + 'static) -> std::io::Result<Self> {
        let shared = Arc::new(Shared {
            waiting: Mutex::new(Waiting {
                lines: Vec::with_capacity(MAX_WAITING),
                left_out: 0,
                is_writing: false,
            }),
            changed: Condvar::new(),
        });
        let of_thread = Arc::clone(&shared);
        thread::Builder::new()
            .name("notes".to_owned())
            .stack_size(STACK_BYTES)
            .spawn(move || of_thread.write_to(out))?;
        Ok(Self(shared))
    }

    fn push(&self, line: Vec<u8>) {
        let mut waiting = self.0.lock();
        if waiting.lines.len() < MAX_WAITING {
            waiting.lines.push(line);
        } else {
            waiting.left_out += 1;
        }
        drop(waiting);
        self.0.changed.notify_all();
    }

    fn flush(&self, most: Duration) {
        let is_untold = |of: &mut Waiting| of.is_writing || !of.lines.is_empty();
        let waiting = self.0.lock();
        drop(self.0.changed.wait_timeout_while(waiting, most, is_untold));
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The thread. What cannot be written is lost.
    fn write_to(&self, mut out: impl Write) {
        let mut lines = Vec::with_capacity(MAX_WAITING);
        loop {
            let left_out = self.take(&mut lines);
            for line in lines.drain(..) {
                let _ = out.write_all(&line);
            }
            if left_out > 0 {
                let told = format!("lines that nobody read in time, left out here: {left_out}\n");
                let _ = out.write_all(told.as_bytes());
            }
        }
    }

    /// Waits for lines and takes all that wait; how many were left out after them.
    fn take(&self, lines: &mut Vec<Vec<u8>>) -> u64 {
        let mut waiting = self.lock();
        waiting.is_writing = false;
        self.changed.notify_all();
        let waited = self.changed.wait_while(waiting, |of| of.lines.is_empty());
        let mut waiting = waited.unwrap_or_else(PoisonError::into_inner);
        waiting.is_writing = true;
        std::mem::swap(&mut waiting.lines, lines);
        std::mem::take(&mut waiting.left_out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::{Command, Stdio};
    use std::sync::mpsc::{Receiver, Sender, channel};
    use std::time::Instant;

    /// A hang of the tests, not a measurement.
    const LONG: Duration = Duration::from_secs(60);

    /// An output that nobody reads until it is released.
    struct Unread {
        begun: Sender<()>,
        held: Receiver<()>,
        written: Arc<Mutex<Vec<u8>>>,
    }

    impl Write for Unread {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            let _ = self.begun.send(());
            let _ = self.held.recv();
            self.written.lock().unwrap().extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn whoever_says_a_line_never_waits_and_what_is_left_out_is_told_in_its_place() {
        let (release, held) = channel();
        let (begun, begins) = channel();
        let written = Arc::new(Mutex::new(Vec::new()));
        let out = Unread {
            begun,
            held,
            written: Arc::clone(&written),
        };
        let lines = Lines::start(out).unwrap();
        let say = |number: usize| lines.push(format!("{number}\n").into_bytes());
        say(0);
        begins.recv().unwrap();
        // One is being written, and so many wait.
        let (fit, all) = (1 + MAX_WAITING, 1000 + MAX_WAITING);
        for number in 1..all {
            say(number);
        }
        // It hangs: the end does not.
        lines.flush(Duration::from_millis(1));
        assert!(written.lock().unwrap().is_empty());
        drop(release);
        lines.flush(LONG);
        say(all);
        lines.flush(LONG);
        let text = String::from_utf8(written.lock().unwrap().clone()).unwrap();
        let left_out = format!(
            "lines that nobody read in time, left out here: {}",
            all - fit
        );
        let numbers = (0..fit).map(|number| number.to_string());
        let expected: Vec<String> = numbers.chain([left_out, all.to_string()]).collect();
        assert!(
            text.lines().eq(expected.iter().map(String::as_str)),
            "{text}"
        );
    }

    /// Set in the process of the test below, and its status.
    const PANICS: &str = "LOGGING_PANICS";
    const HAS_PANICKED: i32 = 7;

    #[test]
    fn a_panic_does_not_wait_for_whoever_reads_it() {
        if std::env::var_os(PANICS).is_some() {
            panic_where_nobody_reads();
        }
        let (_unread, mut errors) = std::io::pipe().unwrap();
        // A pipe's room (pipe(7)).
        errors.write_all(&[b' '; 1 << 16]).unwrap();
        let name = "logging::tests::a_panic_does_not_wait_for_whoever_reads_it";
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", name, "--nocapture"])
            .env(PANICS, "1")
            .env_remove("RUST_BACKTRACE")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(errors)
            .spawn()
            .unwrap();
        let start = Instant::now();
        while child.try_wait().unwrap().is_none() && start.elapsed() < LONG {
            thread::sleep(Duration::from_millis(5));
        }
        // Where it hangs.
        let _ = child.kill();
        assert_eq!(child.wait().unwrap().code(), Some(HAS_PANICKED));
    }

    fn panic_where_nobody_reads() -> ! {
        start();
        let _queue = queue();
        let panics: fn() = || panic!("made on purpose");
        let ended = thread::spawn(panics).join();
        std::process::exit(if ended.is_err() { HAS_PANICKED } else { 1 });
    }

    #[test]
    fn events_of_tracing_are_whole_lines() {
        let event = b"WARN a sentence\n";
        assert_eq!(Events.write(event).unwrap(), event.len());
        assert!(Events.flush().is_ok());
    }
}
