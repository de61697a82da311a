//! The scenes of the seeds.

use super::kind::Kind;
use super::library::Library;
use super::scenario::stream;
use crate::failure::Failure;
use glam::DVec3;
use hrtc_core::cache::{Cache, CacheError};
use scene::{NoFiles, Overrides, ProbeShape, ScenePlan, ToolMeshPlan, TrajectoryPlan, parse};
use simulator::Random;
use spm_builder::generate::{Shape, generate};
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::Path;

/// Longest side of every object, metres.
pub const SIZE_M: f64 = 0.12;
/// Distance of one object from the next, metres: none touches another.
const SPACING_M: f64 = 0.4;
/// Bytes beside the caches for the base meshes of all models: each has a hundred faces or so.
const STORE_BYTES: usize = 256 << 10;
/// Faces of a mesh tool.
const TOOL_FACES: u32 = 200;
/// Length of a mesh tool, metres.
const TOOL_M: f64 = 0.02;

const SCENE_EFFECTS: [&str; 6] = [
    "{ viscosity = { damping_ns_per_m = 0.2 } }",
    "{ spring = { point_m = [0.0, 0.0, 0.05], stiffness_n_per_m = 2.0, force_max_n = 0.2 } }",
    "{ vibration = { frequency_hz = 120.0, amplitude_n = 0.03, direction = [0, 0, 1] } }",
    "{ gravity = { mass_kg = 0.01, direction = [0, 0, -1], centre_m = [0, 0, 0.03] }, from_s = 1.0, until_s = 2.0, fade_s = 0.2 }",
    "{ inertia = { mass_kg = 0.05 } }",
    "{ boundary = { ball = { radius_m = BOUNDARY }, stiffness_n_per_m = 800.0 } }",
];
/// How far the boundary is beyond the middle of the last object, metres: a hand works inside. The
/// radius that follows takes the place of BOUNDARY.
const BOUNDARY_M: f64 = 0.075;
const SURFACE_EFFECTS: [&str; 5] = [
    "{ friction = { static = 0.4, dynamic = 0.3 } }",
    "{ shading = { radius_m = 0.001, max_turn_deg = 45 } }",
    "{ texture = { amplitude_m = 2e-5, noise = { wavelength_m = 0.001, seed = 1 } } }",
    "{ magnet = { force_n = 0.2, reach_m = 0.003 } }",
    "{ vibration = { frequency_hz = 80.0, amplitude_n = 0.05 } }",
];
const MOTIONS: [&str; 4] = [
    "{ rail = { axis = [0, 0, 1], mass_kg = 0.5, spring_n_per_m = 150.0, limits_m = [-0.01, 0.0] } }",
    "{ hinge = { axis = [0, 1, 0], anchor_m = [-0.06, 0, 0], mass_kg = 0.5, spring_nm_per_rad = 0.05, limits_deg = [-10, 40] } }",
    "{ free = { mass_kg = 0.5, spring_n_per_m = 50.0 } }",
    "{ driven = { angular_rad_per_s = [0, 0, 3], period_s = 2.0 } }",
];
const TOOLS: [&str; 2] = [
    "{ capsule = { radius_m = 0.003, length_m = 0.02, faces = 120 } }",
    "{ cylinder = { radius_m = 0.004, length_m = 0.03, faces = 120 } }",
];

/// A scene and the numbers of its objects' models.
pub struct Scene {
    /// The scene.
    pub plan: ScenePlan,
    /// One an object.
    pub models: Vec<usize>,
}

fn some_of(of: &[&str], random: &mut Random) -> String {
    let chosen: Vec<&str> = of.iter().copied().filter(|_| random.happens(0.5)).collect();
    chosen.join(", ")
}

/// Draws a scene with these kinds.
///
/// # Errors
/// When the scene is refused.
pub fn draw(kinds: &BTreeSet<Kind>, bits: u64, library: &Library) -> Result<Scene, Failure> {
    let of = |kind| kinds.contains(&kind).then(|| stream(bits, kind));
    let mut random = Random::new(bits);
    let stiffness = 300.0 * 5f64.powf(random.unit());
    let objects = of(Kind::Objects).map_or(1, |mut of| 2 + of.below(3) as usize);
    let probes = of(Kind::Probes).map_or(1, |mut of| 2 + of.below(2) as usize);
    let encoder_m = if random.happens(0.5) { 1e-5 } else { 0.0 };
    let hand = 200.0 * 4f64.powf(random.unit());
    let models: Vec<usize> = (0..objects)
        .map(|_| random.below(library.len() as u64) as usize)
        .collect();
    let (mut effects, mut motions) = (of(Kind::Effects), of(Kind::Movables));
    let mut text = String::new();
    if let Some(random) = &mut effects {
        let boundary_m = BOUNDARY_M + SPACING_M * (objects - 1) as f64;
        let effects = some_of(&SCENE_EFFECTS, random).replace("BOUNDARY", &boundary_m.to_string());
        let _ = writeln!(text, "effects = [{effects}]");
    }
    for (k, &model) in models.iter().enumerate() {
        let name = Library::name(model);
        let at = SPACING_M * k as f64;
        let _ = writeln!(
            text,
            "[[object]]\nmodel = \"{name}\"\nsize_m = {SIZE_M}\n\
             pose = {{ position_m = [{at}, 0, 0] }}\n\
             surface = {{ stiffness_n_per_m = {stiffness}, damping_ns_per_m = 0.5 }}"
        );
        if let Some(random) = &mut effects {
            let _ = writeln!(text, "effects = [{}]", some_of(&SURFACE_EFFECTS, random));
        }
        if let Some(random) = &mut motions {
            let motion = MOTIONS[random.below(MOTIONS.len() as u64) as usize];
            let _ = writeln!(text, "movable = {motion}");
        }
    }
    let mut tools = of(Kind::Tools);
    let mut is_mesh = Vec::new();
    for _ in 0..probes {
        let shape = tools.as_mut().map(|of| TOOLS.get(of.below(3) as usize));
        is_mesh.push(shape == Some(None));
        let ball = "{ sphere = { radius_m = 0.002 } }";
        let shape = shape.flatten().copied().unwrap_or(ball);
        let _ = writeln!(
            text,
            "[[probe]]\nshape = {shape}\n[probe.device.simulated]\nmass_kg = 0.1\n\
             damping_ns_per_m = 1.0\nencoder_m = {encoder_m:?}\n\
             hand = {{ stiffness_n_per_m = {hand}, damping_ns_per_m = 2.0 }}"
        );
    }
    let mut plan = parse(
        &text,
        "simulated",
        Path::new(""),
        &Overrides::default(),
        &NoFiles,
    )?;
    // Hands go their own ways; a tour that is asked for all the same is one more thing to answer.
    // It is asked for once in a session: where messages overtake each other, in every seed.
    let has_tours = random.happens(0.4) || kinds.contains(&Kind::Reordering);
    for (probe, is_mesh) in plan.probes.iter_mut().zip(is_mesh) {
        if !has_tours {
            probe.trajectory = TrajectoryPlan::Points(Vec::new());
        }
        if is_mesh {
            probe.shape = mesh_tool();
        }
    }
    if let Some(mut random) = of(Kind::SmallCache) {
        let factor = 1.1 + 1.5 * random.unit();
        let least = models
            .iter()
            .map(|&model| least_cache(model, library))
            .max();
        let each = (least.unwrap_or(0) as f64 * factor) as usize;
        plan.cache_bytes = each * plan.active_objects() + STORE_BYTES;
    } else {
        plan.cache_bytes = (8 << 20) * plan.active_objects();
    }
    Ok(Scene { plan, models })
}

/// Bytes of the smallest cache for both versions of a model.
fn least_cache(model: usize, library: &Library) -> usize {
    let needed = [false, true].map(|is_rebuilt| {
        let header = library.version(model, is_rebuilt).model.file.model_header();
        match Cache::new(0).begin_model(&header) {
            Ok(()) => 0,
            Err(CacheError::TooSmall { needed, .. }) => needed,
        }
    });
    needed[0].max(needed[1])
}

/// A ring that stands on the device's position.
fn mesh_tool() -> ProbeShape {
    let ring = generate(Shape::Torus, TOOL_FACES, 1);
    let positions = || ring.positions.iter().map(|&p| DVec3::from_array(p));
    let lower = positions().fold(DVec3::INFINITY, DVec3::min);
    let upper = positions().fold(DVec3::NEG_INFINITY, DVec3::max);
    let scale = TOOL_M / (upper - lower).max_element();
    let foot = DVec3::Z * lower.z;
    ProbeShape::Mesh(ToolMeshPlan {
        file: "ring".to_string(),
        positions: positions().map(|p| (p - foot) * scale).collect(),
        triangles: ring.triangles.clone(),
    })
}
