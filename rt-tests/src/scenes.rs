//! The scene of a command: its file, what the command line changes in it, and its models.

use crate::failure::{Chosen, Failure};
use hrtc::tuning::RUN_SECONDS;
use scene::ScenePlan;
use spm_builder::TerminalProgress;
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use ve_station::database::Database;

/// The scene of commands that were given none.
pub const BUNDLED_SCENE: &str = include_str!("../../config/scenes/first-touch.toml");

/// A scene file: a named one, or the bundled one in a temporary folder that lives as long as this.
#[derive(Debug)]
pub struct SceneFile {
    path: PathBuf,
    _folder: Option<TempDir>,
}

impl SceneFile {
    /// The named file, or the bundled scene.
    ///
    /// # Errors
    /// When the bundled scene cannot be written.
    pub fn named_or_bundled(named: Option<&Path>) -> Result<Self, Failure> {
        if let Some(named) = named {
            return Ok(Self {
                path: named.to_path_buf(),
                _folder: None,
            });
        }
        Self::of_text("first-touch.toml", BUNDLED_SCENE)
    }

    /// A scene as text, in a file of this name.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn of_text(name: &str, text: &str) -> Result<Self, Failure> {
        let folder = tempfile::tempdir()
            .map_err(|error| Failure::Run(format!("there is no temporary folder ({error})")))?;
        let path = folder.path().join(name);
        let wrong = |error: std::io::Error| Failure::write_at(Chosen::Temporary, &path, &error);
        std::fs::write(&path, text).map_err(wrong)?;
        Ok(Self {
            path,
            _folder: Some(folder),
        })
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// Checks a length of time from the command line.
///
/// # Errors
/// One sentence when no run may be so long.
pub fn check_seconds(seconds: f64) -> Result<(), Failure> {
    if RUN_SECONDS.contains(&seconds) {
        return Ok(());
    }
    let [least, most] = [RUN_SECONDS.start(), RUN_SECONDS.end()];
    Err(Failure::Input(format!(
        "--seconds is {seconds}; write a number from {least} to {most}"
    )))
}

/// Opens every model of a scene, building those that are meshes, with progress on the terminal.
///
/// Done before any process starts: a bad file is refused at once, and no build falls into a run.
///
/// # Errors
/// One sentence that names the file.
pub fn prepare_models(plan: &ScenePlan) -> Result<Database, Failure> {
    let progress = TerminalProgress::new();
    let opened = Database::open(plan, &progress);
    progress.finish();
    opened.map_err(|error| Failure::Input(error.to_string()))
}

/// A path as a string of a scene file. Rust's own quoting escapes what TOML does not know.
///
/// # Errors
/// When it is not UTF-8, which TOML is.
pub fn path_in_toml(path: &Path) -> Result<String, Failure> {
    let text = path.to_str().ok_or_else(|| {
        Failure::Input(format!(
            "{}: no scene can name this path, which is not UTF-8: rename it",
            path.display()
        ))
    })?;
    Ok(toml::Value::from(text).to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;

    #[test]
    fn any_path_that_is_utf8_is_read_from_a_scene_as_it_was_written() {
        for name in [
            "plain.obj",
            "cafe\u{301}.obj",
            "\u{2764}\u{fe0f}.obj",
            "a \"quoted\" name.obj",
            "back\\slash \\u0041.obj",
            "tab\tline\n\u{1}\u{7f}\u{85}.obj",
        ] {
            let path = Path::new("/models").join(name);
            let quoted = path_in_toml(&path).expect("it is UTF-8");
            let text = format!("model = {quoted}\nsize_m = 0.3\n");
            let table: toml::Table = text.parse().unwrap_or_else(|error| panic!("{error}"));
            let read = table["model"].as_str();
            assert_eq!(read.map(Path::new), Some(path.as_path()));
        }
    }

    #[test]
    fn a_path_that_is_not_utf8_is_refused_by_name() {
        let refused = path_in_toml(Path::new(OsStr::from_bytes(b"/models/b\xffd.obj")));
        let said = refused.expect_err("TOML is UTF-8").to_string();
        assert!(
            said.contains("/models/b") && said.contains("UTF-8"),
            "{said}"
        );
    }
}
