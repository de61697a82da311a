//! Memory pressure over many sizes of the cache: a larger one makes no contact coarser on average,
//! and the finest ring does not hunt.

use crate::common::{plan, real_model, spm, spm_of_file, world};
use crate::ensure_within_capacity;
use hrtc_core::cache::Cache;
use scene::{ProbeShape, ScenePlan, TrajectoryPlan};
use spm::{ModelHeader, SpmFile};
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

const TICKS: u32 = 16_000;
/// Ticks until the first steps have taken effect.
const SETTLED: u32 = 1_000;
/// Tours over which the contacts of a size are averaged.
const TOURS: u64 = 3;
/// Tenths of the least cache.
const SIZES: [usize; 8] = [10, 11, 12, 13, 14, 15, 17, 20];
/// By how much a larger cache may be worse on so few tours: trials of a finer ring fall on other
/// places.
const SPREAD: f64 = 1.4;
/// Changes of the finest ring in a run: up to the coarsest, then there and back in each trial,
/// after 1, 2, 4 and 8 seconds.
const MAX_CHANGES: u32 = 12;

/// The scene of a size and a tour.
fn plan_of(bytes: usize, tour: u64) -> ScenePlan {
    let mut plan = plan("");
    // So wide that what it touches at full resolution fills many cells.
    plan.probes[0].shape = ProbeShape::Sphere { radius_m: 0.006 };
    if let TrajectoryPlan::Tour { seed, .. } = &mut plan.probes[0].trajectory {
        *seed = tour;
    }
    plan.cache_bytes = bytes;
    plan
}

/// What the contacts of a run had.
#[derive(Debug, Default)]
struct Accuracy {
    contacts: f64,
    full: f64,
    certified_m: f64,
    /// Expected error of the second coarser ring, metres.
    second_m: f64,
}

impl Accuracy {
    fn add(&mut self, plan: &ScenePlan, model: &[u8], header: &ModelHeader) {
        let mut world = world(plan, model, 8.0);
        let (mut changes, mut before) = (0, 0.0);
        for tick in 0..TICKS {
            let record = world.step_led().record;
            assert!(!record.contact || record.contact_bounded, "tick {tick}");
            changes += u32::from(record.finest_tolerance_m != before);
            before = record.finest_tolerance_m;
            if record.contact && tick >= SETTLED {
                self.contacts += 1.0;
                self.full += f64::from(u8::from(record.contact_full));
                self.certified_m += record.certified_error_m;
            }
        }
        assert!(changes <= MAX_CHANGES, "it hunts: {changes} changes");
        assert!(world.controller().fault().is_none());
        ensure_within_capacity(world.controller().cache());
        world.controller().cache().check();
        let frame = world.controller().frame().expect("the model is there");
        self.second_m = f64::from(header.level_tolerances[2]) * frame.metres_per_unit;
    }
}

fn check_sizes(name: &str, model: &[u8]) {
    let file = SpmFile::open(model).expect("the SPM is good");
    let header = file.model_header();
    let least = Cache::least_bytes(&header);
    let mut smallest = f64::INFINITY;
    for tenths in SIZES {
        let mut all = Accuracy::default();
        for tour in 1..=TOURS {
            all.add(&plan_of(least * tenths / 10, tour), model, &header);
        }
        let [full, mean_m] = [all.full, all.certified_m].map(|sum| sum / all.contacts);
        println!("{name}, {tenths} tenths: {mean_m:.2e} m, full {full:.2}");
        assert!(all.contacts > 10_000.0, "it touches");
        assert!(
            mean_m <= SPREAD * smallest,
            "{name}, {tenths} tenths: {mean_m:.2e} m, in a smaller cache {smallest:.2e} m"
        );
        assert!(mean_m <= 2.0 * all.second_m, "the ring that fits is taken");
        assert!(tenths < 20 || full >= 0.95, "{name}: it fits");
        smallest = smallest.min(mean_m);
    }
}

#[test]
fn on_generated_relief() {
    let mesh = generate(Shape::Relief, 60_000, 1);
    check_sizes("relief", &spm(mesh, &BuildOptions::default()));
}

#[test]
fn on_a_real_model() {
    if let Some(path) = real_model("bunny20k.obj") {
        check_sizes("bunny", &spm_of_file(&path));
    }
}
