//! One run of both processes: started together, watched, ended together.

use super::own_domain::OwnDomain;
use super::process::{Event, Process};
use super::roles::LoopArgs;
use super::stop::is_set;
use crate::failure::Failure;
use crate::machine::cores;
use hrtc::result::{Finished, Status, SupervisedLine};
use hrtc::run::next_tick_core;
use realtime::rights::monotonic_ns;
use scene::ScenePlan;
use scene_args::{OverrideArgs, typed_path};
use std::ffi::OsString;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

/// Restarts of a station in one run at the most.
const MAX_RESTARTS: usize = 3;
/// How long the controller may take beyond its seconds before it counts as hanging.
const PATIENCE: Duration = Duration::from_secs(30);
/// How long a process may take to end when asked.
const ENDING: Duration = Duration::from_secs(5);

/// What a run is told.
#[derive(Debug, Clone)]
pub struct PairArgs<'a> {
    /// Scene file.
    pub scene: &'a Path,
    /// Its plan, for the core of the tick.
    pub plan: &'a ScenePlan,
    /// Length, seconds.
    pub seconds: f64,
    /// Over the scene.
    pub overrides: &'a OverrideArgs,
    /// Over the scene's loop.
    pub loop_: LoopArgs,
    /// First file of the recording, or "off"; without one the run is recorded all the same, as a
    /// user's would be, and the files are removed after it.
    pub record: Option<&'a Path>,
    /// File with a device in place of that of the first probe.
    pub device: Option<&'a Path>,
}

/// What became of it.
#[derive(Debug)]
pub struct Outcome {
    /// What the controller counted.
    pub finished: Finished,
    /// What disturbed it, a sentence each: a station that had to start again.
    pub notes: Vec<String>,
    /// Whether the controller was ended by force after its result.
    pub is_late: bool,
    /// Whether it ended before its time, on request.
    pub is_early: bool,
    /// Why the run failed though there is a result of it: a panic of the tick, for example.
    pub failure: Option<Failure>,
}

impl Outcome {
    /// The run, for who measures it: one that failed or was disturbed is no measure.
    ///
    /// # Errors
    /// With why it failed, or what disturbed it.
    pub fn undisturbed(self) -> Result<Finished, Failure> {
        if let Some(failure) = self.failure {
            return Err(failure);
        }
        if self.notes.is_empty() {
            return Ok(self.finished);
        }
        Err(Failure::Run(self.notes.join("; ")))
    }

    /// What a report has to say of it, a sentence each.
    #[must_use]
    pub fn told(&self) -> Vec<String> {
        let early = self.is_early.then_some("ended early on request");
        let late = self.is_late.then_some(
            "the controller took long to end after its result and was ended by force: its recording may lack its end",
        );
        let notes = self.notes.iter().map(String::as_str);
        let told = early.into_iter().chain(notes).chain(late);
        told.map(str::to_string).collect()
    }

    /// Fails with why the run did, or with the figures of which a value was not finite: there is a
    /// result, but no report of it.
    ///
    /// # Errors
    /// When it failed, or there are such figures.
    pub fn check_finite(&self) -> Result<(), Failure> {
        if let Some(failure) = &self.failure {
            return Err(failure.clone());
        }
        match &self.finished.result.non_finite[..] {
            [] => Ok(()),
            names => Err(Failure::Run(format!(
                "values were not finite, so these figures are left out: {}",
                names.join(", ")
            ))),
        }
    }
}

/// The core of everything but the tick of a pair that is started now, when there are two: the
/// tick's thread binds itself to its own. That is another one while another run has the quieter.
#[must_use]
pub fn other_core(plan: &ScenePlan) -> Option<usize> {
    let tick = next_tick_core(&plan.loop_)?;
    (cores() >= 2).then(|| usize::from(tick == 0))
}

/// Runs both processes until the time is over or `stop` is set; `show` gets the live status and
/// what they say.
///
/// # Errors
/// When a process cannot be started, or ends before there is a result.
pub fn run_pair(
    args: &PairArgs,
    stop: &AtomicBool,
    show: &mut dyn FnMut(Shown),
) -> Result<Outcome, Failure> {
    let domain = OwnDomain::new().map_err(|error| Failure::Run(error.to_string()))?;
    let unkept = tempfile::tempdir()
        .map_err(|error| Failure::Run(format!("no folder for the recording: {error}")))?;
    let unkept_file = unkept.path().join("recording.mcap");
    let is_recorded = args.plan.record.keep_bytes.is_some();
    let record = args.record.or(is_recorded.then_some(unkept_file.as_path()));
    Processes::start(args, record, domain.name()).and_then(|mut pair| {
        let finished = pair.watch(args.seconds, stop, show);
        pair.station.terminate();
        pair.station.wait(ENDING);
        let notes = std::mem::take(&mut pair.notes);
        let (is_early, is_late) = (pair.is_early, pair.is_late);
        finished.map(|(finished, failure)| Outcome {
            finished,
            notes,
            is_late,
            is_early,
            failure,
        })
    })
}

/// For the live line.
#[derive(Debug, Clone, Copy)]
pub enum Shown<'a> {
    /// How the run stands.
    Status(&'a Status),
    /// A line that a process said, and its name.
    Said(&'a str, &'a str),
}

struct Processes {
    station: Process,
    station_arguments: Vec<OsString>,
    core: Option<usize>,
    restarts: usize,
    controller: Process,
    events: Receiver<Event>,
    sender: Sender<Event>,
    notes: Vec<String>,
    is_late: bool,
    is_early: bool,
}

impl Processes {
    fn start(args: &PairArgs, record: Option<&Path>, domain: &str) -> Result<Self, Failure> {
        let (sender, events) = channel();
        let started = monotonic_ns();
        let core = other_core(args.plan);
        let role = |role: &str| -> Vec<OsString> {
            let mut typed = vec![role.into(), "--domain".into(), domain.into()];
            typed.extend(args.overrides.typed());
            typed.extend(args.loop_.typed());
            typed
        };
        // "--" lets a scene's name begin with a hyphen.
        let scene = [OsString::from("--"), args.scene.into()];
        let mut station_arguments = role("role-station");
        station_arguments.extend(scene.clone());
        let mut controller_arguments = role("role-hrtc");
        controller_arguments.push(format!("--seconds={}", args.seconds).into());
        controller_arguments.push(format!("--started-ns={started}").into());
        controller_arguments.extend(typed_files(record, args.device));
        controller_arguments.extend(scene);
        let station = Process::start("station", &station_arguments, core, &sender)?;
        let controller = Process::start("controller", &controller_arguments, core, &sender)?;
        Ok(Self {
            station,
            station_arguments,
            core,
            restarts: 0,
            controller,
            events,
            sender,
            notes: Vec::new(),
            is_late: false,
            is_early: false,
        })
    }

    /// Until the controller ended; its result, and why it failed beside that.
    fn watch(
        &mut self,
        seconds: f64,
        stop: &AtomicBool,
        show: &mut dyn FnMut(Shown),
    ) -> Result<(Finished, Option<Failure>), Failure> {
        let mut finished = None;
        let mut asked: Option<Instant> = None;
        let hanging = Instant::now() + Duration::from_secs_f64(seconds) + PATIENCE;
        loop {
            match self.events.recv_timeout(Duration::from_millis(50)) {
                Ok(event) => take(event, &mut finished, show),
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {}
            }
            if let Some(status) = self.controller.ended() {
                // All its output is read before its end is judged.
                self.controller.wait(ENDING);
                while let Ok(event) = self.events.try_recv() {
                    take(event, &mut finished, show);
                }
                return with_failure(finished, status.success(), || {
                    self.controller.failure(Some(status))
                });
            }
            if is_set(stop) && asked.is_none() {
                asked = Some(Instant::now());
                self.is_early = true;
                self.controller.terminate();
            }
            let late = asked.is_some_and(|asked| asked.elapsed() > ENDING);
            if late || Instant::now() > hanging {
                let _ = self.controller.wait(Duration::ZERO);
                while let Ok(event) = self.events.try_recv() {
                    take(event, &mut finished, show);
                }
                if let Some(finished) = finished
                    && finished.result.safety.tick_panics == 0
                {
                    self.is_late = true;
                    return Ok((finished, None));
                }
                return Err(Failure::Run(
                    "the controller did not end in time and was ended by force; there is no result"
                        .to_string(),
                ));
            }
            self.mind_station(asked.is_some())?;
        }
    }

    /// Restarts a station that died; one that refuses its input ends the run.
    fn mind_station(&mut self, ending: bool) -> Result<(), Failure> {
        let Some(status) = self.station.ended() else {
            return Ok(());
        };
        if ending {
            return Ok(());
        }
        self.station.wait(ENDING);
        let failure = self.station.failure(Some(status));
        if failure.status() == 2 || self.restarts == MAX_RESTARTS {
            self.controller.terminate();
            self.controller.wait(ENDING);
            return Err(failure);
        }
        self.restarts += 1;
        self.notes.push(format!(
            "{failure}; it was restarted ({} of at most {MAX_RESTARTS})",
            self.restarts
        ));
        self.station = Process::start("station", &self.station_arguments, self.core, &self.sender)?;
        Ok(())
    }
}

/// The controller's options that name a file.
fn typed_files(record: Option<&Path>, device: Option<&Path>) -> Vec<OsString> {
    let record = record.map(|path| typed_path("record", path));
    let device = device.map(|path| typed_path("device", path));
    record.into_iter().chain(device).collect()
}

/// The result of a controller, and why it failed where it did; the failure alone where there is no
/// result. What was not finite is named in that: the caller fails with it.
fn with_failure(
    finished: Option<Finished>,
    is_success: bool,
    failure: impl FnOnce() -> Failure,
) -> Result<(Finished, Option<Failure>), Failure> {
    match finished {
        Some(finished) => {
            let is_told = is_success || !finished.result.non_finite.is_empty();
            let failure = (!is_told).then(failure);
            Ok((finished, failure))
        }
        None => Err(failure()),
    }
}

fn take(event: Event, finished: &mut Option<Finished>, show: &mut dyn FnMut(Shown)) {
    match event {
        Event::Line("controller", line) => match serde_json::from_str(&line) {
            Ok(SupervisedLine::Status { status }) => show(Shown::Status(&status)),
            Ok(SupervisedLine::Finished(result)) => *finished = Some(*result),
            // Not ours: shown, not judged.
            Err(_) => show(Shown::Said("controller", &line)),
        },
        Event::Line(name, line) | Event::Said(name, line) => show(Shown::Said(name, &line)),
    }
}

#[cfg(test)]
mod tests {
    use super::super::roles::ControllerArgs;
    use super::*;
    use crate::scenes::BUNDLED_SCENE;
    use clap::Parser;
    use realtime::core_claim::CoreClaim;
    use realtime::rights::usable_cores;
    use scene::{NoFiles, Overrides, parse};

    #[derive(Debug, Parser)]
    struct Role {
        #[command(flatten)]
        args: ControllerArgs,
    }

    #[test]
    fn files_whose_names_begin_with_a_hyphen_reach_the_controller() {
        let (record, device) = (Path::new("-r.mcap"), Path::new("--seconds"));
        let head = ["role", "--domain=d", "--seconds=1", "--started-ns=1"].map(OsString::from);
        let scene = ["--", "-s.toml"].map(OsString::from);
        let files = typed_files(Some(record), Some(device));
        let typed = head.into_iter().chain(files).chain(scene);
        let read = Role::try_parse_from(typed).unwrap().args;
        assert_eq!(read.record.as_deref(), Some(record));
        assert_eq!(read.device.as_deref(), Some(device));
        assert_eq!(typed_files(None, None), Vec::<OsString>::new());
    }

    #[test]
    fn everything_else_stays_off_the_core_that_a_tick_gets_beside_other_runs() {
        let (folder, overrides) = (Path::new(""), Overrides::default());
        let plan = parse(
            BUNDLED_SCENE,
            "first-touch.toml",
            folder,
            &overrides,
            &NoFiles,
        )
        .unwrap();
        let Some(quiet) = next_tick_core(&plan.loop_) else {
            return;
        };
        let cores = usable_cores();
        let free = cores.iter().copied().find(|&core| core != quiet).unwrap();
        // A run of somebody else may have it: then none is free.
        if CoreClaim::take(free).is_none() {
            return;
        }
        let others = cores.iter().filter(|&&core| core != free);
        let _claims: Vec<Option<CoreClaim>> = others.map(|&core| CoreClaim::take(core)).collect();
        assert_ne!(other_core(&plan), Some(free));
    }

    #[test]
    fn a_run_that_failed_keeps_its_result_and_is_no_measure() {
        let failure = || Failure::Run("the tick panicked".to_string());
        let mut finished = Finished::default();
        finished.result.ticks = 7;
        let (kept, failed) = with_failure(Some(finished.clone()), false, failure).unwrap();
        assert_eq!((kept.result.ticks, &failed), (7, &Some(failure())));
        let outcome = Outcome {
            finished: kept,
            notes: Vec::new(),
            is_late: false,
            is_early: false,
            failure: failed,
        };
        assert_eq!(outcome.check_finite(), Err(failure()));
        assert_eq!(outcome.undisturbed(), Err(failure()));
        let sound = with_failure(Some(finished.clone()), true, failure);
        assert_eq!(sound, Ok((finished.clone(), None)));
        finished.result.non_finite = vec!["force_n".to_string()];
        let named = with_failure(Some(finished.clone()), false, failure);
        assert_eq!(named, Ok((finished, None)), "the result says it");
        assert_eq!(with_failure(None, false, failure), Err(failure()));
    }

    #[test]
    fn a_disturbed_run_is_no_measure_and_one_that_ended_on_request_is_not_disturbed() {
        let outcome = |notes: &[&str]| Outcome {
            finished: Finished::default(),
            notes: notes.iter().map(ToString::to_string).collect(),
            is_late: true,
            is_early: true,
            failure: None,
        };
        let told = outcome(&["it hung"]).told();
        assert_eq!(told[..2], ["ended early on request", "it hung"]);
        assert!(told[2].contains("ended by force"), "{told:?}");
        assert_eq!(outcome(&[]).undisturbed(), Ok(Finished::default()));
        assert_eq!(
            outcome(&["it crashed", "it hung"]).undisturbed(),
            Err(Failure::Run("it crashed; it hung".to_string()))
        );
    }
}
