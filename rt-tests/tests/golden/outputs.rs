//! What of a tick goes into the hashes, as numbers in their stated order: the only place that names
//! the fields of what a tick takes and gives.
//!
//! Every part begins with the tick. A list begins with its length; what may be absent with 1, or is
//! a single 0.
//!
//! | part | numbers |
//! |---|---|
//! | wrench | of each probe: force x y z, torque x y z |
//! | requests | of each: client, incarnation, sequence, consumed, model, name; of the tour seed, seconds, speed, depth, radius; epoch, kind, object, count, credit, encoding; of each valid region: region, tolerance's bits, action |
//! | reports | of each: client, tick, probe, object, position x y z, orientation w x y z, contact x y z, force x y z |
//! | contacts | of each probe: object, face, point x y z, the faces that push; then of each object that moves: object, position x y z, orientation w x y z |
//! | counters | chunks consumed; then [`counters`], in its order |
//! | chunks | of each that arrived with this tick: station, client, model, sequence, epoch, kind, object, region, tolerance's bits, count, last, code, and the words of all of its slots |

use super::digest::Digest;
use hrtc_core::record::CoreRecord;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::{Controller, TickOutputs};
use serde::Serialize;
use toml::{Table, Value};

/// Lower bounds by scene.
const LEAST: &str = include_str!("least.toml");

/// The parts, in the order in which they stand in a line.
pub const PARTS: [&str; 6] = [
    "wrench", "requests", "reports", "contacts", "counters", "chunks",
];

/// Takes a tick into the hashes of the parts.
pub fn put_tick(
    parts: &mut [Digest; PARTS.len()],
    tick: u64,
    controller: &Controller,
    outputs: &TickOutputs,
    arrived: &[InboxChunk],
) {
    for part in parts.iter_mut() {
        part.put(tick);
    }
    let [wrench, requests, reports, contacts, counted, chunks] = parts;

    wrench.put(outputs.wrenches.len());
    for of in &outputs.wrenches {
        wrench.put_all(of.force.to_array());
        wrench.put_all(of.torque.to_array());
    }

    requests.put(outputs.outbox.requests().len());
    for of in outputs.outbox.requests() {
        requests.put_all([
            of.client,
            of.incarnation,
            of.sequence,
            of.consumed,
            of.model,
            of.name,
        ]);
        let tour = of.tour;
        requests.put(tour.seed);
        requests.put_all([tour.seconds, tour.speed, tour.depth, tour.radius]);
        requests.put_all([
            of.epoch,
            of.kind,
            of.object,
            of.count,
            of.credit,
            of.encoding,
        ]);
        for ask in of.regions.iter().take(of.count as usize) {
            requests.put_all([ask.region, ask.tolerance_bits, ask.action]);
        }
    }

    reports.put(outputs.reports.len());
    for of in &outputs.reports {
        reports.put_all([of.client, of.tick]);
        reports.put_all([of.probe, of.object]);
        reports.put_all(of.position);
        reports.put_all(of.orientation_wxyz);
        reports.put_all(of.contact);
        reports.put_all(of.force);
    }

    contacts.put(outputs.contacts.len());
    for of in &outputs.contacts {
        contacts.put(of.is_some());
        if let Some(touched) = of {
            let contact = &touched.contact;
            contacts.put_all([touched.object, contact.face]);
            contacts.put_all(contact.point.to_array());
            contacts.put_all(contact.faces);
        }
    }
    for (object, body) in controller.movables().iter() {
        let pose = body.pose();
        contacts.put(object);
        contacts.put_all(pose.position.to_array());
        contacts.put_all(pose.wxyz());
    }

    counted.put(outputs.chunks_consumed);
    counters(counted, &outputs.record, outputs.wrenches.len());

    chunks.put(arrived.len());
    for of in arrived {
        let head = &of.header;
        chunks.put_all([head.station, head.client, head.model, head.sequence]);
        chunks.put_all([
            head.epoch,
            head.kind,
            head.object,
            head.region,
            head.tolerance_bits,
            head.count,
            head.last,
            head.code,
        ]);
        chunks.put_all(of.slots.iter().flat_map(|slot| slot.words));
    }
}

/// What the core counted and measured: first of each probe, then of all.
fn counters(into: &mut Digest, record: &CoreRecord, probes: usize) {
    for of in &record.probes[..probes] {
        into.put_all([of.contact, of.contact_full, of.contact_asked]);
        into.put_all([
            of.contact_tolerance_m,
            of.finest_tolerance_m,
            of.certified_error_m,
            of.depth_m,
        ]);
        into.put_all([of.clamped, of.rejected_sample]);
        into.put(of.energy_j);
    }
    into.put_all([
        record.contact,
        record.contact_full,
        record.contact_bounded,
        record.contact_asked,
    ]);
    into.put_all([
        record.contact_tolerance_m,
        record.finest_tolerance_m,
        record.certified_error_m,
        record.depth_m,
    ]);
    into.put_all([
        record.active_objects,
        record.moving,
        record.unserved,
        record.active_faces,
        record.vsplits,
        record.ecols,
        record.geomorphing,
        record.deferred,
        record.rejected_folds,
        record.work_units,
        record.query_work,
        record.unfinished,
        record.early,
        record.late_contacts,
        record.stuck,
    ]);
    into.put_all([
        record.vsps_received,
        record.bytes_received,
        record.regions_subscribed,
        record.resubscribed,
        record.resent,
        record.evicted,
    ]);
    into.put(record.vsps_loaded);
    into.put(record.cache_bytes);
    into.put_all([record.clamped, record.rejected_sample]);
    into.put(record.energy_j);
    into.put(record.ready);
    into.put(record.measured_error_m);
    into.put(record.stopping);
}

/// What a scene was like: so that a hash of nothing is noticed. Ticks unless said.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Tally {
    /// A probe touches.
    pub contact: u64,
    /// All that touch do so at the full mesh.
    pub full: u64,
    /// Not all that touch do so at the full mesh.
    pub coarse: u64,
    /// All probes touch.
    pub all_touch: u64,
    /// A vertex is on its way.
    pub flying: u64,
    /// A torque is felt.
    pub torque: u64,
    /// An object moves.
    pub moving: u64,
    /// Objects awake at the most.
    pub awake: u32,
    /// A chunk waits for the next tick.
    pub waiting: u64,
    /// Splits.
    pub splits: u64,
    /// Collapses.
    pub collapses: u64,
    /// Requests.
    pub requests: u64,
    /// Reports.
    pub reports: u64,
    /// Reports of a contact measured by the station.
    pub measured: u64,
    /// Regions asked for.
    pub regions: u64,
    /// Regions refused.
    pub refused: u64,
    /// Records evicted.
    pub evicted: u64,
    /// Epochs ended.
    pub epochs: u64,
    /// Samples rejected.
    pub rejected: u64,
    /// The largest force, newtons.
    pub force_n: f64,
}

impl Tally {
    /// Takes a tick in.
    pub fn take(&mut self, controller: &Controller, outputs: &TickOutputs, waiting: usize) {
        let record = &outputs.record;
        let touching = outputs.contacts.iter().flatten().count();
        self.contact += u64::from(record.contact);
        self.full += u64::from(record.contact_full);
        self.coarse += u64::from(record.contact && !record.contact_full);
        self.all_touch += u64::from(touching == outputs.contacts.len());
        self.flying += u64::from(record.geomorphing > 0);
        let torques = || outputs.wrenches.iter().map(|of| of.torque.length());
        self.torque += u64::from(torques().any(|torque| torque > 0.0));
        self.moving += u64::from(record.moving > 0);
        self.awake = self.awake.max(record.active_objects);
        self.waiting += u64::from(waiting > 0);
        self.splits += u64::from(record.vsplits);
        self.collapses += u64::from(record.ecols);
        self.requests += outputs.outbox.requests().len() as u64;
        self.reports += outputs.reports.len() as u64;
        self.measured += u64::from(record.measured_error_m >= 0.0);
        self.regions = record.regions_subscribed;
        self.refused = controller.refused().0;
        self.evicted = record.evicted;
        self.epochs = record.resubscribed;
        self.rejected += u64::from(record.rejected_sample);
        let forces = outputs.wrenches.iter().map(|of| of.force.length());
        self.force_n = forces.fold(self.force_n, f64::max);
    }

    /// What is not above its bound in `least.toml`, with that bound.
    pub fn missing(&self, scene: &str) -> Vec<(String, Value)> {
        let counted = Table::try_from(self).expect("a tally is a table");
        let number = |value: &Value| value.as_float().or(value.as_integer().map(|i| i as f64));
        let least: Table = LEAST.parse().expect("the bounds are TOML");
        let bounds = ["every_scene", scene].map(|name| least[name].as_table().expect("a table"));
        bounds
            .into_iter()
            .flatten()
            .filter(|(field, bound)| number(&counted[*field]) <= number(bound))
            .map(|(field, bound)| (field.clone(), bound.clone()))
            .collect()
    }
}
