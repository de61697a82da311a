//! Scenes: the TOML file as typed (`typed`), the checks (`validate`), and the validated, immutable plan (`plan`).

#![forbid(unsafe_code)]

mod effects;
mod height_map;
mod plan;
mod trajectory;
mod typed;
mod validate;

pub use effects::{
    BoundaryPlan, Effect, EffectPlan, FrictionPlan, GravityPlan, InertiaPlan, MagnetPlan, Pattern,
    ShadingPlan, SpringPlan, TexturePlan, VibrationPlan, Workspace,
};
pub use height_map::{Height, HeightMap, HeightMapError};
pub use plan::{
    AccuracyPlan, Hand, LoopPlan, MAX_OBJECTS, MAX_PROBES, MAX_SEATS, ModelScale, ModelSource,
    ObjectPlan, Overrides, ProbePlan, ProbeShape, RefinementPlan, SafetyPlan, ScenePlan,
    SimulatedDevicePlan, SurfacePlan, ToolMeshPlan, TrajectoryPlan,
};
pub use typed::parse_bytes;
pub use validate::{
    DrivenPlan, FreePlan, HingePlan, MAX_MOVABLES, MassPlan, MovablePlan, RailPlan, RestPlan,
    SHAPES, SceneError, least_coupled_mass, load, parse,
};
