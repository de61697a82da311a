//! Swept capsules against fronts: the first touch is that of a look at all, found by bisection, and what is known in closed
//! form at any scale.

#[path = "common/bodies.rs"]
mod bodies;
mod common;

use bodies::{Front, box_mesh, models, orientation, plate_mesh, scaled, vector};
use common::Random;
use geometry::closest_points_of_segment_and_triangle;
use glam::DVec3;
use hrtc_core::contact::query::{Capsule, Ending, swept_capsule, swept_sphere};
use proptest::prelude::*;
use spm::SpmParts;
use std::sync::OnceLock;

fn parts() -> &'static [(String, SpmParts)] {
    static PARTS: OnceLock<Vec<(String, SpmParts)>> = OnceLock::new();
    PARTS.get_or_init(|| models(1500))
}

fn front(random: &mut Random) -> Front {
    let (_, parts) = &parts()[random.below(parts().len() as u64) as usize];
    Front::new(parts, [0, 60, 97, 100][random.below(4) as usize], random)
}

/// Near the front or away from it, short, long or a ball; and where it goes, mostly to the front.
fn sweep(front: &Front, random: &mut Random) -> (Capsule, DVec3) {
    let size = front.diagonal();
    let goal = front.any_face(random).1[0];
    let away = size * [0.02, 0.2, 1.0][random.below(3) as usize];
    let start = goal + vector(random) * away;
    let half =
        vector(random).normalize_or_zero() * size * [0.0, 0.01, 0.1][random.below(3) as usize];
    let capsule = Capsule {
        axis: [start - half, start + half],
        radius: size * [0.0, 1e-4, 0.01, 0.05][random.below(4) as usize],
    };
    let motion = match random.below(4) {
        0 => vector(random) * away,
        1 => DVec3::AXES[random.below(3) as usize] * away,
        _ => (goal - start) * (0.5 + random.unit()),
    };
    (capsule, motion)
}

fn distance(capsule: Capsule, shift: DVec3, corners: [DVec3; 3]) -> f64 {
    let axis = capsule.axis.map(|end| end + shift);
    closest_points_of_segment_and_triangle(axis, corners)
        .distance_squared
        .sqrt()
}

/// When a capsule that is outside of a face touches it, and how deep it comes: the least of a convex function between
/// thirds, then the root before it between halves.
fn touch_of(capsule: Capsule, motion: DVec3, corners: [DVec3; 3]) -> (f64, f64) {
    let at = |t: f64| distance(capsule, motion * t, corners);
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..120 {
        let (one, other) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        // Where both are the same the least lies between.
        if at(one) <= at(other) {
            high = other;
        } else {
            low = one;
        }
    }
    let nearest = [0.0, 0.5 * (low + high), 1.0]
        .into_iter()
        .min_by(|a, b| at(*a).total_cmp(&at(*b)))
        .unwrap();
    let depth = capsule.radius - at(nearest);
    let (mut free, mut touched) = (0.0, nearest);
    for _ in 0..100 {
        let middle = 0.5 * (free + touched);
        if at(middle) > capsule.radius {
            free = middle;
        } else {
            touched = middle;
        }
    }
    (touched, depth)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn the_first_touch_is_that_of_all(seed in any::<u64>(), budget in 0u32..100) {
        let mut random = Random(seed);
        let front = front(&mut random);
        let slack = 1e-7 * front.diagonal();
        for _ in 0..4 {
            let (capsule, motion) = sweep(&front, &mut random);
            let mut expected = f64::INFINITY;
            let mut within_at_start = false;
            for &(_, corners) in &front.faces {
                let at_start = distance(capsule, DVec3::ZERO, corners);
                within_at_start |= at_start <= capsule.radius + slack;
                // What the whole motion is too short for.
                if at_start > capsule.radius + motion.length() {
                    continue;
                }
                let (touched, depth) = touch_of(capsule, motion, corners);
                // A face that is only grazed may be touched or not.
                if depth > slack || capsule.radius == 0.0 && depth == 0.0 {
                    expected = expected.min(touched);
                }
            }
            let answer = swept_capsule(front.surface(), capsule, motion, u32::MAX);
            prop_assert_eq!(answer.ending, Ending::Complete);
            prop_assert_eq!(answer.free, answer.touch.map_or(1.0, |touch| touch.fraction));
            let step = slack / motion.length();
            if !within_at_start {
                prop_assert!(answer.free <= expected + step, "{} {}", answer.free, expected);
            }
            if let Some(touch) = answer.touch {
                prop_assert!((0.0..1.0).contains(&touch.fraction));
                // It is a touch, and none is passed on the way.
                let corners = front.mesh.corners(touch.face);
                let found = distance(capsule, motion * touch.fraction, corners);
                prop_assert!(found <= capsule.radius + slack, "{} {}", found, capsule.radius);
                prop_assert!(((touch.on_axis - touch.on_face).length() - found).abs() <= slack);
                prop_assert!((touch.normal.length() - 1.0).abs() < 1e-9);
                prop_assert!(touch.normal.dot(motion) <= 1e-9 * motion.length() || found <= 1e-12 * front.diagonal());
            }
            let part = swept_capsule(front.surface(), capsule, motion, budget);
            prop_assert!(part.work.nodes <= budget && part.free <= answer.free);
            match part.ending {
                Ending::Complete => prop_assert_eq!(part, answer),
                ending => {
                    let Ending::OutOfBudget { unvisited } = ending else {
                        panic!("nobody stops it: {ending:?}")
                    };
                    prop_assert!(unvisited > 0);
                    prop_assert_eq!(part.work.nodes, budget);
                }
            }
        }
    }

    #[test]
    fn a_capsule_of_no_length_is_a_sphere(seed in any::<u64>()) {
        let mut random = Random(seed);
        let front = front(&mut random);
        for _ in 0..40 {
            let (capsule, motion) = sweep(&front, &mut random);
            let [start, _] = capsule.axis;
            let ball = Capsule { axis: [start; 2], ..capsule };
            let ours = swept_capsule(front.surface(), ball, motion, u32::MAX);
            let (hit, _) = swept_sphere(front.surface(), start, motion, capsule.radius);
            prop_assert_eq!(ours.touch.is_some(), hit.is_some());
            let (ours, theirs) = (ours.free, hit.map_or(1.0, |hit| hit.fraction));
            // Of faces that are touched at once, in an edge, the first of either search.
            prop_assert!((ours - theirs).abs() <= 1e-12, "{} {}", ours, theirs);
        }
    }
}

/// Upright, lying and slanting capsules fall on a plate, straight or not, at any scale.
#[test]
fn on_a_plate_it_gets_as_far_as_its_lowest_point_is_high() {
    let mut random = Random(11);
    for exponent in -6..=6 {
        let s = 10f64.powi(exponent);
        let front = Front::of_mesh(&scaled(&plate_mesh(2.0, 24), s));
        for k in 0..60 {
            let turn = orientation(&mut random);
            let half = match k % 3 {
                0 => DVec3::X * 0.3,
                1 => DVec3::Z * 0.3,
                _ => turn * DVec3::Z * 0.3,
            };
            let height = 0.05 + 0.5 * random.unit();
            let lift = half.z.abs() + 0.1 + height;
            let middle = DVec3::new(random.unit() - 0.5, random.unit() - 0.5, lift);
            let capsule = Capsule {
                axis: [(middle - half) * s, (middle + half) * s],
                radius: 0.1 * s,
            };
            let fall = 1.0 + random.unit();
            let motion = DVec3::new(random.unit() - 0.5, random.unit() - 0.5, -fall) * s;
            let answer = swept_capsule(front.surface(), capsule, motion, u32::MAX);
            let touch = answer.touch.expect("it lands");
            assert!((touch.fraction - height / fall).abs() < 1e-6, "{touch:?}");
            assert!((touch.normal - DVec3::Z).length() < 1e-6, "{touch:?}");
            assert!((touch.on_face.z / s).abs() < 1e-9, "{touch:?}");
            // From where it rests it goes along the plate, and up.
            let rest = Capsule {
                axis: capsule
                    .axis
                    .map(|end| end + motion * touch.fraction + DVec3::Z * (1e-6 * s)),
                ..capsule
            };
            for motion in [DVec3::new(0.3, 0.1, 0.0), DVec3::new(0.1, 0.0, 1.0)] {
                let answer = swept_capsule(front.surface(), rest, motion * s, u32::MAX);
                assert!(answer.touch.is_none() && answer.free == 1.0);
            }
        }
    }
}

/// An axis that slants over the edge of a box: its inner points touch inner points of the edge.
#[test]
fn on_an_edge_it_touches_with_its_side() {
    let r = 0.1;
    for exponent in -6..=6 {
        let s = 10f64.powi(exponent);
        let front = Front::of_mesh(&scaled(&box_mesh(DVec3::ONE), s));
        for across in [-0.5, 0.1, 0.7] {
            // In the plane y = across, on the line x + z = 4; the edge is at x + z = 2.
            let capsule = Capsule {
                axis: [
                    DVec3::new(0.0, across, 4.0) * s,
                    DVec3::new(3.0, across, 1.0) * s,
                ],
                radius: r * s,
            };
            let touch = swept_capsule(front.surface(), capsule, DVec3::Z * (-3.0 * s), u32::MAX)
                .touch
                .expect("the edge is in the way");
            let expected = (2.0 - r * 2f64.sqrt()) / 3.0;
            assert!((touch.fraction - expected).abs() < 1e-6, "{touch:?}");
            let edge = DVec3::new(1.0, across, 1.0);
            assert!((touch.on_face / s - edge).length() < 1e-6, "{touch:?}");
            let out = DVec3::new(1.0, 0.0, 1.0).normalize();
            assert!((touch.normal - out).length() < 1e-6, "{touch:?}");
            // ContactForecast the box it falls through.
            let beside = Capsule {
                axis: capsule.axis.map(|end| {
                    end + DVec3::Y * (1.2 * s * across.signum() + s * 0.5 * across.signum())
                }),
                ..capsule
            };
            let answer = swept_capsule(front.surface(), beside, DVec3::Z * (-3.0 * s), u32::MAX);
            assert!(answer.touch.is_none() && answer.free == 1.0);
        }
    }
}

/// What pierces a face at the start does not move; the normal is that of the face.
#[test]
fn an_axis_through_a_face_is_stopped_at_once() {
    let front = Front::of_mesh(&plate_mesh(1.0, 8));
    for radius in [0.0, 0.1] {
        let capsule = Capsule {
            axis: [DVec3::new(0.1, 0.2, -0.5), DVec3::new(0.15, 0.2, 0.5)],
            radius,
        };
        let down = DVec3::new(0.3, 0.0, -1.0);
        let answer = swept_capsule(front.surface(), capsule, down, u32::MAX);
        let touch = answer.touch.expect("it is stuck");
        assert!(touch.fraction == 0.0 && answer.free == 0.0);
        assert!((touch.normal - DVec3::Z).length() < 1e-12, "{touch:?}");
    }
}

/// What is no capsule or no motion touches nothing, and nothing is free.
#[test]
fn what_is_not_finite_is_refused() {
    let front = Front::of_mesh(&plate_mesh(1.0, 4));
    let good = Capsule {
        axis: [DVec3::Z, DVec3::Z * 2.0],
        radius: 0.1,
    };
    let refused = |capsule, motion| {
        let answer = swept_capsule(front.surface(), capsule, motion, u32::MAX);
        assert!(answer.touch.is_none() && answer.free == 0.0 && answer.work.nodes == 0);
    };
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for k in 0..3 {
            let mut no_point = DVec3::Z;
            no_point[k] = bad;
            refused(good, no_point);
            let axis = [DVec3::Z, no_point];
            refused(Capsule { axis, ..good }, -DVec3::Z);
        }
        refused(
            Capsule {
                radius: bad,
                ..good
            },
            -DVec3::Z,
        );
    }
    refused(
        Capsule {
            radius: -0.1,
            ..good
        },
        -DVec3::Z,
    );
    let answer = swept_capsule(front.surface(), good, -DVec3::Z, u32::MAX);
    assert!(answer.touch.is_some());
}
