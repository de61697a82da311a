//! A force of which not all is paid for fades, and does not shake.

use super::*;

/// The device presses in, the surface rises as far again, and the device leaves with one step
/// back in four. Most of the unpaid force fades before the account cuts it, no increase is above
/// the perception limit, and no more than was put in comes out, but for the force of some ticks.
#[test]
fn an_unpaid_force_fades_below_the_perception_limit() {
    let (stiffness_n_per_m, pressed, raised) = (1000.0, 2e-3, 2e-3);
    for step in [1e-5, 5e-5, 1e-4] {
        let mut account = EnergyAccount::new(0.0, PERIOD_S);
        let (mut x, mut rise, mut tick, mut before): (f64, f64, u32, f64) = (0.0, 0.0, 0, 0.0);
        let (mut whole, mut fall, mut excess): (f64, f64, f64) = (0.0, 0.0, 0.0);
        while x <= 0.0 {
            let is_leaving = rise >= raised;
            if rise == 0.0 && x > -pressed {
                x -= step;
            } else if !is_leaving {
                rise += 1e-5;
            } else {
                // One step back in four.
                tick += 1;
                x += if tick % 4 == 0 { -step } else { step };
            }
            account.moved_to(&Pose::at(DVec3::X * x), [1; 2], STANDING);
            let depth = (rise - x).max(0.0);
            let wanted = push(stiffness_n_per_m * depth);
            let spring = CouplingSpring {
                stiffness_n_per_m,
                stored_j: 0.5 * stiffness_n_per_m * depth * depth,
                raised_j: 0.0,
            };
            let force = wanted.force.x * account.share(wanted, spring, CarriedWork::default());
            if is_leaving {
                let imperceptible = PERIOD_S * STEP_N_PER_S.max(STEP_SHARE_PER_S * before)
                    + stiffness_n_per_m * step;
                excess = excess.max((force - before) / imperceptible);
                fall = fall.max(before - force);
            } else {
                whole = force;
            }
            account.set_output(push(force), push(force));
            before = force;
        }
        let share = fall / whole;
        assert!(share < 0.8 && excess <= 1.0, "{step}: {share}, {excess}");
        let of_ticks = 2.0 * stiffness_n_per_m * (pressed + raised) * step;
        assert!(account.joules() <= of_ticks, "{step}: {}", account.joules());
    }
}

/// A third of the spring is paid for. While the device leaves, evenly or not, the surface gives a
/// little in every tick: the force falls until it is paid for, and does not come and go.
#[test]
fn what_is_given_meanwhile_does_not_shake_a_force_that_fades() {
    let (stiffness_n_per_m, depth) = (1000.0, 3e-3);
    let stored = |depth: f64| 0.5 * stiffness_n_per_m * depth * depth;
    for uneven in [0.0, 0.3] {
        let mut account = EnergyAccount::new(0.0, PERIOD_S);
        account.moved_to(&Pose::IDENTITY, [1; 2], STANDING);
        account.contact_joules = -stored(depth) / 3.0;
        let (mut x, mut before, mut was_falling, mut turns) = (0.0, f64::INFINITY, true, 0);
        account.limited = push(1.0);
        for tick in 0..250 {
            let step = 1e-5 * (1.0 + uneven * f64::from(tick * 7 % 5 - 2) / 2.0);
            x += step;
            account.moved_to(&Pose::at(DVec3::X * x), [1; 2], STANDING);
            let left = depth - x;
            let wanted = push(stiffness_n_per_m * left);
            let spring = CouplingSpring {
                stiffness_n_per_m,
                stored_j: stored(left),
                raised_j: 0.02 * stiffness_n_per_m * left * step,
            };
            let force = wanted.force.x * account.share(wanted, spring, CarriedWork::default());
            account.set_output(push(force), push(force));
            turns += u32::from((force < before) != was_falling);
            (before, was_falling) = (force, force < before);
        }
        assert!(before > 0.0 && turns < 10, "{uneven}: {turns} turns");
    }
}

/// A hand of 200 N/m rests 5 mm in a surface, and has paid for it. Then its force is cut once, as
/// after a stall, and rises along a ramp: nobody has paid for it any more. Before, it came and went
/// by half of it forty times a second.
#[test]
fn a_hand_at_rest_whose_force_was_cut_is_not_shaken() {
    let (stiffness_n_per_m, step_m, ramp_s) = (800.0, 1e-5, 0.2);
    for period_s in [1e-3, 2.5e-4] {
        let slew_n = 2000.0 * period_s;
        let account = EnergyAccount::new(step_m, period_s);
        let mut account = account.with_slew([slew_n, f64::INFINITY]);
        let (mut x, mut v, mut force, mut ramp) = (5e-3_f64, 0.0_f64, 0.0_f64, 1.0_f64);
        let (mut largest, mut sum, mut count): (f64, f64, f64) = (0.0, 0.0, 0.0);
        let ticks = |seconds: f64| (seconds / period_s).round() as u64;
        for tick in 0..ticks(7.5) {
            let seconds = tick as f64 * period_s;
            let aim = 3e-3 - 8e-3 * (2.0 * seconds).min(1.0);
            for _ in 0..16 {
                let dt = period_s / 16.0;
                v += (force - v + 200.0 * (aim - x) - 2.0 * v) * dt / 0.1;
                x += v * dt;
            }
            let measured = (x / step_m).round() * step_m;
            account.moved_to(&Pose::at(DVec3::X * measured), [1; 2], STANDING);
            if tick == ticks(2.0) {
                assert!(force > 0.79, "{force} N before");
                account.set_output(Wrench::ZERO, Wrench::ZERO);
                (force, ramp) = (0.0, 0.0);
            }
            account.pass_time(period_s);
            ramp = (ramp + period_s / ramp_s).min(1.0);
            let depth = (-measured).max(0.0);
            let wanted = push(stiffness_n_per_m * depth);
            let spring = CouplingSpring {
                stiffness_n_per_m,
                stored_j: 0.5 * stiffness_n_per_m * depth * depth,
                raised_j: 0.0,
            };
            let share = account.share(wanted, spring, CarriedWork::default());
            let most = (wanted.force.x * share).min(8.0) * ramp;
            let before = force;
            force = most.clamp(force - slew_n, force + slew_n);
            account.set_output(push(force), push(force));
            if tick > ticks(2.5) {
                largest = crate::record::max_or_nan(largest, (force - before).abs());
                (sum, count) = (sum + force, count + 1.0);
            }
        }
        let mean = sum / count;
        println!("{period_s} s: {largest} N in a tick, {mean} N at mean");
        assert!(largest < 0.1, "{period_s} s: {largest} N in a tick");
        assert!(mean > 0.1, "{period_s} s: {mean} N at mean");
    }
}

/// A tool that is twisted between two walls: their forces cancel. Nothing is paid for, as after a
/// soft start, and its torque returns as gently as a force.
#[test]
fn a_torque_beside_no_force_does_not_return_in_a_tick() {
    let (stiffness_n_per_m, stored_j) = (1000.0, 1e-4);
    let mut account = EnergyAccount::new(0.0, PERIOD_S);
    account.moved_to(&turned_by(0.0, 0.0), [1; 2], STANDING);
    account.paid = 0.2;
    let spring = CouplingSpring {
        stiffness_n_per_m,
        stored_j,
        raised_j: 0.0,
    };
    let pull = (2.0 * stiffness_n_per_m * stored_j).sqrt();
    for _ in 0..100 {
        let before = account.paid;
        account.moved_to(&turned_by(0.0, 0.0), [1; 2], STANDING);
        let share = account.share(twist(0.02), spring, CarriedWork::default());
        let unfelt = PERIOD_S * (STEP_SHARE_PER_S * before).max(STEP_N_PER_S / pull);
        assert!(share <= before + unfelt, "{before}, then {share}");
    }
}
