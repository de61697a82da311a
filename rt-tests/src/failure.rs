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

impl Failure {
    /// The exit status.
    #[must_use]
    pub fn status(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Run(_) => 1,
        }
    }

    /// A file or folder that cannot be written.
    #[must_use]
    pub fn write(path: &Path, error: &dyn std::fmt::Display) -> Self {
        Self::Input(format!(
            "{}: cannot be written ({error}); choose another folder with --out",
            path.display()
        ))
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        Self::Input(error.to_string())
    }
}
