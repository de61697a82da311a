//! Two bodies, each a refined front or a tool, under any poses and scales: the pairs that
//! meet are those of a test of all pairs, whichever side is asked.

use crate::common::fronts::{Front, frame, models, plate_mesh, scaled};
use geometry::{Similarity, triangle_pair};
use glam::{DQuat, DVec3};
use hrtc_core::contact::query::{Body, Ending, FacePair, Placed, all_pairs, first_pair};
use hrtc_core::contact::tool::{Tool, capsule_mesh, cylinder_mesh};
use proptest::prelude::*;
use simulator::Random;
use spm::{Handle, SpmParts};
use std::f64::consts::TAU;
use std::sync::OnceLock;

type Pairs = Vec<(Handle, Handle)>;

/// The look at all pairs.
fn brute_pairs(a: &[(Handle, [DVec3; 3])], b: &[(Handle, [DVec3; 3])]) -> Pairs {
    let mut pairs = Vec::new();
    for &(x, s) in a {
        for &(y, t) in b {
            if triangle_pair(s, t).meets() {
                pairs.push((x, y));
            }
        }
    }
    pairs.sort_unstable();
    pairs
}

fn pairs_of(out: &[FacePair]) -> Pairs {
    let mut pairs: Pairs = out.iter().map(|pair| (pair.a, pair.b)).collect();
    pairs.sort_unstable();
    pairs
}

fn found<A: Body, B: Body>(a: &A, b: &B) -> Pairs {
    let mut out = vec![FacePair::NONE; 1 << 16];
    let found = all_pairs(a, b, u32::MAX, &mut out);
    assert_eq!(found.ending, Ending::Complete);
    assert!(found.work.boxes >= found.work.node_pairs && found.work.faces as usize >= found.count);
    for pair in &out[..found.count] {
        let meeting = triangle_pair(a.corners(pair.a), b.corners(pair.b));
        assert_eq!(pair.meeting, meeting);
    }
    pairs_of(&out[..found.count])
}

fn moved(front: &Front, to: &Similarity) -> Vec<(Handle, [DVec3; 3])> {
    let moved = |&(face, t): &(Handle, [DVec3; 3])| (face, t.map(|p| to.point(p)));
    front.faces.iter().map(moved).collect()
}

fn parts() -> &'static [(String, SpmParts)] {
    static PARTS: OnceLock<Vec<(String, SpmParts)>> = OnceLock::new();
    PARTS.get_or_init(|| models(900))
}

/// Two fronts, and a frame that brings the second to the first: mostly they overlap.
struct Scene {
    a: Front,
    b: Front,
    b_to_a: Similarity,
}

impl Scene {
    fn new(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let mut front = || {
            let (_, parts) = &parts()[random.below(parts().len() as u64) as usize];
            let chance = [0, 60, 97, 100][random.below(4) as usize];
            Front::new(parts, chance, &mut random)
        };
        let (a, b) = (front(), front());
        let turn = random.orientation();
        // From a tenth to all of the other's size, with a face of it near a face of the other.
        let scale = a.diagonal() / b.diagonal() * 10f64.powf(-random.unit());
        let on_a = a.any_face(&mut random).1[0];
        let on_b = frame(DVec3::ZERO, turn, scale).point(b.any_face(&mut random).1[0]);
        let off = random.vector() * a.diagonal() * [0.0, 0.01, 0.3][random.below(3) as usize];
        let b_to_a = frame(on_a - on_b + off, turn, scale);
        Self { a, b, b_to_a }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    /// Exactly the pairs of the look at all, by boxes moved as they are met and by a tool moved
    /// before.
    #[test]
    fn pairs_are_those_of_all_faces(seed in any::<u64>()) {
        let Scene { a, b, b_to_a } = Scene::new(seed);
        let of_b = moved(&b, &b_to_a);
        let expected = brute_pairs(&a.faces, &of_b);
        let placed = Placed { body: b.surface(), to_query: b_to_a };
        prop_assert_eq!(&found(&a.surface(), &placed), &expected);
        let mut tool = Tool::new(&b.as_mesh()).expect("a front is a tool");
        tool.place(&b_to_a);
        let by_tool = found(&a.surface(), &tool);
        let mut by_tool: Pairs = by_tool.iter().map(|&(x, k)| (x, b.faces[k as usize].0)).collect();
        by_tool.sort_unstable();
        prop_assert_eq!(&by_tool, &expected);
        // The other way round.
        let swapped: Pairs = found(&placed, &a.surface()).iter().map(|&(x, y)| (y, x)).collect();
        let mut swapped = swapped;
        swapped.sort_unstable();
        prop_assert_eq!(&swapped, &expected);
        // The first, with and without a hint, that may be any face.
        let mut random = Random::new(seed);
        let hint = (a.any_face(&mut random).0, b.any_face(&mut random).0);
        for hint in [None, Some(hint), expected.first().copied()] {
            let (first, ending, _) = first_pair(&a.surface(), &placed, u32::MAX, hint);
            prop_assert!(ending.is_complete());
            prop_assert_eq!(first.is_some(), !expected.is_empty());
            let is_expected = |pair: FacePair| expected.binary_search(&(pair.a, pair.b)).is_ok();
        prop_assert!(first.is_none_or(is_expected));
        }
    }

    /// Any budget and any output gives a part of the pairs, and says that it is a part.
    #[test]
    fn a_spent_budget_and_a_full_output_say_so(
        seed in any::<u64>(),
        budget in 0u32..3000,
        room in 0usize..200,
    ) {
        let Scene { a, b, b_to_a } = Scene::new(seed);
        let placed = Placed { body: b.surface(), to_query: b_to_a };
        let expected = brute_pairs(&a.faces, &moved(&b, &b_to_a));
        let mut out = vec![FacePair::NONE; room];
        let answer = all_pairs(&a.surface(), &placed, budget, &mut out);
        let part = pairs_of(&out[..answer.count]);
        prop_assert!(part.iter().all(|pair| expected.binary_search(pair).is_ok()));
        prop_assert!(answer.work.node_pairs <= budget);
        match answer.ending {
            Ending::Complete => prop_assert_eq!(&part, &expected),
            Ending::Stopped { .. } => prop_assert!(answer.count == room && room < expected.len()),
            Ending::OutOfBudget { unvisited } => {
                prop_assert!(unvisited > 0 && answer.work.node_pairs == budget);
            }
        }
        prop_assert!(out[answer.count..].iter().all(|pair| *pair == FacePair::NONE));
    }

    /// The whole scene a million diagonals away, and in units in any unit: the same pairs.
    #[test]
    fn place_and_units_do_not_matter(seed in any::<u64>(), exponent in -6..=6i32) {
        let Scene { a, b, b_to_a } = Scene::new(seed);
        let mut random = Random::new(seed);
        let far = random.vector().normalize() * 1e6 * a.diagonal();
        let a_to_world = frame(far, DQuat::IDENTITY, 1.0);
        // The same relative pose by way of the world: rounding of 1e6 diagonals is left.
        let corner = b_to_a.point(DVec3::ZERO);
        let turn = DQuat::from_mat3(&glam::DMat3::from_cols(
            b_to_a.vector(DVec3::X) / b_to_a.scale(),
            b_to_a.vector(DVec3::Y) / b_to_a.scale(),
            b_to_a.vector(DVec3::Z) / b_to_a.scale(),
        ));
        let b_to_world = frame(far + corner, turn, b_to_a.scale());
        let relative = Similarity::relative(&a_to_world, &b_to_world).expect("good frames");
        let probe = b.faces[0].1[0];
        let moved = relative.point(probe).distance(b_to_a.point(probe));
        prop_assert!(moved <= 1e-9 * a.diagonal(), "moved by {}", moved / a.diagonal());
        // A tool in units of a power of two meets the same faces.
        let s = 2f64.powi(exponent * 3);
        let mut tool = Tool::new(&scaled(&b.as_mesh(), s)).expect("a front is a tool");
        tool.place(&frame(corner, turn, b_to_a.scale() / s));
        let mut plain = Tool::new(&b.as_mesh()).expect("a front is a tool");
        plain.place(&frame(corner, turn, b_to_a.scale()));
        let pairs = found(&a.surface(), &tool);
        prop_assert_eq!(&pairs, &found(&a.surface(), &plain));
    }
}

/// A capsule or cylinder, upright or lying, meets a plate exactly when it reaches below it.
#[test]
fn tools_meet_a_plate_only_below_it() {
    let plate = Front::of_mesh(&plate_mesh(2.0, 24));
    for mesh in [
        capsule_mesh(0.25, 1.0, 24, 20),
        cylinder_mesh(0.25, 1.0, 960),
    ] {
        let mut tool = Tool::new(&mesh).expect("it is a tool");
        for height in [0.3, 1e-3, 0.0, -1e-3, -0.1] {
            for lying in [false, true] {
                let turn = if lying {
                    // A row of vertices is lowest.
                    DQuat::from_rotation_y(TAU / 4.0)
                } else {
                    DQuat::IDENTITY
                };
                tool.place(&frame(DVec3::new(0.013, 0.021, 5.0), turn, 1.0));
                let lowest = tool.vertices().fold(f64::INFINITY, |low, p| low.min(p.z));
                let lift = 5.0 - lowest + height;
                tool.place(&frame(DVec3::new(0.013, 0.021, lift), turn, 1.0));
                let meets = !found(&plate.surface(), &tool).is_empty();
                assert!(height.abs() < 1e-12 || meets == (height < 0.0), "{height}");
            }
        }
    }
}
