//! What a controller's tick reached.

use super::Run;
use crate::commands::simulate::kind::Kind;
use hrtc_core::Fault;
use simulator::LinkCounts;

/// Kinds that do something to messages, in the order of [`done`].
const OF_MESSAGES: [Kind; 4] = [Kind::Loss, Kind::Duplicates, Kind::Reordering, Kind::Damage];

/// What a link did to messages of all kinds so far.
fn done(counts: &LinkCounts) -> [u64; 4] {
    let all = [
        // What an event loses is no loss by chance.
        &counts.lost_by_chance,
        &counts.doubled,
        &counts.overtook,
        &counts.damaged,
    ];
    all.map(|counts| counts.iter().sum())
}

impl Run<'_> {
    /// Counts what the tick of a controller reached: of messages and samples what was done to them
    /// since its tick before, of what lasts the tick itself.
    pub(super) fn cover(&mut self, tick: u64, k: usize) {
        let has_faults = !self.is_quiet && tick >= self.scenario.faulty[0];
        let (side, client) = (&mut self.sides[k], &mut self.simulation.clients_mut()[k]);
        let coverage = &mut self.coverage;
        let messages = done(&client.link().counts());
        let record = &client.outputs().record;
        let faults = client.sample_faults();
        let samples = [faults.noisy, faults.spikes, faults.nonsense, faults.missing];
        let kinds = [Kind::Noise, Kind::Spikes, Kind::Nonsense, Kind::Missing];
        if record.contact {
            for ((kind, now), before) in kinds.into_iter().zip(samples).zip(side.samples_before) {
                coverage.met(kind, now - before);
            }
            let of_messages = OF_MESSAGES.into_iter().zip(messages);
            for ((kind, now), before) in of_messages.zip(side.messages_before) {
                coverage.met(kind, now - before);
            }
            let while_faulty = [Kind::Delay, Kind::Bandwidth, Kind::Early, Kind::Compact];
            let lasting =
                |kind: &Kind| kind.is_of_scene() || (has_faults && while_faulty.contains(kind));
            for &kind in self.scenario.kinds.iter().filter(|kind| lasting(kind)) {
                coverage.met(kind, 1);
            }
            coverage.reached("contact at full resolution", u64::from(record.contact_full));
            coverage.reached("geomorphs in contact", u64::from(record.geomorphing > 0));
            coverage.reached(
                "steps left for later",
                u64::from(record.unfinished + record.early),
            );
        }
        (side.samples_before, side.messages_before) = (samples, messages);
        let controller = client.controller();
        if controller.has_faults() {
            let mut faults = controller.faults();
            let is_other = faults.any(|(_, fault)| fault == Fault::AnotherModel) && record.contact;
            coverage.reached(
                "models of another version found in contact",
                u64::from(is_other),
            );
            let is_lost = controller.fault() == Some(Fault::UnknownModel);
            coverage.reached("models of another scene found", u64::from(is_lost));
        }
        coverage.reached("epochs ended", record.resubscribed);
        coverage.reached("records evicted", record.evicted);
        coverage.reached("samples rejected", u64::from(record.rejected_sample));
        coverage.reached("forces clamped", u64::from(record.clamped));
    }
}
