//! The text of a scene, its errors with line numbers, and reading of single numbers.

use crate::files::{Files, read_text};
use crate::limits::{Limit, MAX_LENGTH_M};
use crate::plan::HeightMap;
use crate::typed::{Numbers, Vector};
use crate::wording;
use glam::DVec3;
use serde::de::DeserializeOwned;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
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
    /// The pictures that were read and their steepest slopes, by path: many objects may name one.
    pub(crate) maps: RefCell<BTreeMap<PathBuf, (Arc<HeightMap>, f64)>>,
}

impl Source<'_> {
    /// The text as typed.
    pub(crate) fn typed<T: DeserializeOwned>(&self) -> Result<T, SceneError> {
        toml::from_str(self.text).map_err(|error| {
            let sentence = wording::sentence(self.text, error.span(), error.message());
            match error.span() {
                Some(span) => self.at(span.start, &sentence),
                None => self.whole(&sentence),
            }
        })
    }

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

    /// A number that the scene must give.
    pub(crate) fn required<T: Copy>(
        &self,
        (key, typed): Keyed<Spanned<T>>,
        range: impl Limit<T>,
    ) -> Result<T, SceneError> {
        range
            .check(key, *typed.get_ref())
            .map_err(|sentence| self.value(typed, &sentence))
    }

    /// A number that the scene may give.
    pub(crate) fn optional<T: Copy>(
        &self,
        (key, typed): Keyed<Option<Spanned<T>>>,
        range: impl Limit<T>,
    ) -> Result<Option<T>, SceneError> {
        let required = |typed| self.required((key, typed), range);
        typed.as_ref().map(required).transpose()
    }

    /// A number of the scene, or its default.
    pub(crate) fn number<T: Copy>(
        &self,
        typed: Keyed<Option<Spanned<T>>>,
        default: T,
        range: impl Limit<T>,
    ) -> Result<T, SceneError> {
        Ok(self.optional(typed, range)?.unwrap_or(default))
    }

    /// A place or a velocity; `at` is where the scene gives it.
    pub(crate) fn vector<T>(
        &self,
        (key, at): Keyed<Spanned<T>>,
        typed: Numbers<3>,
    ) -> Result<DVec3, SceneError> {
        let vector = DVec3::from_array(typed.0);
        // NaN fails the comparison.
        if vector.abs().cmple(DVec3::splat(MAX_LENGTH_M)).all() {
            return Ok(vector);
        }
        let sentence = format!("{key} needs three finite numbers, none larger than {MAX_LENGTH_M}");
        Err(self.value(at, &sentence))
    }

    /// A place or a velocity, or zeros.
    pub(crate) fn vector_or_zero(&self, (key, typed): Keyed<Vector>) -> Result<DVec3, SceneError> {
        match typed {
            None => Ok(DVec3::ZERO),
            Some(typed) => self.vector((key, typed), *typed.get_ref()),
        }
    }

    /// A direction, made a unit vector.
    pub(crate) fn direction(
        &self,
        (key, typed): Keyed<Spanned<Numbers<3>>>,
    ) -> Result<DVec3, SceneError> {
        let vector = DVec3::from_array(typed.get_ref().0);
        // Scaled first, so no square overflows or vanishes.
        let unit = (vector / vector.abs().max_element()).try_normalize();
        unit.ok_or_else(|| {
            let sentence = format!(
                "{key} needs three finite numbers that are not all zero, such as [0, 0, 1]"
            );
            self.value(typed, &sentence)
        })
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

/// A field of a table with its key in the scene.
pub(crate) type Keyed<'a, T> = (&'a str, &'a T);

/// A field with its name as its key: `key!(typed.rate_hz)`.
macro_rules! key {
    ($table:ident.$field:ident) => {
        (stringify!($field), &$table.$field)
    };
}
pub(crate) use key;
