//! With `refinement = "global"` the refined mesh is exactly the prefix of the sequence, or exactly
//! the splits that exceed the tolerance; and no tick exceeds its budget.

use crate::common::{
    Place, World, front_of, places_on_tour, plan, rest, scene_plan, scene_world, settle, spm, world,
};
use crate::ensure_within_capacity;
use glam::DVec3;
use scene::RefinementPlan;
use simulator::{front_faces, refined_front};
use spm::{ActiveMesh, Certified, ErrorScale, OperationFaces, SpmFile};
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};
use std::collections::BTreeSet;

/// Ticks within which the whole model must be refined.
const MAX_TICKS: u64 = 40_000;

fn model(faces: u32) -> Vec<u8> {
    let mesh = generate(Shape::Relief, faces, 1);
    spm(mesh, &BuildOptions::default())
}

fn start(model: &[u8], lod: Option<u32>, tolerance_m: f64, cache_bytes: usize) -> World {
    let mut plan = plan("");
    plan.accuracy.tolerance_m = tolerance_m;
    plan.accuracy.refinement = RefinementPlan::Global { lod };
    plan.cache_bytes = cache_bytes;
    world(&plan, model, 8.0)
}

/// The faces after these splits, by an active mesh of its own whose slots are the file's numbers.
fn faces_after(file: &SpmFile<Vec<u8>>, splits: impl Iterator<Item = u32>) -> BTreeSet<u32> {
    let header = file.model_header();
    let mut mesh = ActiveMesh::new(header.base_vertices, header.base_faces, header.vsps);
    for (handle, vertex) in (0u32..).zip(file.base_vertices()) {
        mesh.set_base_vertex(handle, vertex.position, Certified::EXACT);
    }
    for (handle, face) in (0u32..).zip(file.base_faces()) {
        let set = mesh.set_base_face(handle, face.corners, face.neighbours);
        set.expect("the file has checked its base mesh");
    }
    let mut out = OperationFaces::new();
    for i in 0..header.vsps {
        let record = file.record(i).expect("the file is good");
        mesh.load(i, &record, record.vs, record.fn_, [Certified::EXACT; 2]);
    }
    for i in splits {
        mesh.split(i, &mut out).expect("the sequence is legal");
    }
    let mut faces = BTreeSet::new();
    mesh.for_each_active_face(|face| assert!(faces.insert(face)));
    faces
}

/// Rests on the surface until the front is complete; no tick does more than its budget.
fn complete(world: &mut World, touch: Place, what: &str) {
    rest(world, touch, MAX_TICKS);
    world.controller().cache().check();
    within_budget(world, what);
}

fn within_budget(world: &World, what: &str) {
    let (most, budget) = (world.summary().work_max, world.controller().work_budget());
    println!(
        "{what}: at tick {} work at the most {most} of {budget}",
        world.tick()
    );
    assert!(most <= budget, "{what}: a tick does {most} of {budget}");
}

#[test]
fn a_level_of_detail_is_the_prefix_mesh() {
    let model = model(30_000);
    let file = SpmFile::open(model.clone()).expect("the model is good");
    let vsps = file.model_header().vsps;
    let [touch] = places_on_tour(&plan(""), &model, [1.0]);
    for lod in [0, 1, vsps / 10, vsps / 2, vsps, vsps + 7] {
        let mut world = start(&model, Some(lod), 0.0, 64 << 20);
        complete(&mut world, touch, &format!("lod {lod}"));
        let count = lod.min(vsps);
        assert_eq!(
            refined_front(world.controller().cache()),
            (0..count).collect::<Vec<u32>>()
        );
        assert_eq!(
            front_faces(world.controller()),
            faces_after(&file, 0..count),
            "lod {lod}"
        );
        // The surface of few splits may lie elsewhere.
        let record = world.summary().last;
        assert!(record.contact || count < vsps, "it touches");
        assert_eq!(record.contact, record.contact_asked, "lod {lod}");
    }
}

#[test]
fn a_tolerance_is_the_splits_that_exceed_it() {
    let model = model(30_000);
    let file = SpmFile::open(model.clone()).expect("the model is good");
    let header = file.model_header();
    let [touch] = places_on_tour(&plan(""), &model, [1.0]);
    let scale = ErrorScale::for_diagonal(header.diagonal);
    for tolerance in [0.0, 1e-4, 1e-3] {
        let mut world = start(&model, None, tolerance, 64 << 20);
        complete(&mut world, touch, &format!("tolerance {tolerance} m"));
        let metres = world
            .controller()
            .frame()
            .expect("it is there")
            .metres_per_unit;
        let units = f64::from((tolerance / metres) as f32);
        let exceeds = |&i: &u32| {
            let code = file.record(i).expect("the file is good").e;
            tolerance == 0.0 || scale.decode(code) > units
        };
        let splits: Vec<u32> = (0..header.vsps).filter(exceeds).collect();
        assert!(!splits.is_empty());
        assert_eq!(
            refined_front(world.controller().cache()),
            splits,
            "{tolerance} m"
        );
        assert_eq!(
            front_faces(world.controller()),
            faces_after(&file, splits.into_iter())
        );
        assert!(world.summary().last.contact && world.summary().last.contact_asked);
    }
}

#[test]
fn what_does_not_fit_is_cut_and_reported() {
    let model = model(60_000);
    let file = SpmFile::open(model.clone()).expect("the model is good");
    let vsps = file.model_header().vsps;
    let [touch] = places_on_tour(&plan(""), &model, [1.0]);
    let bytes = 4 << 20;
    for lod in [Some(vsps), None] {
        let mut world = start(&model, lod, 0.0, bytes);
        for tick in 0..12_000 {
            let record = world
                .step_at(if tick < 500 { touch.above } else { touch.goal })
                .record;
            assert!(!record.contact || record.contact_bounded);
        }
        world.controller().cache().check();
        ensure_within_capacity(world.controller().cache());
        let (record, front) = (
            world.summary().last,
            refined_front(world.controller().cache()),
        );
        println!(
            "{lod:?}: {} of {vsps} splits, tolerance {:.2e} m, {} steps of economy",
            front.len(),
            record.finest_tolerance_m,
            world.controller().pressure_steps()
        );
        within_budget(&world, &format!("{lod:?} in a small cache"));
        let slots = world.controller().cache().slots();
        assert!(
            slots < vsps && front.len() as u32 > slots / 8,
            "it is of use"
        );
        assert!(
            record.contact && !record.contact_asked,
            "it is cut, and reported"
        );
        if lod.is_some() {
            let count = front.len() as u32;
            assert_eq!(
                front,
                (0..count).collect::<Vec<u32>>(),
                "a prefix all the same"
            );
        } else {
            assert!(record.finest_tolerance_m > 0.0);
        }
        assert_eq!(
            front_faces(world.controller()),
            faces_after(&file, front.into_iter())
        );
    }
}

/// An object that no probe is near comes coarser, and back under the next touch.
#[test]
fn a_level_of_detail_that_is_given_up_is_not_as_asked_until_it_is_done_again() {
    const COUNT: u32 = 20_000;
    let model = spm(generate(Shape::Sphere, 60_000, 1), &BuildOptions::default());
    // A single object would always count as near.
    let objects = [DVec3::ZERO, DVec3::X].map(|centre| ("ball", 0.1, centre));
    let mut plan = scene_plan(&objects, 1, 64 << 20);
    plan.accuracy.refinement = RefinementPlan::Global { lod: Some(COUNT) };
    let mut world = scene_world(&plan, &[("ball", &model[..])], 0.0);
    let is_whole = |world: &World| front_of(world, 0).into_iter().eq(0..COUNT);
    // So deep that it touches the base mesh, too.
    let (pressed, lifted) = (DVec3::Z * 0.0495, DVec3::Z * 0.0795);
    let at = |step: u32| lifted.lerp(pressed, f64::from(step.min(30)) / 30.0);
    settle(&mut world, &[Some(lifted)]);
    for step in 0..30 {
        world.step_at(at(step));
    }
    settle(&mut world, &[Some(pressed)]);
    let record = world.outputs().record;
    assert!(is_whole(&world) && record.contact && record.contact_asked);
    for step in (0..30).rev() {
        world.step_at(at(step));
    }
    settle(&mut world, &[Some(lifted)]);
    let left = front_of(&world, 0).len();
    assert!(left < COUNT as usize / 2, "{left} splits are left");
    let mut coarse = 0;
    for step in 0.. {
        let record = world.step_at(at(step)).record;
        if is_whole(&world) {
            break;
        }
        assert!(u64::from(step) < MAX_TICKS, "it does not come back");
        if record.contact && record.certified_error_m != 0.0 {
            coarse += 1;
            assert!(!record.contact_asked, "{coarse} ticks after it touches");
        }
    }
    println!("{left} splits were left, {coarse} ticks of coarse contact");
    assert!(coarse > 0, "it touches before the front is done");
    for _ in 0..100 {
        world.step_at(pressed);
    }
    let record = world.outputs().record;
    assert!(record.contact && record.contact_asked);
}
