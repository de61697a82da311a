//! A device slower than the loop: in a period without a sample it goes on.

use super::*;

/// A mass of 0.1 kg with a damping, N s/m, at a wall of a stiffness, N/m, and its place (metres,
/// negative in the wall) and speed. Its driver has a sample in one of so many periods.
struct SlowDevice {
    account: EnergyAccount,
    stiffness_n_per_m: f64,
    damping: f64,
    every: u64,
    x: f64,
    v: f64,
    force: f64,
    /// Energy that the force has put out, joules.
    put_out_j: f64,
    measured: f64,
    tick: u64,
}

impl SlowDevice {
    fn new([stiffness_n_per_m, damping]: [f64; 2], every: u64, [x, v]: [f64; 2]) -> Self {
        Self {
            account: EnergyAccount::new(0.0, PERIOD_S),
            stiffness_n_per_m,
            damping,
            every,
            x,
            v,
            force: 0.0,
            put_out_j: 0.0,
            measured: x,
            tick: 0,
        }
    }

    /// A tick with a force of the hand at a place and speed. Returns the share of the force.
    fn step(&mut self, hand: impl Fn(f64, f64) -> f64) -> f64 {
        for _ in 0..16 {
            let dt = PERIOD_S / 16.0;
            let sum = self.force - self.damping * self.v + hand(self.x, self.v);
            self.v += sum * dt / 0.1;
            self.x += self.v * dt;
            self.put_out_j += self.force * self.v * dt;
        }
        if self.tick.is_multiple_of(self.every) {
            let periods = if self.tick == 0 { 1 } else { self.every };
            self.measured = self.x;
            let pose = Pose::at(DVec3::X * self.x);
            self.account.moved_to(&pose, [1, periods], STANDING);
        } else {
            self.account.go_on(1, STANDING);
        }
        self.tick += 1;
        let depth = (-self.measured).max(0.0);
        let wanted = push(self.stiffness_n_per_m * depth);
        let spring = CouplingSpring {
            stiffness_n_per_m: self.stiffness_n_per_m,
            stored_j: 0.5 * self.stiffness_n_per_m * depth * depth,
            raised_j: 0.0,
        };
        let share = self.account.share(wanted, spring, CarriedWork::default());
        self.force = wanted.force.x * share;
        self.account.set_output(push(self.force), push(self.force));
        share
    }
}

/// Taken for at rest in the periods between two samples, it put out a quarter of the impact.
#[test]
fn a_slow_device_that_bounces_gets_back_little_of_its_impact() {
    for k in 0..40 {
        let (speed, phase) = (0.05 + 0.0125 * f64::from(k), f64::from(k * 7 % 40) / 40.0);
        let impact_j = 0.5 * 0.1 * speed * speed;
        let from = [speed * PERIOD_S * (1.0 + phase), -speed];
        let mut device = SlowDevice::new([1000.0, 0.0], 4, from);
        for _ in 0..4000 {
            device.step(|_, _| 0.0);
            let is_away = device.x > 0.0 && device.measured > 0.0 && device.v > 0.0;
            if is_away && device.force == 0.0 {
                break;
            }
        }
        let share = device.put_out_j / impact_j;
        assert!(share <= 0.1, "{speed} m/s: {share} of the impact");
    }
}

/// A hand of 200 N/m holds it in a wall, at rest or trembling. Taken for at rest in between, it
/// lost nine tenths of its force at 250 Hz; with all of the work in between as a leak of the
/// spring, a quarter on each quick way out.
#[test]
fn a_slow_device_that_is_held_in_a_surface_has_its_force() {
    for every in [1, 2, 3, 4] {
        for [tremor_m, hz, share] in [[0.0, 3.0, 0.98], [2e-3, 3.0, 0.97], [6e-3, 5.0, 0.8]] {
            let mut device = SlowDevice::new([800.0, 1.0], every, [1e-3, 0.0]);
            let mut least = f64::INFINITY;
            for tick in 0..4000_u32 {
                let turn = std::f64::consts::TAU * hz * PERIOD_S * f64::from(tick);
                let aim = -0.01 + tremor_m * turn.sin();
                let given = device.step(|x, v| 200.0 * (aim - x) - 2.0 * v);
                if tick > 2000 {
                    least = least.min(given);
                }
            }
            assert!(least > share, "{every}, {tremor_m}: {least} of the force");
            if tremor_m == 0.0 {
                let off = device.force / 1.6 - 1.0;
                assert!(off.abs() < 0.01, "{every}: {} N", device.force);
            }
            assert!(device.put_out_j < 0.0, "{every}: {} J", device.put_out_j);
        }
    }
}

/// All displacements together are the measured one, whatever was estimated in between, and each
/// period without a sample has its part of it.
#[test]
fn what_a_slow_device_does_is_booked_evenly_and_once() {
    for encoder_m in [0.0, 1e-5] {
        let mut account = EnergyAccount::new(encoder_m, PERIOD_S);
        account.set_force(push(1.0).force);
        let (mut booked, mut last) = (Vec::new(), 0.0);
        for tick in 0..=400_u32 {
            let x = 1e-4 * f64::from(tick);
            if tick % 4 == 0 {
                let periods = if tick == 0 { 1 } else { 4 };
                account.moved_to(&Pose::at(DVec3::X * x), [1, periods], STANDING);
            } else {
                account.go_on(1, STANDING);
            }
            booked.push(account.joules() - last);
            last = account.joules();
        }
        assert!((last - 0.04).abs() < 1e-12, "{last} J");
        // The first sample shows no motion yet.
        for (tick, joules) in booked.iter().enumerate().skip(5) {
            assert!((joules - 1e-4).abs() < 1e-12, "{tick}: {joules} J");
        }
        // It stops: what was too much is taken back.
        account.go_on(1, STANDING);
        account.moved_to(&Pose::at(DVec3::X * 0.04), [1, 2], STANDING);
        let off = account.joules() - 0.04;
        assert!(off.abs() <= encoder_m + 1e-12, "{off} J");
    }
}
