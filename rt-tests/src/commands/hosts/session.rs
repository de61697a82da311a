//! Touches of scenes, one after another; of each scene the one on one machine first.

use super::HostsArgs;
use super::asked::Asked;
use super::refused::{Refused, Trial};
use super::result::{Conditions, Found};
use super::touch::Bench;
use crate::commands::faults::{self, Faults};
use crate::failure::{Chosen, Failure};
use crate::links::hosts::{Links, STATION};
use crate::links::points::{Guest, Point};
use crate::links::programs::Programs;
use crate::links::way::Shape;
use crate::processes::stop::is_set;
use crate::report::output::{make_folder, make_folder_at, status_line};
use crate::scenes::{SceneFile, prepare_models};
use indicatif::ProgressBar;
use scene::{Overrides, ScenePlan, load};
use scene_args::OverrideArgs;
use scene_files::DiskFiles;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;
use tempfile::TempDir;

/// Seed of losses and jitter, and of the tour, where none is given.
const SEED: u64 = 1;

/// Kills of the processes of a link, and restarts of its station.
const KILLS: u64 = 10;

/// What is asked of a touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Ask {
    /// Nothing.
    Nothing,
    /// What is asked of its link.
    Link(&'static Asked),
    /// Each controller that is not stopped touches as it does alone over the same link.
    AsAlone,
}

/// Controllers that touch at the same time.
#[derive(Debug, Clone, PartialEq)]
pub struct Touch {
    /// The controllers.
    pub guests: Vec<Guest>,
    /// What is asked of them.
    pub ask: Ask,
}

impl Touch {
    /// A controller alone.
    #[must_use]
    pub fn alone(point: Point) -> Self {
        Self {
            guests: vec![Guest::at(point)],
            ask: Ask::Nothing,
        }
    }

    /// A controller over a link of which something is asked.
    #[must_use]
    pub fn asked(asked: &'static Asked) -> Self {
        Self {
            guests: vec![asked.guest()],
            ask: Ask::Link(asked),
        }
    }
}

/// A scene and its touches.
pub struct Setting {
    file: SceneFile,
    overrides: OverrideArgs,
    plan: ScenePlan,
    /// The touches over links.
    pub touches: Vec<Touch>,
}

impl Setting {
    /// Reads the scene.
    ///
    /// # Errors
    /// One sentence when it is refused.
    pub fn new(
        file: SceneFile,
        overrides: &OverrideArgs,
        touches: Vec<Touch>,
    ) -> Result<Self, Failure> {
        let plan = load(file.path(), &overrides.overrides(), &DiskFiles)?;
        Ok(Self {
            file,
            overrides: overrides.clone(),
            plan,
            touches,
        })
    }

    /// Seed of losses and jitter.
    fn seed(&self) -> u64 {
        self.overrides.seed.unwrap_or(SEED)
    }
}

/// What all touches of a command share.
pub struct Session<'a> {
    args: &'a HostsArgs,
    programs: Programs,
    /// Of keys and recordings.
    folder: TempDir,
    stop: Arc<AtomicBool>,
    bar: ProgressBar,
    begin: Instant,
    /// Touches that are over, and all.
    done: usize,
    of: usize,
}

impl<'a> Session<'a> {
    /// Finds the programs and makes keys, for so many touches until `stop` is set.
    ///
    /// # Errors
    /// What is missing, in one sentence.
    pub fn begin(args: &'a HostsArgs, of: usize, stop: Arc<AtomicBool>) -> Result<Self, Failure> {
        let programs = Programs::find()?;
        make_folder(&args.out)?;
        let folder = tempfile::tempdir()
            .map_err(|error| Failure::Run(format!("there is no temporary folder ({error})")))?;
        programs.make_keys(&folder.path().join("keys"), &STATION.to_string())?;
        Ok(Self {
            args,
            programs,
            folder,
            stop,
            bar: status_line(),
            begin: Instant::now(),
            done: 0,
            of,
        })
    }

    /// Touches a scene, after its models are built.
    ///
    /// # Errors
    /// What failed, in one sentence; what was found before it is there.
    pub fn run(&mut self, setting: &Setting, found: &mut Found) -> Result<(), Failure> {
        if is_set(&self.stop) {
            return Err(Failure::Run("ended early on request".to_string()));
        }
        prepare_models(&setting.plan)?;
        let path = setting.file.path();
        let scene = std::path::absolute(path)
            .map_err(|error| Failure::Input(format!("{}: {error}", path.display())))?;
        let stop = Arc::clone(&self.stop);
        let bench = self.bench(setting, scene, &stop);
        self.bar.set_message("one machine");
        let local = bench.local().map_err(|error| {
            let model = setting.plan.objects[0].model.name();
            Failure::Run(format!("{model} on one machine: {error}"))
        })?;
        found.take(local, Ask::Nothing);
        self.tell(found, "one machine");
        for touch in &setting.touches {
            let names = touch.guests.iter().map(|guest| guest.point.to_string());
            let names = names.collect::<Vec<_>>().join(" and ");
            let number = self.done + 1;
            self.bar
                .set_message(format!("{names} ({number} of {})", self.of));
            match bench.linked(&touch.guests) {
                Ok(touched) => found.take(touched, touch.ask),
                Err(error) if is_set(&self.stop) => return Err(error),
                // The other links are worth their time.
                Err(error) => found.failed.push(error.to_string()),
            }
            self.tell(found, &names);
        }
        self.bar.set_message("");
        Ok(())
    }

    fn bench<'b>(&self, setting: &Setting, scene: PathBuf, stop: &'b AtomicBool) -> Bench<'b> {
        let args = self.args;
        Bench {
            programs: self.programs.clone(),
            scene,
            overrides: setting.overrides.typed(),
            links: Links {
                keys: self.folder.path().join("keys"),
                shape: Shape {
                    jitter_s: args.jitter_ms * 1e-3,
                    damaged: args.damaged,
                    replayed: args.replayed,
                    ..Shape::default()
                },
                seed: setting.seed(),
            },
            folder: self.folder.path().to_path_buf(),
            seconds: args.seconds,
            rate_hz: setting.plan.loop_.rate_hz,
            soft_start_s: setting.plan.safety.ramp_s,
            cut_s: args.cut,
            stop,
        }
    }

    /// Nothing yet, under the conditions of a scene's touches.
    #[must_use]
    pub fn found(&self, setting: &Setting) -> Found {
        let args = self.args;
        Found {
            conditions: Conditions {
                seconds: args.seconds,
                seed: setting.seed(),
                jitter_ms: args.jitter_ms,
                cut_s: args.cut,
                damaged: args.damaged,
                replayed: args.replayed,
            },
            ..Found::default()
        }
    }

    /// Who is refused at a link, on the loopback.
    ///
    /// # Errors
    /// What failed, in one sentence.
    pub fn refuse(&self) -> Result<Vec<Refused>, Failure> {
        self.bar.set_message("who is refused");
        let file = SceneFile::named_or_bundled(None)?;
        prepare_models(&load(file.path(), &Overrides::default(), &DiskFiles)?)?;
        let folder = self.folder.path().join("refused");
        make_folder_at(Chosen::Temporary, &folder)?;
        Trial {
            programs: &self.programs,
            scene: file.path(),
            folder: &folder,
            stop: &self.stop,
        }
        .refuse()
    }

    /// What is done to links in contact: the cases of `rt-tests faults`.
    ///
    /// # Errors
    /// What failed, in one sentence.
    pub fn disturb(&self) -> Result<Faults, Failure> {
        self.bar.set_message("");
        faults::of_link(KILLS, &self.stop)
    }

    /// Says of a long command how far it is.
    fn tell(&mut self, found: &Found, names: &str) {
        self.done += 1;
        if !self.args.is_long() {
            return;
        }
        let each_s = self.begin.elapsed().as_secs_f64() / self.done as f64;
        let left = each_s * self.of.saturating_sub(self.done) as f64 / 60.0;
        let (done, of, model) = (self.done, self.of, &found.scene.model);
        self.bar.suspend(|| {
            eprintln!("{model}, {names}: {done} of {of}, {left:.0} minutes more");
        });
    }
}

impl Drop for Session<'_> {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
