//! Without friction nothing drags: a tool that slides or turns is held only along the contact
//! normals, however fine the mesh and however fast the hand; and over an edge nothing jolts.

use crate::common::fronts::{Front, box_mesh, plate_mesh};
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};
use hrtc_core::contact::coupling::Coupling;
use hrtc_core::contact::motion::Twist;
use hrtc_core::contact::query::Ending;
use hrtc_core::contact::rigid_proxy::ToolProxy;
use hrtc_core::contact::tool::{Tool, ToolMesh, capsule_mesh, cylinder_mesh};
use std::f64::consts::TAU;

const STIFFNESS: f64 = 800.0;
/// A third more than a tick of the product has: a cylinder that swings by 0.5 rad over the bumps
/// needs that in a few ticks.
const BUDGET: u32 = 1 << 16;
/// A tool of 20 mm on a plate of 80 mm.
const RADIUS: f64 = 0.003;
const LENGTH: f64 = 0.02;
const PLATE: f64 = 0.04;
/// Way a tick at 0.1 m/s.
const STEP: f64 = 1e-4;

/// A proxy that is led tick by tick.
struct Hand {
    proxy: ToolProxy,
}

impl Hand {
    fn new(mesh: &ToolMesh) -> Self {
        let tool = Tool::new(mesh).expect("it is a tool");
        Self {
            proxy: ToolProxy::new(tool, 1.0).expect("it has an extent"),
        }
    }

    fn to(&mut self, front: &Front, pose: &Pose) -> Wrench {
        let answer = self.proxy.advance(front.surface(), pose, BUDGET);
        assert_eq!(answer.ending, Ending::Complete);
        let spring = Coupling {
            stiffness_n_per_m: STIFFNESS,
            damping_ns_per_m: 0.0,
        };
        self.proxy.wrench(&spring, 1.0, &Twist::default())
    }

    /// From above down to a pose.
    fn press(&mut self, front: &Front, pose: &Pose, up: DVec3) {
        for k in (0..=200).rev() {
            let above = pose.position + up * (STEP * f64::from(k));
            self.to(
                front,
                &Pose {
                    position: above,
                    ..*pose
                },
            );
        }
    }
}

/// Pressed onto a plate and turned about the plate's normal, nothing holds it back from the turn.
#[test]
fn a_tool_that_turns_on_a_plate_feels_no_torque_about_its_normal() {
    let plate = Front::of_mesh(&plate_mesh(PLATE, 40));
    let depth = 0.001;
    for (name, mesh, lying) in [
        (
            "cylinder upright",
            cylinder_mesh(RADIUS, LENGTH, 240),
            false,
        ),
        ("cylinder lying", cylinder_mesh(RADIUS, LENGTH, 240), true),
        ("capsule lying", capsule_mesh(RADIUS, LENGTH, 24, 20), true),
    ] {
        let lie = if lying {
            DQuat::from_rotation_y(0.25 * TAU)
        } else {
            DQuat::IDENTITY
        };
        let lowest = mesh.positions.iter().map(|&p| (lie * p).z);
        let lowest = lowest.fold(f64::INFINITY, f64::min);
        for rad_per_tick in [0.005, 0.02, 0.06, 0.1] {
            let pose = |angle: f64| Pose {
                position: DVec3::new(0.001, 0.002, -lowest - depth),
                orientation: DQuat::from_rotation_z(angle) * lie,
            };
            let mut hand = Hand::new(&mesh);
            hand.press(&plate, &pose(0.0), DVec3::Z);
            let due = STIFFNESS * (depth + hand.proxy.contact_offset());
            for k in 0..300 {
                let measured = hand.to(&plate, &pose(rad_per_tick * f64::from(k)));
                let label = format!("{name}, {rad_per_tick} rad a tick, tick {k}: {measured:?}");
                assert!(
                    (measured.force - DVec3::Z * due).length() < 1e-2 * due,
                    "{label}"
                );
                assert!(measured.torque.z.abs() < 1e-2 * due * RADIUS, "{label}");
            }
        }
    }
}

/// A tilted plane feels the same in two faces and in thousands.
#[test]
fn a_plane_feels_the_same_however_it_is_cut() {
    let tilt = DQuat::from_rotation_y(0.3) * DQuat::from_rotation_x(0.2);
    let up = tilt * DVec3::Z;
    let measured = |pieces: u32, mesh: &ToolMesh, turn: DQuat| {
        let mut plane = plate_mesh(PLATE, pieces);
        for position in &mut plane.positions {
            *position = tilt * *position;
        }
        let front = Front::of_mesh(&plane);
        let mut hand = Hand::new(mesh);
        let lowest = mesh.positions.iter().map(|&p| (turn * p).z);
        let lowest = lowest.fold(f64::INFINITY, f64::min);
        let pose = |k: u32| Pose {
            position: tilt * DVec3::new(STEP * f64::from(k) - 0.015, 0.004, -lowest - 0.001),
            orientation: tilt * DQuat::from_rotation_z(0.01 * f64::from(k)) * turn,
        };
        hand.press(&front, &pose(0), up);
        (0..300)
            .map(|k| hand.to(&front, &pose(k)))
            .collect::<Vec<_>>()
    };
    for (name, mesh, turn) in [
        (
            "cylinder upright",
            cylinder_mesh(RADIUS, LENGTH, 240),
            DQuat::IDENTITY,
        ),
        (
            "cylinder leaning",
            cylinder_mesh(RADIUS, LENGTH, 240),
            DQuat::from_rotation_y(0.4),
        ),
        (
            "cylinder lying",
            cylinder_mesh(RADIUS, LENGTH, 240),
            DQuat::from_rotation_y(0.25 * TAU),
        ),
        (
            "capsule leaning",
            capsule_mesh(RADIUS, LENGTH, 24, 20),
            DQuat::from_rotation_y(0.4),
        ),
    ] {
        let whole = measured(1, &mesh, turn);
        for pieces in [7, 64] {
            // The corners of the pieces are rounded to f32: the plane is no plane to 1e-9 m.
            for (k, (one, many)) in whole.iter().zip(measured(pieces, &mesh, turn)).enumerate() {
                let off = one.force.distance(many.force) / one.force.length();
                assert!(
                    off < 2e-3,
                    "{name}, {pieces} pieces, tick {k}: {off:e}\n{one:?}\n{many:?}"
                );
                let along = many.force.reject_from_normalized(up).length() / many.force.length();
                assert!(
                    along < 5e-3,
                    "{name}, {pieces} pieces, tick {k}: {along:e} along the plane"
                );
            }
        }
    }
}

/// Over bumps as wide as the tool, the axis swinging as a hand's does, the force along the way is
/// small beside that across.
#[test]
fn bumps_do_not_hold_a_tool_back() {
    let mut bumpy = plate_mesh(PLATE, 160);
    for p in &mut bumpy.positions {
        let [x, y] = [p.x, p.y].map(|s| (s * TAU / 0.007).sin());
        p.z = 0.0006 * (x + y) + 0.0001 * (p.x * TAU / 0.0021).sin();
    }
    let front = Front::of_mesh(&bumpy);
    for (name, mesh) in [
        ("cylinder", cylinder_mesh(RADIUS, LENGTH, 960)),
        ("capsule", capsule_mesh(RADIUS, LENGTH, 24, 20)),
    ] {
        for swing in [0.0, 0.2, 0.5] {
            let mut hand = Hand::new(&mesh);
            let pose = |k: u32| {
                // 40 rad/s at the most where it swings by 0.5 rad.
                let angle = swing * (0.08 * f64::from(k)).sin();
                let axis = DVec3::new(0.8, 0.6, 0.0);
                let orientation = DQuat::from_axis_angle(axis, angle);
                // The tip is 1 mm deep and goes straight on.
                let tip = DVec3::new(
                    STEP * f64::from(k) - 0.02,
                    0.3 * STEP * f64::from(k),
                    -0.001,
                );
                Pose {
                    position: tip + orientation * DVec3::Z * (0.5 * LENGTH),
                    orientation,
                }
            };
            hand.press(&front, &pose(0), DVec3::Z);
            let way = DVec3::new(1.0, 0.3, 0.0).normalize();
            let (mut along, mut across) = (0.0, 0.0);
            for k in 0..400 {
                let measured = hand.to(&front, &pose(k));
                along -= measured.force.dot(way);
                across += measured.force.z;
            }
            // What a tool in no hurry feels is 0.10 to 0.17: it falls off the bumps.
            let drag = along / across;
            assert!(drag < 0.3, "{name} that swings by {swing}: {drag}");
            assert!(across > 400.0 * 0.5, "{name}: it is pressed on");
        }
    }
}

/// Pressed into the top of a box and led out over its edge, where the nearest way out is another
/// one: the proxy goes there at once, the force over some ticks.
#[test]
fn over_an_edge_the_force_changes_little_more_than_the_device_moves() {
    let (half, depth) = (0.02, 0.002);
    let block = Front::of_mesh(&box_mesh(DVec3::splat(half)));
    let lie = DQuat::from_rotation_x(0.25 * TAU);
    for (name, mesh, turn) in [
        (
            "cylinder along the edge",
            cylinder_mesh(RADIUS, LENGTH, 240),
            lie,
        ),
        (
            "capsule along the edge",
            capsule_mesh(RADIUS, LENGTH, 24, 20),
            lie,
        ),
        (
            "capsule upright",
            capsule_mesh(RADIUS, LENGTH, 24, 20),
            DQuat::IDENTITY,
        ),
    ] {
        let lowest = mesh.positions.iter().map(|&p| (turn * p).z);
        let lowest = lowest.fold(f64::INFINITY, f64::min);
        let pose = |x: f64| Pose {
            position: DVec3::new(x, 0.001, half - lowest - depth),
            orientation: turn,
        };
        let mut hand = Hand::new(&mesh);
        let start = half - 0.005;
        hand.press(&block, &pose(start), DVec3::Z);
        let at = |hand: &Hand| hand.proxy.penetration().linear;
        let (mut last, mut before) = (hand.to(&block, &pose(start)), at(&hand));
        let (mut farthest, mut first) = (0.0f64, None);
        for k in 1..=250 {
            let deflection = hand.proxy.deflection();
            let wrench = hand.to(&block, &pose(start + STEP * f64::from(k)));
            let own = STIFFNESS * (STEP + hand.proxy.contact_offset());
            let change = (wrench.force - last.force).length();
            // The motion and 7 % of the deflection, which has a part in rotation, too.
            let felt = own + 0.07 * (STIFFNESS * deflection + own);
            assert!(change <= felt, "{name}, tick {k}: {change} N of {felt} N");
            farthest = farthest.max((at(&hand) - before).length());
            first = first.or(Some(last.force));
            (last, before) = (wrench, at(&hand));
        }
        // It has gone over the edge at once, and nothing holds it there.
        assert!(
            first.is_some_and(|force| force.z > 0.9 * STIFFNESS * depth),
            "{name}"
        );
        assert!(farthest > 3.0 * STEP, "{name}: {farthest} m");
        assert_eq!(last.force, DVec3::ZERO, "{name}");
    }
}
