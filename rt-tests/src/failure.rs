//! How a command ends when it does not end well.

use scene::SceneError;
use std::path::Path;
use thiserror::Error;

/// One sentence for the user, and which status it becomes.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Failure {
    /// A bad file, option or scene: status 2.
    #[error("{0}")]
    Input(String),
    /// Something went wrong on the way, or a check failed: status 1.
    #[error("{0}")]
    Run(String),
}

/// By what a user says where something is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Chosen {
    /// An option that names a folder or a file.
    By(&'static str),
    /// The folder for what is temporary.
    Temporary,
}

impl Chosen {
    /// What most commands have.
    pub const OUT: Self = Self::By("--out");
    /// For what others are asked.
    pub const EXPORT: Self = Self::By("--export");
}

impl Failure {
    /// The exit status.
    #[must_use]
    pub fn status(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Run(_) => 1,
        }
    }

    /// A file or folder of `--out` that cannot be written.
    #[must_use]
    pub fn write(path: &Path, error: &dyn std::fmt::Display) -> Self {
        Self::write_at(Chosen::OUT, path, error)
    }

    /// A file or folder that cannot be written, and how to choose another.
    #[must_use]
    pub fn write_at(chosen: Chosen, path: &Path, error: &dyn std::fmt::Display) -> Self {
        let remedy = match chosen {
            Chosen::By(option) => format!("choose another place with {option}"),
            Chosen::Temporary => "make room there, or set TMPDIR to another folder".to_string(),
        };
        let path = path.display();
        Self::Input(format!("{path}: cannot be written ({error}); {remedy}"))
    }
}

/// What is said of how a measurement ended beside what it had measured by then.
///
/// # Errors
/// The failure itself where that is nothing: it is all that there is to say.
pub fn beside_measured(
    ended: Result<(), Failure>,
    is_nothing: bool,
) -> Result<Vec<String>, Failure> {
    match ended {
        Err(failure) if is_nothing => Err(failure),
        ended => Ok(ended.err().iter().map(Failure::to_string).collect()),
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        Self::Input(error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_written_is_named_with_what_chooses_its_place() {
        let path = Path::new("here/file");
        let out = Failure::write(path, &"no room").to_string();
        assert!(out.contains("here/file") && out.contains("no room") && out.contains("--out"));
        for (chosen, remedy) in [
            (Chosen::EXPORT, "--export"),
            (Chosen::By("--csv"), "--csv"),
            (Chosen::Temporary, "TMPDIR"),
        ] {
            let told = Failure::write_at(chosen, path, &"no room").to_string();
            assert!(told.contains(remedy) && !told.contains("--out"), "{told}");
        }
    }
}
