//! Open sheets as tools: flat on a plate every face is as near as any other.

use crate::common::fronts::{Front, box_mesh, plate_mesh};
use crate::common::guided_tool::TICK_BUDGET;
use geometry::Pose;
use glam::{DQuat, DVec3};
use hrtc_core::contact::coupling::Coupling;
use hrtc_core::contact::motion::Twist;
use hrtc_core::contact::query::{Deadline, Limit};
use hrtc_core::contact::rigid_proxy::{StepSettings, ToolProxy};
use hrtc_core::contact::tool::{Tool, ToolMesh};

/// The corners of a sheet, and what may have stopped each step of a tick.
const MOST_CONTACTS: usize = 4 + StepSettings::PRODUCT.max_steps as usize;

fn proxy(mesh: &ToolMesh) -> ToolProxy {
    ToolProxy::new(Tool::new(mesh).expect("it is a tool"), 1.0).expect("it has an extent")
}

/// With a budget for a part of what is near, a tool that starts close to a plate learns that it is
/// clear, though its device moves in each tick.
#[test]
fn what_starts_close_to_a_plate_and_moves_gets_to_know_that_it_is_clear() {
    const BUDGET: u32 = 6000;
    let plate = Front::of_mesh(&plate_mesh(1.0, 64));
    let mut proxy = proxy(&plate_mesh(0.2, 16));
    let above = 0.5 * proxy.static_offset();
    let mut to = |x: f64, height: f64| {
        proxy.advance(
            plate.surface(),
            &Pose::at(DVec3::new(x, 0.013, height)),
            BUDGET,
        );
        (proxy.pose().position.z, proxy.is_blocked())
    };
    for k in 0..100 {
        to(1e-4 * f64::from(k), above);
    }
    for k in 0..200 {
        let (height, _) = to(0.01, above - 1e-4 * f64::from(k));
        assert!(height > 0.0, "{k}: {height}");
    }
    let (height, is_blocked) = to(0.01, above - 0.02);
    assert!(height > 0.0 && is_blocked, "{height}");
}

/// A sheet has no corner that is lower than its neighbours: its rim is held, whatever a tick may
/// spend, and holding it costs no more than a small part of that.
#[test]
fn a_sheet_pressed_flat_is_held_at_any_budget() {
    for budget in [TICK_BUDGET / 4, TICK_BUDGET, 10 * TICK_BUDGET] {
        for start in [1e-2, 8e-6, 2e-5] {
            let plate = Front::of_mesh(&plate_mesh(1.0, 64));
            let mut proxy = proxy(&plate_mesh(0.2, 16));
            let mut last = 0;
            for k in 0..300 {
                let height = start - 1e-4 * f64::from(k);
                let pose = Pose::at(DVec3::new(0.01, 0.013, height));
                last = proxy.advance(plate.surface(), &pose, budget).spent;
            }
            let height = proxy.pose().position.z;
            assert!(
                height > 0.0 && height < 2.0 * proxy.static_offset(),
                "{height}"
            );
            assert!(
                proxy.is_blocked() && last < TICK_BUDGET / 8,
                "{last} of {budget}"
            );
            let [.., (contacts, _)] = proxy.high_water();
            assert!(contacts <= MOST_CONTACTS, "{contacts} contacts");
        }
    }
}

/// A strip of squares along x about the origin, so many by two.
fn strip(length: f64, squares: u32) -> ToolMesh {
    let side = length / f64::from(squares);
    let mut mesh = ToolMesh::default();
    for x in 0..=squares {
        for y in 0..3 {
            let [x, y] = [x, y].map(|k| side * f64::from(k));
            let place = DVec3::new(x - 0.5 * length, y - side, 0.0);
            mesh.positions.push(place);
        }
    }
    for square in 0..2 * squares {
        let a = square / 2 * 3 + square % 2;
        mesh.triangles.push([a, a + 3, a + 4]);
        mesh.triangles.push([a, a + 4, a + 1]);
    }
    mesh
}

/// Its rim has more vertices than there is room for contacts: its corners hold it, both ends alike.
#[test]
fn a_long_strip_pressed_flat_is_held_at_both_ends() {
    const STIFFNESS: f64 = 800.0;
    const DEPTH: f64 = 0.01;
    let plate = Front::of_mesh(&plate_mesh(1.0, 8));
    let mut proxy = proxy(&strip(0.6, 300));
    for k in 0..400 {
        let height = (0.01 - 1e-4 * f64::from(k)).max(-DEPTH);
        let pose = Pose::at(DVec3::new(0.11, 0.07, height));
        let answer = proxy.advance(plate.surface(), &pose, TICK_BUDGET);
        assert_eq!(answer.dropped, 0, "{k}");
    }
    let spring = Coupling {
        stiffness_n_per_m: STIFFNESS,
        damping_ns_per_m: 0.0,
    };
    let measured = proxy.wrench(&spring, 1.0, &Twist::default());
    let due = DVec3::Z * STIFFNESS * (DEPTH + proxy.contact_offset());
    assert!(
        measured.force.distance(due) < 1e-3 * due.length(),
        "{measured:?}"
    );
    assert!(
        measured.torque.length() < 1e-4 * due.length(),
        "{measured:?}"
    );
    let [.., (contacts, _)] = proxy.high_water();
    assert!(contacts <= MOST_CONTACTS, "{contacts} contacts");
}

/// Under a flat tool lie more vertices of a plane than there is room for contacts. Rounded to f32
/// they are in no plane exactly, but none is a contact: the tool's corners hold it.
#[test]
fn a_box_flat_on_a_dense_tilted_plane_is_held_at_its_corners() {
    const STIFFNESS: f64 = 800.0;
    const DEPTH: f64 = 0.01;
    const HALF: f64 = 0.05;
    let turn = DQuat::from_rotation_x(0.4) * DQuat::from_rotation_y(0.3);
    let place = |p: DVec3| DVec3::new(1.1, 2.3, -1.7) + turn * p;
    let mut plane = plate_mesh(0.5, 30);
    for p in &mut plane.positions {
        *p = place(*p);
    }
    let plane = Front::of_mesh(&plane);
    let mut proxy = proxy(&box_mesh(DVec3::new(0.4, 0.4, HALF)));
    for k in 0..300 {
        let height = (0.01 - 1e-4 * f64::from(k)).max(-DEPTH);
        let pose = Pose {
            position: place(DVec3::new(0.011, 0.007, HALF + height)),
            orientation: turn,
        };
        let answer = proxy.advance(plane.surface(), &pose, TICK_BUDGET);
        assert_eq!(answer.dropped, 0, "{k}");
    }
    let spring = Coupling {
        stiffness_n_per_m: STIFFNESS,
        damping_ns_per_m: 0.0,
    };
    let measured = proxy.wrench(&spring, 1.0, &Twist::default());
    let due = turn * DVec3::Z * STIFFNESS * (DEPTH + proxy.contact_offset());
    assert!(
        measured.force.distance(due) < 1e-3 * due.length(),
        "{measured:?}, not {due}"
    );
    let [.., (contacts, _)] = proxy.high_water();
    assert!(contacts <= 128, "{contacts} contacts");
}

/// The time of each tick is over before it begins.
struct Over;

impl Deadline for Over {
    fn is_over(&mut self) -> bool {
        true
    }
}

/// A late tick that looks around leaves what it found to the next one: so many pairs of faces are
/// near a sheet that they alone take longer than what is done in any case.
#[test]
fn a_late_tick_looks_around_or_tests_what_it_found() {
    const FLOOR: u32 = 600;
    const INTERVAL: u32 = 160;
    const MOST: u32 = 2 * (FLOOR + INTERVAL);
    let plate = Front::of_mesh(&plate_mesh(1.0, 64));
    let mut proxy = proxy(&plate_mesh(0.2, 16));
    let at = |height: f64| Pose::at(DVec3::new(0.01, 0.013, height));
    let above = 0.5 * proxy.static_offset();
    let (mut looked, mut most) = (0, 0);
    let tested = loop {
        let mut over = Over;
        let limit = Limit::new(TICK_BUDGET, [FLOOR, INTERVAL], &mut over);
        let answer = proxy.advance(plate.surface(), &at(above), limit);
        if answer.ending.is_complete() {
            break answer;
        }
        looked += 1;
        most = most.max(answer.spent);
        assert!(looked < 1000, "it does not get to know");
    };
    println!("{looked} ticks of up to {most}, then {}", tested.spent);
    assert!(looked > 3 && most <= MOST, "{looked}, {most}");
    let looks_too = tested.work.node_pairs > 0;
    assert!(tested.spent > MOST && !looks_too, "{tested:?}");
    for k in 0..50 {
        let goal = at(above - 1e-4 * f64::from(k));
        proxy.advance(plate.surface(), &goal, TICK_BUDGET);
    }
    assert!(proxy.pose().position.z > 0.0 && proxy.is_blocked());
}
