//! A split may leave a ball a little inside of several faces at once: it comes out of all of them,
//! and slides on over their edge.

use crate::common::fronts::{Front, box_mesh};
use geometry::closest_point_on_triangle;
use glam::DVec3;
use hrtc_core::contact::sphere_proxy::Proxy;
use simulator::Random;

/// Radius of the ball; the box has sides of 2.
const RADIUS: f64 = 0.1;
/// By how much it is inside, in radii: twice as far as an imperceptible split left it in
/// `rt-tests simulate --seeds 678..679`.
const MOST_INSIDE: f64 = 4e-3;
/// Ticks in which it comes to where it can.
const TICKS: usize = 10;

fn distance(front: &Front, place: DVec3) -> f64 {
    let distances = front.faces.iter().map(|(_, corners)| {
        closest_point_on_triangle(*corners, place)
            .distance_squared
            .sqrt()
    });
    distances.fold(f64::INFINITY, f64::min)
}

#[test]
fn out_of_both_faces_and_over_the_edge() {
    let front = Front::of_mesh(&box_mesh(DVec3::ONE));
    let mut random = Random::new(678);
    for run in 0..500 {
        // From less than the skin of the sweep on.
        let inside = MOST_INSIDE * RADIUS * 10f64.powf(-5.0 * random.unit());
        // Over the upper face, so near its edge that the face beyond is nearer than the radius.
        let height = RADIUS - inside;
        let aside = (RADIUS * RADIUS - height * height).sqrt() * random.unit();
        let along = 0.5 * random.unit();
        let start = DVec3::new(1.0 - aside, along, 1.0 + height);
        let mut proxy = Proxy::new(RADIUS);
        proxy.place(start);
        // Outside of the face beyond, below the edge.
        let goal = DVec3::new(
            1.0 + 0.5 * RADIUS,
            along,
            1.0 - 0.5 * RADIUS * random.unit(),
        );
        for _ in 0..TICKS {
            proxy.advance(front.surface(), goal, u32::MAX);
        }
        let clearance = distance(&front, proxy.position()) / RADIUS;
        assert!(
            clearance > 1.0 - 1e-5,
            "run {run}: {clearance} radii from the surface"
        );
        // Where the ball touches the face beyond.
        let there = DVec3::new(1.0 + RADIUS, along, goal.z.min(1.0));
        let missing = proxy.position().distance(there) / RADIUS;
        assert!(missing < 1e-3, "run {run}: {missing} radii from {there}");
    }
}
