//! The station that is heard, and for how long its silence means nothing.

use crate::tuning::{HELLO_PERIOD, ROUND_TRIPS_OF_SILENCE, STATION_TIMEOUT};
use std::time::{Duration, Instant};

/// The living station. Time is given in.
#[derive(Debug, Default)]
pub struct StationHeard {
    /// Its incarnation, and its last sign of life.
    last: Option<(u64, Instant)>,
    /// What the link adds to every silence.
    link: Duration,
}

impl StationHeard {
    /// The round-trip time that was measured last; zero for none.
    ///
    /// What a link loses comes again after a round trip and what its sender waits for, and so do
    /// all messages behind it.
    pub fn set_round_trip(&mut self, round_trip: Duration) {
        self.link = ROUND_TRIPS_OF_SILENCE * round_trip;
    }

    /// A heartbeat.
    ///
    /// A living station is kept when another one is heard, so that two of them do not alternate. A
    /// restarted one replaces a dead one whose last sign of life is two heartbeats old.
    pub fn heartbeat(&mut self, incarnation: u64, now: Instant) {
        let timeout = 2 * HELLO_PERIOD + self.link;
        let is_other = |&(current, last): &(u64, Instant)| {
            current != incarnation && now.duration_since(last) <= timeout
        };
        if !self.last.as_ref().is_some_and(is_other) {
            self.last = Some((incarnation, now));
        }
    }

    /// A chunk: a sign of life of a known station, also where heartbeats wait behind such chunks.
    pub fn chunk(&mut self, incarnation: u64, now: Instant) {
        if let Some((current, last)) = &mut self.last
            && *current == incarnation
        {
            *last = now;
        }
    }

    /// Incarnation of the living station; 0 for none.
    pub fn living(&mut self, now: Instant) -> u64 {
        let timeout = STATION_TIMEOUT + self.link;
        self.last
            .take_if(|(_, last)| now.duration_since(*last) > timeout);
        self.last.map_or(0, |(incarnation, _)| incarnation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(milliseconds: u64) -> Duration {
        Duration::from_millis(milliseconds)
    }

    /// Ticks of a millisecond in which no station lived, where heartbeats and chunks arrive at
    /// these.
    fn lost(round_trip: Duration, heartbeats: &[u64], chunks: &[u64], end: u64) -> u64 {
        let start = Instant::now();
        let mut heard = StationHeard::default();
        heard.set_round_trip(round_trip);
        let mut lost = 0;
        for tick in 0..end {
            let now = start + ms(tick);
            if heartbeats.contains(&tick) {
                heard.heartbeat(7, now);
            }
            if chunks.contains(&tick) {
                heard.chunk(7, now);
            }
            lost += u64::from(heard.living(now) == 0);
        }
        lost
    }

    /// Arrivals over a stream that loses a message of every hundred: it comes again after a round
    /// trip and 200 ms (the least that Linux waits), twice that where it is lost again, and nothing
    /// overtakes it.
    fn arrivals(round_trip: u64, period: u64, lost_twice: bool) -> Vec<u64> {
        let mut free = 0;
        let send = |k: u64| {
            let again = if lost_twice { 3 } else { 1 };
            let late = if k % 100 == 50 {
                again * (round_trip + 200)
            } else {
                0
            };
            free = free.max(k * period + round_trip / 2 + late);
            free
        };
        (0..300).map(send).collect()
    }

    #[test]
    fn a_link_that_loses_does_not_lose_the_station() {
        for round_trip in [1, 20, 100, 200, 400] {
            let heartbeats = arrivals(round_trip, 100, false);
            let lost_in_all = lost(ms(round_trip), &heartbeats, &[], 20_000);
            assert_eq!(
                lost_in_all,
                round_trip / 2,
                "{round_trip} ms: until the first"
            );
        }
        let heartbeats = arrivals(200, 100, true);
        assert_eq!(lost(ms(200), &heartbeats, &[], 20_000), 100);
        assert!(lost(Duration::ZERO, &heartbeats, &[], 20_000) > 100);
    }

    #[test]
    fn heartbeats_that_wait_behind_chunks_are_not_missed() {
        // Four seconds of chunks at 0.25 Mbit/s, after which the heartbeats come.
        let chunks: Vec<u64> = (1..=30).map(|k| 131 * k).collect();
        let heartbeats: Vec<u64> = [0].into_iter().chain((40..80).map(|k| 100 * k)).collect();
        assert_eq!(lost(ms(20), &heartbeats, &chunks, 8000), 0);
        assert!(lost(ms(20), &heartbeats, &[], 8000) > 3000);
    }

    #[test]
    fn a_dead_station_is_missed_and_another_one_takes_its_place() {
        let start = Instant::now();
        let mut heard = StationHeard::default();
        assert_eq!(heard.living(start), 0);
        // Chunks of a station that no heartbeat named say nothing.
        heard.chunk(3, start);
        assert_eq!(heard.living(start), 0);
        heard.heartbeat(1, start);
        heard.heartbeat(2, start + ms(100));
        heard.chunk(2, start + ms(100));
        assert_eq!(heard.living(start + ms(100)), 1, "the first one is kept");
        heard.heartbeat(2, start + ms(201));
        assert_eq!(heard.living(start + ms(201)), 2);
        assert_eq!(heard.living(start + ms(701)), 2);
        assert_eq!(heard.living(start + ms(702)), 0);
    }
}
