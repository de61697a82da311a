//! The durations of `tuning.rs` in ticks of a controller, converted once when it is made.

use crate::tuning::active::{REACH_S, SLEEP_S, TOUCH_S};
use crate::tuning::cache::REFUSED_S;
use crate::tuning::lod::{COLLAPSE_S, HYSTERESIS_S};
use crate::tuning::memory_pressure::{EARLY_S, MAX_WAIT_S, MISSES_S, PAUSE_S, SETTLE_S, WAIT_S};
use crate::tuning::prediction::{
    DRIFT_S, FADING_S, LANDING_S, LEAD_S, MEAN_S, RECENT_S, REFINE_AHEAD_S, REFINE_AROUND_S,
    SPANS_S, WARM_S,
};
use crate::tuning::probe::{MAX_SILENCE_S, SPEED_LEFT_PER_MS, TOUR_RETRY_S};
use crate::tuning::streaming::{MAX_ROOM_WAIT_S, MAX_WAITED_S};
use crate::tuning::tick::{FAR_REPORT_S, REPORT_S};
use geometry::portable::pow;
use haptic_device::COMMAND_VALIDITY_S;
use protocol::ANSWER_TIMEOUT_MS;

/// Durations of the core in ticks, each that of the constant of its name in `tuning.rs`.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Horizons {
    /// Ticks a second.
    pub rate_hz: f64,
    /// Between two contact reports.
    pub report: u64,
    /// Between two of them to a station on another machine.
    pub far_report: u64,
    /// By which the reach is longer.
    pub reach: f64,
    /// Out of reach until an object may lose its place.
    pub sleep: u64,
    /// Within which a probe could touch.
    pub touch: f64,
    /// Without an answer until the session asks again.
    pub answer_timeout: u64,
    /// For which a record may wait for room.
    pub max_room_wait: u32,
    /// For which a refused region is not requested again.
    pub refused: u64,
    /// For which a region stays wanted.
    pub hysteresis: u64,
    /// Within which a backlog of collapses is worked off.
    pub collapse: u32,
    /// Without a sample until the force ramps down.
    pub max_silence: u64,
    /// For which a wrench is valid.
    pub validity: u64,
    /// Until a refused tour is requested again.
    pub tour_retry: u64,
    /// Share of the greatest speed that is left after a tick.
    pub speed_left: f64,
    /// Of the prediction.
    pub prediction: PredictionHorizons,
    /// Of the reaction to a small cache.
    pub pressure: PressureHorizons,
}

/// Durations of the prediction in ticks.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PredictionHorizons {
    /// Within which a surface must be for a prediction to be moved onto it.
    pub landing: f64,
    /// Over which velocity and acceleration are estimated.
    pub spans: [usize; 2],
    /// Over which an acceleration fades.
    pub fading: f64,
    /// Over which the speed is averaged.
    pub mean: f64,
    /// After which the largest speed counts a third.
    pub recent: f64,
    /// That it takes to have a loaded cell refined.
    pub refine_around: f64,
    /// At which the refined set looks.
    pub refine_ahead: f64,
    /// By which the refined strip is wider.
    pub lead: f64,
    /// Over a cell below which fewer neighbours are kept warm.
    pub warm: f64,
    /// After which a region is thought to be reached at rest.
    pub drift: f64,
    /// Looks at the finest ring, and at a coarser one, in a tick: one a millisecond, and at least
    /// one.
    pub looks: usize,
}

/// Durations of the reaction to a small cache in ticks.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PressureHorizons {
    /// For which a step may take effect.
    pub settle: u64,
    /// Before the first step back.
    pub wait: u64,
    /// The longest wait.
    pub max_wait: u64,
    /// Within which a step back was too early.
    pub early: u64,
    /// That contacts may lose for want of room at the most, at the error of the next ring.
    pub misses: u32,
    /// Without any question.
    pub pause: u64,
}

impl Horizons {
    /// Of a controller with so many ticks a second.
    #[must_use]
    pub fn new(rate_hz: f64) -> Self {
        let ticks = |seconds: f64| seconds * rate_hz;
        let whole = |seconds: f64| (seconds * rate_hz).round().max(1.0) as u64;
        let short = |seconds: f64| (seconds * rate_hz).round().max(1.0) as u32;
        Self {
            rate_hz,
            report: whole(REPORT_S),
            far_report: whole(FAR_REPORT_S),
            reach: ticks(REACH_S),
            sleep: whole(SLEEP_S),
            touch: ticks(TOUCH_S),
            answer_timeout: (ANSWER_TIMEOUT_MS as f64 * 1e-3 * rate_hz).ceil() as u64,
            max_room_wait: short(MAX_ROOM_WAIT_S),
            refused: whole(REFUSED_S),
            hysteresis: whole(HYSTERESIS_S),
            collapse: short(COLLAPSE_S),
            max_silence: (MAX_SILENCE_S * rate_hz).round() as u64,
            validity: whole(COMMAND_VALIDITY_S),
            tour_retry: whole(TOUR_RETRY_S),
            speed_left: pow(SPEED_LEFT_PER_MS, 1e3 / rate_hz),
            prediction: PredictionHorizons {
                landing: ticks(LANDING_S),
                spans: SPANS_S.map(|seconds| whole(seconds) as usize),
                fading: ticks(FADING_S),
                mean: ticks(MEAN_S).max(1.0),
                recent: ticks(RECENT_S).max(1.0),
                refine_around: ticks(REFINE_AROUND_S),
                refine_ahead: ticks(REFINE_AHEAD_S),
                lead: ticks(LEAD_S),
                warm: ticks(WARM_S),
                drift: ticks(DRIFT_S),
                looks: (1e3 / rate_hz).round().max(1.0) as usize,
            },
            pressure: PressureHorizons {
                settle: whole(SETTLE_S),
                wait: whole(WAIT_S),
                max_wait: whole(MAX_WAIT_S),
                early: whole(EARLY_S),
                misses: short(MISSES_S),
                pause: whole(PAUSE_S),
            },
        }
    }

    /// Of so many periods that were skipped in a row those that count as waited for an answer.
    #[must_use]
    pub fn waited(&self, skipped: u64) -> u64 {
        skipped.min((MAX_WAITED_S * self.rate_hz).round() as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_duration_is_the_same_time_at_every_rate() {
        let kilohertz = Horizons::new(1000.0);
        assert_eq!((kilohertz.sleep, kilohertz.hysteresis), (100, 40));
        assert_eq!(kilohertz.prediction.spans, [4, 16]);
        assert_eq!(kilohertz.speed_left, SPEED_LEFT_PER_MS);
        for rate_hz in [100.0, 500.0, 4000.0, 10_000.0] {
            let here = Horizons::new(rate_hz);
            for (ticks, at_kilohertz) in [
                (here.sleep, kilohertz.sleep),
                (here.hysteresis, kilohertz.hysteresis),
                (here.refused, kilohertz.refused),
                (here.report, kilohertz.report),
                (here.answer_timeout, kilohertz.answer_timeout),
                (here.pressure.settle, kilohertz.pressure.settle),
                (here.pressure.max_wait, kilohertz.pressure.max_wait),
            ] {
                let seconds = ticks as f64 / rate_hz;
                assert!((seconds - at_kilohertz as f64 * 1e-3).abs() < 1e-9 + 0.5 / rate_hz);
            }
            let left = here.speed_left.powf(rate_hz);
            let expected = kilohertz.speed_left.powf(1000.0);
            assert!((left / expected - 1.0).abs() < 1e-9, "{left} {expected}");
        }
    }
}
