//! Effects on a tool act at each of its contacts, with the contact's own force: between two walls,
//! flat on a plate, and over an edge.

use crate::common::{World, scene_plan, scene_world, spm};
use crate::effects::{add_effects, valley};
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};
use scene::{ProbeShape, ToolMeshPlan};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, SoupMesh};
use std::f64::consts::TAU;

/// Of a surface of which the scene does not say it, N/m.
const STIFFNESS: f64 = 800.0;
const SIZE: f64 = 0.2;
const PERIOD_S: f64 = 1e-3;
/// Share of a force that moves from one contact to another in a tick at the most.
const SHARE_A_TICK: f64 = 0.07;

/// A model under a tool, at rest above it.
fn world(model: &[u8], effects: &str, shape: ProbeShape) -> World {
    let mut plan = scene_plan(&[("model", SIZE, DVec3::ZERO)], 1, 16 << 20);
    add_effects(&mut plan, effects);
    plan.probes[0].shape = shape;
    let mut world = scene_world(&plan, &[("model", model)], 0.0);
    for _ in 0..1000 {
        step(&mut world, Pose::at(DVec3::Z * 0.05));
    }
    world
}

fn step(world: &mut World, pose: Pose) -> Wrench {
    world.step_poses(&[Some(pose)]);
    world.outputs().wrenches[0]
}

/// A box about the device's position, which is in the middle of its underside.
fn block(half: DVec3) -> ProbeShape {
    let mesh = crate::common::fronts::box_mesh(half);
    ProbeShape::Mesh(ToolMeshPlan {
        file: "block".to_string(),
        positions: mesh
            .positions
            .iter()
            .map(|&p| p + DVec3::Z * half.z)
            .collect(),
        triangles: mesh.triangles,
    })
}

fn lying_along_y(position: DVec3) -> Pose {
    Pose {
        position,
        orientation: DQuat::from_rotation_arc(DVec3::Z, DVec3::Y),
    }
}

/// In a groove of 15 degrees each wall pushes with F / (2 sin 7.5°), against the other: the walls
/// hold the tool as if it lay on a plate with 7.7 times the force.
#[test]
fn friction_in_a_groove_is_that_of_both_walls() {
    let half = 7.5f64.to_radians();
    let model = valley(std::f64::consts::PI - 2.0 * half);
    let (radius_m, length_m) = (3e-3, 0.03);
    let capsule = ProbeShape::Capsule {
        radius_m,
        length_m,
        faces: 960,
    };
    let friction = "{ friction = { static = 0.3, dynamic = 0.3 } }";
    let mut worlds = ["", friction].map(|effects| world(&model, effects, capsule.clone()));
    let mut go = |from: DVec3, to: DVec3, ticks: u32| {
        let mut last = [Wrench::ZERO; 2];
        for k in 1..=ticks {
            let place = from.lerp(to, f64::from(k) / f64::from(ticks));
            let steps = worlds
                .iter_mut()
                .map(|world| step(world, lying_along_y(place)));
            for (last, wrench) in last.iter_mut().zip(steps) {
                *last = wrench;
            }
        }
        last
    };
    let mut height = 0.12;
    go(DVec3::Z * 0.05, DVec3::Z * height, 500);
    while go(DVec3::Z * height, DVec3::Z * (height - 1e-4), 1)[0]
        .force
        .z
        == 0.0
    {
        height -= 1e-4;
        assert!(height > -0.12, "the groove is missed");
    }
    let pressed = DVec3::Z * (height - 5e-4);
    go(DVec3::Z * height, pressed, 100);
    let mut forces = Vec::new();
    let mut at = pressed;
    for _ in 0..20 {
        let to = at + DVec3::Y * 4e-4;
        forces.push(go(at, to, 8));
        at = to;
    }
    for [plain, held] in forces.split_off(12) {
        let push = plain.force;
        assert!(push.z > 0.2 && push.y.abs() < 1e-3 * push.z, "{push}");
        let due = 0.3 * push.z / half.sin();
        let found = -(held.force - push).y;
        assert!(
            (found / due - 1.0).abs() < 0.05,
            "{found} N, due are {due} N"
        );
    }
}

/// Pose of a hand that slides a block over a plate, a little tilted, turned and lifted all the time
/// as a hand does, so that other corners of it push in every few ticks.
fn slid(tick: u32, height: f64) -> Pose {
    let t = f64::from(tick) * PERIOD_S;
    let tremor = |hz: f64, phase: f64| (TAU * hz * t + phase).sin();
    let tilt = DVec3::new(tremor(97.0, 0.0), tremor(83.0, 1.0), 0.1 * tremor(3.0, 2.0)) * 2e-4;
    Pose {
        position: DVec3::new(0.03 * t - 0.01, 0.002 * tremor(2.0, 0.0), height),
        orientation: DQuat::from_scaled_axis(tilt),
    }
}

/// What effects add to the wrench on a block that slides flat over a plate: the most that it
/// changes in a tick, N and Nm, and the largest force, N.
fn change_on_a_plate(effects: &str) -> [f64; 3] {
    let plate = spm(generate(Shape::Plate, 5000, 1), &BuildOptions::default());
    let shape = block(DVec3::new(5e-3, 3e-3, 2e-3));
    let mut worlds = ["", effects].map(|effects| world(&plate, effects, shape.clone()));
    let mut added = |pose: Pose| {
        let [plain, with] = worlds.each_mut().map(|world| step(world, pose));
        let added = Wrench {
            force: with.force - plain.force,
            torque: with.torque - plain.torque,
        };
        (plain.force.z, added)
    };
    let mut height = 0.05;
    while added(slid(0, height)).0 == 0.0 {
        height -= 1e-4;
        assert!(height > -0.05, "the plate is missed");
    }
    for _ in 0..8 {
        height -= 1e-4;
        added(slid(0, height));
    }
    let (_, mut last) = added(slid(0, height));
    let [mut force, mut torque, mut most] = [0.0f64; 3];
    for tick in 1..600 {
        let (_, now) = added(slid(tick, height));
        force = force.max((now.force - last.force).length());
        torque = torque.max((now.torque - last.torque).length());
        most = most.max(now.force.length());
        last = now;
    }
    [force, torque, most]
}

/// Distance of a corner of that block from its device, and the most that it moves in a tick.
const CORNER_M: f64 = 5.9e-3;
const MOVES_M: f64 = 6e-5;

#[test]
fn friction_of_a_block_flat_on_a_plate_has_no_steps() {
    let [force, torque, most] = change_on_a_plate("{ friction = { static = 0.4, dynamic = 0.3 } }");
    // The spring along the surface, and the normal force, which changes with the tremor's height.
    let due = STIFFNESS * MOVES_M * (1.0 + 0.4);
    println!("{force} N, {torque} Nm a tick, {most} N");
    assert!(most > 0.1, "{most}");
    assert!(force < due, "{force} N of {due}");
    let due = CORNER_M * (due + SHARE_A_TICK * most);
    assert!(torque < due, "{torque} Nm of {due}");
}

#[test]
fn a_grating_under_a_block_flat_on_a_plate_has_no_steps() {
    let (amplitude, wave) = (2e-5, 4e-3);
    let [force, torque, most] = change_on_a_plate(
        "{ texture = { amplitude_m = 2e-5, grating = { wavelength_m = 4e-3, direction = [1, 0, 0] } } }",
    );
    let slope = TAU * amplitude / wave;
    let pressed = 1.0;
    println!("{force} N, {torque} Nm a tick, {most} N");
    assert!(most > 0.01, "{most}");
    // Height and slope under a corner that moves, and a share of the forces that moves from one
    // corner to another, where height and slope are others.
    let moves = STIFFNESS * slope * MOVES_M + pressed * slope * TAU / wave * MOVES_M;
    let shared = SHARE_A_TICK * 2.0 * (STIFFNESS * amplitude + pressed * slope);
    let due = moves + shared + slope * STIFFNESS * MOVES_M;
    assert!(force < due, "{force} N of {due}");
    assert!(torque < CORNER_M * due, "{torque} Nm of {}", CORNER_M * due);
}

/// A plate with a roof along y over its right part.
fn plate_with_a_roof(slope: f64) -> Vec<u8> {
    let mut mesh = SoupMesh::default();
    let cells = 20;
    for i in 0..=cells {
        for j in 0..=cells {
            let [x, y] = [i, j].map(|k| 2.0 * f64::from(k) / f64::from(cells) - 1.0);
            let z = (0.3 - (x - 0.5).abs()).max(0.0) * slope.tan();
            mesh.positions.push([x, y, z]);
        }
    }
    let row = cells as u32 + 1;
    for i in 0..cells as u32 {
        for j in 0..cells as u32 {
            let [a, b] = [i * row + j, (i + 1) * row + j];
            mesh.triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
        }
    }
    spm(mesh, &BuildOptions::default())
}

/// A beam lies with one end on a plate and on the ridge of a blunt roof. Shading turns the force at
/// the ridge to the roof's middle, and leaves the force at the end as it is.
#[test]
fn shading_at_one_contact_leaves_the_force_at_the_other() {
    let slope = 15f64.to_radians();
    let model = plate_with_a_roof(slope);
    // 0.1 m a unit; the roof is 0.03 m wide on each side, the beam reaches beyond it.
    let unit = 0.5 * SIZE;
    let height = 0.3 * unit * slope.tan();
    let half = DVec3::new(0.045, 2e-3, 2e-3);
    let ridge = 0.5 * unit;
    let end = -0.03;
    // Its underside goes from the plate at its end to the ridge.
    let tilt = height.atan2(ridge - end);
    let orientation = DQuat::from_rotation_y(-tilt);
    let on = DVec3::X * end + orientation * (DVec3::X * half.x);
    let shaded = "{ shading = { radius_m = 0.004, max_turn_deg = 60 } }";
    let mut worlds = ["", shaded].map(|effects| world(&model, effects, block(half)));
    let mut press = |above: f64| {
        let position = on + DVec3::Z * above;
        worlds.each_mut().map(|world| {
            let pose = Pose {
                position,
                orientation,
            };
            (step(world, pose), pose)
        })
    };
    let mut last = press(0.02);
    for tick in 0..3000 {
        last = press(0.02 - 2.1e-2 * (f64::from(tick) / 2000.0).min(1.0));
    }
    let [(plain, _), (turned, pose)] = last;
    let normal = orientation * DVec3::Z;
    // The plate pushes up at the end, the ridge along the beam's normal: what is sideways is its.
    let at_ridge = plain.force.x / normal.x;
    let at_end = plain.force.z - at_ridge * normal.z;
    println!("{plain:?} {turned:?}: {at_ridge} N, {at_end} N");
    assert!(at_ridge > 0.1 && at_end > 0.1, "{at_ridge} N, {at_end} N");
    let change = turned.force - plain.force;
    let due = (DVec3::Z - normal) * at_ridge;
    assert!(change.distance(due) < 0.15 * due.length(), "{change} {due}");
    // The device is pressed in by 1 mm; the contacts are 9 mm apart in height.
    let arm = DVec3::new(ridge, 0.0, height) - pose.position;
    let off = turned.torque - plain.torque - arm.cross(change);
    assert!(off.y.abs() < 1.5e-3 * change.length(), "{off}, {change}");
}

/// A tilted block comes down to a plate corner first, its position a reach and more above: the
/// plate pulls that corner from its reach on, and no more where it touches.
#[test]
fn a_magnet_pulls_a_tool_where_it_is_nearest() {
    const DOWN: f64 = 2e-5;
    let (force_n, reach_m) = (1.0, 5e-3);
    let plate = spm(generate(Shape::Plate, 5000, 1), &BuildOptions::default());
    let half = DVec3::new(0.02, 5e-3, 5e-3);
    let magnet = format!("{{ magnet = {{ force_n = {force_n}, reach_m = {reach_m} }} }}");
    let mut world = world(&plate, &magnet, block(half));
    let tilt = 20.0f64.to_radians();
    let lever = half.x * tilt.cos();
    assert!(half.x * tilt.sin() > reach_m);
    let mut pulls: Vec<Wrench> = Vec::new();
    for k in 0.. {
        let pose = Pose {
            position: DVec3::Z * (0.05 - DOWN * f64::from(k)),
            orientation: DQuat::from_rotation_y(tilt),
        };
        let wrench = step(&mut world, pose);
        if wrench.force.z > 0.0 {
            break;
        }
        assert!(k < 5000, "it never touches");
        pulls.push(wrench);
    }
    let before = pulls.iter().take_while(|of| of.force.z == 0.0).count();
    let near = (pulls.len() - before) as f64 * DOWN;
    assert!((near / reach_m - 1.0).abs() < 0.05, "from {near} m on");
    let most = pulls.iter().map(|of| -of.force.z).fold(0.0, f64::max);
    assert!((most / force_n - 1.0).abs() < 0.01, "{most} N");
    // The slope of the pull.
    let change = 4.0 * force_n * DOWN / reach_m;
    for pair in pulls.windows(2) {
        let changed = (pair[1].force - pair[0].force).length();
        assert!(changed < 1.1 * change, "{changed} N, {pair:?}");
    }
    let last = pulls.last().expect("it pulled");
    assert!(
        last.force.length() < 3.0 * change,
        "{last:?} where it touches"
    );
    for of in pulls.iter().filter(|of| of.force.z < -0.5 * force_n) {
        let arm = of.torque.y / of.force.z.abs();
        assert!((arm.abs() / lever - 1.0).abs() < 0.2, "{arm} of {lever} m");
        assert!(of.torque.y > 0.0, "the pull turns it on: {of:?}");
    }
}
