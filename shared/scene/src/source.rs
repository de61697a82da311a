//! The text of a scene, its errors with line numbers, and checks of single numbers.

use crate::files::{Files, read_text};
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;
use toml::Spanned;

/// Why a scene is refused: one sentence that names file, line and remedy.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct SceneError(pub String);

/// A scene's text with its context.
pub(crate) struct Source<'a> {
    /// Name of the scene in messages.
    pub(crate) shown: &'a str,
    pub(crate) text: &'a str,
    /// Start of relative paths.
    pub(crate) folder: &'a Path,
    pub(crate) files: &'a dyn Files,
}

impl Source<'_> {
    /// Refuses the text at a byte.
    pub(crate) fn at(&self, byte: usize, sentence: &str) -> SceneError {
        let line = self.line(byte);
        SceneError(format!("{}, line {line}: {sentence}", self.shown))
    }

    /// Line of a byte of the text, from 1.
    pub(crate) fn line(&self, byte: usize) -> usize {
        let before = &self.text.as_bytes()[..byte.min(self.text.len())];
        1 + before.iter().filter(|&&b| b == b'\n').count()
    }

    /// Refuses a value of the text.
    pub(crate) fn value<T>(&self, value: &Spanned<T>, sentence: &str) -> SceneError {
        self.at(value.span().start, sentence)
    }

    /// Refuses the scene as a whole.
    pub(crate) fn whole(&self, sentence: &str) -> SceneError {
        SceneError(format!("{}: {sentence}", self.shown))
    }

    /// A number of the scene, or its default.
    pub(crate) fn number(
        &self,
        value: Option<&Spanned<f64>>,
        key: &str,
        default: f64,
        range: Range,
    ) -> Result<f64, SceneError> {
        let Some(value) = value else {
            return Ok(default);
        };
        range
            .check(key, *value.get_ref())
            .map_err(|sentence| self.value(value, &sentence))
    }

    /// A whole number of the scene, or its default.
    pub(crate) fn whole_number(
        &self,
        value: Option<&Spanned<i64>>,
        key: &str,
        default: i64,
        range: std::ops::RangeInclusive<i64>,
    ) -> Result<i64, SceneError> {
        let Some(value) = value else {
            return Ok(default);
        };
        let number = *value.get_ref();
        if range.contains(&number) {
            return Ok(number);
        }
        let (low, high) = (range.start(), range.end());
        Err(self.value(
            value,
            &format!("{key} is {number}; write a whole number from {low} to {high}"),
        ))
    }

    /// Path of a file that the scene names.
    pub(crate) fn path(&self, file: &Spanned<String>) -> PathBuf {
        self.folder.join(file.get_ref())
    }

    pub(crate) fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        self.files.read(path)
    }

    pub(crate) fn read_text(&self, path: &Path) -> io::Result<String> {
        read_text(self.files, path)
    }
}

/// Allowed values of a number.
#[derive(Clone, Copy)]
pub(crate) enum Range {
    /// Above 0, at most this.
    Positive(f64),
    /// From 0 to this.
    NotNegative(f64),
    /// From the first to the second.
    Within(f64, f64),
}

impl Range {
    /// The number itself, or a sentence that names the key and the allowed values.
    pub(crate) fn check(self, key: &str, number: f64) -> Result<f64, String> {
        let (fits, wanted) = match self {
            Self::Positive(max) => (
                number > 0.0 && number <= max,
                format!("a number above 0, at most {max}"),
            ),
            Self::NotNegative(max) => (
                (0.0..=max).contains(&number),
                format!("a number from 0 to {max}"),
            ),
            Self::Within(min, max) => (
                (min..=max).contains(&number),
                format!("a number from {min} to {max}"),
            ),
        };
        if fits {
            Ok(number)
        } else {
            Err(format!("{key} is {number}; write {wanted}"))
        }
    }
}
