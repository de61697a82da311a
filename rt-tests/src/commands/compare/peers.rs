//! Answers of a program that asks further libraries the same questions (`rt-tests/peers`), in the
//! same minute on the same core.

use super::check_stop;
use super::closest::{COLD, MEMORY, PATH, TOLERANCES};
use super::questions::Questions;
use super::row::{Row, Who};
use super::timing::Timed;
use crate::failure::Failure;
use crate::models::Model;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};
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
/// Time between two looks at the program.
const LOOK: Duration = Duration::from_millis(50);

/// Runs the program on a folder of questions and reads what it wrote there: rows of every library
/// and task that it answered.
///
/// # Errors
/// When it does not run, an answer is damaged, or one is not there that a limit asks for; when the
/// command is to end.
pub fn rows(
    program: &Path,
    folder: &Path,
    model: &Model,
    asked: &Questions,
    stop: &AtomicBool,
) -> Result<Vec<Row>, Failure> {
    let failed = |what: &dyn std::fmt::Display| {
        Failure::Input(format!(
            "{}: {what}; build it as rt-tests/peers/README.md says",
            program.display()
        ))
    };
    let tools = asked.tools.iter().map(|tool| tool.task);
    remove_earlier(folder, PATHS.into_iter().chain(tools))?;
    check_stop(stop)?;
    let status = run(Command::new(program).arg(folder), stop, &failed)?;
    if !status.success() {
        return Err(failed(&format!("ended with {status}")));
    }
    read_rows(folder, model, asked, &failed)
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

/// Runs a command until it ends. It writes into a folder that is removed when this one is to end,
/// so it is ended before.
fn run(
    command: &mut Command,
    stop: &AtomicBool,
    failed: &Failed<'_>,
) -> Result<ExitStatus, Failure> {
    let not_run = |error: std::io::Error| failed(&format!("cannot be run ({error})"));
    let mut child = command.spawn().map_err(not_run)?;
    loop {
        // First: Ctrl-C in a terminal ends the program, too.
        if let Err(ended) = check_stop(stop) {
            let _ = child.kill();
            let _ = child.wait();
            return Err(ended);
        }
        if let Some(status) = child.try_wait().map_err(not_run)? {
            return Ok(status);
        }
        std::thread::sleep(LOOK);
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

    fn failed(what: &dyn std::fmt::Display) -> Failure {
        Failure::Input(what.to_string())
    }

    #[test]
    fn answers_that_a_limit_asks_for_must_be_there() {
        let model = open("relief:1000").unwrap_or_else(|error| panic!("{error}"));
        let full = Surface::new(model.full_triangles());
        let random = &mut Xoshiro256PlusPlus::seed_from_u64(1);
        let asked = Questions::new(&model, &full, 1000, random);
        let asked = asked.unwrap_or_else(|error| panic!("{error}"));
        let folder = tempfile::tempdir().expect("a folder");
        let silent = Path::new("/bin/true");
        let found = rows(
            silent,
            folder.path(),
            &model,
            &asked,
            &AtomicBool::new(false),
        );
        let said = found.expect_err("it says nothing");
        assert_eq!(said.status(), 2);
        let said = said.to_string();
        for part in ["embree.closest_path.answers", "Embree", "README"] {
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
        let read = || read_rows(folder.path(), &model, &asked, &failed);
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
    fn a_program_is_ended_with_the_command_that_waits_for_it() {
        let run_until = |program: &str, is_to_end: bool| {
            let mut command = Command::new(program);
            run(command.arg("600"), &AtomicBool::new(is_to_end), &failed)
        };
        let ended = run_until("sleep", true);
        assert_eq!(ended, Err(Failure::Run("ended on request".to_string())));
        let missing = run_until("/nowhere/peers", false);
        let said = missing.expect_err("there is none").to_string();
        assert!(said.contains("cannot be run"), "{said}");
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
