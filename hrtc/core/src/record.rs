//! Numbers of one tick.

use crate::governor::QueryWork;
use scene::MAX_PROBES;
use serde::{Deserialize, Serialize};

/// Contact of one probe in a tick; of several objects the worst.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ProbeRecord {
    /// Whether the probe touches.
    pub contact: bool,
    /// Whether every face that holds the probe is a face of the full mesh.
    pub contact_full: bool,
    /// Whether every face that holds the probe is one of the front's and has a certified bound.
    pub contact_bounded: bool,
    /// Whether the contact is as accurate as was asked for.
    pub contact_asked: bool,
    /// Expected error of the front at the contact, metres; see [`CoreRecord::contact_tolerance_m`].
    pub contact_tolerance_m: f64,
    /// The finest expected error that is asked for where it touches, metres.
    pub finest_tolerance_m: f64,
    /// Certified error at the contact, metres.
    pub certified_error_m: f64,
    /// Penetration of the device behind the proxy, metres.
    pub depth_m: f64,
    /// Share of the wanted force of its contacts that is not rendered, 0 to 1, the largest of them:
    /// not paid for where a contact is found late, or withheld by energy account or limits. 0
    /// without contact.
    pub force_withheld: f64,
    /// Whether the force was clamped.
    pub clamped: bool,
    /// Whether the sample was rejected.
    pub rejected_sample: bool,
    /// Energy put out by the rendering, joules, total.
    pub energy_j: f64,
    /// The part of it that surfaces gave by moving, joules, total.
    pub given_j: f64,
}

/// The larger number; not a number where one of them is none, unlike [`f64::max`].
#[must_use]
pub fn max_or_nan(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// Numbers of one tick. Counters are of this tick unless called total.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct CoreRecord {
    /// Contacts of the probes; the next fields are of all of them, the worst of those that touch.
    pub probes: [ProbeRecord; MAX_PROBES],
    /// Whether a probe touches.
    pub contact: bool,
    /// Whether every face that holds a probe is a face of the full mesh.
    pub contact_full: bool,
    /// Whether the contacts have a certified bound.
    pub contact_bounded: bool,
    /// Whether the contacts are as accurate as was asked for.
    pub contact_asked: bool,
    /// Expected error of the front at the contact, metres: 0 at full resolution, negative where not
    /// even the coarsest ring is done there.
    pub contact_tolerance_m: f64,
    /// The finest expected error that is asked for now, metres: what was asked for, or coarser for
    /// want of time or room.
    pub finest_tolerance_m: f64,
    /// Certified error at the contact, metres.
    pub certified_error_m: f64,
    /// Penetration of the device behind the proxy, metres.
    pub depth_m: f64,
    /// Share of the wanted force of a contact that is not rendered; see
    /// [`ProbeRecord::force_withheld`].
    pub force_withheld: f64,
    /// Active objects whose model is known.
    pub active_objects: u32,
    /// Movable objects that are stepped.
    pub moving: u32,
    /// Pairs of a probe and an object that could touch though the object is not active and ready.
    pub unserved: u32,
    /// Faces of the active fronts.
    pub active_faces: u32,
    /// Splits performed.
    pub vsplits: u32,
    /// Collapses performed.
    pub ecols: u32,
    /// Vertices in a geomorph.
    pub geomorphing: u32,
    /// Perceptible splits that wait for room, or for a geomorph beside them.
    pub deferred: u32,
    /// Perceptible splits that wait since they would turn a face over.
    pub rejected_folds: u32,
    /// Of these, the ones performed in the tick after all: no other split comes first.
    pub passed_folds: u32,
    /// Operations of the tick in work units (splits, collapses, nodes, records) for the budget.
    pub work_units: u32,
    /// Nodes visited and faces tested by the queries.
    pub query_work: u32,
    /// The same, by [`crate::governor::QueryWork::unit`].
    pub query_units: [u32; QueryWork::UNITS],
    /// Faces that operations and geomorphs changed, with what each operation counts more.
    pub operation_faces: u32,
    /// What the tick might spend by the costs of its work, nanoseconds, and what it has spent.
    pub allowed_ns: u32,
    /// See `allowed_ns`.
    pub spent_ns: u32,
    /// How many times as long a tick takes as the costs say.
    pub slowness: f64,
    /// Share of its period that a tick may spend; late ticks lower it.
    pub time_share: f64,
    /// Splits and collapses a tick that there is time for.
    pub operations: f64,
    /// Probes whose budget left a part of their motion to the next tick; their proxies wait outside
    /// of the objects.
    pub unfinished: u32,
    /// Tools whose step ended early though the budget had room; they move on in the next ticks.
    pub early: u32,
    /// Contacts of tools that were found after the step that they should have stopped: the force
    /// before had not known them.
    pub late_contacts: u32,
    /// Tools that the surface has moved into or over and that know no way out: they stay where they
    /// are, and jump when there is one that passes through no face.
    pub stuck: u32,
    /// Records received, total.
    pub vsps_received: u64,
    /// Bytes received (chunks), total.
    pub bytes_received: u64,
    /// Regions subscribed, total.
    pub regions_subscribed: u64,
    /// Epochs ended, so that regions were declared and asked for anew, total.
    pub resubscribed: u64,
    /// Regions asked for again, with every record, since their answer counted on records that were
    /// gone, total.
    pub resent: u64,
    /// Smoothed time from a question to the station to the first part of its answer, seconds;
    /// negative before the first.
    pub round_trip_s: f64,
    /// Rate at which the link brings chunks while more is on its way, bytes a second; negative
    /// while it was not seen.
    pub link_bytes_per_s: f64,
    /// Records evicted, total.
    pub evicted: u64,
    /// VSPs loaded now.
    pub vsps_loaded: u32,
    /// Cache bytes in use now.
    pub cache_bytes: u64,
    /// Cache bytes that may be in use now: more are on their way out.
    pub cache_limit_bytes: u64,
    /// Whether a force was clamped.
    pub clamped: bool,
    /// Whether a sample was rejected.
    pub rejected_sample: bool,
    /// Energy put out by the rendering, joules, total; above 0 means it pushed energy in.
    pub energy_j: f64,
    /// Whether every model is known, so that any contact could be answered.
    pub ready: bool,
    /// Whether the newest station has answered everything that it was asked, about every active
    /// object, and knows what is held.
    pub synchronised: bool,
    /// Largest measured error that arrived this tick, metres; negative when none did, and not a
    /// finite number where the station sent such a one.
    pub measured_error_m: f64,
    /// Whether the force was asked to ramp down.
    pub stopping: bool,
    /// Hash over every tick's outputs so far.
    pub replay_hash: u64,
}

impl CoreRecord {
    /// Fills in the fields of all probes from those of each.
    pub fn sum_probes(&mut self) {
        self.clamped = self.probes.iter().any(|probe| probe.clamped);
        self.rejected_sample = self.probes.iter().any(|probe| probe.rejected_sample);
        let touching = || self.probes.iter().filter(|probe| probe.contact);
        let most = |of: fn(&ProbeRecord) -> f64| touching().map(of).fold(0.0, max_or_nan);
        let is_touching = touching().next().is_some();
        let is_full = is_touching && touching().all(|probe| probe.contact_full);
        let is_asked = is_touching && touching().all(|probe| probe.contact_asked);
        let is_unknown = touching().any(|probe| probe.contact_tolerance_m < 0.0);
        let tolerance_m = most(|probe| probe.contact_tolerance_m);
        self.contact_tolerance_m = if is_unknown { -1.0 } else { tolerance_m };
        self.finest_tolerance_m = most(|probe| probe.finest_tolerance_m);
        self.certified_error_m = most(|probe| probe.certified_error_m);
        self.depth_m = most(|probe| probe.depth_m);
        self.force_withheld = most(|probe| probe.force_withheld);
        self.contact = is_touching;
        self.contact_full = is_full;
        self.contact_asked = is_asked;
        self.contact_bounded = is_touching && touching().all(|probe| probe.contact_bounded);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_contact_without_a_bound_leaves_all_without_and_no_number_is_kept() {
        let touching = |certified_error_m: f64| ProbeRecord {
            contact: true,
            contact_bounded: certified_error_m.is_finite(),
            certified_error_m,
            ..ProbeRecord::default()
        };
        for (errors, is_bounded) in [([1e-3, 2e-3], true), ([f64::NAN, 2e-3], false)] {
            for errors in [errors, [errors[1], errors[0]]] {
                let mut record = CoreRecord::default();
                record.probes[0] = touching(errors[0]);
                record.probes[1] = touching(errors[1]);
                record.sum_probes();
                assert_eq!(record.contact_bounded, is_bounded, "{errors:?}");
                assert_eq!(record.certified_error_m.is_finite(), is_bounded);
            }
        }
    }
}
