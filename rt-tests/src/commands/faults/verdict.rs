//! What all cases came to.

use super::touch::{Resync, Touched, Undisturbed};
use crate::report::quantile::quantile;
use serde::Serialize;

/// How often real processes were killed.
#[derive(Debug, Default, Serialize)]
pub struct Kills {
    /// Of the station, in contact.
    pub station: u64,
    /// Of the controller, in contact.
    pub controller: u64,
}

/// Times, milliseconds; all 0 of none.
#[derive(Debug, Default, PartialEq, Serialize)]
pub struct Times {
    /// How many there are.
    pub count: u64,
    /// Median.
    pub p50: f64,
    /// 99 % are not above it.
    pub p99: f64,
    /// Largest.
    pub max: f64,
}

impl Times {
    /// Of times in any order.
    #[must_use]
    pub fn of(times: &[f64]) -> Self {
        let mut ascending = times.to_vec();
        ascending.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| quantile(&ascending, share);
        Self {
            count: times.len() as u64,
            p50: at(0.5),
            p99: at(0.99),
            max: at(1.0),
        }
    }
}

/// Packets that somebody at the cable changed or sent once more, in both directions.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Harmed {
    /// Changed, so that no checksum of IP or TCP showed it.
    pub damaged: u64,
    /// Sent once more, a second later.
    pub replayed: u64,
    /// Whether both sides said that the link was lost.
    pub named: bool,
}

/// One case.
#[derive(Debug, PartialEq, Eq, Serialize)]
pub struct Case {
    /// Its name.
    pub name: &'static str,
    /// Whether all was as it must be; not so when it was skipped.
    pub pass: bool,
    /// Whether this machine or user cannot run it.
    pub skipped: bool,
    /// Periods missed by own work in its runs.
    pub missed_own_cpu: u64,
    /// The same in an undisturbed run of the same length and seed: the worst of three, or, over a
    /// link, that of one.
    pub missed_own_cpu_undisturbed: u64,
    /// Disturbed runs that came to a result.
    pub runs: u64,
    /// What was seen, or what was wrong.
    pub what: String,
}

/// What is printed as JSON.
#[derive(Debug, Default, Serialize)]
pub struct Faults {
    /// Kills.
    pub kills: Kills,
    /// Periods missed by own work, of all runs.
    pub missed_own_cpu: u64,
    /// Largest step of the force in a disturbed run, newtons.
    pub force_step_n_max: f64,
    /// The same over the periods between the two ticks, newtons a period.
    pub force_step_per_period_n_max: f64,
    /// Median of those of three undisturbed runs, newtons a period.
    pub force_step_undisturbed_n: f64,
    /// From a station's readiness to its synchronisation.
    pub resync_ms: Times,
    /// Disturbed runs whose front at the end was compared with that of an undisturbed one.
    pub fronts_compared: u64,
    /// Whether some were, and all of them were equal.
    pub fronts_equal: bool,
    /// Whether the undisturbed runs ended with different fronts: then none can be compared.
    pub undisturbed_fronts_differ: bool,
    /// Files left by processes that had ended.
    pub leaked: u64,
    /// Packets that were harmed on the way between two hosts.
    pub harmed: Harmed,
    /// From the end of the last wrench's validity to zero force of a device in a process of its
    /// own.
    pub device_late_ms: Times,
    /// From the fault to zero force of that device.
    pub device_zero_ms: Times,
    /// What ended the command early; empty where every case that was chosen has its verdict.
    pub failed: Vec<String>,
    /// The cases.
    pub cases: Vec<Case>,
}

/// A case's answer: what was seen, or what was wrong.
pub type Answer = Result<String, String>;

/// Adds up the cases.
#[derive(Default)]
pub struct Verdicts {
    /// What is printed.
    pub faults: Faults,
    /// What disturbed runs are compared with.
    pub undisturbed: Undisturbed,
    /// The same over a link, once it is known.
    pub undisturbed_over_link: Option<Undisturbed>,
    resync_ms: Vec<f64>,
    /// Fronts that were not as they were compared with.
    fronts_apart: u64,
    /// Own misses of the cases so far.
    missed_before: u64,
    /// Own misses of the undisturbed run by which the present case was judged, once it was.
    missed_undisturbed: Option<u64>,
    /// Runs that were judged since the last case.
    runs: u64,
    /// Of the device's cases, milliseconds.
    pub late_ms: Vec<f64>,
    /// Of the device's cases, milliseconds.
    pub zero_ms: Vec<f64>,
}

impl Verdicts {
    /// Counts a disturbed run and judges it.
    ///
    /// # Errors
    /// What is wrong with it, in words.
    pub fn judge(&mut self, touched: &Touched) -> Answer {
        self.judge_by(&self.undisturbed.clone(), touched)
    }

    /// Counts a disturbed run and judges it by an undisturbed one.
    ///
    /// # Errors
    /// What is wrong with it, in words.
    pub fn judge_by(&mut self, undisturbed: &Undisturbed, touched: &Touched) -> Answer {
        self.runs += 1;
        self.missed_undisturbed = Some(undisturbed.missed_own_cpu);
        let result = &touched.finished.result;
        let faults = &mut self.faults;
        faults.missed_own_cpu += result.missed_own_cpu;
        for (most, step) in [
            (&mut faults.force_step_n_max, result.force_step_n_max),
            (
                &mut faults.force_step_per_period_n_max,
                result.force_step_per_period_n_max,
            ),
        ] {
            *most = most.max(step);
        }
        faults.leaked += touched.left.len() as u64;
        if let Some(front) = undisturbed.front {
            faults.fronts_compared += 1;
            self.fronts_apart += u64::from(front != result.front_hash);
        }
        let times = touched.resyncs.iter().map(|of| of.synchronised_ms);
        self.resync_ms.extend(times.filter(|&ms| ms >= 0.0));
        let wrong = undisturbed.complaints(touched);
        if !wrong.is_empty() {
            return Err(wrong.join("; "));
        }
        let mut seen = format!(
            "force step {:.2} N a period",
            result.force_step_per_period_n_max
        );
        let slower = |a: &Resync, b: &Resync| a.synchronised_ms.total_cmp(&b.synchronised_ms);
        if let Some(slowest) = touched.resyncs.iter().copied().max_by(slower) {
            let (heard, ms) = (slowest.heard_ms, slowest.synchronised_ms);
            seen += &format!(", synchronised within {ms:.0} ms, heard after {heard:.0}");
        }
        Ok(seen)
    }

    /// Adds a case.
    pub fn add(&mut self, name: &'static str, answer: Answer) {
        let pass = answer.is_ok();
        let (Ok(what) | Err(what)) = answer;
        self.push(name, pass, false, what);
    }

    /// Adds a case that cannot be run here.
    pub fn skip(&mut self, name: &'static str, why: &str) {
        self.push(name, false, true, why.to_string());
    }

    fn push(&mut self, name: &'static str, pass: bool, skipped: bool, what: String) {
        let missed = self.faults.missed_own_cpu;
        let undisturbed = self.missed_undisturbed.take();
        self.faults.cases.push(Case {
            name,
            pass,
            skipped,
            missed_own_cpu: missed - self.missed_before,
            missed_own_cpu_undisturbed: undisturbed.unwrap_or(self.undisturbed.missed_own_cpu),
            runs: std::mem::take(&mut self.runs),
            what,
        });
        self.missed_before = missed;
    }

    /// The whole.
    #[must_use]
    pub fn finish(mut self) -> Faults {
        self.faults.resync_ms = Times::of(&self.resync_ms);
        self.faults.device_late_ms = Times::of(&self.late_ms);
        self.faults.device_zero_ms = Times::of(&self.zero_ms);
        self.faults.fronts_equal = self.faults.fronts_compared > 0 && self.fronts_apart == 0;
        self.faults
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrtc::result::{Finished, RunResult};

    fn touched(front_hash: u64) -> Touched {
        let result = RunResult {
            contact_ticks: 1,
            front_hash,
            ..RunResult::default()
        };
        Touched {
            finished: Box::new(Finished {
                result,
                ..Finished::default()
            }),
            resyncs: Vec::new(),
            left: Vec::new(),
        }
    }

    fn undisturbed(missed_own_cpu: u64) -> Undisturbed {
        Undisturbed {
            front: Some(5),
            missed_own_cpu,
            ..Undisturbed::default()
        }
    }

    #[test]
    fn fronts_are_equal_where_some_were_compared_and_none_differed() {
        let found = |fronts: &[u64]| {
            let mut verdicts = Verdicts::default();
            for &front in fronts {
                let judged = verdicts.judge_by(&undisturbed(0), &touched(front));
                assert_eq!(judged.is_ok(), front == 5);
            }
            let found = verdicts.finish();
            (found.fronts_compared, found.fronts_equal)
        };
        assert_eq!(found(&[]), (0, false));
        assert_eq!(found(&[5, 5]), (2, true));
        assert_eq!(found(&[5, 6, 5]), (3, false));
    }

    #[test]
    fn own_misses_stand_beside_those_of_the_run_that_a_case_was_judged_by() {
        let mut verdicts = Verdicts {
            undisturbed: undisturbed(4),
            ..Verdicts::default()
        };
        let over_link = verdicts.judge_by(&undisturbed(9), &touched(5));
        verdicts.add("link-cut", over_link);
        let here = verdicts.judge(&touched(5));
        verdicts.add("station-killed", here);
        verdicts.skip("disk-full", "there is no right");
        let found = verdicts.finish();
        let cases = found.cases.iter();
        let missed: Vec<u64> = cases.map(|of| of.missed_own_cpu_undisturbed).collect();
        assert_eq!(missed, [9, 4, 4]);
    }

    #[test]
    fn times_of_none_are_told_from_times_of_nothing() {
        assert_eq!((Times::of(&[]).count, Times::of(&[]).max), (0, 0.0));
        assert_eq!((Times::of(&[0.0]).count, Times::of(&[0.0]).max), (1, 0.0));
    }
}
