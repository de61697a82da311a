//! The scene of a run: a file of this machine, or the station's.

use super::{RunArgs, RunError, new_identity};
use crate::fetch::{FetchOptions, fetch};
use crate::message::note;
use crate::tuning::FETCH_STATION;
use scene::{Overrides, ScenePlan};
use scene_files::{DiskFiles, FileCache, KeptFiles, NotingFiles, cache_folder};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use transport::Domain;

/// A scene, and what makes it again.
pub(super) struct LoadedScene {
    /// Its file; that of the station's scene is among `files` only.
    pub path: PathBuf,
    /// What the command line says over it; of the station's scene, also the station's.
    pub overrides: Overrides,
    pub plan: ScenePlan,
    /// All that was read for it.
    pub files: KeptFiles,
}

impl LoadedScene {
    /// Reads the scene of the arguments, or fetches the station's.
    pub fn new(args: &RunArgs, domain: &Domain, stop: &AtomicBool) -> Result<Self, RunError> {
        match &args.scene {
            Some(path) => {
                let files = NotingFiles::default();
                let plan = scene::load(path, &args.overrides, &files)?;
                Ok(Self {
                    path: path.clone(),
                    overrides: args.overrides.clone(),
                    plan,
                    files: files.into_kept(),
                })
            }
            None => Self::of_station(args, domain, stop),
        }
    }

    fn of_station(args: &RunArgs, domain: &Domain, stop: &AtomicBool) -> Result<Self, RunError> {
        let place = match &args.station {
            Some(address) => format!("at {address}"),
            None => format!("in domain {}", domain.name()),
        };
        let cache = cache_folder().map(|folder| FileCache::new(&folder));
        if cache.is_none() {
            note!("the scene's files are not kept for the next run: set HRTC_CACHE to a folder");
        }
        let options = FetchOptions {
            // Another client than the run's: a late chunk of a file is none of a session.
            client: new_identity().client,
            place,
            station_timeout: FETCH_STATION,
            cache,
        };
        let fetched = fetch(domain, &options, stop)?;
        let manifest = fetched.manifest;
        let overrides = manifest.under(&args.overrides);
        let mut files = manifest.kept(&overrides, fetched.contents);
        for device in &overrides.devices {
            // One that cannot be read is named when the scene is loaded.
            if let Ok(content) = scene::Files::read(&DiskFiles, device) {
                files.contents.insert(device.clone(), content);
            }
        }
        let path = manifest.path();
        let mut plan = scene::load(&path, &overrides, &files)?;
        // What a station says about this machine's disk does not count.
        plan.record.path = None;
        Ok(Self {
            path,
            overrides,
            plan,
            files,
        })
    }
}
