//! Scenes: the TOML file as typed (`typed`), the checks (`validate`), and the validated, immutable plan (`plan`).

mod plan;
mod trajectory;
mod typed;
mod validate;

pub use plan::{
    AccuracyPlan, Hand, LoopPlan, MOST_OBJECTS, MOST_PROBES, MOST_SEATS, ModelScale, ModelSource,
    ObjectPlan, Overrides, ProbePlan, ProbeShape, RefinementPlan, SafetyPlan, ScenePlan,
    SimulatedDevicePlan, SurfacePlan, ToolMeshPlan, TrajectoryPlan,
};
pub use typed::parse_bytes;
pub use validate::{SHAPES, SceneError, load, parse};
