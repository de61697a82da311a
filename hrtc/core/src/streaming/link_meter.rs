//! Round-trip time and rate of the link to the station, measured from what is exchanged anyway, and
//! what follows from them: how long to wait, how much may be under way, how far to look ahead.

use super::chunk::InboxChunk;
use crate::cache::MAX_OUTSTANDING;
use crate::horizons::Horizons;
use crate::tuning::streaming::{
    FAR_TIMEOUT_S, FIRST_TIMEOUT_S, FIRST_WINDOW, IN_TRANSIT, INCLUDED_S, MAX_LEAD_S, MIN_SPAN_S,
    MIN_WINDOW, QUEUE_S, QUEUED, RATE_SHARE, REGIONS_KEPT, REQUEST_SHARE, ROUND_TRIP_SHARE,
    VARIATION_SHARE, VARIATIONS, WAIT_SHARE,
};
use protocol::{CHUNK_SLOTS, CREDIT_CHUNKS, ChunkHeader, MAX_CREDIT_CHUNKS, Request};

/// How a chunk was sent, as its header says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sent {
    station: u64,
    clock_us: u32,
    waited_for_credit: bool,
}

impl Sent {
    /// What a header says.
    #[must_use]
    pub fn of(header: &ChunkHeader) -> Self {
        Self {
            station: header.station,
            clock_us: header.sent_us,
            waited_for_credit: header.waited_for_credit != 0,
        }
    }
}

/// The smallest of the values of late: of the present span of time, and of the one before.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Least {
    spans: [f64; 2],
    began: u64,
}

impl Least {
    fn new() -> Self {
        Self {
            spans: [f64::INFINITY; 2],
            began: 0,
        }
    }

    fn take(&mut self, value: f64, tick: u64, span: f64) {
        if tick.saturating_sub(self.began) as f64 > span {
            self.spans = [f64::INFINITY, self.spans[0]];
            self.began = tick;
        }
        self.spans[0] = self.spans[0].min(value);
    }

    fn get(&self) -> Option<f64> {
        let least = self.spans[0].min(self.spans[1]);
        least.is_finite().then_some(least)
    }
}

/// How long chunks take from a station: from its clock to ours, which have no common start, so that
/// only the differences between chunks mean anything.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Delay {
    station: u64,
    /// What its first chunk took, microseconds by the two clocks.
    first_us: u32,
    /// The least that chunks of late took, ticks more than the first.
    least: Least,
}

/// See the module. Times are in ticks; until something is measured the link counts as a local one.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct LinkMeter {
    rate_hz: f64,
    /// The shortest timeout.
    answer_timeout: u64,
    /// The timeout before a round trip was measured.
    first_timeout: u64,
    /// Chunks that the window may have so far (RFC 5681, 3.1): one more with each that comes, so
    /// that it doubles in a round trip, and a thin line is known before much is under way. A local
    /// link has all of them at once.
    slow_start: u64,
    /// Smoothed round-trip time and its mean deviation.
    round_trip: Option<(f64, f64)>,
    /// Shortest round trip.
    least: Least,
    /// Of the station that was heard last.
    delay: Option<Delay>,
    /// Chunks that the inbox held after the last tick.
    left: usize,
    /// When a chunk arrived last.
    arrived: u64,
    /// How long chunks of late waited on the link behind others, on the mean.
    waits: f64,
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
            slow_start: MAX_CREDIT_CHUNKS,
            round_trip: None,
            least: Least::new(),
            delay: None,
            left: 0,
            arrived: 0,
            waits: 0.0,
            flow: None,
            regions: (0.0, 0.0),
        }
    }

    /// The station is on another machine: nothing is known of the first round trip.
    pub fn station_is_far(&mut self) {
        self.first_timeout = (FIRST_TIMEOUT_S * self.rate_hz).ceil() as u64;
        let far_timeout = (FAR_TIMEOUT_S * self.rate_hz).ceil() as u64;
        self.answer_timeout = self.answer_timeout.max(far_timeout);
        self.slow_start = FIRST_WINDOW;
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
        self.least.take(ticks, tick, MIN_SPAN_S * self.rate_hz);
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

    /// Ticks for which a chunk that arrives now waited on the link behind others.
    fn waited_on_link(&mut self, sent: Sent, tick: u64) -> f64 {
        // The clocks wrap, the differences of their differences do not.
        let now_us = (tick as f64 * 1e6 / self.rate_hz) as u64 as u32;
        let delay_us = now_us.wrapping_sub(sent.clock_us);
        let delay = match &mut self.delay {
            Some(delay) if delay.station == sent.station => delay,
            delay => delay.insert(Delay {
                station: sent.station,
                first_us: delay_us,
                least: Least::new(),
            }),
        };
        let beyond_us = delay_us.wrapping_sub(delay.first_us).cast_signed();
        let ticks = 1e-6 * f64::from(beyond_us) * self.rate_hz;
        delay.least.take(ticks, tick, MIN_SPAN_S * self.rate_hz);
        delay.least.get().map_or(0.0, |least| ticks - least)
    }

    /// Notes the chunks of a tick: `waiting` are in the inbox now. `sent`: the first and the last
    /// of the new ones.
    ///
    /// The time between two chunks tells the rate of the link when the second was on the link
    /// already as the first arrived; else it tells what the station had to send, or might.
    ///
    /// A link that stalls for a moment, as TCP does for a lost packet, looks thin. Then the window
    /// becomes so small that every chunk waits for its credit and none tells the rate of the link.
    /// So those that come at once tell it: all but one were carried while the last was on the link.
    /// And each that only waited for credit lets it be tried whether the link carries more.
    pub fn arrive(&mut self, waiting: usize, sent: Option<[Sent; 2]>, tick: u64) {
        let came = waiting.saturating_sub(self.left);
        self.slow_start = MAX_CREDIT_CHUNKS.min(self.slow_start + came as u64);
        let Some([first, last]) = sent.filter(|_| came > 0) else {
            return;
        };
        let [waited, last_waited] = [first, last].map(|of| self.waited_on_link(of, tick));
        self.waits += (last_waited - self.waits) * WAIT_SHARE;
        let since_last = tick.saturating_sub(self.arrived) as f64;
        self.arrived = tick;
        if self.left > 0 {
            return;
        }
        let keeps = 1.0 - RATE_SHARE;
        let fade = |(chunks, ticks): (f64, f64)| (keeps * chunks, keeps * ticks);
        // The least delay has a chunk's own transfer in it.
        let transfer = 1.0 / self.rate();
        if waited + transfer >= since_last {
            let (chunks, ticks) = self.flow.map(fade).unwrap_or_default();
            self.flow = Some((chunks + came as f64, ticks + since_last));
        } else if came > 1 {
            let carried = ((came - 1) as f64, last_waited.max(1.0));
            let faded = self.flow.map(fade);
            self.flow = faded.map(|of| (of.0 + carried.0, of.1 + carried.1));
        } else if first.waited_for_credit {
            self.flow = self.flow.map(|(chunks, ticks)| (chunks, keeps * ticks));
        }
    }

    /// Chunks that the inbox held after the last tick.
    pub fn left(&self) -> usize {
        self.left
    }

    /// So many chunks are left in the inbox at the end of a tick.
    pub fn leave(&mut self, chunks: usize) {
        self.left = chunks;
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

    /// Smoothed round-trip time, ticks; 0 when none was measured.
    #[must_use]
    pub fn round_trip_ticks(&self) -> u64 {
        self.round_trip.map_or(0, |(ticks, _)| ticks.ceil() as u64)
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
        let least = self.least.get().unwrap_or(0.0);
        let chunks = self.rate() * (2.0 * least + QUEUE_S * self.rate_hz);
        chunks.max(MIN_WINDOW as f64)
    }

    /// As many in a time as so many chunks at once are on a local link.
    fn as_locally(&self, chunks: u64) -> f64 {
        chunks as f64 * (1.0 + self.lead() / (INCLUDED_S * self.rate_hz))
    }

    /// Chunks that may be under way.
    #[must_use]
    pub fn window(&self) -> u64 {
        // `as` saturates.
        let most = self.as_locally(CREDIT_CHUNKS);
        let most = most.min(self.slow_start as f64);
        self.carried().min(most).ceil() as u64
    }

    /// Records that may be under way, where prediction leads for the distance; else 0.
    #[must_use]
    pub fn records_in_transit(&self) -> u32 {
        if self.lead() > 0.0 {
            self.window() as u32 * CHUNK_SLOTS as u32
        } else {
            0
        }
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
        let local = self.as_locally(CREDIT_CHUNKS);
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

    /// Ticks that the link takes for the answer to a region that is asked for now, behind so many
    /// that are outstanding; 0 while no limit was seen.
    fn transfer_ticks(&self, outstanding: usize) -> f64 {
        (outstanding + 1) as f64 * self.chunks_per_region() / self.rate()
    }

    /// Whether a region that is asked for now, behind so many that are outstanding, is not here
    /// within `ticks` because the link is thin: then it would delay what can be. Where the link
    /// carries whatever is asked for, none is called late: it costs nothing, and the hand may come
    /// later or stay longer than predicted.
    ///
    /// Thin is a link on which chunks wait: one of TCP is slow at first, and what it carried then
    /// says little about what it can.
    #[must_use]
    pub fn comes_late(&self, outstanding: usize, ticks: f64) -> bool {
        let transfer = self.transfer_ticks(outstanding);
        let least = self.least.get().unwrap_or(0.0);
        let is_busy = self.waits.min(transfer) > INCLUDED_S * self.rate_hz;
        is_busy && least + transfer > ticks
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
        let answer = self
            .least
            .get()
            .map_or(0.0, |least| least + self.transfer_ticks(0));
        (answer - INCLUDED_S * self.rate_hz).clamp(0.0, MAX_LEAD_S * self.rate_hz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn meter() -> LinkMeter {
        LinkMeter::new(&Horizons::new(1000.0))
    }

    /// Of a chunk that was sent at a tick, for which it had waited for its credit.
    fn sent(tick: u64) -> Option<[Sent; 2]> {
        let sent = Sent {
            station: 1,
            // Any start of its clock, so that it wraps.
            clock_us: ((1000 * tick) as u32).wrapping_sub(20_000),
            waited_for_credit: true,
        };
        Some([sent; 2])
    }

    /// A meter after answers of `round_trip` ticks, and a chunk every `gap` ticks of an answer that
    /// is on its way.
    fn after(round_trip: u64, gap: u64) -> LinkMeter {
        let mut meter = meter();
        for k in 0..200 {
            meter.answered(round_trip, k);
            // Four are on the link at a time.
            meter.arrive(1, sent(1000 + k.saturating_sub(3) * gap), 1100 + k * gap);
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
        assert_eq!(far.timeout(0), 300, "what TCP repeats is not lost");
        assert!(new.round_trip_s() < 0.0 && new.bytes_per_s() < 0.0);
        assert!((local.round_trip_s() - 0.004).abs() < 1e-9);
    }

    #[test]
    fn the_window_of_a_far_station_doubles_in_a_round_trip() {
        let mut meter = meter();
        assert_eq!(meter.window(), CREDIT_CHUNKS);
        meter.station_is_far();
        meter.answered(200, 0);
        let mut windows = Vec::new();
        for round_trip in 1..6 {
            let window = meter.window();
            meter.arrive(window as usize, sent(200 * round_trip), 200 * round_trip);
            meter.leave(0);
            windows.push(window);
        }
        assert_eq!(windows, [8, 16, 32, 64, 64]);
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
        assert!(thin.comes_late(1, 61.0) && !thin.comes_late(1, 63.0));
        assert!(far.comes_late(3, 363.0) && !far.comes_late(3, 365.0));
        // The distance alone is no reason.
        assert!(!far.comes_late(0, 0.0) && !after(300, 1).comes_late(20, 0.0));
    }

    #[test]
    fn nothing_is_late_on_a_link_that_was_slow_only_at_first() {
        let mut link = after(200, 16);
        assert!(link.comes_late(10, 200.0));
        // What is asked for now comes without waiting, though the rate that was seen is still low.
        for k in 0..16 {
            let tick = 10_000 + 100 * k;
            link.arrive(1, sent(tick - 100), tick);
            link.leave(0);
        }
        assert!(link.transfer_ticks(10) > 30.0);
        assert!(!link.comes_late(10, 200.0));
    }

    #[test]
    fn what_the_station_sends_at_its_own_pace_says_nothing_about_the_rate() {
        for jitter in [0, 3] {
            let mut meter = meter();
            meter.answered(100, 0);
            for k in 1..1000 {
                let is_late = k % 2 == 0;
                let delay = 100 + if is_late { jitter } else { 0 };
                meter.arrive(1, sent(7 * k), 7 * k + delay);
                meter.leave(0);
            }
            assert!(meter.bytes_per_s() < 0.0);
        }
    }

    #[test]
    fn another_station_has_another_clock() {
        let mut meter = meter();
        for k in 1..1000 {
            let station = 1 + k / 100;
            let began_us = station as u32 * 0x1234_5678;
            let of = sent(7 * k).map(|of| {
                of.map(|of| Sent {
                    station,
                    clock_us: of.clock_us.wrapping_add(began_us),
                    ..of
                })
            });
            meter.arrive(1, of, 7 * k + 100);
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
            // It stalls for longer and longer.
            meter.arrive(1, sent(tick - 250 - tick / 4), tick);
            meter.leave(0);
            tick += 200;
        }
        for round_trips in 0..1000 {
            if meter.window() >= before {
                return round_trips;
            }
            let allowed = tick;
            tick += 200;
            for burst in (0..meter.window().div_ceil(burst)).map(|_| burst) {
                meter.arrive(burst as usize, sent(allowed), tick);
                meter.leave(0);
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
