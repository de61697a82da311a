//! Plausibility of a device's samples: the only place that decides whether a sample is a motion.
//!
//! A sample is *unusable* when a number is not finite, when the position is so far that its square
//! is not, or when the quaternion has no direction. A quaternion of another length than 1 is
//! normalised. A usable sample is *plausible* when a motion within the device's [`MotionLimits`]
//! leads there from the last accepted sample. With the velocity v and the pose x of that sample, n
//! periods T ago, the m periods from the one before it, the acceleration a, the step h of the
//! encoder and the step φ of that of the orientation:
//!
//! - speed: `|x' - x| <= v_max n T + h`;
//! - acceleration: `|x' - x - v n T| <= a T² n (n + m) / 2 + 2 h (n + 1)`, since v is the mean of m
//!   periods, as of half of them before x; each of the three samples is wrong by up to h;
//! - turn: the angle between the orientations is at most `ω_max n T + √3 φ`: each of the three
//!   components of a rotation vector is wrong by up to `φ / 2`, in both samples.
//!
//! The limits widen with n, so a device that was silent may have moved; but a run of rejected or
//! absent samples widens them only up to [`MAX_WIDENED_S`]: a stream of wild samples beyond them
//! never makes one plausible. Periods that were skipped before this sample, or before a tick
//! without any while none was rejected, widen them beyond that. A wild sample may pass where they
//! are wide. So a second sample, and one that strays by more than `a T² + 4 h`, as none does where
//! each of three samples came in a period, is in *doubt*: the next one is plausible from the course
//! before it, too. Else the velocity that the wild one gave would exclude the true place. What that
//! course led to leaves no doubt: it would stay, and grow ever wider. Elsewhere, a device is at a
//! *new place* only after [`NEW_PLACE_S`] of samples that are plausible after one another, and when
//! the force on it has ramped down, so that it begins anew from zero. The proxies stay where they
//! were: between there and the new place may be a surface.

use crate::tuning::probe::{MAX_WIDENED_S, MIN_NEW_PLACE_SAMPLES, NEW_PLACE_S};
use geometry::Pose;
use geometry::portable::turn_between;
use glam::DVec3;
use haptic_device::MotionLimits;
use mutants::{Mutant, is};

/// Squared length by which a unit quaternion may be off by rounding: it is left as it is.
const UNIT_ROUNDING: f64 = 16.0 * f64::EPSILON;

/// An accepted sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accepted {
    /// Pose, with a unit quaternion.
    pub pose: Pose,
    /// Periods since the accepted sample before; 1 for the first.
    pub periods: u64,
    /// Whether no plausible motion leads there: the force on the device has ramped down.
    pub is_new_place: bool,
}

/// Judge of the samples of one device.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Plausibility {
    limits: MotionLimits,
    /// Step of the encoder, metres.
    encoder_m: f64,
    /// The largest turn that the encoder of the orientation shows of a device at rest, radians.
    turned_at_rest: f64,
    period_s: f64,
    /// [`NEW_PLACE_S`] in samples, and [`MAX_WIDENED_S`] in periods.
    new_place_samples: u32,
    max_widened: u64,
    /// Course of the accepted samples.
    course: Option<Course>,
    /// Course before the last accepted sample, where that is in doubt.
    before_doubt: Option<Course>,
    /// Course of the last rejected ones, and their number.
    rejected: Option<(Course, u32)>,
}

/// Samples that are plausible after one another.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Course {
    pose: Pose,
    /// Mean motion a period before the pose, metres, and the periods that it was measured over;
    /// unknown of a single sample.
    motion: Option<(DVec3, f64)>,
    /// Periods since.
    age: u64,
    /// Of these, those that were skipped before a tick without a sample.
    skipped: u64,
}

impl Course {
    fn at(pose: Pose) -> Self {
        Self {
            pose,
            motion: None,
            age: 0,
            skipped: 0,
        }
    }

    /// A tick comes so many periods after the one before; `is_silent`: without a sample.
    fn wait(&mut self, elapsed: u64, is_silent: bool) {
        self.age = self.age.saturating_add(elapsed);
        if is_silent {
            self.skipped = self.skipped.saturating_add(elapsed.saturating_sub(1));
        }
    }

    /// How far a pose is off the course, so many periods later, metres; and the periods before the
    /// last sample in which the motion was measured. Two samples show a speed, and no acceleration.
    fn deviation(&self, pose: &Pose, periods: f64) -> (f64, f64) {
        let moved = pose.position - self.pose.position;
        self.motion.map_or((0.0, 1.0), |(motion, before)| {
            ((moved - motion * periods).length(), before)
        })
    }

    /// The course with the next sample.
    fn led_to(self, pose: Pose) -> Self {
        let periods = self.age.max(1) as f64;
        let motion = (pose.position - self.pose.position) / periods;
        Self {
            motion: Some((motion, periods)),
            ..Self::at(pose)
        }
    }
}

impl Plausibility {
    /// Before the first sample. `encoder_m`: step of the device's encoder, metres.
    #[must_use]
    pub fn new(limits: MotionLimits, encoder_m: f64, period_s: f64) -> Self {
        Self {
            limits,
            encoder_m,
            turned_at_rest: 0.0,
            period_s,
            new_place_samples: ((NEW_PLACE_S / period_s).round() as u32).max(MIN_NEW_PLACE_SAMPLES),
            max_widened: (MAX_WIDENED_S / period_s).round().max(1.0) as u64,
            course: None,
            before_doubt: None,
            rejected: None,
        }
    }

    /// The same with a step of the measured orientation, radians.
    #[must_use]
    pub fn with_angular_step(self, encoder_rad: f64) -> Self {
        Self {
            turned_at_rest: 3.0f64.sqrt() * encoder_rad,
            ..self
        }
    }

    /// Judges by other limits from now on.
    pub fn set_limits(&mut self, limits: MotionLimits) {
        self.limits = limits;
    }

    /// Judges the pose that a device gave in a tick, `elapsed` periods after the tick before;
    /// `is_free`: no force acts on the device. `None` where there is none or it is rejected.
    pub fn judge(&mut self, given: Option<Pose>, elapsed: u64, is_free: bool) -> Option<Accepted> {
        // Between rejected samples a tick without any is part of their stream.
        let is_silent = given.is_none() && self.rejected.is_none();
        let rejected = self.rejected.as_mut().map(|(course, _)| course);
        let courses = self.course.iter_mut().chain(self.before_doubt.as_mut());
        for course in courses.chain(rejected) {
            course.wait(elapsed, is_silent);
        }
        if is(Mutant::NotFinite)
            && let Some(pose) = given.filter(|pose| !pose.is_finite())
        {
            return Some(Accepted {
                pose,
                periods: 1,
                is_new_place: false,
            });
        }
        let pose = given.and_then(usable)?;
        let Some(course) = self.course else {
            self.course = Some(Course::at(pose));
            return Some(Accepted {
                pose,
                periods: 1,
                is_new_place: false,
            });
        };
        let periods = course.age;
        let is_plausible = |of: &Course| self.is_plausible(of, &pose, elapsed);
        let straight = Some(course).filter(is_plausible);
        let before = self.before_doubt.filter(is_plausible);
        let in_doubt = straight.filter(|from| self.is_in_doubt(from, &pose, elapsed));
        // In doubt again, a sample that the course before the doubt leads to is of that one.
        let straight = straight.filter(|_| in_doubt.is_none() || before.is_none());
        let from = straight.or(before);
        let is_new_place = from.is_none();
        self.course = Some(match from {
            Some(from) => from.led_to(pose),
            None => self.new_place(pose, elapsed, is_free)?,
        });
        // What the course before a doubt led to leaves none: that course would grow ever wider.
        self.before_doubt = in_doubt.filter(|_| straight.is_some());
        self.rejected = None;
        Some(Accepted {
            pose,
            periods,
            is_new_place,
        })
    }

    /// The course of the rejected samples, of which this is one, once it is believed.
    fn new_place(&mut self, pose: Pose, elapsed: u64, is_free: bool) -> Option<Course> {
        let before = self
            .rejected
            .filter(|(course, _)| self.is_plausible(course, &pose, elapsed));
        let (course, count) = before.map_or((Course::at(pose), 1), |(course, count)| {
            (course.led_to(pose), count.saturating_add(1))
        });
        self.rejected = Some((course, count));
        (count >= self.new_place_samples && is_free).then_some(course)
    }

    /// Periods since the last sample of the course by which its limits widen.
    fn widened(&self, course: &Course, elapsed: u64) -> f64 {
        let widened = course.skipped.saturating_add(elapsed.max(self.max_widened));
        course.age.min(widened) as f64
    }

    /// How far a motion may be off its course, metres: see the module.
    fn max_deviation(&self, periods: f64, before: f64) -> f64 {
        let bend = 0.5 * periods * (periods + before) * self.period_s * self.period_s;
        self.limits.acceleration_m_per_s2 * bend + 2.0 * self.encoder_m * (periods + 1.0)
    }

    fn is_plausible(&self, course: &Course, pose: &Pose, elapsed: u64) -> bool {
        let periods = self.widened(course, elapsed);
        let seconds = periods * self.period_s;
        let moved = pose.position.distance(course.pose.position);
        let (deviation, before) = course.deviation(pose, periods);
        let turned = turn_between(course.pose.orientation, pose.orientation);
        is(Mutant::Spike)
            || moved <= self.limits.speed_m_per_s * seconds + self.encoder_m
                && deviation <= self.max_deviation(periods, before)
                && turned <= self.limits.angular_speed_rad_per_s * seconds + self.turned_at_rest
    }

    /// Whether it is plausible only since the limits are wide; or it is the second sample, of which
    /// no deviation is known.
    fn is_in_doubt(&self, course: &Course, pose: &Pose, elapsed: u64) -> bool {
        let (deviation, _) = course.deviation(pose, self.widened(course, elapsed));
        course.motion.is_none() || deviation > self.max_deviation(1.0, 1.0)
    }
}

/// The pose with a unit quaternion; `None` for numbers that cannot be reckoned with.
fn usable(pose: Pose) -> Option<Pose> {
    if !pose.is_finite() || !pose.position.length_squared().is_finite() {
        return None;
    }
    let squared = pose.orientation.length_squared();
    if (squared - 1.0).abs() <= UNIT_ROUNDING {
        return Some(pose);
    }
    squared.is_normal().then(|| Pose {
        orientation: pose.orientation / squared.sqrt(),
        ..pose
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    const PERIOD_S: f64 = 1e-3;

    fn judge() -> Plausibility {
        Plausibility::new(MotionLimits::HAND, 1e-5, PERIOD_S)
    }

    fn at(x: f64) -> Option<Pose> {
        Some(Pose::at(DVec3::X * x))
    }

    /// Sine of 0.1 m at 3 Hz (35 m/s² at the most), rounded to the encoder's step.
    fn hand(tick: u64) -> Option<Pose> {
        let x = 0.1 * (6.0 * std::f64::consts::PI * tick as f64 * PERIOD_S).sin();
        at((x / 1e-5).round() * 1e-5)
    }

    #[test]
    fn every_sample_of_a_hand_is_accepted_also_after_silence_and_skipped_periods() {
        let mut judge = judge();
        let mut tick = 0;
        for k in 0..5000u64 {
            let elapsed = [1, 1, 1, 2, 5, 18, 300][(k % 7) as usize];
            tick += elapsed;
            let given = if k % 11 == 3 { None } else { hand(tick) };
            let accepted = judge.judge(given, elapsed, false);
            assert_eq!(accepted.is_some(), given.is_some(), "tick {tick}");
            assert!(accepted.is_none_or(|of| !of.is_new_place));
        }
    }

    /// A hand that moves to and fro by 20 mm, at up to 4.5 m/s and 1000 m/s²: its velocity after a
    /// stall is not its mean velocity in the stall.
    #[test]
    fn a_stall_rejects_no_hand_with_or_without_a_sample_in_its_tick() {
        for stall in [2, 18, 300, 60_000] {
            for is_silent in [false, true] {
                let mut judge = judge();
                let mut tick = 0;
                for k in 0..200u64 {
                    let stalls = k % 20 == 19;
                    let elapsed = if stalls { stall } else { 1 };
                    tick += elapsed;
                    let given = at(0.02 * (0.223 * tick as f64).sin());
                    let given = given.filter(|_| !(stalls && is_silent));
                    let accepted = judge.judge(given, elapsed, false);
                    assert_eq!(accepted.is_some(), given.is_some(), "{stall}, tick {tick}");
                }
            }
        }
    }

    #[test]
    fn skipped_periods_make_no_wild_sample_of_a_stream_plausible() {
        let mut judge = judge();
        judge.judge(at(0.0), 1, true);
        for k in 0..1000 {
            let x = if k % 2 == 0 { -3.0 } else { 5.0 };
            assert_eq!(judge.judge(at(x), 2, true), None, "sample {k}");
        }
        // Each is given twice, which counts as once.
        for k in 0..4000 {
            let x = if k % 4 == 0 { -3.0 } else { 5.0 };
            let given = if k % 2 == 0 { at(x) } else { None };
            assert_eq!(judge.judge(given, 2, true), None, "tick {k}");
        }
    }

    /// A device at rest, of whose samples some are absent and some are wild: these may pass where a
    /// hand could have gone there meanwhile. The true place is always believed.
    #[test]
    fn no_wild_sample_among_absent_ones_excludes_the_true_place() {
        for rate_hz in [250.0, 500.0, 1000.0, 2000.0, 4000.0, 10_000.0] {
            for jump in [1e-3, 3e-3, 0.01, 0.02, 0.045, 0.07, 0.1, 0.3] {
                let mut judge = Plausibility::new(MotionLimits::HAND, 1e-5, 1.0 / rate_hz);
                let mut was_wild = true;
                for tick in 0..20_000u32 {
                    // Of the kinds a third is absent, and every fifth wild, but never two of these
                    // after one another.
                    let kind = tick.wrapping_mul(2_654_435_761).rotate_left(9) % 15;
                    let is_wild = kind < 3 && !was_wild;
                    let given = if kind < 8 && !is_wild {
                        None
                    } else {
                        at(if is_wild { jump } else { 0.0 })
                    };
                    was_wild = if given.is_some() { is_wild } else { was_wild };
                    let accepted = judge.judge(given, 1, false);
                    let is_true = given.is_some() && !is_wild;
                    assert!(
                        !is_true || accepted.is_some_and(|of| !of.is_new_place),
                        "{rate_hz} Hz, {jump} m, tick {tick}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_wild_sample_after_silence_does_not_exclude_the_true_place() {
        for (silent, jump) in [(6, 0.007), (12, 0.025)] {
            let mut judge = judge();
            (0..5).for_each(|_| assert!(judge.judge(at(0.0), 1, false).is_some()));
            (0..silent).for_each(|_| assert_eq!(judge.judge(None, 1, false), None));
            let wild = judge.judge(at(jump), 1, false);
            assert!(wild.is_some(), "it may have gone there");
            for tick in 0..12 {
                let is_silent = silent == 12 && tick == 0;
                let given = if is_silent { None } else { at(0.0) };
                let accepted = judge.judge(given, 1, false);
                assert_eq!(accepted.is_some(), given.is_some(), "{jump} m, tick {tick}");
            }
        }
    }

    #[test]
    fn wild_samples_are_not_accepted_after_one_another() {
        for jump in [0.02, 0.05] {
            let mut judge = judge();
            (0..50).for_each(|_| assert!(judge.judge(at(0.0), 1, false).is_some()));
            let mut wild = |k| judge.judge(at(if k % 2 == 0 { jump } else { -jump }), 1, false);
            let accepted: Vec<bool> = (0..1000).map(|k| wild(k).is_some()).collect();
            let both = accepted.windows(2).filter(|of| of[0] && of[1]).count();
            assert!(both <= 1, "{jump} m: {both}");
        }
    }

    #[test]
    fn a_wild_second_sample_does_not_exclude_the_true_place() {
        for silent in [0, 4, 8] {
            for jump in [0.005, 0.05, 0.1] {
                let mut judge = judge();
                judge.judge(at(0.0), 1, true);
                (0..silent).for_each(|_| assert_eq!(judge.judge(None, 1, true), None));
                judge.judge(at(jump), 1, true);
                for tick in 0..3 {
                    let accepted = judge.judge(at(0.0), 1, false);
                    assert!(
                        accepted.is_some_and(|of| !of.is_new_place),
                        "{silent} {jump} {tick}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_spike_is_rejected_and_the_motion_goes_on() {
        for spike in [0.01, 1.0, 1e6, 1e150, 1e200, f64::MAX, f64::NAN] {
            let mut judge = judge();
            let mut accepted_before = 0;
            for tick in 0..200 {
                let is_spike = (100..106).contains(&tick);
                let given = if is_spike { at(spike) } else { hand(tick) };
                let accepted = judge.judge(given, 1, false);
                assert_eq!(accepted.is_none(), is_spike, "{spike} at tick {tick}");
                if let Some(of) = accepted {
                    let periods = (tick - accepted_before).max(1);
                    assert_eq!(of.periods, periods, "{spike} at tick {tick}");
                    accepted_before = tick;
                }
            }
        }
    }

    #[test]
    fn a_hand_that_moves_is_believed_at_a_new_place_at_every_rate() {
        for rate_hz in [100.0, 250.0, 1000.0, 4000.0, 10_000.0] {
            let mut judge = Plausibility::new(MotionLimits::HAND, 1e-5, 1.0 / rate_hz);
            judge.judge(at(0.0), 1, true);
            // At 1.2 m/s from the first sample there.
            let moving = |tick: u64| at(1.0 + 1.2 * tick as f64 / rate_hz);
            let accepted = (0..).find(|&tick| judge.judge(moving(tick), 1, true).is_some());
            let seconds = accepted.map_or(f64::INFINITY, |tick| (tick + 1) as f64 / rate_hz);
            let most = NEW_PLACE_S.max(f64::from(MIN_NEW_PLACE_SAMPLES) / rate_hz);
            assert!(seconds <= most * (1.0 + 1e-9), "{rate_hz} Hz: {seconds} s");
        }
    }

    #[test]
    fn a_new_place_is_accepted_after_consistent_samples_and_without_force() {
        let mut judge = judge();
        judge.judge(at(0.0), 1, false);
        for k in 0..100 {
            assert_eq!(judge.judge(at(1.0), 1, false), None, "a force acts, {k}");
        }
        let accepted = judge.judge(at(1.0), 1, true);
        assert!(accepted.is_some_and(|of| of.is_new_place));
        // Elsewhere every time: nothing is believed, however long it lasts.
        for k in 0..1000 {
            let x = if k % 2 == 0 { -3.0 } else { 5.0 };
            assert_eq!(judge.judge(at(x), 1, true), None, "sample {k}");
        }
        assert!(
            judge
                .judge(at(1.0), 1, true)
                .is_some_and(|of| !of.is_new_place)
        );
    }

    #[test]
    fn turns_within_the_steps_of_the_encoder_are_accepted_at_every_rate() {
        let encoder_rad = 0.033;
        let turned = |steps: DVec3| {
            Some(Pose {
                position: DVec3::ZERO,
                orientation: DQuat::from_scaled_axis(steps * encoder_rad),
            })
        };
        for rate_hz in [1000.0, 4000.0, 10_000.0] {
            let judge = Plausibility::new(MotionLimits::HAND, 1e-5, 1.0 / rate_hz);
            let mut judge = judge.with_angular_step(encoder_rad);
            // At the edge between two steps, of one component and of all three.
            for axis in [DVec3::X, DVec3::ONE] {
                for k in 0..10 {
                    let steps = axis * f64::from(k % 2);
                    let accepted = judge.judge(turned(steps), 1, false);
                    assert!(accepted.is_some_and(|of| !of.is_new_place), "{rate_hz} Hz");
                }
            }
            // The last one was one step of all three.
            let wild = DVec3::ONE + DVec3::X * (100.0 / rate_hz / encoder_rad + 3.0);
            assert_eq!(judge.judge(turned(wild), 1, false), None, "{rate_hz} Hz");
        }
    }

    #[test]
    fn a_quaternion_is_normalised_or_rejected_and_a_wild_turn_is_rejected() {
        let turned = |w: f64, x: f64| {
            Some(Pose {
                position: DVec3::ZERO,
                orientation: DQuat::from_xyzw(x, 0.0, 0.0, w),
            })
        };
        let mut judge = judge();
        for (w, x) in [(1.0, 0.0), (3.0, 0.0), (1e-3, 1e-6), (1e100, 0.0)] {
            let pose = judge.judge(turned(w, x), 1, false).map(|of| of.pose);
            let length = pose.map(|pose| pose.orientation.length());
            assert!(length.is_some_and(|l| (l - 1.0).abs() < 1e-15), "{w} {x}");
        }
        for (w, x) in [(0.0, 0.0), (1e-200, 0.0), (f64::NAN, 0.0), (0.0, 1.0)] {
            assert_eq!(judge.judge(turned(w, x), 1, false), None, "{w} {x}");
        }
        // The same orientation with the other sign.
        assert!(judge.judge(turned(-1.0, 0.0), 1, false).is_some());
    }
}
