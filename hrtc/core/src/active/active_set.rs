//! Who sits where: which objects are awake.
//!
//! An object wakes when a probe comes near, long before it can touch: reach grows with the speed. It keeps its seat
//! as long as nobody else needs one; then those go first that have been out of reach for longest. When every seat is
//! needed, the objects nearest to a probe have them. One object takes a seat in a tick, so that a tick stays short.

use crate::active::broad_phase::{Ball, BroadPhase, Near};
use crate::active::object::{ActiveObject, ObjectInstance};
use crate::cache::base_mesh_store::Model;
use crate::controller::Controller;
use crate::frame::ModelFrame;
use crate::frame::in_axes_of;
use crate::streaming::subscriber::Outbox;
use geometry::Pose;
use glam::DVec3;
use protocol::CREDIT_CHUNKS;

/// Reach of a probe at rest, in its radii, and ticks of its motion by which it is longer: the base mesh is there
/// within a few ticks, what lies ahead of the contact within sixty.
const REACH_RADII: f64 = 10.0;
const REACH_TICKS: f64 = 150.0;
/// Ticks out of reach after which a seat may be given away, and a probe is not followed any more.
const SLEEP_TICKS: u64 = 100;
/// An object takes the seat of one that is in reach too when it is nearer by this factor: no flicker between two.
const NEARER: f64 = 2.0;
/// Ticks of motion within which a probe could touch.
const TOUCH_TICKS: f64 = 2.0;
/// Objects that are placed in a tick at the most.
const PLACED_A_TICK: usize = 64;

/// What is known of all objects together.
#[derive(Debug)]
pub struct ActiveSet {
    /// Objects whose box is not known yet, the next one last, in the order in which models are asked for.
    pub unplaced: Vec<u32>,
    /// Objects in the order in which their models are asked for: those of tours first.
    pub to_fetch: Vec<u32>,
    /// The first of them whose model may be unknown.
    pub next_fetch: usize,
    /// The epoch in which the next session of each object begins.
    pub epochs: Vec<u32>,
}

impl ActiveSet {
    /// `toured`: objects with a tour.
    pub fn new(objects: usize, toured: impl Iterator<Item = u32>) -> Self {
        let mut to_fetch: Vec<u32> = toured.collect();
        to_fetch.extend(0..objects as u32);
        Self {
            unplaced: to_fetch.iter().rev().copied().collect(),
            to_fetch,
            next_fetch: 0,
            epochs: vec![0; objects],
        }
    }
}

impl Controller {
    /// Finds out which objects are near, wakes them and puts others to sleep.
    pub(crate) fn seat_objects(&mut self, tick: u64, outbox: &mut Outbox) -> u32 {
        if self.placings.len() == 1 {
            return 0;
        }
        self.place_objects();
        let balls = self.probes.iter().enumerate().filter_map(|(probe, p)| {
            Some(Ball {
                probe,
                centre: p.pose?.position,
                radius: REACH_RADII * p.reach_m + REACH_TICKS * p.speed,
            })
        });
        self.broad_phase.find(balls, REACH_TICKS);
        self.note_needs(tick);
        if self.seats.len() < self.placings.len() {
            self.seat_one(tick, outbox);
        }
        self.share_credit(tick);
        self.count_unseated()
    }

    /// Tells the broad phase where objects are whose models have become known.
    fn place_objects(&mut self) {
        let Self {
            seating,
            placings,
            library,
            broad_phase,
            ..
        } = self;
        for _ in 0..PLACED_A_TICK.min(seating.unplaced.len()) {
            let Some(object) = seating.unplaced.pop() else {
                return;
            };
            let placing = placings[object as usize];
            let Some(model) = library.model(placing.model) else {
                seating.unplaced.push(object);
                return;
            };
            place(broad_phase, &placing, model);
        }
    }

    /// Notes which seats are needed in this tick, and follows the probes that are near.
    fn note_needs(&mut self, tick: u64) {
        for seat in &mut self.seats {
            seat.distance = f64::INFINITY;
        }
        for k in 0..self.broad_phase.near().len() {
            let near = self.broad_phase.near()[k];
            if let Some(seat) = seat_of(&mut self.seats, near.object as u32) {
                let start = self.probes[near.probe].last;
                seat.comes_near(near, start, tick);
            }
        }
        for seat in &mut self.seats {
            let object = seat.object();
            let awaits = object.is_some_and(|o| self.probes.iter().any(|p| p.awaits_tour_of(o)));
            seat.is_pinned = object.is_some() && (seat.model.is_none() || awaits);
            if seat.is_touched() {
                seat.distance = 0.0;
            }
            if seat.is_pinned || seat.distance.is_finite() {
                seat.needed = tick;
            }
            for touch in &mut seat.touches {
                if touch.felt.is_some() {
                    touch.near_at = tick;
                }
                if touch.is_followed && touch.near_at + SLEEP_TICKS < tick {
                    touch.leave();
                }
            }
        }
    }

    /// Gives a seat to the object that needs one most.
    fn seat_one(&mut self, tick: u64, outbox: &mut Outbox) {
        let Some((object, distance)) = self.next_to_seat() else {
            return;
        };
        let Some(k) = self.seat_to_give(distance, tick) else {
            return;
        };
        let seat = &mut self.seats[k];
        if let Some(before) = seat.object() {
            let epoch = seat.close(outbox, tick);
            self.seating.epochs[before as usize] = epoch.wrapping_add(1);
        }
        let placing = self.placings[object as usize];
        let kept = self.library.slots(placing.model).is_some();
        let known = self.library.model(placing.model).copied();
        let epoch = self.seating.epochs[object as usize];
        seat.give(placing, epoch, known.filter(|_| kept), tick);
        for near in self.broad_phase.near() {
            if near.object == object as usize {
                let start = self.probes[near.probe].last;
                seat.comes_near(*near, start, tick);
            }
        }
    }

    /// The object without a seat that needs one most, and its distance from a probe: one whose tour is to be made,
    /// one in reach, one whose model nobody knows yet.
    fn next_to_seat(&mut self) -> Option<(u32, f64)> {
        let toured = self.probes.iter().find_map(|probe| {
            let tour = probe.tour.as_ref().filter(|tour| !tour.is_whole)?;
            let is_seated = self.seats.iter().any(|s| s.object() == Some(tour.object));
            (!is_seated).then_some((tour.object, 0.0))
        });
        if toured.is_some() {
            return toured;
        }
        let near = self.broad_phase.near().iter().find_map(|near| {
            let object = near.object as u32;
            let is_seated = self.seats.iter().any(|s| s.object() == Some(object));
            (!is_seated).then_some((object, near.distance))
        });
        near.or_else(|| {
            let object = self.next_to_fetch()?;
            Some((object, f64::INFINITY))
        })
    }

    /// An object whose model is not known and does not come.
    fn next_to_fetch(&mut self) -> Option<u32> {
        if self.library.is_complete() {
            return None;
        }
        let Self {
            seating,
            placings,
            library,
            seats,
            ..
        } = self;
        let model = |object: u32| placings[object as usize].model;
        while let Some(&object) = seating.to_fetch.get(seating.next_fetch)
            && library.model(model(object)).is_some()
        {
            seating.next_fetch += 1;
        }
        let rest = &seating.to_fetch[seating.next_fetch..];
        rest.iter().copied().find(|&object| {
            let is_coming =
                |seat: &ActiveObject| seat.placing.is_some_and(|p| p.model == model(object));
            library.model(model(object)).is_none() && !seats.iter().any(is_coming)
        })
    }

    /// The seat that may be given to an object at a distance, metres; infinite for one that is only to be known.
    fn seat_to_give(&self, distance: f64, tick: u64) -> Option<usize> {
        let seats = || self.seats.iter().enumerate();
        if let Some((k, _)) = seats().find(|(_, seat)| seat.placing.is_none()) {
            return Some(k);
        }
        let waits = if distance.is_finite() { SLEEP_TICKS } else { 0 };
        let idle = seats().filter(|(_, seat)| !seat.is_pinned && seat.needed + waits < tick);
        let longest = idle.min_by_key(|(_, seat)| seat.needed);
        let farthest = || {
            let farther = seats().filter(|(_, seat)| {
                !seat.is_pinned && seat.distance > 0.0 && seat.distance > NEARER * distance
            });
            farther.max_by(|(_, a), (_, b)| a.distance.total_cmp(&b.distance))
        };
        longest.or_else(farthest).map(|(k, _)| k)
    }

    /// Shares out the chunks that may be under way: one to a seat out of reach, the others alike to the rest.
    fn share_credit(&mut self, tick: u64) {
        let used = self.seats.iter().filter(|seat| seat.placing.is_some());
        let needed = used.clone().filter(|seat| seat.needed == tick).count() as u64;
        let idle = used.count() as u64 - needed;
        let share = (CREDIT_CHUNKS - idle) / needed.max(1);
        for seat in &mut self.seats {
            let is_needed = seat.needed == tick;
            seat.subscriber
                .set_credit(if is_needed { share } else { 1 });
        }
    }

    /// Pairs of a probe and an object that it could touch now, and that is not ready for it.
    fn count_unseated(&self) -> u32 {
        if !self.library.is_complete() {
            return 0;
        }
        let within = self.broad_phase.near().iter().filter(|near| {
            let probe = &self.probes[near.probe];
            let way = self.broad_phase.way(near.object);
            near.distance <= probe.reach_m + TOUCH_TICKS * (probe.speed + way)
        });
        let missing = within.filter(|near| {
            let object = Some(near.object as u32);
            let is_ready = |seat: &ActiveObject| seat.object() == object && seat.is_ready();
            !self.seats.iter().any(is_ready)
        });
        missing.count() as u32
    }
}

impl ActiveObject {
    /// A probe is near; `start`: where it was in the tick before, world, metres.
    fn comes_near(&mut self, near: Near, start: Option<Pose>, tick: u64) {
        self.distance = self.distance.min(near.distance);
        let Some(placing) = &self.placing else {
            return;
        };
        let touch = &mut self.touches[near.probe];
        touch.near_at = tick;
        if !touch.is_followed {
            // As it was seen from the object then: what has moved since is the same to the sweep.
            let was = placing.before.unwrap_or(placing.pose);
            touch.follow(start.map(|start| in_axes_of(&was, start)));
        }
    }
}

/// Tells the broad phase where an object is.
pub fn place(broad_phase: &mut BroadPhase, placing: &ObjectInstance, model: &Model) {
    let frame = ModelFrame::new(placing.pose, placing.scale, &model.header);
    let [lower, upper] = [model.header.lower, model.header.upper]
        .map(|corner| DVec3::from_array(corner) - frame.origin);
    // The front of a coarse mesh may stick out by R.
    let (lower, upper) = frame.box_to_world(lower, upper, model.radius_max);
    broad_phase.place(placing.object as usize, lower, upper);
}

/// The seat of an object.
pub fn seat_of(seats: &mut [ActiveObject], object: u32) -> Option<&mut ActiveObject> {
    seats.iter_mut().find(|seat| seat.object() == Some(object))
}
