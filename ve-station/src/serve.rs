//! `ve-station serve`: the shell that joins database, core and connection.

use crate::clients::{self, ClientStatus};
use crate::connection::Connection;
use crate::database::{Database, DatabaseError};
use crate::tuning::link::STATUS_KEPT;
use crate::tuning::models::{BUILD_STACK_BYTES, STOP_POLL, TOLD_AFTER};
use crate::viewer::{Viewer, ViewerError};
use file_transfer::FileServer;
use indicatif::{ProgressBar, ProgressStyle};
use scene::{self, Overrides, SceneError, ScenePlan};
use scene_files::{NotingFiles, Package};
use serde::Serialize;
use spm_builder::{Progress, TerminalProgress};
use station_core::station::{Counters, Station};
use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::thread;
use std::time::{Instant, SystemTime, UNIX_EPOCH};
use thiserror::Error;
use transport::{Domain, TransportError};

/// What `ve-station serve` was told.
#[derive(Debug, Clone, PartialEq)]
pub struct ServeArgs {
    /// The scene file.
    pub scene: PathBuf,
    /// Name of the iceoryx2 domain.
    pub domain: String,
    /// What the command line says over the scene.
    pub overrides: Overrides,
    /// Where touches are shown ([`crate::viewer`]); `None` for nowhere.
    pub view: Option<String>,
    /// Print one JSON object at the end, on standard output.
    pub json: bool,
}

/// Why nothing is served: one sentence.
#[derive(Debug, Error)]
pub enum ServeError {
    /// The scene.
    #[error("{0}")]
    Scene(#[from] SceneError),
    /// A model.
    #[error("{0}")]
    Database(#[from] DatabaseError),
    /// The transport.
    #[error("{0}")]
    Transport(#[from] TransportError),
    /// The viewer.
    #[error("{0}")]
    Viewer(#[from] ViewerError),
    /// The operating system gave no thread.
    #[error("cannot start the thread that opens the models: {0}")]
    Thread(std::io::Error),
    /// The thread that opens the models panicked.
    #[error(
        "the models cannot be opened by a defect in ve-station; please report what it printed above"
    )]
    Panicked,
    /// Asked to stop before anything was served.
    #[error("stopped before the models were ready")]
    Stopped,
}

/// What `--json` prints when the service ends.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ServeReport {
    /// Name of the scene.
    pub scene: String,
    /// Name of the domain.
    pub domain: String,
    /// What happened.
    #[serde(flatten)]
    pub counters: Counters,
    /// Heartbeats refused: of another version or byte order, or none at all.
    pub refused_heartbeats: u64,
    /// Chunks handed out of the scene's plan and files.
    pub file_chunks: u64,
}

/// Serves a scene until `stop` is set.
///
/// Tells on standard error what is served and, with the line `ready`, that requests are heard; it
/// waits for nobody to read that, but for a moment at its end.
///
/// # Errors
/// When the scene, a model or the domain cannot be used, or `stop` was set before the models were
/// ready; nothing is served then.
pub fn serve(args: &ServeArgs, stop: &AtomicBool) -> Result<ServeReport, ServeError> {
    let _lines = transport::logging::queue();
    let domain = Domain::new(&args.domain)?;
    let files = NotingFiles::default();
    let plan = scene::load(&args.scene, &args.overrides, &files)?;
    let mut viewer = match &args.view {
        Some(target) => Some(Viewer::new(&plan, target)?),
        None => None,
    };
    let database = open_models(&plan, stop)?;
    for (index, model) in database.models.iter().enumerate() {
        let head = model.file.model_header();
        let objects = database.objects.iter().filter(|o| o.model == index);
        let of = match objects.count() {
            0 | 1 => String::new(),
            count => format!("{count} objects: "),
        };
        note(&format!(
            "{of}{}, {} faces, {} regions, base mesh of {} faces",
            model.name,
            head.faces,
            model.file.regions().len(),
            head.base_faces
        ));
    }
    let station = Station::new(incarnation(), database.models, database.objects);
    let files = served_files(args, files, station.incarnation());
    let mut connection = Connection::open(&domain, station)?.with_files(files);
    note("ready");
    let mut status = StatusLine::new();
    connection.run_telling(stop, move |clients| {
        status.show(clients);
        if let Some(viewer) = &mut viewer {
            viewer.look(note);
        }
    });
    let report = ServeReport {
        scene: plan.name,
        domain: args.domain.clone(),
        counters: connection.station().counters(),
        refused_heartbeats: connection.refused_heartbeats(),
        file_chunks: connection.files().counters().chunks,
    };
    if args.json
        && let Ok(text) = serde_json::to_string(&report)
    {
        // Nobody may be left to read it.
        let _ = writeln!(std::io::stdout(), "{text}");
    }
    Ok(report)
}

/// The scene and its files for controllers that have none of them. A scene that cannot travel is
/// served to those that have it.
fn served_files(args: &ServeArgs, read: NotingFiles, station: u64) -> FileServer {
    match Package::new(&args.scene, &args.overrides, &read.into_kept()) {
        Ok(package) => FileServer::new(station, package.manifest, package.contents),
        Err(error) => {
            note(&format!(
                "controllers need the scene file themselves, it is not given away: {error}"
            ));
            FileServer::empty(station)
        }
    }
}

/// Says a line on standard error.
fn note(line: &str) {
    transport::logging::line(format_args!("{line}"));
}

/// The line that tells who is connected: on a terminal one that is kept up to date and goes at the
/// end, elsewhere one for each controller that comes or goes, and now and then.
struct StatusLine {
    bar: ProgressBar,
    /// The clients that were listed last, and when.
    listed: (Vec<u64>, Instant),
}

impl StatusLine {
    fn new() -> Self {
        let bar = ProgressBar::new_spinner();
        if let Ok(style) = ProgressStyle::with_template("{wide_msg}") {
            bar.set_style(style);
        }
        Self {
            bar,
            listed: (Vec::new(), Instant::now()),
        }
    }

    fn show(&mut self, clients: &[ClientStatus]) {
        let line = clients::line(clients);
        if !self.bar.is_hidden() {
            self.bar.set_message(line);
            return;
        }
        let ids: Vec<u64> = clients.iter().map(|of| of.client).collect();
        let (listed, since) = &self.listed;
        let is_due = !ids.is_empty() && since.elapsed() >= STATUS_KEPT;
        if ids != *listed || is_due {
            note(&line);
            self.listed = (ids, Instant::now());
        }
    }
}

impl Drop for StatusLine {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Opens the models on a thread of its own, so that a request to stop is heard while one is built.
/// The thread of a stopped service is left to end with the process.
fn open_models(plan: &ScenePlan, stop: &AtomicBool) -> Result<Database, ServeError> {
    let (opened, wait) = sync_channel(1);
    let plan = plan.clone();
    let open = move || {
        let progress = TerminalProgress::new();
        progress.phase("opening models", 0);
        let database = Database::open(&plan, &progress);
        progress.finish();
        // Nobody waits after a stop.
        let _ = opened.send(database);
    };
    let thread = thread::Builder::new().name("models".to_owned());
    let thread = thread.stack_size(BUILD_STACK_BYTES);
    thread.spawn(open).map_err(ServeError::Thread)?;
    let began = Instant::now();
    // A terminal shows a bar.
    let mut is_told = std::io::stderr().is_terminal();
    loop {
        if !is_told && began.elapsed() >= TOLD_AFTER {
            is_told = true;
            note(
                "the models are not ready yet: a mesh is built when it is first used, here or by another program, which takes minutes for millions of faces",
            );
        }
        match wait.recv_timeout(STOP_POLL) {
            Ok(database) => return Ok(database?),
            Err(RecvTimeoutError::Disconnected) => return Err(ServeError::Panicked),
            Err(RecvTimeoutError::Timeout) if stop.load(Ordering::Relaxed) => {
                return Err(ServeError::Stopped);
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
    }
}

/// A number that no other start has: the time, with the process mixed in. Never 0, which means
/// none.
fn incarnation() -> u64 {
    let now = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(0, |d| d.as_nanos() as u64);
    (now ^ u64::from(std::process::id()) << 48).max(1)
}
