//! Standard output, JSON, files and the status line.

use crate::failure::{Chosen, Failure};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::io::Write;
use std::path::Path;
use std::time::Duration;

/// Time between two drawings of a status line.
const REDRAW: Duration = Duration::from_millis(200);

/// Prints on standard output; a reader that went away (`| head`) is no failure.
///
/// # Errors
/// When it cannot be printed for another reason.
pub fn print(text: &str) -> Result<(), Failure> {
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(Failure::Run(format!(
            "standard output cannot be written ({error})"
        ))),
        _ => Ok(()),
    }
}

/// Prints one JSON object on standard output.
///
/// # Errors
/// When it has no JSON or cannot be printed.
pub fn print_json(value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string(value).map_err(no_json)?;
    print(&format!("{text}\n"))
}

/// Prints the words, or with `json` one object on standard output and the words on standard error.
///
/// # Errors
/// When it has no JSON or cannot be printed.
pub fn print_either(json: bool, words: &str, value: &impl Serialize) -> Result<(), Failure> {
    if json {
        eprint!("{words}");
        print_json(value)
    } else {
        print(words)
    }
}

/// Makes a folder for the results of `--out`, with those above it.
///
/// # Errors
/// When it cannot be made.
pub fn make_folder(folder: &Path) -> Result<(), Failure> {
    make_folder_at(Chosen::OUT, folder)
}

/// Makes a folder, with those above it.
///
/// # Errors
/// When it cannot be made.
pub fn make_folder_at(chosen: Chosen, folder: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|error| Failure::write_at(chosen, folder, &error))
}

/// Writes a value as JSON, one field a line.
///
/// # Errors
/// When it has no JSON or cannot be written.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Failure> {
    let json = serde_json::to_vec_pretty(value).map_err(no_json)?;
    write_whole(path, &json)
}

fn no_json(error: serde_json::Error) -> Failure {
    Failure::Run(format!("the result has no JSON ({error})"))
}

/// Writes a file of `--out` whole or not at all.
///
/// # Errors
/// When it cannot be written.
pub fn write_whole(path: &Path, contents: &[u8]) -> Result<(), Failure> {
    write_whole_at(Chosen::OUT, path, contents)
}

/// Writes a file whole or not at all.
///
/// # Errors
/// When it cannot be written.
pub fn write_whole_at(chosen: Chosen, path: &Path, contents: &[u8]) -> Result<(), Failure> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let write = || -> std::io::Result<()> {
        let mut file = tempfile::NamedTempFile::new_in(folder)?;
        file.write_all(contents)?;
        // A temporary file is private; a report is for all who may read the folder.
        let readable = std::os::unix::fs::PermissionsExt::from_mode(0o644);
        file.as_file().set_permissions(readable)?;
        file.persist(path)?;
        Ok(())
    };
    write().map_err(|error| Failure::write_at(chosen, path, &error))
}

/// A spinner on standard error with the elapsed time and a message; silent without a terminal.
#[must_use]
pub fn status_line() -> ProgressBar {
    styled(ProgressBar::new_spinner(), "{spinner} {elapsed} {msg}")
}

/// A bar on standard error over so many steps, with a message; silent without a terminal.
#[must_use]
pub fn status_bar(steps: u64) -> ProgressBar {
    styled(ProgressBar::new(steps), "{spinner} {bar:20} {msg}")
}

fn styled(bar: ProgressBar, template: &str) -> ProgressBar {
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar.enable_steady_tick(REDRAW);
    bar
}
