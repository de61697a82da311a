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

mod layout;
mod series;
mod shapes;
mod space;
mod touch;

use super::course::{Screen, Sent, send};
use super::follower::Follower;
use super::pace::Medium;
use crate::failure::Failure;
use hrtc::recorder::Twin;
use hrtc::tick_record::TickRecord;
use rerun::{RecordingStream, RecordingStreamBuilder, RecordingStreamError, SpawnOptions};
use scene::ScenePlan;
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
    told: impl FnMut(f64),
) -> Result<Sent, Failure> {
    let failed = |error: RecordingStreamError| refused(target, &error);
    let mut follower = Follower::open(recording)?;
    let (stream, medium) = open(target).map_err(failed)?;
    layout::send(&stream, None).map_err(failed)?;
    if let Err(error) = stream.flush_with_timeout(ANSWER) {
        // Its end would wait for a viewer that is not there.
        std::mem::forget(stream);
        return Err(Failure::Run(format!("{target}: nothing listens ({error})")));
    }
    let mut screen = Rerun {
        target,
        stream: &stream,
        space: Space::new(&follower.plan, follower.force_max_n),
        series: Series::new(&stream).map_err(failed)?,
        has_eye: false,
    };
    let sent = send(&mut follower, medium, &mut screen, stop, told)?;
    if sent.ticks == 0 {
        let name = recording.display();
        return Err(Failure::Input(format!("{name}: there is no tick in it")));
    }
    let flushed = stream.flush_blocking();
    flushed.map_err(|error| Failure::Run(format!("{target}: {error}")))?;
    Ok(sent)
}

/// The viewer, or a file for it.
struct Rerun<'a> {
    /// As the user named it.
    target: &'a str,
    stream: &'a RecordingStream,
    space: Space,
    series: Series,
    /// Whether the layout has the eye of the first touch.
    has_eye: bool,
}

impl Screen for Rerun<'_> {
    fn take(&mut self, record: &TickRecord) {
        self.series.take(record);
    }

    fn point(&mut self, seconds: f64) -> Result<(), Failure> {
        let sent = self.series.send(self.stream, seconds);
        sent.map_err(|error| refused(self.target, &error))
    }

    fn frame(
        &mut self,
        plan: &ScenePlan,
        record: &TickRecord,
        twin: &Twin,
    ) -> Result<usize, Failure> {
        let failed = |error: RecordingStreamError| refused(self.target, &error);
        let bytes = self.space.show(self.stream, plan, record, twin);
        let bytes = bytes.map_err(failed)?;
        if self.space.eye.is_some() && !self.has_eye {
            self.has_eye = true;
            layout::send(self.stream, self.space.eye).map_err(failed)?;
        }
        Ok(bytes)
    }
}

fn refused(target: &str, error: &RecordingStreamError) -> Failure {
    Failure::Run(format!("{target}: rerun cannot write there ({error})"))
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
