//! A touch of real processes in a domain of its own, and what is asked of every one: no own miss,
//! no step of the force, the same front at rest, nothing left.

use super::bench::{Bench, SLOT_S, files_below};
use crate::processes::own_domain::OwnDomain;
use crate::processes::surroundings::Surroundings;
use crate::processes::watched::{PATIENCE, Watched, pause};
use hrtc::result::{Finished, StationHeard};
use realtime::rights::monotonic_ns;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::{Duration, Instant};
use transport::Domain;

/// Step of the force that is never too large, newtons a period: what a hand does not tell from the
/// edge of a facet.
const STEP_N: f64 = 0.3;
/// Step of the force a period of a disturbed run over that of an undisturbed one.
const STEP_RATIO: f64 = 1.5;
/// Time in which a station that is ready again on this machine must be synchronised, milliseconds.
pub const RESYNC_MS: f64 = 1000.0;

/// Ending of the one segment that iceoryx2 keeps of a domain, with or without processes: it is made
/// once and never removed, so it does not grow.
const KEPT_OF_DOMAIN: &str = ".global_mgmt";

/// Files of a domain without processes, and files where none of the processes may leave one.
fn left(domain: &Domain, bench: &Bench) -> Vec<PathBuf> {
    let prefix = domain.prefix();
    let memory = std::fs::read_dir("/dev/shm");
    let memory = memory.into_iter().flatten().flatten();
    let memory = memory.filter(|of| {
        let name = of.file_name().to_string_lossy().into_owned();
        name.starts_with(&prefix) && !name.ends_with(KEPT_OF_DOMAIN)
    });
    let mut left: Vec<PathBuf> = memory.map(|of| of.path()).collect();
    left.extend(files_below(&domain.root()));
    left.extend(bench.leftovers());
    left
}

/// A domain of a case.
///
/// # Errors
/// When its folder cannot be made.
pub fn own_domain() -> Result<Rc<OwnDomain>, String> {
    OwnDomain::new()
        .map(Rc::new)
        .map_err(|error| error.to_string())
}

/// A station and a controller in a domain.
pub struct Touch<'a> {
    /// The bench.
    pub bench: &'a Bench<'a>,
    /// The station that is to be heard.
    pub station: Watched,
    /// The controller.
    pub controller: Watched,
    /// When the station came back, on CLOCK_MONOTONIC, ns.
    pub returns_ns: Vec<u64>,
    /// Whether an exchange may outlast what is done to it: a link that is made again within the
    /// silence that a station is allowed.
    pub may_outlast: bool,
    /// Length of the run, seconds.
    seconds: f64,
    started_ns: u64,
    touched: Instant,
    /// The domain; last, so that its processes are gone before its files.
    pub domain: Rc<OwnDomain>,
}

/// What became of it.
pub struct Touched {
    /// The controller's result.
    pub finished: Box<Finished>,
    /// What followed each return of the station.
    pub resyncs: Vec<Resync>,
    /// Files that were left.
    pub left: Vec<PathBuf>,
}

/// What followed a return of the station: times since then, milliseconds; negative without one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resync {
    /// Until the controller heard of it.
    pub heard_ms: f64,
    /// Until it was synchronised.
    pub synchronised_ms: f64,
}

/// Arguments of a role.
fn arguments(role: &str, domain: &Domain, scene: &Path, more: &[String]) -> Vec<OsString> {
    let mut typed: Vec<OsString> = vec![role.into(), "--domain".into(), domain.name().into()];
    typed.extend(more.iter().map(OsString::from));
    typed.push(scene.into());
    typed
}

/// Starts a station and waits until it is ready.
///
/// # Errors
/// When it is not.
pub fn start_station(bench: &Bench, domain: &Domain) -> Result<Watched, String> {
    start_station_for(bench, domain, "touch.toml")
}

/// Starts a station for a scene of the bench and waits until it is ready.
///
/// # Errors
/// When it is not.
pub fn start_station_for(bench: &Bench, domain: &Domain, scene: &str) -> Result<Watched, String> {
    let scene = bench.path(scene);
    let typed = arguments("role-station", domain, &scene, &[]);
    let mut station = Watched::start("station", &typed, bench.around())?;
    station.wait_for("the start", bench.stop, |of| of.ready_ns.is_some())?;
    Ok(station)
}

/// How a controller is started.
pub struct Start<'a> {
    /// Name of the scene in the bench.
    pub scene: &'a str,
    /// Length, seconds.
    pub seconds: f64,
    /// Arguments beside.
    pub more: Vec<String>,
    /// Surroundings.
    pub around: Surroundings,
}

impl<'a> Start<'a> {
    /// A run of the bench's length.
    #[must_use]
    pub fn usual(bench: &Bench) -> Self {
        Self {
            scene: "touch.toml",
            seconds: bench.seconds(),
            more: Vec::new(),
            around: bench.around(),
        }
    }
}

/// Starts a controller; the time of it on CLOCK_MONOTONIC, ns.
///
/// # Errors
/// When the system refuses.
pub fn start_controller(
    bench: &Bench,
    domain: &Domain,
    start: Start,
) -> Result<(Watched, u64), String> {
    let started_ns = monotonic_ns();
    let mut more = start.more;
    more.push(format!("--seconds={}", start.seconds));
    more.push(format!("--started-ns={started_ns}"));
    let scene = bench.path(start.scene);
    let typed = arguments("role-hrtc", domain, &scene, &more);
    Ok((
        Watched::start("controller", &typed, start.around)?,
        started_ns,
    ))
}

impl<'a> Touch<'a> {
    /// Starts both in a domain and waits for the touch.
    ///
    /// # Errors
    /// When a process does not start, or nothing is touched.
    pub fn begin(
        bench: &'a Bench<'a>,
        domain: Rc<OwnDomain>,
        start: Start,
    ) -> Result<Self, String> {
        let seconds = start.seconds;
        let station = start_station(bench, &domain)?;
        let (mut controller, started_ns) = start_controller(bench, &domain, start)?;
        controller.wait_for("the first touch", bench.stop, Watched::is_touching)?;
        let controller = (controller, started_ns);
        Ok(Self::of(bench, domain, station, controller, seconds))
    }

    /// A touch that has just begun, of a controller that was started at this time.
    #[must_use]
    pub fn of(
        bench: &'a Bench<'a>,
        domain: Rc<OwnDomain>,
        station: Watched,
        (controller, started_ns): (Watched, u64),
        seconds: f64,
    ) -> Self {
        Self {
            bench,
            station,
            controller,
            returns_ns: Vec::new(),
            may_outlast: false,
            seconds,
            started_ns,
            touched: Instant::now(),
            domain,
        }
    }

    /// Starts both for a run of the usual length in a domain of its own, and waits for the touch.
    ///
    /// # Errors
    /// See [`Touch::begin`].
    pub fn usual(bench: &'a Bench<'a>) -> Result<Self, String> {
        Self::begin(bench, own_domain()?, Start::usual(bench))
    }

    /// Starts a controller for a run of the usual length in place of one that has ended, and waits
    /// for the touch.
    ///
    /// # Errors
    /// When it does not start, or touches nothing.
    pub fn replace_controller(&mut self) -> Result<(), String> {
        let start = Start::usual(self.bench);
        let (controller, started_ns) = start_controller(self.bench, &self.domain, start)?;
        self.controller = controller;
        self.started_ns = started_ns;
        self.returns_ns.clear();
        let (of, bench) = (&mut self.controller, self.bench);
        of.wait_for("the first touch", bench.stop, Watched::is_touching)?;
        self.touched = Instant::now();
        Ok(())
    }

    /// Whether a disturbance that begins now can be mended before the rest.
    #[must_use]
    pub fn has_room(&self) -> bool {
        let end = (self.bench.slots as f64 - 0.7) * SLOT_S;
        self.sliding_s() < end
    }

    /// Time since the touch began, seconds.
    #[must_use]
    pub fn sliding_s(&self) -> f64 {
        self.touched.elapsed().as_secs_f64()
    }

    /// Starts a station in place of the last one.
    ///
    /// # Errors
    /// When it does not start.
    pub fn restart_station(&mut self) -> Result<(), String> {
        self.station = start_station(self.bench, &self.domain)?;
        let now = monotonic_ns();
        self.returns_ns.push(self.station.ready_ns.unwrap_or(now));
        Ok(())
    }

    /// Waits so that a slot is over that began then.
    pub fn end_slot(&mut self, began: Instant) {
        pause(SLOT_S - began.elapsed().as_secs_f64(), self.bench.stop);
        self.controller.listen();
    }

    /// Waits for the end of the controller, ends the station, looks for what is left.
    ///
    /// # Errors
    /// When one of them does not end well.
    pub fn finish(mut self) -> Result<Touched, String> {
        let longest = PATIENCE + Duration::from_secs_f64(self.seconds);
        let ended = self.controller.wait_for_end(longest, self.bench.stop);
        let station = self.station.end();
        let left = left(&self.domain, self.bench);
        ended?;
        station?;
        let finished = self.controller.finished.take();
        let finished = finished.ok_or("the controller ended without a result")?;
        let ms = |ns: u64| ns.saturating_sub(self.started_ns) as f64 / 1e6;
        let returns = self.returns_ns.iter().map(|&ns| ms(ns));
        let next = returns.clone().skip(1).chain([f64::INFINITY]);
        let spans = returns.zip(next);
        Ok(Touched {
            resyncs: spans
                .map(|span| Resync::of(span, self.may_outlast, &finished))
                .collect(),
            finished,
            left,
        })
    }
}

impl Resync {
    /// What followed a return before the next one. At once where an exchange that may outlast it
    /// did: none began anew.
    fn of((back_ms, next_ms): (f64, f64), may_outlast: bool, finished: &Finished) -> Self {
        let is_in_span = |ms: &f64| (back_ms..next_ms).contains(ms);
        let first = |ms: fn(&StationHeard) -> f64| {
            let mut times = finished.stations.iter().map(ms);
            times.find(is_in_span).map(|ms| ms - back_ms)
        };
        let heard_ms = first(|of| of.heard_ms);
        let went_on = may_outlast && heard_ms.is_none();
        let if_none = if went_on { 0.0 } else { -1.0 };
        Self {
            heard_ms: heard_ms.unwrap_or(if_none),
            synchronised_ms: first(|of| of.synchronised_ms).unwrap_or(if_none),
        }
    }
}

/// What undisturbed runs of the same length came to.
#[derive(Debug, Clone, Default)]
pub struct Undisturbed {
    /// Median of their largest steps of the force, newtons a period.
    pub step_n: f64,
    /// The front that each of them ended with; `None` when they differ, or there was none.
    pub front: Option<u64>,
    /// Whether they ended with different fronts.
    pub fronts_differ: bool,
    /// Largest number of periods that one of them missed by own work.
    pub missed_own_cpu: u64,
    /// Time in which a station that is back must be synchronised, milliseconds.
    pub resync_ms: f64,
}

impl Undisturbed {
    /// The largest step that a disturbed run may have, newtons a period.
    #[must_use]
    pub fn limit_n(&self) -> f64 {
        STEP_N.max(STEP_RATIO * self.step_n)
    }

    /// What is wrong with a run, in words; nothing with a good one.
    #[must_use]
    pub fn complaints(&self, touched: &Touched) -> Vec<String> {
        let result = &touched.finished.result;
        let mut wrong = Vec::new();
        if result.missed_own_cpu > 0 {
            wrong.push(format!(
                "{} periods missed by own work, {} page faults in those ticks",
                result.missed_own_cpu, result.page_faults_missed
            ));
        }
        if result.unaccounted_periods != 0 {
            wrong.push(format!(
                "{} periods without a record: they are in no figure",
                result.unaccounted_periods
            ));
        }
        let (step, limit) = (result.force_step_per_period_n_max, self.limit_n());
        if step > limit {
            wrong.push(format!(
                "a force step of {step:.2} N a period, above {limit:.2} N"
            ));
        }
        if result.contact_ticks == 0 {
            wrong.push("nothing was touched".to_string());
        }
        if result.contact_unbounded_ticks > 0 {
            wrong.push(format!(
                "{} ticks in contact without a certified error",
                result.contact_unbounded_ticks
            ));
        }
        match self.front {
            None => wrong.push("no front to compare with".to_string()),
            Some(front) if front != result.front_hash => {
                wrong.push("another front at rest than a fresh start's".to_string());
            }
            Some(_) => {}
        }
        for again in &touched.resyncs {
            let (heard, ms) = (again.heard_ms, again.synchronised_ms);
            if ms < 0.0 {
                wrong.push("the station was not synchronised again".to_string());
            } else if ms > self.resync_ms {
                wrong.push(format!(
                    "synchronised only after {ms:.0} ms, heard after {heard:.0}"
                ));
            }
        }
        if let Some(first) = touched.left.first() {
            let (count, first) = (touched.left.len(), first.display());
            wrong.push(format!("{count} files left, {first} among them"));
        }
        wrong
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrtc::result::RunResult;

    fn again(synchronised_ms: f64) -> Resync {
        Resync {
            heard_ms: 700.0,
            synchronised_ms,
        }
    }

    fn good() -> Touched {
        Touched {
            finished: Box::new(Finished {
                result: RunResult {
                    contact_ticks: 1,
                    front_hash: 5,
                    // Over skipped periods.
                    force_step_n_max: 0.9,
                    force_step_per_period_n_max: 0.29,
                    ..RunResult::default()
                },
                ..Finished::default()
            }),
            resyncs: vec![again(900.0)],
            left: Vec::new(),
        }
    }

    #[test]
    fn each_rule_alone_fails_a_run() {
        let undisturbed = Undisturbed {
            step_n: 0.1,
            front: Some(5),
            fronts_differ: false,
            // It excuses none of a disturbed run.
            missed_own_cpu: 4,
            resync_ms: RESYNC_MS,
        };
        assert_eq!(undisturbed.complaints(&good()), Vec::<String>::new());
        let spoil: [fn(&mut Touched); 8] = [
            |of| of.finished.result.missed_own_cpu = 1,
            |of| of.finished.result.unaccounted_periods = 1,
            |of| of.finished.result.force_step_per_period_n_max = 0.31,
            |of| of.finished.result.contact_ticks = 0,
            |of| of.finished.result.front_hash = 6,
            |of| of.resyncs.push(again(1001.0)),
            |of| of.resyncs.push(again(-1.0)),
            |of| of.left.push("x".into()),
        ];
        for spoil in spoil {
            let mut run = good();
            spoil(&mut run);
            assert_eq!(undisturbed.complaints(&run).len(), 1);
        }
        let mut run = good();
        run.finished.result.front_hash = 6;
        let other = "another front at rest than a fresh start's";
        assert_eq!(undisturbed.complaints(&run), [other]);
        let rough = Undisturbed {
            step_n: 0.4,
            front: None,
            fronts_differ: true,
            ..undisturbed
        };
        assert_eq!(rough.limit_n(), STEP_RATIO * 0.4);
        // The run is not to blame for that.
        assert_eq!(rough.complaints(&good()), ["no front to compare with"]);
    }

    #[test]
    fn a_return_is_matched_with_the_first_synchronisation_after_it() {
        let heard = |heard_ms: f64, synchronised_ms: f64| StationHeard {
            heard_ms,
            synchronised_ms,
        };
        let finished = Finished {
            stations: vec![heard(1.0, 9.0), heard(50.0, -1.0), heard(70.0, 80.0)],
            ..Finished::default()
        };
        let times = |span, may_outlast| {
            let of = Resync::of(span, may_outlast, &finished);
            (of.heard_ms, of.synchronised_ms)
        };
        for may_outlast in [false, true] {
            assert_eq!(times((40.0, f64::INFINITY), may_outlast), (10.0, 40.0));
            assert_eq!(times((40.0, 75.0), may_outlast), (10.0, -1.0), "anew");
        }
        assert_eq!(times((90.0, 99.0), false), (-1.0, -1.0));
        assert_eq!(times((90.0, 99.0), true), (0.0, 0.0), "none began anew");
    }
}
