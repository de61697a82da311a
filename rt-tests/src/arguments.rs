//! The command line.

use crate::accuracy::AccuracyArgs;
use crate::bare::BareArgs;
use crate::compare::CompareArgs;
use crate::effects::EffectsArgs;
use crate::fronts::FrontsArgs;
use crate::jitter::JitterArgs;
use crate::load::LoadArgs;
use crate::predictors::PredictorsArgs;
use crate::replay::ReplayArgs;
use crate::run::RunArgs;
use crate::stability::StabilityArgs;
use crate::zwidth::ZwidthArgs;
use clap::{Args, Parser, Subcommand};
use scene::Overrides;
use std::ffi::OsString;
use std::path::PathBuf;

/// Runs the station and the controller together, measures them and reports.
#[derive(Debug, Parser)]
#[command(name = "rt-tests", version)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands; roles are this program as one of the processes that a command starts.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run both processes on a scene; ends with a report, with status 0 also when periods were missed
    Run(RunArgs),
    /// Measure the loop's timing beside a bare loop; status 0 only for the verdict "pass"
    Jitter(JitterArgs),
    /// Put a recording (run --record FILE) through the controller again; status 1 when a tick differs
    Replay(ReplayArgs),
    /// Show on any mesh that fronts are legal, certified and cheap; status 1 when a limit is broken
    Fronts(FrontsArgs),
    /// Show what accuracy costs: the same touch from the base mesh to the full mesh; status 1 when a check fails
    Accuracy(AccuracyArgs),
    /// Show what a query and an update cost beside parry's; status 1 when an answer is wrong or a limit broken
    Compare(CompareArgs),
    /// Show what each source of the prediction buys: the same motion with each alone and with all
    Predictors(PredictorsArgs),
    /// Run the hard cases, each with its measure, limit and verdict; status 1 when one fails
    Stability(StabilityArgs),
    /// Show what each effect of a scene costs a tick, and that one that is not listed costs nothing
    Effects(EffectsArgs),
    /// Measure how stiff a wall this machine can render: its period, the delay of its force, and theory beside it
    Zwidth(ZwidthArgs),
    /// The station of a run.
    #[command(hide = true)]
    RoleStation(RoleArgs),
    /// The controller of a run.
    #[command(hide = true)]
    RoleHrtc(ControllerArgs),
    /// A loop with an empty body, or with fixed arithmetic.
    #[command(hide = true)]
    RoleBare(BareArgs),
    /// Load on a core.
    #[command(hide = true)]
    RoleLoad(LoadArgs),
}

/// What the station's role is told.
#[derive(Debug, Args)]
pub struct RoleArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// iceoryx2 domain.
    #[arg(long)]
    pub domain: String,
    /// Over the scene.
    #[command(flatten)]
    pub overrides: OverrideArgs,
}

/// What the controller's role is told.
#[derive(Debug, Args)]
pub struct ControllerArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// iceoryx2 domain.
    #[arg(long)]
    pub domain: String,
    /// Length of the run.
    #[arg(long)]
    pub seconds: f64,
    /// Start of both processes on CLOCK_MONOTONIC.
    #[arg(long)]
    pub started_ns: u64,
    /// Where to record every input of every tick.
    #[arg(long)]
    pub record: Option<PathBuf>,
    /// Over the scene.
    #[command(flatten)]
    pub overrides: OverrideArgs,
}

/// What the command line says over the scene.
#[derive(Debug, Clone, Default, Args)]
pub struct OverrideArgs {
    /// Another model for the first object: an SPM or mesh file; the scene's size is kept
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Longest side of the first object, metres
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub size: Option<f64>,
    /// Speed of the tour, metres a second
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    pub speed: Option<f64>,
    /// Seed of the tour
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Limit of the controller's cache, such as 16MiB
    #[arg(long, value_name = "BYTES")]
    pub cache: Option<String>,
    /// Wanted error at the contact, metres; 0 is the full mesh
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub tolerance: Option<f64>,
}

impl OverrideArgs {
    /// As the scene takes them.
    #[must_use]
    pub fn overrides(&self) -> Overrides {
        Overrides {
            model: self.model.clone(),
            size_m: self.size,
            speed_m_per_s: self.speed,
            seed: self.seed,
            cache: self.cache.clone(),
            tolerance_m: self.tolerance,
        }
    }

    /// As they are typed again for a role; `=` keeps a negative number from being read as an option.
    #[must_use]
    pub fn typed(&self) -> Vec<OsString> {
        let mut typed = Vec::new();
        if let Some(model) = &self.model {
            typed.push("--model".into());
            typed.push(model.into());
        }
        let numbers = [
            ("size", self.size.map(|v| v.to_string())),
            ("speed", self.speed.map(|v| v.to_string())),
            ("seed", self.seed.map(|v| v.to_string())),
            ("cache", self.cache.clone()),
            ("tolerance", self.tolerance.map(|v| v.to_string())),
        ];
        for (name, value) in numbers {
            if let Some(value) = value {
                typed.push(format!("--{name}={value}").into());
            }
        }
        typed
    }
}
