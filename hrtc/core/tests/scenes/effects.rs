//! Effects on a probe of a scene: each follows its formula, for a ball and a tool, from object to
//! object, without an allocation.

use crate::common::{World, scene_plan, scene_world, spm};
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};
use realtime::counting_allocator::count;
use scene::{NoFiles, Overrides, ProbeShape, ScenePlan, parse};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, SoupMesh};
use std::path::Path;
use std::sync::LazyLock;

/// Of a surface of which the scene does not say it, N/m.
const STIFFNESS: f64 = 800.0;
const RADIUS: f64 = 1e-3;
const SIZE: f64 = 0.2;

static PLATE: LazyLock<Vec<u8>> =
    LazyLock::new(|| spm(generate(Shape::Plate, 5000, 1), &BuildOptions::default()));

/// Adds the effects of a list, as a scene types it.
pub fn add_effects(plan: &mut ScenePlan, effects: &str) {
    let text = format!(
        "effects = [{effects}]\n[[object]]\ngenerate = {{ shape = \"plate\", faces = 1000 }}\nsize_m = 0.2\n[[probe]]\n"
    );
    let listed = parse(
        &text,
        "test",
        Path::new(""),
        &Overrides::default(),
        &NoFiles,
    )
    .expect("good effects");
    for object in &mut plan.objects {
        object.effects = listed.objects[0].effects.clone();
    }
    plan.effects = listed.effects;
    // No limit, since a limited force would hide the formula.
    plan.safety.ramp_s = 0.0;
    plan.safety.slew_n_per_s = 1e6;
    plan.safety.passivity = false;
    for object in &mut plan.objects {
        object.surface.damping_ns_per_m = 0.0;
    }
}

/// A plate seen from above whose top is at this height, and a probe.
fn plate(effects: &str, shape: Option<ProbeShape>) -> World {
    let mut plan = scene_plan(&[("plate", SIZE, DVec3::ZERO)], 1, 16 << 20);
    add_effects(&mut plan, effects);
    if let Some(shape) = shape {
        plan.probes[0].shape = shape;
    }
    let mut world = scene_world(&plan, &[("plate", &PLATE)], 0.0);
    for _ in 0..1000 {
        step(&mut world, DVec3::Z * 0.05);
    }
    world
}

fn step(world: &mut World, place: DVec3) -> Wrench {
    pose(world, Pose::at(place))
}

fn pose(world: &mut World, pose: Pose) -> Wrench {
    world.step_poses(&[Some(pose)]);
    world.outputs().wrenches[0]
}

/// Height of the plate's upper side.
fn top() -> f64 {
    let mut world = plate("", None);
    let force = step(&mut world, DVec3::Z * 0.05).force;
    assert_eq!(force, DVec3::ZERO);
    let mut height = 0.05;
    while step(&mut world, DVec3::Z * height).force.z == 0.0 {
        height -= 1e-4;
        assert!(height > -0.05, "the plate is missed");
    }
    // Depth from the force.
    let force = step(&mut world, DVec3::Z * height).force.z;
    height + force / STIFFNESS - RADIUS
}

#[test]
fn friction_holds_to_its_static_coefficient_and_slides_at_its_dynamic_one() {
    let top = top();
    let upright = ProbeShape::Capsule {
        radius_m: RADIUS,
        length_m: 0.02,
        faces: 960,
    };
    for shape in [None, Some(upright)] {
        let is_tool = shape.is_some();
        let mut world = plate("{ friction = { static = 0.4, dynamic = 0.3 } }", shape);
        let at = |x: f64, y: f64| DVec3::new(x, y, top + RADIUS - 1e-3);
        for k in 0..100 {
            let share = f64::from(k) / 100.0;
            step(&mut world, (DVec3::Z * 0.05).lerp(at(0.0, 0.0), share));
        }
        let (mut most, mut slides) = (0.0f64, 0.0);
        for k in 0..1000 {
            let wrench = step(&mut world, at(2e-6 * f64::from(k), 0.0));
            let Wrench { force, torque } = wrench;
            let ratio = -force.x / force.z;
            most = most.max(ratio);
            slides = ratio;
            if is_tool {
                // It acts where the tool touches, a radius below the device.
                let due = DVec3::new(0.0, 0.0, -RADIUS).cross(force);
                assert!(
                    torque.distance(due) < 0.1 * RADIUS * force.length(),
                    "{torque} {due}"
                );
            }
        }
        // A step moves the ratio by 0.002.
        assert!((most - 0.4).abs() < 0.004, "{most}");
        assert!((slides - 0.3).abs() < 0.004, "{slides}");
        // Turned back it holds the other way, and off the surface it is gone.
        for k in 0..1000 {
            step(&mut world, at(2e-3 - 2e-6 * f64::from(k), 0.0));
        }
        let force = step(&mut world, at(0.0, 0.0)).force;
        assert!((force.x / force.z - 0.3).abs() < 0.004, "{force}");
        let mut off = force;
        for k in 0..100 {
            let share = f64::from(k) / 100.0;
            off = step(&mut world, at(0.0, 0.0).lerp(DVec3::Z * 0.05, share)).force;
        }
        assert_eq!(off, DVec3::ZERO);
    }
}

#[test]
fn a_texture_is_felt_as_its_height_and_its_slope() {
    let top = top();
    let (amplitude, wave) = (5e-5, 4e-3);
    let mut world = plate(
        "{ texture = { amplitude_m = 5e-5, grating = { wavelength_m = 4e-3, direction = [1, 0, 0] } } }",
        None,
    );
    let depth = 1e-3;
    step(&mut world, DVec3::new(0.0, 0.0, top + 2.0 * RADIUS));
    for k in 0..1000 {
        let x = 1e-5 * f64::from(k);
        let force = step(&mut world, DVec3::new(x, 0.0, top + RADIUS - depth)).force;
        let turn = std::f64::consts::TAU * x / wave;
        let pressed = STIFFNESS * (depth + amplitude * (turn.sin() - 1.0));
        let due = DVec3::new(
            -std::f64::consts::TAU * amplitude / wave * turn.cos(),
            0.0,
            1.0,
        ) * pressed;
        // Depth is as exact as the plate's height is known.
        assert!(force.distance(due) < 1e-6, "{x}: {force} {due}");
    }
}

/// A valley whose slopes meet at an angle of `turn` radians.
pub fn valley(turn: f64) -> Vec<u8> {
    let (sine, cosine) = (0.5 * turn).sin_cos();
    let mut mesh = SoupMesh::default();
    let cells = 16;
    for i in 0..=2 * cells {
        for j in 0..=cells {
            let x = f64::from(i - cells) / f64::from(cells);
            let y = f64::from(2 * j - cells) / f64::from(cells);
            mesh.positions.push([x * cosine, y, x.abs() * sine]);
        }
    }
    let row = cells as u32 + 1;
    for i in 0..2 * cells as u32 {
        for j in 0..cells as u32 {
            let [a, b] = [i * row + j, (i + 1) * row + j];
            mesh.triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
        }
    }
    spm(mesh, &BuildOptions::default())
}

#[test]
fn shading_turns_the_force_over_a_blunt_edge_and_leaves_a_sharp_one() {
    // A valley, where a ball goes from one face's normal to the other's in a step.
    for (turn_deg, smooth) in [(30.0f64, true), (60.0, false)] {
        let (sine, cosine) = (0.5 * turn_deg.to_radians()).sin_cos();
        let bytes = valley(turn_deg.to_radians());
        let turns = |effects: &str| {
            let mut plan = scene_plan(&[("valley", SIZE, DVec3::ZERO)], 1, 16 << 20);
            add_effects(&mut plan, effects);
            let mut world = scene_world(&plan, &[("valley", &bytes)], 0.0);
            for _ in 0..1000 {
                step(&mut world, DVec3::Z * 0.05);
            }
            let at = |x: f64| DVec3::new(x, 0.0, x.abs() * sine / cosine + RADIUS / cosine - 2e-4);
            step(&mut world, DVec3::new(-0.01, 0.0, 0.01));
            let mut last = step(&mut world, at(-0.01)).force;
            let mut most = 0.0f64;
            for k in 0..400 {
                let force = step(&mut world, at(-0.01 + 5e-5 * f64::from(k))).force;
                most = most.max(force.angle_between(last).to_degrees());
                last = force;
            }
            most
        };
        let plain = turns("");
        let shaded = turns("{ shading = { radius_m = 0.005, max_turn_deg = 45 } }");
        assert!(plain > 0.1 * turn_deg, "{plain}");
        if smooth {
            assert!(shaded < 0.25 * plain, "{shaded} of {plain}");
        } else {
            assert!((shaded - plain).abs() < 0.05 * plain, "{shaded} of {plain}");
        }
    }
}

/// Angle of the force on a capsule to the normal of a smooth sphere, radians, at places all over a
/// sphere of facets: the mean and the largest.
fn angle_on_facets(effects: &str) -> [f64; 2] {
    let mut plan = scene_plan(&[("sphere", SIZE, DVec3::ZERO)], 1, 16 << 20);
    add_effects(&mut plan, effects);
    plan.probes[0].shape = ProbeShape::Capsule {
        radius_m: RADIUS,
        length_m: 0.02,
        faces: 960,
    };
    let facets = spm(generate(Shape::Sphere, 2000, 1), &BuildOptions::default());
    let mut world = scene_world(&plan, &[("sphere", &facets)], 0.0);
    let mut press = |up: DVec3, height: f64| {
        let upright = Pose {
            position: up * (0.5 * SIZE + height),
            orientation: DQuat::from_rotation_arc(DVec3::Z, up),
        };
        pose(&mut world, upright).force
    };
    let mut angles = Vec::new();
    for k in 0..80 {
        // A spiral from pole to pole, around the object from one place to the next.
        let at = |k: f64| {
            let (z, turn) = (1.0 - (k + 0.5) / 40.0, 2.399_963 * k);
            let around = (1.0 - z * z).sqrt();
            DVec3::new(around * turn.cos(), around * turn.sin(), z)
        };
        let up = at(f64::from(k));
        for step in 0..300 {
            let share = f64::from(step) / 300.0;
            press(at((f64::from(k) - 1.0 + share).max(0.0)), 0.02);
        }
        let pressed = (0..500).map(|tick| press(up, 2e-3 - 8e-6 * f64::from(tick)));
        let force = pressed.last().unwrap_or_default();
        assert!(force.length() > 0.2, "{up}: {force}");
        angles.push(force.angle_between(up));
    }
    let mean = angles.iter().sum::<f64>() / angles.len() as f64;
    [mean, angles.into_iter().fold(0.0, f64::max)]
}

#[test]
fn shading_turns_the_force_on_a_tool_towards_the_smooth_normal() {
    let [plain, plain_most] = angle_on_facets("");
    let [shaded, shaded_most] = angle_on_facets("{ shading = { radius_m = 0.01 } }");
    println!("mean {plain} to {shaded} rad, at most {plain_most} to {shaded_most} rad");
    assert!(shaded < 0.3 * plain, "{shaded} of {plain}");
    assert!(
        shaded_most < 0.3 * plain_most,
        "{shaded_most} of {plain_most}"
    );
}

/// A tool that lies on two slopes is pushed by both: its force is neither's, and is the same in
/// every tick, whichever of the two is nearer by a rounding error.
#[test]
fn shading_leaves_the_force_on_a_tool_between_two_slopes() {
    let slope = 30f64.to_radians();
    let bytes = valley(2.0 * slope);
    let mut plan = scene_plan(&[("valley", SIZE, DVec3::ZERO)], 1, 16 << 20);
    add_effects(
        &mut plan,
        "{ shading = { radius_m = 0.002, max_turn_deg = 45 } }",
    );
    let radius_m = 0.01;
    plan.probes[0].shape = ProbeShape::Cylinder {
        radius_m,
        length_m: 0.03,
        faces: 960,
    };
    let mut world = scene_world(&plan, &[("valley", &bytes)], 0.0);
    // Along the valley, and swayed as a hand sways.
    let along = DQuat::from_rotation_arc(DVec3::Z, DVec3::Y);
    let lies_m = radius_m / slope.cos();
    let mut press = |tick: u32, height: f64| {
        let sway = DVec3::new((0.1 * f64::from(tick)).sin(), 0.0, 0.0) * 1e-6;
        let middle = DVec3::Y * 0.015;
        let position = DVec3::Z * height + sway - middle;
        let lying = Pose {
            position,
            orientation: along,
        };
        pose(&mut world, lying).force
    };
    for tick in 0..1000 {
        press(tick, lies_m + 2e-3 - 4e-6 * f64::from(tick));
    }
    for tick in 0..500 {
        let force = press(tick, lies_m - 2e-3);
        let off = force.angle_between(DVec3::Z).to_degrees();
        assert!(force.length() > 1.0 && off < 2.0, "{tick}: {force}, {off}");
    }
}

#[test]
fn a_vibration_of_a_surface_is_felt_while_it_is_touched_and_has_its_amplitude() {
    let top = top();
    let mut world = plate("", None);
    let pressed = DVec3::Z * (top + RADIUS - 1e-3);
    step(&mut world, DVec3::Z * (top + 2.0 * RADIUS));
    let still = step(&mut world, pressed).force;
    let mut plan = scene_plan(&[("plate", SIZE, DVec3::ZERO)], 1, 16 << 20);
    add_effects(&mut plan, "");
    let listed = "[[object]]\ngenerate = { shape = \"plate\", faces = 1000 }\nsize_m = 0.2\neffects = [{ vibration = { frequency_hz = 50, amplitude_n = 0.1, direction = [0, 1, 0] } }]\n[[probe]]\n";
    let listed = parse(
        listed,
        "test",
        Path::new(""),
        &Overrides::default(),
        &NoFiles,
    )
    .expect("it is good");
    plan.objects[0].effects = listed.objects[0].effects.clone();
    let mut world = scene_world(&plan, &[("plate", &PLATE)], 0.0);
    for _ in 0..1000 {
        assert_eq!(step(&mut world, DVec3::Z * 0.05).force, DVec3::ZERO);
    }
    step(&mut world, DVec3::Z * (top + 2.0 * RADIUS));
    let (mut sum, mut most) = (0.0, 0.0f64);
    for _ in 0..200 {
        let more = step(&mut world, pressed).force - still;
        assert!(more.x.abs() < 1e-9 && more.z.abs() < 1e-9, "{more}");
        sum += more.y;
        most = most.max(more.y);
    }
    assert!(
        (most - 0.1).abs() < 1e-9 && sum.abs() < 1e-9,
        "{most} {sum}"
    );
}

#[test]
fn a_magnet_pulls_from_its_reach_on_and_not_beyond() {
    let top = top();
    let mut world = plate("{ magnet = { force_n = 1.0, reach_m = 0.01 } }", None);
    for (gap, due) in [
        (0.02, 0.0),
        (0.01, 0.0),
        (0.0075, 0.75),
        (0.005, 1.0),
        (0.0025, 0.75),
    ] {
        let force = step(&mut world, DVec3::Z * (top + RADIUS + gap)).force;
        assert!(force.distance(DVec3::NEG_Z * due) < 1e-6, "{gap}: {force}");
    }
}

/// A plate with a magnet of a long reach, alone or with others a metre away each; the probe is far
/// above.
fn magnets(plates: usize) -> (World, f64) {
    let places: Vec<_> = (0..plates)
        .map(|k| ("plate", SIZE, DVec3::X * k as f64))
        .collect();
    let mut plan = scene_plan(&places, 1, 16 << 20);
    add_effects(&mut plan, "{ magnet = { force_n = 1.0, reach_m = 0.1 } }");
    let mut world = scene_world(&plan, &[("plate", &PLATE)], 0.0);
    for _ in 0..1000 {
        step(&mut world, DVec3::Z * 0.3);
    }
    (world, top() + RADIUS)
}

#[test]
fn a_magnet_pulls_as_far_beside_other_objects_as_alone() {
    let forces = [1, 2].map(|plates| {
        let (mut world, top) = magnets(plates);
        let mut force = DVec3::ZERO;
        for _ in 0..300 {
            force = step(&mut world, DVec3::Z * (top + 0.07)).force;
        }
        force
    });
    for force in forces {
        assert!(force.distance(DVec3::NEG_Z * 0.84) < 1e-6, "{forces:?}");
    }
}

/// A hand comes fast and leaves slowly.
#[test]
fn a_closed_path_in_the_reach_of_a_magnet_beside_another_object_puts_out_no_work() {
    let (mut world, top) = magnets(2);
    let mut height = 0.15;
    let mut last = step(&mut world, DVec3::Z * (top + height)).force.z;
    let (mut work, mut taken) = (0.0, 0.0);
    // Metres a tick.
    for (speed, to) in [(3e-4, 0.03), (-2e-5, 0.15)] {
        let ticks = ((height - to) / speed).round() as u32;
        for _ in 0..ticks {
            height -= speed;
            let force = step(&mut world, DVec3::Z * (top + height)).force.z;
            // A force between two ticks is their mean.
            work -= 0.5 * (last + force) * speed;
            last = force;
        }
        taken = f64::max(taken, work);
    }
    println!("{taken} J in, {work} J left");
    assert!(taken > 0.03, "{taken}");
    assert!(work.abs() < 1e-3 * taken, "{work} of {taken}");
}

#[test]
fn a_weight_hangs_in_its_centre_of_mass_and_a_boundary_pushes_back() {
    let mut world = plate(
        "{ gravity = { mass_kg = 0.1, centre_m = [0, 0, 0.03] } }, { boundary = { ball = { radius_m = 0.1 }, stiffness_n_per_m = 100 } }",
        None,
    );
    let weight = 0.980_665;
    let lying = Pose {
        position: DVec3::Z * 0.05,
        orientation: DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2),
    };
    let wrench = pose(&mut world, lying);
    assert!(wrench.force.distance(DVec3::NEG_Z * weight) < 1e-12);
    // Its centre of mass is 3 cm along x.
    assert!(
        wrench.torque.distance(DVec3::Y * 0.03 * weight) < 1e-12,
        "{}",
        wrench.torque
    );
    let outside = step(&mut world, DVec3::Z * 0.11).force;
    assert!(
        outside.distance(DVec3::NEG_Z * (weight + 1.0)) < 1e-9,
        "{outside}"
    );
}

#[test]
fn effects_go_with_their_object_and_nothing_is_allocated() {
    assert!(count(|| vec![0u8; 100]) > 0, "the allocator counts");
    // More objects than active ones: they are reassigned and come back.
    let places: Vec<(&str, f64, DVec3)> = (0..6)
        .map(|k| ("plate", 0.05, DVec3::X * 0.1 * f64::from(k)))
        .collect();
    let mut plan = scene_plan(&places, 1, 16 << 20);
    add_effects(
        &mut plan,
        "{ friction = { static = 0.5 } }, { shading = { radius_m = 1e-3 } }, { texture = { amplitude_m = 1e-5, noise = { wavelength_m = 1e-3 } } }, \
         { magnet = { force_n = 0.1, reach_m = 3e-3 } }, { vibration = { frequency_hz = 50, amplitude_n = 0.01 } }, { viscosity = { damping_ns_per_m = 0.1 } }, \
         { spring = { path_m = [[0, 0, 0], [0.2, 0, 0], [0.6, 0, 0]], stiffness_n_per_m = 1 } }, { gravity = { mass_kg = 0.01 } }, { inertia = { mass_kg = 0.01 } }, \
         { boundary = { ball = { radius_m = 1 } } }",
    );
    // Every other one has none.
    for object in plan.objects.iter_mut().skip(1).step_by(2) {
        object.effects = [].into();
    }
    plan.effects.clear();
    let mut world = scene_world(&plan, &[("plate", &PLATE)], 0.0);
    let place = |object: usize, height: f64| DVec3::new(0.1 * object as f64, 0.0, height);
    let mut friction = [0.0f64; 6];
    for object in [0, 1, 2, 3, 4, 5, 0, 1] {
        for k in 0..1500 {
            let height = 0.02 - 2.5e-5 * f64::from(k.min(1000));
            let aside = DVec3::Y * 2e-6 * f64::from((k - 1000).max(0));
            let force = step(&mut world, place(object, height.max(-2e-4)) + aside).force;
            if k > 1000 {
                friction[object] = friction[object].max(force.y.abs() / force.z.abs().max(1e-9));
            }
        }
        for k in 0..200 {
            step(&mut world, place(object, 1e-4 * f64::from(k)));
        }
    }
    assert_eq!(world.client().allocations(), 0);
    for (object, ratio) in friction.iter().enumerate() {
        if object % 2 == 0 {
            assert!(*ratio > 0.3, "{friction:?}");
        } else {
            assert!(*ratio < 1e-6, "{friction:?}");
        }
    }
}
