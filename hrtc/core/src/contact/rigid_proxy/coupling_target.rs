//! The end of the coupling. While a tick stops before the proxy has converged, proxy lag must not
//! become force, and an estimated target moves at a limited rate. Where the proxy has converged but
//! has gone far, over a ridge, the coupling follows it over a few ticks.

use super::{ToolAdvance, ToolProxy};
use crate::contact::motion::{Placement, Twist};
use crate::perception::{GROWTH_PER_S, OF_PROXY, STEP_SHARE_PER_S};
use mutants::{Mutant, is};

/// Largest motion of an estimated target, in units of the device's motion: a sliding tool moves
/// with the device, one that falls off an edge faster.
const MAX_TARGET_RATE: f64 = 4.0;

/// What a hand cannot perceive of the coupling.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Imperceptible {
    /// Its deflection, model units.
    pub deflection: f64,
    /// Change of its deflection in a period, model units.
    pub step: f64,
    /// Period of the loop, seconds.
    pub period_s: f64,
}

impl Imperceptible {
    /// Everything is perceived, at 1 kHz.
    pub(super) const NOTHING: Self = Self {
        deflection: 0.0,
        step: 0.0,
        period_s: 1e-3,
    };
}

impl ToolProxy {
    /// The placement that the known contacts allow, without the limits of a tick. If no step found
    /// contacts, its own become the answer's.
    pub(super) fn target_allowed_by_contacts(&mut self, answer: &mut ToolAdvance) -> Placement {
        let offset = self.contact_offset();
        self.contacts.carry(&self.at);
        self.add_stops(offset);
        let wanted = self.at.to(&self.goal);
        let mut allowed = ToolAdvance::new();
        let path = self.allowed(&wanted, offset, Some(&mut allowed));
        if answer.contact_count == 0 {
            answer.contacts = allowed.contacts;
            answer.contact_count = allowed.contact_count;
        }
        let is_free = allowed.contact_count == 0;
        if self.step_limit.is_limited() {
            // While the surface moves, catching up must not be perceptible.
            self.at
        } else if is_free {
            self.goal
        } else {
            // Unknown contacts may stop the proxy earlier: the target moves no farther than the
            // device has.
            let share = self.device_travel / path.farthest(self.shape.radius);
            self.at.moved(&path.times(share.min(1.0)))
        }
    }

    /// Limits the motion of the target in a tick in which the device made a `motion`. An estimate,
    /// and the true target after it, change with every contact found or lost. At rest in the world,
    /// the device's own motion deflects the coupling. Beyond that the deflection changes by at most
    /// the device's motion or an imperceptible amount, and grows no faster than its energy may grow
    /// unpaid.
    pub(super) fn limit_target_rate(&mut self, motion: &Twist) {
        let is_true = self.coupling_target == self.at;
        if is_true && !self.is_estimate {
            self.follow(motion);
            return;
        }
        let radius = self.shape.radius;
        let change = self.goal.to(&self.coupling_target).minus(&self.deflection);
        let Imperceptible {
            deflection: imperceptible,
            period_s,
            ..
        } = self.imperceptible;
        let imperceptible = imperceptible.max(self.static_offset());
        let growth = GROWTH_PER_S * period_s;
        let most = (MAX_TARGET_RATE * motion.farthest(radius) + self.step_limit.limit())
            .max(self.imperceptible_change(self.deflection.farthest(radius)));
        let share = (most / change.farthest(radius)).min(1.0);
        let deflection = self.deflection.plus(&change.times(share));
        let before = self.length_of(&self.deflection);
        let longest = before.hypot(growth.sqrt() * before.max(imperceptible));
        let shorter = (longest / self.length_of(&deflection)).min(1.0);
        self.is_estimate = !is_true || share < 1.0 || shorter < 1.0;
        if share < 1.0 || shorter < 1.0 {
            self.coupling_target = self.goal.moved(&deflection.times(shorter));
        }
    }

    /// Lets the coupling follow a proxy that has converged. Over a convex set of placements the
    /// deflection changes by no more than the device moves, in the metric of the tool's mass;
    /// beyond that, behind a ridge, by no more than is imperceptible in a tick.
    fn follow(&mut self, motion: &Twist) {
        let before = self.deflection.plus(motion);
        let change = self.goal.to(&self.at).minus(&before);
        let most = self.length_of(motion) + self.imperceptible_change(self.length_of(&before));
        let length = self.length_of(&change);
        if length > most && !is(Mutant::Geomorph) {
            let deflection = before.plus(&change.times(most / length));
            self.coupling_target = self.goal.moved(&deflection);
        }
    }

    /// Change of a deflection in a tick that a hand cannot perceive, model units.
    fn imperceptible_change(&self, deflection: f64) -> f64 {
        let Imperceptible { step, period_s, .. } = self.imperceptible;
        let of_deflection = OF_PROXY * STEP_SHARE_PER_S * period_s * deflection;
        of_deflection.max(step).max(self.static_offset())
    }
}
