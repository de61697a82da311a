//! The energy that a probe's forces put out in a contact, over the device's exact motion.

use super::super::trace::{Checked, ensure};
use glam::DVec3;
use hrtc_core::record::{ProbeRecord, max_or_nan};
use scene::ScenePlan;
use simulated_device::DeviceState;

/// Rounding error of a position that is known exactly, metres.
const ROUNDING_M: f64 = 1e-9;

/// What a probe's forces put out.
///
/// A contact may put out no more than it took in, beside what surfaces gave that were refined under
/// the probe, up to what no sampled controller knows in time.
/// With the largest force F and speed v of the contact, the largest error h of a position that was
/// believed (the step of the encoder with the noise, or a spike that a hand could have made), n
/// periods for which the motion was not known at the longest (a sample that did not come or was
/// rejected, a stall until its wrench expires), and the slew limit s:
/// - two errors of a position in the balance, `2 F h` (of the encoder, the account tolerates it);
/// - the motion of the periods under way, `F v (n + 1) T`, which is known only afterwards;
/// - the force falls from F to 0 in `F / s` at best, on average with half of it: `F² v / (2 s)`.
///
/// This holds twice: from where a force begins to where there is none, and over the whole contact,
/// in which the force may go and come back: small excesses of many short forces add up. There each
/// fault (a motion that was not known, a position that was wrong by more than the noise) is news of
/// its own, and adds its own share.
#[derive(Debug)]
pub(super) struct Account {
    slew_n_per_s: f64,
    period_s: f64,
    /// Periods for which a force is valid.
    validity: u64,
    step_m: f64,
    /// Force in the period under way.
    force: DVec3,
    /// Whether the probe touched when it was set.
    is_touching: bool,
    /// Where the device was, and the work on it so far, joules.
    last: Option<(DVec3, f64)>,
    since_force: Balance,
    since_contact: Balance,
    /// What the faults of this contact may have put out, joules.
    faults_j: f64,
    /// What was put out so far that surfaces gave, joules.
    given_j: f64,
    /// Periods since the last sample that was believed.
    blind: u64,
    /// Whether one is believed again.
    is_seen_again: bool,
    /// Its error, metres.
    error_m: f64,
}

/// What was put out since a time.
#[derive(Debug, Clone, Copy, Default)]
struct Balance {
    /// Joules, beside what surfaces gave.
    joules: f64,
    /// The largest of each.
    worst: Held,
}

/// Periods under one force.
#[derive(Debug, Clone, Copy, Default)]
struct Held {
    /// Newtons.
    force: f64,
    /// Speed of the device, m/s.
    speed: f64,
    /// Periods for which its motion was not known.
    periods: u64,
    /// Error of where it was believed to be, metres.
    error_m: f64,
}

impl Held {
    /// The larger of each.
    fn worse(self, other: Self) -> Self {
        Self {
            force: max_or_nan(self.force, other.force),
            speed: max_or_nan(self.speed, other.speed),
            periods: self.periods.max(other.periods),
            error_m: max_or_nan(self.error_m, other.error_m),
        }
    }
}

impl Account {
    /// Before the first tick. `step_m`: error of every position, metres; `validity`: periods for
    /// which a force is valid.
    pub(super) fn new(plan: &ScenePlan, step_m: f64, validity: u64) -> Self {
        Self {
            slew_n_per_s: plan.safety.slew_n_per_s,
            period_s: 1.0 / plan.loop_.rate_hz,
            validity,
            step_m,
            force: DVec3::ZERO,
            is_touching: false,
            last: None,
            since_force: Balance::default(),
            since_contact: Balance::default(),
            faults_j: 0.0,
            given_j: 0.0,
            blind: 0,
            is_seen_again: false,
            error_m: 0.0,
        }
    }

    /// The force of the coming period, where the device was believed to be, if it was seen, and the
    /// record of the tick.
    pub(super) fn output(&mut self, force: DVec3, believed: Option<DVec3>, record: &ProbeRecord) {
        self.force = force;
        self.is_touching = record.contact;
        let given_j = record.given_j - self.given_j;
        self.given_j = record.given_j;
        self.since_force.joules -= given_j;
        self.since_contact.joules -= given_j;
        self.is_seen_again = believed.is_some() && self.blind > 0;
        self.blind = if believed.is_some() {
            0
        } else {
            self.blind + 1
        };
        if let (Some(believed), Some((place, _))) = (believed, self.last) {
            self.error_m = believed.distance(place);
        }
    }

    /// The controller was started again.
    pub(super) fn restart(&mut self) {
        self.force = DVec3::ZERO;
        self.is_touching = false;
        self.last = None;
        self.given_j = 0.0;
        self.is_seen_again = false;
        self.since_force = Balance::default();
        self.end_contact();
    }

    fn end_contact(&mut self) {
        self.since_contact = Balance::default();
        self.faults_j = 0.0;
    }

    /// The device has moved under the force for so many periods, or until the force expired.
    ///
    /// # Errors
    /// When more energy came out than may.
    pub(super) fn moved_to(&mut self, device: &DeviceState, periods: u64) -> Checked {
        let place = device.pose.position;
        let Some((last, work_j)) = self.last.replace((place, device.work_j)) else {
            return Ok(());
        };
        let size = self.force.length();
        if size == 0.0 {
            self.since_force = Balance::default();
            // A force that is withheld does not end the contact.
            if !self.is_touching {
                self.end_contact();
            }
            return Ok(());
        }
        let joules = device.work_j - work_j;
        let acting = periods.min(self.validity);
        let [whole_s, acting_s] = [periods, acting].map(|of| of as f64 * self.period_s);
        // How far it went under a force that has expired only its work tells.
        let along = joules.abs() / (size * acting_s);
        let held = Held {
            force: size,
            speed: max_or_nan(place.distance(last) / whole_s, along),
            periods: self.blind + acting,
            error_m: max_or_nan(self.step_m, self.error_m),
        };
        let is_wrong = self.error_m > 2.0 * self.step_m + ROUNDING_M;
        if self.blind > 0 {
            self.faults_j += size * held.speed * acting_s;
        } else if self.is_seen_again || periods > 1 || is_wrong {
            self.faults_j += self.unknown_j(&held);
        }
        for balance in [&mut self.since_force, &mut self.since_contact] {
            balance.joules += joules;
            balance.worst = balance.worst.worse(held);
        }
        self.check("since a force began", &self.since_force, 0.0)?;
        self.check(
            "since the contact began",
            &self.since_contact,
            self.faults_j,
        )
    }

    /// What no sampled controller knows in time, joules.
    fn unknown_j(&self, held: &Held) -> f64 {
        let under_way = held.speed * (held.periods + 1) as f64 * self.period_s;
        let fall = held.speed * held.force / (2.0 * self.slew_n_per_s);
        held.force * (2.0 * held.error_m + under_way + fall)
    }

    fn check(&self, since: &str, balance: &Balance, faults_j: f64) -> Checked {
        let Balance { joules, worst } = balance;
        let tolerance = self.unknown_j(worst) + faults_j;
        ensure(*joules <= tolerance, "energy of a contact", || {
            let mj = 1e3;
            format!(
                "{since}: {:.4} mJ put out, {:.4} mJ tolerated (force to {:.2} N, speed to {:.3} m/s)",
                joules * mj,
                tolerance * mj,
                worst.force,
                worst.speed,
            )
        })
    }
}
