//! The energy account of a probe, and its limit of the force (Hannaford 2002).
//!
//! A sampled force is constant for a period while the device moves on. A virtual wall of stiffness
//! K therefore returns more energy than it received: `K T / 2 ∫ v² dt` (Colgate 1994).
//!
//! # Observed energy
//!
//! With the force f, the torque t, the position x of the device and its rotation vector θ in the
//! period, the energy that the rendering has put out is exact under zero-order hold:
//! `E[k+1] = E[k] + f[k] · (x[k+1] - x[k]) + t[k] · θ - W_carried`. Position and rotation are those
//! within the encoder's steps ([`super::device_motion`]). Two sums are kept: of the whole
//! wrench for the record, and since the start of the contact of the passive wrench, for the limit.
//!
//! # Limit
//!
//! Hannaford 2002 dissipates the excess afterwards by added damping. Here the excess is not put
//! out: the passive wrench is scaled by a share from 0 to 1. Of the wanted wrench, let W be its
//! work in the coming period over the extrapolated motion, U the energy in its spring and K the
//! stiffness of that, and d the change of length of the spring. A is the energy that the contact
//! has taken in, N that of two encoder steps, an error of the balance that is tolerated. A share p
//! of the spring is paid for (see below). While the device moves away:
//!
//! - Hold: `p (W - K d² / 2)`. The work of the scaled force is then the loss of energy of the
//!   spring in the period. What the spring holds beyond A, since a contact began between two ticks
//!   or a tick was missed, is compensated by up to `K d²` more. It is proportional to v²: a device
//!   at rest is unaffected.
//! - Account: the work is at most A.
//! - Slew: the force limiter behind the account lets a force F fall by at most s in a tick. It is
//!   scaled so far that A also pays for its work while it falls to zero, about `u F² / 2 s` at a
//!   motion u in a tick. The same holds for a torque.
//!
//! The force is never reversed, so a surface does not stick.
//!
//! A contact lasts for as long as a passive wrench is wanted, whatever its share. Within it nothing
//! that was put out is forgotten. Afterwards an excess fades with `EXCESS_FADES_S`: kept for
//! ever, it would mute the next contacts after a device was silent inside a surface; dropped at
//! once, a buzz of short contacts could go on, each with an excess.
//!
//! # Share that is paid for
//!
//! At the share `c = (A + N) / U` what was taken in and the spring are used up together: the work
//! of that force leaves c as it is. The share p follows c:
//!
//! - While the device moves away with `p > c`, p falls by `2 p (p - c) W / (A + N)`. So c falls in
//!   proportion to `p / c` while that goes to 1. The account cuts the force before that only where
//!   A is less than N; then p is c at once, so that the force does not come back in the next tick.
//!   Work that no spring gives back, as of a force that is shaded, lowers c; p follows at up to
//!   twice c, and falls as what is left does. The faster the device leaves, the faster p falls,
//!   also beyond the perception limit: A would else be used up, and the force cut. By as much as p
//!   must fall to stay as far above c, it falls towards it: that is the 2.
//! - With `p < c` it rises by the perception limit of a tick.
//! - While the device does not move away, p rises to `RETURNS_TO` times c, and by `RETURNS_BEYOND`
//!   imperceptible forces beyond; the slower the less is paid for, by c of the perception limit of
//!   a tick (at least with `UNPAID_RETURNS_S`, so that it returns at all). What returns must fade
//!   again at the next turn: a hand that trembles would notice that the force comes and goes, and
//!   one that rests gives way to what returns. A hand that presses on pays for more.
//! - Over material that moves facets rise under the device as much as they fell. So p falls no
//!   faster than by `W / U` and the perception limit, and rises to 1: by the share of U that a
//!   force along the motion would do as work, and by the perception limit at the most.
//!
//! With a torque these forces are generalised ones, in the metric of the coupling.
//!
//! # Extrapolation
//!
//! A motion that is out of line with those before it, by a jump or a stop, is neither a velocity
//! nor an acceleration yet: what comes next is then the median of the last three. It may be the
//! first of others like it, so the work is that over the last motion where that is more. Along an
//! axis without work for the longest window of the velocity estimate, what moves is the noise of
//! the encoder.
//!
//! # Moving surfaces
//!
//! A moving surface carries the device along and does work on it. The account is that of the spring
//! between device and surface, so the work over the motion of the material ([`CarriedWork`]) is
//! subtracted.
//!
//! A surface that is refined under the probe moves too, by imperceptible steps, and so does a force
//! that returns (see [`CouplingSpring::raised_j`]). A hand gives way to it: what it gave may be put
//! out beyond the energy taken in, but only while the device moves, and only what is given of late
//! (`RAISED_FADES_S`). A device that stands and is withdrawn later gets none of it.

use super::device_motion::{DeviceMotion, Displacement};
use crate::perception::{IMPERCEPTIBLE_N, STEP_N_PER_S, STEP_SHARE_PER_S};
use crate::tuning::force::{
    EXCESS_FADES_S, MOTION_ROUNDING, RAISED_FADES_S, RETURNS_BEYOND, RETURNS_TO, UNPAID_RETURNS_S,
    VELOCITY_WINDOW_S,
};
use geometry::portable::rotation_vector;
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};
use mutants::{Mutant, is};

/// Observes the energy that the rendering puts out, and limits the passive wrench by it.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct EnergyAccount {
    period_s: f64,
    /// Energy put out by the whole wrench, joules.
    joules: f64,
    /// Energy put out by the limited part since the contact began, joules; after it, what is left
    /// of the excess.
    contact_joules: f64,
    /// What the surfaces gave of late and was not put out, joules.
    raised_j: f64,
    /// What was put out of it so far, joules.
    given_j: f64,
    /// Whether no passive wrench is wanted in this period: the contact is over.
    is_apart: bool,
    /// Share of the force that the energy taken in allows, 0 to 1; it fades.
    paid: f64,
    /// Wrench on the device in this period.
    wrench: Wrench,
    /// Its limited part.
    limited: Wrench,
    /// Metres.
    translation: DeviceMotion,
    /// Radians: the sum of the rotation vectors of all periods.
    rotation: DeviceMotion,
    /// Orientation at the newest sample.
    orientation: DQuat,
    /// Displacement and turn of this tick that are not booked yet; none between two ticks.
    #[serde(skip)]
    seen: Option<(Displacement, Displacement)>,
    /// Largest change in a period of a force, newtons, and of a torque, newton metres, that has
    /// passed the account.
    slew: [f64; 2],
}

/// Work of the wrenches on the device over the motion of the surface's material; 0 at rest.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CarriedWork {
    /// Work of the forces, joules.
    pub pushed_j: f64,
    /// Work of the torques, joules.
    pub turned_j: f64,
    /// What both would be along the motion, joules.
    pub most_j: f64,
}

impl CarriedWork {
    /// Their sum, joules.
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
            most_j: self.most_j + other.most_j,
        }
    }
}

/// The springs between the device and its proxies, as a sum.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct CouplingSpring {
    /// Stiffness, N/m.
    pub stiffness_n_per_m: f64,
    /// Stored energy, joules.
    pub stored_j: f64,
    /// What was given to it in this tick, joules: by a surface that moves, or of what was unpaid.
    pub raised_j: f64,
}

impl CouplingSpring {
    /// A fraction of it.
    #[must_use]
    pub fn times(self, share: f64) -> Self {
        Self {
            stiffness_n_per_m: self.stiffness_n_per_m * share,
            stored_j: self.stored_j * share,
            raised_j: self.raised_j * share,
        }
    }
}

impl std::ops::Add for CouplingSpring {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            stiffness_n_per_m: self.stiffness_n_per_m + other.stiffness_n_per_m,
            stored_j: self.stored_j + other.stored_j,
            raised_j: self.raised_j + other.raised_j,
        }
    }
}

impl EnergyAccount {
    /// An empty account. `encoder_m`: step of the device's encoder, metres; 0 for none.
    #[must_use]
    pub fn new(encoder_m: f64, period_s: f64) -> Self {
        let window = (VELOCITY_WINDOW_S / period_s).round().max(1.0) as usize;
        Self {
            period_s,
            joules: 0.0,
            contact_joules: 0.0,
            raised_j: 0.0,
            given_j: 0.0,
            is_apart: false,
            paid: 1.0,
            wrench: Wrench::ZERO,
            limited: Wrench::ZERO,
            translation: DeviceMotion::new(encoder_m, window),
            rotation: DeviceMotion::new(0.0, window),
            orientation: DQuat::IDENTITY,
            seen: None,
            slew: [f64::INFINITY; 2],
        }
    }

    /// The same before a limit of the change in a tick: of the force, newtons, and of the torque,
    /// newton metres.
    #[must_use]
    pub fn with_slew(self, slew: [f64; 2]) -> Self {
        Self { slew, ..self }
    }

    /// The same with a step of the measured orientation, radians.
    #[must_use]
    pub fn with_angular_step(self, encoder_rad: f64) -> Self {
        let rotation = self.rotation.with_step(encoder_rad);
        Self { rotation, ..self }
    }

    /// [`Self::see`] and [`Self::book`].
    pub fn moved_to(&mut self, pose: &Pose, periods: [u64; 2], carried: [f64; 2]) {
        self.see(pose, periods);
        self.book(carried);
    }

    /// [`Self::see_nothing`] and [`Self::book`].
    pub fn go_on(&mut self, elapsed: u64, carried: [f64; 2]) {
        self.see_nothing(elapsed);
        self.book(carried);
    }

    /// Takes the pose of the device (world, metres) at the end of a period. `elapsed`: periods
    /// since the last call of this or of [`Self::see_nothing`]; `periods`: those that the motion
    /// took, more where there was no sample.
    pub fn see(&mut self, pose: &Pose, [elapsed, periods]: [u64; 2]) {
        let turned = rotation_vector(pose.orientation * self.orientation.inverse());
        self.orientation = pose.orientation;
        let turned_to = self.rotation.newest().unwrap_or_default() + turned;
        let moved = self.translation.moved_to(pose.position, [elapsed, periods]);
        let turned = self.rotation.moved_to(turned_to, [elapsed, periods]);
        self.seen = moved.zip(turned);
    }

    /// There is no sample after `elapsed` periods: the device has gone on as it did. For one at
    /// rest neither hold nor leak would be paid for in these periods, and a force that may return
    /// there would have to be cut at the next sample.
    pub fn see_nothing(&mut self, elapsed: u64) {
        let moved = self.translation.go_on(elapsed);
        self.seen = moved.zip(self.rotation.go_on(elapsed));
    }

    /// Adds the work of the last wrench over the motion that was seen. `carried` and `limited`:
    /// work over the motion of the material, joules, of the whole wrench and of its limited part;
    /// both are subtracted.
    pub fn book(&mut self, [carried, limited]: [f64; 2]) {
        let Some((moved, turned)) = self.seen.take() else {
            return;
        };
        let Wrench { force, torque } = self.wrench;
        let work = force.dot(moved.whole) + torque.dot(turned.whole);
        self.joules += work - carried;
        let Wrench { force, torque } = self.limited;
        let work = force.dot(moved.without_noise) + torque.dot(turned.without_noise);
        let lost = work - limited;
        // Not `clamp`, which has a panic.
        let of_raised = lost.min(self.raised_j).max(0.0);
        self.raised_j -= of_raised;
        self.given_j += of_raised;
        self.contact_joules += lost - of_raised;
        if moved.is_at_rest && turned.is_at_rest {
            // It does not give way.
            self.raised_j = 0.0;
        }
    }

    /// So much time has passed, seconds: what surfaces gave fades, and the excess of a contact that
    /// is over.
    pub fn pass_time(&mut self, seconds: f64) {
        self.raised_j *= RAISED_FADES_S / (RAISED_FADES_S + seconds);
        if self.is_apart {
            // Exponential decay by the implicit Euler method: stable for any time.
            self.contact_joules *= EXCESS_FADES_S / (EXCESS_FADES_S + seconds);
        }
    }

    /// The next pose is no motion: no work leads there. The sums stay.
    pub fn go_to_new_place(&mut self) {
        self.translation.go_to_new_place();
        self.rotation.go_to_new_place();
    }

    /// Permitted share, 0 to 1, of a wanted passive wrench. It is called after [`Self::moved_to`]
    /// of the same tick. `ahead`: predicted work of the wrench over the motion of the material in
    /// the coming period.
    #[must_use]
    pub fn share(&mut self, wanted: Wrench, spring: CouplingSpring, ahead: CarriedWork) -> f64 {
        if is(Mutant::Passivity) {
            return 1.0;
        }
        if is(Mutant::Mute) {
            return 1.0 / 3.0;
        }
        self.is_apart = wanted == Wrench::ZERO;
        // As far as the hand has not paid for it already.
        let unpaid = (self.contact_joules + spring.stored_j - self.raised_j).max(0.0);
        self.raised_j += spring.raised_j.min(unpaid);
        let pushed = most_work(wanted.force, &self.translation) - ahead.pushed_j;
        let turned = most_work(wanted.torque, &self.rotation) - ahead.turned_j;
        let work = pushed + turned;
        let size = wanted.force.length();
        let taken_in = (self.raised_j - self.contact_joules).max(0.0);
        // Two encoder steps of error in the balance are tolerated.
        let steps = size * self.translation.step() + wanted.torque.length() * self.rotation.step();
        let paid_j = taken_in + 2.0 * steps;
        // With a torque the force may be none: the size is that of the generalised force, √(2 K U).
        let pull = (2.0 * spring.stiffness_n_per_m * spring.stored_j).sqrt();
        let generalised = if wanted.torque == DVec3::ZERO {
            size
        } else {
            size.max(pull)
        };
        let leaves = work > self.rounding(size, ahead);
        self.follow(
            leaves.then_some(work),
            [paid_j, spring.stored_j, ahead.most_j],
            generalised,
        );
        if !leaves {
            return self.paid;
        }
        // Change of length of the spring, `along`. Force and torque of a tool may do opposite work,
        // so with a torque it follows from the total work and the generalised force.
        let (work_of_spring, pull) = if wanted.torque == DVec3::ZERO {
            (pushed, size)
        } else {
            (work, pull)
        };
        let along = if pull > 0.0 {
            work_of_spring / pull
        } else {
            0.0
        };
        // Energy of the hold, K d² / 2.
        let hold_loss = 0.5 * spring.stiffness_n_per_m * along * along;
        let unpaid = self.paid * spring.stored_j - paid_j;
        let held = self.paid * (work - hold_loss - unpaid.clamp(0.0, 2.0 * hold_loss)) / work;
        // At a share s the force does the work s W, and s² of its fall's or less while it falls.
        let fall = self.most_work_of_fall(wanted, [pushed, turned]);
        let payable = 2.0 * taken_in / (work + (work * work + 4.0 * fall * taken_in).sqrt());
        // What is cut comes back as what is unpaid does, but for the error that is tolerated.
        let paid_for = paid_j / spring.stored_j;
        self.paid = self.paid.min(payable.max(paid_for));
        held.min(payable).clamp(0.0, 1.0)
    }

    /// The share that is paid for follows the energies that are paid for and in the spring, joules:
    /// see the module; the third is the most work over the motion of the material in the coming
    /// period. `leaving`: work of the wanted wrench in that, joules, where the device moves
    /// away. `generalised`: size of the wrench, newtons.
    fn follow(
        &mut self,
        leaving: Option<f64>,
        [paid_j, stored_j, carried_j]: [f64; 3],
        generalised: f64,
    ) {
        // Not a number without a spring: all is paid for.
        let paid_for = (paid_j / stored_j).min(1.0);
        let least_n = STEP_N_PER_S * self.period_s / generalised;
        let imperceptible = (STEP_SHARE_PER_S * self.period_s * self.paid).max(least_n);
        let excess = self.paid - paid_for;
        self.paid = match leaving {
            Some(work) if excess > 0.0 => {
                let falls = 2.0 * self.paid * excess * work / paid_j;
                // Facets that fall away under the device rise again.
                let of_spring = imperceptible.min(work / stored_j);
                let is_carried = carried_j > 0.0;
                let falls = if is_carried {
                    falls.min(of_spring)
                } else {
                    falls
                };
                paid_for.max(self.paid - falls)
            }
            Some(_) => paid_for.min(self.paid + imperceptible),
            None => {
                let beyond = RETURNS_BEYOND * IMPERCEPTIBLE_N / generalised;
                let due = (RETURNS_TO * paid_for + beyond).max(self.paid).min(1.0);
                let slowest =
                    (1.0 - self.paid) * self.period_s / (UNPAID_RETURNS_S + self.period_s);
                let returns = (imperceptible * paid_for).max(slowest).min(due - self.paid);
                // Facets that move rise under the device as much as they fell.
                let rises = imperceptible.min(carried_j / stored_j).min(1.0 - self.paid);
                self.paid + returns.max(rises)
            }
        };
    }

    /// [`bound_of_fall`] of a wrench whose force and torque do `works` in the coming period.
    fn most_work_of_fall(&self, wrench: Wrench, works: [f64; 2]) -> f64 {
        let [slew_n, slew_nm] = self.slew;
        let force = bound_of_fall(wrench.force, works[0], &self.translation, slew_n);
        force + bound_of_fall(wrench.torque, works[1], &self.rotation, slew_nm)
    }

    /// Bound of the rounding error in the work relative to a moving surface, joules; 0 for a
    /// surface at rest. `force` in newtons.
    fn rounding(&self, force: f64, ahead: CarriedWork) -> f64 {
        if ahead == CarriedWork::default() {
            return 0.0;
        }
        let place = self.translation.newest().unwrap_or_default().length();
        let terms = force * place + ahead.pushed_j.abs() + ahead.turned_j.abs();
        MOTION_ROUNDING * terms
    }

    /// Energy that the contact took in beyond the energy in its spring, joules, at least 0. A
    /// rising surface may add this much to the spring.
    #[must_use]
    pub fn reserve(&self, spring: CouplingSpring) -> f64 {
        self.balance(spring.stored_j).max(0.0)
    }

    /// Energy that the contact took in beyond `stored_j`, joules; negative where that is more.
    #[must_use]
    pub fn balance(&self, stored_j: f64) -> f64 {
        0.0 - self.contact_joules - stored_j
    }

    /// Sets the wrench on the device for the coming period, and its `limited` part, which has
    /// passed [`Self::share`].
    pub fn set_output(&mut self, wrench: Wrench, limited: Wrench) {
        // A contact begins without credit.
        if self.limited == Wrench::ZERO {
            self.contact_joules = self.contact_joules.max(0.0);
            self.raised_j = 0.0;
        }
        // The force limiter made no force of what is not finite.
        let finite = |of: Wrench| if of.is_finite() { of } else { Wrench::ZERO };
        self.wrench = finite(wrench);
        self.limited = finite(limited);
    }

    /// The wrench of the coming period, and its limited part.
    #[must_use]
    pub fn output(&self) -> [Wrench; 2] {
        [self.wrench, self.limited]
    }

    /// Sets a force for the coming period, all of it limited. Unlike [`Self::set_output`], a zero
    /// force does not end the contact.
    pub fn set_force(&mut self, force: DVec3) {
        self.wrench = Wrench {
            force,
            torque: DVec3::ZERO,
        };
        self.limited = self.wrench;
    }

    /// Drops the energy taken in beyond `stored_j`, the energy in the spring, joules: it is
    /// dissipated and not returned later.
    pub fn dissipate_beyond(&mut self, stored_j: f64) {
        self.contact_joules = self.contact_joules.max(-stored_j);
    }

    /// Extrapolated motion in the coming period, metres.
    #[must_use]
    pub fn next(&self) -> DVec3 {
        self.translation.next()
    }

    /// An empty account of the same device.
    #[must_use]
    pub fn restarted(&self) -> Self {
        Self::new(self.translation.step(), self.period_s).with_angular_step(self.rotation.step())
    }

    /// Estimated motion in the last period, metres, without the noise of the encoder.
    #[must_use]
    pub fn motion(&self) -> DVec3 {
        self.translation.last()
    }

    /// Estimated turn in the last period, radians: a rotation vector, without the noise of the
    /// encoder.
    #[must_use]
    pub fn turn(&self) -> DVec3 {
        self.rotation.last()
    }

    /// Step of the device's encoder, metres; 0 for none.
    #[must_use]
    pub fn encoder_m(&self) -> f64 {
        self.translation.step()
    }

    /// Energy put out so far that surfaces gave by moving, joules.
    #[must_use]
    pub fn given_j(&self) -> f64 {
        self.given_j
    }

    /// Energy put out so far, joules; above 0 the rendering has been active.
    #[must_use]
    pub fn joules(&self) -> f64 {
        self.joules
    }
}

/// Most work, joules, of a force (N) or torque (N m) in the coming period: over the extrapolated
/// motion, or where the device goes on as in the last period. A jump may have been the only one, or
/// the first of a motion.
fn most_work(force: DVec3, motion: &DeviceMotion) -> f64 {
    force.dot(motion.next()).max(force.dot(motion.last()))
}

/// Bound of the work, joules, of a force (N) or torque (N m) after the coming period, in which it
/// does `work`, while it falls to zero by `slew` a period and the device goes on as it does. Over
/// n = F / s periods of a motion u that grows by a it is the sum of `(F - k s) (u + k a)` over the
/// whole k up to n, at most `u s (n - 1/2)² / 2 + a F n² / 6`. Of a share of the force it is at
/// most the square of that share. What falls against the motion puts out nothing.
fn bound_of_fall(force: DVec3, work: f64, motion: &DeviceMotion, slew: f64) -> f64 {
    let periods = force.length() / slew;
    if periods <= 1.0 {
        return 0.0;
    }
    let growth = (motion.next() - motion.last()).dot(force).max(0.0);
    let even = 0.5 * work.max(0.0) * (periods - 0.5).powi(2) / periods;
    even + growth * periods * periods / 6.0
}

#[cfg(test)]
mod tests;
