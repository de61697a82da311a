//! What a run remembers for whoever reads why it failed.

use hrtc_core::record::CoreRecord;
use serde::Serialize;
use simulator::Client;
use std::collections::VecDeque;
use std::fmt::Write;

/// Happenings kept.
const EVENTS: usize = 24;
/// Ticks of each controller kept.
const TICKS: usize = 8;

/// A check that did not hold.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Violation {
    /// Name of the check.
    pub check: String,
    /// The tick after which it did not hold.
    pub tick: u64,
    /// The controller.
    pub client: usize,
    /// What was found.
    pub found: String,
}

/// The end of a check: nothing, or what was found.
pub type Checked = Result<(), (&'static str, String)>;

/// Fails a check.
///
/// # Errors
/// When the condition does not hold, with the check and what was found.
pub fn ensure(holds: bool, check: &'static str, found: impl FnOnce() -> String) -> Checked {
    if holds { Ok(()) } else { Err((check, found())) }
}

/// Values of a tick.
#[derive(Debug, Clone, Copy)]
struct TickLine {
    client: usize,
    tick: u64,
    force_n: f64,
    record: CoreRecord,
    inbox: usize,
}

/// The last happenings and ticks of a run.
#[derive(Debug, Clone, Default)]
pub struct Trace {
    /// The tick that is being run.
    pub tick: u64,
    /// The controller that is being looked at.
    pub client: usize,
    events: VecDeque<(u64, String)>,
    ticks: VecDeque<TickLine>,
}

impl Trace {
    /// Notes a happening.
    pub fn event(&mut self, text: String) {
        if self.events.len() == EVENTS {
            self.events.pop_front();
        }
        self.events.push_back((self.tick, text));
    }

    /// Notes a tick of a controller.
    pub fn tick_of(&mut self, client: usize, of: &Client, clients: usize) {
        if self.ticks.len() >= TICKS * clients {
            self.ticks.pop_front();
        }
        let forces = of.outputs().wrenches.iter().map(|of| of.force.length());
        self.ticks.push_back(TickLine {
            client,
            tick: self.tick,
            force_n: forces.fold(0.0, f64::max),
            record: of.outputs().record,
            inbox: of.inbox_len(),
        });
    }

    /// The happenings, and the last ticks of the controller that failed.
    #[must_use]
    pub fn text(&self, client: usize) -> String {
        let mut text = String::from("what happened:\n");
        for (tick, event) in &self.events {
            let _ = writeln!(text, "  {tick:>6}  {event}");
        }
        let _ = writeln!(text, "the last ticks of controller {client}:");
        for line in self.ticks.iter().filter(|line| line.client == client) {
            let of = &line.record;
            let _ = writeln!(
                text,
                "  {:>6}  force {:.3} N, depth {:.2} mm, faces {}, {}{}splits {}, collapses {}, geomorphs {}, deferred {}, folds {} passed {}, loaded {}, work {}, queries {}, epochs ended {}, inbox {}",
                line.tick,
                line.force_n,
                of.depth_m * 1e3,
                of.active_faces,
                if of.contact { "contact, " } else { "" },
                if of.contact_full { "full, " } else { "" },
                of.vsplits,
                of.ecols,
                of.geomorphing,
                of.deferred,
                of.rejected_folds,
                of.passed_folds,
                of.vsps_loaded,
                of.work_units,
                of.query_work,
                of.resubscribed,
                line.inbox,
            );
        }
        text
    }
}
