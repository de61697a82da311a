//! Missed periods whose cause is made on purpose have its class. Each test judges classes only, so
//! that a slow machine cannot fail it.

use realtime::pacer::{Miss, MissClass, Pacer, Wake};
use realtime::rights::{monotonic_ns, pin_to_core, set_fifo, sleep_until_ns, thread_cpu_ns};
use std::io::{BufRead, BufReader, Lines, Write};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError, mpsc};
use std::thread;

/// Tries of each cause.
const TRIES: u64 = 20;
/// Ticks between two tries.
const BETWEEN: u64 = 10;
const MS: u64 = 1_000_000;
/// Time for which a lock is held: the scheduler keeps no ready thread waiting for so long.
const HELD: u64 = 20 * MS;

/// One test at a time: each one's cause would be another's miss.
static ALONE: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs a loop at 1 kHz and has `cause` make a miss in every tenth tick. The wakes that follow the
/// ticks with a cause.
fn after_causes(mut cause: impl FnMut()) -> Vec<Wake> {
    let mut pacer = Pacer::new(1000.0, 0);
    let mut after = Vec::new();
    let mut is_caused = false;
    for k in 0..BETWEEN * TRIES + 1 {
        let wake = pacer.wait();
        if is_caused {
            after.push(wake);
        }
        pacer.done();
        // After `done`: work that the shell does outside the measured section counts as well.
        is_caused = k % BETWEEN == BETWEEN - 1;
        if is_caused {
            cause();
        }
    }
    assert_eq!(after.len() as u64, TRIES);
    after
}

fn spin_cpu(ns: u64) {
    let end = thread_cpu_ns() + ns;
    while thread_cpu_ns() < end {
        std::hint::spin_loop();
    }
}

#[test]
fn a_busy_tick_is_our_processor_time() {
    let _alone = alone();
    for wake in after_causes(|| spin_cpu(3 * MS)) {
        assert_eq!(wake.misses[0].class, MissClass::OwnCpu, "{wake:?}");
        assert!(wake.misses[0].periods >= 2 && wake.skipped >= wake.misses[0].periods);
    }
}

#[test]
fn a_lock_that_another_thread_of_ours_holds_is_our_wait() {
    let _alone = alone();
    let lock = Mutex::new(());
    let (ask, asked) = mpsc::sync_channel::<()>(0);
    let (tell, held) = mpsc::sync_channel::<()>(0);
    thread::scope(|scope| {
        let lock = &lock;
        scope.spawn(move || {
            while asked.recv().is_ok() {
                let guard = lock.lock().unwrap();
                tell.send(()).unwrap();
                sleep_until_ns(monotonic_ns() + HELD);
                drop(guard);
            }
        });
        let wakes = after_causes(|| {
            ask.send(()).unwrap();
            held.recv().unwrap();
            drop(lock.lock().unwrap());
        });
        drop(ask);
        for wake in wakes {
            assert_eq!(wake.misses[0].class, MissClass::OwnWait, "{wake:?}");
        }
    });
}

/// Time for which the hog computes: more than a stall of the host, which would be a late timer.
const HOGGED: u64 = 20 * MS;
/// Periods that a hog takes at the least.
const LEAST_HOGGED: u32 = 15;

/// A thread of a higher real-time priority takes the loop's core, twenty times.
#[test]
fn a_realtime_hog_on_the_core_is_the_run_queue() {
    let _alone = alone();
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let core = cores - 1;
    let hog_is_done = AtomicBool::new(false);
    thread::scope(|scope| {
        let hog_is_done = &hog_is_done;
        let loop_ = scope.spawn(move || {
            pin_to_core(core).and_then(|()| set_fifo(1)).ok()?;
            let mut pacer = Pacer::new(1000.0, 0);
            let mut missed = Vec::new();
            while !hog_is_done.load(Ordering::Relaxed) {
                let wake = pacer.wait();
                pacer.done();
                let is_long = |miss: &Miss| miss.periods >= LEAST_HOGGED;
                missed.extend(wake.misses.into_iter().filter(is_long));
            }
            Some(missed)
        });
        let hog = scope.spawn(move || {
            let granted = pin_to_core(core).and_then(|()| set_fifo(2));
            for _ in 0..TRIES {
                if granted.is_err() {
                    break;
                }
                sleep_until_ns(monotonic_ns() + 20 * MS);
                spin_cpu(HOGGED);
            }
            hog_is_done.store(true, Ordering::Relaxed);
            granted
        });
        if let Err(missing) = hog.join().unwrap() {
            let _ = writeln!(std::io::stderr(), "skipped: {}", missing.right.name());
            return;
        }
        let Some(missed) = loop_.join().unwrap() else {
            let _ = writeln!(std::io::stderr(), "skipped: SCHED_FIFO 1");
            return;
        };
        let queued = missed
            .iter()
            .filter(|miss| miss.class == MissClass::RunQueue);
        // The host may stall the loop as well; the hog's misses are never missing.
        assert!(queued.count() as u64 >= TRIES, "{missed:?}");
        let ours = missed
            .iter()
            .any(|miss| matches!(miss.class, MissClass::OwnCpu | MissClass::OwnWait));
        assert!(!ours, "{missed:?}");
    });
}

/// Set for the process that is stopped.
const STOPPED_CHILD: &str = "MISSES_STOPPED_CHILD";
/// Ticks a second of its loop: at 20 Hz it sleeps nearly always.
const STOPPED_HZ: f64 = 20.0;
/// Time for which it is stopped: more than the host or other processes take it for.
const STOPPED: u64 = 150 * MS;
/// Stops at the most: on a busy machine some come too late for the sleep.
const MAX_STOPS: u64 = 10 * TRIES;

/// The loop of the process that is stopped. Says when it is about to sleep, and until when; and how
/// many periods the sleep lost, and why.
#[test]
fn loop_of_the_stopped_process() {
    if std::env::var_os(STOPPED_CHILD).is_none() {
        return;
    }
    // Refused without rights: other processes may then keep it from its core for longer.
    let _ = set_fifo(1);
    // SAFETY: takes no pointers.
    let thread = unsafe { libc::gettid() };
    let mut pacer = Pacer::new(STOPPED_HZ, 0);
    // The tests' harness ends with this process.
    loop {
        let wake = pacer.wait();
        let lost = wake.misses[1];
        let next = wake.planned_ns + u64::from(1 + lost.periods) * pacer.period_ns();
        println!("\nwoke {} {:?}", lost.periods, lost.class);
        println!("\nsleeps {thread} {next}");
    }
}

/// Waits until a thread is in a state, as `/proc` names it.
fn wait_for_state(thread: libc::pid_t, state: char) {
    let is_there = || {
        let stat = std::fs::read_to_string(format!("/proc/{thread}/stat")).unwrap();
        stat.rsplit_once(") ").unwrap().1.starts_with(state)
    };
    while !is_there() {
        sleep_until_ns(monotonic_ns() + MS / 10);
    }
}

/// The process that is stopped.
struct Stopped {
    child: Child,
    lines: Lines<BufReader<ChildStdout>>,
}

impl Stopped {
    fn start() -> Self {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "loop_of_the_stopped_process", "--nocapture"])
            .env(STOPPED_CHILD, "1")
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        Self { child, lines }
    }

    /// The rest of the next line that begins with a word.
    fn said(&mut self, word: &str) -> String {
        let mut said = self.lines.by_ref().map(Result::unwrap).filter_map(|line| {
            let rest = line.strip_prefix(word)?;
            Some(rest.trim().to_string())
        });
        said.next().unwrap()
    }

    /// The thread that sleeps now, and until when, ns.
    fn sleeps(&mut self) -> (libc::pid_t, u64) {
        loop {
            let said = self.said("sleeps ");
            let (thread, until) = said.split_once(' ').unwrap();
            let until = until.parse().unwrap();
            // What it said long ago is over.
            if monotonic_ns() + 10 * MS < until {
                return (thread.parse().unwrap(), until);
            }
        }
    }

    fn signal(&self, thread: libc::pid_t, signal: libc::c_int) {
        let process = self.child.id();
        // SAFETY: takes plain numbers; the child is not waited for yet, so the ids are its own.
        let done = unsafe { libc::syscall(libc::SYS_tgkill, process, thread, signal) };
        assert_eq!(done, 0);
    }

    /// Stops it in a sleep; how many periods the sleep lost, and why. `None` when the stop came too
    /// late for the sleep.
    fn stop(&mut self) -> Option<String> {
        let (thread, until) = self.sleeps();
        wait_for_state(thread, 'S');
        // To the thread itself: another one of a lower priority may take it much later.
        self.signal(thread, libc::SIGSTOP);
        wait_for_state(thread, 'T');
        let hit_the_sleep = monotonic_ns() < until;
        sleep_until_ns(monotonic_ns() + STOPPED);
        self.signal(thread, libc::SIGCONT);
        let woke = self.said("woke ");
        hit_the_sleep.then_some(woke)
    }
}

impl Drop for Stopped {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn a_stopped_process_is_neither_ours_nor_the_timers() {
    let _alone = alone();
    // As its loop does.
    let _ = set_fifo(1);
    let mut stopped = Stopped::start();
    let stops = (0..MAX_STOPS).filter_map(|_| stopped.stop());
    let woke: Vec<String> = stops.take(TRIES as usize).collect();
    assert_eq!(woke.len() as u64, TRIES, "{woke:?}");
    let is_named = |woke: &String| woke.ends_with(" Stopped") && !woke.starts_with("0 ");
    assert!(woke.iter().all(is_named), "{woke:?}");
}
