//! A tool in contact obeys mechanics: analytic forces and torques, rest without creep, at every
//! scale.

use crate::common::fronts::{Front, box_mesh, plate_mesh, scaled};
use crate::common::guided_tool::TICK_BUDGET;
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec2, DVec3};
use hrtc_core::contact::coupling::Coupling;
use hrtc_core::contact::motion::Twist;
use hrtc_core::contact::query::{Deadline, Ending, Limit};
use hrtc_core::contact::rigid_proxy::{
    Imperceptible, MAX_SURFACE_FACES, StepSettings, ToolAdvance, ToolProxy,
};
use hrtc_core::contact::tool::{Tool, ToolMesh, capsule_mesh, cylinder_mesh};
use simulator::Random;
use spm::OperationFaces;
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, build_model};
use std::f64::consts::{FRAC_PI_2, PI};

const STIFFNESS: f64 = 800.0;
const SPRING: Coupling = Coupling {
    stiffness_n_per_m: STIFFNESS,
    damping_ns_per_m: 0.0,
};

fn proxy(mesh: &ToolMesh) -> ToolProxy {
    ToolProxy::new(Tool::new(mesh).expect("it is a tool"), 1.0).expect("it has an extent")
}

/// One tick; nothing may be left out.
fn tick(proxy: &mut ToolProxy, front: &Front, pose: &Pose) -> ToolAdvance {
    let answer = proxy.advance(front.surface(), pose, TICK_BUDGET);
    assert_eq!(answer.ending, Ending::Complete);
    answer
}

fn wrench(proxy: &ToolProxy) -> Wrench {
    proxy.wrench(&SPRING, 1.0, &Twist::default())
}

/// Moves from one pose to another in so many ticks, and stays there as long.
fn move_to(
    proxy: &mut ToolProxy,
    front: &Front,
    from: &Pose,
    to: &Pose,
    ticks: u32,
) -> ToolAdvance {
    let mut last = None;
    for k in 1..=2 * ticks {
        let share = (f64::from(k) / f64::from(ticks)).min(1.0);
        let pose = Pose {
            position: from.position.lerp(to.position, share),
            orientation: from.orientation.slerp(to.orientation, share),
        };
        last = Some(tick(proxy, front, &pose));
    }
    last.expect("there are ticks")
}

fn lowest(mesh: &ToolMesh, turn: DQuat) -> f64 {
    let heights = mesh.positions.iter().map(|&p| (turn * p).z);
    heights.fold(f64::INFINITY, f64::min)
}

/// Flat on a plate: force = stiffness x depth, no torque, whatever the mesh of either.
#[test]
fn pressed_flat_the_force_is_the_depth_and_there_is_no_torque() {
    for pieces in [1, 3, 24] {
        let plate = Front::of_mesh(&plate_mesh(4.0, pieces));
        for (name, mesh, turn) in [
            ("box", box_mesh(DVec3::new(0.5, 0.3, 0.2)), DQuat::IDENTITY),
            (
                "cylinder upright",
                cylinder_mesh(0.3, 1.0, 240),
                DQuat::IDENTITY,
            ),
            (
                "cylinder lying",
                cylinder_mesh(0.3, 1.0, 240),
                DQuat::from_rotation_y(FRAC_PI_2),
            ),
            (
                "capsule lying",
                capsule_mesh(0.3, 1.5, 24, 20),
                DQuat::from_rotation_y(FRAC_PI_2),
            ),
        ] {
            let mut proxy = proxy(&mesh);
            let low = lowest(&mesh, turn);
            let at = |depth: f64| Pose {
                position: DVec3::new(0.11, 0.07, -low - depth),
                orientation: turn,
            };
            let start = at(-0.5);
            tick(&mut proxy, &plate, &start);
            let depth = 0.05;
            let answer = move_to(&mut proxy, &plate, &start, &at(depth), 50);
            let measured = wrench(&proxy);
            let expected = DVec3::Z * STIFFNESS * (depth + proxy.contact_offset());
            let label = format!(
                "{name} {pieces}: {measured:?} {} contacts",
                answer.contacts().len()
            );
            assert!(
                measured.force.distance(expected) < 1e-6 * expected.length(),
                "{label}"
            );
            assert!(
                measured.torque.length() < 1e-6 * expected.length(),
                "{label}"
            );
            assert!(!answer.contacts().is_empty(), "{label}");
        }
    }
}

/// Faces of a front under a round foot.
fn faces_under(front: &Front, centre: DVec2, radius: f64) -> usize {
    let is_under = |corner: &DVec3| corner.truncate().distance(centre) < radius;
    let mut under = 0;
    front.mesh.for_each_active_face(|face| {
        under += usize::from(front.mesh.corners(face).iter().all(is_under));
    });
    under
}

/// A foot over many faces, and over more than there is room for, is held, and lets go where it is
/// lifted.
#[test]
fn pressed_flat_on_more_faces_than_there_is_room_for_it_is_held() {
    const RADIUS: f64 = 0.3;
    for (half, pieces, has_room) in [(4.0, 300, true), (0.75, 112, false)] {
        let plate = Front::of_mesh(&plate_mesh(half, pieces));
        let mesh = cylinder_mesh(RADIUS, 1.0, 240);
        let mut proxy = proxy(&mesh);
        let low = lowest(&mesh, DQuat::IDENTITY);
        let mut stuck = 0;
        for [x, y] in [[0.11, 0.07], [-0.3, 0.2]] {
            let under = faces_under(&plate, DVec2::new(x, y), 0.95 * RADIUS);
            assert!(has_room == (under < MAX_SURFACE_FACES), "{under} faces");
            // Such a foot takes all the work of a tick, and more.
            let mut to = |depth: f64| {
                let pose = Pose {
                    position: DVec3::new(x, y, -low - depth),
                    orientation: DQuat::IDENTITY,
                };
                let answer = proxy.advance(plate.surface(), &pose, TICK_BUDGET);
                stuck += u32::from(answer.is_stuck);
                wrench(&proxy).force
            };
            for k in 0..2000 {
                to(0.55 * f64::from(k) / 2000.0 - 0.5);
            }
            for _ in 0..50 {
                let force = to(0.05);
                assert!(force.z > 0.9 * STIFFNESS * 0.05, "{pieces}: {force}");
                assert!(
                    force.truncate().length() < 0.1 * force.z,
                    "{pieces}: {force}"
                );
            }
            for k in (0..200).rev() {
                to(0.55 * f64::from(k) / 200.0 - 0.5);
            }
            for _ in 0..20 {
                to(-0.5);
            }
            assert_eq!(to(-0.5), DVec3::ZERO, "{pieces}: it is lifted");
        }
        assert_eq!(stuck > 0, !has_room, "{pieces}: it is told");
        let [(pairs, most), (faces, room), _] = proxy.high_water();
        let is_full = pairs == most || faces == room;
        assert!(
            is_full || has_room,
            "{pieces}: {pairs} pairs, {faces} faces"
        );
    }
}

/// A plate is refined under a foot, beyond what there is room for: the foot is held on, lets go
/// where it is lifted, and beyond the rim nothing of the plate is left.
#[test]
fn refined_beyond_the_room_under_a_foot_it_holds_and_lets_go() {
    const RADIUS: f64 = 0.6;
    const DEPTH: f64 = 0.05;
    const SPLITS: usize = 200;
    let plate = generate(Shape::Plate, 16_000, 1);
    let options = BuildOptions {
        base_faces: Some(100),
        regions: None,
    };
    let parts = build_model(plate, &options, &NoProgress).expect("the model is built");
    let mut front = Front::new(&parts, 0, &mut Random::new(1));
    let mesh = cylinder_mesh(RADIUS, 1.0, 240);
    let mut proxy = proxy(&mesh);
    let low = lowest(&mesh, DQuat::IDENTITY);
    let lead = |proxy: &mut ToolProxy, front: &Front, x: f64, depth: f64| {
        let pose = Pose::at(DVec3::new(x, 0.02, -low - depth));
        proxy.advance(front.surface(), &pose, TICK_BUDGET);
        wrench(proxy).force
    };
    for k in 0..=300 {
        lead(
            &mut proxy,
            &front,
            0.01,
            (0.002 * f64::from(k) - 0.55).min(DEPTH),
        );
    }
    let coarse = lead(&mut proxy, &front, 0.01, DEPTH);
    assert!(coarse.z > 0.9 * STIFFNESS * DEPTH, "{coarse}");
    let slots: Vec<u32> = (0..parts.header.vsps).collect();
    let mut out = OperationFaces::new();
    for some in slots.chunks(SPLITS) {
        let Front { mesh, tree, .. } = &mut front;
        for &slot in some {
            if mesh.split_is_legal(slot) {
                mesh.split(slot, &mut out)
                    .expect("the builder's records fit");
                for (&face, leaf) in out.made_or_removed().iter().zip(out.leaves) {
                    assert!(tree.insert(face, leaf));
                }
                out.deformed().iter().for_each(|&face| tree.deform(face));
                proxy.carry(mesh, &out);
            }
        }
        tree.refit(|face| mesh.face_box(face));
        lead(&mut proxy, &front, 0.01, DEPTH);
    }
    let under = faces_under(&front, DVec2::new(0.01, 0.02), 0.95 * RADIUS);
    assert!(under > MAX_SURFACE_FACES, "{under} faces");
    for _ in 0..200 {
        lead(&mut proxy, &front, 0.01, DEPTH);
    }
    let fine = lead(&mut proxy, &front, 0.01, DEPTH);
    assert!(fine.z > 0.9 * STIFFNESS * DEPTH, "{fine}");
    let way = [
        [0.01, DEPTH, 0.01, -0.5],
        [0.01, -0.5, 3.0, -0.5],
        [3.0, -0.5, 3.0, 1.0],
    ];
    for [from, above, to, below] in way {
        for k in 1..=200 {
            let share = f64::from(k) / 200.0;
            let [x, depth] = [from + share * (to - from), above + share * (below - above)];
            lead(&mut proxy, &front, x, depth);
        }
        for _ in 0..50 {
            lead(&mut proxy, &front, to, below);
        }
        let force = lead(&mut proxy, &front, to, below);
        assert_eq!(force, DVec3::ZERO, "at {to}, {below}");
    }
}

/// Contacts act at the quantization error of the device's position, within a range that goes by the
/// tool.
#[test]
fn contacts_act_at_the_quantization_error_of_the_device() {
    for size in [1e-3, 1.0, 1e3] {
        let plate = Front::of_mesh(&scaled(&plate_mesh(4.0, 3), size));
        let tool = scaled(&box_mesh(DVec3::splat(0.2)), size);
        let gyration = proxy(&tool).gyration();
        let [least, most] = StepSettings::PRODUCT.contact_offset.map(|of| of * gyration);
        for (quantization, expected) in [
            (0.0, least),
            (3.0 * least, 3.0 * least),
            (1e9 * least, most),
        ] {
            let mut proxy = proxy(&tool);
            proxy.set_imperceptible(Imperceptible {
                step: 0.0,
                quantization,
                period_s: 1e-3,
            });
            let offset = proxy.contact_offset();
            assert!(
                (offset - expected).abs() < 1e-12 * expected,
                "{offset} {expected}"
            );
            let at = |height: f64| Pose::at(DVec3::Z * (size * (0.2 + height)));
            tick(&mut proxy, &plate, &at(0.1));
            move_to(&mut proxy, &plate, &at(0.1), &at(-0.05), 20);
            let height = proxy.pose().position.z - 0.2 * size;
            assert!((height - offset).abs() < 1e-3 * offset, "{height} {offset}");
        }
    }
}

/// Tilted, the device is turned back towards lying flat, and is not pushed along the plate.
#[test]
fn a_tilted_cylinder_is_turned_towards_flat() {
    let plate = Front::of_mesh(&plate_mesh(4.0, 24));
    let mesh = cylinder_mesh(0.3, 1.0, 240);
    for tilt in [0.02, 0.1, -0.3] {
        let mut proxy = proxy(&mesh);
        let start = Pose::at(DVec3::Z);
        tick(&mut proxy, &plate, &start);
        let end = Pose {
            position: DVec3::Z * 0.4,
            orientation: DQuat::from_rotation_y(tilt),
        };
        move_to(&mut proxy, &plate, &start, &end, 200);
        let measured = wrench(&proxy);
        let size = measured.force.length();
        assert!(
            measured.force.z > 0.0 && measured.force.truncate().length() < 1e-4 * size,
            "{measured:?}"
        );
        assert!(measured.torque.y * tilt < 0.0, "{tilt} {measured:?}");
        let aside = DVec3::new(measured.torque.x, 0.0, measured.torque.z).length();
        assert!(aside < 1e-3 * measured.torque.length(), "{measured:?}");
    }
}

/// Open squares that meet: a groove of two planes, or a corner of three.
fn corner(planes: usize) -> Front {
    let mut mesh = ToolMesh::default();
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    for k in 0..planes {
        let (u, v) = (axes[(k + 1) % 3] * 2.0, axes[(k + 2) % 3] * 2.0);
        let first = mesh.positions.len() as u32;
        let low = if planes == 2 { -DVec3::Z } else { DVec3::ZERO };
        let at = |a: f64, b: f64| low + u * a + v * b;
        mesh.positions
            .extend([at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)]);
        mesh.triangles.push([first, first + 1, first + 2]);
        mesh.triangles.push([first, first + 2, first + 3]);
    }
    Front::of_mesh(&mesh)
}

/// A minute at 1 kHz in a groove and a corner: nothing creeps, and noise leaves nothing behind.
#[test]
fn a_tool_rests_in_grooves_and_corners() {
    let capsule = capsule_mesh(0.1, 0.4, 12, 10);
    for (planes, mesh, turn) in [
        (2, &capsule, DQuat::from_rotation_y(0.1)),
        (3, &capsule, DQuat::from_rotation_x(0.3)),
        (
            3,
            &box_mesh(DVec3::new(0.1, 0.2, 0.15)),
            DQuat::from_rotation_z(0.02),
        ),
    ] {
        let front = corner(planes);
        let mut proxy = proxy(mesh);
        let start = Pose {
            position: DVec3::splat(0.8),
            orientation: turn,
        };
        tick(&mut proxy, &front, &start);
        let end = Pose {
            position: DVec3::splat(0.05),
            orientation: turn,
        };
        move_to(&mut proxy, &front, &start, &end, 1000);
        let settled = proxy.pose();
        for _ in 0..60_000 {
            tick(&mut proxy, &front, &end);
        }
        let rested = proxy.pose();
        let limit = 1e-4 * proxy.contact_offset();
        let crept = rested.position.distance(settled.position);
        assert!(crept < limit, "{planes} planes: {crept:e}");
        let mut random = Random::new(5);
        for _ in 0..2000 {
            let noisy = Pose {
                position: end.position + random.vector() * 1e-4,
                ..end
            };
            tick(&mut proxy, &front, &noisy);
        }
        for _ in 0..200 {
            tick(&mut proxy, &front, &end);
        }
        let back = proxy.pose().position.distance(rested.position);
        assert!(back < limit, "{planes} planes: {back:e}");
    }
}

/// A path over a relief, from a seed: what each tick gives.
fn rub(scale: f64, seed: u64) -> Vec<(Pose, Wrench)> {
    let mut relief = plate_mesh(1.0, 16);
    let mut random = Random::new(seed);
    for p in &mut relief.positions {
        p.z = f64::from((0.1 * random.unit()) as f32);
    }
    let front = Front::of_mesh(&scaled(&relief, scale));
    let mut proxy = proxy(&scaled(&capsule_mesh(0.1, 0.5, 12, 10), scale));
    let turn = DQuat::from_rotation_y(1.3);
    (0..600)
        .map(|k| {
            let t = f64::from(k) / 600.0;
            let at = DVec3::new(
                t - 0.5,
                0.2 * (9.0 * t).sin(),
                0.5 - 0.5 * (3.0 * t).min(1.0),
            );
            let pose = Pose {
                position: at * scale,
                orientation: DQuat::from_rotation_z(2.0 * t) * turn,
            };
            let answer = proxy.advance(front.surface(), &pose, TICK_BUDGET);
            assert_eq!(answer.ending, Ending::Complete);
            (proxy.pose(), proxy.wrench(&SPRING, 1.0, &Twist::default()))
        })
        .collect()
}

#[test]
fn the_same_scene_at_another_scale_gives_the_same_forces() {
    let reference = rub(1.0, 3);
    assert!(
        reference
            .iter()
            .filter(|(_, w)| w.force.length() > 1.0)
            .count()
            > 300
    );
    assert_eq!(reference, rub(1.0, 3), "the same again");
    // Powers of two keep every f32 of the surface as it is.
    for exponent in [-13, -4, 4, 13] {
        let scale = 2f64.powi(exponent);
        for ((pose, wrench), (other, measured)) in reference.iter().zip(rub(scale, 3)) {
            assert!((other.position / scale).distance(pose.position) < 1e-9);
            assert!((measured.force / scale).distance(wrench.force) < 1e-9 * STIFFNESS);
            assert!((measured.torque / (scale * scale)).distance(wrench.torque) < 1e-9 * STIFFNESS);
        }
    }
}

#[test]
fn what_is_no_pose_is_counted_and_moves_nothing() {
    let plate = Front::of_mesh(&plate_mesh(1.0, 4));
    let mut proxy = proxy(&capsule_mesh(0.1, 0.5, 12, 10));
    let good = Pose::at(DVec3::Z);
    assert!(proxy.place(&good));
    tick(&mut proxy, &plate, &good);
    let none = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    let bad = [
        Pose::at(DVec3::splat(f64::NAN)),
        Pose::at(DVec3::X * f64::INFINITY),
        Pose {
            orientation: none,
            ..good
        },
        Pose {
            orientation: DQuat::from_xyzw(f64::NAN, 0.0, 0.0, 1.0),
            ..good
        },
    ];
    for (k, pose) in (1u64..).zip(&bad) {
        let answer = proxy.advance(plate.surface(), pose, TICK_BUDGET);
        assert!(answer.rejected && proxy.rejected() == k);
        assert_eq!(proxy.pose(), good);
        assert!(wrench(&proxy).is_finite());
    }
    assert!(!proxy.place(&bad[0]));
}

/// With any budget the answer says whether it was enough, all its work stays within it, and the
/// tool stays on its side.
#[test]
fn a_budget_is_kept_and_its_end_is_told() {
    let plate = Front::of_mesh(&plate_mesh(1.0, 64));
    let mesh = capsule_mesh(0.1, 0.5, 24, 20);
    let mut unfinished = 0;
    for budget in [0, 1, 10, 100, 1000, 10_000] {
        let mut proxy = proxy(&mesh);
        tick(&mut proxy, &plate, &Pose::at(DVec3::Z));
        for k in 0..300 {
            let pose = Pose::at(DVec3::new(
                0.001 * f64::from(k),
                0.0,
                1.0 - 0.004 * f64::from(k),
            ));
            let answer = proxy.advance(plate.surface(), &pose, budget);
            assert!(answer.work.node_pairs <= budget && answer.spent <= budget);
            unfinished += usize::from(answer.ending != Ending::Complete);
            let at = proxy.pose();
            let low = mesh
                .positions
                .iter()
                .map(|&p| at.transform_point(p).z)
                .fold(f64::INFINITY, f64::min);
            assert!(low > 0.0, "{budget} {low}");
        }
    }
    assert!(unfinished > 300, "{unfinished}");
}

/// The time of each tick is over before it begins.
struct Over;

impl Deadline for Over {
    fn is_over(&mut self) -> bool {
        true
    }
}

/// What starts across a plate and is led out looks around in each tick: where the time of all ticks
/// is over before they begin, no more is done than in any case, and the tool gets clear all the
/// same, and is held when it is led back.
#[test]
fn a_late_tick_does_not_look_around_for_longer_than_any_tick() {
    const FLOOR: u32 = 600;
    const INTERVAL: u32 = 160;
    const MOST: u32 = 2 * (FLOOR + INTERVAL);
    let plate = Front::of_mesh(&plate_mesh(0.5, 64));
    let mesh = capsule_mesh(0.1, 0.5, 24, 20);
    let [in_time, late] = [false, true].map(|is_late| {
        let mut proxy = proxy(&mesh);
        let mut most = 0;
        for k in 0..1600 {
            let height = 0.2 * (f64::from(k) * PI / 1600.0).sin();
            let pose = Pose {
                position: DVec3::new(0.01, 0.02, height),
                orientation: DQuat::from_rotation_y(FRAC_PI_2),
            };
            let mut over = Over;
            let limit = if is_late {
                Limit::new(TICK_BUDGET, [FLOOR, INTERVAL], &mut over)
            } else {
                TICK_BUDGET.into()
            };
            let answer = proxy.advance(plate.surface(), &pose, limit);
            // Until it is clear; then it takes steps.
            if k < 200 {
                most = most.max(answer.spent);
            }
        }
        assert!(proxy.pose().position.z > 0.09 && proxy.is_blocked());
        most
    });
    println!("{in_time} in time, {late} late");
    assert!(in_time > MOST && late <= MOST, "{in_time}, {late}");
}
