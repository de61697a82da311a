//! The energy account of a probe, and the limit that it sets to the force.
//!
//! A force is held for a period while the device moves on, so a sampled wall gives back more than it took: K T / 2 for
//! each unit of the integral of v² (facts of haptics, F1 and section 0.3). A passivity observer counts it (Hannaford
//! and Ryu 2002); theirs is then dissipated by added damping, after the fact and in jerks. Here it is not given out in
//! the first place. Where the device moves away, the force of a tick is scaled such that its work over the coming
//! period, with the motion extrapolated, is what the spring between device and proxy loses in it: that takes v T / 2
//! off its length. Where more is in the spring than was taken in (a touch that began between two ticks, a missed tick,
//! a surface that rose), up to v T more is taken off until it is not: in proportion to the speed, so that a hand at rest
//! feels nothing of it. And never is more given back than was taken in: where the spring holds more than that, the force of
//! a device that moves away fades to what the rest would be the energy of, and comes back, by no more in a tick than a hand
//! can tell. The force is not turned round: a wall does not stick.
//!
//! A surface that moves carries the device along, and that costs or gives what it may: the account is that of the
//! spring between them, so the work over the motion of the material ([`CarriedWork`]) is taken off.

use crate::perception::{STEP_N, STEP_SHARE};
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};

/// Periods over which a velocity is taken at the most.
const MAX_PERIODS: usize = 16;

/// Counts the energy that the rendering puts out, exact under zero-order hold (facts of haptics, F5), and limits it.
#[derive(Debug, Clone)]
pub struct EnergyAccount {
    /// Step of the encoder, metres: motion within it is noise and does no work.
    encoder_m: f64,
    joules: f64,
    /// Energy put out since the touch began, joules.
    contact_joules: f64,
    /// The share of the force that what was taken in allows.
    paid: f64,
    /// What acts on the device, and what of it is limited.
    wrench: Wrench,
    limited: Wrench,
    /// Samples, the newest first, metres; none before the first.
    samples: Option<[DVec3; MAX_PERIODS + 1]>,
    /// The newest sample without what is within the encoder's step.
    filtered: DVec3,
    /// Motion a period, metres: now, one and two periods ago.
    motion: [DVec3; 3],
    orientation: DQuat,
    /// Rotation in the last period, radians.
    rotation: DVec3,
}

/// Work of forces and of torques on the device over the motion of the material that gives them, joules; nothing where
/// that stands.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CarriedWork {
    /// Of forces.
    pub pushed_j: f64,
    /// Of torques.
    pub turned_j: f64,
}

impl CarriedWork {
    /// All of it.
    #[must_use]
    pub fn total(self) -> f64 {
        self.pushed_j + self.turned_j
    }
}

impl std::ops::Add for CarriedWork {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            pushed_j: self.pushed_j + other.pushed_j,
            turned_j: self.turned_j + other.turned_j,
        }
    }
}

/// What holds the device to its proxies.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CouplingSpring {
    /// Stiffness, N/m.
    pub stiffness_n_per_m: f64,
    /// Energy in it now, joules.
    pub stored_j: f64,
}

impl CouplingSpring {
    /// A share of it.
    #[must_use]
    pub fn times(self, share: f64) -> Self {
        Self {
            stiffness_n_per_m: self.stiffness_n_per_m * share,
            stored_j: self.stored_j * share,
        }
    }
}

impl std::ops::Add for CouplingSpring {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            stiffness_n_per_m: self.stiffness_n_per_m + other.stiffness_n_per_m,
            stored_j: self.stored_j + other.stored_j,
        }
    }
}

impl EnergyAccount {
    /// Nothing counted; `encoder_m` is the step of the device's encoder, metres, 0 for none.
    #[must_use]
    pub fn new(encoder_m: f64) -> Self {
        Self {
            encoder_m,
            joules: 0.0,
            contact_joules: 0.0,
            paid: 1.0,
            wrench: Wrench::ZERO,
            limited: Wrench::ZERO,
            samples: None,
            filtered: DVec3::ZERO,
            motion: [DVec3::ZERO; 3],
            orientation: DQuat::IDENTITY,
            rotation: DVec3::ZERO,
        }
    }

    /// The device is here at the end of the period in which the last wrench acted: `E += f[k] . (x[k+1] - x[k])`, and
    /// its torque times the rotation; less what it did over the motion of the material, joules: the wrench, and of it
    /// what is limited.
    pub fn moved_to(&mut self, pose: &Pose, [carried, limited]: [f64; 2]) {
        let position = pose.position;
        let turn = pose.orientation * self.orientation.inverse();
        self.orientation = pose.orientation;
        let Some(samples) = &mut self.samples else {
            self.samples = Some([position; MAX_PERIODS + 1]);
            self.filtered = position;
            return;
        };
        let Wrench { force, torque } = self.wrench;
        // The shorter way round.
        self.rotation = (if turn.w < 0.0 { -turn } else { turn }).to_scaled_axis();
        let work = force.dot(position - samples[0]) + torque.dot(self.rotation);
        self.joules += work - carried;
        samples.copy_within(..MAX_PERIODS, 1);
        samples[0] = position;
        let beyond = position - self.filtered;
        let length = beyond.length();
        let motion = if length > self.encoder_m {
            beyond * (1.0 - self.encoder_m / length)
        } else {
            DVec3::ZERO
        };
        self.filtered += motion;
        let Wrench { force, torque } = self.limited;
        let work = force.dot(motion) + torque.dot(self.rotation);
        self.contact_joules += work - limited;
        let velocity = velocity(samples, self.encoder_m);
        self.motion = [velocity, self.motion[0], self.motion[1]];
    }

    /// The share, 0 to 1, of a wanted wrench that may be given now, in the tick of [`Self::moved_to`]; `ahead`: its
    /// work over the motion of the material in the coming period.
    #[must_use]
    pub fn share(&mut self, wanted: Wrench, spring: CouplingSpring, ahead: CarriedWork) -> f64 {
        let next = self.next();
        let pushed = wanted.force.dot(next) - ahead.pushed_j;
        let work = pushed + (wanted.torque.dot(self.rotation) - ahead.turned_j);
        let size = wanted.force.length();
        let taken_in = 0.0 - self.contact_joules;
        let moves_away = work > self.rounding(size, ahead);
        let due = if moves_away && spring.stored_j > taken_in {
            (taken_in.max(0.0) / spring.stored_j).sqrt()
        } else {
            1.0
        };
        let imperceptible = (STEP_SHARE * self.paid).max(STEP_N / size);
        // As the device takes the energy out of the spring: what hardly moves fades hardly.
        let fades = imperceptible.min(work.max(0.0) / spring.stored_j);
        self.paid = due
            .max(self.paid - fades)
            .min(self.paid + imperceptible)
            .min(1.0);
        if !moves_away {
            return self.paid;
        }
        // By how much the spring between device and proxy gets shorter: of one that turns too, force and torque may do
        // opposite works, so that the length of the one tells nothing of it.
        let (work_of_spring, pull) = if wanted.torque == DVec3::ZERO {
            (pushed, size)
        } else {
            (
                work,
                (2.0 * spring.stiffness_n_per_m * spring.stored_j).sqrt(),
            )
        };
        let along = if pull > 0.0 {
            work_of_spring / pull
        } else {
            0.0
        };
        let hold_loss = 0.5 * spring.stiffness_n_per_m * along * along;
        // What the encoder's step alone may make of the balance is none of it.
        let unpaid = self.contact_joules + spring.stored_j - 2.0 * size * self.encoder_m;
        let given = work - hold_loss - unpaid.clamp(0.0, 2.0 * hold_loss);
        self.paid = self.paid.min((taken_in / work).max(0.0));
        (given / work).min(self.paid).clamp(0.0, 1.0)
    }

    /// What rounding alone may make of the difference between two motions that are alike, joules; nothing of a surface
    /// that stands, whose motion is none.
    fn rounding(&self, force: f64, ahead: CarriedWork) -> f64 {
        if ahead == CarriedWork::default() {
            return 0.0;
        }
        let place = self.samples.map_or(0.0, |samples| samples[0].length());
        let terms = force * place + ahead.pushed_j.abs() + ahead.turned_j.abs();
        8.0 * f64::EPSILON * terms
    }

    /// Energy that the touch took in beyond what its spring holds, joules: what may come into the spring otherwise, as
    /// by a surface that rises, without being owed.
    #[must_use]
    pub fn reserve(&self, spring: CouplingSpring) -> f64 {
        (0.0 - self.contact_joules - spring.stored_j).max(0.0)
    }

    /// This acts on the device from now on, and of it `limited` is what [`Self::share`] was asked for.
    pub fn set_output(&mut self, wrench: Wrench, limited: Wrench) {
        // A touch begins without credit; what an earlier one put out too much is still owed.
        if self.limited == Wrench::ZERO {
            self.contact_joules = self.contact_joules.max(0.0);
        }
        self.wrench = wrench;
        self.limited = limited;
    }

    /// The same of all of a force within one and the same touch, where no force is no end of it.
    pub fn set_force(&mut self, force: DVec3) {
        self.wrench = Wrench {
            force,
            torque: DVec3::ZERO,
        };
        self.limited = self.wrench;
    }

    /// What was taken in beyond what the spring holds, joules, is gone, as heat: it is not given back later.
    pub fn dissipate_beyond(&mut self, stored_j: f64) {
        self.contact_joules = self.contact_joules.max(-stored_j);
    }

    /// Motion in the coming period, extrapolated, metres.
    #[must_use]
    pub fn next(&self) -> DVec3 {
        let [now, before, earlier] = self.motion;
        let (change, change_before) = (now - before, before - earlier);
        // A jump is no acceleration.
        let lasting = change.dot(change_before) > 0.0;
        if lasting { now + change } else { now }
    }

    /// The share, 0 to 1, of a wanted force that may be given now such that no more was given back at the end of the
    /// period than was taken in and is not in the spring then, `stored_j` joules.
    #[must_use]
    pub fn share_of_spring(&self, wanted: DVec3, stored_j: f64) -> f64 {
        let work = wanted.dot(self.next());
        if work.is_nan() || work <= 0.0 {
            return 1.0;
        }
        // What the encoder's step alone may make of the balance is none of it.
        let noise = 2.0 * wanted.length() * self.encoder_m;
        ((noise - self.contact_joules - stored_j) / work).clamp(0.0, 1.0)
    }

    /// A new account of the same device.
    #[must_use]
    pub fn restarted(&self) -> Self {
        Self::new(self.encoder_m)
    }

    /// Motion in the last period, metres, without what is noise of the encoder.
    #[must_use]
    pub fn motion(&self) -> DVec3 {
        self.motion[0]
    }

    /// Energy put out so far, joules; above 0 the rendering pushed energy into the hand.
    #[must_use]
    pub fn joules(&self) -> f64 {
        self.joules
    }
}

/// Motion a period over the longest stretch that is straight and even within the encoder's step (first-order adaptive
/// windowing, Janabi-Sharifi, Hayward and Chen 2000).
fn velocity(samples: &[DVec3; MAX_PERIODS + 1], encoder_m: f64) -> DVec3 {
    let [now, ..] = *samples;
    let even = |periods: usize| {
        let a_period = (samples[periods] - now) / periods as f64;
        (1..periods).all(|k| (now + a_period * k as f64).distance(samples[k]) <= encoder_m)
    };
    let mut periods = 1;
    while periods < MAX_PERIODS && even(periods + 1) {
        periods += 1;
    }
    (now - samples[periods]) / periods as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 1e-3;
    /// No work over the motion of what stands.
    const STANDING: [f64; 2] = [0.0; 2];

    /// A force along x, newtons.
    fn push(newtons: f64) -> Wrench {
        Wrench {
            force: DVec3::X * newtons,
            torque: DVec3::ZERO,
        }
    }

    /// A free mass of 0.1 kg with a damping, in N s/m, falls on a wall at a speed and leaves again: the energy that the wall
    /// put out, joules.
    fn bounce(stiffness_n_per_m: f64, damping: f64, speed: f64, phase: f64, limited: bool) -> f64 {
        let mut account = EnergyAccount::new(0.0);
        let (mut x, mut v, mut force) = (speed * PERIOD_S * (1.0 + phase), -speed, 0.0);
        for _ in 0..4000 {
            for _ in 0..16 {
                let dt = PERIOD_S / 16.0;
                v += (force - damping * v) * dt / 0.1;
                x += v * dt;
            }
            account.moved_to(&Pose::at(DVec3::X * x), STANDING);
            let depth = (-x).max(0.0);
            let wanted = push(stiffness_n_per_m * depth);
            let spring = CouplingSpring {
                stiffness_n_per_m,
                stored_j: 0.5 * stiffness_n_per_m * depth * depth,
            };
            let share = if limited {
                account.share(wanted, spring, CarriedWork::default())
            } else {
                1.0
            };
            force = wanted.force.x * share;
            account.set_output(push(force), push(force));
            if x > 0.0 && v > 0.0 {
                break;
            }
        }
        account.joules()
    }

    /// Pressed in, then raised on as far again for nothing, the device leaves and trembles: the force that is not paid for is
    /// mostly gone before it has to be cut off, and comes back no faster than a hand can tell.
    #[test]
    fn a_force_that_was_not_paid_for_fades() {
        let (stiffness_n_per_m, pressed, raised) = (1000.0, 2e-3, 2e-3);
        for step in [1e-5, 5e-5, 1e-4] {
            let mut account = EnergyAccount::new(0.0);
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
                account.moved_to(&Pose::at(DVec3::X * x), STANDING);
                let depth = (rise - x).max(0.0);
                let wanted = push(stiffness_n_per_m * depth);
                let spring = CouplingSpring {
                    stiffness_n_per_m,
                    stored_j: 0.5 * stiffness_n_per_m * depth * depth,
                };
                let force = wanted.force.x * account.share(wanted, spring, CarriedWork::default());
                if is_leaving {
                    let imperceptible = STEP_N.max(STEP_SHARE * before) + stiffness_n_per_m * step;
                    excess = excess.max((force - before) / imperceptible);
                    fall = fall.max(before - force);
                } else {
                    whole = force;
                }
                account.set_output(push(force), push(force));
                before = force;
            }
            let share = fall / whole;
            println!("{step} a tick: falls by {share}, rises by {excess} of what is not felt");
            assert!(share < 0.8 && excess <= 1.0, "{step}: {share}, {excess}");
        }
    }

    /// A tool that rolls on the surface: its force does about as much work as its torque does the other way.
    #[test]
    fn opposite_works_of_force_and_torque_take_nothing_off() {
        let (stiffness_n_per_m, newtons, step) = (1000.0, 0.5, 1e-5);
        for rest in [1.0, 1e-3, 1e-6] {
            let mut account = EnergyAccount::new(0.0);
            let at = |k: f64, turned: f64| Pose {
                position: DVec3::X * (step * k),
                orientation: DQuat::from_rotation_z(turned * k),
            };
            let turned = 1e-3;
            account.moved_to(&at(0.0, turned), STANDING);
            // It has taken in enough.
            account.set_output(push(newtons), push(newtons));
            account.moved_to(&at(-100.0, turned), STANDING);
            for k in 1..4 {
                account.set_output(push(newtons), push(newtons));
                account.moved_to(&at(f64::from(k) - 100.0, turned), STANDING);
            }
            let torque = DVec3::Z * (-newtons * step * (1.0 - rest) / turned);
            let wanted = Wrench {
                torque,
                ..push(newtons)
            };
            let spring = CouplingSpring {
                stiffness_n_per_m,
                stored_j: 0.5 * newtons * newtons / stiffness_n_per_m,
            };
            let share = account.share(wanted, spring, CarriedWork::default());
            assert!(
                share > 0.95,
                "{share} of it, where {rest} of the work is left"
            );
        }
    }

    #[test]
    fn a_sampled_spring_leaks_what_theory_says() {
        // Into a wall of stiffness K at speed v and out again: the hold leaks K T / 2 * integral of v^2.
        let (k, v) = (1000.0, 0.1);
        let mut account = EnergyAccount::new(0.0);
        let mut x: f64 = 0.0;
        for tick in 0..=40 {
            account.moved_to(&Pose::at(DVec3::X * x), STANDING);
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
    fn a_limited_wall_of_any_stiffness_gives_back_no_more_than_it_took() {
        for stiffness in [100.0, 1000.0, 3000.0, 10_000.0] {
            for damping in [0.0, 0.1, 1.0] {
                for k in 0..40 {
                    let (speed, phase) =
                        (0.05 + 0.0125 * f64::from(k), f64::from(k * 7 % 40) / 40.0);
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
    fn noise_within_a_step_of_the_encoder_takes_nothing_off_a_resting_force() {
        let mut account = EnergyAccount::new(1e-5);
        let stiffness_n_per_m = 1000.0;
        for tick in 0..600_000u32 {
            // Pressed in quietly, then at rest under noise of a step for ten minutes.
            let press = (f64::from(tick) * 1e-5).min(2e-3);
            let noise = if press < 2e-3 {
                0.0
            } else {
                [0.0, 1e-5, 0.0, 0.0, 1e-5][tick as usize % 5]
            };
            let depth = press + noise;
            account.moved_to(&Pose::at(DVec3::X * -depth), STANDING);
            let wanted = push(stiffness_n_per_m * depth);
            let spring = CouplingSpring {
                stiffness_n_per_m,
                stored_j: 0.5 * stiffness_n_per_m * depth * depth,
            };
            let share = account.share(wanted, spring, CarriedWork::default());
            // By no more than the noise itself shows in the force.
            assert!(
                wanted.force.x * (1.0 - share) <= stiffness_n_per_m * 1e-5,
                "tick {tick}: {share}"
            );
            let given = push(wanted.force.x * share);
            account.set_output(given, given);
        }
    }

    #[test]
    fn a_surface_that_carries_the_device_along_takes_nothing_off_its_force() {
        // A surface comes at 1 m/s onto a device that it carries along from then on, pressed in by a millimetre.
        let stiffness_n_per_m = 1000.0;
        for carried in [true, false] {
            let mut account = EnergyAccount::new(0.0);
            let (mut surface, mut device, mut force) = (0.0f64, 1e-3f64, 0.0f64);
            let mut least = f64::INFINITY;
            for tick in 0..2000 {
                surface += PERIOD_S;
                device = device.max(surface - 1e-3);
                let work = if carried { force * PERIOD_S } else { 0.0 };
                account.moved_to(&Pose::at(DVec3::X * device), [work; 2]);
                let depth = (surface - device).max(0.0);
                let wanted = push(stiffness_n_per_m * depth);
                let spring = CouplingSpring {
                    stiffness_n_per_m,
                    stored_j: 0.5 * stiffness_n_per_m * depth * depth,
                };
                let ahead = CarriedWork {
                    pushed_j: if carried {
                        wanted.force.x * PERIOD_S
                    } else {
                        0.0
                    },
                    turned_j: 0.0,
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
                // Such an account lets nobody be pushed: the reason for the other.
                assert!(least < 0.1, "{least}");
            }
        }
    }
}
