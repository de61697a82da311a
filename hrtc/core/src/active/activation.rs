//! Which objects become active, and in which places.
//!
//! An object becomes active when a probe comes near, long before a contact is possible: the reach
//! grows with the speed, holds the way of a tick however many periods were skipped, and is never
//! less than the range of an effect. It stays active as long as no other object needs its place;
//! then those go first that have been out of reach for longest. Where more objects are in reach
//! than there are places, the nearest of each probe have them (`places`); but none takes the place
//! of what the tip of a probe may touch: the rest of a tool keeps only what it touches.
//! One object becomes active a tick, so that a tick stays short. One that has its place late is
//! touched from where the probe was outside (`starts`), on a straight way from there: a hand that
//! went round it before it had a place, nearer than its coarsest front reaches, is held on the side
//! from which it came.
//!
//! Of more objects than there are places that a probe touches at once the last ones are not felt,
//! and of an object without a place no effect acts.
//! Boxes that overlap, such as of links of a chain, are all nearest to a probe within them: there
//! an object keeps its place however near the others are.
//!
//! No force is given before every model is known that can be. So each is requested at the start,
//! with an object that becomes active for it; where the places do not suffice, such an object goes
//! before one in reach, and may take its place.

use super::active_set::{ActiveSet, place};
use super::broad_phase::{Ball, Near};
use super::object::ActiveObject;
use super::starts::Vicinity;
use crate::budget::Budget;
use crate::instance::{ObjectInstance, in_axes_of};
use crate::probe::Probe;
use crate::streaming::Outbox;
use crate::tuning::active::{PLACED_A_TICK, REACH_RADII};
use geometry::Pose;

impl ActiveSet {
    /// Finds the objects near a probe, and makes the one that needs it most active. Returns the
    /// pairs of a probe and an object that could touch now though the object is not ready.
    pub fn activate(
        &mut self,
        probes: &[Probe],
        tick: u64,
        budget: &mut Budget,
        outbox: &mut Outbox,
    ) -> u32 {
        if self.instances.len() == 1 {
            return 0;
        }
        self.place_objects();
        self.find_near(probes);
        self.note_needs(probes, tick);
        if self.objects.len() < self.instances.len() {
            self.activate_one(probes, tick, budget, outbox);
        }
        self.share_credit(tick);
        self.count_unserved(probes)
    }

    /// Finds the objects near the probes: those that one may reach soon, that it may have gone
    /// through of late, or they over it, and those with an effect on it.
    fn find_near(&mut self, probes: &[Probe]) {
        // An object that it may have gone through needs some ticks to have its place.
        for (path, probe) in self.paths.iter_mut().zip(probes) {
            let ends = probe.last.zip(probe.pose);
            let went = ends.map(|(last, now)| last.position.distance(now.position));
            let went = went.filter(|went| went.is_finite());
            *path = went.unwrap_or(0.0).max(self.horizons.speed_left * *path);
        }
        // Skipped periods are the same for all probes.
        let elapsed = probes.first().map_or(1, |p| p.periods()[0]) as f64;
        self.passed_ticks = elapsed.max(self.horizons.speed_left * self.passed_ticks);
        let (reach_ticks, effects_m) = (self.horizons.reach, self.effects_m);
        let paths = self.paths.into_iter().zip(probes).enumerate();
        let balls = paths.filter_map(|(probe, (path, p))| {
            let around = (REACH_RADII * p.reach_m).max(p.reach_m + effects_m);
            Some(Ball {
                probe,
                centre: p.pose?.position,
                radius: around + (reach_ticks * p.speed).max(path),
            })
        });
        self.broad_phase
            .find(balls, reach_ticks.max(self.passed_ticks));
    }

    /// Tells the broad phase where objects are whose models have become known: at once where an
    /// object can be touched by now, and the others in turn. None waits for another's model: a hand
    /// would enter it. What was looked at is looked at again when another model is known.
    fn place_objects(&mut self) {
        let known = self.store.known();
        if self.looked_at.0 != known {
            self.looked_at = (known, 0);
        }
        let left = self.unplaced.len() - self.looked_at.1;
        if left == 0 {
            return;
        }
        for active in self.objects.iter().filter(|of| of.is_ready()) {
            if let Some(instance) = &active.instance
                && let Some(model) = self.store.model(instance.model)
            {
                place(&mut self.broad_phase, instance, model);
            }
        }
        for _ in 0..PLACED_A_TICK.min(left) {
            let Some(object) = self.unplaced.pop_back() else {
                return;
            };
            let instance = &self.instances[object as usize];
            match self.store.model(instance.model) {
                Some(model) => place(&mut self.broad_phase, instance, model),
                None => {
                    self.unplaced.push_front(object);
                    self.looked_at.1 += 1;
                }
            }
        }
    }

    /// Where the pair of a probe and an object that is near begins, if it begins in this tick;
    /// object's axes, metres.
    fn note_start(&mut self, near: Near, probes: &[Probe], tick: u64) -> Option<Pose> {
        let (instance, probe) = (&self.instances[near.object], &probes[near.probe]);
        let object = Some(near.object as u32);
        let active = self.objects.iter().find(|of| of.object() == object);
        // In the axes of the object then: motion since is the same to the sweep.
        let before = instance.before.unwrap_or(instance.pose);
        let beside = Vicinity {
            last: probe.last.map(|last| in_axes_of(&before, last)),
            now: probe.pose.map(|now| in_axes_of(&instance.pose, now)),
            distance: near.distance,
            zone: self.broad_phase.margin(near.object) + probe.reach_m,
            is_held: active.is_some_and(|of| of.contacts.pairs[near.probe].contact.is_some()),
        };
        let start = &mut self.starts[near.object * probes.len() + near.probe];
        start.note(&beside, tick, self.horizons.sleep)
    }

    /// Notes which active objects are needed in this tick, and begins and ends the pairs with their
    /// probes.
    fn note_needs(&mut self, probes: &[Probe], tick: u64) {
        for object in &mut self.objects {
            object.distance = f64::INFINITY;
        }
        for k in 0..self.broad_phase.near().len() {
            let near = self.broad_phase.near()[k];
            // Also with a place: it may lose that.
            let start = self.note_start(near, probes, tick);
            if let Some(object) = self.get_mut(near.object as u32) {
                object.comes_near(near, start, tick);
            }
        }
        let keeps_all = self.objects.len() == self.instances.len();
        for active in &mut self.objects {
            let object = active.object();
            let awaits = object.is_some_and(|o| probes.iter().any(|p| p.awaits_tour_of(o)));
            let is_used = object.is_some() && !active.session.is_ended();
            if active.contacts.any_contact() {
                active.distance = 0.0;
            }
            // A known model whose mesh is to come again does not hold a place that a hand has left:
            // where the station is gone it would for ever.
            let is_known = |of: ObjectInstance| self.store.model(of.model).is_some();
            let may_wait = !keeps_all && active.instance.is_some_and(is_known);
            let is_expected = !active.is_ready() && (active.distance.is_finite() || !may_wait);
            active.is_pinned = is_used && (awaits || is_expected);
            if active.is_pinned || active.distance.is_finite() {
                active.needed = tick;
            }
            for pair in &mut active.contacts.pairs {
                if pair.contact.is_some() {
                    pair.near_at = tick;
                }
                if pair.is_near && pair.near_at + self.horizons.sleep < tick {
                    pair.end();
                }
            }
        }
    }

    /// Makes the object active that needs it most. A place that changes hands is emptied before,
    /// over as many ticks as that takes.
    fn activate_one(
        &mut self,
        probes: &[Probe],
        tick: u64,
        budget: &mut Budget,
        outbox: &mut Outbox,
    ) {
        let Some((object, k)) = self.next_to_activate(probes, tick) else {
            return;
        };
        let active = &mut self.objects[k];
        if let Some(before) = active.object() {
            for (probe, of) in probes.iter().enumerate() {
                if let Some(beside) = active.outside((probe, of), budget) {
                    let start = before as usize * probes.len() + probe;
                    self.starts[start].go_on_from(beside);
                }
            }
            let epoch = active.session.close(outbox, tick);
            self.epochs[before as usize] = epoch.wrapping_add(1);
            active.vacate(tick);
            // Another session may end at once in the same place.
            self.noted = None;
        }
        if !active.is_vacant(budget) {
            return;
        }
        let instance = self.instances[object as usize];
        let is_stored = self.store.slots(instance.model).is_some();
        let stored = self.store.model(instance.model).filter(|_| is_stored);
        let epoch = self.epochs[object as usize];
        active.assign(instance, epoch, stored, tick);
        for near in self.broad_phase.near() {
            if near.object == object as usize {
                let start = &self.starts[near.object * probes.len() + near.probe];
                active.comes_near(*near, start.pose(), tick);
            }
        }
    }

    /// The object that needs most to become active, and its place: one that a probe needs, or else
    /// one whose model is not known yet. Where such a model is missing and no place is free, it
    /// goes first: there is no force before it is known.
    fn next_to_activate(&mut self, probes: &[Probe], tick: u64) -> Option<(u32, usize)> {
        let distances = self.distances();
        let needed = self.needed_objects(probes, &distances);
        let has_free_place = self.objects.iter().any(ActiveObject::is_free);
        let fetches_first = !self.is_complete() && !has_free_place;
        if (needed[0].is_none() || fetches_first)
            && let Some(object) = self.next_to_fetch()
            && let Some(k) = self.place_to_fetch(tick)
        {
            return Some((object, k));
        }
        // Where one has no place, that of another probe may have one.
        needed
            .iter()
            .flatten()
            .find_map(|of| Some((of.object, self.place_for(of, &distances, tick)?)))
    }

    /// An object whose model is neither known nor requested. Of many models some are looked at in
    /// a tick, so that each has its turn.
    fn next_to_fetch(&mut self) -> Option<u32> {
        if self.is_complete() && !self.faults.is_asking() {
            return None;
        }
        for _ in 0..PLACED_A_TICK.min(self.to_fetch.len()) {
            let object = self.to_fetch[self.next_fetch];
            if self.is_to_fetch(object) {
                return Some(object);
            }
            self.next_fetch = (self.next_fetch + 1) % self.to_fetch.len();
        }
        None
    }

    /// Whether an object's model is to be requested, and no active object has it.
    fn is_to_fetch(&self, object: u32) -> bool {
        let model = self.instances[object as usize].model;
        let is_coming = |of: &ActiveObject| of.instance.is_some_and(|of| of.model == model);
        self.store.model(model).is_none()
            && !self.faults.is_closed(model)
            && !self.objects.iter().any(is_coming)
    }

    /// Pairs of a probe and an object that could touch now though the object is not ready.
    fn count_unserved(&self, probes: &[Probe]) -> u32 {
        if !self.is_complete() {
            return 0;
        }
        let within = self.broad_phase.near().iter().filter(|near| {
            let probe = &probes[near.probe];
            let motion = self.broad_phase.displacement(near.object);
            let zone = self.broad_phase.margin(near.object) + probe.reach_m;
            near.distance <= zone + self.horizons.touch * (probe.speed + motion)
        });
        let missing = within.filter(|near| {
            let object = Some(near.object as u32);
            let is_ready = |of: &ActiveObject| of.object() == object && of.is_ready();
            !self.objects.iter().any(is_ready)
        });
        missing.count() as u32
    }
}

impl ActiveObject {
    /// Whether an object may have the place at once.
    fn is_free(&self) -> bool {
        self.instance.is_none() && !self.front.cache.is_clearing()
    }

    /// A probe is in reach; `start`: where their pair begins if it does, object's axes, metres.
    fn comes_near(&mut self, near: Near, start: Option<Pose>, tick: u64) {
        self.distance = self.distance.min(near.distance);
        if self.instance.is_none() {
            return;
        }
        let pair = &mut self.contacts.pairs[near.probe];
        pair.near_at = tick;
        if pair.is_near {
            pair.waits(start);
        } else {
            self.approached_by(near.probe, start);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cache::base_mesh_store::Model;
    use crate::streaming::Fault;
    use crate::streaming::subscriber::Identity;
    use glam::DVec3;
    use scene::{NoFiles, Overrides, parse};
    use spm::ModelHeader;
    use std::path::Path;

    /// Of a scene of these models, one an object, and a probe.
    fn set_of(models: impl Iterator<Item = usize>) -> ActiveSet {
        set_with(1, models)
    }

    /// The same with so many probes.
    fn set_with(probes: usize, models: impl Iterator<Item = usize>) -> ActiveSet {
        let mut text = String::from("[cache]\nbytes = \"3MiB\"\n");
        text += &"[[probe]]\n".repeat(probes);
        for model in models {
            text += &format!("[[object]]\nmodel = \"{model}.spm\"\nsize_m = 0.1\n");
        }
        let path = Path::new("");
        let plan = parse(&text, "models", path, &Overrides::default(), &NoFiles).unwrap();
        let identity = Identity {
            client: 7,
            incarnation: 8,
        };
        ActiveSet::new(&plan, identity, 0, std::iter::empty())
    }

    #[test]
    fn of_many_models_some_are_looked_at_in_a_tick_and_each_has_its_turn() {
        let last = 4 * PLACED_A_TICK + 5;
        let mut set = set_of(0..=last);
        let refused = (0..last).map(|model| (model, Some(Fault::UnknownModel)));
        set.faults.note(refused, |_| false, 0);
        let found: Vec<_> = (0..8).map(|_| set.next_to_fetch()).collect();
        // It stays the next one until it has a place.
        let object = Some(last as u32);
        assert_eq!(
            found,
            [None, None, None, None, object, object, object, object]
        );
    }

    #[test]
    fn models_are_requested_in_the_order_of_their_first_objects() {
        let mut set = set_of([3, 1, 3, 1, 2, 3, 0].into_iter());
        assert_eq!(set.to_fetch, [0, 1, 4, 6]);
        assert_eq!(set.unplaced.len(), 7, "each object is to be placed");
        let refuse = |set: &mut ActiveSet, model| {
            let refused = [(model, Some(Fault::UnknownModel))];
            set.faults.note(refused.into_iter(), |_| false, 0);
        };
        for (model, object) in [0, 1, 4, 6].into_iter().enumerate() {
            assert_eq!(set.next_to_fetch(), Some(object));
            refuse(&mut set, model);
        }
        assert_eq!(set.next_to_fetch(), None);
    }

    #[test]
    fn an_object_without_a_box_is_looked_at_again_when_another_model_is_known() {
        // More of a model than are looked at in a tick, and one of another.
        let many = PLACED_A_TICK + 1;
        let mut set = set_of(std::iter::repeat_n(0, many).chain([1]));
        let two_ticks = |set: &mut ActiveSet| {
            set.place_objects();
            set.place_objects();
        };
        two_ticks(&mut set);
        let order = set.unplaced.clone();
        set.place_objects();
        assert_eq!(set.unplaced, order, "each was looked at");
        let mut header: ModelHeader = bytemuck::Zeroable::zeroed();
        header.upper = [1.0; 3];
        let model = Model {
            header,
            radius_max: 0.0,
            area: 1.0,
        };
        set.store.insert(1, model);
        two_ticks(&mut set);
        assert_eq!(set.unplaced.len(), many, "it is placed");
        assert!(set.unplaced.iter().all(|&object| object < many as u32));
        set.store.insert(0, model);
        two_ticks(&mut set);
        assert!(set.unplaced.is_empty());
    }

    /// A floor of four tiles, whose coarse fronts reach far into each other.
    #[test]
    fn the_tile_across_a_corner_gives_its_place() {
        const TILE: f64 = 0.1;
        let mut set = set_of([0; 4].into_iter());
        assert_eq!(set.objects.len(), 3, "places");
        for (object, (x, y)) in [(0.0, 0.0), (-TILE, 0.0), (0.0, -TILE), (-TILE, -TILE)]
            .into_iter()
            .enumerate()
        {
            let lower = DVec3::new(x, y, 0.0);
            let upper = lower + DVec3::splat(TILE);
            set.broad_phase.place(object, lower, upper, 0.5 * TILE);
        }
        for (place, instance) in set.objects.iter_mut().zip(&set.instances) {
            place.instance = Some(*instance);
        }
        let tip = set.objects[0].contacts.pairs[0].patch_m;
        // In the last tile, so far from the others.
        let mut place_for_it = |inside: f64| {
            let ball = Ball {
                probe: 0,
                centre: DVec3::new(-inside, -inside, 0.5 * TILE),
                radius: TILE,
            };
            let near = set.broad_phase.find([ball], 1.0).to_vec();
            assert_eq!(near.len(), 4);
            let mut distance = f64::INFINITY;
            for near in near {
                match set.get_mut(near.object as u32) {
                    Some(active) => active.distance = near.distance,
                    None => distance = near.distance,
                }
            }
            assert_eq!(distance, 0.0);
            let distances = set.distances();
            let needed = set.needed_at((3, 0), distance, &distances);
            set.place_for(&needed, &distances, 0)
        };
        assert_eq!(place_for_it(0.2 * TILE), Some(0));
        assert_eq!(place_for_it(0.8 * tip), Some(0));
        // There the tip may touch all of them.
        assert_eq!(place_for_it(0.6 * tip), None);
    }

    /// One probe is in eight boxes at once and touches nothing, another one is near two others.
    #[test]
    fn a_probe_in_a_crowd_leaves_another_its_place() {
        const CROWD: usize = 8;
        let mut set = set_with(2, std::iter::repeat_n(0, CROWD + 2));
        assert_eq!(set.objects.len(), 5, "places");
        for object in 0..CROWD {
            set.broad_phase
                .place(object, DVec3::splat(-1.0), DVec3::ONE, 0.0);
        }
        let tip = set.objects[0].contacts.pairs[0].patch_m;
        // The next one begins where the first one ends.
        for (object, lower) in [(CROWD, 10.0), (CROWD + 1, 11.0)] {
            let lower = DVec3::X * lower;
            set.broad_phase
                .place(object, lower, lower + DVec3::ONE, 0.0);
        }
        for (place, instance) in set.objects.iter_mut().zip(&set.instances) {
            place.instance = Some(*instance);
        }
        let place_for = |set: &mut ActiveSet, object: usize, x: f64| {
            let ball = |probe, x| Ball {
                probe,
                centre: DVec3::new(x, 0.5, 0.5),
                radius: 1.0,
            };
            let near = set.broad_phase.find([ball(0, 0.0), ball(1, x)], 1.0);
            let near = near.to_vec();
            for of in &mut set.objects {
                of.distance = f64::INFINITY;
            }
            for near in &near {
                if let Some(active) = set.get_mut(near.object as u32) {
                    active.distance = active.distance.min(near.distance);
                }
            }
            let needed = near.iter().find(|near| near.object == object);
            let needed = needed.expect("it is in reach");
            let distances = set.distances();
            let of = (object as u32, needed.probe);
            let needed = set.needed_at(of, needed.distance, &distances);
            set.place_for(&needed, &distances, 0)
        };
        let first = 9.9;
        assert_eq!(place_for(&mut set, 5, first), None, "of the crowd");
        let place = place_for(&mut set, CROWD, first);
        let place = place.expect("the first one of the other probe has a place");
        set.objects[place].instance = Some(set.instances[CROWD]);
        for object in (0..CROWD).filter(|&object| object == place || object > 4) {
            assert_eq!(place_for(&mut set, object, first), None, "{object}");
        }
        // In the first one, the next is needed when the tip may touch it.
        let next = CROWD + 1;
        assert_eq!(place_for(&mut set, next, 11.0 - 2.0 * tip), None);
        let other = place_for(&mut set, next, 11.0 - 0.5 * tip);
        assert!(other.is_some_and(|other| other != place), "{other:?}");
    }
}
