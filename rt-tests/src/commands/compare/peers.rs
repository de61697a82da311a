//! Answers of a program that asks further libraries the same questions (`rt-tests/peers`), in the
//! same minute on the same core.

use super::closest::{COLD, MEMORY, PATH, TOLERANCES};
use super::questions::Questions;
use super::row::{Row, Who};
use super::timing::Timed;
use crate::failure::Failure;
use crate::models::Model;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Who is asked, and how the files of its answers begin.
const ASKED: [(Who, &str); 3] = [
    (Who::Embree, "embree"),
    (Who::Fcl, "fcl"),
    (Who::FclMoved, "fcl_moved"),
];

/// Runs the program on a folder of questions and reads what it wrote there: rows of every library
/// and task that it answered.
///
/// # Errors
/// When it does not run, or an answer is damaged.
pub fn rows(
    program: &Path,
    folder: &Path,
    model: &Model,
    asked: &Questions,
) -> Result<Vec<Row>, Failure> {
    let failed = |what: &dyn std::fmt::Display| {
        Failure::Input(format!(
            "{}: {what}; build it as rt-tests/peers/README.md says",
            program.display()
        ))
    };
    let tools = asked.tools.iter().map(|tool| tool.task);
    remove_earlier(folder, [PATH, MEMORY, COLD].into_iter().chain(tools))?;
    let ended = Command::new(program).arg(folder).status();
    let status = ended.map_err(|error| failed(&format!("cannot be run ({error})")))?;
    if !status.success() {
        return Err(failed(&format!("ended with {status}")));
    }
    let diagonal = model.file.model_header().diagonal;
    let mut rows = Vec::new();
    let tools = asked
        .tools
        .iter()
        .map(|tool| (tool.task, &tool.expected, 0.0));
    let near = TOLERANCES[1] * diagonal;
    let paths = [PATH, MEMORY, COLD].map(|task| (task, &asked.expected, near));
    for (task, expected, tolerance) in paths.into_iter().chain(tools) {
        for (who, name) in ASKED {
            let path = answers(folder, name, task);
            let Ok(bytes) = std::fs::read(&path) else {
                continue;
            };
            let timed = read(&bytes);
            if timed.ns.iter().any(|ns| !(ns.is_finite() && *ns >= 0.0)) {
                let what = format!("{} has a time that is none", path.display());
                return Err(failed(&what));
            }
            if timed.ns.len() != expected.len() {
                return Err(failed(&format!(
                    "{} has {} answers, not {}",
                    path.display(),
                    timed.ns.len(),
                    expected.len()
                )));
            }
            let differ = timed.differ(expected, tolerance);
            rows.push(Row::new(task, model, who, timed.ns, differ));
        }
    }
    Ok(rows)
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
