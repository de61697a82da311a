//! Tools as probes of a scene: a capsule, a cylinder and a mesh feel a surface as their shape does,
//! wherever the object, beside balls, from one object to the next, without an allocation.

use crate::common::{World, check, scene_plan, scene_world, spm};
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};
use hrtc_core::contact::tool::cylinder_mesh;
use realtime::counting_allocator::count;
use scene::{ProbeShape, ToolMeshPlan};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, SoupMesh};
use std::sync::LazyLock;

const RADIUS: f64 = 0.003;
const LENGTH: f64 = 0.02;
/// Of a surface of which the scene does not say it, N/m.
const STIFFNESS: f64 = 800.0;
/// Step of the encoder of a device of which the scene does not say it, metres.
const ENCODER_M: f64 = 1e-5;
/// Longest side of every object, metres.
const SIZE: f64 = 0.2;

static PLATE: LazyLock<Vec<u8>> =
    LazyLock::new(|| spm(generate(Shape::Plate, 5000, 1), &BuildOptions::default()));
static SPHERE: LazyLock<Vec<u8>> =
    LazyLock::new(|| spm(generate(Shape::Sphere, 20_000, 1), &BuildOptions::default()));

/// Two balls of a sixth of its length at its ends.
static DUMBBELL: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let ball = generate(Shape::Sphere, 30_000, 1);
    let mut mesh = SoupMesh::default();
    for middle in [-2.0, 2.0] {
        let first = mesh.positions.len() as u32;
        let triangles = ball.triangles.iter().map(|t| t.map(|v| v + first));
        mesh.triangles.extend(triangles);
        let moved = ball.positions.iter().map(|[x, y, z]| [x + middle, *y, *z]);
        mesh.positions.extend(moved);
    }
    spm(mesh, &BuildOptions::default())
});

fn capsule() -> ProbeShape {
    ProbeShape::Capsule {
        radius_m: RADIUS,
        length_m: LENGTH,
        faces: 960,
    }
}

fn cylinder() -> ProbeShape {
    ProbeShape::Cylinder {
        radius_m: RADIUS,
        length_m: LENGTH,
        faces: 240,
    }
}

/// A cylinder as a mesh of its own, its origin in the middle.
fn mesh() -> ProbeShape {
    let mesh = cylinder_mesh(RADIUS, LENGTH, 240);
    ProbeShape::Mesh(ToolMeshPlan {
        file: "cylinder.spm".to_string(),
        positions: mesh.positions,
        triangles: mesh.triangles,
    })
}

/// Objects side by side, a probe for each shape.
fn scene(objects: &[(&str, DVec3)], shapes: &[ProbeShape]) -> World {
    let objects: Vec<_> = objects.iter().map(|&(name, at)| (name, SIZE, at)).collect();
    let mut plan = scene_plan(&objects, shapes.len(), 8 << 20);
    for (probe, shape) in plan.probes.iter_mut().zip(shapes) {
        probe.shape = shape.clone();
    }
    scene_world(&plan, &[("plate", &PLATE), ("sphere", &SPHERE)], 0.0)
}

/// Rests there until nothing changes and gives the wrenches.
fn press(world: &mut World, above: &[Pose], inside: &[Pose]) -> Vec<Wrench> {
    let some = |poses: &[Pose]| poses.iter().copied().map(Some).collect::<Vec<_>>();
    for _ in 0..800 {
        world.step_poses(&some(above));
    }
    for tick in 1..=400 {
        let share = (f64::from(tick) / 200.0).min(1.0);
        let way: Vec<_> = above
            .iter()
            .zip(inside)
            .map(|(from, to)| {
                Some(Pose {
                    position: from.position.lerp(to.position, share),
                    orientation: from.orientation.slerp(to.orientation, share),
                })
            })
            .collect();
        world.step_poses(&way);
    }
    world.outputs().wrenches.clone()
}

#[test]
fn flat_on_a_plate_a_tool_of_any_kind_pushes_back_with_stiffness_times_depth() {
    let depth = 0.001;
    // The mesh's origin is its middle: its tip is half its length below.
    for (name, shape, tip) in [
        ("capsule", capsule(), RADIUS),
        ("cylinder", cylinder(), 0.0),
        ("mesh", mesh(), 0.5 * LENGTH),
    ] {
        assert!((shape.tip_m() - tip).abs() < 1e-12, "{name}");
        let mut world = scene(&[("plate", DVec3::ZERO)], &[shape]);
        let at = |z: f64| Pose::at(DVec3::new(0.01, 0.02, tip + z));
        let [wrench] = press(&mut world, &[at(0.01)], &[at(-depth)])[..] else {
            panic!("there is one probe");
        };
        // A contact acts half a step of the encoder above the plate.
        let due = STIFFNESS * (depth + 0.5 * ENCODER_M);
        let record = world.outputs().record;
        assert!(record.contact && record.contact_full, "{name}: {record:?}");
        assert!(
            (wrench.force - DVec3::Z * due).length() < 1e-3 * due,
            "{name}: {wrench:?}, {due} N are due"
        );
        assert!(
            wrench.torque.length() < 1e-3 * due * LENGTH,
            "{name}: {wrench:?}"
        );
    }
}

#[test]
fn a_turned_object_turns_force_and_torque_with_it() {
    let measured = |turn: DQuat| {
        let mut plan = scene_plan(&[("plate", SIZE, DVec3::new(1.0, -2.0, 0.5))], 1, 8 << 20);
        plan.objects[0].pose.orientation = turn;
        plan.probes[0].shape = cylinder();
        let pose = plan.objects[0].pose;
        let mut world = scene_world(&plan, &[("plate", &PLATE), ("sphere", &SPHERE)], 0.0);
        // Tilted, so that one side of its foot touches.
        let tilt = DQuat::from_rotation_x(0.2);
        let at = |z: f64| Pose {
            position: pose.transform_point(DVec3::new(0.01, 0.02, z)),
            orientation: pose.orientation * tilt,
        };
        let measured = press(&mut world, &[at(0.01)], &[at(-0.0005)])[0];
        [measured.force, measured.torque].map(|v| turn.inverse() * v)
    };
    let straight = measured(DQuat::IDENTITY);
    assert!(
        straight[1].x.abs() > 1e-5,
        "a tilted foot is turned: {straight:?}"
    );
    for turn in [
        DQuat::from_rotation_y(1.0),
        DQuat::from_rotation_z(-2.0) * DQuat::from_rotation_x(0.7),
    ] {
        let turned = measured(turn);
        for (a, b) in straight.iter().zip(&turned) {
            assert!(
                a.distance(*b) < 1e-6 * a.length(),
                "{straight:?} {turned:?}"
            );
        }
    }
}

/// A bar lies on one ball and is tilted until it touches another far from there: neither its tip
/// nor what it touches tells of that. With geomorphs, what is coarse there would stay so for long.
#[test]
fn what_another_part_of_a_tool_comes_to_touch_is_at_full_resolution() {
    let shape = ProbeShape::Capsule {
        radius_m: RADIUS,
        length_m: 0.18,
        faces: 960,
    };
    let (mut once, mut twice, mut coarse) = (0, 0, 0);
    for turn in 0..4 {
        let mut plan = scene_plan(&[("dumbbell", SIZE, DVec3::ZERO)], 1, 16 << 20);
        plan.probes[0].shape = shape.clone();
        assert!(plan.accuracy.geomorph);
        let mut world = scene_world(&plan, &[("dumbbell", &DUMBBELL)], 0.0);
        let around = DQuat::from_rotation_x(f64::from(turn));
        let pose = |height: f64, tilt: f64| {
            let orientation = around * DQuat::from_rotation_y(0.5 * std::f64::consts::PI - tilt);
            let over = DVec3::new(-SIZE / 3.0, 0.0, SIZE / 6.0 + RADIUS + height);
            Some(Pose {
                position: around * over - orientation * DVec3::Z * 0.02,
                orientation,
            })
        };
        for _ in 0..600 {
            world.step_poses(&[pose(0.02, 0.2)]);
        }
        for tick in 0..2000 {
            let t = 1e-3 * f64::from(tick);
            let height = 0.02 - 0.021 * t.min(1.0);
            let tilt = 0.2 - 0.21 * (t - 1.0).max(0.0);
            let record = world.step_poses(&[pose(height, tilt)]).record;

            once += u32::from(record.contact);
            let force = world.outputs().wrenches[0].force.length();
            assert_eq!(record.contact, force > 0.0, "tick {tick}: {force} N");
            coarse += u32::from(record.contact && !record.contact_asked);
        }
        twice += u32::from(world.outputs().wrenches[0].force.length() > 1.5 * STIFFNESS * 0.001);
    }
    println!("{once} ticks in contact, {coarse} of them coarser than asked; {twice} times at both");
    assert_eq!((twice, coarse), (4, 0), "of {once} ticks");
}

#[test]
fn a_ball_beside_a_tool_feels_what_it_feels_alone() {
    let ball = ProbeShape::Sphere { radius_m: RADIUS };
    let at = |x: f64, z: f64| Pose::at(DVec3::new(x, 0.0, RADIUS + z));
    let mut alone = scene(&[("plate", DVec3::ZERO)], std::slice::from_ref(&ball));
    let mut beside = scene(&[("plate", DVec3::ZERO)], &[ball, capsule()]);
    let one = press(&mut alone, &[at(-0.05, 0.01)], &[at(-0.05, -0.001)]);
    let two = press(
        &mut beside,
        &[at(-0.05, 0.01), at(0.05, 0.01)],
        &[at(-0.05, -0.001), at(0.05, -0.001)],
    );
    assert_eq!(one[0], two[0]);
    assert!(two[1].force.z > 0.5 * one[0].force.z);
}

#[test]
fn a_tool_goes_from_object_to_object_and_allocates_nothing() {
    assert!(count(|| vec![0u8; 100]) > 0, "the allocator counts");
    let centre = |object: usize| DVec3::X * (0.3 * object as f64);
    let row: Vec<_> = (0..8).map(|object| ("sphere", centre(object))).collect();
    let mut world = scene(&row, &[capsule()]);
    let mut at = Pose::at(centre(0) + DVec3::Z * (0.5 * SIZE + 0.02));
    let (mut unfinished, mut all) = (0, 0);
    let mut go = |world: &mut World, to: DVec3, ticks: u32| {
        all += ticks;
        let from = at.position;
        for tick in 1..=ticks {
            at.position = from.lerp(to, f64::from(tick) / f64::from(ticks));
            world.step_poses(&[Some(at)]);
            assert_eq!(world.client().allocations(), 0);
            unfinished += world.outputs().record.unfinished;
            assert!(world.outputs().wrenches[0].is_finite());
        }
    };
    for object in 0..8 {
        let above = centre(object) + DVec3::Z * (0.5 * SIZE + 0.02);
        go(&mut world, above, 400);
        go(
            &mut world,
            centre(object) + DVec3::Z * (0.5 * SIZE + RADIUS - 0.001),
            200,
        );
        go(&mut world, above - DVec3::Z * 0.018, 100);
        let touched = world.outputs().contacts[0].expect("it touches");
        assert_eq!(touched.object as usize, object);
        go(&mut world, above, 100);
        assert_eq!(world.outputs().contacts[0], None);
    }
    println!("{unfinished} of {all} ticks know nothing");
    // Where it comes to an object its pairs are collected over some ticks.
    assert!(50 * unfinished <= all, "{unfinished} of {all}");
    check(&world);
}

/// Four tools lie on a rough surface and slide over it while it is refined under them.
#[test]
fn the_queries_of_a_tick_stay_within_one_total_and_every_tool_comes_to_its_contact() {
    let model = spm(generate(Shape::Relief, 60_000, 1), &BuildOptions::default());
    let mut plan = scene_plan(&[("relief", SIZE, DVec3::ZERO)], 4, 16 << 20);
    for probe in &mut plan.probes {
        probe.shape = ProbeShape::Capsule {
            radius_m: RADIUS,
            length_m: 0.04,
            faces: 960,
        };
    }
    let mut world = scene_world(&plan, &[("relief", &model)], 0.0);
    let lying = DQuat::from_rotation_y(0.5 * std::f64::consts::PI);
    let budget = world.controller().query_budget();
    let (mut busiest, mut before) = (0.0f64, Vec::new());
    for tick in 0..4000 {
        let t = 1e-3 * f64::from(tick);
        let height = 0.1 - 0.12 * (t / 1.5).min(1.0);
        // Still in the last second.
        let along = 0.03 * (10.0 * (t - 1.5).clamp(0.0, 1.5)).sin();
        let places = (0u32..4).map(|k| {
            let (x, y) = (f64::from(k / 2), f64::from(k % 2));
            Some(Pose {
                position: DVec3::new(0.08 * x - 0.07 + along, 0.06 * y - 0.03 + along, height),
                orientation: lying,
            })
        });
        let record = world.step_poses(&places.collect::<Vec<_>>()).record;
        busiest = busiest.max(f64::from(record.spent_ns) / f64::from(record.allowed_ns));
        assert!(
            record.query_work <= budget,
            "tick {tick}: {} units of {budget}",
            record.query_work
        );
        if tick == 3500 {
            before = world.outputs().wrenches.clone();
        }
    }
    println!("{busiest} of the time of a tick at the most");
    assert!(busiest <= 1.0 && busiest > 0.9, "{busiest}");
    let outputs = world.outputs();
    for (k, (now, before)) in outputs.wrenches.iter().zip(&before).enumerate() {
        assert!(outputs.record.probes[k].contact, "tool {k}");
        let differs = now.force.distance(before.force) / before.force.length();
        println!("tool {k}: {} N, then {} N", before.force, now.force);
        assert!(differs < 0.01, "tool {k} has come to rest: {differs}");
    }
}
