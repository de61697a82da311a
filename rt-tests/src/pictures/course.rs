//! The course of a run as it is sent: which of its ticks a viewer gets, up to the last one.

use super::follower::{Follower, LOOK, Reach};
use super::pace::{Medium, Pace};
use crate::failure::Failure;
use crate::processes::stop::is_set;
use hrtc::recorder::Twin;
use hrtc::tick_record::TickRecord;
use scene::ScenePlan;
use std::sync::atomic::AtomicBool;

/// What shows a run.
pub trait Screen {
    /// Takes a tick into the present stretch of the curves.
    fn take(&mut self, record: &TickRecord);

    /// Ends that stretch at a time of the run, seconds, with a point of each curve.
    ///
    /// # Errors
    /// When it cannot be sent.
    fn point(&mut self, seconds: f64) -> Result<(), Failure>;

    /// Shows space at the tick that the twin has just run; bytes sent.
    ///
    /// # Errors
    /// When it cannot be sent.
    fn frame(
        &mut self,
        plan: &ScenePlan,
        record: &TickRecord,
        twin: &Twin,
    ) -> Result<usize, Failure>;
}

/// What was sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sent {
    /// Time of the last tick, seconds of the run.
    pub seconds: f64,
    /// Ticks whose replay equals the controller's.
    pub ticks: u64,
    /// Ticks from the first one on that were passed over: they are not in the recording, or their
    /// inputs are not.
    pub passed_over: u64,
    /// Pictures of space.
    pub frames: u64,
    /// Pictures of space that were left out, so that the file stays bounded.
    pub left_out: u64,
}

/// Sends a recording to its end, or behind the run that writes it until that ends or `stop` is set;
/// gives the time of each picture to `told`, seconds of the run.
///
/// # Errors
/// Those of the screen, and when a tick gives other outputs than the controller's.
pub fn send(
    follower: &mut Follower,
    medium: Medium,
    screen: &mut impl Screen,
    stop: &AtomicBool,
    mut told: impl FnMut(f64),
) -> Result<Sent, Failure> {
    let mut pace = Pace::new(medium);
    let (mut seconds, mut ticks) = (0.0, 0);
    // Whether the last tick is in them.
    let (mut has_point, mut has_frame) = (true, true);
    // Pictures left out before it.
    let mut left_out = 0;
    loop {
        let reach = follower.read(|plan, record, twin| {
            (seconds, ticks) = (record.tick as f64 / plan.loop_.rate_hz, ticks + 1);
            screen.take(record);
            has_point = pace.is_point_due(seconds);
            if has_point {
                screen.point(seconds)?;
            }
            left_out = pace.left_out;
            has_frame = pace.is_frame_due(seconds);
            if has_frame {
                pace.sent(screen.frame(plan, record, twin)?);
                told(seconds);
            }
            Ok(())
        })?;
        if reach == Reach::End || is_set(stop) {
            break;
        }
        std::thread::sleep(LOOK);
    }
    // The end, which is not due yet: of the pictures one more than there is room for.
    if !has_point {
        screen.point(seconds)?;
    }
    if let Some((record, twin)) = follower.last().filter(|_| !has_frame) {
        // It may have been due without room.
        pace.left_out = left_out;
        pace.sent(screen.frame(&follower.plan, record, twin)?);
        told(seconds);
    }
    Ok(Sent {
        seconds,
        ticks,
        passed_over: follower.passed_over(),
        frames: pace.frames,
        left_out: pace.left_out,
    })
}
