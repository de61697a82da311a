//! Period and delay of a real loop, from the stamps of its device.

use crate::failure::Failure;
use crate::processes::stamped_device::Stamp;
use crate::report::quantile::quantile;
use serde::Serialize;

/// Ticks by which a force may be late and still be found.
const MAX_LATE: usize = 4;
/// Standard deviations by which the answer to the dither must stand out.
const CLEAR: f64 = 6.0;

/// What was measured of a loop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RealLoop {
    /// Median of the time between two samples, seconds.
    pub period_s: f64,
    /// The longest, seconds; a skipped period counts.
    pub longest_period_s: f64,
    /// Whole ticks between a sample and the force that answers to it.
    pub whole_ticks: usize,
    /// Median of the time from the sample to the force of the same tick, seconds.
    pub work_s: f64,
    /// 99th percentile of it, seconds.
    pub work_p99_s: f64,
    /// Ticks whose stamps were seen.
    pub stamps: usize,
}

impl RealLoop {
    /// What the stamps of a run say.
    ///
    /// # Errors
    /// One sentence when they are too few, or the device touched too little to see the answer to
    /// its dither.
    pub fn of(stamps: &[Stamp]) -> Result<Self, Failure> {
        let seconds = |ns: u64| ns as f64 * 1e-9;
        let mut periods: Vec<f64> = stamps
            .windows(2)
            .map(|pair| seconds(pair[1].read_ns - pair[0].read_ns))
            .collect();
        let mut works: Vec<f64> = stamps
            .iter()
            .map(|of| seconds(of.write_ns - of.read_ns))
            .collect();
        periods.sort_by(f64::total_cmp);
        works.sort_by(f64::total_cmp);
        let (Some(&longest_period_s), Some(whole_ticks)) = (periods.last(), late_ticks(stamps))
        else {
            return Err(Failure::Run(
                "the loop's delay cannot be told from its stamps: the device touched too little; give a scene whose first probe has a trajectory, or more with --seconds"
                    .to_string(),
            ));
        };
        Ok(Self {
            period_s: quantile(&periods, 0.5),
            longest_period_s,
            whole_ticks,
            work_s: quantile(&works, 0.5),
            work_p99_s: quantile(&works, 0.99),
            stamps: stamps.len(),
        })
    }

    /// Delay of the force in ticks, beyond the hold of a period.
    #[must_use]
    pub fn delay_ticks(&self) -> f64 {
        self.whole_ticks as f64 + self.work_s / self.period_s
    }
}

/// Ticks after which the force answers to the dither of a sample. Second differences of both, along
/// the force: the motion itself hardly has any.
fn late_ticks(stamps: &[Stamp]) -> Option<usize> {
    let mut sums = [(0.0, 0.0); MAX_LATE + 1];
    for window in stamps.windows(MAX_LATE + 3) {
        let [before, middle, now] = [3, 2, 1].map(|k| &window[window.len() - k]);
        let touches = [before, middle, now]
            .iter()
            .all(|of| of.force.length() > 0.0);
        if !touches {
            continue;
        }
        let along = middle.force.normalize();
        let force = (now.force - middle.force * 2.0 + before.force).dot(along);
        for (late, (sum, squares)) in sums.iter_mut().enumerate() {
            let dither = |k: usize| window[window.len() - 1 - late - k].dither.dot(along);
            // A surface pushes against a motion into it.
            let product = -force * (dither(0) - 2.0 * dither(1) + dither(2));
            *sum += product;
            *squares += product * product;
        }
    }
    let clear = |&(sum, squares): &(f64, f64)| sum / squares.sqrt();
    let (late, best) = sums
        .iter()
        .map(clear)
        .enumerate()
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    (best > CLEAR).then_some(late)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::processes::stamped_device::DITHER_M;
    use glam::DVec3;

    /// A stroke over a rough surface with an encoder, whose force comes so many ticks late.
    fn stamps(late: usize, stiffness: f64) -> Vec<Stamp> {
        let mut random = 1u64;
        let mut bit = || {
            random = random
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            if random >> 40 & 1 == 1 {
                DITHER_M
            } else {
                -DITHER_M
            }
        };
        let dithers: Vec<DVec3> = (0..4000).map(|_| DVec3::new(bit(), bit(), bit())).collect();
        let tilt = |k: usize| (0.01 * k as f64).sin();
        (0..dithers.len())
            .map(|k| {
                let answered = dithers[k.saturating_sub(late)];
                let normal = DVec3::new(tilt(k), 0.0, 1.0).normalize();
                let motion = 1e-5 * (100.0 * (0.02 * k as f64).sin()).round();
                let depth = 2e-3 + motion - answered.dot(normal);
                Stamp {
                    read_ns: 1_000_000 * k as u64,
                    write_ns: 1_000_000 * k as u64 + 50_000 + (k as u64 % 3) * 10_000,
                    dither: dithers[k],
                    force: normal * (stiffness * depth.max(0.0)),
                }
            })
            .collect()
    }

    #[test]
    fn whole_ticks_of_delay_are_seen_in_the_answer_to_the_dither() {
        for late in 0..=MAX_LATE {
            let found = RealLoop::of(&stamps(late, 800.0)).unwrap();
            assert_eq!(found.whole_ticks, late);
            assert!((found.period_s - 1e-3).abs() < 1e-12 && found.stamps == 4000);
            assert!(
                (found.delay_ticks() - late as f64 - 0.06).abs() < 1e-9,
                "{found:?}"
            );
        }
    }

    #[test]
    fn a_device_that_touches_nothing_or_whose_force_answers_to_nothing_tells_no_delay() {
        assert!(RealLoop::of(&stamps(0, 0.0)).is_err());
        assert!(RealLoop::of(&stamps(MAX_LATE + 3, 800.0)).is_err());
        assert!(RealLoop::of(&[]).is_err());
    }
}
