//! Round-trip time and rate of the link to the station, measured from what is exchanged anyway, and
//! what follows from them: how long to wait, how much may be under way, how far to look ahead.
//!
//! Link and station go on while periods are skipped: what is measured is measured by the clock,
//! skipped periods too ([`LinkMeter::clock`]). When in them a chunk came is not known, so a
//! measurement that may be by so much too long changes what is believed only beyond that.

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

/// See the module. Times are in periods, ticks that were run and skipped ones; until something is
/// measured the link counts as a local one.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct LinkMeter {
    rate_hz: f64,
    /// Periods that were skipped so far.
    skipped: u64,
    /// Periods within which chunks that wait now may have come unseen.
    unseen: u64,
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
            skipped: 0,
            unseen: 0,
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

    /// A tick begins, after so many skipped periods.
    pub fn begin_tick(&mut self, skipped: u64) {
        self.skipped = self.skipped.saturating_add(skipped);
        let before = if self.left > 0 { self.unseen } else { 0 };
        self.unseen = before.max(skipped);
    }

    /// The time in a tick of those that were run, periods: skipped ones count.
    #[must_use]
    pub fn clock(&self, tick: u64) -> u64 {
        tick.saturating_add(self.skipped)
    }

    /// What is believed after a measurement that may be too long by what came unseen: the same,
    /// where that explains it.
    fn within(&self, believed: f64, measured: f64) -> f64 {
        believed.max(measured - self.unseen as f64).min(measured)
    }

    /// A question that was put once is answered, so long after it was put by the
    /// [`LinkMeter::clock`]: one put twice says nothing (Karn's rule).
    pub fn answered(&mut self, periods: u64, tick: u64) {
        let measured = periods as f64;
        // RFC 6298, 2.2 and 2.3.
        self.round_trip = Some(match self.round_trip {
            None => {
                let first = self.within(0.0, measured);
                (first, 0.5 * first)
            }
            Some((smoothed, variation)) => {
                let ticks = self.within(smoothed, measured);
                (
                    smoothed + (ticks - smoothed) * ROUND_TRIP_SHARE,
                    variation + ((ticks - smoothed).abs() - variation) * VARIATION_SHARE,
                )
            }
        });
        let now = self.clock(tick);
        self.least.take(measured, now, MIN_SPAN_S * self.rate_hz);
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

    /// Periods for which a chunk that arrives now waited on the link behind others, or here unseen.
    fn waited_on_link(&mut self, sent: Sent, now: u64) -> f64 {
        // The clocks wrap, the differences of their differences do not.
        let now_us = (now as f64 * 1e6 / self.rate_hz) as u64 as u32;
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
        delay.least.take(ticks, now, MIN_SPAN_S * self.rate_hz);
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
    ///
    /// One that came in skipped periods counts as if it had not waited in them; those that come at
    /// once after a stall came in at most that time.
    pub fn arrive(&mut self, waiting: usize, sent: Option<[Sent; 2]>, tick: u64) {
        let came = waiting.saturating_sub(self.left);
        self.slow_start = MAX_CREDIT_CHUNKS.min(self.slow_start + came as u64);
        let Some([first, last]) = sent.filter(|_| came > 0) else {
            return;
        };
        let now = self.clock(tick);
        let [waited, last_waited] = [first, last].map(|of| self.waited_on_link(of, now));
        let waits = self.within(self.waits, last_waited);
        self.waits += (waits - self.waits) * WAIT_SHARE;
        let since_last = now.saturating_sub(self.arrived) as f64;
        self.arrived = now;
        if self.left > 0 {
            return;
        }
        let keeps = 1.0 - RATE_SHARE;
        let fade = |(chunks, ticks): (f64, f64)| (keeps * chunks, keeps * ticks);
        // The least delay has a chunk's own transfer in it.
        let transfer = 1.0 / self.rate();
        let unseen = self.unseen as f64;
        if waited - unseen + transfer >= since_last {
            let (chunks, ticks) = self.flow.map(fade).unwrap_or_default();
            self.flow = Some((chunks + came as f64, ticks + since_last));
        } else if came > 1 {
            let carried = ((came - 1) as f64, last_waited.max(1.0) + unseen);
            let faded = self.flow.map(fade);
            // After a stall the time is an upper bound: it may only raise the rate.
            if unseen == 0.0 || carried.0 > carried.1 * self.rate() {
                self.flow = faded.map(|of| (of.0 + carried.0, of.1 + carried.1));
            }
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
mod tests;
