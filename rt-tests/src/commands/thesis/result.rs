//! What comes out, as it lies in the JSON. Numbers only.

use crate::report::chart::{Chart, Stroke};
use serde::Serialize;

/// A passage of the thesis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Quote {
    /// Its section.
    pub section: &'static str,
    /// Line of its first word in the text of the thesis that lies beside this project
    /// (`../shared/thesis.txt`).
    pub line: u32,
    /// The words.
    pub text: &'static str,
}

/// A number beside what the thesis says of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Series {
    /// What it counts, and of which model.
    pub name: String,
    /// Its unit; empty for a ratio or a count.
    pub unit: &'static str,
    /// Ours.
    pub ours: f64,
    /// The published number; two are the ends of a range, none where the text has none.
    pub published: Vec<f64>,
}

impl Series {
    /// A number of which the thesis has none.
    #[must_use]
    pub fn new(name: impl Into<String>, unit: &'static str, ours: f64) -> Self {
        Self {
            name: name.into(),
            unit,
            ours,
            published: Vec::new(),
        }
    }

    /// Beside a published number or range.
    #[must_use]
    pub fn beside(mut self, published: &[f64]) -> Self {
        self.published = published.to_vec();
        self
    }
}

/// A figure or table of the thesis, measured.
#[derive(Debug, Clone, Serialize)]
pub struct Figure {
    /// Its number, or that of the section.
    pub figure: &'static str,
    /// What it shows.
    pub title: &'static str,
    /// Its numbers.
    pub series: Vec<Series>,
    /// What they say, and what differs from the thesis and why.
    pub says: String,
    /// What the thesis says.
    pub quotes: Vec<Quote>,
    /// Its pictures.
    #[serde(skip)]
    pub charts: Vec<Chart>,
    /// Names of the curves in all of them.
    #[serde(skip)]
    pub names: Vec<(String, &'static str, Stroke)>,
}

/// Everything.
#[derive(Debug, Clone, Serialize)]
pub struct Thesis {
    /// Seed of the paths and tours.
    pub seed: u64,
    /// Names of the models.
    pub models: Vec<String>,
    /// The figures.
    pub figures: Vec<Figure>,
    /// What came to no figure, each with its number and the reason.
    pub failed: Vec<String>,
}
