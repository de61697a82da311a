//! The station and the controller as roles of this program.

use super::device_page::registry;
use super::own_domain::Hold;
use super::stop::stop_flag;
use crate::failure::Failure;
use clap::Args;
use scene::Overrides;
use scene_args::OverrideArgs;
use std::ffi::OsString;
use std::path::PathBuf;
use transport::Domain;

/// Loop of a scene as a command has it.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct LoopArgs {
    /// Ticks a second.
    #[arg(long)]
    pub rate: Option<f64>,
    /// Microseconds before a deadline that are spun.
    #[arg(long)]
    pub spin_us: Option<u64>,
    /// How many times as long every stage of a tick takes.
    #[arg(long)]
    pub slow: Option<f64>,
}

impl LoopArgs {
    /// As the scene takes them, with other values.
    #[must_use]
    pub fn with(self, others: &OverrideArgs) -> Overrides {
        Overrides {
            rate_hz: self.rate,
            spin_us: self.spin_us,
            ..others.overrides()
        }
    }

    /// As arguments of another process.
    #[must_use]
    pub fn typed(self) -> Vec<OsString> {
        let rate = self.rate.map(|rate| format!("--rate={rate}"));
        let spin = self.spin_us.map(|spin| format!("--spin-us={spin}"));
        let slow = self.slow.map(|slow| format!("--slow={slow}"));
        let all = rate.into_iter().chain(spin).chain(slow);
        all.map(OsString::from).collect()
    }
}

/// Arguments of the station's role.
#[derive(Debug, Args)]
pub struct StationArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// iceoryx2 domain.
    #[arg(long)]
    pub domain: String,
    /// Over the scene.
    #[command(flatten)]
    pub overrides: OverrideArgs,
    /// Over the scene's loop.
    #[command(flatten)]
    pub loop_: LoopArgs,
}

/// Arguments of the controller's role.
#[derive(Debug, Args)]
pub struct ControllerArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// iceoryx2 domain.
    #[arg(long)]
    pub domain: String,
    /// Length of the run, seconds.
    #[arg(long)]
    pub seconds: f64,
    /// Start of both processes on CLOCK_MONOTONIC, nanoseconds.
    #[arg(long)]
    pub started_ns: u64,
    /// First file of the recording, or "off".
    #[arg(long)]
    pub record: Option<PathBuf>,
    /// File with a device in place of that of the first probe.
    #[arg(long)]
    pub device: Option<PathBuf>,
    /// Over the scene.
    #[command(flatten)]
    pub overrides: OverrideArgs,
    /// Over the scene's loop.
    #[command(flatten)]
    pub loop_: LoopArgs,
}

/// Holds the domain's files: the command that started this role may end before it.
fn hold(domain: &str) -> Result<Hold, Failure> {
    Domain::new(domain)
        .and_then(|domain| Hold::on(&domain))
        .map_err(|error| Failure::Input(error.to_string()))
}

/// The station of a run.
///
/// # Errors
/// One sentence, with its status.
pub fn station(args: StationArgs) -> Result<(), Failure> {
    let stop = stop_flag()?;
    let _hold = hold(&args.domain)?;
    let serve = ve_station::serve::ServeArgs {
        scene: args.scene,
        domain: args.domain,
        overrides: args.loop_.with(&args.overrides),
        view: None,
        json: false,
    };
    ve_station::serve::serve(&serve, &stop)
        .map(drop)
        .map_err(|error| Failure::Input(error.to_string()))
}

/// The controller of a run.
///
/// # Errors
/// One sentence, with its status.
pub fn controller(args: ControllerArgs) -> Result<(), Failure> {
    let stop = stop_flag()?;
    let _hold = hold(&args.domain)?;
    let run = hrtc::run::RunArgs {
        seconds: Some(args.seconds),
        overrides: Overrides {
            devices: args.device.into_iter().collect(),
            ..args.loop_.with(&args.overrides)
        },
        output: hrtc::run::Output::Supervised,
        started_ns: Some(args.started_ns),
        record: args.record,
        slow: args.loop_.slow.unwrap_or(1.0),
        ..hrtc::run::RunArgs::new(&args.scene, &args.domain)
    };
    hrtc::run::run_with(&registry(), &run, &stop).map_err(|error| {
        let sentence = error.to_string();
        match hrtc::cli::status(&error) {
            2 => Failure::Input(sentence),
            _ => Failure::Run(sentence),
        }
    })
}
