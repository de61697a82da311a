//! Where every order of splits turns a face over, the contact comes to full resolution all the
//! same: without a change of force that a hand feels, and with the proxy on its side.

use crate::common::{World, plan, spm, surface_over, world};
use glam::DVec3;
use hrtc_core::perception::{STEP_N_PER_S, STEP_SHARE_PER_S};
use scene::ProbeShape;
use spm::{ModelHeader, SpmFile};
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

/// So coarse a base mesh that its first splits fold the terrain over.
const BASE_FACES: u32 = 100;
/// Share of its sides beside its rim where it is not pressed.
const RIM: f64 = 0.2;
/// Splits at whose places the probe is pressed.
const SPLITS: u32 = 64;
/// Ticks for which it stays far above, and where it begins, metres.
const FAR_TICKS: u32 = 100;
const FAR_M: f64 = 0.06;
/// How fast it comes down, metres a tick.
const STEP_M: f64 = 5e-4;
/// Ticks after which the device's velocity is known to be none.
const REST_TICKS: u32 = 20;
/// Ticks within which the contact is at full resolution.
const MAX_TICKS: u32 = 6_000;
/// Period of the loop, seconds.
const PERIOD_S: f64 = 1e-3;

fn terrain() -> Vec<u8> {
    let options = BuildOptions {
        base_faces: Some(BASE_FACES),
        ..BuildOptions::default()
    };
    spm(generate(Shape::Terrain, 2_500, 5), &options)
}

/// Whether a place, stored coordinates, is away from the rim: beside it a probe may slip off.
fn is_inside(header: &ModelHeader, place: DVec3) -> bool {
    let [lower, upper, origin] = [header.lower, header.upper, header.origin].map(DVec3::from_array);
    let share = (place + origin - lower) / (upper - lower);
    [share.x, share.y]
        .iter()
        .all(|of| (RIM..1.0 - RIM).contains(of))
}

/// Presses at a place until the contact is at full resolution. Returns the folds that were passed.
fn press(world: &mut World, file: &SpmFile<&[u8]>, goal: DVec3) -> u32 {
    // It meets the base mesh.
    world.mute_station(true);
    let mut height = FAR_M;
    while height > 0.0 {
        world.step_at(goal + height * DVec3::Z);
        height -= STEP_M;
    }
    for _ in 0..REST_TICKS {
        world.step_at(goal);
    }
    world.mute_station(false);
    let mut before = world.outputs().wrenches[0].force;
    let mut passed = 0;
    for _ in 0..MAX_TICKS {
        let outputs = world.step_at(goal);
        let (force, record) = (outputs.wrenches[0].force, outputs.record);
        let allowed = PERIOD_S * STEP_N_PER_S.max(STEP_SHARE_PER_S * before.length());
        let step = force.distance(before);
        assert!(step <= allowed, "{step} N in a tick, {before} N before");
        before = force;
        passed += record.passed_folds;
        if record.contact_full && record.geomorphing == 0 {
            let controller = world.controller();
            let proxy = controller.proxy().expect("it touches");
            let proxy = controller
                .frame()
                .expect("the model is there")
                .to_model(proxy);
            let (_, closest) = file.closest_point(proxy).expect("the SPM is good");
            // No face of the full mesh hangs over.
            let out = proxy - closest.point;
            assert!(
                out.z > 0.0,
                "the proxy at {proxy} is under the terrain, {passed} folds passed"
            );
            return passed;
        }
    }
    panic!("the contact at {goal} stays coarse, {passed} folds passed");
}

#[test]
fn a_pressed_contact_comes_to_full_resolution_over_folds() {
    let bytes = terrain();
    let file = SpmFile::open(bytes.as_slice()).expect("the SPM is good");
    let mut plan = plan("");
    plan.probes[0].shape = ProbeShape::Sphere { radius_m: 2e-3 };
    let mut passed = 0;
    for id in 0..SPLITS {
        let mut world = world(&plan, &bytes, 1.0);
        for _ in 0..FAR_TICKS {
            world.step_at(FAR_M * DVec3::Z);
        }
        let frame = world.controller().frame().expect("the model is there");
        let split = file.record(id).expect("the file has it");
        let near = DVec3::from_array(split.pos_t.map(f64::from));
        if !is_inside(&file.model_header(), near) {
            continue;
        }
        let near = frame.to_world(near);
        let place = surface_over(&world, &bytes, near);
        passed += press(&mut world, &file, place.goal);
        println!("split {id}: {passed} folds passed");
    }
    assert!(passed > 0, "no split of this terrain folds it over");
}
