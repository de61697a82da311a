//! `hrtc`: the controller alone.

use clap::{Args, Parser, Subcommand};
use hrtc::run::{Output, RunArgs, run};
use scene_args::OverrideArgs;
use signal_hook::consts::{SIGINT, SIGTERM};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

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
}

#[derive(Debug, Args)]
struct RunOptions {
    /// The scene file, the same that the station serves
    scene: PathBuf,
    /// Length of the run, seconds; until Ctrl-C when absent
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// iceoryx2 domain of the station
    #[arg(long, value_name = "NAME", default_value = "hrtc")]
    domain: String,
    /// Print the result as one JSON object
    #[arg(long, conflicts_with = "supervised")]
    json: bool,
    /// Print JSON lines for a supervisor: status, then the result
    #[arg(long)]
    supervised: bool,
    /// Record every input of every tick, for rt-tests replay
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    #[command(flatten)]
    overrides: OverrideArgs,
}

fn main() -> ExitCode {
    let Command::Run(options) = Cli::parse().command;
    transport::logging::start();
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        if let Err(error) = signal_hook::flag::register(signal, Arc::clone(&stop)) {
            eprintln!("hrtc: cannot listen to signals: {error}");
            return ExitCode::from(1);
        }
    }
    let output = match (options.json, options.supervised) {
        (_, true) => Output::Supervised,
        (true, false) => Output::Json,
        (false, false) => Output::Text,
    };
    let args = RunArgs {
        scene: options.scene,
        domain: options.domain,
        seconds: options.seconds,
        overrides: options.overrides.overrides(),
        output,
        started_ns: None,
        record: options.record,
    };
    match run(&args, &stop) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("hrtc: {error}");
            ExitCode::from(2)
        }
    }
}
