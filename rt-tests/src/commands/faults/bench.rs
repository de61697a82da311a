//! What all cases share: one folder with the model, the scenes and everything that the processes
//! may write.

use crate::failure::{Chosen, Failure};
use crate::processes::device_page::{DevicePage, NAME};
use crate::processes::pair::other_core;
use crate::processes::surroundings::Surroundings;
use crate::scenes::path_in_toml;
use indicatif::ProgressBar;
use scene::Overrides;
use scene_files::DiskFiles;
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, SoupMesh, build_model, write_spm_file};
use std::ffi::OsString;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use tempfile::TempDir;

/// Faces of the model: enough that a slide over it loads regions all the way.
const FACES: u32 = 20_000;
/// Longest side of the object, metres.
const SIZE_M: f64 = 0.15;
/// Time from the start of the path to the pressed touch, seconds.
const APPROACH_S: f64 = 1.5;
/// Time of a disturbance and its mending, seconds: half as long again as a station may take to be
/// synchronised.
pub const SLOT_S: f64 = 1.5;
/// Disturbances in one run at the most: a run as long as that of a person who tries.
pub const MAX_SLOTS: usize = 5;
/// Rest at the end of a path, seconds: 2 in which the front settles, and a fifth for the start.
const REST_S: f64 = 2.2;
/// Radius of the slide, metres, and the time of one round, seconds: 28 mm/s.
const RADIUS_M: f64 = 0.008;
const ROUND_S: f64 = 1.8;
/// Rounds of the slide over the large model, in disturbances: long enough for three controllers to
/// start and to slide together.
const LARGE_SLOTS: usize = 12;
/// Depth of the hand below the surface, metres: 1.6 N through the hand's stiffness of 200 N/m.
const HAND_DEPTH_M: f64 = 0.008;
/// Depth of the stiff device below the surface, metres: 2.4 N at 800 N/m.
const DEVICE_DEPTH_M: f64 = 0.003;

/// The bench.
pub struct Bench<'a> {
    folder: TempDir,
    /// The core of everything but the tick: chosen once, while no controller of the bench has
    /// claimed its own.
    core: Option<usize>,
    /// Height of the model's surface over the origin, metres.
    top: f64,
    /// The model's file as it was built.
    pub model_bytes: Vec<u8>,
    /// Disturbances in one run.
    pub slots: usize,
    /// Faces of the large model.
    pub large_faces: u32,
    /// Asks for an early end.
    pub stop: &'a AtomicBool,
    /// Says what is going on.
    pub bar: ProgressBar,
}

impl<'a> Bench<'a> {
    /// Builds the model and writes the scenes, for runs of so many disturbances.
    ///
    /// # Errors
    /// When the folder cannot be made or written.
    pub fn new(
        slots: usize,
        large_faces: u32,
        stop: &'a AtomicBool,
        bar: ProgressBar,
    ) -> Result<Self, Failure> {
        let folder = tempfile::tempdir()
            .map_err(|error| Failure::Run(format!("there is no temporary folder ({error})")))?;
        bar.set_message("building the model");
        let at = |name: &str| folder.path().join(name);
        let write = |name: &str, text: &str| {
            std::fs::write(at(name), text).map_err(|error| unwritten(&at(name), &error))
        };
        for name in ["cache", "tmp", "state", "disk"] {
            std::fs::create_dir(at(name)).map_err(|error| unwritten(&at(name), &error))?;
        }
        let mesh = generate(Shape::Relief, FACES, 1);
        let top = top_m(&mesh, SIZE_M);
        let parts = build_model(mesh, &BuildOptions::default(), &NoProgress)
            .map_err(|error| Failure::Run(error.to_string()))?;
        let model = at("model.spm");
        let wrong = |error: std::io::Error| unwritten(&model, &error);
        write_spm_file(&parts, &model).map_err(wrong)?;
        let model_bytes = std::fs::read(&model).map_err(wrong)?;
        let page = at("page");
        DevicePage::create(&page).map_err(|error| unwritten(&page, &error))?;
        write("slide.csv", &slide(top, slots))?;
        write("press.csv", &press(top))?;
        let simulated = "trajectory = { csv = \"slide.csv\" }";
        write("touch.toml", &scene("", "model", SIZE_M, simulated))?;
        write("slow.toml", &scene(SLOW, "model", SIZE_M, simulated))?;
        write("device.toml", &scene("", "model", SIZE_M, &pressed(&page)?))?;
        let plan = scene::load(&at("touch.toml"), &Overrides::default(), &DiskFiles)?;
        Ok(Self {
            folder,
            core: other_core(&plan),
            top,
            model_bytes,
            slots,
            large_faces,
            stop,
            bar,
        })
    }

    /// Makes `large.toml`: a model of [`Bench::large_faces`], as dense to the probe as the other,
    /// and a slide over it. The length of a run, seconds.
    ///
    /// # Errors
    /// When it cannot be built or written.
    pub fn add_large(&self) -> Result<f64, String> {
        let faces = self.large_faces;
        let words = |error: &dyn std::fmt::Display| error.to_string();
        self.bar
            .set_message(format!("building a model of {faces} faces"));
        let size_m = SIZE_M * (f64::from(faces) / f64::from(FACES)).sqrt();
        let mesh = generate(Shape::Relief, faces, 1);
        let top = top_m(&mesh, size_m);
        let parts = build_model(mesh, &BuildOptions::default(), &NoProgress);
        let parts = parts.map_err(|error| words(&error))?;
        write_spm_file(&parts, &self.path("large.spm")).map_err(|error| words(&error))?;
        let scene = scene(
            SLOW,
            "large",
            size_m,
            "trajectory = { csv = \"large.csv\" }",
        );
        for (name, text) in [
            ("large.csv", slide(top, LARGE_SLOTS)),
            ("large.toml", scene),
        ] {
            std::fs::write(self.path(name), text).map_err(|error| words(&error))?;
        }
        Ok(seconds(LARGE_SLOTS))
    }

    /// Makes `far.toml`: a slide over the model, with room for so many disturbances. The length of
    /// a run, seconds.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn add_far(&self, slots: usize) -> Result<f64, String> {
        let probe = "trajectory = { csv = \"far.csv\" }";
        for (name, text) in [
            ("far.csv", slide(self.top, slots)),
            ("far.toml", scene("", "model", SIZE_M, probe)),
        ] {
            std::fs::write(self.path(name), text).map_err(|error| error.to_string())?;
        }
        Ok(seconds(slots))
    }

    /// A file of the folder.
    #[must_use]
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Length of a run, seconds.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        seconds(self.slots)
    }

    /// Surroundings of a process that writes nowhere else, on the core of everything but the tick.
    #[must_use]
    pub fn around(&self) -> Surroundings {
        let at = |name: &str| OsString::from(self.path(name));
        Surroundings {
            core: self.core,
            variables: vec![
                ("HRTC_CACHE", at("cache")),
                ("TMPDIR", at("tmp")),
                ("XDG_STATE_HOME", at("state")),
            ],
            ..Surroundings::default()
        }
    }

    /// Files that processes left where nothing may be left: cache and temporary files.
    #[must_use]
    pub fn leftovers(&self) -> Vec<PathBuf> {
        ["cache", "tmp"]
            .iter()
            .flat_map(|name| files_below(&self.path(name)))
            .collect()
    }

    /// Writes the model's bytes over the file in place, without making another.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn overwrite_model(&self, bytes: &[u8]) -> std::io::Result<()> {
        use std::io::Write as _;
        let mut file = std::fs::File::options()
            .write(true)
            .open(self.path("model.spm"))?;
        file.write_all(bytes)?;
        file.set_len(bytes.len() as u64)
    }
}

/// Something of the bench's folder that cannot be written.
fn unwritten(path: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::write_at(Chosen::Temporary, path, error)
}

/// Files of a folder and of all folders in it.
#[must_use]
pub fn files_below(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .flat_map(|entry| match entry.file_type() {
            Ok(kind) if kind.is_dir() => files_below(&entry.path()),
            _ => vec![entry.path()],
        })
        .collect()
}

/// Head of the scenes of several controllers: loops at 1 kHz are more than two cores have; the
/// messages are the same.
const SLOW: &str = "[loop]\nrate_hz = 100\ncore = -1\n";

fn scene(head: &str, model: &str, size_m: f64, probe: &str) -> String {
    format!("{head}[[object]]\nmodel = \"{model}.spm\"\nsize_m = {size_m}\n[[probe]]\n{probe}\n")
}

/// The probe of a device in a process of its own, whose page is this file.
///
/// # Errors
/// When the path is not UTF-8.
fn pressed(page: &Path) -> Result<String, Failure> {
    let page = path_in_toml(page)?;
    Ok(format!(
        "device = {{ custom = {{ name = \"{NAME}\", file = {page} }} }}\ntrajectory = {{ csv = \"press.csv\" }}"
    ))
}

/// Length of a run with a slide over so many disturbances, seconds.
fn seconds(slots: usize) -> f64 {
    APPROACH_S + slots as f64 * SLOT_S + REST_S
}

/// Height of the surface over the origin when the object has this size, metres.
fn top_m(mesh: &SoupMesh, size_m: f64) -> f64 {
    let side = |axis: usize| {
        let values = mesh.positions.iter().map(|at| at[axis]);
        let least = values.clone().fold(f64::INFINITY, f64::min);
        values.fold(f64::NEG_INFINITY, f64::max) - least
    };
    let scale = size_m / (0..3).map(side).fold(0.0, f64::max);
    let upper = mesh.positions.iter().filter(|at| at[2] > 0.0);
    let distance = |at: &&[f64; 3]| at[0].hypot(at[1]);
    let nearest = upper.min_by(|a, b| distance(a).total_cmp(&distance(b)));
    nearest.map_or(0.0, |at| scale * at[2])
}

/// An approach, a slide in rounds, and a rest in contact.
fn slide(top: f64, slots: usize) -> String {
    let mut csv = String::from("t,x,y,z\n");
    for (t, above) in [(0.0, 0.02), (0.8, 0.005)] {
        let _ = writeln!(csv, "{t},0,0,{}", top + above);
    }
    let rounds_s = slots as f64 * SLOT_S;
    let steps = (rounds_s / 0.05).round() as usize;
    for step in 0..=steps {
        let t = rounds_s * step as f64 / steps as f64;
        let angle = std::f64::consts::TAU * t / ROUND_S;
        let (x, y) = (RADIUS_M * (1.0 - angle.cos()), RADIUS_M * angle.sin());
        let _ = writeln!(csv, "{},{x},{y},{}", APPROACH_S + t, top - HAND_DEPTH_M);
    }
    csv
}

/// An approach of the stiff device, and a rest in contact.
fn press(top: f64) -> String {
    let [above, below] = [top + 0.005, top - DEVICE_DEPTH_M];
    format!("t,x,y,z\n0,0,0,{above}\n0.3,0,0,{above}\n0.6,0,0,{below}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scene_of_the_device_names_any_page() {
        let page = Path::new("/cafe\u{301}/\u{2764}\u{fe0f}/a \"b\" \\c/page");
        let probe = pressed(page).expect("it is UTF-8");
        let text = scene("", "model", SIZE_M, &probe);
        let table: toml::Table = text.parse().unwrap_or_else(|error| panic!("{error}"));
        let custom = &table["probe"][0]["device"]["custom"];
        assert_eq!(custom["file"].as_str().map(Path::new), Some(page));
    }
}
