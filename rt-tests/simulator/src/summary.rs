//! Counts and extremes of a run.

use geometry::Wrench;
use glam::DVec3;
use hrtc_core::record::{CoreRecord, max_or_nan};

/// Counts and extremes over the ticks of a client; forces are those of its first probe.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Summary {
    /// Ticks.
    pub ticks: u64,
    /// Ticks in contact.
    pub contact: u64,
    /// Ticks in contact with the full mesh.
    pub full: u64,
    /// Largest force, newtons.
    pub force_max: f64,
    /// Largest change of the force in a tick, newtons.
    pub force_step_max: f64,
    /// Largest number of active faces.
    pub faces_max: u32,
    /// Sum of the active faces of all ticks.
    pub faces_sum: u64,
    /// Splits.
    pub vsplits: u64,
    /// Collapses.
    pub ecols: u64,
    /// Largest refinement work of a tick, work units.
    pub work_max: u32,
    /// Largest certified error at the contact, metres.
    pub certified_max: f64,
    /// Largest measured error at the contact, metres.
    pub measured_max: f64,
    /// Largest cache, bytes.
    pub cache_max: u64,
    /// The record of the last tick.
    pub last: CoreRecord,
    last_force: DVec3,
}

impl Summary {
    /// Share of the contact ticks that were in contact with the full mesh.
    #[must_use]
    pub fn full_share(&self) -> f64 {
        self.full as f64 / self.contact.max(1) as f64
    }

    /// The force of the last tick, newtons.
    #[must_use]
    pub fn force(&self) -> DVec3 {
        self.last_force
    }

    /// Adds a tick.
    pub(crate) fn add(&mut self, record: &CoreRecord, wrench: Wrench) {
        let force = wrench.force;
        self.ticks += 1;
        self.contact += u64::from(record.contact);
        self.full += u64::from(record.contact_full);
        self.force_max = max_or_nan(self.force_max, force.length());
        self.force_step_max = max_or_nan(self.force_step_max, force.distance(self.last_force));
        self.last_force = force;
        self.faces_max = self.faces_max.max(record.active_faces);
        self.faces_sum += u64::from(record.active_faces);
        self.vsplits += u64::from(record.vsplits);
        self.ecols += u64::from(record.ecols);
        self.work_max = self.work_max.max(record.work_units);
        self.certified_max = max_or_nan(self.certified_max, record.certified_error_m);
        self.measured_max = max_or_nan(self.measured_max, record.measured_error_m);
        self.cache_max = self.cache_max.max(record.cache_bytes);
        self.last = *record;
    }
}
