//! Who has the places: where more objects are needed than there are places, the nearest have them,
//! by the boxes of their full meshes, and no probe is without them for another one in a crowd.
//!
//! A place goes to a clearly nearer object. But every probe keeps the first of its own: another one
//! has none of it. And a probe that has fewer than [`SURE`] places for what it needs as much takes
//! one that is neither touched nor among the first of any probe: for its first object wherever the
//! others are, for the next one where those are not clearly nearer. So no two objects take a place
//! from each other in turn, and a free place goes to the one that would take it.

use super::active_set::ActiveSet;
use super::object::ActiveObject;
use crate::probe::Probe;
use crate::tuning::active::NEARER;
use scene::{MAX_ACTIVE_OBJECTS, MAX_PROBES};
use std::cmp::Ordering;

/// Places that are for each probe: of what it touches, and of what comes next.
const SURE: usize = 2;

/// An object without a place that a probe needs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Needed {
    pub object: u32,
    pub probe: usize,
    /// Its distance from the probe, metres.
    pub distance: f64,
    /// Places that the probe has for what it touches, or needs as much as this.
    pub held: usize,
}

impl Needed {
    /// The first to have a place comes first. `close`: see [`ActiveSet::close_m`].
    fn order(&self, other: &Self, close: f64) -> Ordering {
        let [own, others] = [self, other].map(|of| match of.held {
            0 => -1.0,
            held if held < SURE => of.distance / NEARER,
            _ => of.distance.max(close),
        });
        own.total_cmp(&others)
            .then(self.distance.total_cmp(&other.distance))
            .then(self.object.cmp(&other.object))
            .then(self.probe.cmp(&other.probe))
    }
}

/// How far the object of each place is from each probe, metres: less than any distance where it is
/// touched, infinite where it is out of reach or cannot be touched.
pub(super) struct Distances([[f64; MAX_ACTIVE_OBJECTS]; MAX_PROBES]);

impl Distances {
    /// Places that a probe has for what it touches, or what is no farther from it.
    fn held(&self, probe: usize, within: f64) -> usize {
        let of_probe = self.0[probe].iter();
        of_probe.filter(|&&distance| distance <= within).count()
    }

    /// How many places a probe needs more than this one; `None` where it does not need it.
    fn turn(&self, place: usize, probe: usize) -> Option<usize> {
        let of_probe = &self.0[probe];
        let distance = of_probe[place];
        let before = of_probe
            .iter()
            .enumerate()
            .filter(|&(k, &other)| (other, k) < (distance, place));
        (distance < f64::INFINITY).then(|| before.count())
    }

    /// Whether another probe needs none more than this one.
    fn is_first_of_another(&self, place: usize, probe: usize) -> bool {
        (0..MAX_PROBES).any(|other| other != probe && self.turn(place, other) == Some(0))
    }

    /// Whether it is none of those that are for a probe.
    fn is_spare(&self, place: usize) -> bool {
        (0..MAX_PROBES).all(|probe| self.turn(place, probe).is_none_or(|turn| turn >= SURE))
    }
}

impl ActiveSet {
    /// Whether an object is active.
    fn is_active(&self, object: u32) -> bool {
        self.objects.iter().any(|of| of.object() == Some(object))
    }

    /// By the last search of the broad phase, and by the contacts of the tick before.
    pub(super) fn distances(&self) -> Distances {
        let mut all = [[f64::INFINITY; MAX_ACTIVE_OBJECTS]; MAX_PROBES];
        for near in self.broad_phase.near() {
            let object = near.object as u32;
            let mut places = self.objects.iter();
            let place = places.position(|of| of.object() == Some(object));
            if let Some(place) = place.filter(|_| !self.is_lost_object(object)) {
                all[near.probe][place] = near.distance;
            }
        }
        for (place, active) in self.objects.iter().enumerate() {
            for (of_probe, pair) in all.iter_mut().zip(&active.contacts.pairs) {
                if pair.contact.is_some() {
                    of_probe[place] = f64::NEG_INFINITY;
                }
            }
        }
        Distances(all)
    }

    /// Half of the widest tip, metres. Closer than that, the steps of an encoder would move a place
    /// to and fro.
    fn close_m(&self) -> f64 {
        let pairs = self.objects.iter().flat_map(|of| &of.contacts.pairs);
        0.5 * pairs.map(|pair| pair.patch_m).fold(0.0, f64::max)
    }

    /// An object without a place at a distance from a probe that needs it, metres.
    pub(super) fn needed_at(
        &self,
        (object, probe): (u32, usize),
        distance: f64,
        distances: &Distances,
    ) -> Needed {
        let within = NEARER * distance.max(self.close_m());
        Needed {
            object,
            probe,
            distance,
            held: distances.held(probe, within),
        }
    }

    /// The object that each probe needs most of those without a place, the first to have one first.
    pub(super) fn needed_objects(
        &self,
        probes: &[Probe],
        distances: &Distances,
    ) -> [Option<Needed>; MAX_PROBES] {
        let mut all: [Option<Needed>; MAX_PROBES] = [None; MAX_PROBES];
        for (needed, of) in all.iter_mut().zip(probes.iter().enumerate()) {
            *needed = self.needed_by(of, distances);
        }
        let close = self.close_m();
        all.sort_unstable_by(|a, b| match (a, b) {
            (Some(a), Some(b)) => a.order(b, close),
            _ => b.is_some().cmp(&a.is_some()),
        });
        all
    }

    /// The object without a place that a probe needs most: the one whose scripted path is to be
    /// made, or else the nearest in reach.
    fn needed_by(&self, (k, probe): (usize, &Probe), distances: &Distances) -> Option<Needed> {
        let is_needed = |object: u32| !self.is_active(object) && !self.is_lost_object(object);
        let tour = probe.tour.as_ref().filter(|tour| tour.is_awaited());
        if let Some(tour) = tour.filter(|tour| is_needed(tour.object)) {
            return Some(Needed {
                object: tour.object,
                probe: k,
                distance: 0.0,
                held: 0,
            });
        }
        let mut near = self.broad_phase.near().iter().filter(|of| of.probe == k);
        let found = near.find(|of| is_needed(of.object as u32))?;
        Some(self.needed_at((found.object as u32, k), found.distance, distances))
    }

    /// The place for an object that a probe needs.
    pub(super) fn place_for(
        &self,
        needed: &Needed,
        distances: &Distances,
        tick: u64,
    ) -> Option<usize> {
        // Nothing can be touched of an object whose model may never come; it may be on its way,
        // too.
        let is_lost = |of: &ActiveObject| of.object().is_some_and(|o| self.is_lost_object(o));
        let lost = || self.objects.iter().position(is_lost);
        let close = self.close_m();
        let within = NEARER * needed.distance.max(close);
        let farthest = || {
            let places = self.objects.iter().enumerate();
            let farther = places.filter(|(k, of)| {
                let is_kept = of.is_pinned || distances.is_first_of_another(*k, needed.probe);
                !is_kept && of.distance > within
            });
            let farthest = farther.max_by(|(_, a), (_, b)| a.distance.total_cmp(&b.distance));
            farthest.map(|(k, _)| k)
        };
        let spare = || {
            let is_first = needed.held == 0;
            let places = self.objects.iter().enumerate().filter(|(k, of)| {
                let is_far = !of.contacts.any_contact() && of.clearance_m() > close;
                let may_go = !of.is_pinned && is_far;
                let is_needed_more = needed.distance < NEARER * of.distance.max(close);
                may_go && (is_first || is_needed_more) && distances.is_spare(*k)
            });
            let farthest = places.max_by(|(_, a), (_, b)| {
                let by_box = a.distance.total_cmp(&b.distance);
                by_box.then(a.clearance_m().total_cmp(&b.clearance_m()))
            });
            farthest.map(|(k, _)| k)
        };
        let idle = self.idle_place(self.horizons.sleep, tick);
        let other = idle.or_else(farthest).or_else(lost);
        other.or_else(|| if needed.held < SURE { spare() } else { None })
    }

    /// The place for an object whose model is only to be known: an idle one. Where none will be
    /// idle as long as the hands stay, and there is no force for want of a model, it is that of the
    /// object in reach whose surface is farthest. Not of one that is touched: its proxy knows from
    /// where the hand came.
    pub(super) fn place_to_fetch(&self, tick: u64) -> Option<usize> {
        let idle = self.idle_place(0, tick);
        let may_wait = self.is_complete() || self.objects.iter().any(|of| of.is_pinned);
        if idle.is_some() || may_wait {
            return idle;
        }
        let places = self.objects.iter().enumerate();
        let untouched = places.filter(|(_, of)| !of.contacts.any_contact());
        let farthest =
            untouched.max_by(|(_, a), (_, b)| a.clearance_m().total_cmp(&b.clearance_m()));
        farthest.map(|(k, _)| k)
    }

    /// A vacant place, or else that of the object that has been out of reach for longest, and for
    /// more than so many ticks.
    fn idle_place(&self, ticks: u64, tick: u64) -> Option<usize> {
        let places = || self.objects.iter().enumerate();
        let idle = || {
            let idle = places().filter(|(_, of)| !of.is_pinned && of.needed + ticks < tick);
            idle.min_by_key(|(_, of)| of.needed)
        };
        let vacant = places().find(|(_, of)| of.instance.is_none());
        vacant.or_else(idle).map(|(k, _)| k)
    }
}
