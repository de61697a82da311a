//! The LOD selection of the thesis, 4.1.2: by the time T' that a frame took beside the time T that
//! it may take.
//!
//! | case | | LOD2 of each object |
//! |---|---|---|
//! | 1 | T' - T < -t | LOD1 + ALOD f g1: finer |
//! | 2 | T' - T > 0 | LOD1 - ALOD g2: coarser |
//! | 3 | else | LOD1 |
//!
//! with ALOD a fiftieth of all splits, t a tenth of T, and
//!
//! - `f = min((D - a) / D, (W - c) / W)`, a the distance and c the path in the last frame;
//! - `g1 = 2^(i - j - b)`, 0 where i - j < b: class b (1 to 3) of importance waits b - 1 frames;
//! - `g2 = 2^(2j - i)`, 1 where 2j < i + 1.
//!
//! i is the frame, j the last one before the case changed to this one. What it leaves open is done
//! thus:
//!
//! - Frames are counted from where the last rise began; so case 2 takes the steps of that rise
//!   back, the largest first. Counted from the start of a run, g2 would soon exceed any mesh.
//!   Frames in which nothing changed do not count: case 3, and case 1 where all is as fine as asked
//!   for. More than all splits is no larger step.
//! - Visible range D is the distance at which an object comes into reach, the diagonal W of the
//!   screen that of the object. A class is a halving of importance, as g1 halves.
//! - A frame is that of a picture, a thirtieth of a second: what is asked for has come and is split
//!   by the next. Its T is what its ticks might take. They do not begin what they have no time for;
//!   so its T' is what they took, and what the splits would take that are due at its end and left.

use super::Seen;
use crate::tuning::policy::{DEAD_ZONE, FRAME_S, STEPS};
use serde::{Deserialize, Serialize};

/// Time of a tick by the costs, nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// What it might spend.
    pub allowed: f64,
    /// What it has spent.
    pub spent: f64,
    /// What the splits would have taken that were due and for which there was no time.
    pub left: f64,
}

/// What is done at the end of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum Case {
    Finer,
    Coarser,
    Same,
}

/// See the module.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Reactive {
    frame_ticks: u32,
    /// Ticks of this frame so far; what they might spend, and what they have spent.
    ticks: u32,
    allowed: f64,
    spent: f64,
    case: Case,
    /// Frames of the last rise, and of the fall after it.
    rises: u32,
    falls: u32,
    /// Whether a frame has just ended.
    steps_now: bool,
}

impl Reactive {
    /// For ticks of a period, seconds.
    #[must_use]
    pub fn new(period_s: f64) -> Self {
        Self {
            frame_ticks: (FRAME_S / period_s).round().max(1.0) as u32,
            ticks: 0,
            allowed: 0.0,
            spent: 0.0,
            case: Case::Same,
            rises: 0,
            falls: 0,
            steps_now: false,
        }
    }

    /// Whether the objects change in this tick.
    #[must_use]
    pub fn steps_now(&self) -> bool {
        self.steps_now
    }

    /// LOD2 of an object of this LOD1, in shares of all its splits.
    #[must_use]
    pub fn stepped(&self, share: f64, seen: Option<Seen>) -> f64 {
        let step = match (self.case, seen) {
            (Case::Finer, Some(seen)) => eagerness(&seen) * rise(self.rises, class(&seen)),
            (Case::Coarser, _) => -fall(self.rises, self.falls),
            _ => 0.0,
        };
        (share + step / STEPS).clamp(0.0, 1.0)
    }

    /// A tick is over. `can_rise`: whether an object may be finer still.
    pub fn end_tick(&mut self, load: Load, can_rise: impl FnOnce() -> bool) {
        self.steps_now = false;
        self.ticks += 1;
        self.allowed += load.allowed;
        self.spent += load.spent;
        if self.ticks == self.frame_ticks {
            self.end_frame((self.spent + load.left) / self.allowed, can_rise);
            (self.ticks, self.allowed, self.spent) = (0, 0.0, 0.0);
            self.steps_now = true;
        }
    }

    /// A frame of this T' over T is over.
    fn end_frame(&mut self, ratio: f64, can_rise: impl FnOnce() -> bool) {
        let case = if ratio > 1.0 {
            Case::Coarser
        } else if ratio < 1.0 - DEAD_ZONE && can_rise() {
            Case::Finer
        } else {
            Case::Same
        };
        let changed = case != std::mem::replace(&mut self.case, case);
        match case {
            Case::Finer if changed => (self.rises, self.falls) = (1, 0),
            Case::Finer => self.rises = self.rises.saturating_add(1),
            Case::Coarser if changed => self.falls = 1,
            Case::Coarser => self.falls = self.falls.saturating_add(1),
            Case::Same => {}
        }
    }
}

/// f: how much of a step towards finer an object takes, 0 to 1.
#[must_use]
pub fn eagerness(seen: &Seen) -> f64 {
    (1.0 - seen.distance)
        .min(1.0 - FRAME_S * seen.speed)
        .clamp(0.0, 1.0)
}

/// The class of an object's importance: 1 is the most important one.
fn class(seen: &Seen) -> u32 {
    // Rounded to the next power of two.
    let squared = seen.importance * seen.importance;
    if squared > 1.0 / 2.0 {
        1
    } else if squared > 1.0 / 8.0 {
        2
    } else {
        3
    }
}

/// g1, `since` = i - j frames after the case changed.
fn rise(since: u32, class: u32) -> f64 {
    since.checked_sub(class).map_or(0.0, power)
}

/// g2, after so many frames of the last rise (j) and the fall after it (i - j).
fn fall(rises: u32, falls: u32) -> f64 {
    power(rises.saturating_sub(falls))
}

/// A power of two, at most the first that is more than all splits.
fn power(exponent: u32) -> f64 {
    let most = (STEPS as u32).next_power_of_two();
    f64::from(1_u32.checked_shl(exponent).unwrap_or(most).min(most))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_class(importance: f64) -> Seen {
        Seen {
            importance,
            distance: 0.0,
            speed: 0.0,
        }
    }

    const CLASSES: [f64; 3] = [1.0, 0.5, 0.25];

    /// Frames that take these shares of their time.
    fn run(policy: &mut Reactive, shares: &mut [f64; 3], ratios: &[f64]) -> Vec<[f64; 3]> {
        let of_frame = |&ratio| {
            policy.end_frame(ratio, || true);
            for (share, importance) in shares.iter_mut().zip(CLASSES) {
                *share = policy.stepped(*share, Some(of_class(importance)));
            }
            *shares
        };
        ratios.iter().map(of_frame).collect()
    }

    #[test]
    fn figure_4_2() {
        let j = 5_u32;
        // Case 1 from frame j + 1 on: the classes wait for one another, then double.
        let of_class = |class| [6, 7, 8, 9, 10].map(|i: u32| rise(i - j, class));
        assert_eq!(of_class(1), [1.0, 2.0, 4.0, 8.0, 16.0]);
        assert_eq!(of_class(2), [0.0, 1.0, 2.0, 4.0, 8.0]);
        assert_eq!(of_class(3), [0.0, 0.0, 1.0, 2.0, 4.0]);
        // Case 2 after a rise of j frames, the same for all: 2^(2j - i), and 1 from 2j = i on.
        let falls = [6, 7, 8, 9, 10, 11, 12].map(|i: u32| fall(j, i - j));
        assert_eq!(falls, [16.0, 8.0, 4.0, 2.0, 1.0, 1.0, 1.0]);
    }

    #[test]
    fn a_measured_course_follows_the_three_cases() {
        let mut policy = Reactive::new(1e-3);
        let mut shares = [0.0; 3];
        let in_steps = |of: [f64; 3]| of.map(|share| (share * STEPS).round());
        // Four frames with time left.
        let course = run(&mut policy, &mut shares, &[0.5, 0.6, 0.7, 0.85]);
        let rise: Vec<_> = course.into_iter().map(in_steps).collect();
        let expected = [
            [1.0, 0.0, 0.0],
            [3.0, 1.0, 0.0],
            [7.0, 3.0, 1.0],
            [15.0, 7.0, 3.0],
        ];
        assert_eq!(rise, expected);
        // In the dead zone, and on both of its edges, nothing changes.
        let held = run(&mut policy, &mut shares, &[0.9, 0.95, 1.0]);
        assert!(held.iter().all(|&of| in_steps(of) == expected[3]));
        // Too little time: the last step of the rise is taken back first, from all classes.
        let course = run(&mut policy, &mut shares, &[1.01, 1.5, 1.01]);
        let fall: Vec<_> = course.into_iter().map(in_steps).collect();
        assert_eq!(fall, [[7.0, 0.0, 0.0], [3.0, 0.0, 0.0], [1.0, 0.0, 0.0]]);
        // Time again: it begins with small steps.
        let course = run(&mut policy, &mut shares, &[0.89, 0.89]);
        assert_eq!(in_steps(course[1]), [4.0, 1.0, 0.0]);
    }

    #[test]
    fn all_is_asked_for_within_eight_frames_and_a_frame_that_cannot_rise_is_none_of_a_rise() {
        let mut policy = Reactive::new(1e-3);
        let mut shares = [0.0; 3];
        run(&mut policy, &mut shares, &[0.1; 8]);
        assert_eq!(shares, [1.0; 3]);
        for _ in 0..1000 {
            policy.end_frame(0.1, || false);
        }
        let [fine, ..] = run(&mut policy, &mut shares, &[1.1, 0.95])[1];
        assert!(fine < 1.0, "the last step of the rise is taken back");
        // As after the same rise without the wait between.
        let mut other = Reactive::new(1e-3);
        let mut at_once = [0.0; 3];
        run(&mut other, &mut at_once, &[0.1; 8]);
        let [expected, ..] = run(&mut other, &mut at_once, &[1.1, 0.95])[1];
        assert_eq!(fine, expected);
    }

    #[test]
    fn a_far_or_a_fast_object_rises_less_and_one_out_of_reach_not_at_all() {
        let mut policy = Reactive::new(1e-3);
        policy.end_frame(0.1, || true);
        let risen = |distance: f64, speed: f64| {
            let seen = Seen {
                distance,
                speed,
                ..of_class(1.0)
            };
            policy.stepped(0.0, Some(seen)) * STEPS
        };
        assert!((risen(0.25, 0.0) - 0.75).abs() < 1e-12);
        assert!((risen(0.25, 15.0) - 0.5).abs() < 1e-12);
        assert_eq!((risen(2.0, 0.0), risen(0.0, 60.0)), (0.0, 0.0));
        assert_eq!(policy.stepped(0.3, None), 0.3);
    }

    #[test]
    fn splits_that_were_left_are_time_that_was_short() {
        let mut policy = Reactive::new(1e-3);
        let full = |left: f64| Load {
            allowed: 6e5,
            spent: 4e5,
            left,
        };
        for tick in 0..2 * policy.frame_ticks {
            policy.end_tick(full(0.0), || true);
            assert_eq!(policy.steps_now(), (tick + 1) % policy.frame_ticks == 0);
        }
        assert_eq!((policy.case, policy.rises), (Case::Finer, 2));
        for _ in 0..policy.frame_ticks {
            policy.end_tick(full(7e6), || true);
        }
        assert_eq!((policy.case, policy.falls), (Case::Coarser, 1));
    }
}
