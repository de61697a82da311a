//! Under memory pressure the contact becomes coarser and stays correct; when the demand fits again,
//! the asked resolution returns.

use crate::common::{World, places_on_tour, plan, spm, world};
use crate::ensure_within_capacity;
use hrtc_core::Fault;
use hrtc_core::cache::CacheError;
use scene::{ProbeShape, ScenePlan};
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

/// A probe so wide that what it touches at full resolution fills many cells.
fn wide_plan() -> ScenePlan {
    let mut plan = plan("");
    plan.probes[0].shape = ProbeShape::Sphere { radius_m: 0.006 };
    plan
}

fn start(model: &[u8], bytes: usize) -> World {
    let mut plan = wide_plan();
    plan.cache_bytes = bytes;
    world(&plan, model, 8.0)
}

/// The smallest cache that the model may have.
fn min_bytes(model: &[u8]) -> usize {
    let mut world = start(model, 20_000);
    for _ in 0..100 {
        world.step_led();
    }
    match world.controller().fault() {
        Some(Fault::Cache(CacheError::TooSmall { needed, .. })) => needed,
        other => panic!("20 kB are too small, and it says {other:?}"),
    }
}

/// Checks that the last tick is correct, however coarse.
fn check(world: &World) {
    let record = world.summary().last;
    ensure_within_capacity(world.controller().cache());
    if record.contact {
        assert!(record.contact_bounded, "a contact has its certified bound");
        assert!(record.certified_error_m.is_finite() && record.certified_error_m >= 0.0);
    }
}

#[test]
fn a_small_cache_coarsens_the_contact_and_recovers() {
    let mesh = generate(Shape::Relief, 60_000, 1);
    let model = spm(mesh, &BuildOptions::default());
    let bytes = min_bytes(&model) * 11 / 10;
    let mut world = start(&model, bytes);
    let (mut coarser, mut contacts, mut asked) = (0, 0, 0);
    for _ in 0..8000 {
        let record = world.step_led().record;
        check(&world);
        coarser += u32::from(record.finest_tolerance_m > 0.0);
        contacts += u32::from(record.contact);
        asked += u32::from(record.contact_asked);
    }
    world.controller().cache().check();
    let steps = world.controller().pressure_steps();
    println!(
        "{bytes} bytes: {contacts} contacts, {asked} as asked, {coarser} ticks coarser than asked, {steps} steps of economy"
    );
    assert!(
        contacts > 4000 && asked < contacts,
        "the cache is too small"
    );
    assert!(
        steps > 0 && coarser > 100,
        "it becomes coarser, and reports it"
    );

    // The demand falls: a tolerance whose blocks fit is reached, and the LOD controller is where
    // it was set.
    let ladder = world
        .controller()
        .header()
        .map(|header| header.level_tolerances[2]);
    let scale = world
        .controller()
        .frame()
        .map_or(0.0, |frame| frame.metres_per_unit);
    let tolerance = f64::from(ladder.expect("the model is there")) * scale;
    world.controller_mut().set_tolerance(tolerance);
    let [touch] = places_on_tour(&wide_plan(), &model, [2.0]);
    let mut back = 0;
    for tick in 0..100_000 {
        let record = world
            .step_at(if tick < 500 { touch.above } else { touch.goal })
            .record;
        check(&world);
        let is_back = record.contact_asked && record.finest_tolerance_m <= tolerance * 1.000_001;
        back = if is_back { back + 1 } else { 0 };
        if back == 2000 {
            break;
        }
    }
    println!(
        "{} ticks later: {:.2e} m at the contact, {tolerance:.2e} m asked for, {} steps of economy",
        world.tick() - 8000,
        world.summary().last.contact_tolerance_m,
        world.controller().pressure_steps()
    );
    assert_eq!(back, 2000, "it comes back and stays");
    assert!(world.summary().last.contact_tolerance_m <= tolerance * 1.000_001);
    world.controller().cache().check();
}
