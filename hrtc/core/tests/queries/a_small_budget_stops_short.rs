//! Searches of a ball that are cut short: what they say is certain, only less.

use crate::common::fronts::{Front, models};
use geometry::closest_point_on_triangle;
use glam::DVec3;
use hrtc_core::contact::query::{MAX_FACES, NearFaces, swept_sphere, swept_sphere_budget};
use hrtc_core::contact::sphere_proxy::Proxy;
use hrtc_core::governor::MIN_BALL_UNITS;
use hrtc_core::record::max_or_nan;
use simulator::Random;

/// Units that every pair has in each tick.
const EVERY_TICK: u32 = MIN_BALL_UNITS as u32;

fn distances(front: &Front, point: DVec3) -> impl Iterator<Item = f64> {
    let corners = front.faces.iter().map(|&(_, corners)| corners);
    corners.map(move |t| closest_point_on_triangle(t, point).distance_squared.sqrt())
}

fn budget(random: &mut Random) -> u32 {
    [0, 3, 30, 100, 300][random.below(5) as usize]
}

#[test]
fn every_face_of_the_ball_that_is_left_is_known() {
    let mut random = Random::new(41);
    let (mut cut, mut held) = (0, 0);
    for (name, parts) in models(3000) {
        let front = Front::new(&parts, 100, &mut random);
        let mut near = NearFaces::new();
        for _ in 0..40 {
            let (_, [corner, ..]) = front.any_face(&mut random);
            let point = corner + random.vector() * front.diagonal() * 0.02;
            let asked = front.diagonal() * [0.03, 0.2][random.below(2) as usize];
            let most = budget(&mut random);
            let (is_all, work) =
                near.collect(front.surface(), (point, asked), MAX_FACES, &mut most.into());
            assert!(
                work.nodes + work.faces <= most,
                "{name}: {work:?} of {most}"
            );
            let ball = near.margin(point);
            assert!(
                ball <= asked && (is_all || ball < asked || most == 0),
                "{name}"
            );
            let inside = distances(&front, point).filter(|&d| d < ball).count();
            let mut gathered = 0;
            near.within(point, ball.max(0.0), |_, _| gathered += 1);
            assert!(
                gathered >= inside,
                "{name}: {gathered} of {inside} within {ball}"
            );
            cut += usize::from(!is_all);
            held += usize::from(!is_all && gathered > 0);
        }
    }
    assert!(
        cut > 20 && held > 5,
        "{cut} were cut short, {held} of them with faces"
    );
}

#[test]
fn a_sweep_is_free_up_to_where_it_looked() {
    let mut random = Random::new(42);
    let (mut cut, mut moved) = (0, 0);
    for (name, parts) in models(3000) {
        let front = Front::new(&parts, 100, &mut random);
        for _ in 0..40 {
            let size = front.diagonal();
            let (_, [corner, ..]) = front.any_face(&mut random);
            let start = corner + random.vector() * size * 0.1;
            let motion = corner - start + random.vector() * size * 0.02;
            let (radius, most) = (0.005 * size, budget(&mut random));
            let (hit, free, work) =
                swept_sphere_budget(front.surface(), (start, motion), radius, most);
            assert!(
                work.nodes + work.faces <= most,
                "{name}: {work:?} of {most}"
            );
            let all = swept_sphere(front.surface(), start, motion, radius).0;
            let most_free = all.map_or(1.0, |hit| hit.fraction);
            assert!(
                (0.0..=most_free).contains(&free),
                "{name}: {free} of {most_free}"
            );
            if let Some(hit) = hit {
                assert!(all == Some(hit) || hit.fraction == free, "{name}");
            }
            cut += usize::from(free < most_free);
            moved += usize::from(free < most_free && free > 0.0);
        }
    }
    assert!(
        cut > 20 && moved > 5,
        "{cut} were cut short, {moved} of them on their way"
    );
}

#[test]
fn a_ball_with_little_work_stays_out_and_comes_along() {
    let mut random = Random::new(43);
    let (mut cut, mut arrived) = (0, 0);
    for (name, parts) in models(3000) {
        let front = Front::new(&parts, 100, &mut random);
        let radius = 0.01 * front.diagonal();
        for fixed in [None, Some(40), Some(EVERY_TICK), Some(400)] {
            let (_, [corner, ..]) = front.any_face(&mut random);
            let outside = front.upper + 2.0 * radius;
            let [mut short, mut free] = [0, 1].map(|_| {
                let mut proxy = Proxy::new(radius);
                proxy.place(outside);
                proxy
            });
            let mut goal = outside;
            for tick in 0..900 {
                let to = if tick < 300 { corner } else { outside };
                goal += (to - goal).clamp_length_max(0.3 * radius);
                let most = fixed.unwrap_or_else(|| budget(&mut random));
                let advance = short.advance(front.surface(), goal, most);
                let spent = advance.work.nodes + advance.work.faces;
                // The faces that stop a ball, three, are gone through twice, whatever the work.
                assert!(spent <= most.max(24), "{name}: {spent} of {most}");
                cut += usize::from(advance.is_cut);
                // No number is no clearance.
                let nearness = distances(&front, short.position()).map(|d| -d);
                let clearance = -nearness.fold(f64::NEG_INFINITY, max_or_nan);
                let least = (1.0 - 1e-5) * radius;
                assert!(clearance > least, "{name}, tick {tick}: {clearance}");
                free.advance(front.surface(), goal, u32::MAX);
            }
            // Neither is held by anything: with what every tick has, both are where the hand is.
            let is_enough = fixed.is_some_and(|most| most >= EVERY_TICK);
            if is_enough && free.position() == goal {
                let behind = short.position().distance(goal) / radius;
                assert!(
                    behind == 0.0,
                    "{name}: {behind} radii behind with {fixed:?}"
                );
                arrived += 1;
            }
        }
    }
    assert!(cut > 500, "{cut} ticks were cut short");
    assert!(arrived > 5, "{arrived} arrived");
}
