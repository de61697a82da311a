//! A row of the comparison: what one contender took for one task on one model.

use crate::models::Model;
use crate::report::quantile::{quantile, sort};
use serde::Serialize;

/// Who answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Who {
    /// Ours, on the front as the controller forms it.
    OursLocal,
    /// Ours, on the full mesh.
    OursFull,
    /// Parry in single precision, on the full mesh.
    ParryF32,
    /// The same with the tool made anew at every pose.
    ParryF32Moved,
    /// Parry in double precision, on the full mesh.
    ParryF64,
    /// The same with the tool made anew at every pose.
    ParryF64Moved,
    /// Embree's point queries, on the full mesh; asked by a program of its own.
    Embree,
    /// FCL, on the full mesh, told the pose of the tool; asked by a program of its own.
    Fcl,
    /// The same with trees of boxes along the axes and the tool made anew at every pose.
    FclMoved,
}

impl Who {
    pub const ALL: [Self; 9] = [
        Self::OursLocal,
        Self::OursFull,
        Self::ParryF32,
        Self::ParryF32Moved,
        Self::ParryF64,
        Self::ParryF64Moved,
        Self::Embree,
        Self::Fcl,
        Self::FclMoved,
    ];

    pub fn words(self) -> &'static str {
        match self {
            Self::OursLocal => "ours, local front",
            Self::OursFull => "ours, full mesh",
            Self::ParryF32 => "parry f32",
            Self::ParryF32Moved => "parry f32, moved",
            Self::ParryF64 => "parry f64",
            Self::ParryF64Moved => "parry f64, moved",
            Self::Embree => "Embree",
            Self::Fcl => "FCL",
            Self::FclMoved => "FCL, moved",
        }
    }

    /// The library, whatever its way.
    pub fn library(self) -> &'static str {
        match self {
            Self::OursLocal | Self::OursFull => "ours",
            Self::ParryF32 | Self::ParryF32Moved => "parry f32",
            Self::ParryF64 | Self::ParryF64Moved => "parry f64",
            Self::Embree => "Embree",
            Self::Fcl | Self::FclMoved => "FCL",
        }
    }
}

/// What one contender took for one task on one model.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// The task.
    pub task: &'static str,
    /// The model.
    pub model: String,
    /// Faces of the full mesh.
    pub faces: u32,
    /// Who.
    pub who: Who,
    /// Median of the single queries, nanoseconds.
    pub p50_ns: f64,
    /// 99th of 100, nanoseconds.
    pub p99_ns: f64,
    /// The longest single one, nanoseconds.
    pub max_ns: f64,
    /// Answers that differ from the exact ones by more than rounding.
    pub answers_differ: u64,
    /// Bytes of mesh and tree together, for the task `build`; else 0.
    pub bytes: u64,
}

impl Row {
    pub fn new(
        task: &'static str,
        model: &Model,
        who: Who,
        mut ns: Vec<f64>,
        answers_differ: u64,
    ) -> Self {
        sort(&mut ns);
        Self {
            task,
            model: model.name.clone(),
            faces: model.file.model_header().faces,
            who,
            p50_ns: quantile(&ns, 0.5),
            p99_ns: quantile(&ns, 0.99),
            max_ns: quantile(&ns, 1.0),
            answers_differ,
            bytes: 0,
        }
    }
}
