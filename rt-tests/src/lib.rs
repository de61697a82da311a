//! Runs both processes, measures them and reports.
//!
//! | module | holds |
//! |---|---|
//! | [`arguments`] | the command line |
//! | [`commands`] | the commands, one file or folder each |
//! | [`cases`] | the hard cases of `stability` |
//! | [`trajectory`] | a touch recorded in virtual time, to be given to many settings |
//! | [`processes`] | this program again as other processes |
//! | [`links`] | hosts on this machine, and the links between them |
//! | [`scenes`] | the scene of a command and what the command line changes in it |
//! | [`models`] | meshes, fronts on them, and exact distances |
//! | [`peers`] | other libraries, for comparison only |
//! | [`pictures`] | pictures of a touch, from its recording |
//! | [`report`] | numbers in words, tables, pictures, pages and files |
//! | [`clocks`] | times of single pieces of work |
//! | [`machine`], [`failure`] | where it was measured; how a command fails |

pub mod arguments;
pub mod cases;
pub mod clocks;
pub mod commands;
pub mod failure;
pub mod links;
pub mod machine;
pub mod models;
pub mod peers;
pub mod pictures;
pub mod processes;
pub mod report;
pub mod scenes;
pub mod trajectory;

use arguments::{Arguments, Command};
use failure::Failure;
use processes::stop::stop_flag;
use processes::{bare_loop, device_page, load, roles};
use std::process::ExitCode;

/// Runs a command; says in one sentence on standard error why it failed.
#[must_use]
pub fn execute(arguments: Arguments) -> ExitCode {
    match dispatch(arguments.command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            ExitCode::from(failure.status())
        }
    }
}

fn dispatch(command: Command) -> Result<(), Failure> {
    match command {
        Command::Run(args) => commands::run::run(&args),
        Command::Check(args) => commands::check::check(&args),
        Command::Jitter(args) => commands::jitter::jitter(&args),
        Command::Replay(args) => commands::replay::replay(&args),
        Command::View(args) => commands::view::view(&args),
        Command::Export(args) => commands::export::export(&args),
        Command::Fronts(args) => commands::fronts::fronts(&args),
        Command::Accuracy(args) => commands::accuracy::accuracy(&args),
        Command::Thesis(args) => commands::thesis::thesis(&args),
        Command::Compare(args) => commands::compare::compare(&args),
        Command::Costs(args) => commands::costs::costs(&args),
        Command::Deadline(args) => commands::deadline::deadline(&args),
        Command::Policies(args) => commands::policies::policies(&args),
        Command::Predictors(args) => commands::predictors::predictors(&args),
        Command::Stability(args) => commands::stability::stability(&args),
        Command::Simulate(args) => commands::simulate::simulate(&args),
        Command::Effects(args) => commands::effects::effects(&args),
        Command::Tools(args) => commands::tools::tools(&args),
        Command::Tune(args) => commands::tune::tune(&args),
        Command::Zwidth(args) => commands::zwidth::zwidth(&args),
        Command::Faults(args) => commands::faults::faults(&args),
        Command::Hosts(args) => commands::hosts::hosts(&args),
        Command::Codecs(args) => commands::codecs::codecs(&args),
        Command::RoleStation(args) => roles::station(args),
        Command::RoleHrtc(args) => roles::controller(args),
        Command::RoleDevice(args) => device_page::device(&args, &*stop_flag()?),
        Command::RoleBare(args) => bare_loop::bare(&args, &*stop_flag()?),
        Command::RoleLoad(args) => load::load(&args, &*stop_flag()?),
    }
}
