//! The scenes of `rt-tests deadline` and `policies`.

use super::shapes::{cylinder, spur_gear, uv_sphere};
use crate::failure::{Chosen, Failure};
use crate::report::output::make_folder_at;
use crate::scenes::path_in_toml;
use clap::Args;
use scene_args::OverrideArgs;
use spm_builder::{SoupMesh, write_mesh};
use std::path::{Path, PathBuf};

/// The tool of 960 faces of config/scenes/tool.toml.
const TOOL: &str = include_str!("../../../../config/scenes/tool.toml");
const HUNDRED: &str = include_str!("../../../../config/scenes/hundred-objects.toml");
/// The trajectory that it names.
const OVER_A_ROW: &str = include_str!("../../../../config/trajectories/over-a-row.csv");

/// Which scenes are run.
#[derive(Debug, Args)]
pub struct SceneArgs {
    /// Only the scenes whose name holds this
    #[arg(long, value_name = "NAME")]
    pub only: Option<String>,
    /// Folder of dragon.obj, without which its scenes are left out
    #[arg(long, value_name = "DIR", default_value = "../shared/models")]
    pub models: PathBuf,
    /// Faces of the terrain
    #[arg(long, value_name = "N", default_value_t = 10_000_000)]
    pub terrain_faces: u32,
}

/// Checks how many times slower machines are to be.
///
/// # Errors
/// When one is no number from 1 to 64.
pub fn check_slow(slow: &[f64]) -> Result<(), Failure> {
    match slow.iter().find(|slow| !(1.0..=64.0).contains(*slow)) {
        None => Ok(()),
        Some(slow) => Err(Failure::Input(format!(
            "--slow {slow}: write numbers from 1 to 64"
        ))),
    }
}

/// A scene file.
#[derive(Debug)]
pub struct Scene {
    /// For the table.
    pub name: String,
    /// The file.
    pub path: PathBuf,
    model: Option<PathBuf>,
}

impl Scene {
    /// What is changed in the file for a seed.
    #[must_use]
    pub fn overrides(&self, seed: u64) -> OverrideArgs {
        OverrideArgs {
            model: self.model.clone(),
            seed: Some(seed),
            ..OverrideArgs::default()
        }
    }
}

/// The scenes, written into a folder, and those that are left out.
///
/// # Errors
/// When a file cannot be written, or no scene is left.
pub fn scenes(args: &SceneArgs, folder: &Path) -> Result<(Vec<Scene>, Vec<String>), Failure> {
    let (mut scenes, mut left_out) = (Vec::new(), Vec::new());
    let wanted = |name: &str| args.only.as_ref().is_none_or(|only| name.contains(only));
    for of in ["scenes", "trajectories"] {
        make_folder_at(Chosen::Temporary, &folder.join(of))?;
    }
    let write = |path: &Path, text: &str| {
        let wrong = |error: std::io::Error| Failure::write_at(Chosen::Temporary, path, &error);
        std::fs::write(path, text).map_err(wrong)
    };
    write(&folder.join("trajectories/over-a-row.csv"), OVER_A_ROW)?;
    let mut add = |name: &str, text: &str, model: Option<PathBuf>| {
        let path = folder.join("scenes").join(format!("{name}.toml"));
        write(&path, text)?;
        scenes.push(Scene {
            name: name.to_owned(),
            path,
            model,
        });
        Ok::<(), Failure>(())
    };
    for (name, size_m) in [("terrain-2m", 2.0), ("terrain-20cm", 0.2)] {
        if wanted(name) {
            let object = format!(
                "generate = {{ shape = \"terrain\", faces = {} }}",
                args.terrain_faces
            );
            add(name, &stroked(&object, size_m, 1.0), None)?;
        }
    }
    let dragon = args.models.join("dragon.obj");
    for (name, is_tool) in [("dragon-ball", false), ("dragon-tool", true)] {
        if wanted(name) && !dragon.is_file() {
            left_out.push(format!(
                "{name} is left out: {} is not there",
                dragon.display()
            ));
        } else if wanted(name) && is_tool {
            add(name, TOOL, Some(absolute(&dragon)?))?;
        } else if wanted(name) {
            let object = format!("model = {}", path_in_toml(&absolute(&dragon)?)?);
            add(name, &stroked(&object, 0.15, 0.1), None)?;
        }
    }
    if wanted("hundred-objects") {
        add("hundred-objects", HUNDRED, None)?;
    }
    for (name, mesh) in meshes() {
        if wanted(name) {
            let path = folder.join(format!("{name}.obj"));
            write_mesh(&mesh(), &path).map_err(|error| Failure::Run(error.to_string()))?;
            let object = format!("model = {}", path_in_toml(&path)?);
            add(name, &stroked(&object, 0.1, 0.3), None)?;
        }
    }
    if scenes.is_empty() {
        let only = args.only.as_deref().unwrap_or_default();
        let mut why = left_out;
        why.insert(0, format!("--only {only}: no scene is left"));
        return Err(Failure::Input(why.join("; ")));
    }
    Ok((scenes, left_out))
}

/// Makes a mesh.
type Maker = fn() -> SoupMesh;

/// Meshes by name, made when they are needed.
fn meshes() -> [(&'static str, Maker); 5] {
    [
        ("uv-sphere-1000", || uv_sphere(1000, 38)),
        ("uv-sphere-3000", || uv_sphere(3000, 38)),
        ("cylinder-1000", || cylinder(1000, 40)),
        ("cylinder-3000", || cylinder(3000, 14)),
        ("spur-gear", || spur_gear(40)),
    ]
}

/// A ball of 1 mm that strokes an object at a speed, in 16 MiB.
fn stroked(object: &str, size_m: f64, speed_m_per_s: f64) -> String {
    format!(
        "[cache]\nbytes = \"16MiB\"\n\n[[object]]\n{object}\nsize_m = {size_m}\n\n[[probe]]\n\
         shape = {{ sphere = {{ radius_m = 0.001 }} }}\n\
         trajectory = {{ tour = {{ seed = 1, speed_m_per_s = {speed_m_per_s}, depth_m = 0.002 }} }}\n"
    )
}

fn absolute(path: &Path) -> Result<PathBuf, Failure> {
    std::fs::canonicalize(path)
        .map_err(|error| Failure::Input(format!("{}: {error}", path.display())))
}
