//! A surface moves into a tool, over it, or onto it from both sides: the tool passes through no
//! sheet afterwards, gets free where its device is led out, and waits with a bounded force where
//! not.

use crate::common::fronts::{Front, box_mesh, plate_mesh};
use crate::common::guided_tool::{GuidedTool, TICK_BUDGET};
use ab_tree::{AbTree, leaf_key};
use geometry::Pose;
use glam::{DQuat, DVec3};
use hrtc_core::contact::coupling::Coupling;
use hrtc_core::contact::motion::Twist;
use hrtc_core::contact::rigid_proxy::ToolAdvance;
use hrtc_core::contact::tool::{ToolMesh, capsule_mesh};
use spm::{ActiveMesh, Certified, CertifiedCode, OperationFaces, VspRecord};

/// Height of the rims of both sheets, and their radius.
const RIM: f64 = 0.5;
const RADIUS: f64 = 10.0;
/// Half of the thickness of every tool here.
const HALF: f64 = 0.1;

/// Two hexagonal sheets, one over the other, whose middles can be moved towards each other: each is
/// split in two, and both halves move in a geomorph.
struct Sheets {
    front: Front,
    out: OperationFaces,
}

impl Sheets {
    /// `closed`: half of the distance of the middles at the end; less than 0 if they have passed
    /// each other.
    fn new(closed: f64) -> Self {
        let (mut mesh, mut tree) = Self::whole([RIM; 2], closed);
        let mut out = OperationFaces::new();
        for sheet in 0..2 {
            mesh.split(sheet, &mut out).expect("the fan is there");
            for (&face, leaf) in out.made_or_removed().iter().zip(out.leaves) {
                assert!(tree.insert(face, leaf));
            }
            mesh.start_split_geomorph(&out);
        }
        let front = Front::of(mesh, tree);
        Self { front, out }
    }

    /// Both before they are split; heights of their rims and middles.
    fn whole([rim, middle]: [f64; 2], closed: f64) -> (ActiveMesh, AbTree) {
        let mut mesh = ActiveMesh::new(14, 12, 2).with_geomorphs(4);
        let mut tree = AbTree::new(16);
        tree.preconstruct(16);
        for (sheet, side) in [(0, -1.0), (1, 1.0)] {
            let (centre, first) = (7 * sheet, 6 * sheet);
            for k in 0..7 {
                let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_3 * f64::from(k));
                let (out, height) = if k == 0 { (0.0, middle) } else { (RADIUS, rim) };
                let place = turn * DVec3::new(out, 0.0, side * height);
                mesh.set_base_vertex(centre + k, place.as_vec3().to_array(), Certified::EXACT);
            }
            for k in 0..6 {
                let corners = [centre, centre + 1 + k, centre + 1 + (k + 1) % 6];
                let neighbours = [spm::NONE, first + (k + 1) % 6, first + (k + 5) % 6];
                mesh.set_base_face(first + k, corners, neighbours)
                    .expect("a fan");
                assert!(tree.insert(first + k, leaf_key(8 * sheet + k, 16)));
            }
            let [leaf_l, leaf_r] = [6, 7].map(|k| leaf_key(8 * sheet + k, 16));
            let record = VspRecord {
                i: sheet,
                vs: centre,
                fn_: [0, 5, 2, 3].map(|k| first + k),
                leaf_l,
                leaf_r,
                pos_t: [0.0, 1.0, (side * closed) as f32],
                pos_u: [0.0, -1.0, (side * closed) as f32],
                certified: [CertifiedCode::default(); 2],
                e: 0,
            };
            let certified = [Certified::EXACT; 2];
            mesh.load(sheet, &record, record.vs, record.fn_, certified);
        }
        (mesh, tree)
    }

    /// Moves the middles of both so far, 1 being all of it, and takes the tool along.
    fn close(&mut self, done: f64, hand: &mut GuidedTool) {
        let mesh = &mut self.front.mesh;
        for index in 0..mesh.geomorphs().len() {
            let geomorph = mesh.geomorphs()[index];
            mesh.faces_around_geomorph(&geomorph, &mut self.out)
                .expect("the fans are small");
            mesh.step_geomorph(index, done, &self.out);
            hand.proxy.carry(mesh, &self.out);
        }
        let Front { mesh, tree, .. } = &mut self.front;
        mesh.finish_geomorphs();
        for face in 0..16 {
            tree.deform(face);
        }
        tree.refit(|face| mesh.face_box(face));
    }
}

fn is_between(hand: &GuidedTool) -> bool {
    hand.proxy.pose().position.z.abs() < RIM
}

fn tools() -> [(&'static str, ToolMesh, DQuat); 3] {
    [
        ("box", box_mesh(DVec3::new(0.3, 0.2, HALF)), DQuat::IDENTITY),
        (
            "capsule lying",
            capsule_mesh(HALF, 0.8, 24, 20),
            DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2),
        ),
        (
            "capsule askew",
            capsule_mesh(HALF, 0.8, 24, 20),
            DQuat::from_rotation_x(0.3) * DQuat::from_rotation_y(1.5),
        ),
    ]
}

/// One tick, at the product's budget.
fn tick(hand: &mut GuidedTool, sheets: &Sheets, at: DVec3, turn: DQuat) -> ToolAdvance {
    let pose = Pose {
        position: at,
        orientation: turn,
    };
    let answer = hand
        .proxy
        .advance(sheets.front.surface(), &pose, TICK_BUDGET);
    let spring = Coupling {
        stiffness_n_per_m: 1.0,
        damping_ns_per_m: 0.0,
    };
    let force = hand.proxy.wrench(&spring, 1.0, &Twist::default()).force;
    let depth = hand.proxy.pose().position.distance(at);
    // The stiffness times the depth, and what a limited rate has left of it.
    assert!(
        force.is_finite() && force.length() <= 1.01 * depth.max(3.0),
        "{force} at {at}"
    );
    answer
}

/// Two sheets close on a tool between them, so far or more than the tool is thick, in steps of
/// different lengths. Then the device is led out beyond one of them: the tool stays between them.
/// Led back and out at the side, where there is room, the tool follows.
#[test]
fn between_two_sheets_that_close() {
    let mut stuck = 0;
    for (name, mesh, turn) in tools() {
        for closed in [0.9 * HALF, 0.5 * HALF, 0.1 * HALF] {
            for steps in [1, 20, 150, 1500] {
                for beyond in [DVec3::Z, DVec3::NEG_Z] {
                    let label = format!("{name}, {closed}, {steps} steps, {beyond}");
                    let mut sheets = Sheets::new(closed);
                    let mut hand = GuidedTool::new(mesh.clone());
                    let at = DVec3::new(0.05, 0.02, 0.0);
                    for _ in 0..5 {
                        tick(&mut hand, &sheets, at, turn);
                    }
                    for step in 1..=steps {
                        sheets.close(f64::from(step) / f64::from(steps), &mut hand);
                        tick(&mut hand, &sheets, at, turn);
                        assert!(is_between(&hand), "{label}, step {step}");
                    }
                    for k in 0..=200 {
                        let there = at + beyond * (0.01 * f64::from(k));
                        let answer = tick(&mut hand, &sheets, there, turn);
                        stuck += u32::from(answer.is_stuck);
                        assert!(is_between(&hand), "{label}, {there}");
                    }
                    for k in (0..=200).rev() {
                        let there = at + beyond * (0.01 * f64::from(k));
                        tick(&mut hand, &sheets, there, turn);
                        assert!(is_between(&hand), "{label}, {there} on the way back");
                    }
                    let mut there = at;
                    for k in 0..=1500 {
                        there = at + DVec3::X * (0.01 * f64::from(k.min(500)));
                        tick(&mut hand, &sheets, there, turn);
                        assert!(is_between(&hand), "{label}, {there} at the side");
                    }
                    let end = hand.proxy.pose().position;
                    assert!(end.distance(there) < 1e-9, "{label}: {end}");
                    assert!(
                        !hand.proxy.is_blocked() && !hand.meets(&sheets.front),
                        "{label}"
                    );
                }
            }
        }
    }
    println!("stuck in {stuck} ticks");
    assert!(stuck > 0, "no tool was squeezed");
}

/// Between sheets that have passed each other there is no place, and the last one decides on which
/// side the tool is. It meets neither unless it says so, its force is bounded, and led out at the
/// side it gets free.
#[test]
fn between_two_sheets_that_pass_each_other() {
    let mut stuck = 0;
    for (name, mesh, turn) in tools() {
        for steps in [1, 20, 150] {
            let mut sheets = Sheets::new(-0.5 * HALF);
            let mut hand = GuidedTool::new(mesh.clone());
            let at = DVec3::new(0.05, 0.02, 0.0);
            let mut lead = |hand: &mut GuidedTool, sheets: &Sheets, there: DVec3| {
                let answer = tick(hand, sheets, there, turn);
                stuck += u32::from(answer.is_stuck);
                let is_told = answer.is_stuck || !hand.meets(&sheets.front);
                assert!(is_told, "{name}, {steps}, {there}");
            };
            for _ in 0..5 {
                lead(&mut hand, &sheets, at);
            }
            for step in 1..=steps {
                sheets.close(f64::from(step) / f64::from(steps), &mut hand);
                lead(&mut hand, &sheets, at);
            }
            for k in 0..2000 {
                let angle = 0.003 * f64::from(k);
                let away = DVec3::new(angle.sin(), 0.0, (2.0 * angle).sin());
                lead(&mut hand, &sheets, at + 3.0 * away);
            }
            for k in 0..3000 {
                lead(
                    &mut hand,
                    &sheets,
                    at + DVec3::X * (0.01 * f64::from(k).min(2000.0)),
                );
            }
            assert!(!hand.proxy.is_blocked(), "{name}, {steps}");
        }
    }
    assert!(stuck > 0, "no tool was squeezed");
}

/// A sheet that comes at once, from below into a tool or over it, puts the tool out by no more than
/// it has moved, so that it stays below the other one.
#[test]
fn a_sheet_that_jumps_into_a_tool_puts_it_out() {
    for (name, mesh, turn) in tools() {
        for gap in [0.3, 0.1] {
            let mut sheets = Sheets::new(2.0 * HALF);
            let mut hand = GuidedTool::new(mesh.clone());
            let at = DVec3::new(0.05, 0.02, -RIM + 1.5 * HALF + gap * HALF);
            for _ in 0..5 {
                tick(&mut hand, &sheets, at, turn);
            }
            sheets.close(1.0, &mut hand);
            for k in 0..20 {
                let answer = tick(&mut hand, &sheets, at, turn);
                let is_out = !answer.is_stuck && !hand.meets(&sheets.front);
                assert!(is_out || k < 10, "{name}, {gap}, {k}");
            }
            assert!(is_between(&hand), "{name}, {gap}");
        }
    }
}

/// The tool hovers in a pit, and no face is near it before or after the pit becomes flat above it.
#[test]
fn a_sheet_that_jumps_over_a_tool_far_from_any_face_takes_it_along() {
    let rim = 2.0;
    for (name, mesh, turn) in tools() {
        let (mesh_of_sheets, tree) = Sheets::whole([rim, -0.5], rim);
        let mut sheets = Sheets {
            front: Front::of(mesh_of_sheets, tree),
            out: OperationFaces::new(),
        };
        let mut hand = GuidedTool::new(mesh);
        let at = DVec3::new(0.05, 0.02, 1.0);
        for _ in 0..5 {
            tick(&mut hand, &sheets, at, turn);
        }
        assert!(!hand.proxy.is_blocked(), "{name}: it touches");
        let Sheets { front, out } = &mut sheets;
        front.mesh.split(1, out).expect("the fan is there");
        for (&face, leaf) in out.made_or_removed().iter().zip(out.leaves) {
            assert!(front.tree.insert(face, leaf));
        }
        out.deformed().iter().for_each(|&f| front.tree.deform(f));
        hand.proxy.carry(&front.mesh, out);
        front.tree.refit(|face| front.mesh.face_box(face));
        for k in 0..20 {
            let answer = tick(&mut hand, &sheets, at, turn);
            let z = hand.proxy.pose().position.z;
            let is_out = !answer.is_stuck && z > rim && !hand.meets(&sheets.front);
            assert!(is_out || k < 10, "{name}, {k}: {z}");
        }
        assert!(hand.proxy.is_blocked(), "{name}: no force");
    }
}

/// The mesh came late: the device is beyond the surface already. Placed where it was before, the
/// tool comes from there, also where a tick has time for a part of what is near only.
#[test]
fn what_was_placed_clear_of_the_surface_comes_from_there() {
    for (name, mesh, turn) in tools() {
        for (start, goal, budget) in [
            (1.5, 0.0, TICK_BUDGET),
            (1.5, 0.6, TICK_BUDGET),
            (1.05 + HALF, 0.0, 3000),
            (1.05 + HALF, 1.0, 3000),
        ] {
            let front = Front::of_mesh(&box_mesh(DVec3::ONE));
            let mut hand = GuidedTool::new(mesh.clone());
            let at = |z: f64| Pose {
                position: DVec3::new(0.05, 0.02, z),
                orientation: turn,
            };
            assert!(hand.proxy.place(&at(start)));
            for k in 0..200 {
                let rest = at(goal - 1e-4 * f64::from(k));
                hand.proxy.advance(front.surface(), &rest, budget);
                let z = hand.proxy.pose().position.z;
                assert!(
                    z > 1.0 && !hand.meets(&front),
                    "{name}, {goal}, {budget}, {k}: {z}"
                );
            }
            let z = hand.proxy.pose().position.z;
            assert!(
                hand.proxy.is_blocked() && z < 1.45,
                "{name}, {goal}, {budget}: {z}"
            );
        }
    }
}

/// Nothing is in the way from where it was placed: it comes without force, also where several ticks
/// look around first.
#[test]
fn what_was_placed_far_from_the_device_in_free_space_comes_without_force() {
    let front = Front::of_mesh(&plate_mesh(2.0, 64));
    let spring = Coupling {
        stiffness_n_per_m: 1.0,
        damping_ns_per_m: 0.0,
    };
    for (name, mesh, turn) in tools() {
        for budget in [1000, TICK_BUDGET] {
            let mut hand = GuidedTool::new(mesh.clone());
            let at = |x: f64, z: f64| Pose {
                position: DVec3::new(x, 0.02, z),
                orientation: turn,
            };
            assert!(hand.proxy.place(&at(-0.5, 2.2 * HALF)));
            for k in 0..300 {
                let goal = at(0.5 + 1e-4 * f64::from(k), 4.0 * HALF);
                hand.proxy.advance(front.surface(), &goal, budget);
                let still = Twist::default();
                let force = hand.proxy.wrench(&spring, 1.0, &still).force;
                assert_eq!(force, DVec3::ZERO, "{name}, {budget}, {k}");
            }
            let x = hand.proxy.pose().position.x;
            assert!(x > 0.5, "{name}, {budget}: {x}");
        }
    }
}

/// Placed across a sheet it belongs to neither side: it goes with its device, without force, to
/// either, and stays there.
#[test]
fn what_starts_across_a_sheet_belongs_where_it_gets_clear() {
    let sheets = Sheets::new(HALF);
    for (name, mesh, turn) in tools() {
        for up in [1.0, -1.0] {
            let mut hand = GuidedTool::new(mesh.clone());
            let at = |k: u32| DVec3::new(0.05, 0.02, RIM + 0.01 * up * f64::from(k));
            for k in 0..60 {
                tick(&mut hand, &sheets, at(k), turn);
                assert_eq!(hand.proxy.pose().position, at(k), "{name}: no force");
            }
            for k in (0..90).rev() {
                tick(&mut hand, &sheets, at(k) - 0.3 * up * DVec3::Z, turn);
            }
            let z = hand.proxy.pose().position.z;
            assert!(
                (z - RIM) * up > 0.0 && hand.proxy.is_blocked(),
                "{name}: {z}"
            );
        }
    }
}

/// Placed wholly within a closed body it is in a cavity, and touches its walls from within.
#[test]
fn what_starts_within_a_body_stays_within() {
    let front = Front::of_mesh(&box_mesh(DVec3::ONE));
    for (name, mesh, turn) in tools() {
        let mut hand = GuidedTool::new(mesh);
        for k in 0..400 {
            let pose = Pose {
                position: DVec3::new(0.01, 0.004, -0.02) * f64::from(k),
                orientation: turn,
            };
            hand.proxy.advance(front.surface(), &pose, TICK_BUDGET);
            let at = hand.proxy.pose().position;
            assert!(
                at.abs().max_element() < 1.0 && !hand.meets(&front),
                "{name}: {at}"
            );
        }
        assert!(hand.proxy.is_blocked());
    }
}
