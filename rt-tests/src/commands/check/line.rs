//! The lines: what was measured, the verdict, and the remedy.

use crate::commands::zwidth::RealLoop;
use crate::report::units::digits;
use hrtc::result::{Right, RunResult};
use realtime::interrupts::{InterruptedCore, QuietCores};
use scene::{ScenePlan, TrajectoryPlan};
use serde::Serialize;

/// Of the period, the wake-up that 99 of 100 ticks keep where it is good, and where it is fair: a
/// late wake-up delays the force, and a tenth of a period takes a sixth of the stiffest wall.
const WAKE_SHARES: [f64; 2] = [0.1, 0.5];
/// Share of the periods that may be missed where it is good, and where it is fair: one in ten
/// seconds at 1 kHz, and one in a second.
const MISSED_SHARES: [f64; 2] = [1e-4, 1e-3];
/// Of the period, the work that 999 of 1000 ticks keep: what is left is for what comes between.
const WORK_SHARES: [f64; 2] = [0.5, 0.9];
/// The stiffest wall over that of the scene: below one it puts energy out without the energy
/// account.
const FORCE_RATIOS: [f64; 2] = [1.0, 0.25];
/// The greatest speed over that of the scene's hand: below one the contact gets coarser.
const SPEED_RATIOS: [f64; 2] = [1.0, 0.25];

/// How good something is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// As it should be.
    #[default]
    Good,
    /// Usable with loss.
    Fair,
    /// Not usable.
    Bad,
}

impl Verdict {
    /// As it is printed.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Bad => "BAD",
        }
    }

    /// Of a number that is to be small: within the first limit, within the second, beyond.
    fn small(value: f64, [good, fair]: [f64; 2]) -> Self {
        // What is no number is within nothing.
        if value <= good {
            Self::Good
        } else if value <= fair {
            Self::Fair
        } else {
            Self::Bad
        }
    }

    /// Of a number that is to be large.
    fn large(value: f64, [good, fair]: [f64; 2]) -> Self {
        Self::small(-value, [-good, -fair])
    }
}

/// A line of the screen.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Line {
    /// What it is about.
    pub name: String,
    /// The verdict.
    pub verdict: Verdict,
    /// What was measured, in words.
    pub says: String,
    /// What to do; empty where all is well.
    pub remedy: String,
}

impl Line {
    fn new(name: &str, verdict: Verdict, says: String, remedy: &str) -> Self {
        let remedy = if verdict == Verdict::Good { "" } else { remedy };
        Self {
            name: name.to_string(),
            verdict,
            says,
            remedy: remedy.to_string(),
        }
    }

    /// The wake-ups of a bare loop.
    #[must_use]
    pub fn wake_up(rate_hz: f64, bare: &RunResult) -> Self {
        let period_us = 1e6 / rate_hz;
        let missed = bare.missed as f64 / (bare.missed + bare.ticks).max(1) as f64;
        let verdict = Verdict::small(bare.wake_us.p99 / period_us, WAKE_SHARES)
            .max(Verdict::small(missed, MISSED_SHARES));
        Self::new(
            &format!("wake-ups at {} kHz", rate_hz / 1e3),
            verdict,
            format!(
                "half within {} µs of the deadline, 99 of 100 within {}, the latest {}; {} of {} periods missed",
                digits(bare.wake_us.p50),
                digits(bare.wake_us.p99),
                digits(bare.wake_us.max),
                bare.missed,
                bare.missed + bare.ticks
            ),
            "a PREEMPT_RT kernel on bare metal, a core of its own for the tick (isolcpus=, nohz_full=), no deep sleep of \
             the processor; spin_us in [loop] trades processor time for wake-ups",
        )
    }

    /// Real-time rights of the controller.
    #[must_use]
    pub fn rights(rights: &[Right]) -> Self {
        let missing = || rights.iter().filter(|right| !right.obtained);
        let names: Vec<&str> = missing().map(|right| right.name.as_str()).collect();
        let remedies: Vec<&str> = missing().map(|right| right.detail.as_str()).collect();
        let (verdict, says) = if names.is_empty() {
            (Verdict::Good, "all obtained".to_string())
        } else {
            (Verdict::Fair, format!("missing: {}", names.join(", ")))
        };
        Self::new("rights", verdict, says, &remedies.join("; "))
    }

    /// Interrupts of devices on the core of the tick.
    #[must_use]
    pub fn interrupts(core: Option<usize>) -> Self {
        const NAME: &str = "interrupts";
        let Some(core) = core else {
            let says = "the tick shares its core with everything else".to_string();
            return Self::new(
                NAME,
                Verdict::Fair,
                says,
                "a machine with two cores or more",
            );
        };
        let quiet = QuietCores::look(&[core]);
        let per_minute = quiet.iter().next().map_or(0, |of| of.per_minute);
        let says = format!("{per_minute} a minute by devices on core {core}, the tick's");
        match InterruptedCore::look(core) {
            None => Self::new(NAME, Verdict::Good, says, ""),
            Some(interrupted) => Self::new(NAME, Verdict::Fair, says, &interrupted.to_string()),
        }
    }

    /// The work of a tick in a touch.
    #[must_use]
    pub fn work(rate_hz: f64, run: &RunResult) -> Self {
        let period_us = 1e6 / rate_hz;
        let share = run.work_us.p999 / period_us;
        let missed = run.missed_own_cpu;
        let missed_share = missed as f64 / (run.missed + run.ticks).max(1) as f64;
        let verdict =
            Verdict::small(share, WORK_SHARES).max(Verdict::small(missed_share, MISSED_SHARES));
        Self::new(
            "work of a tick",
            verdict,
            format!(
                "half within {} µs, 999 of 1000 within {}, {} % of the period; {missed} periods missed by the work",
                digits(run.work_us.p50),
                digits(run.work_us.p999),
                digits(100.0 * share)
            ),
            "fewer operations in [loop], a coarser tolerance (rt-tests tune), a lower rate or a faster core",
        )
    }

    /// The stiffest wall.
    #[must_use]
    pub fn force(plan: &ScenePlan, measured: &RealLoop, k_max: f64) -> Self {
        let stiffness = plan.objects[0].surface.stiffness_n_per_m;
        Self::new(
            "stiffest wall",
            Verdict::large(k_max / stiffness, FORCE_RATIOS),
            format!(
                "{} N/m by theory with {} N s/m of damping, a period of {} ms and a delay of {} ticks; the scene has {}",
                digits(k_max),
                digits(plan.probes[0].device.damping_ns_per_m),
                digits(measured.period_s * 1e3),
                digits(measured.delay_ticks()),
                digits(stiffness)
            ),
            "a higher rate, a device with more damping, or a softer surface; safety.passivity = true renders stiffer walls \
             without giving energy",
        )
    }

    /// The greatest speed at full resolution.
    #[must_use]
    pub fn speed(plan: &ScenePlan, run: &RunResult) -> Self {
        Self::speed_beside(hand_speed(&plan.probes[0].trajectory), run)
    }

    /// The same beside the speed of the scene's hand, m/s.
    fn speed_beside(hand: Option<f64>, run: &RunResult) -> Self {
        let greatest = run.greatest_speed_m_per_s;
        let verdict = match hand {
            Some(hand) => Verdict::large(greatest / hand, SPEED_RATIOS),
            None if greatest > 0.0 => Verdict::Good,
            // Nothing moves at full resolution, whatever the hand does.
            None => Verdict::Bad,
        };
        let beside = hand.map_or(
            "the scene has no path of a hand to compare with".to_string(),
            |hand| format!("the scene's hand goes at {}", digits(hand)),
        );
        Self::new(
            "greatest speed",
            verdict,
            format!(
                "{} m/s at full resolution on {} of {} faces; {beside}",
                digits(greatest),
                run.model,
                run.faces,
            ),
            "more operations in [loop], or a coarser tolerance: above it resolution follows speed",
        )
    }
}

/// Greatest speed of a hand on its path, m/s; `None` without a path, or where it stands still.
fn hand_speed(path: &TrajectoryPlan) -> Option<f64> {
    let speed = path.greatest_speed_m_per_s();
    (speed > 0.0).then_some(speed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Pose;
    use glam::DVec3;

    #[test]
    fn a_verdict_is_that_of_the_worse_and_no_number_is_bad() {
        let mut bare = RunResult {
            ticks: 10_000,
            ..RunResult::default()
        };
        bare.wake_us.p99 = 50.0;
        assert_eq!(Line::wake_up(1000.0, &bare).verdict, Verdict::Good);
        assert_eq!(Line::wake_up(1000.0, &bare).remedy, "");
        // The same wake-up is a fifth of the period at 4 kHz.
        let line = Line::wake_up(4000.0, &bare);
        assert_eq!(line.verdict, Verdict::Fair);
        assert!(!line.remedy.is_empty() && line.name.contains("4 kHz"));
        bare.missed = 100;
        assert_eq!(Line::wake_up(1000.0, &bare).verdict, Verdict::Bad);
        bare.wake_us.p99 = f64::NAN;
        bare.missed = 0;
        assert_eq!(Line::wake_up(1000.0, &bare).verdict, Verdict::Bad);
        assert_eq!(Verdict::large(2.0, FORCE_RATIOS), Verdict::Good);
        assert_eq!(Verdict::large(0.5, FORCE_RATIOS), Verdict::Fair);
        assert_eq!(Verdict::large(0.1, FORCE_RATIOS), Verdict::Bad);
    }

    #[test]
    fn periods_missed_by_the_work_count_beside_its_time() {
        let mut run = RunResult {
            ticks: 10_000,
            // By others.
            missed: 500,
            ..RunResult::default()
        };
        run.work_us.p999 = 100.0;
        let of = |run: &RunResult| Line::work(1000.0, run);
        assert_eq!(of(&run).verdict, Verdict::Good);
        run.missed_own_cpu = 5;
        assert_eq!(of(&run).verdict, Verdict::Fair);
        run.missed_own_cpu = 50;
        let line = of(&run);
        assert_eq!(line.verdict, Verdict::Bad);
        assert!(line.says.contains("50 periods missed by the work"));
        run.missed_own_cpu = 0;
        run.work_us.p999 = 950.0;
        assert_eq!(of(&run).verdict, Verdict::Bad);
    }

    #[test]
    fn the_greatest_speed_is_compared_with_that_of_any_path() {
        let at = |x: f64| Pose {
            position: DVec3::new(x, 0.0, 0.0),
            ..Pose::IDENTITY
        };
        let points = |points: &[(f64, f64)]| {
            let points = points.iter().map(|&(s, x)| (s, at(x)));
            hand_speed(&TrajectoryPlan::Points(points.collect()))
        };
        let hand = points(&[(0.0, 0.0), (1.0, 0.25), (1.5, 0.5), (2.5, 0.5)]);
        assert_eq!(hand, Some(0.5));
        assert_eq!(points(&[]), None);
        assert_eq!(points(&[(0.0, 0.1), (9.0, 0.1)]), None);
        for (hand, greatest, verdict) in [
            (hand, 0.5, Verdict::Good),
            (hand, 0.2, Verdict::Fair),
            (hand, 0.1, Verdict::Bad),
            (hand, 0.0, Verdict::Bad),
            (None, 0.1, Verdict::Good),
            (None, 0.0, Verdict::Bad),
            (None, f64::NAN, Verdict::Bad),
        ] {
            let run = RunResult {
                greatest_speed_m_per_s: greatest,
                ..RunResult::default()
            };
            let line = Line::speed_beside(hand, &run);
            assert_eq!(line.verdict, verdict, "{hand:?}, {greatest}");
            assert_eq!(line.says.contains("no path"), hand.is_none());
        }
    }

    #[test]
    fn rights_that_are_missing_are_named_with_their_remedies() {
        let missing = Right {
            name: "locked memory".to_string(),
            obtained: false,
            detail: "raise memlock".to_string(),
        };
        let obtained = Right {
            name: "core 1".to_string(),
            obtained: true,
            detail: String::new(),
        };
        let line = Line::rights(&[obtained.clone(), missing]);
        assert_eq!(line.verdict, Verdict::Fair);
        assert!(line.says.contains("locked memory") && line.remedy == "raise memlock");
        assert_eq!(Line::rights(&[obtained]).verdict, Verdict::Good);
    }
}
