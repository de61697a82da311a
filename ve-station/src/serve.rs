//! `ve-station serve`: the shell that joins database, core and connection.

use crate::connection::Connection;
use crate::database::{Database, DatabaseError};
use scene::{self, Overrides, SceneError};
use scene_files::DiskFiles;
use serde::Serialize;
use spm_builder::{Progress, TerminalProgress};
use station_core::station::{Counters, Station};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::{SystemTime, UNIX_EPOCH};
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
}

/// Serves a scene until `stop` is set.
///
/// Tells on standard error what is served and, with the line `ready`, that requests are heard.
///
/// # Errors
/// When the scene, a model or the domain cannot be used; nothing is served then.
pub fn serve(args: &ServeArgs, stop: &AtomicBool) -> Result<ServeReport, ServeError> {
    let domain = Domain::new(&args.domain)?;
    let plan = scene::load(&args.scene, &args.overrides, &DiskFiles)?;
    let progress = TerminalProgress::new();
    progress.phase("opening models", 0);
    let database = Database::open(&plan, &progress);
    progress.finish();
    let database = database?;
    for (index, model) in database.models.iter().enumerate() {
        let head = model.file.model_header();
        let objects = database.objects.iter().filter(|o| o.model == index);
        let of = match objects.count() {
            0 | 1 => String::new(),
            count => format!("{count} objects: "),
        };
        eprintln!(
            "{of}{}, {} faces, {} regions, base mesh of {} faces",
            model.name,
            head.faces,
            model.file.regions().len(),
            head.base_faces
        );
    }
    let station = Station::new(incarnation(), database.models, database.objects);
    let mut connection = Connection::open(&domain, station)?;
    eprintln!("ready");
    connection.run(stop);
    let report = ServeReport {
        scene: plan.name,
        domain: args.domain.clone(),
        counters: connection.station().counters(),
    };
    if args.json
        && let Ok(text) = serde_json::to_string(&report)
    {
        println!("{text}");
    }
    Ok(report)
}

/// A number that no other start has: the time, with the process mixed in. Never 0, which means
/// none.
fn incarnation() -> u64 {
    let now = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(0, |d| d.as_nanos() as u64);
    (now ^ u64::from(std::process::id()) << 48).max(1)
}
