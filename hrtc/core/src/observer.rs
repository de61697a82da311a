//! What the shell of a tick sees of it and tells it: the ends of its stages, and whether its time
//! is over.

use crate::contact::query::Surface;
use crate::contact::rigid_proxy::ToolProxy;
use crate::tuning::governor::{LAST_REFINEMENT, LAST_STEP, TIME_SHARE};
use geometry::Pose;

/// Stages of a tick, reported to an observer when they end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Inbox and prediction.
    Inbox,
    /// Splits and collapses.
    Refine,
    /// Boxes.
    Refit,
    /// Closest point and proxy.
    Query,
    /// Forces, limiter, reports.
    Force,
    /// Sampling, moving objects, broad phase; the first of a tick.
    BroadPhase,
}

/// Kinds of work that end where the time of a tick is over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Timed {
    /// Received data, splits, collapses and steps of geomorphs: by half of the period, later where
    /// reading the devices takes a part of it.
    Refinement,
    /// Steps and searches of the proxies: by six tenths of it, or as much later.
    Contact,
}

impl Timed {
    /// All.
    pub const ALL: [Self; 2] = [Self::Refinement, Self::Contact];

    /// The share of a period, from its planned start, after which none begins.
    #[must_use]
    pub fn last_begin(self) -> f64 {
        match self {
            Self::Refinement => LAST_REFINEMENT,
            Self::Contact => LAST_STEP,
        }
    }

    /// As [`Self::last_begin`] in a tick in which reading the devices took this share of a period,
    /// at least 0: of what that leaves of a tick's share, work begins in the same part.
    #[must_use]
    pub fn last_begin_after(self, read: f64) -> f64 {
        let last = self.last_begin();
        // A sum: where it took nothing, not a bit changes.
        last + read.min(TIME_SHARE) * (1.0 - last / TIME_SHARE)
    }
}

/// Observer of the ends of stages: a shell measures them without giving the core a clock.
///
/// It also tells whether the time for a kind of work is over. That is an input of the tick: a
/// recording has the answers (`hrtc`'s `TimeAnswers`), and gives the same bits by them.
pub trait StageObserver {
    /// A stage has ended.
    fn ended(&mut self, stage: Stage);

    /// Whether no more of a kind of work is to begin in this tick. Once it is over it stays so.
    fn is_over(&mut self, _work: Timed) -> bool {
        false
    }

    /// The tool of a probe is about to be advanced: what a reference needs to do the same.
    fn tool_before(&mut self, _probe: usize, _tool: &ToolBefore<'_>) {}
}

/// A tool before its proxy is advanced.
#[derive(Debug, Clone, Copy)]
pub struct ToolBefore<'a> {
    /// Its proxy; every change of the surface so far is noted.
    pub proxy: &'a ToolProxy,
    /// The surface.
    pub surface: Surface<'a>,
    /// The device, model units.
    pub goal: Pose,
}

/// Observes nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoObserver;

impl StageObserver for NoObserver {
    fn ended(&mut self, _: Stage) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_reading_of_the_devices_took_comes_before_the_time_of_the_core() {
        for work in Timed::ALL {
            assert_eq!(
                work.last_begin_after(0.0).to_bits(),
                work.last_begin().to_bits()
            );
            let mut before = 0.0;
            for read in [0.0, 0.1, 0.3, 0.5, 0.69] {
                let last = work.last_begin_after(read);
                assert!(
                    last > read && last > before && last < TIME_SHARE,
                    "{work:?} {last}"
                );
                before = last;
            }
            let most = work.last_begin_after(5.0);
            assert!((most - TIME_SHARE).abs() < 1e-12, "{work:?} {most}");
        }
    }
}
