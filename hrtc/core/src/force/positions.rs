//! The last positions of a device, and its motion a period.

use crate::tuning::force::MAX_VELOCITY_PERIODS;
use glam::DVec3;

/// Positions at the ends of the last periods, metres (or rotation vectors, radians), the newest
/// first.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct Positions(
    #[serde(with = "serde_big_array::BigArray")] [DVec3; MAX_VELOCITY_PERIODS + 1],
);

impl Positions {
    /// At rest.
    #[must_use]
    pub fn at(position: DVec3) -> Self {
        Self([position; MAX_VELOCITY_PERIODS + 1])
    }

    /// The newest.
    #[must_use]
    pub fn newest(&self) -> DVec3 {
        self.0[0]
    }

    /// Adds the newest, `elapsed` periods after the one before. In the `periods` of the motion to
    /// it, of which some had no sample, the motion was even.
    pub fn add(&mut self, position: DVec3, [elapsed, periods]: [u64; 2]) {
        let before = self.0[0];
        let shift = elapsed.clamp(1, MAX_VELOCITY_PERIODS as u64) as usize;
        self.0.copy_within(..=MAX_VELOCITY_PERIODS - shift, shift);
        let filled = periods.clamp(1, self.0.len() as u64) as usize;
        let back = (before - position) / periods as f64;
        self.0[0] = position;
        for (k, sample) in self.0[..filled].iter_mut().enumerate().skip(1) {
            *sample = position + back * k as f64;
        }
    }

    /// Motion a period by first-order adaptive windowing (Janabi-Sharifi 2000): over the
    /// longest window, of `window` periods at the most, in which every position is within one
    /// encoder `step`, along each axis, of the line between its ends; over the last period where
    /// the step is 0.
    #[must_use]
    pub fn motion(&self, step: f64, window: usize) -> DVec3 {
        let now = self.newest();
        let longest = if step > 0.0 { window } else { 1 };
        let mut motion = now - self.0[1];
        // Motions that pass every position of the window within a step.
        let (mut least, mut most) = (DVec3::NEG_INFINITY, DVec3::INFINITY);
        for periods in 1..=longest.min(MAX_VELOCITY_PERIODS) {
            let to_here = (now - self.0[periods]) / periods as f64;
            if to_here.cmplt(least).any() || to_here.cmpgt(most).any() {
                break;
            }
            motion = to_here;
            let within = DVec3::splat(step / periods as f64);
            (least, most) = (least.max(to_here - within), most.min(to_here + within));
        }
        motion
    }
}

/// The next of three values: of a monotone sequence it goes on by the last change, or by twice the
/// one before where that is less, of any other it is the median. So one value that is out of line
/// counts neither as a value nor as a change, whether it is by rounding on one side or on the
/// other. Each change may be larger than the one before, where a spring takes up a device that
/// comes at speed: a limit by the lesser of both would be late by a period.
#[must_use]
pub fn next_of([earlier, before, now]: [f64; 3]) -> f64 {
    let (first, second) = (before - earlier, now - before);
    let (one, other, times) = if first * second > 0.0 {
        (2.0 * first, second, 2.0)
    } else {
        (-first, second, 1.0)
    };
    let lesser = if one.abs() < other.abs() { one } else { other };
    before + times * lesser
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_out_of_line_is_not_gone_on_with() {
        assert_eq!(next_of([1.0, 2.0, 3.0]), 4.0);
        assert_eq!(next_of([1.0, 2.0, 2.5]), 3.0);
        assert_eq!(next_of([1.0, 2.0, 3.5]), 5.0);
        assert_eq!(next_of([1.0, 2.0, 50.0]), 6.0);
        for rounding in [-4e-16, 0.0, 4e-16] {
            for values in [
                [1.0, 1.0 + rounding, 50.0],
                [1.0, 50.0, 1.0 + rounding],
                [50.0, 1.0, 1.0 + rounding],
                [-1.0, -1.0 + rounding, 0.0],
            ] {
                let at = if values[2] == 0.0 { -1.0 } else { 1.0 };
                assert!((next_of(values) - at).abs() < 3e-15, "{values:?}");
            }
        }
    }

    #[test]
    fn skipped_periods_and_missing_samples_leave_an_even_motion() {
        let step = DVec3::new(3e-4, -1e-4, 2e-4);
        let mut positions = Positions::at(DVec3::ZERO);
        let (mut now, mut sampled) = (0u64, 0u64);
        for (elapsed, is_sampled) in [
            (1, true),
            (18, true),
            (1, false),
            (1, false),
            (1, true),
            (300, true),
            (4, false),
        ]
        .into_iter()
        .cycle()
        .take(700)
        {
            now += elapsed;
            if is_sampled {
                positions.add(step * now as f64, [elapsed, now - sampled]);
                sampled = now;
            } else {
                positions.add(positions.newest(), [elapsed, elapsed]);
                continue;
            }
            let motion = positions.motion(1e-9, 16);
            assert!(
                motion.distance(step) < 1e-9 * step.length() * now as f64,
                "{now}: {motion}"
            );
        }
    }
}
