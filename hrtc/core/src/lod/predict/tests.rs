//! Where a moving device is looked for.

use super::*;
use crate::lod::lod_controller::header;

fn lod() -> LodController {
    LodController::new(&header(&[0.0, 0.01, 0.02]), 0.0, 1.0)
}

fn still(position: DVec3, clearance: f64) -> Motion {
    Motion {
        position,
        radius: 0.01,
        clearance,
    }
}

/// Everything predicted over one round of turns, by region; true where it is to be refined.
fn round(
    predictor: &mut Predictor,
    rings: bool,
    device: DVec3,
    velocity: DVec3,
    clearance: f64,
) -> std::collections::BTreeMap<RegionKey, bool> {
    let mut all = std::collections::BTreeMap::new();
    for k in 0..TURNS {
        let position = device + velocity * k as f64;
        predictor.predict(&lod(), rings, position, still(position, clearance), |p| {
            *all.entry(p.key).or_default() |= p.refine;
        });
    }
    all
}

fn key(ring: usize, point: DVec3) -> RegionKey {
    let lod = lod();
    let ring = &lod.rings()[ring];
    RegionKey::new(ring.grid.region_of_point(point), ring.tolerance)
}

#[test]
fn a_resting_contact_refines_its_cell_and_loads_its_neighbours() {
    let centre = DVec3::splat(8.5 / 16.0);
    let all = round(
        &mut Predictor::new(&Horizons::new(1000.0)),
        false,
        centre,
        DVec3::ZERO,
        0.0,
    );
    assert_eq!(all.get(&key(0, centre)), Some(&true));
    assert_eq!(all.len(), 27);
    assert_eq!(all.values().filter(|&&refine| refine).count(), 1);
}

#[test]
fn every_ring_is_refined_at_the_contact() {
    let centre = DVec3::splat(8.5 / 16.0);
    let all = round(
        &mut Predictor::new(&Horizons::new(1000.0)),
        true,
        centre,
        DVec3::ZERO,
        0.0,
    );
    for ring in 0..3 {
        assert_eq!(all.get(&key(ring, centre)), Some(&true), "ring {ring}");
    }
    // The finest keeps its neighbours warm, a coarser ring needs none.
    assert_eq!(all.len(), 27 + 2);
}

#[test]
fn motion_loads_what_lies_ahead_and_knows_when_it_is_due() {
    let mut predictor = Predictor::new(&Horizons::new(1000.0));
    let velocity = DVec3::new(1e-3, 0.0, 0.0);
    let mut position = DVec3::splat(0.3);
    for _ in 0..20 {
        round(&mut predictor, true, position, velocity, 0.0);
        position += velocity * TURNS as f64;
    }
    let all = round(&mut predictor, true, position, velocity, 0.0);
    assert!(all.contains_key(&key(0, position + velocity * 60.0)));
    assert!(!all.contains_key(&key(0, position - velocity * 200.0)));
    let mut due = Vec::new();
    for _ in 0..TURNS {
        predictor.predict(&lod(), false, position, still(position, 0.0), |p| {
            let grid = lod().rings()[0].grid;
            due.push((grid.distance_squared(p.key.id, position).sqrt(), p.ticks));
        });
    }
    assert!(
        due.iter()
            .all(|&(distance, ticks)| distance > 0.0 || ticks == 0.0)
    );
    assert!(due.iter().any(|&(_, ticks)| ticks > 5.0));
}

/// At a lower rate a tick makes several looks.
#[test]
fn what_lies_ahead_is_looked_for_where_it_lands_at_any_rate() {
    let of_a_round = ROUND
        .iter()
        .filter(|(look, _)| matches!(look, Look::Ahead(..)));
    let of_a_round = of_a_round.count();
    for rate_hz in [250.0, 500.0, 1000.0] {
        let mut predictor = Predictor::new(&Horizons::new(rate_hz));
        let velocity = DVec3::new(1.0, 0.0, 1.0) / rate_hz;
        let mut position = DVec3::splat(0.3);
        let (mut farthest, mut landed, mut met) = (0.0f64, 0, 0);
        let rounds = 12;
        for _ in 0..rounds * TURNS * rate_hz as usize / 1000 {
            let points = predictor
                .ahead(position)
                .map(|point| point.map(|ahead| DVec3::new(ahead.x, ahead.y, 0.3)));
            predictor.project_onto_front(points);
            let mut seen = [false; TURNS];
            predictor.predict(&lod(), false, position, still(position, 0.0), |p| {
                for (seen, point) in seen.iter_mut().zip(points) {
                    *seen |= point.is_some_and(|at| p.key == key(0, at));
                }
            });
            for (seen, point) in seen.iter().zip(points) {
                landed += usize::from(point.is_some());
                met += usize::from(point.is_some() && *seen);
                farthest = point.map_or(farthest, |at| at.x.max(farthest));
            }
            position += velocity;
        }
        assert!(farthest > 0.36, "{rate_hz}: {farthest}");
        assert_eq!(met, landed, "{rate_hz}");
        // Not in the first ones, before the motion is known.
        assert!(landed >= (rounds - 8) * of_a_round, "{rate_hz}: {landed}");
    }
}

#[test]
fn a_hand_that_stops_keeps_what_it_may_turn_to_loaded_as_far_as_the_link_is() {
    let stopped = |lead: f64| {
        let mut predictor = Predictor::new(&Horizons::new(1000.0));
        predictor.set_lead(lead);
        let velocity = DVec3::new(1e-3, 0.0, 0.0);
        let mut position = DVec3::new(0.3, 0.5, 0.5);
        for _ in 0..10 {
            round(&mut predictor, false, position, velocity, 0.0);
            position += velocity * TURNS as f64;
        }
        for _ in 0..5 {
            round(&mut predictor, false, position, DVec3::ZERO, 0.0);
        }
        let all = round(&mut predictor, false, position, DVec3::ZERO, 0.0);
        all.contains_key(&key(0, position + DVec3::Y * 0.14))
    };
    assert!(stopped(200.0) && !stopped(0.0));
}

/// What a ball touches is a radius away from its centre: two cells of a ring are as far as a look
/// goes.
#[test]
fn a_ball_wider_than_cells_refines_where_it_touches_and_another_around_its_centre() {
    let cell = 1.0 / 16.0;
    let centre = DVec3::splat(8.5) * cell;
    let round_of = |radius: f64, touched: [Option<DVec3>; MAX_PUSHING]| {
        let mut predictor = Predictor::new(&Horizons::new(1000.0));
        predictor.set_touched(touched);
        let motion = Motion {
            position: centre,
            radius,
            clearance: radius,
        };
        let mut all = std::collections::BTreeMap::new();
        for _ in 0..TURNS {
            predictor.predict(&lod(), true, centre, motion, |p| {
                *all.entry(p.key).or_insert(false) |= p.refine;
            });
        }
        all
    };
    let is_refined = |all: &std::collections::BTreeMap<RegionKey, bool>, place: DVec3| {
        all.get(&key(0, place)).copied().unwrap_or_default()
    };
    for cells in [0.16, 1.0, 1.3] {
        let mut touched = [None; MAX_PUSHING];
        touched[0] = Some(centre - DVec3::Z * (cells * cell));
        let narrow = round_of(cells * cell, touched);
        assert_eq!(narrow, round_of(cells * cell, [None; MAX_PUSHING]));
        assert!(is_refined(&narrow, centre), "{cells}");
    }
    for cells in [3.0, 5.0] {
        let mut touched = [None; MAX_PUSHING];
        let places = [-DVec3::Z, DVec3::X].map(|out| centre + out * (cells * cell));
        (touched[0], touched[1]) = (Some(places[0]), Some(places[1]));
        let wide = round_of(cells * cell, touched);
        let from_centre = round_of(cells * cell, [None; MAX_PUSHING]);
        for place in places {
            assert!(is_refined(&wide, place), "{cells}");
            assert!(!is_refined(&from_centre, place), "{cells}");
        }
        // Nor what is as far and is not touched.
        assert!(!is_refined(&wide, centre + DVec3::Y * (cells * cell)));
    }
}

#[test]
fn far_from_any_surface_nothing_is_predicted() {
    let centre = DVec3::splat(0.5);
    assert!(
        round(
            &mut Predictor::new(&Horizons::new(1000.0)),
            true,
            centre,
            DVec3::ZERO,
            0.5
        )
        .is_empty()
    );
}

#[test]
fn any_speed_visits_a_bounded_number_of_regions() {
    let mut predictor = Predictor::new(&Horizons::new(1000.0));
    for k in 0..200 {
        let p = DVec3::splat(if k % 2 == 0 { -1e6 } else { 1e6 });
        let mut count = 0;
        predictor.predict(&lod(), true, p, still(DVec3::splat(0.5), 0.0), |_| {
            count += 1;
        });
        assert!(count <= 250);
    }
}
