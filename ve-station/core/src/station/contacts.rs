//! Contacts: the distance of each from the full mesh, measured in its client's turn.

use super::Station;
use super::session::Session;
use crate::tuning::service::{MAX_VISITS, VISITS_A_STEP};
use glam::DVec3;
use protocol::{ContactReport, MeasuredError};
use spm::NONE;

impl<D: AsRef<[u8]>> Station<D> {
    pub(super) fn handle_contact(&mut self, report: &ContactReport) {
        let is_free = report.object == NONE;
        let is_of =
            |s: &&mut Session| s.client == report.client && (is_free || s.object == report.object);
        let mut found = false;
        for session in self.sessions.iter_mut().filter(is_of) {
            session.push_contact(report);
            found = true;
        }
        self.counters.stale += u64::from(!found && !is_free);
    }

    /// Measures the contacts that wait in the sessions of a client.
    pub(super) fn measure_contacts(&mut self, client: u64, steps: &mut u64) {
        for at in 0..self.sessions.len() {
            while self.sessions[at].client == client
                && *steps > 0
                && let Some(report) = self.sessions[at].contacts.pop_front()
            {
                self.measure(at, &report, steps);
            }
        }
    }

    /// Measures a contact, unless it is too far from the mesh for its bounded search.
    fn measure(&mut self, at: usize, report: &ContactReport, steps: &mut u64) {
        let session = &mut self.sessions[at];
        if report.object == NONE {
            session.flush_measured(report.probe);
            return;
        }
        let object = self.objects.get(report.object as usize);
        let model = object.and_then(|object| self.models.get(object.model));
        let contact = DVec3::from_array(report.contact);
        let mut visits = MAX_VISITS;
        let found = model.map(|model| model.file.closest_point_within(contact, &mut visits));
        let visited = MAX_VISITS - visits;
        *steps = steps.saturating_sub(visited.div_ceil(VISITS_A_STEP).max(1).into());
        match found {
            Some(Ok(Some((_, closest)))) => {
                self.counters.measured += 1;
                let error = MeasuredError {
                    tick: report.tick,
                    distance: closest.distance_squared.sqrt(),
                    reserved: [0; 2],
                };
                session.push_measured(report.probe, error, self.clock_us);
            }
            Some(Ok(None)) => self.counters.unmeasured += 1,
            _ => self.counters.damaged += 1,
        }
    }
}
