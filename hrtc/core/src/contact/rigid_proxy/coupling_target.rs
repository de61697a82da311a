//! The end of the coupling. While a tick stops before the proxy has converged, proxy lag must not
//! become force: the target is estimated by the contacts that are known. True or estimated, it may
//! jump, over a ridge or with a contact that is found; the coupling follows over some ticks.

use super::{ToolAdvance, ToolProxy};
use crate::contact::motion::{Placement, Twist};
use crate::perception::{OF_PROXY, STEP_SHARE_PER_S};
use mutants::{Mutant, is};

/// What a hand cannot perceive of the coupling, or the device cannot tell.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Imperceptible {
    /// Change of its deflection in a period, model units.
    pub step: f64,
    /// Largest quantization error of the device's position: half a step of its encoder, model
    /// units.
    pub quantization: f64,
    /// Period of the loop, seconds.
    pub period_s: f64,
}

impl Imperceptible {
    /// Everything is perceived and known, at 1 kHz.
    pub(super) const NOTHING: Self = Self {
        step: 0.0,
        quantization: 0.0,
        period_s: 1e-3,
    };
}

/// A tick that ends before the tool has come as near to the device as contacts allow: where the
/// proxy is, and where it would come to by the contacts that are known, without the limits of a
/// tick.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub(super) struct Estimate {
    pub(super) proxy: Placement,
    pub(super) target: Placement,
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
        // The next tick knows only the estimate that they have corrected.
        answer.late_contacts = answer.late_contacts.max(allowed.late_contacts);
        if answer.contact_count == 0 {
            answer.contacts = allowed.contacts;
            answer.contact_count = allowed.contact_count;
        }
        let target = if allowed.contact_count == 0 {
            self.goal
        } else {
            // Unknown contacts may stop the proxy earlier: the target moves no farther than the
            // device has.
            let share = self.device_travel / path.farthest(self.shape.radius);
            self.at.moved(&path.times(share.min(1.0)))
        };
        self.estimate = Some(Estimate {
            proxy: self.at,
            target,
        });
        target
    }

    /// Limits how much the coupling's deflection changes in a tick in which the device made a
    /// `motion`. Over a convex set of placements it changes by no more than the device moves, in
    /// the metric of the tool's mass. Beyond that, behind a ridge or where an estimate was wrong,
    /// it changes by no more than is imperceptible.
    pub(super) fn limit_change(&mut self, motion: &Twist) {
        let before = self.deflection.plus(motion);
        let change = self.goal.to(&self.coupling_target).minus(&before);
        let most = self.length_of(motion) + self.imperceptible_change(self.length_of(&before));
        let length = self.length_of(&change);
        if length > most && !is(Mutant::Geomorph) {
            let deflection = before.plus(&change.times(most / length));
            self.coupling_target = self.goal.moved(&deflection);
        }
    }

    /// Change of a deflection in a tick that a hand cannot perceive, model units.
    pub(super) fn imperceptible_change(&self, deflection: f64) -> f64 {
        let Imperceptible { step, period_s, .. } = self.imperceptible;
        let of_deflection = OF_PROXY * STEP_SHARE_PER_S * period_s * deflection;
        of_deflection.max(step).max(self.static_offset())
    }
}
