//! Places beside a proxy, and what a late tick finds.

use super::*;
use crate::costs::WorkCosts;
use crate::observer::{Stage, StageObserver, Timed};
use crate::work::TickWork;
use ab_tree::{AbTree, leaf_key};
use spm::{ActiveMesh, Certified};

/// Radius of the ball.
const BALL: f64 = 1e-3;

/// Sheets far and wide at some heights, which do not move.
fn sheets(heights: &[f32]) -> (ActiveMesh, AbTree) {
    let count = heights.len() as u32;
    let mut mesh = ActiveMesh::new(4 * count, 2 * count, 0);
    let mut tree = AbTree::new(2 * count);
    tree.preconstruct(2 * count);
    for (sheet, &height) in (0..count).zip(heights) {
        let first = 4 * sheet;
        let corners = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)];
        for (vertex, (x, y)) in (first..).zip(corners) {
            mesh.set_base_vertex(vertex, [x, y, height], Certified::EXACT);
        }
        for (face, corners) in (2 * sheet..).zip([[0, 1, 2], [3, 2, 1]]) {
            mesh.set_base_face(face, corners.map(|k| first + k), [NONE; 3])
                .expect("the vertices are there");
            tree.insert(face, leaf_key(face, 2 * count));
        }
    }
    tree.refit(|face| mesh.face_box(face));
    (mesh, tree)
}

/// Where the ball at the origin is outside of sheets at these heights, of which one front
/// sticks out by `bulge` over another; `around`: radius of what holds the probe.
fn outside(heights: &[f32], around: f64, bulge: f64) -> Option<f64> {
    let (mesh, tree) = sheets(heights);
    let surface = Surface {
        mesh: &mesh,
        tree: &tree,
    };
    let mut work = Work::default();
    let place = held().outside(surface, [around, bulge], &mut work)?;
    assert!(work.faces > 0);
    assert!(place.position.truncate().length() < 1e-9);
    Some(place.position.z)
}

#[test]
fn a_place_beside_the_proxy_is_on_its_side_and_beyond_every_front() {
    const BULGE: f64 = 0.01;
    let far = 2.0 * BALL + BULGE;
    let is_at = |place: Option<f64>, due: f64| place.is_some_and(|z| (z - due).abs() < 1e-9);
    // The sheet is above it, or below, and touches it.
    for height in [3e-3, -3e-3, 1e-3] {
        let place = outside(&[height], BALL, BULGE);
        let height = f64::from(height);
        assert!(is_at(place, height - far.copysign(height)), "{place:?}");
    }
    // It is far enough away as it is.
    assert_eq!(outside(&[0.02], BALL, BULGE), Some(0.0));
    // Another sheet is near the place, and it is between the two.
    let place = outside(&[3e-3, -0.0205], BALL, BULGE);
    assert!(is_at(place, f64::from(3e-3_f32) - far), "{place:?}");
    for other in [-0.0195, -6e-3] {
        assert_eq!(outside(&[3e-3, other], BALL, BULGE), None, "{other}");
    }
    // What holds a tool is not free.
    assert_eq!(outside(&[3e-3], 4e-3, BULGE), None);
    // Of a front nothing is certified.
    for bulge in [f64::INFINITY, f64::NAN] {
        assert_eq!(outside(&[3e-3], BALL, bulge), None);
    }
}

#[test]
fn a_proxy_begins_from_the_latest_start() {
    let frame = ModelFrame {
        pose: Pose::IDENTITY,
        metres_per_unit: 2.0,
        origin: DVec3::X,
    };
    let shape = ProbeShape::Sphere { radius_m: BALL };
    let mut pair = ProbeObjectPair::new(&shape, SurfaceEffects::default());
    let at = |z: f64| Pose::at(DVec3::Z * z);
    pair.begin(Some(at(0.1)));
    pair.waits(Some(at(-0.1)));
    pair.update(&frame, Some(at(-0.1)));
    let begins = pair.proxy.pose();
    assert_eq!(begins.map(|of| frame.model_to_object(of)), Some(at(-0.1)));
    // Then it is where the surface lets it be.
    pair.waits(Some(at(0.1)));
    pair.update(&frame, Some(at(0.1)));
    assert_eq!(pair.proxy.pose(), begins);
}

/// A ball of 1 mm that is held at the origin.
fn held() -> ProbeObjectPair {
    let shape = ProbeShape::Sphere { radius_m: 1e-3 };
    let mut pair = ProbeObjectPair::new(&shape, SurfaceEffects::default());
    pair.proxy.begin(1e-3, 1.0, Some(Pose::IDENTITY));
    pair
}

#[test]
fn what_was_nearest_stays_so_where_a_search_finds_nothing_nearer() {
    let pair = held();
    let at = |x: f64| Some(DVec3::X * x);
    assert_eq!(pair.nearer_of(None, at(2.0)), at(2.0));
    assert_eq!(pair.nearer_of(at(3.0), at(2.0)), at(2.0));
    assert_eq!(pair.nearer_of(at(1.0), at(2.0)), at(1.0));
    assert_eq!(pair.nearer_of(at(1.0), None), at(1.0));
}

/// The share of the spring that is paid for, of a hand that moves to and fro in a surface which
/// then comes half a millimetre nearer by itself.
fn paid(damping_ns_per_m: f64) -> f64 {
    let plan = SurfacePlan {
        stiffness_n_per_m: 800.0,
        damping_ns_per_m,
    };
    let period_s = 1e-3;
    let mut pair = held();
    let mut before = 0.0;
    for tick in 0..=1000_u32 {
        let turn = std::f64::consts::TAU * 5.0 * period_s * f64::from(tick);
        let depth = 1.5e-3 - 1e-3 * turn.cos();
        let risen = if tick == 1000 { 5e-4 } else { 0.0 };
        let goal = Pose::at(DVec3::NEG_Z * (depth + risen));
        let moved = Twist {
            linear: DVec3::NEG_Z * (depth - before),
            angular: DVec3::ZERO,
        };
        before = depth;
        pair.begin_tick();
        let velocity = moved.times(1.0 / period_s);
        let _ = pair.couple((&goal, 1.0, &plan), [&moved, &velocity], period_s);
    }
    pair.paid()
}

#[test]
fn what_damping_takes_pays_for_no_contact() {
    let [without, with] = [0.0, 5.0].map(paid);
    assert!(without < 0.9, "{without}");
    assert!((with - without).abs() < 1e-9, "{with}, {without} without");
}

/// Whether the time of a tick is over.
struct Late(bool);

impl StageObserver for Late {
    fn ended(&mut self, _: Stage) {}

    fn is_over(&mut self, _: Timed) -> bool {
        self.0
    }
}

/// A tick of a pair: the contact that it finds.
fn tick(pair: &mut ProbeObjectPair, heights: &[f32], is_late: bool) -> Option<Contact> {
    let (mesh, tree) = sheets(heights);
    let surface = Surface {
        mesh: &mesh,
        tree: &tree,
    };
    let (work, mut late) = (TickWork::new(1e3), Late(is_late));
    let time = (&WorkCosts::REFERENCE, u32::MAX);
    let mut budget = QueryBudget::new(&work, time, [0].into_iter(), &mut late);
    budget.begin_pair(0);
    pair.begin_tick();
    pair.advance(surface, &mut budget)?.contact
}

/// The sheet that held the ball has gone, which follows gently, and the next faces are deeper in
/// the tree than a late search comes.
#[test]
fn what_is_held_keeps_its_contact_in_a_late_tick_that_finds_no_face() {
    let height = 2e-3;
    let far: Vec<f32> = (0..1024u16).map(|k| 1.0 + f32::from(k)).collect();
    let mut pair = held();
    pair.goal = Some(Pose::at(DVec3::Z * 5e-3));
    let before = tick(&mut pair, &[height], false).expect("the sheet stops it");
    assert!((before.point.z - f64::from(height)).abs() < 1e-12);
    pair.proxy.limit_slide(1e-6);
    for _ in 0..3 {
        pair.hint = None;
        let then = tick(&mut pair, &far, true).expect("it is held");
        assert!(pair.proxy.is_held() && pair.hint.is_none());
        assert!(then.face == NONE && then.point.distance(before.point) < 1e-12);
    }
    // With time it finds what is there.
    let found = tick(&mut pair, &far, false).expect("it is held");
    assert!(found.face != NONE && (found.point.z - 1.0).abs() < 1e-12);
}
