//! Segments and capsules against fronts: the closest face and all faces within a distance are those of a look at all.

#[path = "common/bodies.rs"]
mod bodies;
mod common;

use bodies::{Front, models, orientation, plate_mesh, vector};
use common::Random;
use geometry::{closest_point_on_triangle, closest_points_of_segment_and_triangle};
use glam::{DQuat, DVec3};
use hrtc_core::contact::query::{
    Capsule, Ending, closest_to_capsule, closest_to_segment, faces_near_capsule, faces_near_segment,
};
use proptest::prelude::*;
use spm::{Handle, SpmParts};
use std::ops::ControlFlow;
use std::sync::OnceLock;

fn parts() -> &'static [(String, SpmParts)] {
    static PARTS: OnceLock<Vec<(String, SpmParts)>> = OnceLock::new();
    PARTS.get_or_init(|| models(2000))
}

fn front(random: &mut Random) -> Front {
    let (_, parts) = &parts()[random.below(parts().len() as u64) as usize];
    Front::new(parts, [0, 60, 97, 100][random.below(4) as usize], random)
}

/// Near the front or anywhere, short, long or a point, slanting or along an axis.
fn segment(front: &Front, random: &mut Random) -> [DVec3; 2] {
    let size = front.diagonal();
    let start = match random.below(3) {
        0 => front.lower.lerp(front.upper, 0.5) + vector(random) * size,
        1 => front.any_face(random).1[0],
        _ => front.any_face(random).1[1] + vector(random) * size * 0.02,
    };
    let length = size * [0.0, 0.01, 0.1, 1.0][random.below(4) as usize];
    let way = match random.below(3) {
        0 => DVec3::AXES[random.below(3) as usize],
        _ => vector(random).normalize_or_zero(),
    };
    [start, start + way * length]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn the_closest_face_to_a_segment_is_that_of_all(seed in any::<u64>(), budget in 0u32..200) {
        let mut random = Random(seed);
        let front = front(&mut random);
        let rounding = 1e-12 * front.diagonal();
        for _ in 0..10 {
            let segment = segment(&front, &mut random);
            let distance = |&(_, t): &(Handle, [DVec3; 3])| {
                closest_points_of_segment_and_triangle(segment, t).distance_squared
            };
            let expected = front.faces.iter().map(distance).fold(f64::INFINITY, f64::min).sqrt();
            let hint = front.any_face(&mut random).0;
            for hint in [None, Some(hint)] {
                let answer = closest_to_segment(front.surface(), segment, u32::MAX, hint);
                let nearest = answer.nearest.expect("the front has faces");
                let found = nearest.closest.distance_squared.sqrt();
                prop_assert!((found - expected).abs() <= rounding, "{} {}", found, expected);
                prop_assert_eq!(found == 0.0, expected == 0.0);
                prop_assert!(answer.ending == Ending::Complete && (answer.at_least - found).abs() <= rounding);
                let on_face = closest_point_on_triangle(front.mesh.corners(nearest.face), nearest.closest.points[1]);
                prop_assert!(on_face.distance_squared.sqrt() <= rounding);
                let part = closest_to_segment(front.surface(), segment, budget, hint);
                prop_assert!(part.work.nodes <= budget && part.at_least <= expected + rounding);
                prop_assert!(part.ending != Ending::Complete || (part.at_least - expected).abs() <= rounding);
                let capsule = Capsule { axis: segment, radius: 0.03 };
                let of_capsule = closest_to_capsule(front.surface(), capsule, u32::MAX, hint);
                let contact = of_capsule.contact.expect("the front has faces");
                prop_assert_eq!(contact.face, nearest.face);
                prop_assert!((contact.distance - (found - 0.03)).abs() <= rounding);
            }
        }
    }

    #[test]
    fn faces_near_a_capsule_are_those_of_all(seed in any::<u64>(), budget in 0u32..200) {
        let mut random = Random(seed);
        let front = front(&mut random);
        for _ in 0..10 {
            let axis = segment(&front, &mut random);
            let radius = front.diagonal() * 0.1 * random.unit();
            let margin = radius * (random.unit() - 0.5);
            let reach = radius + margin;
            let near = |&&(_, t): &&(Handle, [DVec3; 3])| {
                closest_points_of_segment_and_triangle(axis, t).distance_squared <= reach * reach
            };
            let mut expected: Vec<Handle> = front.faces.iter().filter(near).map(|f| f.0).collect();
            expected.sort_unstable();
            let capsule = Capsule { axis, radius };
            let mut found = Vec::new();
            let (ending, work) = faces_near_capsule(front.surface(), capsule, margin, u32::MAX, |contact| {
                found.push(contact.face);
                ControlFlow::Continue(())
            });
            found.sort_unstable();
            prop_assert_eq!(&found, &expected);
            prop_assert!(ending == Ending::Complete && work.faces as usize >= found.len());
            let mut part = Vec::new();
            let (ending, work) = faces_near_capsule(front.surface(), capsule, margin, budget, |contact| {
                part.push(contact.face);
                if part.len() == 5 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            });
            prop_assert!(work.nodes <= budget && part.len() <= 5);
            prop_assert!(part.iter().all(|face| expected.binary_search(face).is_ok()));
            match ending {
                Ending::Complete => prop_assert_eq!(part.len(), expected.len()),
                Ending::Stopped { .. } => prop_assert_eq!(part.len(), 5),
                Ending::OutOfBudget { unvisited } => prop_assert!(unvisited > 0 && work.nodes == budget),
            }
        }
    }
}

/// A capsule over a plate: its height, lying, upright and slanting, at any scale.
#[test]
fn a_capsule_over_a_plate_is_as_high_as_it_is() {
    let mut random = Random(9);
    for exponent in -6..=6 {
        let s = 10f64.powi(exponent);
        let mut mesh = plate_mesh(2.0, 24);
        mesh.positions.iter_mut().for_each(|p| *p *= s);
        let plate = Front::of_mesh(&mesh);
        for _ in 0..50 {
            let turn: DQuat = orientation(&mut random);
            let half = turn * DVec3::Z * 0.3;
            let height = 0.5 * random.unit() - 0.1;
            let lift = half.z.abs() + 0.1 + height;
            let middle = DVec3::new(random.unit() - 0.5, random.unit() - 0.5, lift);
            let capsule = Capsule {
                axis: [(middle - half) * s, (middle + half) * s],
                radius: 0.1 * s,
            };
            let found = closest_to_capsule(plate.surface(), capsule, u32::MAX, None);
            let contact = found.contact.expect("the plate is there");
            assert!(
                (contact.distance / s - height).abs() < 1e-6,
                "{}",
                contact.distance
            );
            assert!((contact.on_face.z / s).abs() < 1e-12);
        }
    }
}

/// What is no segment has no answer, and no face is near it.
#[test]
fn what_is_not_finite_is_refused() {
    let plate = Front::of_mesh(&plate_mesh(1.0, 4));
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for axis in 0..3 {
            let mut end = DVec3::Z;
            end[axis] = bad;
            let segment = [DVec3::ZERO, end];
            let answer = closest_to_segment(plate.surface(), segment, u32::MAX, None);
            assert!(answer.nearest.is_none() && answer.at_least == 0.0);
            let mut count = 0;
            let visit = |_| {
                count += 1;
                ControlFlow::Continue(())
            };
            let (ending, _) = faces_near_segment(plate.surface(), segment, 10.0, u32::MAX, visit);
            assert!(ending == Ending::Complete && count == 0);
        }
    }
    for distance in [f64::NAN, -1.0] {
        let segment = [DVec3::ZERO, DVec3::Z];
        let (_, work) = faces_near_segment(plate.surface(), segment, distance, 100, |near| {
            panic!("nothing is at {distance}: {near:?}")
        });
        assert_eq!(work.faces, 0);
    }
}
