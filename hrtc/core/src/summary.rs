//! What a tick was like, summed up over seats and probes.

use crate::controller::Controller;
use crate::probe::pair::ContactState;
use crate::record::{CoreRecord, ProbeRecord};
use geometry::Wrench;

impl Controller {
    /// Sums up what the seats and probes did and felt in a tick.
    pub(crate) fn finish_record(&mut self, record: &mut CoreRecord) {
        record.gather();
        let mut measured: f64 = -1.0;
        let mut finest: f64 = 0.0;
        record.cache_bytes = self.library.bytes_used() as u64;
        for seat in &self.seats {
            record.vsplits += seat.tally.vsplits;
            record.ecols += seat.tally.ecols;
            record.in_flight += seat.cache.mesh().flights().len() as u32;
            record.postponed += seat.tally.postponed;
            record.refused_folds += seat.tally.refused;
            record.work_units += seat.tally.work_units;
            record.active_faces += seat.cache.mesh().active_faces();
            record.vsps_received += seat.vsps_received;
            record.bytes_received += seat.bytes_received;
            record.regions_subscribed += seat.subscriber.subscribed;
            record.resubscribed += seat.subscriber.resubscribed;
            record.resent += seat.subscriber.resent;
            record.evicted += seat.cache.evicted();
            record.vsps_loaded += seat.cache.loaded();
            record.cache_bytes += seat.cache.bytes_used() as u64;
            record.awake += u32::from(seat.is_ready());
            if let Some(frame) = seat.frame {
                let scale = frame.metres_per_unit;
                finest = finest.max(f64::from(seat.finest_tolerance()) * scale);
                if let Some(distance) = seat.measured {
                    measured = measured.max(distance * scale);
                }
            }
        }
        if !record.contact {
            record.finest_tolerance_m = finest;
        }
        record.energy_j = self.probes.iter().map(|probe| probe.energy.joules()).sum();
        record.moving = self.movables.awake() as u32;
        record.ready = self.is_ready();
        record.measured_error_m = measured;
        self.mix(record);
        record.replay_hash = self.replay_hash;
    }

    /// Takes a tick's outputs into the hash.
    fn mix(&mut self, record: &CoreRecord) {
        let mut hash = self.replay_hash;
        let mut mix = |word: u64| {
            // One round of splitmix64 a word.
            let mut z = (hash ^ word).wrapping_add(0x9E37_79B9_7F4A_7C15);
            z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
            hash = z ^ z >> 31;
        };
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
        self.replay_hash = hash;
    }
}

impl ProbeRecord {
    /// Takes in what one of the probe's touches felt; `finest`: the finest tolerance asked for there, model units.
    pub(crate) fn add(&mut self, felt: &ContactState, metres_per_unit: f64, finest: f32) {
        let is_first = !self.contact;
        self.contact = true;
        self.contact_full = (is_first || self.contact_full) && felt.certified == 0.0;
        self.contact_asked = (is_first || self.contact_asked) && felt.asked;
        let unknown = self.contact_tolerance_m < 0.0 || felt.tolerance_m < 0.0;
        self.contact_tolerance_m = if unknown {
            -1.0
        } else {
            self.contact_tolerance_m.max(felt.tolerance_m)
        };
        let certified = f64::from(felt.certified) * metres_per_unit;
        self.certified_error_m = self.certified_error_m.max(certified);
        self.finest_tolerance_m = self
            .finest_tolerance_m
            .max(f64::from(finest) * metres_per_unit);
        self.depth_m = self.depth_m.max(felt.depth_m);
    }
}
