//! A cache too small for what is wanted makes the touch coarser by the dial and never wrong; when what is wanted
//! fits again, it comes back.

mod common;

use common::{Pair, plan, spm, touches};
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

fn pair(model: &[u8], bytes: usize) -> Pair {
    let mut plan = wide_plan();
    plan.cache_bytes = bytes;
    Pair::new(&plan, model.to_vec(), 8.0)
}

/// The least cache that the model may have.
fn least(model: &[u8]) -> usize {
    let mut pair = pair(model, 20_000);
    for _ in 0..100 {
        pair.step();
    }
    match pair.controller.fault() {
        Some(Fault::Cache(CacheError::TooSmall { needed, .. })) => needed,
        other => panic!("20 kB are too small, and it says {other:?}"),
    }
}

/// A tick in which nothing may be wrong, however coarse it is.
fn check(pair: &Pair, bytes: usize) {
    let record = pair.summary.last;
    let cache = pair.controller.cache();
    assert!(cache.bytes_used() <= bytes && record.cache_bytes <= bytes as u64);
    if record.contact {
        assert!(record.contact_bounded, "a contact has its certified bound");
        assert!(record.certified_error_m.is_finite() && record.certified_error_m >= 0.0);
    }
}

#[test]
fn it_comes_coarser_by_the_dial_and_back() {
    let mesh = generate(Shape::Relief, 60_000, 1);
    let model = spm(mesh, &BuildOptions::default());
    let bytes = least(&model) * 11 / 10;
    let mut pair = pair(&model, bytes);
    let (mut coarser, mut contacts, mut asked) = (0, 0, 0);
    for _ in 0..8000 {
        let record = pair.step();
        check(&pair, bytes);
        coarser += u32::from(record.finest_tolerance_m > 0.0);
        contacts += u32::from(record.contact);
        asked += u32::from(record.contact_asked);
    }
    pair.controller.cache().check();
    let steps = pair.controller.pressure_steps();
    println!(
        "{bytes} bytes: {contacts} contacts, {asked} as asked, {coarser} ticks with a coarser dial, {steps} steps of economy"
    );
    assert!(
        contacts > 4000 && asked < contacts,
        "the cache is too small"
    );
    assert!(steps > 0 && coarser > 100, "it comes coarser, and says so");

    // What is wanted becomes less: a tolerance whose blocks fit is reached, and the dial is where it was set.
    let ladder = pair
        .controller
        .header()
        .map(|header| header.level_tolerances[2]);
    let scale = pair
        .controller
        .frame()
        .map_or(0.0, |frame| frame.metres_per_unit);
    let tolerance = f64::from(ladder.expect("the model is there")) * scale;
    pair.controller.set_tolerance(tolerance);
    let [touch] = touches(&wide_plan(), &model, [2.0]);
    let mut back = 0;
    for tick in 0..100_000 {
        let record = pair.hold(if tick < 500 { touch.above } else { touch.goal });
        check(&pair, bytes);
        let is_back = record.contact_asked && record.finest_tolerance_m <= tolerance * 1.000_001;
        back = if is_back { back + 1 } else { 0 };
        if back == 2000 {
            break;
        }
    }
    println!(
        "{} ticks later: {:.2e} m at the contact, {tolerance:.2e} m asked for, {} steps of economy",
        pair.tick - 8000,
        pair.summary.last.contact_tolerance_m,
        pair.controller.pressure_steps()
    );
    assert_eq!(back, 2000, "it comes back and stays");
    assert!(pair.summary.last.contact_tolerance_m <= tolerance * 1.000_001);
    pair.controller.cache().check();
}
