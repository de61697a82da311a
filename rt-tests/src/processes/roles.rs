//! The station and the controller as roles of this program.

use super::device_page::registry;
use super::stop::stop_flag;
use crate::failure::Failure;
use clap::Args;
use scene_args::OverrideArgs;
use std::path::PathBuf;

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
    /// Over the scene.
    #[command(flatten)]
    pub overrides: OverrideArgs,
}

/// The station of a run.
///
/// # Errors
/// One sentence, with its status.
pub fn station(args: StationArgs) -> Result<(), Failure> {
    let stop = stop_flag()?;
    let serve = ve_station::serve::ServeArgs {
        scene: args.scene,
        domain: args.domain,
        overrides: args.overrides.overrides(),
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
    let run = hrtc::run::RunArgs {
        scene: args.scene,
        domain: args.domain,
        seconds: Some(args.seconds),
        overrides: args.overrides.overrides(),
        output: hrtc::run::Output::Supervised,
        started_ns: Some(args.started_ns),
        record: args.record,
    };
    hrtc::run::run_with(&registry(), &run, &stop).map_err(|error| Failure::Input(error.to_string()))
}
