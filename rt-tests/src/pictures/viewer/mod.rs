//! A run for the viewer [rerun](https://rerun.io): the touch in space and its numbers over time, on
//! one slider, afterwards or while the run goes on.
//!
//! The viewer gets what a replay of the recording gives. So nothing of it is in the controller's
//! process, and a mesh is shown only where the replay equals the controller's outputs, which is
//! checked at every tick.
//!
//! ```text
//! controller ── recording ──> follower ── twin ──> space, series ──> file or listening viewer
//! ```
//!
//! ```sh
//! rt-tests run SCENE --view                # a run, while it goes on
//! ve-station serve SCENE --view            # each of `hrtc run` on the same machine
//! rt-tests view RECORDING --rerun viewer   # one of them
//! rt-tests view RECORDING --rerun OUT.rrd  # afterwards; then `rerun OUT.rrd`
//! rerun OUT.rrd --headless --screenshot-to OUT.png --window-size 1400x950 --port auto
//! ```
//!
//! The station could show nothing of itself: it has neither samples nor fronts. The recording alone
//! has all inputs of the controller, and it lies on the controller's machine; so the viewer's
//! process runs there, after everything else, and a viewer that listens may be anywhere.
//!
//! | entity | shows |
//! |---|---|
//! | `world/object_K/mesh` | the front, coloured by certified error; the base mesh where it rests |
//! | `world/object_K/subscribed`, `predicted` | cells asked for ahead; cells of a predicted touch |
//! | `world/probe_K/device`, `proxy`, `force`, `normal` | a probe, and what holds it |
//! | `touch/axes/...` | the strongest touch from near, its normal upwards |
//! | `plots/...` | the worst of each hundredth of a second |

mod follower;
mod layout;
mod pace;
mod series;
mod shapes;
mod space;
mod touch;

use crate::failure::Failure;
use crate::processes::stop::is_set;
use follower::{Follower, LOOK, Reach};
use pace::{Medium, Pace};
use rerun::{RecordingStream, RecordingStreamBuilder, RecordingStreamError, SpawnOptions};
use series::Series;
use space::Space;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Name of the application, and of the line of time.
const APPLICATION: &str = "hrtc";
const TIMELINE: &str = "run";
/// Roots of both views of space.
const WORLD: &str = "world";
const TOUCH: &str = "touch";

/// Time that a viewer has to start and to answer, many times what it takes.
const ANSWER: Duration = Duration::from_secs(20);

/// What was sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sent {
    /// Time of the last tick, seconds of the run.
    pub seconds: f64,
    /// Ticks whose replay equals the controller's.
    pub ticks: u64,
    /// Pictures of space.
    pub frames: u64,
    /// Pictures of space that were left out, so that the file stays bounded.
    pub left_out: u64,
}

/// Sends a recording to its end, or behind the run that writes it until that ends or `stop` is set.
/// The target is a file, or the address of a viewer (`rerun+http://...`), or `viewer` for one on
/// this machine, which is started where none listens.
///
/// # Errors
/// When the recording cannot be read or has no tick, the file cannot be written, the viewer is not
/// there, or a tick does not replay.
pub fn show(
    recording: &Path,
    target: &str,
    stop: &AtomicBool,
    mut told: impl FnMut(f64),
) -> Result<Sent, Failure> {
    let failed = |error: RecordingStreamError| {
        Failure::Run(format!("{target}: rerun cannot write there ({error})"))
    };
    let mut follower = Follower::open(recording)?;
    let (stream, medium) = open(target).map_err(failed)?;
    layout::send(&stream, None).map_err(failed)?;
    if let Err(error) = stream.flush_with_timeout(ANSWER) {
        // Its end would wait for a viewer that is not there.
        std::mem::forget(stream);
        return Err(Failure::Run(format!("{target}: nothing listens ({error})")));
    }
    let mut space = Space::new(&follower.plan, follower.force_max_n);
    let mut series = Series::new(&stream).map_err(failed)?;
    let mut pace = Pace::new(medium);
    let (mut seconds, mut ticks, mut has_eye) = (0.0, 0, false);
    loop {
        let reach = follower.read(|plan, record, twin| {
            (seconds, ticks) = (record.tick as f64 / plan.loop_.rate_hz, ticks + 1);
            series.take(record);
            if pace.is_point_due(seconds) {
                series.send(&stream, seconds).map_err(failed)?;
            }
            if pace.is_frame_due(seconds) {
                let bytes = space.show(&stream, plan, record, twin);
                pace.sent(bytes.map_err(failed)?);
                if space.eye.is_some() && !has_eye {
                    has_eye = true;
                    layout::send(&stream, space.eye).map_err(failed)?;
                }
                told(seconds);
            }
            Ok(())
        })?;
        if reach == Reach::End || is_set(stop) {
            break;
        }
        std::thread::sleep(LOOK);
    }
    if ticks == 0 {
        let name = recording.display();
        return Err(Failure::Input(format!("{name}: there is no tick in it")));
    }
    let flushed = stream.flush_blocking();
    flushed.map_err(|error| Failure::Run(format!("{target}: {error}")))?;
    Ok(Sent {
        seconds,
        ticks,
        frames: pace.frames,
        left_out: pace.left_out,
    })
}

fn open(target: &str) -> Result<(RecordingStream, Medium), RecordingStreamError> {
    let builder = RecordingStreamBuilder::new(APPLICATION);
    if target == "viewer" {
        let options = SpawnOptions {
            // Of itself it would listen to the whole network.
            extra_args: ["--bind", "127.0.0.1"].map(str::to_owned).to_vec(),
            ..SpawnOptions::default()
        };
        return Ok((builder.spawn_opts(&options)?, Medium::Stream));
    }
    if target.contains("://") {
        return Ok((builder.connect_grpc_opts(target)?, Medium::Stream));
    }
    Ok((builder.save(target)?, Medium::File))
}
