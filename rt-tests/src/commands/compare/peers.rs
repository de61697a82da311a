//! Answers of a program that asks further libraries the same questions (`rt-tests/peers`), in the
//! same minute on the same core.

use super::closest::{COLD, MEMORY, PATH, TOLERANCES};
use super::questions::Questions;
use super::row::{Row, Who};
use super::timing::Timed;
use crate::failure::Failure;
use crate::models::Model;
use std::path::Path;
use std::process::Command;

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
        for (who, name) in [
            (Who::Embree, "embree"),
            (Who::Fcl, "fcl"),
            (Who::FclMoved, "fcl_moved"),
        ] {
            let path = folder.join(format!("{name}.{task}.answers"));
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
