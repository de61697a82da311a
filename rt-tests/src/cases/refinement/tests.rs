use super::*;
use rand::SeedableRng;

/// The direction of a press in the run of a seed.
fn direction_of(seed: u64, press: u64) -> DVec3 {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    (0..press).for_each(|_| _ = direction(&mut random));
    direction(&mut random)
}

/// As it was when these were found.
const WITHOUT_ACCOUNT: Setup = Setup {
    departs: &[(Departure::Account, ALONE)],
    ..Setup::PRODUCT
};

fn is_not_felt(presses: &[(u64, u64)]) {
    is_not_felt_in(WITHOUT_ACCOUNT, false, presses);
}

fn is_not_felt_by_a_tool(presses: &[(u64, u64)]) {
    is_not_felt_in(WITHOUT_ACCOUNT.with_tool(), false, presses);
}

/// `is_in_hand`: of a rough body, by a device in a hand.
fn is_not_felt_in(setup: Setup, is_in_hand: bool, presses: &[(u64, u64)]) {
    let bodies = bodies().unwrap();
    for &(seed, k) in presses {
        let mut found = Found::new(0.0);
        let how = Press {
            coarse_m: coarse(if is_in_hand { k / 4 } else { k }),
            is_late: !is_in_hand && k % 2 == 1,
            is_rough: is_in_hand,
            is_in_hand,
        };
        let (bytes, up) = (&bodies[usize::from(is_in_hand)], direction_of(seed, k));
        refined_and_back(bytes, setup, how, up, &mut found).unwrap();
        assert!(found.value <= 1.0, "{seed}, {k}: {}", found.value);
    }
}

/// Its motion was allowed to the probe as well.
#[test]
fn a_hand_that_gives_way_is_no_reason_to_go_farther() {
    for (rate_hz, seed) in [(500.0, 4), (500.0, 5), (2000.0, 3)] {
        let mut setup = Setup::at_rate(rate_hz);
        setup.departs = WITHOUT_ACCOUNT.departs;
        is_not_felt_in(setup, true, &[(seed, 3)]);
    }
}

fn folds_nothing(presses: &[(u64, u64)]) {
    let bytes = folded_ball().unwrap();
    let setup = WITHOUT_ACCOUNT;
    for &(seed, k) in presses {
        let mut found = Found::new(0.0);
        let up = direction_of(seed, k);
        refined_over_folds(&bytes, setup, up, &mut found).unwrap();
        assert!(found.value <= 1.0, "{seed}, {k}: {}", found.value);
    }
}

/// Below and out of reach before, above and out of reach after: it was said not to be felt.
#[test]
fn a_face_that_passes_over_a_free_probe_is_felt() {
    is_not_felt(&[(1, 11), (1, 303), (2, 83), (3, 219), (5, 155)]);
}

/// Neither step came within reach alone.
#[test]
fn both_vertices_of_a_pair_together_make_no_force_discontinuity() {
    is_not_felt(&[(3, 344), (4, 296), (5, 396)]);
}

/// It met the tool from where it rested, and put it out by as much as anything near had
/// changed.
#[test]
fn what_has_met_a_tool_puts_it_out_by_no_more_than_that() {
    is_not_felt_by_a_tool(&[(1, 109)]);
}

/// What was gathered was not known any more in the next tick, so that the tool never came to a
/// step.
#[test]
fn a_tool_goes_on_while_the_surface_changes_in_every_tick() {
    is_not_felt_by_a_tool(&[(1, 279)]);
}

/// Where it could go by the contacts known so far was taken for where it will be held.
#[test]
fn a_tool_that_is_stopped_early_keeps_its_force() {
    is_not_felt_by_a_tool(&[(2, 31), (2, 343)]);
}

#[test]
fn a_slow_rise_is_no_force_discontinuity() {
    is_not_felt(&[(4, 175)]);
}

/// It was made out of reach, where nobody minds, and a vertex in flight brought it to the
/// probe.
#[test]
fn no_flight_brings_a_face_that_is_turned_over() {
    folds_nothing(&[(1, 30), (1, 236), (2, 136), (2, 148), (2, 149)]);
}

#[test]
fn nothing_is_turned_over_beside_a_free_probe() {
    folds_nothing(&[(3, 325)]);
}

/// By splits beside a flight, of which none turned it over by itself.
#[test]
fn nothing_is_turned_over_by_and_by_while_a_corner_flies() {
    folds_nothing(&[(2, 63), (2, 66), (2, 88), (2, 192), (5, 139)]);
}
