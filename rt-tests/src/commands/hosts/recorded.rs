//! What a controller recorded of its simulated hand, and how two runs of it compare.
//!
//! The hand follows its path by periods, also by those that a tick skips, so a path has the same
//! place in both runs at the same number of periods from its start: the hand waits at its first
//! point, and then leaves it.
//!
//! The simulated hand gives way to the force, and its encoder has steps (10 µm, 8 mN at 800 N/m).
//! So a skipped period, in which the force is held, puts the hands of two runs apart by a step or
//! two for long after, in one machine's runs too. What is compared is the force at the same places.

use crate::report::quantile::{Quantiles, median};
use glam::DVec3;
use hrtc::recorder::{Entry, RecordingPlace, RecordingReader};
use serde::Serialize;
use std::cmp::Reverse;
use std::path::Path;

/// Largest difference of a force that counts as the same, of the local run's; and the least
/// magnitude that the local run's counts with, of its median.
const SAME_FORCE: f64 = 0.01;
const MIN_FORCE: f64 = 0.01;
/// Periods at the same places after which two runs are compared: the damping's velocity looks back
/// by up to 16 ms (`VELOCITY_WINDOW_S` of the controller), at 1 kHz.
const SAME_PERIODS: u64 = 17;
/// Periods that may be skipped where a hand begins.
const START_PERIODS: u64 = 20;
/// Time in which a skipped period or a tick below full resolution is taken to act on the force, in
/// periods: 0.1 s.
const AFTER_PERIODS: u64 = 100;

/// A probe in one tick.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Moment {
    /// Periods since the hand was first seen away from the first point of the path.
    period: u64,
    /// Periods that were skipped before it.
    skipped: u64,
    /// Where the hand is, metres.
    at: DVec3,
    /// Force on it, newtons.
    force: DVec3,
    is_in_contact: bool,
    /// In contact at full resolution.
    is_full: bool,
    /// Whether the soft start is over, so that the force is the touch's alone.
    is_started: bool,
    /// Certified error at the contact, metres; not finite without a bound.
    certified_error_m: f64,
}

/// A run of the simulated hand: each probe from where it leaves the first point of its path.
#[derive(Debug, Default)]
pub struct Recorded {
    probes: Vec<Vec<Moment>>,
    /// Periods skipped in the whole run.
    skipped: u64,
}

/// Forces of a run beside those of the same path on one machine.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Forces {
    /// Ticks in contact at full resolution in both runs, after the soft start of both.
    pub full_ticks: u64,
    /// Of these, those with a force that differs by no more than 1 % (see `same_ticks`), wherever
    /// the hands were.
    pub same_anywhere_ticks: u64,
    /// Of the full ones, those compared: the hand was at the same places for 17 periods.
    pub ticks: u64,
    /// Of these, with a force that differs by no more than 1 % of the local run's; where that is
    /// less than 1 % of its median, of the median's 1 %.
    pub same_ticks: u64,
    /// Their share, 0 to 1; none where nothing is compared.
    pub same_share: Option<f64>,
    /// Of the others, those within 0.1 s after a period that was skipped in one of the runs.
    pub after_skip_ticks: u64,
    /// Of what is left, those within 0.1 s after a contact below full resolution in one of them.
    pub after_coarse_ticks: u64,
    /// Size of the difference, newtons.
    pub difference_n: Quantiles,
    /// The same of all full ticks, wherever the hands were.
    pub difference_anywhere_n: Quantiles,
    /// Median of the local run's force, newtons.
    pub local_force_n: f64,
    /// Periods skipped in the run.
    pub skipped: u64,
    /// Periods skipped in the local run.
    pub local_skipped: u64,
}

/// The end of a run, in which the hand is led no further.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rest {
    /// Its length, periods.
    pub periods: u64,
    /// Certified error at its start, metres; none without a bound.
    pub from_m: Option<f64>,
    /// At its end.
    pub to_m: Option<f64>,
}

impl Recorded {
    /// Reads all files of a recording, up to the tick in which the run ended and the force began to
    /// ramp down. The soft start takes so many ticks that have a sample and could render a contact.
    ///
    /// # Errors
    /// What cannot be read, in one sentence.
    pub fn read(first: &Path, soft_start_ticks: u64) -> Result<Self, String> {
        let place = RecordingPlace {
            first: first.to_path_buf(),
            keep_bytes: 0,
            owns_folder: false,
        };
        let files = (0..).map(|number| place.path(number));
        let mut recorded = Self::default();
        let mut begins = Vec::new();
        for (number, file) in files.enumerate() {
            if number > 0 && !file.exists() {
                break;
            }
            let reader = RecordingReader::open(&file).map_err(|error| error.to_string())?;
            let probes = reader.head().probes();
            recorded.probes.resize(probes, Vec::new());
            begins.resize(probes, None);
            for entry in reader {
                let Entry::Tick(record) = entry else { continue };
                if record.core.stopping {
                    break;
                }
                recorded.skipped += u64::from(record.skipped);
                let all = recorded.probes.iter_mut().zip(&mut begins).enumerate();
                for (k, (moments, begin)) in all {
                    let Some(sample) = record.samples[k] else {
                        continue;
                    };
                    let at = sample.pose.position;
                    let (first, left, ready_ticks) = begin.get_or_insert((at, None, 0));
                    *ready_ticks += u64::from(record.core.ready);
                    if left.is_none() && at == *first {
                        continue;
                    }
                    let probe = &record.core.probes[k];
                    moments.push(Moment {
                        period: record.tick - *left.get_or_insert(record.tick),
                        skipped: recorded.skipped,
                        at,
                        force: record.wrenches[k].force,
                        is_in_contact: probe.contact,
                        is_full: probe.contact && probe.contact_full,
                        is_started: *ready_ticks >= soft_start_ticks,
                        certified_error_m: probe.certified_error_m,
                    });
                }
            }
        }
        Ok(recorded)
    }

    /// The rest of the first probe at the end, from so many periods of its path on, as far as it
    /// was in contact all the time.
    #[must_use]
    pub fn rest(&self, path_periods: u64) -> Option<Rest> {
        let moments = self.probes.first()?;
        let last = moments.last()?;
        let rests = |of: &&Moment| of.is_in_contact && of.period >= path_periods;
        let first = moments.iter().rev().take_while(rests).last()?;
        let bound = |of: &Moment| Some(of.certified_error_m).filter(|error| error.is_finite());
        Some(Rest {
            periods: last.period - first.period,
            from_m: bound(first),
            to_m: bound(last),
        })
    }
}

/// When something last was before each moment of a run, periods; none when it never was.
fn newest(moments: &[Moment], so: impl Fn(&Moment, &Moment) -> bool) -> Vec<Option<u64>> {
    let (mut newest, mut before) = (None, moments.first());
    let at = moments.iter().map(|moment| {
        if before.is_some_and(|before| so(before, moment)) {
            newest = Some(moment.period);
        }
        before = Some(moment);
        newest
    });
    at.collect()
}

/// A run of one probe, with what may act on its force.
struct Told<'a> {
    moments: &'a [Moment],
    skipped: Vec<Option<u64>>,
    coarse: Vec<Option<u64>>,
}

impl<'a> Told<'a> {
    fn of(moments: &'a [Moment]) -> Self {
        Self {
            moments,
            skipped: newest(moments, |before, now| now.skipped > before.skipped),
            coarse: newest(moments, |_, now| now.is_in_contact && !now.is_full),
        }
    }

    fn is_after(&self, newest: &[Option<u64>], at: usize) -> bool {
        newest[at].is_some_and(|period| self.moments[at].period - period <= AFTER_PERIODS)
    }

    /// Whether a period was skipped shortly before, and whether the contact was coarse.
    fn causes(&self, at: usize) -> [bool; 2] {
        [&self.skipped, &self.coarse].map(|newest| self.is_after(newest, at))
    }
}

/// Forces of two runs at the same period, newtons.
struct Pair {
    /// Size of the local run's.
    own: f64,
    difference: f64,
    /// Whether the hands have been at the same places for long enough.
    is_compared: bool,
    causes: [bool; 2],
}

impl Forces {
    /// Those of a run beside those of another.
    #[must_use]
    pub fn beside(local: &Recorded, run: &Recorded) -> Self {
        let mut forces = Self {
            skipped: run.skipped,
            local_skipped: local.skipped,
            ..Self::default()
        };
        let (mut pairs, mut sizes) = (Vec::new(), Vec::new());
        for (local, run) in local.probes.iter().zip(&run.probes) {
            let (local, run) = aligned(local, run);
            let (local, run) = (Told::of(&local), Told::of(&run));
            for (here, there, same) in pairs_of(local.moments, run.moments) {
                let (own, other) = (local.moments[here].force, run.moments[there].force);
                let (of_local, of_run) = (local.causes(here), run.causes(there));
                let causes = [0, 1].map(|k| of_local[k] || of_run[k]);
                sizes.push(own.length());
                pairs.push(Pair {
                    own: own.length(),
                    difference: (other - own).length(),
                    is_compared: same >= SAME_PERIODS,
                    causes,
                });
            }
        }
        forces.full_ticks = pairs.len() as u64;
        forces.local_force_n = median(&sizes);
        let least = MIN_FORCE * forces.local_force_n;
        for pair in &pairs {
            let is_same = pair.difference <= SAME_FORCE * pair.own.max(least);
            forces.same_anywhere_ticks += u64::from(is_same);
            if !pair.is_compared {
                continue;
            }
            let [is_after_skip, is_after_coarse] = pair.causes;
            forces.ticks += 1;
            let counter = if is_same {
                &mut forces.same_ticks
            } else if is_after_skip {
                &mut forces.after_skip_ticks
            } else if is_after_coarse {
                &mut forces.after_coarse_ticks
            } else {
                continue;
            };
            *counter += 1;
        }
        let share = forces.same_ticks as f64 / forces.ticks as f64;
        forces.same_share = (forces.ticks > 0).then_some(share);
        let differences = |of: fn(&&Pair) -> bool| {
            let chosen = pairs.iter().filter(of).map(|pair| pair.difference);
            Quantiles::of(&mut chosen.collect::<Vec<f64>>())
        };
        forces.difference_n = differences(|pair| pair.is_compared);
        forces.difference_anywhere_n = differences(|_| true);
        forces
    }
}

/// Two runs with the same periods at the same places: a skipped period hides when a hand began.
fn aligned(local: &[Moment], run: &[Moment]) -> (Vec<Moment>, Vec<Moment>) {
    let moved = |moments: &[Moment], by: u64| -> Vec<Moment> {
        let moved = moments.iter().map(|of| Moment {
            period: of.period + by,
            ..*of
        });
        moved.collect()
    };
    let local = moved(local, START_PERIODS);
    let same = |by: &u64| {
        let run = moved(run, *by);
        let pairs = at_same_period(&local, &run);
        pairs.filter(|&(a, b)| local[a].at == run[b].at).count()
    };
    // Of equals the smallest shift: hands that are nowhere at the same place began alike.
    let by =
        (0..=2 * START_PERIODS).max_by_key(|by| (same(by), Reverse(by.abs_diff(START_PERIODS))));
    let run = moved(run, by.unwrap_or(START_PERIODS));
    (local, run)
}

/// Numbers of the moments of two runs at the same period.
fn at_same_period<'a>(
    local: &'a [Moment],
    run: &'a [Moment],
) -> impl Iterator<Item = (usize, usize)> + 'a {
    let mut there = 0;
    local.iter().enumerate().filter_map(move |(here, own)| {
        while run.get(there).is_some_and(|of| of.period < own.period) {
            there += 1;
        }
        let other = run.get(there)?;
        (other.period == own.period).then_some((here, there))
    })
}

/// Those of them that are full in both, each with the periods for which the hands have been at the
/// same places.
fn pairs_of<'a>(
    local: &'a [Moment],
    run: &'a [Moment],
) -> impl Iterator<Item = (usize, usize, u64)> + 'a {
    let (mut same, mut next) = (0, 0);
    at_same_period(local, run).filter_map(move |(here, there)| {
        let (own, other) = (&local[here], &run[there]);
        let before = if own.period == next { same } else { 0 };
        same = if own.at == other.at { before + 1 } else { 0 };
        next = own.period + 1;
        let is_compared = |of: &Moment| of.is_full && of.is_started;
        (is_compared(own) && is_compared(other)).then_some((here, there, same))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A path of so many periods, in contact at full resolution with a force of 1 N.
    fn path(periods: u64) -> Vec<Moment> {
        let at = |period: u64| Moment {
            period,
            at: DVec3::new(period as f64, 0.0, 0.0),
            force: DVec3::Z,
            is_in_contact: true,
            is_full: true,
            is_started: true,
            ..Moment::default()
        };
        (0..periods).map(at).collect()
    }

    fn run(moments: Vec<Moment>) -> Recorded {
        Recorded {
            skipped: moments.last().map_or(0, |of| of.skipped),
            probes: vec![moments],
        }
    }

    #[test]
    fn forces_are_compared_at_the_same_period_whatever_was_skipped() {
        let local = run(path(1000));
        let mut moments = path(1000);
        // Two periods are skipped; a tick after them is 2 % off, and one much later.
        moments.drain(500..502);
        for moment in &mut moments[500..] {
            moment.skipped = 2;
        }
        moments[520].force = DVec3::Z * 1.02;
        moments[900].force = DVec3::Z * 0.9;
        moments[901].force = DVec3::Z * 1.009;
        // A coarse one, and one that is off after it.
        moments[300].is_full = false;
        moments[310].force = DVec3::X;
        // Nothing is said of another place, and what comes from there.
        moments[100].at = DVec3::Y;
        moments[107].force = DVec3::X;
        let forces = Forces::beside(&local, &run(moments));
        // Without the two that were skipped and the coarse one.
        assert_eq!(forces.full_ticks, 997);
        assert_eq!(forces.same_anywhere_ticks, 993);
        // Without the first 16, the other place and 16, and 16 after those skipped.
        assert_eq!((forces.ticks, forces.same_ticks), (948, 945));
        assert_eq!((forces.after_skip_ticks, forces.after_coarse_ticks), (1, 1));
        assert_eq!((forces.skipped, forces.local_skipped), (2, 0));
        assert_eq!(forces.same_share, Some(945.0 / 948.0));
        assert_eq!(forces.difference_n.p50, 0.0);
        assert_eq!(forces.difference_n.max, DVec3::X.distance(DVec3::Z));
        assert_eq!(forces.difference_anywhere_n, forces.difference_n);
    }

    #[test]
    fn a_hand_that_is_first_seen_late_is_compared_at_the_same_places() {
        let late: Vec<Moment> = path(103)[3..].to_vec();
        let late = late.iter().map(|of| Moment {
            period: of.period - 3,
            ..*of
        });
        let late: Vec<Moment> = late.collect();
        for (local, other) in [(path(103), late.clone()), (late, path(103))] {
            let forces = Forces::beside(&run(local), &run(other));
            assert_eq!((forces.full_ticks, forces.ticks), (100, 84));
        }
    }

    #[test]
    fn hands_that_are_nowhere_at_the_same_place_are_not_shifted() {
        let mut moments = path(100);
        for moment in &mut moments {
            moment.at.y = 1.0;
        }
        let forces = Forces::beside(&run(path(100)), &run(moments));
        assert_eq!((forces.full_ticks, forces.ticks), (100, 0));
    }

    #[test]
    fn a_small_force_counts_as_a_hundredth_of_the_median() {
        let mut local = path(100);
        local[50].force = DVec3::Z * 1e-4;
        let mut moments = local.clone();
        moments[50].force = DVec3::Z * 1.9e-4;
        let same = |moments| Forces::beside(&run(local.clone()), &run(moments)).same_ticks;
        assert_eq!(same(moments.clone()), 84);
        moments[50].force = DVec3::Z * 2.1e-4;
        assert_eq!(same(moments), 83);
    }

    #[test]
    fn what_is_no_number_is_not_the_same() {
        let mut moments = path(20);
        moments[19].force.x = f64::NAN;
        let forces = Forces::beside(&run(path(20)), &run(moments));
        assert_eq!((forces.ticks, forces.same_ticks), (4, 3));
        assert!(forces.difference_n.max.is_nan());
    }

    #[test]
    fn a_soft_start_is_not_compared() {
        let mut moments = path(100);
        for moment in &mut moments[..50] {
            moment.force *= 0.9;
            moment.is_started = false;
        }
        for (local, other) in [(path(100), moments.clone()), (moments, path(100))] {
            let forces = Forces::beside(&run(local), &run(other));
            assert_eq!((forces.full_ticks, forces.same_share), (50, Some(1.0)));
        }
    }

    #[test]
    fn nothing_in_common_has_no_share() {
        let forces = Forces::beside(&run(path(10)), &Recorded::default());
        assert_eq!((forces.ticks, forces.same_share), (0, None));
    }

    #[test]
    fn the_rest_is_the_end_in_contact_behind_the_path() {
        let mut moments = path(100);
        for (left, moment) in (0..40).rev().zip(&mut moments[60..]) {
            moment.certified_error_m = f64::from(left);
        }
        moments[60].certified_error_m = f64::INFINITY;
        let rest = run(moments.clone()).rest(60).unwrap();
        let expected = Rest {
            periods: 39,
            from_m: None,
            to_m: Some(0.0),
        };
        assert_eq!(rest, expected);
        moments[80].is_in_contact = false;
        assert_eq!(run(moments.clone()).rest(60).unwrap().periods, 18);
        moments[99].is_in_contact = false;
        assert_eq!(run(moments).rest(60), None);
    }
}
