//! `ve-station serve --view`: the viewer rerun behind the recording of a controller here.
//!
//! The station has neither samples nor fronts: what a controller sees is in its recording, and
//! `rt-tests view --rerun` shows that, in a process of its own, while it is written. So the station
//! looks where recordings of its scene lie, and starts that program for each that begins.

use crate::tuning::viewer::ENDS;
use scene::ScenePlan;
use scene_files::recordings_folder;
use std::collections::BTreeSet;
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Instant;
use thiserror::Error;

/// Why nothing can be shown: one sentence.
#[derive(Debug, Error)]
pub enum ViewerError {
    /// The program that shows it is not there.
    #[error(
        "--view needs {0}, which is not there: cargo build --release -p rt-tests --features view"
    )]
    NoProgram(PathBuf),
    /// The scene is not recorded.
    #[error("--view shows what the controller records, and this scene has its recording off")]
    NotRecorded,
    /// The user has no folder for recordings.
    #[error("--view looks into the user's folder of recordings, and there is none: set HOME")]
    NoFolder,
}

/// Looks for recordings and shows them, one after the other.
#[derive(Debug)]
pub struct Viewer {
    program: PathBuf,
    target: String,
    /// Where the recordings lie, and how their names begin.
    folder: PathBuf,
    prefix: String,
    /// Those that were shown, or were there before.
    seen: BTreeSet<PathBuf>,
    process: Option<Child>,
}

impl Viewer {
    /// Of a scene, in a file or a viewer as `rt-tests view --rerun` names them.
    ///
    /// # Errors
    /// When the program is not beside this one, or the scene is not recorded.
    pub fn new(plan: &ScenePlan, target: &str) -> Result<Self, ViewerError> {
        if plan.record.keep_bytes.is_none() {
            return Err(ViewerError::NotRecorded);
        }
        let (folder, prefix) = match &plan.record.path {
            Some(path) => (
                // Of a bare name it is empty.
                match path.parent().filter(|of| !of.as_os_str().is_empty()) {
                    Some(folder) => folder.to_path_buf(),
                    None => PathBuf::from("."),
                },
                path.file_stem().unwrap_or_default().to_owned(),
            ),
            None => (
                recordings_folder().ok_or(ViewerError::NoFolder)?,
                format!("{}-", plan.name).into(),
            ),
        };
        let own = std::env::current_exe().unwrap_or_default();
        let program = own.with_file_name("rt-tests");
        if !program.is_file() {
            return Err(ViewerError::NoProgram(program));
        }
        Ok(Self {
            program,
            target: target.to_owned(),
            folder,
            prefix: prefix.to_string_lossy().into_owned(),
            seen: BTreeSet::new(),
            process: None,
        })
    }

    /// Starts the program for a recording that has begun, unless the one before is still shown.
    /// `tell` gets a line about it.
    pub fn look(&mut self, tell: impl Fn(&str)) {
        if let Some(process) = &mut self.process {
            match process.try_wait() {
                Ok(None) => return,
                Ok(Some(status)) if !status.success() => tell("the viewer has ended, see above"),
                _ => {}
            }
            self.process = None;
        }
        let Some(recording) = self.new_recording() else {
            return;
        };
        self.seen.insert(recording.clone());
        let mut command = Command::new(&self.program);
        command.arg("view").arg(format!("--rerun={}", self.target));
        command.arg("--").arg(&recording).stdin(Stdio::null());
        match command.spawn() {
            Ok(process) => {
                tell(&format!("shows {}", recording.display()));
                self.process = Some(process);
            }
            Err(error) => tell(&format!(
                "{} cannot be started: {error}",
                self.program.display()
            )),
        }
    }

    /// A recording that is written now and was not shown yet.
    fn new_recording(&self) -> Option<PathBuf> {
        let entries = std::fs::read_dir(&self.folder).ok()?;
        let mut paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
        paths.find(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            // Not of a scene whose name begins with that of this one.
            let rest = name.strip_prefix(&self.prefix);
            let rest = rest.and_then(|rest| rest.strip_suffix(".mcap"));
            let is_number = |c: char| c.is_ascii_digit() || c == '-';
            let is_ours = rest.is_some_and(|rest| rest.chars().all(is_number));
            is_ours && !self.seen.contains(path) && is_written(path)
        })
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        let Some(process) = &mut self.process else {
            return;
        };
        // A signal from the terminal has reached it, too.
        let began = Instant::now();
        while began.elapsed() < ENDS {
            if !matches!(process.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(ENDS / 20);
        }
        let _ = process.kill();
        let _ = process.wait();
    }
}

/// Whether somebody shares the lock of a file, as who writes a recording. (Who looks whether it is
/// free has the lock alone, for a moment.)
fn is_written(path: &Path) -> bool {
    // Over NFS only what is open for writing is locked alone.
    let opened = File::options().read(true).write(true).open(path);
    opened.is_ok_and(|file| is_held(&file.try_lock()) && file.try_lock_shared().is_ok())
}

/// Whether another one holds a lock of a file, by the answer to who would have its lock alone: any
/// other refusal says nothing of that.
fn is_held(locked: &Result<(), TryLockError>) -> bool {
    matches!(locked, Err(TryLockError::WouldBlock))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn who_looks_at_a_lock_does_not_write() {
        let folder = tempfile::tempdir().expect("there is a folder");
        let paths = ["looked", "written", "free"].map(|name| folder.path().join(name));
        let files = paths
            .each_ref()
            .map(|path| File::create(path).expect("it is written"));
        files[0].try_lock().expect("nobody has it");
        files[1].try_lock_shared().expect("nobody has it");
        assert_eq!(paths.map(|path| is_written(&path)), [false, true, false]);
    }

    /// As over NFS, where a lock is refused that the file is not open for, or where there are none.
    #[test]
    fn a_lock_that_cannot_be_had_is_not_one_that_another_has() {
        assert!(is_held(&Err(TryLockError::WouldBlock)));
        assert!(!is_held(&Ok(())));
        for (name, number) in [("EBADF", 9), ("ENOLCK", 37)] {
            let error = std::io::Error::from_raw_os_error(number);
            assert!(!is_held(&Err(TryLockError::Error(error))), "{name}");
        }
    }

    #[test]
    fn each_recording_of_the_scene_that_is_written_is_shown_once() {
        let folder = tempfile::tempdir().expect("there is a folder");
        let at = |name: &str| folder.path().join(name);
        // Instead of rt-tests: notes its arguments.
        let (program, noted) = (at("rt-tests"), at("noted"));
        let script = format!("#!/bin/sh\necho \"$@\" >> {}\n", noted.display());
        std::fs::write(&program, script).expect("it is written");
        let mode = std::fs::Permissions::from_mode(0o755);
        std::fs::set_permissions(&program, mode).expect("it is ours");
        let mut viewer = Viewer {
            program,
            target: "viewer".to_owned(),
            folder: folder.path().to_owned(),
            prefix: "touch-".to_owned(),
            seen: BTreeSet::new(),
            process: None,
        };
        let write = |name: &str| {
            let file = File::create(at(name)).expect("it is written");
            file.try_lock_shared().expect("nobody has it");
            file
        };
        let told = RefCell::new(Vec::new());
        let look = |viewer: &mut Viewer| {
            viewer.look(|line| told.borrow_mut().push(line.to_owned()));
            if let Some(process) = &mut viewer.process {
                assert!(process.wait().expect("it ends").success());
            }
        };
        let _other = write("other-1.mcap");
        let _longer = write("touch-more-4-5.mcap");
        drop(write("touch-1.mcap"));
        look(&mut viewer);
        assert!(!noted.exists(), "one of another scene, one that is over");
        let _first = write("touch-2.mcap");
        look(&mut viewer);
        look(&mut viewer);
        let _second = write("touch-3.mcap");
        look(&mut viewer);
        let noted = std::fs::read_to_string(noted).expect("it was started");
        let line = |name: &str| format!("view --rerun=viewer -- {}", at(name).display());
        let lines: Vec<&str> = noted.lines().collect();
        assert_eq!(lines, [line("touch-2.mcap"), line("touch-3.mcap")]);
        assert_eq!(told.borrow().len(), 2, "{told:?}");
    }
}
