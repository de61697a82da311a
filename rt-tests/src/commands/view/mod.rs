//! `rt-tests view`: a touch of a recording as a picture, a film, or in the viewer rerun.

mod rerun;

use crate::failure::Failure;
use crate::pictures::check_target;
use crate::pictures::playback::Playback;
use crate::pictures::shots::{FRAME_MS, Shots};
use crate::report::output::{print, status_line, write_whole};
use clap::Args;
use picture::{PictureError, animation};
use std::path::PathBuf;
use ve_station::output::{OutputError, check_output};

/// Arguments of `rt-tests view`.
#[derive(Debug, Args)]
pub struct ViewArgs {
    /// The first file of a recording; rt-tests run and hrtc run write one
    pub file: PathBuf,
    /// The picture, a PNG file [default: touch.png, or touch-film.png]
    #[arg(short, long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// The moment, seconds since the start of the run [default: that of the greatest force in
    /// contact]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    pub at: Option<f64>,
    /// Write an animation of the time around the moment, an animated PNG file, as browsers show it
    #[arg(long)]
    pub film: bool,
    /// Write all of the run for the viewer rerun, up to its end, also while it is recorded: a file
    /// (OUT.rrd), rerun+http://HOST:PORT/proxy for one that listens, or "viewer" for one on this
    /// machine (pip install rerun-sdk==0.36.3). Needs a build with --features view
    #[arg(long, value_name = "OUT", conflicts_with_all = ["out", "at", "film"])]
    pub rerun: Option<String>,
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 when the recording cannot be used or does not reach there, 1 when a tick
/// of it does not replay.
pub fn view(args: &ViewArgs) -> Result<(), Failure> {
    let refused = |error: OutputError| Failure::Input(error.to_string());
    if let Some(target) = &args.rerun {
        check_target(target, &args.file)?;
        return rerun::view(&args.file, target);
    }
    let default = if args.film {
        "touch-film.png"
    } else {
        "touch.png"
    };
    let out = args.out.clone().unwrap_or_else(|| PathBuf::from(default));
    check_output(&out, &args.file, "png").map_err(refused)?;
    let line = status_line();
    line.set_message("reading the recording");
    let playback = Playback::open(&args.file)?;
    let tick = match args.at {
        Some(seconds) => playback.tick_at(seconds)?,
        None => playback.shown_tick(),
    };
    let shots = Shots::new(&playback);
    line.set_message("replaying up to the moment");
    let failed = |error: PictureError| Failure::Run(error.to_string());
    let (shown, bytes) = if args.film {
        let film = shots.film(tick, |count| line.set_message(format!("picture {count}")));
        let (shown, pictures) = film?;
        line.set_message("encoding");
        (shown, animation(&pictures, FRAME_MS).map_err(failed)?)
    } else {
        let (shown, picture) = shots.still(tick)?;
        (shown, picture.to_png().map_err(failed)?)
    };
    line.finish_and_clear();
    write_whole(&out, &bytes)?;
    let seconds = playback.seconds(shown);
    print(&format!(
        "the touch at {seconds:.3} s (tick {shown}) in {}\n",
        out.display()
    ))
}
