//! Two bodies, each a refined front or a tool, under any poses and scales: pairs that meet, closest features and
//! depths are those of a look at all faces, whichever side is asked.

#[path = "common/bodies.rs"]
mod bodies;
mod common;

use bodies::{Front, box_mesh, frame, models, orientation, plate_mesh, scaled, vector};
use common::Random;
use geometry::{
    ClosestPair, Similarity, closest_point_on_triangle, closest_points_of_triangles,
    least_distance_squared_of_triangles, solid_angle, triangle_pair,
};
use glam::{DQuat, DVec3};
use hrtc_core::contact::query::{
    Body, Ending, FacePair, Placed, all_pairs, closest_features, deepest_sample, first_pair,
    local_depth,
};
use hrtc_core::contact::tool::{Tool, capsule_mesh, cylinder_mesh};
use proptest::prelude::*;
use spm::{Handle, NONE, SpmParts};
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

fn brute_closest(a: &[(Handle, [DVec3; 3])], b: &[(Handle, [DVec3; 3])]) -> f64 {
    let mut best = ClosestPair::NONE;
    for &(_, s) in a {
        for &(_, t) in b {
            if least_distance_squared_of_triangles(s, t) < best.distance_squared {
                let closest = closest_points_of_triangles(s, t);
                if closest.distance_squared < best.distance_squared {
                    best = closest;
                }
            }
        }
    }
    best.distance_squared.sqrt()
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

/// Whether faces without a corner in common meet.
fn crosses_itself(front: &Front) -> bool {
    let corners = |face: Handle| front.mesh.face(face).corners;
    front.faces.iter().enumerate().any(|(k, &(x, s))| {
        front.faces[..k].iter().any(|&(y, t)| {
            !corners(x).iter().any(|v| corners(y).contains(v)) && triangle_pair(s, t).meets()
        })
    })
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
        let mut random = Random(seed);
        let mut front = || {
            let (_, parts) = &parts()[random.below(parts().len() as u64) as usize];
            let chance = [0, 60, 97, 100][random.below(4) as usize];
            Front::new(parts, chance, &mut random)
        };
        let (a, b) = (front(), front());
        let turn = orientation(&mut random);
        // From a tenth to all of the other's size, with a face of it near a face of the other.
        let scale = a.diagonal() / b.diagonal() * 10f64.powf(-random.unit());
        let on_a = a.any_face(&mut random).1[0];
        let on_b = frame(DVec3::ZERO, turn, scale).point(b.any_face(&mut random).1[0]);
        let off = vector(&mut random) * a.diagonal() * [0.0, 0.01, 0.3][random.below(3) as usize];
        let b_to_a = frame(on_a - on_b + off, turn, scale);
        Self { a, b, b_to_a }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    /// Exactly the pairs of the look at all, by boxes moved as they are met and by a tool moved before.
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
        let mut random = Random(seed);
        let hint = (a.any_face(&mut random).0, b.any_face(&mut random).0);
        for hint in [None, Some(hint), expected.first().copied()] {
            let (first, ending, _) = first_pair(&a.surface(), &placed, u32::MAX, hint);
            prop_assert!(ending.is_complete());
            prop_assert_eq!(first.is_some(), !expected.is_empty());
            prop_assert!(first.is_none_or(|pair| expected.binary_search(&(pair.a, pair.b)).is_ok()));
        }
    }

    /// Any budget and any output gives a part of the pairs, and says that it is a part.
    #[test]
    fn a_spent_budget_and_a_full_output_say_so(seed in any::<u64>(), budget in 0u32..3000, room in 0usize..200) {
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

    /// The distance of the look at all, its points on their faces; a bound from below whatever the budget.
    #[test]
    fn closest_features_are_those_of_all_faces(seed in any::<u64>(), budget in 0u32..2000) {
        let Scene { a, b, b_to_a } = Scene::new(seed);
        let of_b = moved(&b, &b_to_a);
        let expected = brute_closest(&a.faces, &of_b);
        let size = a.diagonal();
        let rounding = 1e-12 * size;
        let placed = Placed { body: b.surface(), to_query: b_to_a };
        let mut random = Random(seed);
        let any_hint = (a.any_face(&mut random).0, b.any_face(&mut random).0);
        for hint in [None, Some(any_hint)] {
            let answer = closest_features(&a.surface(), &placed, f64::INFINITY, u32::MAX, hint);
            let nearest = answer.nearest.expect("both have faces");
            let distance = nearest.closest.distance_squared.sqrt();
            prop_assert!((distance - expected).abs() <= rounding, "{} {}", distance, expected);
            prop_assert_eq!(distance == 0.0, expected == 0.0);
            prop_assert!(answer.ending.is_complete() && (answer.at_least - distance).abs() <= rounding);
            let faces = [a.mesh.corners(nearest.a), placed.corners(nearest.b)];
            for (point, t) in nearest.closest.points.iter().zip(faces) {
                prop_assert!(closest_point_on_triangle(t, *point).distance_squared.sqrt() <= rounding);
            }
            // Within a margin, or not at all.
            for margin in [0.5 * expected, 2.0 * expected] {
                let answer = closest_features(&a.surface(), &placed, margin, u32::MAX, hint);
                let within = answer.nearest.map(|n| n.closest.distance_squared.sqrt());
                let expected_within = (margin > 0.75 * expected || expected == 0.0).then_some(distance);
                prop_assert_eq!(within.is_some(), expected_within.is_some());
                prop_assert!(answer.at_least <= expected + rounding);
            }
            let part = closest_features(&a.surface(), &placed, f64::INFINITY, budget, hint);
            prop_assert!(part.at_least <= expected + rounding);
            prop_assert!(part.work.node_pairs <= budget);
            if let Some(nearest) = part.nearest {
                prop_assert!(nearest.closest.distance_squared.sqrt() >= expected - rounding);
            }
            prop_assert!(!part.ending.is_complete() || (part.at_least - expected).abs() <= rounding);
        }
        let swapped = closest_features(&placed, &a.surface(), f64::INFINITY, u32::MAX, None);
        prop_assert!((swapped.at_least - expected).abs() <= rounding);
    }

    /// The vertex of a tool that is deepest in a closed front that does not cross itself is that of all vertices, inside told by the winding.
    #[test]
    fn the_deepest_sample_is_that_of_all_vertices(seed in any::<u64>(), budget in 0u32..3000) {
        let mut random = Random(seed);
        let closed = |(_, parts): &&(String, SpmParts)| {
            parts.base_faces.iter().all(|face| !face.neighbours.contains(&NONE))
        };
        let closed: Vec<_> = parts().iter().filter(closed).collect();
        let (_, parts) = closed[random.below(closed.len() as u64) as usize];
        let a = Front::new(parts, [0, 97, 100][random.below(3) as usize], &mut random);
        // A coarse front may cross itself: then sides are those of its sheets, and inside is not one thing.
        prop_assume!(!crosses_itself(&a));
        let size = a.diagonal();
        let mesh = capsule_mesh(0.05 * size, 0.3 * size, 10, 6);
        let mut tool = Tool::new(&mesh).expect("a capsule is a tool");
        let at = a.any_face(&mut random).1[0] + vector(&mut random) * size * 0.1;
        tool.place(&frame(at, orientation(&mut random), 1.0));
        let mut expected = 0.0f64;
        for p in tool.vertices() {
            let turns: f64 = a.faces.iter().map(|&(_, t)| solid_angle(t, p)).sum();
            if turns.abs() > TAU {
                let distance = |&(_, t): &(Handle, [DVec3; 3])| closest_point_on_triangle(t, p).distance_squared;
                let nearest = a.faces.iter().map(distance).fold(f64::INFINITY, f64::min);
                expected = expected.max(nearest.sqrt());
            }
        }
        let rounding = 1e-12 * size;
        let hint = random.below(u64::from(tool.faces())) as u32;
        for hint in [None, Some(hint)] {
            let answer = deepest_sample(a.surface(), &tool, u32::MAX, hint);
            let depth = answer.deepest.map_or(0.0, |deep| deep.depth);
            prop_assert!((depth - expected).abs() <= rounding, "{} {}", depth, expected);
            prop_assert!(answer.ending.is_complete() && answer.at_most == depth);
            if let Some(deep) = answer.deepest {
                prop_assert!(tool.corners(deep.face).contains(&deep.sample));
                prop_assert!((deep.sample.distance(deep.nearest.closest.point) - depth).abs() <= rounding);
            }
            let part = deepest_sample(a.surface(), &tool, budget, hint);
            prop_assert!(part.at_most >= expected - rounding);
            prop_assert!(part.deepest.map_or(0.0, |deep| deep.depth) <= expected + rounding);
        }
    }

    /// The whole scene a million diagonals away, and in units from 1e-6 to 1e6: the same pairs, the same distance.
    #[test]
    fn place_and_units_do_not_matter(seed in any::<u64>(), exponent in -6..=6i32) {
        let Scene { a, b, b_to_a } = Scene::new(seed);
        let mut random = Random(seed);
        let far = vector(&mut random).normalize() * 1e6 * a.diagonal();
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
        let distance = |to_query| {
            let placed = Placed { body: b.surface(), to_query };
            closest_features(&a.surface(), &placed, f64::INFINITY, u32::MAX, None).at_least
        };
        let (near, far_off) = (distance(b_to_a), distance(relative));
        prop_assert!((near - far_off).abs() <= 1e-8 * a.diagonal());
        // A tool in other units is the same tool.
        let s = 10f64.powi(exponent);
        let in_units = scaled(&b.as_mesh(), s);
        let mut tool = Tool::new(&in_units).expect("a front is a tool");
        let to_a = frame(corner, turn, b_to_a.scale() / s);
        tool.place(&to_a);
        let by_tool = closest_features(&a.surface(), &tool, f64::INFINITY, u32::MAX, None).at_least;
        prop_assert!((near - by_tool).abs() <= 1e-11 * a.diagonal());
        // And in units of a power of two, to the bit.
        let s = 2f64.powi(exponent * 3);
        let mut tool = Tool::new(&scaled(&b.as_mesh(), s)).expect("a front is a tool");
        tool.place(&frame(corner, turn, b_to_a.scale() / s));
        let mut plain = Tool::new(&b.as_mesh()).expect("a front is a tool");
        plain.place(&frame(corner, turn, b_to_a.scale()));
        let pairs = found(&a.surface(), &tool);
        prop_assert_eq!(&pairs, &found(&a.surface(), &plain));
    }
}

/// Distances of meshes that stand for spheres: centres less radii, within the error of the meshes.
#[test]
fn spheres_are_as_far_as_their_centres_less_their_radii() {
    let sphere = capsule_mesh(1.0, 2.0, 64, 64);
    // The mesh is inside the sphere by less than this.
    let sagitta = 1.0 - (TAU / 128.0).cos().powi(2);
    let a = Front::of_mesh(&sphere);
    let mut b = Tool::new(&scaled(&sphere, 0.5)).expect("a sphere is a tool");
    let mut random = Random(5);
    for k in 0..60 {
        let gap = [1e-3, 0.1, 3.0, -0.2][k % 4];
        let way = vector(&mut random).normalize();
        b.place(&frame(way * (1.5 + gap), orientation(&mut random), 1.0));
        let answer = closest_features(&a.surface(), &b, f64::INFINITY, u32::MAX, None);
        let meets = !found(&a.surface(), &b).is_empty();
        if gap < 0.0 {
            assert!(meets && answer.at_least == 0.0);
            let deepest = deepest_sample(a.surface(), &b, u32::MAX, None);
            let depth = deepest.deepest.expect("it is in").depth;
            assert!(
                depth <= -gap + 1e-6 && depth >= -gap - 0.06,
                "{depth} {gap}"
            );
        } else {
            assert!(!meets || gap < 1e-2, "{gap}");
            let off = answer.at_least - gap;
            assert!(off > -1e-6 && off < 2.0 * sagitta, "{off} {sagitta}");
            let deepest = deepest_sample(a.surface(), &b, u32::MAX, None);
            assert!(deepest.deepest.is_none() && deepest.at_most == 0.0);
        }
    }
    // Inside: the surfaces do not meet, and the depth tells it.
    b.place(&frame(DVec3::X * 0.3, DQuat::IDENTITY, 1.0));
    assert!(found(&a.surface(), &b).is_empty());
    let deepest = deepest_sample(a.surface(), &b, u32::MAX, None);
    let depth = deepest.deepest.expect("it is inside").depth;
    assert!((depth - 0.8).abs() < 1e-2, "{depth}");
}

/// Boxes side by side, and a corner in a face.
#[test]
fn boxes_are_as_far_as_their_sides() {
    let a = Front::of_mesh(&box_mesh(DVec3::new(1.0, 2.0, 3.0)));
    let mut b = Tool::new(&box_mesh(DVec3::ONE)).expect("a box is a tool");
    for (x, expected) in [(2.5, 0.5), (2.0, 0.0), (1.75, 0.0)] {
        b.place(&frame(DVec3::X * x, DQuat::IDENTITY, 1.0));
        let answer = closest_features(&a.surface(), &b, 10.0, u32::MAX, None);
        assert!((answer.at_least - expected).abs() < 1e-12);
        assert_eq!(found(&a.surface(), &b).is_empty(), expected > 0.0);
        let deepest = deepest_sample(a.surface(), &b, u32::MAX, None).deepest;
        let depth = deepest.map_or(0.0, |deep| deep.depth);
        assert!((depth - (2.0 - x).max(0.0)).abs() < 1e-12, "{depth}");
    }
    // The corner of a cube on its tip, 0.125 deep in the face at x = 1.
    let tip = DQuat::from_rotation_arc(DVec3::ONE.normalize(), DVec3::NEG_X);
    b.place(&frame(DVec3::X * (1.0 - 0.125 + 3f64.sqrt()), tip, 1.0));
    let deepest = deepest_sample(a.surface(), &b, u32::MAX, None);
    let depth = deepest.deepest.expect("the tip is in").depth;
    assert!((depth - 0.125).abs() < 1e-12, "{depth}");
    let (local, ending, _) = local_depth(&a.surface(), &b, u32::MAX);
    assert!(ending.is_complete());
    let (_, local) = local.expect("the tip crosses the face");
    assert!((local.depth - 0.125).abs() < 1e-12, "{}", local.depth);
    assert!(local.direction.distance(DVec3::X) < 1e-12);
}

/// A capsule or cylinder over, on and in a plate, upright and lying.
#[test]
fn tools_over_a_plate_are_as_high_as_they_are() {
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
                let answer = closest_features(&plate.surface(), &tool, 1.0, u32::MAX, None);
                let deepest = deepest_sample(plate.surface(), &tool, u32::MAX, None);
                let depth = deepest.deepest.map_or(0.0, |deep| deep.depth);
                assert!((answer.at_least - height.max(0.0)).abs() < 1e-12);
                assert!(
                    (depth - (-height).max(0.0)).abs() < 1e-12,
                    "{depth} {height}"
                );
                let meets = !found(&plate.surface(), &tool).is_empty();
                assert!(height.abs() < 1e-12 || meets == (height < 0.0), "{height}");
            }
        }
    }
}
