//! What is gathered around a point: every face of the ball, of the largest ball that fits, in any
//! front; and where there are more than fit, what it costs does not grow with the ball that was
//! asked for.

use crate::common::fronts::{Front, models};
use geometry::closest_point_on_triangle;
use hrtc_core::contact::query::{MAX_FACES, NearFaces};
use simulator::Random;

#[test]
fn every_face_of_the_ball_is_gathered_and_the_ball_is_the_largest_that_fits() {
    let mut random = Random::new(31);
    for (name, parts) in models(3000) {
        for chance in [0, 70, 100] {
            let front = Front::new(&parts, chance, &mut random);
            let mut near = NearFaces::new();
            for k in 0..20 {
                let (_, [corner, ..]) = front.any_face(&mut random);
                let point = corner + random.vector() * front.diagonal() * 0.01;
                let asked = front.diagonal() * [0.003, 0.03, 0.3, 2.0][k % 4];
                let (is_all, _) = near.collect(
                    front.surface(),
                    (point, asked),
                    MAX_FACES,
                    &mut u32::MAX.into(),
                );
                assert!(is_all);
                let ball = near.margin(point);
                assert!(ball <= asked, "{name}");

                let mut distances: Vec<f64> = front
                    .faces
                    .iter()
                    .map(|&(_, t)| closest_point_on_triangle(t, point).distance_squared.sqrt())
                    .collect();
                distances.sort_unstable_by(f64::total_cmp);
                let inside = |radius: f64| distances.partition_point(|&d| d < radius);
                if inside(asked) <= MAX_FACES {
                    assert_eq!(ball, asked, "{name}: all of the ball fits");
                } else {
                    assert_eq!(
                        ball, distances[MAX_FACES],
                        "{name}: up to the first face that does not fit"
                    );
                }
                let mut gathered = 0;
                near.within(point, ball, |_, _| gathered += 1);
                assert!(
                    gathered >= inside(ball),
                    "{name}: {gathered} of {}",
                    inside(ball)
                );
            }
        }
    }
}

#[test]
fn a_ball_of_everything_costs_little_more_than_what_fits() {
    let mut random = Random::new(32);
    let (_, parts) = models(20_000).swap_remove(0);
    let front = Front::new(&parts, 100, &mut random);
    let mut near = NearFaces::new();
    for _ in 0..50 {
        let (_, [corner, ..]) = front.any_face(&mut random);
        let asked = 2.0 * front.diagonal();
        let (_, work) = near.collect(
            front.surface(),
            (corner, asked),
            MAX_FACES,
            &mut u32::MAX.into(),
        );
        // Without an order every one of the faces would be tested.
        let most = 8 * MAX_FACES as u32;
        assert!(
            work.nodes + work.faces < most,
            "{work:?} of {} faces",
            front.faces.len()
        );
    }
}
