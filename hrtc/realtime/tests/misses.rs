//! Missed periods whose cause is made on purpose have its class. Each test judges classes only, so
//! that a slow machine cannot fail it.

use realtime::pacer::{MissClass, Pacer, Wake};
use realtime::rights::{monotonic_ns, pin_to_core, set_fifo, sleep_until_ns, thread_cpu_ns};
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
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

#[test]
fn a_busy_tick_stays_ours_when_the_sleep_after_it_is_late_too() {
    let _alone = alone();
    for wake in after_causes(|| spin_cpu(2 * MS)) {
        let [work, sleep] = wake.misses;
        assert_eq!(work.class, MissClass::OwnCpu);
        assert_eq!(wake.skipped, work.periods + sleep.periods);
    }
}

/// A thread of a higher real-time priority takes the loop's core for 5 ms, twenty times.
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
                missed.extend(wake.misses.into_iter().filter(|miss| miss.periods >= 3));
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
                let end = monotonic_ns() + 5 * MS;
                while monotonic_ns() < end {
                    std::hint::spin_loop();
                }
            }
            hog_is_done.store(true, Ordering::Relaxed);
            granted
        });
        if let Err(missing) = hog.join().unwrap() {
            println!("skipped: {}", missing.right.name());
            return;
        }
        let Some(missed) = loop_.join().unwrap() else {
            println!("skipped: SCHED_FIFO 1");
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

/// The loop of the process that is stopped: 10 Hz, so that it sleeps nearly always. Says when it
/// begins to sleep, and the class of every miss.
#[test]
fn loop_of_the_stopped_process() {
    if std::env::var_os(STOPPED_CHILD).is_none() {
        return;
    }
    let mut pacer = Pacer::new(10.0, 0);
    // The tests' harness ends with this process.
    loop {
        let wake = pacer.wait();
        for miss in wake.misses {
            if miss.periods >= 2 {
                println!("\nmissed {:?}", miss.class);
            }
        }
        println!("\nsleeps");
    }
}

#[test]
fn a_stopped_process_is_neither_ours_nor_the_timers() {
    let _alone = alone();
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "loop_of_the_stopped_process", "--nocapture"])
        .env(STOPPED_CHILD, "1")
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let id = child.id() as libc::pid_t;
    let signal = |signal: libc::c_int| {
        // SAFETY: takes no pointers; the child is not waited for yet, so the id is its own.
        assert_eq!(unsafe { libc::kill(id, signal) }, 0);
    };
    let output = child.stdout.take().unwrap();
    let mut lines = BufReader::new(output).lines().map_while(Result::ok);
    let mut classes = Vec::new();
    while classes.len() < 3 {
        lines.by_ref().find(|line| line == "sleeps").unwrap();
        sleep_until_ns(monotonic_ns() + 20 * MS);
        signal(libc::SIGSTOP);
        sleep_until_ns(monotonic_ns() + 400 * MS);
        signal(libc::SIGCONT);
        classes.extend(lines.by_ref().find(|line| line.starts_with("missed ")));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(classes, ["missed Stopped"; 3]);
}
