//! Files that a command is to write, checked before it works: a slip must not cost the input.

use std::fs::canonicalize;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why a file is not written.
#[derive(Debug, PartialEq, Eq, Error)]
pub enum OutputError {
    /// It is the file that is read.
    #[error("{}: this is the input, and it would be overwritten: name another file to write", .0.display())]
    IsInput(PathBuf),
    /// Its ending is that of another format.
    #[error("{}: what is written is a .{ending} file: give its name that ending", path.display())]
    Ending {
        /// The file.
        path: PathBuf,
        /// The ending that it should have.
        ending: &'static str,
    },
}

/// Checks that an output is another file than the input.
///
/// # Errors
/// When both paths lead to one file.
pub fn check_is_not_input(output: &Path, input: &Path) -> Result<(), OutputError> {
    // What is not there yet is no input.
    let is_same = matches!((canonicalize(output), canonicalize(input)), (Ok(a), Ok(b)) if a == b);
    if is_same {
        return Err(OutputError::IsInput(output.to_path_buf()));
    }
    Ok(())
}

/// Checks an output whose format is always the same: another file than the input, with the
/// format's ending in small or capital letters.
///
/// # Errors
/// When it is the input, or has another ending.
pub fn check_output(output: &Path, input: &Path, ending: &'static str) -> Result<(), OutputError> {
    check_is_not_input(output, input)?;
    let has_ending = output
        .extension()
        .is_some_and(|found| found.eq_ignore_ascii_case(ending));
    if has_ending {
        return Ok(());
    }
    Err(OutputError::Ending {
        path: output.to_path_buf(),
        ending,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_output_is_no_input_and_has_its_ending() {
        let folder = tempfile::tempdir().unwrap();
        let [input, link, new] = ["a.spm", "link.spm", "new.SPM"].map(|of| folder.path().join(of));
        std::fs::write(&input, b"a model").unwrap();
        std::os::unix::fs::symlink(&input, &link).unwrap();
        let by_dots = folder.path().join("./a.spm");
        for same in [&input, &link, &by_dots] {
            let found = check_output(same, &input, "spm");
            assert_eq!(found, Err(OutputError::IsInput(same.clone())));
        }
        assert_eq!(check_output(&new, &input, "spm"), Ok(()));
        assert_eq!(
            check_output(&new, &folder.path().join("none"), "spm"),
            Ok(())
        );
        let text = check_output(&new, &input, "png").unwrap_err().to_string();
        assert!(text.contains("new.SPM") && text.contains(".png"), "{text}");
    }
}
