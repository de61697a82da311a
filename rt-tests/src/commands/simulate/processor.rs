//! A simulated processor, whose speed changes: what a tick takes on it, and whether the governor
//! keeps the ticks within their time.

use super::trace::{Checked, ensure};
use hrtc_core::governor::{CostGroup, MeasuredTick, WorkCosts};
use simulator::{Client, Random};

/// How many times slower than the reference machine a processor may be at full speed.
const SLOWEST_BASE: f64 = 4.0;
/// By how much each group of costs may be wrong on this processor: twice what measurements of a
/// machine differ by (`rt-tests costs`).
const COSTS_WRONG: f64 = 1.25;
/// Probability that something else takes time from a tick, and how much, in periods. Two such ticks
/// of three would be a slow processor.
const DISTURBED: f64 = 2e-3;
const DISTURBANCE: f64 = 0.5;
/// Ticks that the governor needs to see that the processor is slower: it believes two of three.
/// Ticks that are shorter than this share of what they may take tell it little.
const SEES: u64 = 2;
const LONG: f64 = 0.25;
/// Ticks at constant speed after which what was given up before is back: a second, at the 1 kHz of
/// all scenes here. Turns of the tolerance are counted from then on.
const SETTLED: u64 = 1_000;
/// By how much the governor may then believe the processor to be too slow: a thirtieth is left of
/// what it believed a second ago, the rest is for ticks that were disturbed.
const BELIEVED: f64 = 1.1;
/// The least slowness that it believes.
const LEAST_SLOWNESS: f64 = 0.8;

/// The processor of a controller.
#[derive(Debug)]
pub struct Processor {
    random: Random,
    period_ns: f64,
    /// How many times as long each group of work takes as at full speed, by which its costs are
    /// wrong.
    of_group: [f64; CostGroup::ALL.len()],
    /// How many times as long everything takes at full speed as on the reference machine.
    base: f64,
    /// How many times as long now.
    slow: f64,
    /// Ticks since that changed, and those of them that told the governor something.
    since: u64,
    seen: u64,
    /// Ticks since one was disturbed.
    alone: u64,
    /// The last tolerance, and whether its last change was upwards.
    last: Option<(f64, bool)>,
    turns: u64,
    /// Whether only its speed changes in this run.
    is_undisturbed: bool,
}

impl Processor {
    /// At full speed.
    #[must_use]
    pub fn new(mut random: Random, period_s: f64, is_undisturbed: bool) -> Self {
        let of_group = CostGroup::ALL.map(|_| COSTS_WRONG.powf(2.0 * random.unit() - 1.0));
        let base = SLOWEST_BASE.powf(random.unit());
        Self {
            random,
            period_ns: 1e9 * period_s,
            of_group,
            base,
            slow: base,
            since: 0,
            seen: 0,
            alone: 0,
            last: None,
            turns: 0,
            is_undisturbed,
        }
    }

    /// Everything takes so many times as long from now on.
    pub fn slow_down(&mut self, slow: f64) {
        self.slow = self.base * slow;
        self.since = 0;
        self.seen = 0;
        self.turns = 0;
    }

    /// A controller starts on it: it measures the costs first.
    pub fn start(&mut self, client: &mut Client) {
        let costs = WorkCosts::REFERENCE.scaled([self.slow; CostGroup::ALL.len()]);
        client.controller_mut().set_costs(costs);
        self.since = 0;
        self.seen = 0;
        self.last = None;
        self.turns = 0;
    }

    /// After a tick: how long it took, which the controller is told.
    ///
    /// # Errors
    /// When it took longer than it may.
    pub fn tick(&mut self, client: &mut Client) -> Checked {
        let may_be_late = self.seen < SEES;
        self.since += 1;
        let governor = client.controller().governor();
        let counted = governor.costs().tick / WorkCosts::REFERENCE.tick;
        let groups = governor.spent().by_group.into_iter().zip(self.of_group);
        let truly = self.slow / counted;
        let ns = truly * groups.map(|(ns, wrong)| ns * wrong).sum::<f64>();
        let slowness = governor.slowness();
        let record = client.outputs().record;
        ensure(
            record.spent_ns <= record.allowed_ns,
            "units of a tick",
            || format!("{} ns spent of {}", record.spent_ns, record.allowed_ns),
        )?;
        let is_long = f64::from(record.spent_ns) >= LONG * f64::from(record.allowed_ns);
        self.seen += u64::from(is_long);
        ensure(
            may_be_late || ns <= self.period_ns,
            "time of a tick",
            || format!("{ns:.0} ns on a processor {:.2} times slower", self.slow),
        )?;
        let wrong = self.of_group.into_iter().fold(0.0, f64::max);
        let believed = BELIEVED * (truly * wrong).max(LEAST_SLOWNESS);
        ensure(
            self.since <= SETTLED || slowness <= believed,
            "time is back",
            || format!("{slowness:.2} believed, {believed:.2} at the most"),
        )?;
        self.count_turns(record.finest_tolerance_m)?;
        self.alone += 1;
        let other = if self.random.happens(DISTURBED) && self.alone > 2 {
            self.alone = 0;
            DISTURBANCE * self.period_ns
        } else {
            0.0
        };
        client
            .controller_mut()
            .note_work(MeasuredTick::of_work((ns + other) as u32));
        Ok(())
    }

    /// How often the tolerance changes its direction while nothing else disturbs the run.
    fn count_turns(&mut self, now: f64) -> Checked {
        let (last, rose) = self.last.unwrap_or((now, true));
        let rises = if now == last { rose } else { now > last };
        self.last = Some((now, rises));
        let settled = self.since.saturating_sub(SETTLED);
        if settled == 0 || !self.is_undisturbed {
            return Ok(());
        }
        self.turns += u64::from(rises != rose);
        let seconds = 1e-9 * self.period_ns * settled as f64;
        ensure(
            self.turns as f64 <= 1.0 + seconds,
            "turns of the tolerance",
            || format!("{} in {seconds:.1} s", self.turns),
        )
    }
}
