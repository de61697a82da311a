//! A tool that the surface has caught passes nothing on its way out, and one that starts inside a
//! closed body is not held there.

use crate::common::fronts::{Front, box_mesh, plate_mesh};
use crate::common::guided_tool::{GuidedTool, TICK_BUDGET};
use geometry::Pose;
use glam::{DQuat, DVec3};
use hrtc_core::contact::tool::{ToolMesh, capsule_mesh};
use simulator::Random;
use spm::{OperationFaces, SpmParts};
use spm_builder::{BuildOptions, NoProgress, SoupMesh, build_model};

/// Half the distance of the sheets, the height of their spikes, and the radius of the tool: it has
/// room between the sheets, and none between the spikes.
const HALF_GAP: f64 = 0.25;
const SPIKE: f64 = 0.12;
const RADIUS: f64 = 0.19;

/// Two sheets, one over the other, with a spike at random up or down at each vertex: a coarse front
/// is nearly flat, and as it is split the sheets come towards each other.
fn spiked_sheets() -> SpmParts {
    let plate = plate_mesh(2.0, 24);
    let mut random = Random::new(5);
    let mut mesh = SoupMesh::default();
    for height in [-HALF_GAP, HALF_GAP] {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(plate.positions.iter().map(|p| {
            let spike = random.vector().z.signum() * SPIKE;
            [p.x, p.y, height + spike]
        }));
        let above = |t: &[u32; 3]| t.map(|v| v + first);
        mesh.triangles.extend(plate.triangles.iter().map(above));
    }
    let options = BuildOptions {
        base_faces: Some(32),
        regions: None,
    };
    build_model(mesh, &options, &NoProgress).expect("the model is built")
}

/// Performs all splits in one tick, or undoes them, and tells the proxy.
fn change(front: &mut Front, vsps: u32, is_split: bool, hand: &mut GuidedTool) {
    let mut out = OperationFaces::new();
    let Front { mesh, tree, .. } = front;
    for k in 0..vsps {
        if is_split {
            mesh.split(k, &mut out).expect("the builder's records fit");
            for (&face, leaf) in out.made_or_removed().iter().zip(out.leaves) {
                assert!(tree.insert(face, leaf));
            }
        } else {
            mesh.collapse(vsps - 1 - k, &mut out).expect("small fans");
            out.made_or_removed().iter().for_each(|&f| tree.remove(f));
        }
        out.deformed().iter().for_each(|&f| tree.deform(f));
        hand.proxy.carry(mesh, &out);
    }
    tree.refit(|f| mesh.face_box(f));
}

fn highest(hand: &GuidedTool) -> f64 {
    let at = hand.proxy.pose();
    let heights = hand.mesh.positions.iter().map(|&p| at.transform_point(p).z);
    heights.fold(f64::NEG_INFINITY, f64::max)
}

/// Leads the device out through the upper sheet; the tool stays below it.
fn lead_out(hand: &mut GuidedTool, front: &Front, start: Pose, ticks: u32) {
    for k in 0..ticks {
        let up = DVec3::Z * (0.05 * f64::from(k)).min(3.0);
        let pose = Pose {
            position: start.position + up,
            ..start
        };
        let _ = hand.proxy.advance(front.surface(), &pose, TICK_BUDGET);
        let top = highest(hand);
        assert!(top < HALF_GAP + SPIKE + 2.0 * RADIUS, "{k}: {top}");
        assert!(hand.proxy.pose().position.z < HALF_GAP + SPIKE, "{k}");
    }
}

#[test]
fn two_sheets_close_on_a_tool_that_the_device_leaves_through_one() {
    let parts = spiked_sheets();
    let vsps = parts.header.vsps;
    let (mut caught, mut freed) = (0, 0);
    for place in 0..25 {
        let mut front = Front::new(&parts, 0, &mut Random::new(1));
        let mut hand = GuidedTool::new(capsule_mesh(RADIUS, 1.0, 12, 10));
        let at = |k: i32| 0.5 * f64::from(k - 2);
        let start = Pose {
            position: DVec3::new(at(place % 5), at(place / 5), 0.0),
            orientation: DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2),
        };
        let _ = hand.proxy.advance(front.surface(), &start, TICK_BUDGET);
        if hand.meets(&front) {
            continue;
        }
        change(&mut front, vsps, true, &mut hand);
        let _ = hand.proxy.advance(front.surface(), &start, u32::MAX);
        if !hand.meets(&front) {
            continue;
        }
        caught += 1;
        lead_out(&mut hand, &front, start, 80);
        assert!(hand.proxy.stuck_ticks() > 0 && hand.proxy.is_blocked());
        // The sheets open again: the tool follows the device, as far as the upper sheet.
        change(&mut front, vsps, false, &mut hand);
        let up = Pose {
            position: start.position + DVec3::Z * 3.0,
            ..start
        };
        let before = hand.proxy.stuck_ticks();
        for _ in 0..20 {
            let _ = hand.proxy.advance(front.surface(), &up, TICK_BUDGET);
            assert!(hand.proxy.pose().position.z < HALF_GAP + SPIKE);
        }
        if !hand.meets(&front) {
            freed += 1;
            assert!(hand.proxy.stuck_ticks() <= before + 1);
            assert!(hand.proxy.is_blocked());
        }
    }
    println!("{caught} caught, {freed} freed");
    assert!(caught > 0 && freed > 0, "{caught} {freed}");
}

/// Two sheets close on a tool and never open again: after a second it begins anew with the device,
/// without force, and not before.
#[test]
fn a_tool_that_is_held_for_good_begins_anew_with_the_device() {
    let parts = spiked_sheets();
    let mut front = Front::new(&parts, 0, &mut Random::new(1));
    let mut hand = GuidedTool::new(capsule_mesh(RADIUS, 1.0, 12, 10));
    let start = Pose {
        position: DVec3::new(0.5, 0.5, 0.0),
        orientation: DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2),
    };
    let _ = hand.proxy.advance(front.surface(), &start, TICK_BUDGET);
    change(&mut front, parts.header.vsps, true, &mut hand);
    let _ = hand.proxy.advance(front.surface(), &start, u32::MAX);
    assert!(hand.meets(&front));
    let out = Pose {
        position: DVec3::Z * 3.0,
        ..start
    };
    let mut held = 0;
    while hand.meets(&front) {
        let _ = hand.proxy.advance(front.surface(), &out, TICK_BUDGET);
        held += 1;
        assert!(held <= 1002);
    }
    assert!(held >= 999, "{held}");
    assert_eq!(hand.proxy.pose().position, out.position);
    assert!(!hand.proxy.is_blocked());
}

/// A tool in a closed body, that it is led out of and pressed onto from outside.
fn out_of(body: &Front, tool: ToolMesh) {
    let mut hand = GuidedTool::new(tool);
    let pose = |x: f64| Pose {
        position: DVec3::new(x, 0.013, 0.021),
        orientation: DQuat::from_rotation_x(0.3),
    };
    let mut x = 0.0;
    while x < 3.0 {
        let _ = hand.proxy.advance(body.surface(), &pose(x), TICK_BUDGET);
        assert!(!hand.proxy.is_blocked(), "held at {x}");
        assert_eq!(hand.proxy.pose().position.x, x);
        x += 0.02;
    }
    while x > 0.0 {
        x -= 0.02;
        let _ = hand.proxy.advance(body.surface(), &pose(x), TICK_BUDGET);
        assert!(!hand.meets(body));
    }
    assert!(hand.proxy.is_blocked() && hand.proxy.pose().position.x > 1.0);
}

#[test]
fn what_starts_within_a_closed_body_is_not_held_there() {
    // A box has its diagonals where rays like to go.
    for body in [box_mesh(DVec3::ONE), capsule_mesh(1.0, 2.0, 40, 40)] {
        let body = Front::of_mesh(&body);
        out_of(&body, capsule_mesh(0.05, 0.4, 12, 10));
        out_of(&body, box_mesh(DVec3::splat(0.1)));
    }
}

/// From within, a shell whose faces look inwards, and from behind, an open sheet, are surfaces like
/// any other.
#[test]
fn what_starts_in_a_cavity_or_behind_a_sheet_is_held() {
    let mut shell = box_mesh(DVec3::ONE);
    shell.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    for surface in [shell, plate_mesh(1.0, 8)] {
        let front = Front::of_mesh(&surface);
        let mut hand = GuidedTool::new(capsule_mesh(0.05, 0.4, 12, 10));
        let mut z = -0.6;
        while z < 2.0 {
            let pose = Pose::at(DVec3::new(0.013, 0.021, z));
            let _ = hand.proxy.advance(front.surface(), &pose, TICK_BUDGET);
            assert!(!hand.meets(&front));
            z += 0.02;
        }
        assert!(hand.proxy.is_blocked() && hand.proxy.pose().position.z < 1.0);
    }
}
