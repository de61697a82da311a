//! The scene of a run: a file of this machine, or the station's.

use super::{RunArgs, RunError, new_identity};
use crate::fetch::{FetchOptions, fetch};
use crate::message::note;
use crate::tuning::FETCH_STATION;
use scene::{Files, Overrides, SceneError, ScenePlan};
use scene_files::{DiskFiles, FileCache, KeptFiles, NotingFiles, cache_folder};
use std::path::{Path, PathBuf};
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
        let mut overrides = manifest.under(&args.overrides);
        let mut files = manifest.kept(&overrides, fetched.contents);
        add_own_devices(&mut overrides, &mut files, &DiskFiles);
        let path = manifest.path();
        let mut plan = load_sent(&path, &overrides, &files)?;
        // What a station says about this machine's disk does not count, but that nothing is kept.
        plan.record = scene::RecordPlan {
            keep_bytes: plan.record.keep_bytes.map(|_| super::KEEP_BYTES),
            path: None,
        };
        Ok(Self {
            path,
            overrides,
            plan,
            files,
        })
    }
}

/// Adds the devices' files of this machine to those that a station sent.
fn add_own_devices(overrides: &mut Overrides, files: &mut KeptFiles, disk: &dyn Files) {
    for device in &mut overrides.devices {
        // What was sent has names without a folder: one of the same name is another file.
        *device = Path::new(".").join(&*device);
        // One that cannot be read is named when the scene is loaded.
        if let Ok(content) = disk.read(device) {
            files.contents.insert(device.clone(), content);
        }
    }
}

/// Reads a scene that a station sent. What is refused in it, now or when its devices are made, is
/// not named as a file that could be opened.
fn load_sent(
    path: &Path,
    overrides: &Overrides,
    files: &KeptFiles,
) -> Result<ScenePlan, SceneError> {
    let path_shown = path.display().to_string();
    let shown = format!(
        "the station's scene {path_shown} as it was sent (its lines are not those of the station's file)"
    );
    let mut plan = scene::load(path, overrides, files).map_err(|error| {
        match error.0.strip_prefix(&path_shown) {
            Some(rest) => SceneError(format!("{shown}{rest}")),
            // Of a device's file of this machine.
            None => error,
        }
    })?;
    let devices = plan.probes.iter_mut();
    for device in devices.filter_map(|probe| probe.custom_device.as_mut()) {
        device.file.get_or_insert_with(|| shown.clone().into());
    }
    Ok(plan)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::devices::DeviceRegistry;

    #[test]
    fn what_is_refused_in_a_sent_scene_is_named_as_sent_and_an_own_file_by_its_name() {
        let path = Path::new("touch.toml");
        let sent = |probe: &str, own: Option<&str>| {
            let text = format!("[[object]]\nmodel = \"m.spm\"\nsize_m = 0.1\n[[probe]]\n{probe}\n");
            let mut files = KeptFiles::default();
            files.contents.insert(path.to_path_buf(), text.into());
            let mut overrides = Overrides::default();
            if let Some(own) = own {
                overrides.devices.push("own.toml".into());
                files.contents.insert("own.toml".into(), own.into());
            }
            let plan = load_sent(path, &overrides, &files)?;
            let probe = &plan.probes[0];
            DeviceRegistry::new().make(path, 0, probe, 1e-3).map(|_| ())
        };
        let absent = "device = { custom = { name = \"absent\" } }";
        for probe in ["trajectory = { csv = \"absent.csv\" }", absent] {
            let sentence = sent(probe, None).unwrap_err().to_string();
            let place = "the station's scene touch.toml as it was sent (";
            assert!(sentence.starts_with(place), "{sentence}");
            assert!(sentence.contains("), line 5: "), "{sentence}");
        }
        for own in ["device = { custom = { port = 1 } }", absent] {
            let sentence = sent("", Some(own)).unwrap_err().to_string();
            assert!(sentence.starts_with("own.toml, line 1: "), "{sentence}");
        }
        assert_eq!(sent("", None), Ok(()));
    }

    #[test]
    fn a_device_file_of_the_name_of_the_stations_scene_is_another_file() {
        let path = Path::new("arm.toml");
        let mut files = KeptFiles::default();
        let text = "[[object]]\nmodel = \"m.spm\"\nsize_m = 0.1\n[[probe]]\n";
        files.contents.insert(path.to_path_buf(), text.into());
        let mut disk = KeptFiles::default();
        let device = "device = { simulated = { mass_kg = 0.5 } }";
        // As this machine's disk has it, whether the folder is typed or not.
        for own in [path, Path::new("./arm.toml")] {
            disk.contents.insert(own.to_path_buf(), device.into());
        }
        let mut overrides = Overrides::default();
        overrides.devices.push(path.to_path_buf());
        add_own_devices(&mut overrides, &mut files, &disk);
        let plan = load_sent(path, &overrides, &files).unwrap();
        assert_eq!(plan.probes[0].device.mass_kg, 0.5);
        assert_eq!(plan.objects.len(), 1);
    }
}
