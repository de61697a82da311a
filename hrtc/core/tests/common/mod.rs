//! Scenes and models of the tests.
#![allow(dead_code, reason = "every test file uses another part")]

use geometry::Pose;
use glam::DVec3;
use haptic_device::Sample;
use hrtc_core::record::CoreRecord;
use protocol::{AnswerItem, AnswersReader, AnswersWriter, ChunkKind};
use realtime::counting_allocator::CountingAllocator;
use scene::{NoFiles, Overrides, ScenePlan, TrajectoryPlan, parse};
use simulator::{Client, ClientOptions, LinkModel, STATION, Simulation, refined_front};
use spm::{SpmFile, VspRecord, write_spm};
use spm_builder::{BuildOptions, NoProgress, SoupMesh, build_model, read_mesh};
use station_core::station::{ServedModel, Station};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Counts by thread: tests that run beside each other do not disturb each other.
#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

pub mod fronts;
pub mod guided_tool;
pub mod signed_distance;

/// Both cores and a link, of models in memory.
pub type World = Simulation<Vec<u8>>;

/// Ticks without a change after which a front at rest is complete.
const QUIET_TICKS: u64 = 500;
/// The same for a scene of several objects.
const QUIET_SCENE_TICKS: u64 = 300;
/// Ticks within which such a scene comes to rest.
const MAX_SCENE_TICKS: u64 = 20_000;
/// Ticks above a place before the probe goes down to it.
const APPROACH_TICKS: u64 = 500;
/// Name of the only model.
const MODEL: &str = "model.spm";

/// A scene of one object and one tour.
pub fn plan(extra: &str) -> ScenePlan {
    let text = format!(
        r#"
[cache]
bytes = "16MiB"
[[object]]
model = "{MODEL}"
size_m = 0.15
surface = {{ stiffness_n_per_m = 800.0, damping_ns_per_m = 0.5 }}
[[probe]]
shape = {{ sphere = {{ radius_m = 0.001 }} }}
trajectory = {{ tour = {{ seed = 1, speed_m_per_s = 0.1, depth_m = 0.002 }} }}
[probe.device.simulated]
mass_kg = 0.1
damping_ns_per_m = 1.0
encoder_m = 1e-5
hand = {{ stiffness_n_per_m = 200.0, damping_ns_per_m = 2.0 }}
{extra}
"#
    );
    parse(
        &text,
        "test",
        Path::new(""),
        &Overrides::default(),
        &NoFiles,
    )
    .expect("the test's scene is good")
}

/// A scene of objects, each a name of a model, a size (metres) and a place, and of probes of 1 mm
/// that the test leads.
pub fn scene_plan(objects: &[(&str, f64, DVec3)], probes: usize, cache_bytes: usize) -> ScenePlan {
    let mut text = format!("[cache]\nbytes = {cache_bytes}\n");
    for (model, size, DVec3 { x, y, z }) in objects {
        text += &format!("[[object]]\nmodel = \"{model}\"\nsize_m = {size}\n");
        text += &format!("pose = {{ position_m = [{x}, {y}, {z}] }}\n");
    }
    text += &"[[probe]]\n".repeat(probes);
    let mut plan = parse(
        &text,
        "test",
        Path::new(""),
        &Overrides::default(),
        &NoFiles,
    )
    .expect("the test's scene is good");
    for probe in &mut plan.probes {
        probe.trajectory = TrajectoryPlan::Points(Vec::new());
    }
    plan
}

/// A file of the models beside the repository, or `None` with a line that says so.
pub fn real_model(name: &str) -> Option<PathBuf> {
    model_or(name, "skipped")
}

/// The same; the line says what the test does without it.
pub fn model_or(name: &str, otherwise: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/models");
    let path = folder.join(name);
    if path.exists() {
        return Some(path);
    }
    let thread = std::thread::current();
    let test = thread.name().unwrap_or("a test");
    // Written past the capture of the test runner, which shows nothing of a test that passes.
    let line = format!(
        "{otherwise}: {test} with {name}, {} is not there\n",
        path.display()
    );
    let _ = std::io::stderr().write_all(line.as_bytes());
    None
}

/// Bytes of the SPM of a mesh file.
pub fn spm_of_file(path: &Path) -> Vec<u8> {
    spm(
        read_mesh(path).expect("the model is read"),
        &BuildOptions::default(),
    )
}

/// Bytes of the SPM of a mesh.
pub fn spm(mesh: SoupMesh, options: &BuildOptions) -> Vec<u8> {
    let parts = build_model(mesh, options, &NoProgress).expect("the model is built");
    let mut bytes = Vec::new();
    write_spm(&parts, &mut bytes).expect("memory takes it");
    bytes
}

/// A station of a scene's objects; `models`: name and file of each.
pub fn scene_station(
    plan: &ScenePlan,
    models: &[(&str, &[u8])],
    incarnation: u64,
) -> Station<Vec<u8>> {
    let served = models.iter().map(|(name, spm)| ServedModel {
        name: (*name).to_string(),
        file: SpmFile::open(spm.to_vec()).expect("the SPM is good"),
    });
    simulator::station(plan, served.collect(), incarnation).expect("the test serves every model")
}

/// A station of the only model.
pub fn station(plan: &ScenePlan, spm: &[u8], incarnation: u64) -> Station<Vec<u8>> {
    scene_station(plan, &[(MODEL, spm)], incarnation)
}

/// A world of [`plan`] before its first tick; tours take `tour_s` seconds.
pub fn world(plan: &ScenePlan, spm: &[u8], tour_s: f64) -> World {
    scene_world(plan, &[(MODEL, spm)], tour_s)
}

/// A world of a scene before its first tick; tours, if any, take `tour_s` seconds.
pub fn scene_world(plan: &ScenePlan, models: &[(&str, &[u8])], tour_s: f64) -> World {
    let options = ClientOptions {
        tour_s,
        ..ClientOptions::default()
    };
    Simulation::new(
        scene_station(plan, models, STATION),
        Client::new(plan, options),
    )
}

/// A link with faults: probabilities of a loss, a duplicate, and of being overtaken.
pub fn faulty(loss: f64, duplicates: f64, reordering: f64) -> LinkModel {
    LinkModel {
        loss,
        duplicates,
        reordering,
        ..LinkModel::default()
    }
}

/// A place on the surface and one above it, metres of the world.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// In free space.
    pub above: DVec3,
    /// The probe's centre on the surface: pressed in by its radius.
    pub goal: DVec3,
}

/// Places on the surface under a plan's tour at some times, seconds.
pub fn places_on_tour<const N: usize>(
    plan: &ScenePlan,
    spm: &[u8],
    seconds: [f64; N],
) -> [Place; N] {
    let mut world = world(plan, spm, 8.0);
    while world.controller().tour().is_none() {
        world.step_led();
        assert!(world.tick() < 10_000, "the tour arrives");
    }
    let tour = world.controller().tour().expect("it was waited for");
    let frame = world.controller().frame().expect("the model is there");
    seconds.map(|seconds| {
        let point = tour.iter().find(|point| point.t >= seconds);
        // Points of a tour lie under the surface.
        let inside = point.expect("the tour is longer").position;
        let inside = frame.to_world(DVec3::from_array(inside) - frame.origin);
        surface_over(&world, spm, inside)
    })
}

/// The surface over a point under it, metres of the world.
pub fn surface_over(world: &World, spm: &[u8], inside: DVec3) -> Place {
    let frame = world.controller().frame().expect("the model is there");
    let inside = frame.to_model(inside);
    let file = SpmFile::open(spm).expect("the SPM is good");
    let (_, closest) = file.closest_point(inside).expect("the SPM is good");
    let out = frame.vector_to_world(closest.point - inside).normalize();
    let goal = frame.to_world(closest.point);
    Place {
        above: goal + 0.0025 * out,
        goal,
    }
}

/// Ticks with the probe first above a place and then at it, until the front is complete.
pub fn rest(world: &mut World, place: Place, max_ticks: u64) {
    for tick in 0..APPROACH_TICKS {
        let record = world.step_at(place.above).record;
        assert!(
            tick < APPROACH_TICKS / 2 || !record.contact,
            "the place above is free"
        );
    }
    let goal = [Some(Sample::at(Pose::at(place.goal)))];
    let settled = world.settle(&goal, QUIET_TICKS, max_ticks - APPROACH_TICKS);
    assert!(
        settled.is_some(),
        "the front does not come to rest in {max_ticks} ticks"
    );
}

/// Steps with the probes at their places until nothing changes on the active objects.
pub fn settle(world: &mut World, places: &[Option<DVec3>]) -> CoreRecord {
    let samples: Vec<_> = places
        .iter()
        .map(|place| place.map(Pose::at).map(Sample::at))
        .collect();
    let settled = world.settle(&samples, QUIET_SCENE_TICKS, MAX_SCENE_TICKS);
    settled.expect("the scene comes to rest")
}

/// Checks the caches of all active objects whose base mesh is there.
pub fn check(world: &World) {
    let objects = world.controller().active_objects().iter();
    for object in objects.filter(|object| object.is_ready()) {
        object.cache().check();
    }
}

/// Ids of the performed splits of an active object, ascending.
pub fn front_of(world: &World, object: usize) -> Vec<u32> {
    let object = world
        .controller()
        .active_object(object)
        .expect("it is active");
    refined_front(object.cache())
}

/// Packs a chunk of answers again with its records changed.
pub fn change_records(
    chunk: &mut hrtc_core::streaming::chunk::InboxChunk,
    mut change: impl FnMut(&mut VspRecord),
) {
    if chunk.header.kind != ChunkKind::Answers as u32 {
        return;
    }
    let mut reader = AnswersReader::new(chunk.header.count);
    let mut writer = AnswersWriter::new();
    while let Some(item) = reader.next(&chunk.slots).expect("the station packs well") {
        match item {
            AnswerItem::Part(head) => {
                writer.begin(head.region, head.tolerance_bits, head.is_first());
            }
            AnswerItem::Id { id, record_follows } => assert!(writer.id(id, record_follows)),
            AnswerItem::Record(mut record) => {
                change(&mut record);
                assert!(writer.record(&record));
            }
            AnswerItem::End(head) => writer.end(head.is_last()),
        }
    }
    (chunk.header.count, chunk.slots) = writer.finish();
}
