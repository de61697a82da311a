//! The motion of a device along three axes, in translation (metres) or rotation (radians): what of
//! it does work, and what is expected next.
//!
//! An encoder of step D shows a slow motion as jumps. A force that follows the measured position
//! changes with each, and the device is then between two steps, not on one. If the jump were its
//! motion, the force before it would be charged for half a step too much, on the way in and on the
//! way out. That is `K D v / 2` at a speed v. The hold of a period T leaks `K T v² / 2`, which is
//! less below `v = D / T`: 40 mm/s at 10 um and 4 kHz. So the position is estimated within the
//! step: it goes on at the estimated velocity, as far as the measured position allows. It does so
//! too where a sample is missing: a device slower than the loop is not at rest in between.

use super::positions::{Positions, next_of};
use crate::tuning::force::MOTION_ROUNDING;
use glam::DVec3;

/// The motion of a device, from its positions at the ends of its periods.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct DeviceMotion {
    /// Step of the encoder; 0 for none.
    step: f64,
    /// Longest window of the velocity estimate, periods.
    window: usize,
    /// As measured; `None` before the first sample.
    positions: Option<Positions>,
    /// Estimated position within the encoder's step.
    position: DVec3,
    /// The estimated position without noise.
    estimated_without_noise: WithoutNoise,
    /// The measured position without noise.
    measured_without_noise: WithoutNoise,
    /// Periods since that changed, along each axis.
    still: [u64; 3],
    /// Estimated motion in a period: now, one and two periods ago.
    estimated: [DVec3; 3],
}

/// A displacement to a new position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Displacement {
    /// All of it.
    pub whole: DVec3,
    /// Without the noise of the encoder: along some axes none, along others more than in this
    /// period.
    pub without_noise: DVec3,
    /// Whether the velocity estimate is zero.
    pub is_at_rest: bool,
}

impl DeviceMotion {
    /// Of a device that was nowhere yet. `step`: of its encoder; 0 for none.
    #[must_use]
    pub fn new(step: f64, window: usize) -> Self {
        Self {
            step,
            window,
            positions: None,
            position: DVec3::ZERO,
            estimated_without_noise: WithoutNoise::at(DVec3::ZERO),
            measured_without_noise: WithoutNoise::at(DVec3::ZERO),
            still: [0; 3],
            estimated: [DVec3::ZERO; 3],
        }
    }

    /// The same with another step of the encoder.
    #[must_use]
    pub fn with_step(self, step: f64) -> Self {
        Self { step, ..self }
    }

    /// Step of the encoder.
    #[must_use]
    pub fn step(&self) -> f64 {
        self.step
    }

    /// The newest position; `None` before the first.
    #[must_use]
    pub fn newest(&self) -> Option<DVec3> {
        self.positions.map(|of| of.newest())
    }

    /// The displacement to the newest position, or `None` where it is the first. `elapsed` and
    /// `periods`: see [`Positions::add`].
    pub fn moved_to(
        &mut self,
        position: DVec3,
        [elapsed, periods]: [u64; 2],
    ) -> Option<Displacement> {
        let Some(positions) = &mut self.positions else {
            self.positions = Some(Positions::at(position));
            self.position = position;
            self.estimated_without_noise = WithoutNoise::at(position);
            self.measured_without_noise = WithoutNoise::at(position);
            return None;
        };
        positions.add(position, [elapsed, periods]);
        let motion = positions.motion(self.step, self.window);
        let noise = self.noise_at(position);
        let before = self.position;
        let course = [elapsed, periods].map(|of| of as f64);
        self.position = self.estimated_position(position, motion, course);
        let without_noise = self.estimated_without_noise.move_to(self.position, noise);
        let moved = self.measured_without_noise.move_to(position, noise);
        let lasting = self.without_noise_at_rest(motion, moved, elapsed);
        self.estimated = [lasting, self.estimated[0], self.estimated[1]];
        Some(Displacement {
            whole: self.position - before,
            without_noise,
            is_at_rest: motion == DVec3::ZERO,
        })
    }

    /// The displacement in `elapsed` periods in which nothing was measured, as of a device slower
    /// than the loop: it goes on by the last estimate. The next measured position is reached from
    /// there, so that all displacements together are the measured one. `None` before the first.
    pub fn go_on(&mut self, elapsed: u64) -> Option<Displacement> {
        let positions = self.positions.as_mut()?;
        let measured = positions.newest();
        positions.add(measured, [elapsed; 2]);
        let motion = self.estimated[0];
        let before = self.position;
        self.position += motion * elapsed as f64;
        let noise = self.noise_at(self.position);
        let without_noise = self.estimated_without_noise.move_to(self.position, noise);
        for still in &mut self.still {
            *still = still.saturating_add(elapsed);
        }
        Some(Displacement {
            whole: self.position - before,
            without_noise,
            is_at_rest: motion == DVec3::ZERO,
        })
    }

    /// The longest way back that is noise, at a position.
    fn noise_at(&self, position: DVec3) -> f64 {
        2.0 * self.step + MOTION_ROUNDING * position.abs().max_element()
    }

    /// Estimated position at a `measured` one, after `elapsed` periods of a `motion` each since the
    /// last estimate, and `periods` since the last measured position. When an encoder jumps, the
    /// device is beyond the middle between two steps by at most a period's motion: by so much,
    /// since the account must not see less than is put out. Without a motion for a window, nothing
    /// is known but the step.
    fn estimated_position(
        &self,
        measured: DVec3,
        motion: DVec3,
        [elapsed, periods]: [f64; 2],
    ) -> DVec3 {
        let forgotten = periods / (periods + self.window as f64);
        let gone_on = self.position + motion * elapsed;
        let position = gone_on + (measured - gone_on) * forgotten;
        let to_middle = DVec3::splat(0.5 * self.step) - motion.abs() * periods;
        let within = to_middle.max(DVec3::ZERO);
        position.clamp(measured - within, measured + within)
    }

    /// An estimated `motion` without that along axes on which nothing was `moved` for long.
    fn without_noise_at_rest(&mut self, motion: DVec3, moved: DVec3, elapsed: u64) -> DVec3 {
        let mut lasting = motion;
        for axis in 0..3 {
            let still = self.still[axis].saturating_add(elapsed);
            self.still[axis] = if moved[axis] == 0.0 { still } else { 0 };
            if self.step > 0.0 && self.still[axis] > self.window as u64 {
                lasting[axis] = 0.0;
            }
        }
        lasting
    }

    /// The next position is no motion.
    pub fn go_to_new_place(&mut self) {
        self.positions = None;
        self.estimated = [DVec3::ZERO; 3];
    }

    /// Estimated motion in the last period, without the noise of the encoder.
    #[must_use]
    pub fn last(&self) -> DVec3 {
        self.estimated[0]
    }

    /// Extrapolated motion in the coming period.
    #[must_use]
    pub fn next(&self) -> DVec3 {
        let [now, before, earlier] = self.estimated;
        let along = |k: usize| next_of([earlier[k], before[k], now[k]]);
        DVec3::new(along(0), along(1), along(2))
    }
}

/// A position without noise. Along each axis it goes where the position with noise goes, if that
/// goes on as before or is too far away for noise, and else stays. A position that followed an
/// encoder step behind would be late at every turn: a force that is less on the way in than on the
/// way out would put out two steps of work unseen each time, for ever.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct WithoutNoise {
    position: DVec3,
    /// The last displacement along each axis.
    course: DVec3,
}

impl WithoutNoise {
    fn at(position: DVec3) -> Self {
        Self {
            position,
            course: DVec3::ZERO,
        }
    }

    /// The displacement to where noise has led. `noise`: the longest way back that is noise.
    fn move_to(&mut self, noisy: DVec3, noise: f64) -> DVec3 {
        let beyond = noisy - self.position;
        let mut moved = DVec3::ZERO;
        for axis in 0..3 {
            let along = beyond[axis];
            if along * self.course[axis] > 0.0 || along.abs() > noise {
                moved[axis] = along;
                self.course[axis] = along;
            }
        }
        self.position += moved;
        moved
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tuning::force::VELOCITY_WINDOW_S;

    /// A device presses a spring and lets it go, through an encoder. The work of a force that
    /// follows the encoder is no less than it is, and more by at most half of what jumps would be
    /// charged for; the part without noise is true to two steps beyond that.
    #[test]
    fn the_work_of_a_force_that_follows_an_encoder_is_true() {
        let (step, hz, seconds) = (1e-5, 1.3, 20.0);
        for rate_hz in [250.0, 500.0, 1000.0, 2000.0, 4000.0] {
            for amplitude in [1e-4, 3.37e-4, 1e-3] {
                let stiffness = 0.8 * rate_hz;
                let window = (VELOCITY_WINDOW_S * rate_hz).round() as usize;
                let mut device = DeviceMotion::new(step, window);
                let depth = |tick: f64| {
                    let phase = std::f64::consts::TAU * hz * tick / rate_hz;
                    amplitude * (2.0 - phase.cos() - (1.37 * phase).cos())
                };
                let measured = |of: f64| (of / step).round() * step;
                device.moved_to(DVec3::ZERO, [1; 2]);
                let (mut work, mut path, mut counted, mut all) = (0.0, 0.0, 0.0, 0.0);
                for tick in 0..(seconds * rate_hz) as u64 {
                    let (now, next) = (depth(tick as f64), depth((tick + 1) as f64));
                    let moved = device.moved_to(DVec3::X * measured(next), [1; 2]).unwrap();
                    let force = -stiffness * measured(now);
                    all += force * moved.whole.x;
                    counted += force * moved.without_noise.x;
                    work += force * (next - now);
                    path += (next - now).abs();
                }
                let of_jumps = 0.5 * stiffness * step * path;
                let steps = 2.0 * step * stiffness * 4.0 * amplitude;
                let case = format!("{rate_hz} Hz, {amplitude} m: {work} {all} {counted}");
                assert!(
                    all > work && all - work < 0.5 * of_jumps,
                    "{case} {of_jumps}"
                );
                let off = (counted - work).abs();
                assert!(off < 0.5 * of_jumps + steps, "{case} {of_jumps} {steps}");
            }
        }
    }
}
