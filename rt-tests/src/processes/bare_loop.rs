//! The bare loop: the thread set-up of the controller with an empty body, or with fixed arithmetic
//! of a given length. What it misses, the machine misses.

use super::load::arithmetic;
use super::process::{Event, Process};
use super::stop::is_set;
use crate::failure::Failure;
use crate::report::output::print_json;
use clap::Args;
use hrtc::result::{Accumulator, Finished, Right, RunMeta, SupervisedLine};
use hrtc::run::next_tick_core;
use hrtc::tick_record::{STAGES, TickRecord};
use hrtc_core::record::CoreRecord;
use realtime::pacer::{Pacer, Wake, Worked};
use realtime::rights::{obtain, thread_cpu_ns};
use realtime::slow_thread::SlowThread;
use scene::LoopPlan;
use std::ffi::OsString;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// What the bare loop's role is told.
#[derive(Debug, Args)]
pub struct BareArgs {
    /// Ticks a second.
    #[arg(long)]
    pub rate_hz: f64,
    /// Core of the tick.
    #[arg(long)]
    pub core: Option<usize>,
    /// SCHED_FIFO priority.
    #[arg(long)]
    pub priority: i32,
    /// Microseconds before a deadline that are spun.
    #[arg(long)]
    pub spin_us: u64,
    /// Length.
    #[arg(long)]
    pub seconds: f64,
    /// Thread CPU of the fixed arithmetic of a tick; 0 for an empty body.
    #[arg(long, default_value_t = 0)]
    pub work_ns: u64,
    /// How many times as long as by itself the body takes: the tick's `--slow`.
    #[arg(long, default_value_t = 1.0)]
    pub slow: f64,
}

/// Time that a bare loop may take beyond its seconds.
const TIMEOUT_S: f64 = 30.0;

/// What a bare loop does in a tick.
#[derive(Debug, Clone, Copy)]
pub struct BareWork {
    /// Thread CPU of fixed arithmetic; 0 for an empty body.
    pub ns: u64,
    /// How many times as long as by itself it takes, as the stages of a tick under `--slow`.
    pub slow: f64,
}

/// A bare loop in a process of its own, with this loop's rate, rights and core; all but its tick
/// goes to another core.
///
/// # Errors
/// When the process fails, or ends before there is a result.
pub fn run_bare(
    plan: &LoopPlan,
    other_core: Option<usize>,
    seconds: f64,
    work: BareWork,
    stop: &AtomicBool,
) -> Result<Finished, Failure> {
    let mut typed: Vec<OsString> = vec!["role-bare".into()];
    typed.push(format!("--rate-hz={}", plan.rate_hz).into());
    typed.push(format!("--priority={}", plan.priority).into());
    typed.push(format!("--spin-us={}", plan.spin_us).into());
    typed.push(format!("--seconds={seconds}").into());
    typed.push(format!("--work-ns={}", work.ns).into());
    typed.push(format!("--slow={}", work.slow).into());
    if let Some(core) = next_tick_core(plan) {
        typed.push(format!("--core={core}").into());
    }
    let (sender, events) = channel();
    let mut process = Process::start("bare loop", &typed, other_core, &sender)?;
    // With the last sender gone, the events end when the process does.
    drop(sender);
    let deadline = Instant::now() + Duration::from_secs_f64(seconds + TIMEOUT_S);
    let mut finished = None;
    while Instant::now() < deadline {
        match events.recv_timeout(Duration::from_millis(100)) {
            Ok(Event::Line(_, line)) => {
                if let Ok(SupervisedLine::Finished(result)) = serde_json::from_str(&line) {
                    finished = Some(*result);
                }
            }
            Ok(Event::Said(..)) => {}
            Err(RecvTimeoutError::Timeout) if is_set(stop) => process.terminate(),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    let status = process.wait(Duration::from_secs(1));
    finished.ok_or_else(|| process.failure(status))
}

/// Runs the loop and prints its result as the controller does.
///
/// # Errors
/// When no thread can be made, or the result cannot be printed.
pub fn bare(args: &BareArgs, stop: &AtomicBool) -> Result<(), Failure> {
    let finished = std::thread::scope(|scope| {
        let thread = std::thread::Builder::new()
            .name("tick".to_string())
            .stack_size(1 << 20)
            .spawn_scoped(scope, || measure(args, stop));
        thread.ok()?.join().ok()?
    });
    let Some(finished) = finished else {
        return Err(Failure::Run(
            "the bare loop could not be set up; give it more memory or a shorter --seconds"
                .to_string(),
        ));
    };
    print_json(&SupervisedLine::Finished(Box::new(finished)))
}

fn measure(args: &BareArgs, stop: &AtomicBool) -> Option<Finished> {
    let period = (1e9 / args.rate_hz).round() as u64;
    let most = (args.seconds * args.rate_hz).ceil() as usize;
    let mut ticks: Vec<(Wake, Worked)> = Vec::new();
    ticks.try_reserve_exact(most).ok()?;
    let steps = calibrate((args.work_ns as f64 / args.slow) as u64);
    let obtained = obtain(args.core, args.priority);
    run_loop(args, steps, most, stop, &mut ticks);
    let mut run = Accumulator::new(period, 0);
    for tick in &ticks {
        run.push(&record(tick));
    }
    let missing: Vec<Right> = obtained
        .missing
        .iter()
        .map(|missing| Right {
            name: missing.right.what(),
            obtained: false,
            detail: missing.to_string(),
        })
        .collect();
    Some(run.finish(RunMeta {
        scene: "bare".to_string(),
        slow: args.slow,
        rights: missing,
        ..RunMeta::default()
    }))
}

fn run_loop(
    args: &BareArgs,
    steps: u64,
    most: usize,
    stop: &AtomicBool,
    ticks: &mut Vec<(Wake, Worked)>,
) {
    let mut pacer = Pacer::new(args.rate_hz, args.spin_us);
    let mut x = 1;
    while ticks.len() < ticks.capacity() && !is_set(stop) {
        let wake = pacer.wait();
        if wake.tick >= most as u64 {
            break;
        }
        let mut slow = SlowThread::begin(args.slow);
        x = arithmetic(x, steps);
        slow.end_part();
        let worked = pacer.done();
        ticks.push((wake, worked));
    }
    std::hint::black_box(x);
}

/// Steps of arithmetic that take this long here.
fn calibrate(work_ns: u64) -> u64 {
    const TRIAL: u64 = 200_000;
    if work_ns == 0 {
        return 0;
    }
    let mut times: Vec<u64> = (0..9)
        .map(|x| {
            let start = thread_cpu_ns();
            std::hint::black_box(arithmetic(x, TRIAL));
            thread_cpu_ns() - start
        })
        .collect();
    times.sort_unstable();
    (TRIAL * work_ns / times[times.len() / 2].max(1)).max(1)
}

fn record(&(wake, worked): &(Wake, Worked)) -> TickRecord {
    TickRecord {
        tick: wake.tick,
        planned_ns: wake.planned_ns,
        start_ns: wake.start_ns,
        skipped: wake.skipped,
        misses: wake.misses,
        wake_ns: wake.wake_ns,
        period_ns: wake.period_ns,
        spun_ns: wake.spun_ns,
        extra_switches: wake.extra_switches,
        work_cpu_ns: worked.cpu_ns,
        work_wall_ns: worked.wall_ns,
        stage_ns: [0; STAGES.len()],
        page_faults: worked.page_faults,
        allocations: 0,
        chunks_arrived: 0,
        station: 0,
        core: CoreRecord {
            measured_error_m: -1.0,
            ..CoreRecord::default()
        },
        ..TickRecord::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(seconds: f64, work_ns: u64) -> BareArgs {
        BareArgs {
            rate_hz: 1000.0,
            core: None,
            priority: 1,
            spin_us: 0,
            seconds,
            work_ns,
            slow: 1.0,
        }
    }

    #[test]
    fn an_empty_body_ticks_through_its_time() {
        let finished = measure(&args(0.1, 0), &AtomicBool::new(false)).unwrap();
        let result = finished.result;
        assert!(result.ticks + result.missed >= 99, "{result:?}");
        assert_eq!(result.missed, result.misses.total());
        assert_eq!(result.misses.own_cpu, 0);
    }
}
