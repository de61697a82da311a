//! Further libraries, asked the same questions by a program of their own (`rt-tests/peers`) in the
//! same turns as ours.
//!
//! The program is started once for a model, with a folder of questions. It reads a line for each
//! turn, `TASK FIRST LAST BEFORE`: it puts the questions from FIRST to before LAST to all of its
//! libraries that have the task, behind as many as BEFORE before them, untimed, and says `done`.
//! Before the first it says `ready`: its trees stand. At the end of its input it writes its answers
//! to the folder.

use super::check_stop;
use super::closest::{COLD, MEMORY, PATH, TOLERANCES};
use super::questions::Questions;
use super::row::{Row, Who};
use super::timing::Timed;
use crate::failure::Failure;
use crate::models::Model;
use std::io::{ErrorKind, Read, Write};
use std::ops::Range;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Who is asked, and how the files of its answers begin.
const ASKED: [(Who, &str); 3] = [
    (Who::Embree, "embree"),
    (Who::Fcl, "fcl"),
    (Who::FclMoved, "fcl_moved"),
];

/// The tasks of closest points.
const PATHS: [&str; 3] = [PATH, MEMORY, COLD];
/// Time between two looks at the flag that ends the command.
const LOOK: Duration = Duration::from_millis(50);
/// The longest line that it may say, bytes.
const MAX_LINE: usize = 80;

/// The program, while it is asked. It writes into a folder that may be removed when the command is
/// to end, so it is ended before.
pub struct Peers<'a> {
    program: String,
    folder: &'a Path,
    child: Child,
    /// Its input and output.
    line: Option<UnixStream>,
    stop: &'a AtomicBool,
}

impl<'a> Peers<'a> {
    /// Runs the program on a folder of questions, until it is ready to be asked.
    ///
    /// # Errors
    /// When it does not run, or the command is to end.
    pub fn start(
        program: &Path,
        folder: &'a Path,
        asked: &Questions,
        stop: &'a AtomicBool,
    ) -> Result<Self, Failure> {
        let tools = asked.tools.iter().map(|tool| tool.task);
        remove_earlier(folder, PATHS.into_iter().chain(tools))?;
        let mut command = Command::new(program);
        command.arg(folder).arg("--turns");
        Self::run(command, folder, stop)
    }

    fn run(mut command: Command, folder: &'a Path, stop: &'a AtomicBool) -> Result<Self, Failure> {
        let program = command.get_program().to_string_lossy().into_owned();
        check_stop(stop)?;
        let not_run = |error: std::io::Error| failed(&program, &format!("cannot be run ({error})"));
        let (line, its) = UnixStream::pair().map_err(not_run)?;
        line.set_read_timeout(Some(LOOK)).map_err(not_run)?;
        let input: OwnedFd = its.try_clone().map_err(not_run)?.into();
        command.stdin(input).stdout(Stdio::from(OwnedFd::from(its)));
        let child = command.spawn().map_err(not_run)?;
        // Its ends are closed here, so that its end is seen.
        drop(command);
        let mut peers = Self {
            program,
            folder,
            child,
            line: Some(line),
            stop,
        };
        peers.hear("ready")?;
        Ok(peers)
    }

    /// Puts the questions of a turn of a task to all that have it.
    ///
    /// # Errors
    /// When the program fails, or the command is to end.
    pub fn turn(&mut self, task: &str, turn: Range<usize>, before: usize) -> Result<(), Failure> {
        let asks = format!("{task} {} {} {before}\n", turn.start, turn.end);
        let said = match &mut self.line {
            Some(line) => line.write_all(asks.as_bytes()),
            None => return Ok(()),
        };
        match said {
            Ok(()) => self.hear("done"),
            // It reads no more: why is heard at its end.
            Err(_) => self.hear("done").and(Err(self.failed("reads no more"))),
        }
    }

    /// Ends it, and reads what it wrote: rows of every library and task that it answered.
    ///
    /// # Errors
    /// When the program fails, an answer is damaged, or one that a limit asks for is not there;
    /// when the command is to end.
    pub fn rows(mut self, model: &Model, asked: &Questions) -> Result<Vec<Row>, Failure> {
        self.line = None;
        let status = self.wait()?;
        if !status.success() {
            return Err(self.failed(&format!("ended with {status}")));
        }
        let failed = |what: &dyn std::fmt::Display| self.failed(&what.to_string());
        read_rows(self.folder, model, asked, &failed)
    }

    /// Reads a line, which must be this one.
    fn hear(&mut self, due: &str) -> Result<(), Failure> {
        let mut said = Vec::new();
        while said.last() != Some(&b'\n') && said.len() < MAX_LINE {
            check_stop(self.stop)?;
            let mut byte = [0];
            let heard = match &mut self.line {
                Some(line) => line.read(&mut byte),
                None => Ok(0),
            };
            match heard.map_err(|error| error.kind()) {
                Ok(1..) => said.push(byte[0]),
                // Nothing in the time of a look.
                Err(ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {}
                Ok(0) | Err(_) => {
                    let status = self.wait()?;
                    return Err(self.failed(&format!("ended before it said {due} ({status})")));
                }
            }
        }
        let said = String::from_utf8_lossy(&said);
        if said.trim_end() == due {
            return Ok(());
        }
        Err(self.failed(&format!("says \"{}\", not \"{due}\"", said.trim_end())))
    }

    /// Waits for its end.
    fn wait(&mut self) -> Result<ExitStatus, Failure> {
        loop {
            // First: Ctrl-C in a terminal ends the program, too.
            check_stop(self.stop)?;
            match self.child.try_wait() {
                Ok(Some(status)) => return Ok(status),
                Ok(None) => std::thread::sleep(LOOK),
                Err(error) => return Err(self.failed(&format!("is lost ({error})"))),
            }
        }
    }

    fn failed(&self, what: &str) -> Failure {
        failed(&self.program, what)
    }
}

impl Drop for Peers<'_> {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A turn of who is asked by the program, if there is one.
///
/// # Errors
/// Those of [`Peers::turn`].
pub fn take_turn(
    peers: &mut Option<&mut Peers<'_>>,
    task: &str,
    turn: Range<usize>,
    before: usize,
) -> Result<(), Failure> {
    match peers {
        Some(peers) => peers.turn(task, turn, before),
        None => Ok(()),
    }
}

fn failed(program: &str, what: &str) -> Failure {
    Failure::Input(format!(
        "{program}: {what}; build it as rt-tests/peers/README.md says"
    ))
}

/// What went wrong with the program, as a failure.
type Failed<'a> = dyn Fn(&dyn std::fmt::Display) -> Failure + 'a;

/// Rows of all answers in a folder.
fn read_rows(
    folder: &Path,
    model: &Model,
    asked: &Questions,
    failed: &Failed<'_>,
) -> Result<Vec<Row>, Failure> {
    let diagonal = model.file.model_header().diagonal;
    let mut rows = Vec::new();
    let tools = asked
        .tools
        .iter()
        .map(|tool| (tool.task, &tool.expected, 0.0));
    let near = TOLERANCES[1] * diagonal;
    let paths = PATHS.map(|task| (task, &asked.expected, near));
    for (task, expected, tolerance) in paths.into_iter().chain(tools) {
        for (who, name) in ASKED {
            let path = answers(folder, name, task);
            let timed = match std::fs::read(&path) {
                Ok(bytes) => read(&bytes),
                Err(error) if error.kind() == ErrorKind::NotFound && !is_needed(who, task) => {
                    continue;
                }
                Err(error) => {
                    let (library, path) = (who.words(), path.display());
                    let what = format!("{path}, the answers of {library}, cannot be read: {error}");
                    return Err(failed(&what));
                }
            };
            check(&timed, &path, expected.len()).map_err(|what| failed(&what))?;
            let differ = timed.differ(expected, tolerance);
            rows.push(Row::new(task, model, who, timed.ns, differ));
        }
    }
    Ok(rows)
}

/// Whether a limit asks for these answers: without them it would be kept by nobody's measure.
fn is_needed(who: Who, task: &str) -> bool {
    match who {
        Who::Embree => PATHS.contains(&task),
        Who::Fcl => !PATHS.contains(&task),
        _ => false,
    }
}

/// Whether there are so many answers, each with a time.
///
/// # Errors
/// What is wrong, in words.
fn check(timed: &Timed, path: &Path, expected: usize) -> Result<(), String> {
    let path = path.display();
    if timed.ns.iter().any(|ns| !(ns.is_finite() && *ns >= 0.0)) {
        return Err(format!("{path} has a time that is none"));
    }
    if timed.ns.len() != expected {
        let found = timed.ns.len();
        return Err(format!("{path} has {found} answers, not {expected}"));
    }
    Ok(())
}

/// The file of somebody's answers.
fn answers(folder: &Path, name: &str, task: &str) -> PathBuf {
    folder.join(format!("{name}.{task}.answers"))
}

/// Removes the answers of an earlier run in the same folder: whoever gives none now has none.
fn remove_earlier(folder: &Path, tasks: impl Iterator<Item = &'static str>) -> Result<(), Failure> {
    let paths = tasks.flat_map(|task| ASKED.map(|(_, name)| answers(folder, name, task)));
    for path in paths {
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                return Err(Failure::Input(format!(
                    "{}: answers of an earlier run cannot be removed ({error}); choose another place with --export",
                    path.display()
                )));
            }
            _ => {}
        }
    }
    Ok(())
}

fn read(bytes: &[u8]) -> Timed {
    let (pairs, _) = bytes.as_chunks::<16>();
    let mut timed = Timed::default();
    for pair in pairs {
        let (numbers, _) = pair.as_chunks::<8>();
        timed.ns.push(f64::from_le_bytes(numbers[0]));
        timed.answers.push(f64::from_le_bytes(numbers[1]));
    }
    timed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::compare::tools::TOOLS;
    use crate::models::source::open;
    use crate::models::surface::Surface;
    use rand::SeedableRng;
    use rand_xoshiro::Xoshiro256PlusPlus;

    fn told(what: &dyn std::fmt::Display) -> Failure {
        Failure::Input(what.to_string())
    }

    /// A program in the place of the peers, which is given the folder.
    fn shell<'a>(
        script: &str,
        folder: &'a Path,
        stop: &'a AtomicBool,
    ) -> Result<Peers<'a>, Failure> {
        let mut command = Command::new("sh");
        command.args(["-c", script, "sh"]).arg(folder);
        Peers::run(command, folder, stop)
    }

    #[test]
    fn answers_that_a_limit_asks_for_must_be_there() {
        let model = open("relief:1000").unwrap_or_else(|error| panic!("{error}"));
        let full = Surface::new(model.full_triangles());
        let random = &mut Xoshiro256PlusPlus::seed_from_u64(1);
        let asked = Questions::new(&model, &full, 1000, random);
        let asked = asked.unwrap_or_else(|error| panic!("{error}"));
        let folder = tempfile::tempdir().expect("a folder");
        let said = read_rows(folder.path(), &model, &asked, &told).expect_err("it says nothing");
        assert_eq!(said.status(), 2);
        let said = said.to_string();
        for part in ["embree.closest_path.answers", "Embree"] {
            assert!(said.contains(part), "{said}");
        }

        // All that are needed: in no time, wrong, but there.
        let path = |who: &str, task: &str| answers(folder.path(), who, task);
        let write = |path: &Path, count: usize| {
            std::fs::write(path, vec![0; 16 * count]).expect("it is written");
        };
        for task in PATHS {
            write(&path("embree", task), asked.expected.len());
        }
        for tool in &asked.tools {
            write(&path("fcl", tool.task), tool.expected.len());
        }
        let read = || read_rows(folder.path(), &model, &asked, &told);
        let found = read().unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(found.len(), PATHS.len() + TOOLS.len());
        // One less of either.
        for (who, library, task) in [("embree", "Embree", COLD), ("fcl", "FCL", TOOLS[1].0)] {
            let file = path(who, task);
            let bytes = std::fs::read(&file).expect("it is there");
            std::fs::remove_file(&file).expect("it is removed");
            let said = read().expect_err("one is missing").to_string();
            let named = format!("{who}.{task}.answers, the answers of {library},");
            assert!(said.contains(&named), "{said}");
            std::fs::write(&file, bytes).expect("it is written");
        }
    }

    #[test]
    fn a_program_is_asked_in_turns_and_its_answers_are_read() {
        let model = open("relief:1000").unwrap_or_else(|error| panic!("{error}"));
        let full = Surface::new(model.full_triangles());
        let random = &mut Xoshiro256PlusPlus::seed_from_u64(1);
        let asked = Questions::new(&model, &full, 1000, random);
        let asked = asked.unwrap_or_else(|error| panic!("{error}"));
        let folder = tempfile::tempdir().expect("a folder");
        let (points, poses) = (asked.expected.len(), asked.tools[0].expected.len());
        let script = format!(
            "echo ready\n\
             while read -r turn; do echo \"$turn\" >> \"$1/turns\"; echo done; done\n\
             cd \"$1\"\n\
             for task in {}; do head -c {} /dev/zero > embree.$task.answers; done\n\
             for task in {} {}; do head -c {} /dev/zero > fcl.$task.answers; done",
            PATHS.join(" "),
            16 * points,
            TOOLS[0].0,
            TOOLS[1].0,
            16 * poses
        );
        let goes_on = AtomicBool::new(false);
        let peers = shell(&script, folder.path(), &goes_on);
        let mut peers = peers.unwrap_or_else(|error| panic!("{error}"));
        let mut place = Some(&mut peers);
        for turn in [0..50, 50..100] {
            assert_eq!(take_turn(&mut place, COLD, turn, 50), Ok(()));
        }
        assert_eq!(take_turn(&mut None, COLD, 0..50, 50), Ok(()));
        let rows = peers.rows(&model, &asked);
        let rows = rows.unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(rows.len(), PATHS.len() + TOOLS.len());
        let turns = std::fs::read_to_string(folder.path().join("turns"));
        let due = format!("{COLD} 0 50 50\n{COLD} 50 100 50\n");
        assert_eq!(turns.expect("it was asked"), due);
    }

    #[test]
    fn a_program_that_fails_is_one_sentence_with_a_remedy() {
        let folder = tempfile::tempdir().expect("a folder");
        let goes_on = AtomicBool::new(false);
        for (script, named) in [
            ("exit 3", "ended before it said ready (exit status: 3)"),
            ("echo hello", "says \"hello\", not \"ready\""),
            (
                "echo ready; read -r turn; exit 4",
                "ended before it said done (exit status: 4)",
            ),
        ] {
            let asked = shell(script, folder.path(), &goes_on);
            let ended = asked.and_then(|mut peers| peers.turn(PATH, 0..50, 50));
            let said = ended.expect_err("it fails").to_string();
            assert!(said.contains(named) && said.contains("README"), "{said}");
        }
        let nowhere = Command::new("/nowhere/peers");
        let missing = Peers::run(nowhere, folder.path(), &goes_on);
        let said = missing
            .err()
            .map_or_else(String::new, |error| error.to_string());
        assert!(said.contains("cannot be run"), "{said}");
    }

    #[test]
    fn a_program_is_ended_with_the_command_that_waits_for_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let stop = AtomicBool::new(false);
        let ended = || Failure::Run("ended on request".to_string());
        let script = "echo ready; exec sleep 600";
        let peers = shell(script, folder.path(), &stop);
        let mut peers = peers.unwrap_or_else(|error| panic!("{error}"));
        stop.store(true, std::sync::atomic::Ordering::Relaxed);
        assert_eq!(peers.turn(PATH, 0..50, 50).err(), Some(ended()));
        drop(peers);
        assert_eq!(shell(script, folder.path(), &stop).err(), Some(ended()));
    }

    #[test]
    fn answers_of_an_earlier_run_are_removed_and_nothing_else() {
        let folder = tempfile::tempdir().expect("a folder");
        let old = answers(folder.path(), "fcl", PATH);
        let question = folder.path().join("tips.bin");
        for path in [&old, &question] {
            std::fs::write(path, "of before").expect("it is written");
        }
        let tasks = || [PATH, MEMORY].into_iter();
        assert_eq!(remove_earlier(folder.path(), tasks()), Ok(()));
        assert!(!old.exists() && question.exists());
        // What is no file is not removed.
        std::fs::create_dir(&old).expect("a folder");
        let refused = remove_earlier(folder.path(), tasks()).expect_err("it stays");
        assert!(refused.to_string().contains("fcl.closest_path.answers"));
    }

    #[test]
    fn answers_are_read_as_they_are_written() {
        let bytes: Vec<u8> = [1.0, 2.0, 3.0, 4.0]
            .into_iter()
            .flat_map(f64::to_le_bytes)
            .collect();
        let timed = read(&bytes);
        assert_eq!(timed.ns, [1.0, 3.0]);
        assert_eq!(timed.answers, [2.0, 4.0]);
        // What is cut off is no answer.
        assert_eq!(read(&bytes[..31]).ns, [1.0]);
    }
}
