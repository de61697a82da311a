//! Round-trip time and rate of the link to the station, measured from what is exchanged anyway, and
//! what follows from them: how long to wait, how much may be under way, how far to look ahead.

use super::chunk::InboxChunk;
use crate::cache::MAX_OUTSTANDING;
use crate::horizons::Horizons;
use crate::tuning::streaming::{
    FIRST_TIMEOUT_S, IN_TRANSIT, INCLUDED_S, MAX_LEAD_S, MIN_SPAN_S, MIN_WINDOW, QUEUE_S, QUEUED,
    RATE_SHARE, REGIONS_KEPT, REQUEST_SHARE, ROUND_TRIP_SHARE, VARIATION_SHARE, VARIATIONS,
};
use protocol::{CREDIT_CHUNKS, Request};

/// From when on the station could send a chunk at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Since {
    /// The tick.
    pub tick: u64,
    /// Whether it was asked for it before, and was allowed to send it then.
    pub is_of_credit: bool,
}

/// See the module. Times are in ticks; until something is measured the link counts as a local one.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct LinkMeter {
    rate_hz: f64,
    /// The shortest timeout.
    answer_timeout: u64,
    /// The timeout before a round trip was measured.
    first_timeout: u64,
    /// Smoothed round-trip time and its mean deviation.
    round_trip: Option<(f64, f64)>,
    /// Shortest round trip of the present span of time, and of the one before.
    least: [f64; 2],
    /// When the present span began.
    span_began: u64,
    /// Chunks that the inbox held after the last tick.
    left: usize,
    /// When a chunk arrived last.
    arrived: u64,
    /// Chunks that came while more was on its way, and in how many ticks; the older ones fade.
    flow: Option<(f64, f64)>,
    /// Chunks of answers, and regions that were answered by them; the older ones fade.
    regions: (f64, f64),
}

impl LinkMeter {
    /// Nothing measured yet.
    #[must_use]
    pub fn new(horizons: &Horizons) -> Self {
        Self {
            rate_hz: horizons.rate_hz,
            answer_timeout: horizons.answer_timeout,
            first_timeout: horizons.answer_timeout,
            round_trip: None,
            least: [f64::INFINITY; 2],
            span_began: 0,
            left: 0,
            arrived: 0,
            flow: None,
            regions: (0.0, 0.0),
        }
    }

    /// The station is on another machine: nothing is known of the first round trip.
    pub fn station_is_far(&mut self) {
        self.first_timeout = (FIRST_TIMEOUT_S * self.rate_hz).ceil() as u64;
    }

    /// A question that was put once is answered, so many ticks after it was put: one put twice says
    /// nothing (Karn's rule).
    pub fn answered(&mut self, ticks: u64, tick: u64) {
        let ticks = ticks as f64;
        // RFC 6298, 2.2 and 2.3.
        self.round_trip = Some(match self.round_trip {
            None => (ticks, 0.5 * ticks),
            Some((smoothed, variation)) => (
                smoothed + (ticks - smoothed) * ROUND_TRIP_SHARE,
                variation + ((ticks - smoothed).abs() - variation) * VARIATION_SHARE,
            ),
        });
        if tick.saturating_sub(self.span_began) as f64 > MIN_SPAN_S * self.rate_hz {
            self.least = [f64::INFINITY, self.least[0]];
            self.span_began = tick;
        }
        self.least[0] = self.least[0].min(ticks);
    }

    /// A chunk of answers is taken.
    pub fn answers_taken(&mut self) {
        self.regions.0 += 1.0;
    }

    /// The answer to a region is complete.
    pub fn region_ended(&mut self) {
        self.regions.1 += 1.0;
        if self.regions.1 >= REGIONS_KEPT {
            self.regions = (0.5 * self.regions.0, 0.5 * self.regions.1);
        }
    }

    /// Notes the chunks of a tick: `waiting` are in the inbox now. `since`: from when on the
    /// station could send the first new one at once.
    ///
    /// A link that stalls for a moment, as TCP does for a lost packet, looks thin. Then the window
    /// becomes so small that every chunk waits for its credit and none tells the rate of the link:
    /// so those that come at once tell it, and each that only waited for credit lets it be tried
    /// whether the link carries more. Chunks that no question waits for, as those of tours, tell
    /// nothing: they come as fast as they are made, and several at once where others were before.
    pub fn arrive(&mut self, waiting: usize, since: Option<Since>, tick: u64) {
        let came = waiting.saturating_sub(self.left);
        if came == 0 {
            return;
        }
        // It could when it sent the chunk before: only the link is between the two.
        let is_flow = self.left == 0
            && self.least_round_trip().is_some_and(|least| {
                since.is_some_and(|since| since.tick as f64 + least <= self.arrived as f64)
            });
        let keeps = 1.0 - RATE_SHARE;
        let fade = |(chunks, ticks): (f64, f64)| (keeps * chunks, keeps * ticks);
        if is_flow {
            let ticks = tick.saturating_sub(self.arrived) as f64;
            let (before, in_ticks) = fade(self.flow.unwrap_or_default());
            self.flow = Some((before + came as f64, in_ticks + ticks));
        } else if let (Some(flow), Some(since)) = (self.flow.filter(|_| self.left == 0), since) {
            let (chunks, ticks) = if came > 1 {
                let (before, in_ticks) = fade(flow);
                (before + (came - 1) as f64, in_ticks + 1.0)
            } else if since.is_of_credit {
                (flow.0, keeps * flow.1)
            } else {
                flow
            };
            self.flow = Some((chunks, ticks));
        }
        self.arrived = tick;
    }

    /// Chunks that the inbox held after the last tick.
    pub fn left(&self) -> usize {
        self.left
    }

    /// So many chunks are left in the inbox at the end of a tick.
    pub fn leave(&mut self, chunks: usize) {
        self.left = chunks;
    }

    /// The shortest round trip of late: what the link takes without a queue.
    fn least_round_trip(&self) -> Option<f64> {
        let least = self.least[0].min(self.least[1]);
        least.is_finite().then_some(least)
    }

    /// Chunks a tick; infinite while no limit was seen.
    fn rate(&self) -> f64 {
        self.flow
            .map_or(f64::INFINITY, |(chunks, ticks)| chunks / ticks)
    }

    /// Smoothed round-trip time, seconds: from a question to the first part of its answer.
    /// Negative when none was measured.
    #[must_use]
    pub fn round_trip_s(&self) -> f64 {
        self.round_trip
            .map_or(-1.0, |(ticks, _)| ticks / self.rate_hz)
    }

    /// Rate at which chunks come while more is on its way, bytes a second. Negative when no limit
    /// was seen.
    #[must_use]
    pub fn bytes_per_s(&self) -> f64 {
        let chunk = size_of::<InboxChunk>() as f64;
        self.flow
            .map_or(-1.0, |_| self.rate() * chunk * self.rate_hz)
    }

    /// Silence after which what was asked counts as lost, ticks (RFC 6298, 2.1 to 2.3); doubled
    /// with every silence of late (5.5).
    #[must_use]
    pub fn timeout(&self, silences: u32) -> u64 {
        let ticks = match self.round_trip {
            None => return self.first_timeout << silences,
            Some((smoothed, variation)) => smoothed + VARIATIONS * variation,
        };
        self.answer_timeout.max(ticks.ceil() as u64) << silences
    }

    /// Chunks that the link carries in two round trips, so that a higher rate would be seen, and in
    /// [`QUEUE_S`].
    fn carried(&self) -> f64 {
        let least = self.least_round_trip().unwrap_or(0.0);
        let chunks = self.rate() * (2.0 * least + QUEUE_S * self.rate_hz);
        chunks.max(MIN_WINDOW as f64)
    }

    /// Chunks that may be under way.
    #[must_use]
    pub fn window(&self) -> u64 {
        // `as` saturates.
        (self.carried().ceil() as u64).min(CREDIT_CHUNKS)
    }

    /// Chunks that the answer to a region takes.
    fn chunks_per_region(&self) -> f64 {
        let (chunks, regions) = self.regions;
        chunks.max(1.0) / regions.max(1.0)
    }

    /// Regions that may be outstanding: as many in a time as on a local link, but no more than
    /// twice what may be under way, so that the next question is still for what is needed most.
    #[must_use]
    pub fn most_questions(&self) -> usize {
        let local = CREDIT_CHUNKS as f64 * (1.0 + self.lead() / (INCLUDED_S * self.rate_hz));
        let twice = QUEUED * self.carried() / self.chunks_per_region();
        local
            .min(twice.max(MIN_WINDOW as f64))
            .min(f64::from(MAX_OUTSTANDING)) as usize
    }

    /// Regions, of those outstanding, whose answers may be under way already.
    #[must_use]
    pub fn questions_in_transit(&self) -> usize {
        (IN_TRANSIT * self.carried() / self.chunks_per_region()).ceil() as usize
    }

    /// Ticks until a region that is asked for now is here, behind so many that are outstanding; 0
    /// while nothing was measured.
    fn answer_ticks(&self, outstanding: usize) -> f64 {
        let regions = (outstanding + 1) as f64;
        let least = self.least_round_trip();
        least.map_or(0.0, |least| {
            least + regions * self.chunks_per_region() / self.rate()
        })
    }

    /// Whether a region that is asked for now, behind so many that are outstanding, is not here
    /// within `ticks`. Over a link that is as fast as the prediction's own times count with, none
    /// is called late.
    #[must_use]
    pub fn comes_late(&self, outstanding: usize, ticks: f64) -> bool {
        let answer = self.answer_ticks(outstanding);
        answer > INCLUDED_S * self.rate_hz && answer > ticks
    }

    /// Ticks between two requests at the least, so that they take a small share of a thin line.
    #[must_use]
    pub fn request_ticks(&self) -> u64 {
        let chunks = size_of::<Request>() as f64 / size_of::<InboxChunk>() as f64;
        (chunks / (REQUEST_SHARE * self.rate())) as u64
    }

    /// By how many ticks prediction is to lead beside what it looks ahead for a local link.
    #[must_use]
    pub fn lead(&self) -> f64 {
        (self.answer_ticks(0) - INCLUDED_S * self.rate_hz).clamp(0.0, MAX_LEAD_S * self.rate_hz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn meter() -> LinkMeter {
        LinkMeter::new(&Horizons::new(1000.0))
    }

    /// Of a chunk that was asked for long before it was allowed.
    fn since(tick: u64) -> Option<Since> {
        let is_of_credit = true;
        Some(Since { tick, is_of_credit })
    }

    /// A meter after answers of `round_trip` ticks, and a chunk every `gap` ticks of an answer that
    /// is on its way.
    fn after(round_trip: u64, gap: u64) -> LinkMeter {
        let mut meter = meter();
        for k in 0..200 {
            meter.answered(round_trip, k);
            meter.arrive(1, since(0), 1000 + k * gap);
            meter.leave(0);
        }
        meter
    }

    #[test]
    fn a_local_link_is_as_if_nothing_was_measured() {
        let (new, mut local) = (meter(), meter());
        for tick in 0..10_000 {
            local.answered(4, tick);
        }
        for of in [&new, &local] {
            assert_eq!((of.window(), of.lead()), (CREDIT_CHUNKS, 0.0));
            assert_eq!((of.most_questions(), of.request_ticks()), (32, 0));
            assert!(!of.comes_late(31, 0.0) && of.questions_in_transit() > 32);
        }
        assert_eq!((new.timeout(0), local.timeout(0)), (200, 200));
        assert_eq!(local.timeout(2), 800);
        let mut far = meter();
        far.station_is_far();
        assert_eq!((far.timeout(0), far.timeout(1)), (1000, 2000));
        far.answered(4, 0);
        assert_eq!(far.timeout(0), 200, "no farther than it is");
        assert!(new.round_trip_s() < 0.0 && new.bytes_per_s() < 0.0);
        assert!((local.round_trip_s() - 0.004).abs() < 1e-9);
    }

    #[test]
    fn a_timeout_is_longer_than_every_answer_of_late() {
        for round_trip in [100, 300, 1000] {
            let mut meter = meter();
            for tick in 0..1000 {
                let ticks = round_trip + 40 * (tick % 5);
                if tick > 100 {
                    assert!(meter.timeout(0) > ticks);
                }
                meter.answered(ticks, tick);
            }
        }
    }

    #[test]
    fn a_thin_line_carries_little_at_once() {
        let thin = after(30, 16);
        let chunk = size_of::<InboxChunk>() as f64;
        assert!((thin.bytes_per_s() / (chunk * 1000.0 / 16.0) - 1.0).abs() < 1e-3);
        assert!((MIN_WINDOW..8).contains(&thin.window()));
        assert!(thin.request_ticks() > 4);
        // Farther away, more is under way at the same rate.
        let far = after(300, 16);
        assert!(far.window() > 3 * thin.window() && far.lead() > thin.lead());
        assert!(far.most_questions() > thin.most_questions());
        // An answer takes the round trip and its own chunks, and those of the answers before it.
        assert!(thin.comes_late(0, 45.0) && !thin.comes_late(0, 47.0));
        assert!(far.comes_late(3, 363.0) && !far.comes_late(3, 365.0));
    }

    #[test]
    fn what_the_station_could_not_send_says_nothing_about_the_rate() {
        let mut meter = meter();
        meter.answered(100, 0);
        for k in 1..100 {
            // Asked for, or allowed, less than a round trip before the last one came.
            meter.arrive(1, since(200 * k - 150), 200 * k);
            meter.leave(0);
        }
        assert!(meter.bytes_per_s() < 0.0);
    }

    /// Round trips until as much may be under way again as before a time of stalls, where what is
    /// allowed arrives in bursts of so many.
    fn recovery(burst: u64) -> u64 {
        let mut meter = after(200, 1);
        let before = meter.window();
        let mut tick = 10_000;
        while meter.window() > 2 * MIN_WINDOW {
            assert!(tick < 1_000_000, "the link looks thin");
            meter.arrive(1, since(tick - 500), tick);
            tick += 200;
        }
        for round_trips in 0..1000 {
            if meter.window() >= before {
                return round_trips;
            }
            let allowed = tick;
            tick += 200;
            for burst in (0..meter.window().div_ceil(burst)).map(|_| burst) {
                meter.arrive(burst as usize, since(allowed), tick);
                tick += 1;
            }
        }
        panic!("{} chunks for ever", meter.window());
    }

    #[test]
    fn a_link_that_stalled_is_not_taken_for_a_thin_one() {
        for burst in [1, 2, 4] {
            let round_trips = recovery(burst);
            println!("in bursts of {burst}: {round_trips} round trips");
            assert!(round_trips < 60);
        }
    }

    #[test]
    fn the_shortest_round_trip_follows_a_link_that_changes() {
        let mut meter = meter();
        meter.answered(20, 0);
        for tick in (0..30_000).step_by(100) {
            meter.answered(120, tick);
        }
        assert!((meter.lead() - 90.0).abs() < 1e-9, "{}", meter.lead());
    }
}
