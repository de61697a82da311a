//! The command line.

use crate::commands::accuracy::AccuracyArgs;
use crate::commands::check::CheckArgs;
use crate::commands::codecs::CodecsArgs;
use crate::commands::compare::CompareArgs;
use crate::commands::costs::CostsArgs;
use crate::commands::deadline::DeadlineArgs;
use crate::commands::effects::EffectsArgs;
use crate::commands::export::ExportArgs;
use crate::commands::faults::FaultsArgs;
use crate::commands::fronts::FrontsArgs;
use crate::commands::hosts::HostsArgs;
use crate::commands::jitter::JitterArgs;
use crate::commands::policies::PoliciesArgs;
use crate::commands::predictors::PredictorsArgs;
use crate::commands::replay::ReplayArgs;
use crate::commands::run::RunArgs;
use crate::commands::simulate::SimulateArgs;
use crate::commands::stability::StabilityArgs;
use crate::commands::thesis::ThesisArgs;
use crate::commands::tools::ToolsArgs;
use crate::commands::tune::TuneArgs;
use crate::commands::view::ViewArgs;
use crate::commands::zwidth::ZwidthArgs;
use crate::processes::bare_loop::BareArgs;
use crate::processes::device_page::DeviceArgs;
use crate::processes::load::LoadArgs;
use crate::processes::roles::{ControllerArgs, StationArgs};
use clap::{Parser, Subcommand};

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
    /// Run both processes on a scene; ends with a report, with status 0 also when periods were
    /// missed
    Run(RunArgs),
    /// Rate this machine for haptics in a minute: loop, rights, force and speed, with remedies
    Check(CheckArgs),
    /// Measure the loop's timing beside a bare loop; status 0 only for the verdict "pass"
    Jitter(JitterArgs),
    /// Put a recording of a run through the controller again; status 1 when a tick differs
    Replay(ReplayArgs),
    /// Show a moment of a recording: the object, what of it was refined, the touch and its force
    View(ViewArgs),
    /// Write the ticks of a recording as CSV tables
    Export(ExportArgs),
    /// Show on any mesh that fronts are legal, certified and cheap; status 1 when a limit is broken
    Fronts(FrontsArgs),
    /// Show what accuracy costs: the same touch from the base mesh to the full mesh; status 1 when
    /// a check fails
    Accuracy(AccuracyArgs),
    /// Measure the figures of the thesis on its models, with its published numbers beside ours
    Thesis(ThesisArgs),
    /// Show what a query and an update cost beside parry's; status 1 when an answer is wrong or a
    /// limit broken
    Compare(CompareArgs),
    /// Show what a unit of each kind of a tick's work costs on this machine
    Costs(CostsArgs),
    /// Run hard scenes as on machines that are several times slower: whether every deadline is
    /// kept, and at what error; status 1 when one is not
    Deadline(DeadlineArgs),
    /// Compare the policies of detail at equal time on the scenes of `deadline`, in virtual time;
    /// status 1 when the default is not the better one
    Policies(PoliciesArgs),
    /// Show what each source of the prediction buys: the same motion with each alone and with all
    Predictors(PredictorsArgs),
    /// Run the hard cases, each with its measure, limit and verdict; status 1 when one fails
    Stability(StabilityArgs),
    /// Run both cores through random faults in virtual time, with checks after every tick; status 1
    /// when one fails
    Simulate(SimulateArgs),
    /// Show what each effect of a scene costs a tick, and that one that is not listed costs nothing
    Effects(EffectsArgs),
    /// Find how stiff a wall a loop with this machine's period can render: long simulated
    /// touches, and theory beside them
    Zwidth(ZwidthArgs),
    /// Find the settings of a scene that keep a limit of error, time, bytes or memory on this
    /// machine; status 1 when there are none
    Tune(TuneArgs),
    /// Lead tools over models, every tick beside one with unlimited work; status 1 when a limit is
    /// not kept
    Tools(ToolsArgs),
    /// Kill, stop, replace and starve real processes in contact; status 1 when a case fails
    Faults(FaultsArgs),
    /// Touch on two hosts, over links of any round-trip time and bandwidth, and on one machine
    /// beside; makes the hosts itself, which takes root
    Hosts(HostsArgs),
    /// Show what records and closures cost on the wire by codec, and what coding takes
    Codecs(CodecsArgs),
    /// The station of a run.
    #[command(hide = true)]
    RoleStation(StationArgs),
    /// The controller of a run.
    #[command(hide = true)]
    RoleHrtc(ControllerArgs),
    /// A device in a process of its own.
    #[command(hide = true)]
    RoleDevice(DeviceArgs),
    /// A loop with an empty body, or with fixed arithmetic.
    #[command(hide = true)]
    RoleBare(BareArgs),
    /// Load on a core.
    #[command(hide = true)]
    RoleLoad(LoadArgs),
}
