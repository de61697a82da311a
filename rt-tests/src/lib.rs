//! Runs both processes, measures them and reports.
//!
//! | module | holds |
//! |---|---|
//! | [`run`], [`jitter`], [`replay`], [`accuracy`], [`compare`], [`predictors`], [`stability`], [`effects`], [`zwidth`] | the commands |
//! | [`supervise`], [`pair`] | this program again as a process, and the two of a run |
//! | [`bare`], [`load`] | the loop to compare with, and load on the other core |
//! | [`report`], [`plots`], [`histogram`], [`verdict`] | what it means, in words and pictures |
//! | [`fronts`] | proofs and figures of fronts on any mesh |
//! | [`models`], [`surface`] | meshes and exact distances that checks stand on |
//! | [`peers`] | other libraries, for comparison only |
//! | [`machine`] | where it was measured |

pub mod accuracy;
pub mod arguments;
pub mod bare;
pub mod compare;
pub mod effects;
pub mod failure;
pub mod fronts;
pub mod histogram;
pub mod jitter;
pub mod load;
pub mod machine;
pub mod models;
pub mod pair;
pub mod peers;
pub mod plots;
pub mod predictors;
pub mod replay;
pub mod report;
pub mod run;
pub mod stability;
pub mod supervise;
pub mod surface;
pub mod verdict;
pub mod zwidth;

use arguments::{Arguments, Command, ControllerArgs, RoleArgs};
use failure::Failure;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use supervise::stop_flag;

/// The scene for commands that need one and were given none.
pub const BUNDLED_SCENE: &str = include_str!("../../config/scenes/first-touch.toml");

/// A scene file: the one that was named, or the bundled one, written into a folder.
fn bundled_or(named: Option<&Path>, folder: &Path) -> Result<PathBuf, Failure> {
    if let Some(named) = named {
        return Ok(named.to_path_buf());
    }
    let path = folder.join("first-touch.toml");
    std::fs::write(&path, BUNDLED_SCENE).map_err(|error| Failure::write(&path, &error))?;
    Ok(path)
}

/// Does what was typed; says in one sentence on standard error why it could not.
#[must_use]
pub fn execute(arguments: Arguments) -> ExitCode {
    let done = match arguments.command {
        Command::Run(args) => run::run(&args),
        Command::Jitter(args) => jitter::jitter(&args),
        Command::Replay(args) => replay::replay(&args),
        Command::Fronts(args) => fronts::fronts(&args),
        Command::Accuracy(args) => accuracy::accuracy(&args),
        Command::Compare(args) => compare::compare(&args),
        Command::Predictors(args) => predictors::predictors(&args),
        Command::Stability(args) => stability::stability(&args),
        Command::Effects(args) => effects::effects(&args),
        Command::Zwidth(args) => zwidth::zwidth(&args),
        Command::RoleStation(args) => station(args),
        Command::RoleHrtc(args) => controller(args),
        Command::RoleBare(args) => stop_flag().and_then(|stop| bare::bare(&args, &stop)),
        Command::RoleLoad(args) => stop_flag().map(|stop| load::load(&args, &stop)),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            ExitCode::from(failure.status())
        }
    }
}

/// The station of a run.
fn station(args: RoleArgs) -> Result<(), Failure> {
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
fn controller(args: ControllerArgs) -> Result<(), Failure> {
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
    hrtc::run::run(&run, &stop).map_err(|error| Failure::Input(error.to_string()))
}
