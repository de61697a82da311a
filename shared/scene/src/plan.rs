//! The validated plan of a scene: every number checked, every default filled in, SI units.

use super::effects::EffectPlan;
use super::validate::MovablePlan;
use geometry::Pose;
use glam::DVec3;
use std::path::PathBuf;
use std::sync::Arc;

/// Probes of a scene at the most.
pub const MAX_PROBES: usize = 4;
/// Objects of a scene at the most.
pub const MAX_OBJECTS: usize = 4096;
/// Seats of a controller at the most, see [`ScenePlan::seats`].
pub const MAX_SEATS: usize = 2 * MAX_PROBES + 1;

/// Everything that a scene says.
#[derive(Debug, Clone, PartialEq)]
pub struct ScenePlan {
    /// Name for reports: the file's stem.
    pub name: String,
    /// Folder that relative paths start from.
    pub folder: PathBuf,
    /// The loop.
    pub loop_: LoopPlan,
    /// Bytes of the mesh cache.
    pub cache_bytes: usize,
    /// How accurate the touched surface is to be.
    pub accuracy: AccuracyPlan,
    /// Limits of every force that leaves.
    pub safety: SafetyPlan,
    /// Objects, at least one and at most [`MAX_OBJECTS`].
    pub objects: Vec<ObjectPlan>,
    /// Probes, at least one and at most [`MAX_PROBES`].
    pub probes: Vec<ProbePlan>,
    /// Effects of the scene, which every probe feels anywhere.
    pub effects: Vec<EffectPlan>,
}

impl ScenePlan {
    /// Objects that may be awake at once, each with an equal share of the cache: for every probe the one that it
    /// touches and the one that it comes to next, and one to spare.
    #[must_use]
    pub fn seats(&self) -> usize {
        self.objects.len().min(2 * self.probes.len() + 1)
    }
}

/// The loop and its thread.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoopPlan {
    /// Ticks a second, 100..=10000.
    pub rate_hz: f64,
    /// Core of the tick; `None` leaves it to the kernel.
    pub core: Option<usize>,
    /// SCHED_FIFO priority, 1..=99.
    pub priority: i32,
    /// Microseconds before a deadline that are spun, not slept.
    pub spin_us: u64,
    /// Whether a missing right ends the program.
    pub require_realtime: bool,
    /// Mesh operations (splits and collapses) a tick at the most: K.
    pub operations: usize,
}

/// How accurate the touched surface is to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AccuracyPlan {
    /// Wanted expected error at the contact, metres, not negative; 0 is the full mesh.
    pub tolerance_m: f64,
    /// Where the mesh is refined.
    pub refinement: RefinementPlan,
    /// Whether splits and collapses that a probe can feel travel to their place instead of jumping there.
    pub geomorph: bool,
}

/// Where the mesh is refined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RefinementPlan {
    /// Around the contact and its predicted path, coarser with distance (thesis chapter 5).
    #[default]
    Local,
    /// Everywhere alike (thesis chapter 3): to the tolerance, or, with a level of detail, by a count.
    Global {
        /// Vertex splits of the sequence to perform, from the coarsest on: the level of detail.
        lod: Option<u32>,
    },
}

/// Limits of the force gate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafetyPlan {
    /// Largest force, newtons.
    pub force_max_n: f64,
    /// Largest torque, newton metres.
    pub torque_max_nm: f64,
    /// Largest change of the force, newtons a second; a torque changes by the same share of its limit.
    pub slew_n_per_s: f64,
    /// Soft start and end, seconds.
    pub ramp_s: f64,
    /// Whether a touch gives back no more energy than it took in.
    pub passivity: bool,
}

/// Where a model comes from. Only the station opens it.
#[derive(Debug, Clone, PartialEq)]
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
    /// The name by which both sides make sure that they mean the same model.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::File(path) => path.display().to_string(),
            Self::Generate { shape, faces } => format!("generate:{shape}:{faces}"),
        }
    }
}

/// How large a model is in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
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
    /// Pose of the model's frame in the world; the scale applies first, about the model's own origin.
    pub pose: Pose,
    /// What its surface feels like.
    pub surface: SurfacePlan,
    /// Effects of its surface, at most one of a kind; nothing that is not listed.
    pub effects: Arc<[EffectPlan]>,
    /// How it moves, if it does.
    pub movable: Option<MovablePlan>,
}

/// Stiffness and damping of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePlan {
    /// N/m.
    pub stiffness_n_per_m: f64,
    /// N s/m, along the contact normal.
    pub damping_ns_per_m: f64,
}

/// One probe.
#[derive(Debug, Clone, PartialEq)]
pub struct ProbePlan {
    /// What touches.
    pub shape: ProbeShape,
    /// The device that moves it.
    pub device: SimulatedDevicePlan,
    /// What the simulated hand intends.
    pub trajectory: TrajectoryPlan,
}

/// The shape of a probe, in the device's axes: it reaches out along +z, away from what its tip touches.
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
        /// Faces of its mesh, at the most.
        faces: u32,
    },
    /// A cylinder that stands on the device's position.
    Cylinder {
        /// Radius, metres.
        radius_m: f64,
        /// Height, metres.
        length_m: f64,
        /// Faces of its mesh, at the most.
        faces: u32,
    },
    /// A mesh at one level of detail, its origin at the device's position.
    Mesh(ToolMeshPlan),
}

/// The mesh of a tool.
#[derive(Debug, Clone, PartialEq)]
pub struct ToolMeshPlan {
    /// The file that it was read from, for reports.
    pub file: String,
    /// Vertices, metres.
    pub positions: Vec<DVec3>,
    /// Faces, corners as places in `positions`, counterclockwise from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl ProbeShape {
    /// Radius of the ball around the device's position that reaches as deep as the tip, metres; 0 for a flat tip there.
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

    /// How far the shape is from the device's position anywhere, at the most, metres.
    #[must_use]
    pub fn reach_m(&self) -> f64 {
        match self {
            Self::Sphere { radius_m } => *radius_m,
            Self::Capsule {
                radius_m, length_m, ..
            } => length_m - radius_m,
            Self::Cylinder {
                radius_m, length_m, ..
            } => length_m.hypot(*radius_m),
            Self::Mesh(mesh) => mesh
                .positions
                .iter()
                .fold(0.0, |most, p| f64::max(most, p.length())),
        }
    }

    /// Radius of the patch that the tip touches, metres: what is to be refined around a place that it comes to.
    #[must_use]
    pub fn patch_m(&self) -> f64 {
        match self {
            Self::Sphere { radius_m }
            | Self::Capsule { radius_m, .. }
            | Self::Cylinder { radius_m, .. } => *radius_m,
            Self::Mesh(_) => 0.25 * self.reach_m(),
        }
    }
}

/// The simulated device: a mass with damping, moved by a hand and by the rendered force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulatedDevicePlan {
    /// kg.
    pub mass_kg: f64,
    /// N s/m.
    pub damping_ns_per_m: f64,
    /// Encoder step, metres; 0 for none.
    pub encoder_m: f64,
    /// The hand.
    pub hand: Hand,
}

/// A spring and damper to the intended position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hand {
    /// N/m.
    pub stiffness_n_per_m: f64,
    /// N s/m.
    pub damping_ns_per_m: f64,
}

/// What the hand intends.
#[derive(Debug, Clone, PartialEq)]
pub enum TrajectoryPlan {
    /// A tour of an object: approach, press, slide, lift, move on.
    Tour {
        /// Which object, an index into [`ScenePlan::objects`].
        object: usize,
        /// Seed of its choices.
        seed: u64,
        /// Speed, m/s.
        speed_m_per_s: f64,
        /// Depth of the intent below the surface, metres.
        depth_m: f64,
    },
    /// Points read from a CSV file: seconds and poses in the world.
    Points(Vec<(f64, Pose)>),
}

/// What the command line says over the scene.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Overrides {
    /// Another model for the first object and its copies (relative to the current folder).
    pub model: Option<PathBuf>,
    /// Its longest side, metres.
    pub size_m: Option<f64>,
    /// Speed of the first probe's tour, m/s.
    pub speed_m_per_s: Option<f64>,
    /// Seed of the first probe's tour.
    pub seed: Option<u64>,
    /// Cache bytes, as in the scene ("16MiB").
    pub cache: Option<String>,
    /// Wanted error at the contact, metres.
    pub tolerance_m: Option<f64>,
}
