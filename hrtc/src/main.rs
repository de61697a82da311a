//! `hrtc`: the controller alone.

mod station_link;

use clap::{Args, Parser, Subcommand};
use hrtc::devices::DeviceRegistry;
use hrtc::run::{Output, RunArgs, StopFlags, run_until};
use hrtc::setup::ForceLimits;
use hrtc::tuning::{RUN_SECONDS, SIGNALS_STACK_BYTES};
use scene_args::OverrideArgs;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit status after a third Ctrl-C: 128 and the number of SIGINT.
const INTERRUPTED: i32 = 130;

/// The first signal ends the run with its ramp, the second Ctrl-C at once.
static WITH_RAMP: AtomicBool = AtomicBool::new(false);
static AT_ONCE: AtomicBool = AtomicBool::new(false);

#[global_allocator]
static ALLOCATOR: realtime::counting_allocator::CountingAllocator =
    realtime::counting_allocator::CountingAllocator;

/// The haptic real-time controller.
#[derive(Debug, Parser)]
#[command(name = "hrtc", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Tick on a scene until the time is over or Ctrl-C; a contact needs a station (ve-station
    /// serve)
    Run(RunOptions),
    /// The process of a link, started by `run --station`
    #[cfg(feature = "tunnel")]
    #[command(hide = true)]
    Tunnel(tunnel::TunnelArgs),
}

#[derive(Debug, Args)]
struct RunOptions {
    /// The scene file, the same that the station serves; with --station, that of the station when
    /// it is left out
    #[arg(required_unless_present = "station")]
    scene: Option<PathBuf>,
    /// Length of the run, seconds; until Ctrl-C when absent
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true)]
    seconds: Option<f64>,
    /// Length of the tour, after which the simulated hand rests; that of the run when absent
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true)]
    tour_seconds: Option<f64>,
    /// iceoryx2 domain of the station; with --station, of this machine alone
    #[arg(long, value_name = "NAME", default_value = "hrtc")]
    domain: String,
    /// Calls a station on another machine (ve-station serve --listen): tls/HOST:7447
    #[arg(long, value_name = "ADDRESS")]
    station: Option<String>,
    /// Folder of the controller's keys [default: hrtc/keys in the user's folder of settings]
    #[arg(long, value_name = "DIR", requires = "station")]
    keys: Option<PathBuf>,
    /// Print the result as one JSON object
    #[arg(long, conflicts_with = "supervised")]
    json: bool,
    /// Print JSON lines for a supervisor: status, then the result
    #[arg(long)]
    supervised: bool,
    /// When a supervisor began to start this, on CLOCK_MONOTONIC
    #[arg(long, value_name = "NS", hide = true)]
    started_ns: Option<u64>,
    /// First file of the recording, or "off" [default: the scene's, else a file in the user's state
    /// folder]
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// No more force than this, newtons, whatever the scene says
    #[arg(long, value_name = "N", value_parser = above_zero, allow_negative_numbers = true)]
    max_force: Option<f64>,
    /// No more torque than this, newton metres, whatever the scene says
    #[arg(long, value_name = "NM", value_parser = above_zero, allow_negative_numbers = true)]
    max_torque: Option<f64>,
    /// A file with the device of the first probe, whatever the scene says, as in a scene: device =
    /// { custom = { name = "..." } }; again for the next probe
    #[arg(long, value_name = "FILE")]
    device: Vec<PathBuf>,
    #[command(flatten)]
    overrides: OverrideArgs,
}

/// A finite number above 0.
fn above_zero(text: &str) -> Result<f64, String> {
    let number = text.parse().ok();
    let above = number.filter(|number: &f64| *number > 0.0 && number.is_finite());
    above.ok_or_else(|| "write a number above 0".to_owned())
}

/// The length of a run.
fn seconds(text: &str) -> Result<f64, String> {
    let number = text.parse().ok();
    let allowed = number.filter(|number| RUN_SECONDS.contains(number));
    let [least, most] = [RUN_SECONDS.start(), RUN_SECONDS.end()];
    allowed.ok_or_else(|| format!("write a number from {least} to {most}"))
}

fn main() -> ExitCode {
    match Cli::parse().command {
        Command::Run(options) => run(options),
        #[cfg(feature = "tunnel")]
        Command::Tunnel(args) => tunnel::run(&args),
    }
}

fn run(options: RunOptions) -> ExitCode {
    realtime::rights::keep_heap_small();
    transport::logging::start();
    // Dropped after the link, and after an error was said.
    let _lines = transport::logging::queue();
    if let Err(error) = listen() {
        return failure(&format_args!("cannot listen to signals: {error}"));
    }
    let address = options.station.as_deref();
    let _link = match station_link::call(&options.domain, address, options.keys.as_deref()) {
        Ok(link) => link,
        Err(error) => return failure(&error),
    };
    let output = match (options.json, options.supervised) {
        (_, true) => Output::Supervised,
        (true, false) => Output::Json,
        (false, false) => Output::Text,
    };
    let args = RunArgs {
        scene: options.scene,
        domain: options.domain,
        station: options.station,
        seconds: options.seconds,
        tour_seconds: options.tour_seconds,
        overrides: scene::Overrides {
            devices: options.device,
            ..options.overrides.overrides()
        },
        limits: ForceLimits {
            max_force_n: options.max_force,
            max_torque_nm: options.max_torque,
        },
        output,
        started_ns: options.started_ns,
        record: options.record,
        slow: 1.0,
    };
    let stop = StopFlags {
        with_ramp: &WITH_RAMP,
        at_once: &AT_ONCE,
    };
    match run_until(&DeviceRegistry::new(), &args, stop) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => failure(&error),
    }
}

/// Says a sentence. It waits with all else that is said, since nobody may be left to read it: who
/// writes it here would never end.
fn failure(sentence: &dyn std::fmt::Display) -> ExitCode {
    transport::logging::line(format_args!("hrtc: {sentence}"));
    ExitCode::from(2)
}

/// What a signal asks for.
#[derive(Debug, PartialEq, Eq)]
enum End {
    WithRamp,
    AtOnce,
    /// Whatever still runs.
    WithoutWaiting,
}

/// Only what a person presses asks for more when it comes again: `timeout` sends SIGTERM to the
/// process and to its group, a supervisor sends it as often as it likes, and the force needs its
/// ramp.
fn asked(signal: i32, presses: &mut u32) -> End {
    if signal != SIGINT {
        return End::WithRamp;
    }
    *presses += 1;
    match presses {
        1 => End::WithRamp,
        2 => End::AtOnce,
        _ => End::WithoutWaiting,
    }
}

/// Hears SIGINT, SIGTERM and SIGHUP (a closed terminal) on a thread of its own.
fn listen() -> std::io::Result<()> {
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])?;
    let hear = move || {
        let mut presses = 0;
        for signal in signals.forever() {
            match asked(signal, &mut presses) {
                End::WithRamp => WITH_RAMP.store(true, Ordering::Relaxed),
                End::AtOnce => AT_ONCE.store(true, Ordering::Relaxed),
                End::WithoutWaiting => std::process::exit(INTERRUPTED),
            }
        }
    };
    let thread = std::thread::Builder::new().name("hrtc-signals".to_owned());
    thread.stack_size(SIGNALS_STACK_BYTES).spawn(hear)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_second_press_of_ctrl_c_cuts_the_ramp() {
        let mut presses = 0;
        let mut hear = |signal| asked(signal, &mut presses);
        for signal in [SIGTERM, SIGTERM, SIGHUP, SIGTERM, SIGINT, SIGTERM, SIGHUP] {
            assert_eq!(hear(signal), End::WithRamp, "signal {signal}");
        }
        assert_eq!(hear(SIGINT), End::AtOnce);
        assert_eq!(hear(SIGTERM), End::WithRamp, "it has ended at once already");
        assert_eq!(hear(SIGINT), End::WithoutWaiting);
    }
}
