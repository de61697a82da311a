//! The account over known motions.

use super::*;

mod fading;
mod slow;

const PERIOD_S: f64 = 1e-3;
/// Work over the motion of a surface at rest.
const STANDING: [f64; 2] = [0.0; 2];

/// A force along x, newtons.
fn push(newtons: f64) -> Wrench {
    Wrench {
        force: DVec3::X * newtons,
        torque: DVec3::ZERO,
    }
}

/// Energy, joules, that a wall puts out while a free mass of 0.1 kg hits it at a speed (m/s)
/// and leaves again. `damping` in N s/m; `phase`: part of a period at the impact.
fn bounce(stiffness_n_per_m: f64, damping: f64, speed: f64, phase: f64, limited: bool) -> f64 {
    let account = EnergyAccount::new(0.0, PERIOD_S);
    let [put_out, _] = bounce_by(
        account,
        PERIOD_S,
        [stiffness_n_per_m, damping],
        [f64::INFINITY; 2],
        [speed, phase],
        limited,
    );
    put_out
}

/// The same by an account in front of a limit of the force and of its change in a period, newtons;
/// and what the damping takes while there is a force.
fn bounce_by(
    mut account: EnergyAccount,
    period_s: f64,
    [stiffness_n_per_m, damping]: [f64; 2],
    [most_n, slew_n]: [f64; 2],
    [speed, phase]: [f64; 2],
    limited: bool,
) -> [f64; 2] {
    let (mut x, mut v, mut force) = (speed * period_s * (1.0 + phase), -speed, 0.0);
    let mut damped = 0.0;
    for _ in 0..4000 {
        let is_touched = force > 0.0;
        for _ in 0..16 {
            let dt = period_s / 16.0;
            v += (force - damping * v) * dt / 0.1;
            x += v * dt;
            damped += f64::from(is_touched) * damping * v * v * dt;
        }
        account.moved_to(&Pose::at(DVec3::X * x), [1; 2], STANDING);
        let depth = (-x).max(0.0);
        let wanted = push(stiffness_n_per_m * depth);
        let spring = CouplingSpring {
            stiffness_n_per_m,
            stored_j: 0.5 * stiffness_n_per_m * depth * depth,
            raised_j: 0.0,
        };
        let share = if limited {
            account.share(wanted, spring, CarriedWork::default())
        } else {
            1.0
        };
        let most = most_n.min(wanted.force.x * share);
        force = most.clamp(force - slew_n, force + slew_n);
        account.set_output(push(force), push(force));
        if x > 0.0 && v > 0.0 && force == 0.0 {
            break;
        }
    }
    [account.joules(), damped]
}

/// A limit of slew behind the account lets a force linger when the device leaves: that, too, is
/// paid for, at any rate: to a hundredth of the energy of the impact.
#[test]
fn a_force_that_falls_slowly_puts_out_no_more_than_a_device_damps() {
    let (most_n, slew_n_per_s) = (8.0, 2000.0);
    for rate_hz in [250.0, 500.0, 1000.0, 2000.0, 4000.0] {
        let (period_s, slew_n) = (1.0 / rate_hz, slew_n_per_s / rate_hz);
        let mut unaware = f64::NEG_INFINITY;
        for stiffness in [1.0, 3.0, 10.0].map(|of| of * rate_hz) {
            for k in 0..400 {
                let at = [0.05 + 0.00125 * f64::from(k), f64::from(k * 7 % 40) / 40.0];
                let impact_j = 0.5 * 0.1 * at[0] * at[0];
                let (surface, limits) = ([stiffness, 1.0], [most_n, slew_n]);
                let bounce = |account| bounce_by(account, period_s, surface, limits, at, true);
                let account = EnergyAccount::new(0.0, period_s);
                let [put_out, damped] = bounce(account.clone().with_slew([slew_n, f64::INFINITY]));
                assert!(
                    put_out <= damped + 0.01 * impact_j,
                    "{rate_hz} {stiffness} {at:?}: {put_out} {damped}"
                );
                let [put_out, damped] = bounce(account);
                unaware = unaware.max(put_out - damped);
            }
        }
        // Up to 1 kHz a force falls before the device is out.
        assert!(unaware > 1e-4 || rate_hz <= 1000.0, "{rate_hz}: {unaware}");
    }
}

/// Forces of any number of steps of the slew limit, whole or not, over motions that grow or do not.
#[test]
fn the_work_of_a_force_that_falls_has_a_bound_that_is_quadratic_in_it() {
    let (slew, motion) = (0.5, 1e-5);
    for growth in [0.0, 0.3e-5, 2e-5] {
        let mut device = DeviceMotion::new(0.0, 1);
        let mut place = 0.0;
        for step in [motion - growth, motion, motion + growth] {
            device.moved_to(DVec3::X * place, [1; 2]);
            place += step;
        }
        device.moved_to(DVec3::X * place, [1; 2]);
        let next = device.next().x;
        let grows = (next - device.last().x).max(0.0);
        for k in 1..500 {
            let force = 0.01 * f64::from(k);
            let bound =
                |newtons: f64| bound_of_fall(DVec3::X * newtons, newtons * next, &device, slew);
            let mut work = 0.0;
            for periods in 1..=(force / slew) as u32 {
                let periods = f64::from(periods);
                work += (force - periods * slew) * (next + periods * grows);
            }
            let most = bound(force);
            assert!(
                work <= most * (1.0 + 1e-12),
                "{growth} {force}: {work} {most}"
            );
            assert!(most <= work + 0.5 * slew * (next + 4.0 * force / slew * grows));
            for share in [0.1, 0.5, 0.9] {
                let part = bound(share * force);
                assert!(part <= share * share * most * (1.0 + 1e-12));
            }
        }
    }
}

/// A tool rolls on the surface: force and torque do nearly opposite work.
#[test]
fn opposite_work_of_force_and_torque_leaves_the_share() {
    let (stiffness_n_per_m, newtons, step) = (1000.0, 0.5, 1e-5);
    for rest in [1.0, 1e-3, 1e-6] {
        let mut account = EnergyAccount::new(0.0, PERIOD_S);
        let at = |k: f64, turned: f64| Pose {
            position: DVec3::X * (step * k),
            orientation: DQuat::from_rotation_z(turned * k),
        };
        let turned = 1e-3;
        account.moved_to(&at(0.0, turned), [1; 2], STANDING);
        // Energy taken in first.
        account.set_output(push(newtons), push(newtons));
        account.moved_to(&at(-100.0, turned), [1; 2], STANDING);
        for k in 1..4 {
            account.set_output(push(newtons), push(newtons));
            account.moved_to(&at(f64::from(k) - 100.0, turned), [1; 2], STANDING);
        }
        let torque = DVec3::Z * (-newtons * step * (1.0 - rest) / turned);
        let wanted = Wrench {
            torque,
            ..push(newtons)
        };
        let spring = CouplingSpring {
            stiffness_n_per_m,
            stored_j: 0.5 * newtons * newtons / stiffness_n_per_m,
            raised_j: 0.0,
        };
        let share = account.share(wanted, spring, CarriedWork::default());
        assert!(share > 0.95, "share {share} with {rest} of the work left");
    }
}

#[test]
fn a_sampled_spring_puts_out_the_energy_of_colgate_1994() {
    // Into a wall of stiffness K at speed v and out again: K T / 2 ∫ v² dt.
    let (k, v) = (1000.0, 0.1);
    let mut account = EnergyAccount::new(0.0, PERIOD_S);
    let mut x: f64 = 0.0;
    for tick in 0..=40 {
        account.moved_to(&Pose::at(DVec3::X * x), [1; 2], STANDING);
        let force = push(-k * x.max(0.0));
        account.set_output(force, force);
        x += if tick < 20 {
            v * PERIOD_S
        } else {
            -v * PERIOD_S
        };
    }
    let leak = k * PERIOD_S / 2.0 * v * v * (40.0 * PERIOD_S);
    assert!(
        (account.joules() - leak).abs() < 1e-9,
        "{}",
        account.joules()
    );
}

#[test]
fn a_limited_wall_returns_no_more_energy_than_it_received() {
    for stiffness in [100.0, 1000.0, 3000.0, 10_000.0] {
        for damping in [0.0, 0.1, 1.0] {
            for k in 0..40 {
                let (speed, phase) = (0.05 + 0.0125 * f64::from(k), f64::from(k * 7 % 40) / 40.0);
                let without = bounce(stiffness, damping, speed, phase, false);
                let with = bounce(stiffness, damping, speed, phase, true);
                assert!(without > 0.0, "{stiffness} {damping} {speed}: {without}");
                assert!(
                    with <= 1e-6 * without,
                    "{stiffness} {damping} {speed}: {with} of {without}"
                );
            }
        }
    }
}

#[test]
fn encoder_noise_does_not_reduce_the_force_at_rest() {
    let mut account = EnergyAccount::new(1e-5, PERIOD_S);
    let stiffness_n_per_m = 1000.0;
    for tick in 0..600_000u32 {
        // Pressed in without noise, then ten minutes at rest with noise of one step.
        let press = (f64::from(tick) * 1e-5).min(2e-3);
        let noise = if press < 2e-3 {
            0.0
        } else {
            [0.0, 1e-5, 0.0, 0.0, 1e-5][tick as usize % 5]
        };
        let depth = press + noise;
        account.moved_to(&Pose::at(DVec3::X * -depth), [1; 2], STANDING);
        let wanted = push(stiffness_n_per_m * depth);
        let spring = CouplingSpring {
            stiffness_n_per_m,
            stored_j: 0.5 * stiffness_n_per_m * depth * depth,
            raised_j: 0.0,
        };
        let share = account.share(wanted, spring, CarriedWork::default());
        // At most the force of the noise itself.
        assert!(
            wanted.force.x * (1.0 - share) <= stiffness_n_per_m * 1e-5,
            "tick {tick}: {share}"
        );
        let given = push(wanted.force.x * share);
        account.set_output(given, given);
    }
}

/// A device swings to and fro under a force that is only there on the way out. What it puts out is
/// seen to two steps of the encoder, after one swing as after a thousand.
#[test]
fn the_error_of_an_encoder_does_not_add_up_over_swings() {
    let (step_m, steps, newtons) = (1e-5, 10, 1.0);
    let mut account = EnergyAccount::new(step_m, PERIOD_S);
    account.moved_to(&Pose::at(DVec3::ZERO), [1; 2], STANDING);
    for swing in 1..=1000 {
        let out = (1..=steps).map(|k| (k, newtons));
        let back = (0..steps).rev().map(|k| (k, 0.0));
        for (k, newtons) in out.chain(back) {
            account.set_force(push(newtons).force);
            let place = DVec3::X * (step_m * f64::from(k));
            account.moved_to(&Pose::at(place), [1; 2], STANDING);
        }
        let put_out = f64::from(swing * steps) * step_m * newtons;
        let error = (account.contact_joules - put_out).abs();
        assert!(
            error <= 2.0 * step_m * newtons,
            "{swing} swings: {put_out} J, {error} J unseen"
        );
    }
}

/// An orientation turned about an axis by so many steps.
fn turned_by(step_rad: f64, steps: f64) -> Pose {
    Pose {
        position: DVec3::ZERO,
        orientation: DQuat::from_axis_angle(DVec3::new(2.0, -1.0, 2.0) / 3.0, step_rad * steps),
    }
}

/// A torque about that axis, newton metres.
fn twist(torque_nm: f64) -> Wrench {
    Wrench {
        force: DVec3::ZERO,
        torque: DVec3::new(2.0, -1.0, 2.0) / 3.0 * torque_nm,
    }
}

/// The same in rotation: beyond half a turn too, where the rotation vector starts anew.
#[test]
fn the_error_of_an_encoder_does_not_add_up_over_turns() {
    let (step_rad, steps, torque_nm) = (0.01, 500, 0.02);
    let mut account = EnergyAccount::new(0.0, PERIOD_S).with_angular_step(step_rad);
    account.moved_to(&turned_by(step_rad, 0.0), [1; 2], STANDING);
    for swing in 1..=200 {
        let out = (1..=steps).map(|k| (k, torque_nm));
        let back = (0..steps).rev().map(|k| (k, 0.0));
        for (k, torque_nm) in out.chain(back) {
            account.set_output(twist(torque_nm), twist(torque_nm));
            account.moved_to(&turned_by(step_rad, f64::from(k)), [1; 2], STANDING);
        }
        let put_out = f64::from(swing * steps) * step_rad * torque_nm;
        let error = (account.contact_joules - put_out).abs();
        assert!(
            error <= 4.0 * step_rad * torque_nm,
            "{swing} swings: {put_out} J, {error} J unseen"
        );
        let whole = (account.joules() - put_out).abs();
        assert!(whole < 1e-9 * put_out, "{put_out} {}", account.joules());
    }
}

/// A handle rests in a torsional spring, with noise of one step of its encoder.
#[test]
fn noise_of_the_orientation_does_not_reduce_the_torque_at_rest() {
    let step_rad = 3e-4;
    let mut account = EnergyAccount::new(0.0, PERIOD_S).with_angular_step(step_rad);
    // A surface of 1 kN/m on a radius of gyration of 10 mm.
    let (stiffness_n_per_m, torsion) = (1000.0, 0.1);
    for tick in 0..60_000u32 {
        let press = (f64::from(tick) * step_rad).min(0.06);
        let noise = [0.0, step_rad, 0.0, 0.0, step_rad][tick as usize % 5];
        let angle = press + if press < 0.06 { 0.0 } else { noise };
        account.moved_to(&turned_by(-1.0, angle), [1; 2], STANDING);
        let wanted = twist(torsion * angle);
        let spring = CouplingSpring {
            stiffness_n_per_m,
            stored_j: 0.5 * torsion * angle * angle,
            raised_j: 0.0,
        };
        let share = account.share(wanted, spring, CarriedWork::default());
        let lost = wanted.torque.length() * (1.0 - share);
        assert!(lost <= torsion * step_rad, "tick {tick}: {share}");
        account.set_output(wanted * share, wanted * share);
    }
}

#[test]
fn the_excess_of_an_earlier_contact_does_not_mute_a_later_one() {
    let stiffness_n_per_m = 1000.0;
    let mut account = EnergyAccount::new(0.0, PERIOD_S);
    let move_to = |account: &mut EnergyAccount, x: f64| {
        account.moved_to(&Pose::at(DVec3::X * x), [1; 2], STANDING);
    };
    // A device that was silent inside the surface is pushed out: 10 mJ that nobody put in.
    move_to(&mut account, -5e-3);
    account.set_output(push(2.0), push(2.0));
    move_to(&mut account, 0.0);
    account.set_output(Wrench::ZERO, Wrench::ZERO);
    assert!(account.contact_joules > 9e-3);
    // Half a second above the surface, then a press of 2 mm with a tremor of 20 um
    // at 10 Hz.
    for _ in 0..500 {
        move_to(&mut account, 0.0);
        account.pass_time(PERIOD_S);
        let share = account.share(
            Wrench::ZERO,
            CouplingSpring::default(),
            CarriedWork::default(),
        );
        assert!((0.0..=1.0).contains(&share), "{share}");
        account.set_output(Wrench::ZERO, Wrench::ZERO);
    }
    let mut least = f64::INFINITY;
    for tick in 0..400 {
        let tremor = 1e-5 * (std::f64::consts::TAU * 0.01 * f64::from(tick)).sin();
        let depth = (f64::from(tick) * 1e-5).min(2e-3) + tremor;
        move_to(&mut account, -depth);
        let wanted = push(stiffness_n_per_m * depth.max(0.0));
        let spring = CouplingSpring {
            stiffness_n_per_m,
            stored_j: 0.5 * stiffness_n_per_m * depth * depth,
            raised_j: 0.0,
        };
        let share = account.share(wanted, spring, CarriedWork::default());
        if tick > 300 {
            least = least.min(share);
        }
        let force = push(wanted.force.x * share);
        account.set_output(force, force);
    }
    assert!(least > 0.9, "{least}");
}

/// The account of a device that was pushed out of a surface by 2 N over 5 mm, and is on it still:
/// 10 mJ that nobody put in.
fn account_with_an_excess() -> EnergyAccount {
    let mut account = EnergyAccount::new(0.0, PERIOD_S);
    for (x, force) in [(-6e-3, 2.0), (-1e-3, 0.0)] {
        account.moved_to(&Pose::at(DVec3::X * x), [1; 2], STANDING);
        account.set_output(push(force), push(force));
    }
    assert!(account.contact_joules > 9e-3);
    account
}

/// Lets periods of so many seconds go by, in each of which a spring wants to push a resting device
/// with some newtons, and gets nothing.
fn wait(account: &mut EnergyAccount, newtons: f64, period_s: f64, periods: u32) {
    let stiffness_n_per_m = 1000.0;
    let spring = CouplingSpring {
        stiffness_n_per_m,
        stored_j: 0.5 * newtons * newtons / stiffness_n_per_m,
        raised_j: 0.0,
    };
    for _ in 0..periods {
        account.moved_to(&Pose::at(DVec3::X * -1e-3), [1; 2], STANDING);
        account.pass_time(period_s);
        let share = account.share(push(newtons), spring, CarriedWork::default());
        assert!((0.0..=1.0).contains(&share), "{share}");
        account.set_output(Wrench::ZERO, Wrench::ZERO);
    }
}

/// A damping torque may act where the spring of the contact holds nothing, after an excess.
#[test]
fn a_share_is_between_0_and_1_where_the_spring_holds_nothing() {
    for (turned, newtons) in [(1e-3, 0.0), (1e-3, 1.0), (-1e-3, 0.0), (0.0, 1.0)] {
        let mut account = account_with_an_excess();
        let wanted = Wrench {
            torque: DVec3::Z * 1e-4,
            ..Wrench::ZERO
        };
        for k in 1..4 {
            let pose = Pose {
                position: DVec3::X * -1e-3,
                orientation: DQuat::from_rotation_z(turned * f64::from(k)),
            };
            account.moved_to(&pose, [1; 2], STANDING);
            let nothing = CouplingSpring::default();
            let share = account.share(wanted, nothing, CarriedWork::default());
            assert!((0.0..=1.0).contains(&share), "{share}");
            account.set_output(wanted * share, wanted * share);
        }
        // The next contact has a force again.
        wait(&mut account, newtons, PERIOD_S, 100);
        assert!((0.0..=1.0).contains(&account.paid), "{}", account.paid);
    }
}

#[test]
fn a_contact_without_a_share_forgets_nothing_that_it_put_out() {
    let mut account = account_with_an_excess();
    let excess = account.contact_joules;
    wait(&mut account, 1.0, PERIOD_S, 1000);
    assert_eq!(account.contact_joules, excess);
}

#[test]
fn the_excess_of_a_contact_that_is_over_fades_in_seconds_whatever_the_rate() {
    let left = |rate_hz: u32| {
        let mut account = account_with_an_excess();
        // The first period begins in contact.
        wait(&mut account, 0.0, 0.0, 1);
        let before = account.contact_joules;
        wait(&mut account, 0.0, 1.0 / f64::from(rate_hz), rate_hz / 20);
        account.contact_joules / before
    };
    let exact = (-0.05_f64 / EXCESS_FADES_S).exp();
    for rate_hz in [500, 1000, 4000] {
        let left = left(rate_hz);
        let off = left / exact - 1.0;
        println!("{rate_hz} Hz: {left} left after 50 ms, {off} off the exponential");
        assert!(off.abs() < 0.1, "{rate_hz} Hz: {left} instead of {exact}");
    }
}

#[test]
fn a_surface_that_carries_the_device_keeps_its_force() {
    // A surface meets a device at 1 m/s and carries it along, one millimetre deep.
    let stiffness_n_per_m = 1000.0;
    for carried in [true, false] {
        let mut account = EnergyAccount::new(0.0, PERIOD_S);
        let (mut surface, mut device, mut force) = (0.0f64, 1e-3f64, 0.0f64);
        let mut least = f64::INFINITY;
        for tick in 0..2000 {
            surface += PERIOD_S;
            device = device.max(surface - 1e-3);
            let work = if carried { force * PERIOD_S } else { 0.0 };
            account.moved_to(&Pose::at(DVec3::X * device), [1; 2], [work; 2]);
            let depth = (surface - device).max(0.0);
            let wanted = push(stiffness_n_per_m * depth);
            let spring = CouplingSpring {
                stiffness_n_per_m,
                stored_j: 0.5 * stiffness_n_per_m * depth * depth,
                raised_j: 0.0,
            };
            let ahead = CarriedWork {
                pushed_j: if carried {
                    wanted.force.x * PERIOD_S
                } else {
                    0.0
                },
                turned_j: 0.0,
                most_j: if carried {
                    wanted.force.x * PERIOD_S
                } else {
                    0.0
                },
            };
            let share = account.share(wanted, spring, ahead);
            if tick > 10 {
                least = least.min(share);
            }
            force = wanted.force.x * share;
            account.set_output(push(force), push(force));
        }
        if carried {
            assert!(least > 0.999, "{least}");
            assert!(account.joules() < 1e-12, "{}", account.joules());
        } else {
            // Without the carried work no surface could push a device.
            assert!(least < 0.1, "{least}");
        }
    }
}

/// Share of a force that is left when a device has been pressed in, and has moved away for 30
/// periods since a surface gave it so much energy.
fn share_after_a_rise(given_j: f64) -> f64 {
    let mut account = EnergyAccount::new(0.0, PERIOD_S);
    let mut share = 1.0;
    for tick in 0..=35_u32 {
        let x = 2e-5 * f64::from(tick.abs_diff(5));
        account.moved_to(&Pose::at(DVec3::X * x), [1; 2], STANDING);
        account.pass_time(PERIOD_S);
        let spring = CouplingSpring {
            stiffness_n_per_m: 1000.0,
            stored_j: 2e-3,
            raised_j: if tick == 6 { given_j } else { 0.0 },
        };
        share = account.share(push(2.0), spring, CarriedWork::default());
        account.set_output(push(2.0 * share), push(2.0 * share));
    }
    let of_a_tick = 2.0 * 2e-5;
    assert!(account.joules() <= given_j + of_a_tick);
    share
}

#[test]
fn a_device_that_gives_way_to_a_surface_keeps_its_force_and_one_that_stood_gets_no_more() {
    let (none, some) = (share_after_a_rise(0.0), share_after_a_rise(2e-3));
    assert!(none < 0.05 && some > 0.4, "{none} {some}");
    let left = |standing: u32| {
        let mut account = EnergyAccount::new(0.0, PERIOD_S);
        for tick in 0..=standing {
            account.moved_to(&Pose::at(DVec3::ZERO), [1; 2], STANDING);
            let spring = CouplingSpring {
                stiffness_n_per_m: 1000.0,
                stored_j: 2e-3,
                raised_j: if tick == 0 { 2e-3 } else { 0.0 },
            };
            let _ = account.share(push(2.0), spring, CarriedWork::default());
        }
        account.raised_j
    };
    assert_eq!((left(0), left(1)), (2e-3, 0.0));
}
