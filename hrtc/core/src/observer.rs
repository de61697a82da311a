//! What the shell of a tick sees of it and tells it: the ends of its stages, and whether its time
//! is over.

use crate::contact::query::Surface;
use crate::contact::rigid_proxy::ToolProxy;
use crate::tuning::governor::{LAST_REFINEMENT, LAST_STEP};
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
    /// Received data, splits, collapses and steps of geomorphs: by half of the period.
    Refinement,
    /// Steps and searches of the proxies: by six tenths of it.
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
