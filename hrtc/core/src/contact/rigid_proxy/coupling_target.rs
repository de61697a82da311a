//! Where the coupling holds the tool while a tick ends on its way: what it only has not had the time to go is no force, and
//! a guess is followed gently.

use super::{ToolAdvance, ToolProxy};
use crate::contact::motion::Placement;
use crate::perception::{OF_PROXY, STEP_SHARE};

/// How far the end of the coupling may go where its way is a guess, in units of the device's motion: a tool that slides
/// goes with the device, one that falls off an edge faster.
const MAX_TARGET_RATE: f64 = 4.0;
/// What the energy in the coupling may grow by in a tick of a millisecond without being paid, as a share of it (facts of
/// haptics, F9).
const GROWTH_A_TICK: f64 = 0.048;

impl ToolProxy {
    /// Where the contacts known last let it go, had it the time; where no step was made they are the answer's.
    pub(super) fn target_allowed_by_contacts(&mut self, answer: &mut ToolAdvance) -> Placement {
        let offset = self.contact_offset();
        self.contacts.carry(&self.at);
        self.add_stops(offset);
        let wanted = self.at.to(&self.goal);
        let mut allowed = ToolAdvance::new();
        let path = self.allowed(&wanted, offset, Some(&mut allowed));
        if answer.steps == 0 {
            answer.contacts = allowed.contacts;
            answer.contact_count = allowed.contact_count;
        }
        let is_free = allowed.contact_count == 0;
        if self.step_limit.is_limited() {
            // Nor is it felt while the surface moves that it catches up.
            self.at
        } else if is_free {
            self.goal
        } else {
            // Contacts that are not known yet may hold it sooner: it owes no more than the device has gone.
            let share = self.device_travel / path.farthest(self.shape.radius);
            self.at.moved(&path.times(share.min(1.0)))
        }
    }

    /// Where a tick ends on the way, where the tool is bound for is a guess that changes with every contact found or left:
    /// the coupling follows it, and what is true after it, gently. Held where it was, it is stretched by the device's work
    /// alone; beyond that it changes by no more than the device goes or a hand can tell, and is not stretched farther than
    /// energy may grow unpaid.
    pub(super) fn limit_target_rate(&mut self, travelled: f64) {
        let is_true = self.coupling_target == self.at;
        if is_true && !self.is_estimate {
            return;
        }
        let radius = self.shape.radius;
        let change = self.goal.to(&self.coupling_target).minus(&self.deflection);
        let imperceptible = self.imperceptible.max(self.static_offset());
        let most = (MAX_TARGET_RATE * travelled + self.step_limit.limit())
            .max(OF_PROXY * STEP_SHARE * self.deflection.farthest(radius))
            .max(imperceptible);
        let share = (most / change.farthest(radius)).min(1.0);
        let deflection = self.deflection.plus(&change.times(share));
        let before = self.length_of(&self.deflection);
        let longest = before.hypot(GROWTH_A_TICK.sqrt() * before.max(imperceptible));
        let shorter = (longest / self.length_of(&deflection)).min(1.0);
        self.is_estimate = !is_true || share < 1.0 || shorter < 1.0;
        if share < 1.0 || shorter < 1.0 {
            self.coupling_target = self.goal.moved(&deflection.times(shorter));
        }
    }
}
