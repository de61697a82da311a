//! `rt-tests replay`: a recording through the pure core again, tick by tick.

use crate::failure::Failure;
use crate::report::output::{print, print_json};
use crate::report::units::grouped;
use clap::Args;
use hrtc::recorder::{Replay, replay as replay_file};
use std::path::PathBuf;

/// Arguments of `rt-tests replay`.
#[derive(Debug, Args)]
pub struct ReplayArgs {
    /// A file of a recording; rt-tests run and hrtc run write one
    pub file: PathBuf,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 when the file is no whole recording, 1 when a tick gave other outputs.
pub fn replay(args: &ReplayArgs) -> Result<(), Failure> {
    let found = replay_file(&args.file).map_err(|error| Failure::Input(error.to_string()))?;
    if args.json {
        print_json(&found)?;
    } else if found.equal && found.ticks > 0 {
        print(&format!(
            "all {} ticks gave the recorded outputs, bit by bit{}\n",
            grouped(found.ticks),
            shortened(&found)
        ))?;
    }
    judge(&found, &args.file.display().to_string())
}

/// What the recording lacks.
fn shortened(found: &Replay) -> String {
    match found.holes.first() {
        Some(hole) => format!(
            "; ticks {} to {} are not in the recording: {}",
            hole.first, hole.last, hole.reason
        ),
        None if found.whole => String::new(),
        None => "; the recording has no end: it was cut short".to_string(),
    }
}

fn judge(found: &Replay, name: &str) -> Result<(), Failure> {
    if found.equal && found.ticks == 0 {
        return Err(Failure::Input(format!(
            "{name}: no tick of it replays by itself, since it has no keyframe{}",
            shortened(found)
        )));
    }
    if found.equal {
        return Ok(());
    }
    Err(Failure::Run(format!(
        "{name}: tick {} of this recording gives another {}; it was made by another build, or changed since",
        found.first_difference, found.field
    )))
}
