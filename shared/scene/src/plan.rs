//! The validated plan of a scene: every number checked, every default filled in, SI units.

mod cache;
mod device;
mod effects;
mod height_map;
mod movable;

pub use cache::{CacheChangePlan, CacheTimetable};
pub use device::{
    CustomDevicePlan, DeviceRotationPlan, HandImpedance, SimulatedDevicePlan, device_steps,
};
pub use effects::{
    BoundaryPlan, Effect, EffectPlan, FrictionPlan, GravityPlan, InertiaPlan, MagnetPlan, Pattern,
    ShadingPlan, SpringPlan, TexturePlan, VibrationPlan, Workspace,
};
pub use height_map::{Height, HeightMap, HeightMapError};
pub use movable::{
    DrivenPlan, FreePlan, HingePlan, MAX_MOVABLES, MassPlan, MovablePlan, RailPlan,
    SpringDamperPlan, min_coupled_mass,
};

use geometry::Pose;
use geometry::portable::hypot;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

/// Largest number of probes.
pub const MAX_PROBES: usize = 4;
/// Largest number of objects.
pub const MAX_OBJECTS: usize = 4096;
/// Largest number of active objects, see [`ScenePlan::active_objects`].
pub const MAX_ACTIVE_OBJECTS: usize = 2 * MAX_PROBES + 1;

/// Shapes of `generate = { shape = "..." }`.
pub const SHAPES: [&str; 6] = ["sphere", "torus", "terrain", "plate", "wedge", "relief"];

/// A scene, validated.
#[derive(Debug, Clone, PartialEq)]
pub struct ScenePlan {
    /// Name for reports: the file's stem.
    pub name: String,
    /// Start of relative paths.
    pub folder: PathBuf,
    /// The loop.
    pub loop_: LoopPlan,
    /// Bytes of the mesh cache, all of them reserved at the start.
    pub cache_bytes: usize,
    /// Changes of the bytes that may be in use, by ascending time.
    pub cache_changes: Arc<[CacheChangePlan]>,
    /// Wanted accuracy of the touched surface.
    pub accuracy: AccuracyPlan,
    /// Limits of every output force.
    pub safety: SafetyPlan,
    /// The recording of a run.
    pub record: RecordPlan,
    /// Objects, at least one and at most [`MAX_OBJECTS`].
    pub objects: Vec<ObjectPlan>,
    /// Probes, at least one and at most [`MAX_PROBES`].
    pub probes: Vec<ProbePlan>,
    /// Effects that act on every probe anywhere.
    pub effects: Vec<EffectPlan>,
}

impl ScenePlan {
    /// Number of objects that may be active at once: for every probe the touched one and the next
    /// one, and one to spare. They have equal shares of the cache where there are more objects than
    /// that, else half of it goes by importance.
    #[must_use]
    pub fn active_objects(&self) -> usize {
        self.objects.len().min(2 * self.probes.len() + 1)
    }
}

/// The recording of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordPlan {
    /// Bytes that its files may have together; `None` records nothing.
    pub keep_bytes: Option<u64>,
    /// Its first file; `None` leaves it to the program.
    pub path: Option<PathBuf>,
}

/// The loop and its thread.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoopPlan {
    /// Ticks a second, 100..=10000.
    pub rate_hz: f64,
    /// Core of the tick; `None` leaves it to the kernel.
    pub core: Option<usize>,
    /// Whether the scene names no core: the program chooses one.
    pub picks_core: bool,
    /// SCHED_FIFO priority, 1..=99.
    pub priority: i32,
    /// Busy waiting before a deadline, microseconds.
    pub spin_us: u64,
    /// Whether a missing real-time right is fatal.
    pub require_realtime: bool,
    /// Largest number of mesh operations (splits and collapses) a tick: K. A scene says it of a
    /// millisecond, and another period has as many in proportion ([`work_ms`]).
    pub operations: usize,
}

/// Time of which a tick may do the work, milliseconds: its period, and no less than half a
/// millisecond, since what is decided in one tick has to be seen in one.
#[must_use]
pub fn work_ms(rate_hz: f64) -> f64 {
    (1e3 / rate_hz).max(0.5)
}

impl LoopPlan {
    /// The same at another rate, with as many operations for the same time, at least one a tick.
    #[must_use]
    pub fn at_rate(self, rate_hz: f64) -> Self {
        let operations = self.operations as f64 * (work_ms(rate_hz) / work_ms(self.rate_hz));
        Self {
            rate_hz,
            operations: (operations.round() as usize).max(1),
            ..self
        }
    }
}

/// Wanted accuracy of the touched surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AccuracyPlan {
    /// Wanted expected error at the contact, metres, not negative; 0 is the full mesh.
    pub tolerance_m: f64,
    /// Where the mesh is refined.
    pub refinement: RefinementPlan,
    /// Whether perceptible splits and collapses are geomorphed instead of immediate.
    pub geomorph: bool,
    /// What decides how fine the objects may be for want of time.
    pub policy: PolicyPlan,
}

/// What decides how fine the objects may be for want of time, where the mesh is refined locally.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PolicyPlan {
    /// What it will take, by speed and density, beside the time that a tick has.
    #[default]
    Predictive,
    /// What it took, beside that time (thesis 4.1.2).
    Reactive,
}

/// Where the mesh is refined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub enum RefinementPlan {
    /// Around the contact and its predicted path, coarser with distance (thesis chapter 5).
    #[default]
    Local,
    /// The same everywhere (thesis chapter 3): to the tolerance, or to a number of splits.
    Global {
        /// Level of detail: number of vertex splits, from the base mesh on.
        lod: Option<u32>,
    },
}

/// Limits of the output force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafetyPlan {
    /// Largest force, newtons.
    pub force_max_n: f64,
    /// Largest torque, newton metres.
    pub torque_max_nm: f64,
    /// Largest change of the force, newtons a second; a torque changes by the same share of its
    /// limit.
    pub slew_n_per_s: f64,
    /// Soft start and end, seconds; not 0 in a scene.
    pub ramp_s: f64,
    /// Whether a contact returns no more energy than it received.
    pub passivity: bool,
}

/// Origin of a model. Only the station opens it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum ModelSource {
    /// An SPM or mesh file, relative to the scene's folder or absolute.
    File(PathBuf),
    /// A generated shape.
    Generate {
        /// Name of the shape.
        shape: String,
        /// Faces asked for.
        faces: u32,
    },
}

impl ModelSource {
    /// Name of the model, equal in both processes: that of its file without the folders, which
    /// differ from machine to machine.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::File(path) => {
                let name = path.file_name().unwrap_or(path.as_os_str());
                name.to_string_lossy().into_owned()
            }
            Self::Generate { shape, faces } => format!("generate:{shape}:{faces}"),
        }
    }
}

/// Size of a model in the world.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum ModelScale {
    /// Length of the longest side, metres.
    Size(f64),
    /// Metres a model unit.
    MetresPerUnit(f64),
}

impl ModelScale {
    /// Metres a model unit, for a model whose longest side is given in its units.
    #[must_use]
    pub fn metres_per_unit(self, longest_side: f64) -> f64 {
        match self {
            Self::Size(metres) => metres / longest_side,
            Self::MetresPerUnit(metres) => metres,
        }
    }
}

/// One object.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectPlan {
    /// Its model.
    pub model: ModelSource,
    /// Its size.
    pub scale: ModelScale,
    /// Pose of the model's frame in the world; the scale applies first, about the model's own
    /// origin.
    pub pose: Pose,
    /// Stiffness and damping of its surface.
    pub surface: SurfacePlan,
    /// Effects of its surface, at most one of a kind.
    pub effects: Arc<[EffectPlan]>,
    /// Its motion; `None` for a fixed object.
    pub movable: Option<MovablePlan>,
    /// How much it matters beside others, 0.1 to 10: what is short goes to it first, and half of
    /// the cache is shared out in proportion.
    pub importance: f64,
}

/// Stiffness and damping of a surface.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SurfacePlan {
    /// N/m.
    pub stiffness_n_per_m: f64,
    /// N s/m, along the contact normal.
    pub damping_ns_per_m: f64,
}

/// One probe.
#[derive(Debug, Clone, PartialEq)]
pub struct ProbePlan {
    /// Its shape.
    pub shape: ProbeShape,
    /// Mechanics of its device: those of the simulated one, or those that the checks assume of a
    /// custom one.
    pub device: SimulatedDevicePlan,
    /// The custom device that moves it; `None` for the simulated one.
    pub custom_device: Option<CustomDevicePlan>,
    /// Path of the simulated hand.
    pub trajectory: TrajectoryPlan,
}

/// The shape of a probe, in the device's axes. It extends along +z, away from the surface under its
/// tip.
#[derive(Debug, Clone, PartialEq)]
pub enum ProbeShape {
    /// A ball around the device's position.
    Sphere {
        /// Its radius, metres.
        radius_m: f64,
    },
    /// A capsule whose lower ball is around the device's position.
    Capsule {
        /// Radius, metres.
        radius_m: f64,
        /// From end to end, metres.
        length_m: f64,
        /// Largest number of faces of its mesh.
        faces: u32,
    },
    /// A cylinder that stands on the device's position.
    Cylinder {
        /// Radius, metres.
        radius_m: f64,
        /// Height, metres.
        length_m: f64,
        /// Largest number of faces of its mesh.
        faces: u32,
    },
    /// A mesh at one level of detail, its origin at the device's position.
    Mesh(ToolMeshPlan),
}

/// The mesh of a tool.
#[derive(Debug, Clone, PartialEq)]
pub struct ToolMeshPlan {
    /// Name of its file, for reports.
    pub file: String,
    /// Vertices, metres.
    pub positions: Vec<DVec3>,
    /// Faces: indices into `positions`, counterclockwise from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl ProbeShape {
    /// Depth of the tip below the device's position, metres; 0 for a flat tip there.
    #[must_use]
    pub fn tip_m(&self) -> f64 {
        match self {
            Self::Sphere { radius_m } | Self::Capsule { radius_m, .. } => *radius_m,
            Self::Cylinder { .. } => 0.0,
            Self::Mesh(mesh) => mesh
                .positions
                .iter()
                .fold(0.0, |tip, p| f64::max(tip, -p.z)),
        }
    }

    /// Largest distance of the shape from the device's position, metres.
    #[must_use]
    pub fn extent_m(&self) -> f64 {
        match self {
            Self::Sphere { radius_m } => *radius_m,
            Self::Capsule {
                radius_m, length_m, ..
            } => length_m - radius_m,
            Self::Cylinder {
                radius_m, length_m, ..
            } => hypot(*length_m, *radius_m),
            Self::Mesh(mesh) => mesh
                .positions
                .iter()
                .fold(0.0, |max, p| f64::max(max, p.length())),
        }
    }

    /// Radius of the patch that the tip touches, metres: the area to refine around a contact.
    #[must_use]
    pub fn patch_m(&self) -> f64 {
        match self {
            Self::Sphere { radius_m }
            | Self::Capsule { radius_m, .. }
            | Self::Cylinder { radius_m, .. } => *radius_m,
            Self::Mesh(_) => 0.25 * self.extent_m(),
        }
    }
}

/// Path of the simulated hand.
#[derive(Debug, Clone, PartialEq)]
pub enum TrajectoryPlan {
    /// A scripted path over an object: approach, press, slide, lift, move on.
    Tour {
        /// Index into [`ScenePlan::objects`].
        object: usize,
        /// Seed of its choices.
        seed: u64,
        /// Speed, m/s.
        speed_m_per_s: f64,
        /// Depth of the path below the surface, metres.
        depth_m: f64,
    },
    /// Points of a CSV file: seconds and poses in the world.
    Points(Vec<(f64, Pose)>),
}

impl TrajectoryPlan {
    /// Greatest speed of the hand on it, m/s; 0 where it stands still.
    #[must_use]
    pub fn greatest_speed_m_per_s(&self) -> f64 {
        match self {
            Self::Tour { speed_m_per_s, .. } => *speed_m_per_s,
            Self::Points(points) => points
                .windows(2)
                .map(|pair| {
                    let [(from_s, from), (until_s, until)] = [pair[0], pair[1]];
                    from.position.distance(until.position) / (until_s - from_s)
                })
                .fold(0.0, f64::max),
        }
    }
}

/// Values of the command line, which replace those of the scene.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Overrides {
    /// Another model for the first object and its copies (relative to the current folder).
    pub model: Option<PathBuf>,
    /// Its longest side, metres.
    pub size_m: Option<f64>,
    /// Speed of the first probe's scripted path, m/s.
    pub speed_m_per_s: Option<f64>,
    /// Seed of the first probe's scripted path.
    pub seed: Option<u64>,
    /// Cache bytes, as in the scene ("16MiB").
    pub cache: Option<String>,
    /// Wanted error at the contact, metres.
    pub tolerance_m: Option<f64>,
    /// Ticks a second.
    pub rate_hz: Option<f64>,
    /// Busy waiting before a deadline, microseconds.
    pub spin_us: Option<u64>,
    /// Files with the devices of the first probes (relative to the current folder), each a table
    /// `device` as in a probe of a scene.
    #[serde(default)]
    pub devices: Vec<PathBuf>,
}
