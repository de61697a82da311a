//! The record of a tick: sums over active objects and probes, and the hash over its outputs.

use crate::controller::Controller;
use crate::probe::pair::ContactState;
use crate::record::{CoreRecord, ProbeRecord, max_or_nan};
use crate::tick::TickOutputs;
use geometry::Wrench;

impl Controller {
    /// Fills in the record of a tick.
    pub(crate) fn record(&mut self, outputs: &TickOutputs, record: &mut CoreRecord) {
        record.sum_probes();
        let mut measured: f64 = -1.0;
        let mut finest: f64 = 0.0;
        record.cache_bytes = self.active.store.bytes_used() as u64;
        record.cache_limit_bytes = self.cache_limit as u64;
        for active in &self.active.objects {
            let (front, session) = (&active.front, &active.session);
            record.vsplits += front.stats.vsplits;
            record.ecols += front.stats.ecols;
            record.geomorphing += front.cache.mesh().geomorphs().len() as u32;
            record.deferred += front.stats.deferred;
            record.rejected_folds += front.stats.rejected;
            record.passed_folds += front.stats.passed;
            record.work_units += front.stats.work_units;
            record.active_faces += front.cache.mesh().active_faces();
            record.vsps_received += session.vsps_received;
            record.bytes_received += session.bytes_received;
            record.regions_subscribed += session.subscriber().subscribed;
            record.resubscribed += session.subscriber().resubscribed;
            record.resent += session.subscriber().resent;
            record.evicted += front.cache.evicted();
            record.vsps_loaded += front.cache.loaded();
            record.cache_bytes += front.cache.bytes_used() as u64;
            record.active_objects += u32::from(active.is_ready());
            if let Some(frame) = active.frame {
                let scale = frame.metres_per_unit;
                finest = finest.max(f64::from(front.finest_tolerance()) * scale);
                if let Some(distance) = session.measured {
                    measured = max_or_nan(measured, distance * scale);
                }
            }
        }
        self.most_bytes = self.most_bytes.max(record.cache_bytes);
        if !record.contact {
            record.finest_tolerance_m = finest;
        }
        record.round_trip_s = self.active.meter.round_trip_s();
        record.link_bytes_per_s = self.active.meter.bytes_per_s();
        record.energy_j = self.probes.iter().map(|probe| probe.energy.joules()).sum();
        record.moving = self.movables.awake() as u32;
        record.ready = self.is_ready();
        record.synchronised = record.active_objects > 0
            && self.active.objects.iter().all(|active| {
                let subscriber = active.session.subscriber();
                !active.is_ready() || subscriber.is_synchronised(&active.front.cache)
            });
        record.measured_error_m = measured;
        self.mix(outputs, record);
        record.replay_hash = self.replay_hash;
    }

    /// Takes a tick's outputs into the hash.
    fn mix(&mut self, outputs: &TickOutputs, record: &CoreRecord) {
        let mut hash = self.replay_hash;
        let mut mix = |word: u64| hash = mixed(hash, word);
        for probe in &self.probes {
            let Wrench { force, torque } = probe.wrench;
            for value in force.to_array().into_iter().chain(torque.to_array()) {
                mix(value.to_bits());
            }
        }
        mix(u64::from(record.contact) | u64::from(record.contact_full) << 1);
        mix(u64::from(record.active_faces) << 32 | u64::from(record.vsps_loaded));
        mix(u64::from(record.vsplits) << 32 | u64::from(record.ecols));
        mix(record.certified_error_m.to_bits());
        mix(record.finest_tolerance_m.to_bits());
        for number in self.movables.numbers() {
            mix(number.to_bits());
        }
        for contact in outputs.contacts.iter().flatten() {
            mix(u64::from(contact.object) << 32 | u64::from(contact.contact.face));
            for value in contact.contact.point.to_array() {
                mix(value.to_bits());
            }
        }
        let requests: &[u8] = bytemuck::cast_slice(outputs.outbox.requests());
        let reports: &[u8] = bytemuck::cast_slice(&outputs.reports);
        for words in [requests, reports].map(|bytes| bytes.chunks(size_of::<u64>())) {
            for bytes in words {
                let mut word = [0; size_of::<u64>()];
                word[..bytes.len()].copy_from_slice(bytes);
                mix(u64::from_le_bytes(word));
            }
        }
        self.replay_hash = hash;
    }
}

/// A hash with one more word in it: a round of splitmix64.
pub(crate) fn mixed(hash: u64, word: u64) -> u64 {
    let mut z = (hash ^ word).wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ z >> 31
}

impl ProbeRecord {
    /// Adds the contact state of one of the probe's pairs; `finest`: the finest tolerance asked for
    /// there, model units.
    pub(crate) fn add(&mut self, state: &ContactState, metres_per_unit: f64, finest: f32) {
        let is_first = !self.contact;
        self.contact = true;
        self.contact_full = (is_first || self.contact_full) && state.certified == 0.0;
        let is_bounded = state.certified.is_finite();
        self.contact_bounded = (is_first || self.contact_bounded) && is_bounded;
        self.contact_asked = (is_first || self.contact_asked) && state.is_as_asked;
        let unknown = self.contact_tolerance_m < 0.0 || state.tolerance_m < 0.0;
        self.contact_tolerance_m = if unknown {
            -1.0
        } else {
            self.contact_tolerance_m.max(state.tolerance_m)
        };
        let certified = f64::from(state.certified) * metres_per_unit;
        self.certified_error_m = max_or_nan(self.certified_error_m, certified);
        self.finest_tolerance_m = self
            .finest_tolerance_m
            .max(f64::from(finest) * metres_per_unit);
        self.depth_m = max_or_nan(self.depth_m, state.depth_m);
        self.force_withheld = max_or_nan(self.force_withheld, 1.0 - state.paid);
    }

    /// Of what contacts want, energy account and limits let this share pass.
    pub(crate) fn pass(&mut self, share: f64) {
        if self.contact {
            self.force_withheld = 1.0 - share * (1.0 - self.force_withheld);
        }
    }
}
