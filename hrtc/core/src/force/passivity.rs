//! The energy account of a probe, and its limit of the force (Hannaford 2002).
//!
//! A sampled force is constant for a period while the device moves on. A virtual wall of stiffness
//! K therefore returns more energy than it received: `K T / 2 ∫ v² dt` (Colgate 1994).
//!
//! # Observed energy
//!
//! With the force f, the torque t, the position x of the device and its rotation vector θ in the
//! period, the energy that the rendering has put out is exact under zero-order hold:
//! `E[k+1] = E[k] + f[k] · (x[k+1] - x[k]) + t[k] · θ - W_carried`. Two sums are kept: of the whole
//! wrench for the record, and since the start of the contact of the passive wrench, for the limit.
//!
//! # Limit
//!
//! Hannaford 2002 dissipates the excess afterwards by added damping. Here the excess is not put
//! out: the passive wrench is scaled by a share from 0 to 1. Apart from the fading below, the share
//! is less than 1 only while the device moves away from the surface. With W the work in the coming
//! period over the extrapolated motion, K the stiffness, and d the change of length of the spring
//! between device and proxy:
//!
//! - Hold: `share = (W - K d² / 2) / W`. The work of the scaled force is then the loss of energy of
//!   the spring in the period.
//! - Unpaid energy: a contact may begin between two ticks, a tick may be missed, or a surface may
//!   rise. The spring then holds more energy U than the device put in. Until that is compensated,
//!   up to `K d²` more is taken off W. It is proportional to v²: a device at rest is unaffected.
//! - Account: `share W` is at most the energy that the contact has taken in.
//! - Slew: the force limiter behind the account lets a force F fall by at most s in a tick. It is
//!   scaled so far that the energy taken in also pays for its work while it falls to zero, about
//!   `u F² / 2 s` at a motion u in a tick. That begins where `K v` is above the slew limit.
//!
//! The force is never reversed, so a surface does not stick.
//!
//! A contact lasts for as long as a passive wrench is wanted, whatever its share. Within it nothing
//! that was put out is forgotten. Afterwards an excess fades with `EXCESS_FADES_S`: kept for
//! ever, it would mute the next contacts after a device was silent inside a surface; dropped at
//! once, a buzz of short contacts could go on, each with an excess.
//!
//! # Fading
//!
//! Where U is above the energy A taken in, the force fades towards `√(A / U)` of itself while the
//! device moves away, and returns later. Each change is at most the perception limit of a tick; the
//! fading is also at most `W / U` in a tick.
//!
//! Work that no spring gives back, of a force that is shaded or of a boundary that comes, would
//! empty the account and end the force at once. It fades before: what such work takes in a period
//! is at most half of the perception limit's share of what is left. So it may grow twofold, and the
//! account still empties no faster than a force may fade.
//!
//! # Extrapolation
//!
//! A motion that is out of line with those before it, by a jump or a stop, is neither a velocity
//! nor an acceleration yet: what comes next is then the median of the last three. Along an axis
//! without work for the longest window of the velocity estimate, what moves is the noise of the
//! encoder.
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

use super::positions::{Positions, next_of};
use crate::perception::{STEP_N_PER_S, STEP_SHARE_PER_S};
use crate::tuning::force::{
    EXCESS_FADES_S, LEAK_SHARE, MOTION_ROUNDING, RAISED_FADES_S, VELOCITY_WINDOW_S,
};
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};
use mutants::{Mutant, is};

/// Observes the energy that the rendering puts out, and limits the passive wrench by it.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct EnergyAccount {
    /// Step of the encoder, metres; 0 for none. A way back of up to two, but for rounding, is noise
    /// and does no work on the limited part. The same holds for the orientation and its step.
    encoder_m: f64,
    period_s: f64,
    /// Longest window of the velocity estimate, periods.
    window: usize,
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
    /// Energy in the spring in the last period, joules.
    stored_j: f64,
    /// Wrench on the device in this period.
    wrench: Wrench,
    /// Its limited part.
    limited: Wrench,
    /// `None` before the first sample.
    positions: Option<Positions>,
    /// Position up to which the limited part has done its work, metres.
    worked_to: DVec3,
    /// The last displacement there along each axis, metres.
    course: DVec3,
    /// Periods since then.
    still: [u64; 3],
    /// Estimated motion in a period, metres: now, one and two periods ago.
    motion: [DVec3; 3],
    /// Orientation at the newest sample.
    orientation: DQuat,
    /// Rotation vector of a period, radians, without the noise of the encoder.
    rotation: DVec3,
    /// Step of the measured orientation, radians; 0 for none.
    encoder_rad: f64,
    /// Rotation vector that has not done its work on the limited part, radians: noise.
    unturned: DVec3,
    /// The last rotation that has about each axis, radians.
    turning: DVec3,
    /// Largest change in a period of a force that has passed the account, newtons.
    slew_n: f64,
}

/// Work of the wrenches on the device over the motion of the surface's material; 0 at rest.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CarriedWork {
    /// Work of the forces, joules.
    pub pushed_j: f64,
    /// Work of the torques, joules.
    pub turned_j: f64,
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
        Self {
            encoder_m,
            period_s,
            window: (VELOCITY_WINDOW_S / period_s).round().max(1.0) as usize,
            joules: 0.0,
            contact_joules: 0.0,
            raised_j: 0.0,
            given_j: 0.0,
            is_apart: false,
            paid: 1.0,
            stored_j: 0.0,
            wrench: Wrench::ZERO,
            limited: Wrench::ZERO,
            positions: None,
            worked_to: DVec3::ZERO,
            course: DVec3::ZERO,
            still: [0; 3],
            motion: [DVec3::ZERO; 3],
            orientation: DQuat::IDENTITY,
            rotation: DVec3::ZERO,
            encoder_rad: 0.0,
            unturned: DVec3::ZERO,
            turning: DVec3::ZERO,
            slew_n: f64::INFINITY,
        }
    }

    /// The same before a limit of the force's change in a tick, newtons.
    #[must_use]
    pub fn with_slew(self, slew_n: f64) -> Self {
        Self { slew_n, ..self }
    }

    /// The same with a step of the measured orientation, radians.
    #[must_use]
    pub fn with_angular_step(self, encoder_rad: f64) -> Self {
        Self {
            encoder_rad,
            ..self
        }
    }

    /// Adds the work of the last wrench, from the pose of the device (world, metres) at the end of
    /// its period. `elapsed`: periods since the last call; `periods`: those that the motion took,
    /// more after calls with the same pose, while there was no sample. `carried` and
    /// `limited`: work over the motion of the material, joules, of the
    /// whole wrench and of its limited part; both are subtracted.
    pub fn moved_to(
        &mut self,
        pose: &Pose,
        [elapsed, periods]: [u64; 2],
        [carried, limited]: [f64; 2],
    ) {
        let position = pose.position;
        let turn = pose.orientation * self.orientation.inverse();
        self.orientation = pose.orientation;
        let Some(positions) = &mut self.positions else {
            self.positions = Some(Positions::at(position));
            (self.worked_to, self.course) = (position, DVec3::ZERO);
            return;
        };
        let Wrench { force, torque } = self.wrench;
        // At most half a turn.
        let turned = (if turn.w < 0.0 { -turn } else { turn }).to_scaled_axis();
        let work = force.dot(position - positions.newest()) + torque.dot(turned);
        self.joules += work - carried;
        positions.add(position, [elapsed, periods]);
        let estimated = positions.motion(self.encoder_m, self.window);
        let beyond = position - self.worked_to;
        let noise = 2.0 * self.encoder_m + MOTION_ROUNDING * position.abs().max_element();
        let motion = without_noise(beyond, noise, &mut self.course);
        self.worked_to += motion;
        self.unturned += turned;
        let rotation = without_noise(self.unturned, 2.0 * self.encoder_rad, &mut self.turning);
        self.unturned -= rotation;
        self.rotation = rotation / periods as f64;
        let Wrench { force, torque } = self.limited;
        let work = force.dot(motion) + torque.dot(rotation);
        let lost = work - limited;
        let of_raised = lost.clamp(0.0, self.raised_j);
        self.raised_j -= of_raised;
        self.given_j += of_raised;
        self.contact_joules += lost - of_raised;
        let lasting = self.without_noise_at_rest(estimated, motion, elapsed);
        self.motion = [lasting, self.motion[0], self.motion[1]];
        if estimated == DVec3::ZERO && turned == DVec3::ZERO {
            // It does not give way.
            self.raised_j = 0.0;
        }
    }

    /// An estimated motion without that along axes on which nothing was counted, `motion`, for
    /// long.
    fn without_noise_at_rest(&mut self, estimated: DVec3, motion: DVec3, elapsed: u64) -> DVec3 {
        let mut lasting = estimated;
        for axis in 0..3 {
            let still = self.still[axis].saturating_add(elapsed);
            self.still[axis] = if motion[axis] == 0.0 { still } else { 0 };
            if self.encoder_m > 0.0 && self.still[axis] > self.window as u64 {
                lasting[axis] = 0.0;
            }
        }
        lasting
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
        self.positions = None;
        self.motion = [DVec3::ZERO; 3];
        (self.rotation, self.unturned) = (DVec3::ZERO, DVec3::ZERO);
        self.turning = DVec3::ZERO;
    }

    /// Permitted share, 0 to 1, of a wanted passive wrench. It is called after [`Self::moved_to`]
    /// of the same tick. `ahead`: predicted work of the wrench over the motion of the material in
    /// the coming period.
    #[must_use]
    pub fn share(&mut self, wanted: Wrench, spring: CouplingSpring, ahead: CarriedWork) -> f64 {
        if is(Mutant::Passivity) {
            return 1.0;
        }
        self.is_apart = wanted == Wrench::ZERO;
        // As far as the hand has not paid for it already.
        let unpaid = (self.contact_joules + spring.stored_j - self.raised_j).max(0.0);
        self.raised_j += spring.raised_j.min(unpaid);
        let next = self.next();
        let pushed = wanted.force.dot(next) - ahead.pushed_j;
        let work = pushed + (wanted.torque.dot(self.rotation) - ahead.turned_j);
        let size = wanted.force.length();
        let taken_in = self.raised_j - self.contact_joules;
        let moves_away = work > self.rounding(size, ahead);
        let before = self.paid;
        let step_share = STEP_SHARE_PER_S * self.period_s;
        let imperceptible = (step_share * before).max(STEP_N_PER_S * self.period_s / size);
        self.fade(work, spring.stored_j, moves_away, imperceptible);
        let leak = self.leak(work, spring.stored_j);
        // Over a moving surface facets rise and fall under a device that is held.
        if moves_away && leak > 0.0 && ahead == CarriedWork::default() {
            let due = LEAK_SHARE * step_share * taken_in.max(0.0) / leak;
            self.paid = self.paid.min(due.max(before - imperceptible));
        }
        if !moves_away {
            return self.paid;
        }
        // Change of length of the spring, `along`. Force and torque of a tool may do opposite work,
        // so with a torque it follows from the total work and the generalised force √(2 K U).
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
        // Energy of the hold, K d² / 2.
        let hold_loss = 0.5 * spring.stiffness_n_per_m * along * along;
        // Two encoder steps of error in the balance are tolerated.
        let steps = size * self.encoder_m + wanted.torque.length() * self.encoder_rad;
        let unpaid = spring.stored_j - taken_in - 2.0 * steps;
        let given = work - hold_loss - unpaid.clamp(0.0, 2.0 * hold_loss);
        let taken_in = taken_in.max(0.0);
        let with_fall = work + self.work_of_fall(wanted.force, work);
        let payable = if with_fall > work {
            // The work of the fall is at least quadratic in the force.
            (taken_in / with_fall).sqrt()
        } else {
            1.0
        };
        self.paid = self.paid.min(taken_in / work).min(payable);
        (given / work).min(self.paid).clamp(0.0, 1.0)
    }

    /// The paid share fades, or returns, by no more than is `imperceptible`. `work`: of the force
    /// in the coming period.
    fn fade(&mut self, work: f64, stored_j: f64, moves_away: bool, imperceptible: f64) {
        let taken_in = (self.raised_j - self.contact_joules).max(0.0);
        let due = if moves_away && stored_j > taken_in {
            (taken_in / stored_j).sqrt()
        } else {
            1.0
        };
        // No faster than the device takes energy out of the spring.
        let fades = imperceptible.min(work.max(0.0) / stored_j);
        let slowest = self.paid - fades;
        self.paid = due.max(slowest).min(self.paid + imperceptible).min(1.0);
    }

    /// Of the work in the coming period, what no spring gives back: it is expected to give as much
    /// as in the last one.
    fn leak(&mut self, work: f64, stored_j: f64) -> f64 {
        let released = (self.stored_j - stored_j).clamp(0.0, work.max(0.0));
        self.stored_j = stored_j;
        work - released
    }

    /// Work, joules, of a force after the coming period, in which it does `work`, while it falls to
    /// zero as fast as it may and the device goes on as it does. Over n = F / s periods of a motion
    /// u that grows by a: `Σ (F - k s) (u + k a)`, k = 1 to n, hence
    /// `u F (n - 1) / 2 + a F n² / 6`.
    fn work_of_fall(&self, force: DVec3, work: f64) -> f64 {
        let size = force.length();
        let periods = size / self.slew_n;
        if periods <= 1.0 {
            return 0.0;
        }
        let growth = (self.next() - self.motion[0]).dot(force).max(0.0);
        0.5 * work * (periods - 1.0) + growth * periods * periods / 6.0
    }

    /// Bound of the rounding error in the work relative to a moving surface, joules; 0 for a
    /// surface at rest. `force` in newtons.
    fn rounding(&self, force: f64, ahead: CarriedWork) -> f64 {
        if ahead == CarriedWork::default() {
            return 0.0;
        }
        let place = self.positions.map_or(0.0, |of| of.newest().length());
        let terms = force * place + ahead.pushed_j.abs() + ahead.turned_j.abs();
        MOTION_ROUNDING * terms
    }

    /// Energy that the contact took in beyond the energy in its spring, joules, at least 0. A
    /// rising surface may add this much to the spring.
    #[must_use]
    pub fn reserve(&self, spring: CouplingSpring) -> f64 {
        (0.0 - self.contact_joules - spring.stored_j).max(0.0)
    }

    /// Sets the wrench on the device for the coming period, and its `limited` part, which has
    /// passed [`Self::share`].
    pub fn set_output(&mut self, wrench: Wrench, limited: Wrench) {
        // A contact begins without credit.
        if self.limited == Wrench::ZERO {
            self.contact_joules = self.contact_joules.max(0.0);
            self.raised_j = 0.0;
        }
        self.wrench = wrench;
        self.limited = limited;
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
        let [now, before, earlier] = self.motion;
        let along = |k: usize| next_of([earlier[k], before[k], now[k]]);
        DVec3::new(along(0), along(1), along(2))
    }

    /// Permitted share, 0 to 1, of a wanted force. At the end of the coming period the energy put
    /// out plus `stored_j`, the energy in the spring then, is at most the energy taken in.
    #[must_use]
    pub fn share_of_spring(&self, wanted: DVec3, stored_j: f64) -> f64 {
        let work = wanted.dot(self.next());
        if work.is_nan() || work <= 0.0 || is(Mutant::Passivity) {
            return 1.0;
        }
        // Two encoder steps of error in the balance are tolerated.
        let noise = 2.0 * wanted.length() * self.encoder_m;
        ((noise - self.contact_joules - stored_j) / work).clamp(0.0, 1.0)
    }

    /// An empty account of the same device.
    #[must_use]
    pub fn restarted(&self) -> Self {
        Self::new(self.encoder_m, self.period_s).with_angular_step(self.encoder_rad)
    }

    /// Estimated motion in the last period, metres, without the noise of the encoder.
    #[must_use]
    pub fn motion(&self) -> DVec3 {
        self.motion[0]
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

/// Of a displacement (or rotation) since the last one that was counted: along each axis all of it
/// where it goes on or is too long for noise, else nothing. A position that followed an encoder
/// step behind would be late at every turn: a force that is less on the way in than on the way out
/// would put out two steps of work unseen each time, for ever. `noise`: the longest way back that
/// is none. `course`: the last one counted.
fn without_noise(beyond: DVec3, noise: f64, course: &mut DVec3) -> DVec3 {
    let mut motion = DVec3::ZERO;
    for axis in 0..3 {
        let along = beyond[axis];
        if along * course[axis] > 0.0 || along.abs() > noise {
            motion[axis] = along;
            course[axis] = along;
        }
    }
    motion
}

#[cfg(test)]
mod tests;
