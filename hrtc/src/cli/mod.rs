//! The command line of `hrtc`, for every program that ticks: that of this crate, and one with
//! drivers of its own. With it come the signals and their ramp, the lines of the log, the link to a
//! station on another machine and the exit statuses.
//!
//! | status | meaning |
//! |---|---|
//! | 0 | the run has ended at its time, or by a signal with its ramp |
//! | 1 | the run failed; what is known of it was printed as its result |
//! | 2 | a bad file, option or scene: one sentence says what to do |
//! | 130 | ended by a second or third Ctrl-C, or by a signal before the station's scene was here |
//!
//! # Example
//! A program with a driver of one's own:
//! ```no_run
//! use haptic_device::Device;
//! use hrtc::devices::DeviceRegistry;
//! use std::process::ExitCode;
//!
//! fn open_arm() -> Result<Box<dyn Device>, String> {
//!     Err("no arm is connected".to_owned())
//! }
//!
//! fn main() -> ExitCode {
//!     hrtc::cli::main(&DeviceRegistry::new().with("arm", |_request| open_arm()))
//! }
//! ```

mod signals;

use crate::devices::DeviceRegistry;
use crate::fetch::FetchError;
use crate::message::note;
use crate::run::{Output, RunArgs, RunError, run_until};
use crate::setup::ForceLimits;
use crate::station_link;
use crate::tuning::RUN_SECONDS;
use clap::{Args, Parser, Subcommand};
use scene_args::OverrideArgs;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;
use transport::signals::INTERRUPTED;

/// Status of a run that failed.
const FAILED: u8 = 1;
/// Status for a bad file, option or scene.
const BAD_INPUT: u8 = 2;

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
    /// Length of the tour, after which the simulated hand rests; without it that of the run, at
    /// most ten minutes, or one minute in a run without an end, again and again, back and forth
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
    /// { simulated = {} }, or { custom = { name = "..." } } with a driver that this program has;
    /// again for the next probe
    #[arg(long, value_name = "FILE")]
    device: Vec<PathBuf>,
    #[command(flatten)]
    overrides: OverrideArgs,
}

impl From<RunOptions> for RunArgs {
    fn from(options: RunOptions) -> Self {
        Self {
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
            output: match (options.json, options.supervised) {
                (_, true) => Output::Supervised,
                (true, false) => Output::Json,
                (false, false) => Output::Text,
            },
            started_ns: options.started_ns,
            record: options.record,
            slow: 1.0,
        }
    }
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

/// All of a program that ticks, with these devices beside the simulated one: does what its command
/// line says, and gives its exit status. To be called once, by `main`: it takes the signals of the
/// process, and ends the process itself where the command line is refused or asks for help.
pub fn main(devices: &DeviceRegistry) -> ExitCode {
    main_from(devices, std::env::args_os())
}

/// The same with another command line; its first word is the name of the program.
pub fn main_from(
    devices: &DeviceRegistry,
    words: impl IntoIterator<Item = impl Into<OsString> + Clone>,
) -> ExitCode {
    match Cli::parse_from(words).command {
        Command::Run(options) => run(devices, options),
        #[cfg(feature = "tunnel")]
        Command::Tunnel(args) => tunnel::run(&args),
    }
}

fn run(devices: &DeviceRegistry, options: RunOptions) -> ExitCode {
    realtime::rights::keep_heap_small();
    transport::logging::start();
    // Dropped after the link, and after an error was said.
    let _lines = transport::logging::queue();
    let stop = match signals::listen() {
        Ok(stop) => stop,
        Err(error) => return ended(FAILED, &format_args!("cannot listen to signals: {error}")),
    };
    let address = options.station.as_deref();
    let _link = match station_link::call(&options.domain, address, options.keys.as_deref()) {
        Ok(link) => link,
        Err(error) => return ended(BAD_INPUT, &error),
    };
    match run_until(devices, &options.into(), stop) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => ended(status(&error), &error),
    }
}

/// Says why it ended. The sentence waits with all else that is said, since nobody may be left to
/// read it: who writes it here would never end.
fn ended(status: u8, sentence: &dyn std::fmt::Display) -> ExitCode {
    note!("{sentence}");
    ExitCode::from(status)
}

/// The exit status of a program whose run has ended so: see the page of this module.
#[must_use]
pub fn status(error: &RunError) -> u8 {
    match error {
        RunError::SwitchedOff | RunError::TickHangs | RunError::Fetch(FetchError::Stopped) => {
            INTERRUPTED
        }
        RunError::Scene(..)
        | RunError::Fetch(..)
        | RunError::Transport(..)
        | RunError::Link(..)
        | RunError::Recording(..)
        | RunError::Fault(..)
        | RunError::Right(..)
        | RunError::TooSlow(..) => BAD_INPUT,
        RunError::NonFinite(..)
        | RunError::Thread(..)
        | RunError::TickPanicked(..)
        | RunError::LinkEnded
        | RunError::Print(..) => FAILED,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene::SceneError;
    use std::path::Path;

    #[test]
    fn a_run_that_failed_is_no_bad_input() {
        let input = RunError::Scene(SceneError("scene.toml, line 1: no".to_owned()));
        for (error, expected) in [
            (input, 2),
            (RunError::TickPanicked("on purpose".to_owned()), 1),
            (RunError::LinkEnded, 1),
            (RunError::NonFinite("force_n".to_owned()), 1),
            (RunError::Print(std::io::ErrorKind::StorageFull.into()), 1),
            (RunError::SwitchedOff, 130),
            (RunError::TickHangs, 130),
            // Nothing was wrong with what was typed.
            (RunError::Fetch(FetchError::Stopped), 130),
        ] {
            assert_eq!(status(&error), expected, "{error}");
        }
    }

    #[test]
    fn what_is_typed_is_what_a_run_gets() {
        #[derive(Parser)]
        struct Typed {
            #[command(flatten)]
            run: RunOptions,
        }
        let typed = "run scene.toml --seconds 3 --max-force 2.5 --json --device arm.toml";
        let typed = Typed::try_parse_from(typed.split(' ')).unwrap();
        let args = RunArgs::from(typed.run);
        assert_eq!(args.scene.as_deref(), Some(Path::new("scene.toml")));
        assert_eq!((args.seconds, args.output), (Some(3.0), Output::Json));
        assert_eq!(args.limits.max_force_n, Some(2.5));
        assert_eq!(args.overrides.devices, [PathBuf::from("arm.toml")]);
    }
}
