//! Splits and collapses that a probe feels: their vertices fly, see [`crate::perception`].

use crate::active::object::{ActiveObject, Budget};
use crate::lod::refine::Refinement;
use crate::perception::{
    AROUND, ContactConditions, NEAR_FACTOR, PerceptionLimit, allowed_share, box_of, excess,
    is_perceptible, may_come_near, space_of, turns_over,
};
use crate::probe::Probe;
use crate::probe::pair::ProbeObjectPair;
use glam::DVec3;
use spm::{Handle, Slot};

/// Steps of vertices that cost as much as a split or collapse.
const STEPS_PER_OPERATION: u32 = 2;

/// The share of what a probe allows in a tick that splits which come to their places in the tick of their take-off may take
/// together. Where anything else is in flight under it they take nothing.
const AT_ONCE: f64 = 0.5;

/// How a split or collapse is to be done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transition {
    /// At once: nobody feels it.
    Immediate,
    /// Its vertices fly.
    Geomorph,
    /// Not in this tick: what is around it flies, or there is no room.
    Deferred,
    /// Not while it is felt and all around it is as it is: a face would be turned over.
    Rejected,
}

/// What became of the collapse that has waited longest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Collapsed {
    /// None waits.
    None,
    /// It is performed.
    Done,
    /// Somebody feels it: its vertices fly first, or it waits on.
    Later,
}

impl ActiveObject {
    /// Takes in what the probes feel, and what they allow in this tick.
    pub(crate) fn feel(&mut self, probes: &[Probe]) {
        let Refinement { feelers, used, .. } = &mut self.refinement;
        feelers.clear();
        used.clear();
        used.resize(self.touches.len(), 0.0);
        let (Some(frame), Some(placing), true) = (self.frame, self.placing, self.geomorph) else {
            return;
        };
        for (k, (touch, probe)) in self.touches.iter_mut().zip(probes).enumerate() {
            let Some(goal) = touch.goal.filter(|_| touch.is_followed) else {
                continue;
            };
            let mut conditions = ContactConditions {
                centre: goal.position,
                radius: 0.0,
                up: DVec3::ZERO,
                metres_per_unit: frame.metres_per_unit,
                stiffness_n_per_m: placing.surface.stiffness_n_per_m,
                is_contact: touch.felt.is_some(),
                force_n: 0.0,
                depth_m: 0.0,
                reserve_j: 0.0,
                period_s: self.period_s,
            };
            if let (Some(felt), Some(rendered)) = (&touch.felt, &touch.rendered) {
                conditions.force_n = rendered.passive.force.length();
                conditions.depth_m = felt.depth_m;
                conditions.reserve_j = probe.energy.reserve(rendered.spring);
            }
            let first = feelers.len();
            for part in touch.follower.parts(&goal) {
                (conditions.centre, conditions.radius, conditions.up) =
                    (part.centre, part.radius, part.centre - part.goal);
                feelers.push((k, PerceptionLimit::new(&conditions)));
            }
            let Some((_, feeler)) = feelers.get(first) else {
                continue;
            };
            if touch.follower.is_behind() {
                // It has not caught up with what has moved: what it may do follows the force.
                touch.follower.limit_step(feeler.proxy_step());
            }
        }
    }

    /// A step of every vertex in flight; then the collapses of those that have come to their parents.
    pub(crate) fn fly(&mut self, tick: u64, budget: &mut Budget) {
        let count = self.cache.mesh().flights().len();
        let most = (budget.operations * STEPS_PER_OPERATION) as usize;
        // Where a tick has no time for all, each has its turn.
        let first = if count > most { tick as usize } else { 0 };
        let (mut steps, mut k) = (0, 0);
        while k < count && steps < most {
            steps += self.step((first + k) % count);
            k += 1;
        }
        self.cache.land();
        let spent = (steps as u32).div_ceil(STEPS_PER_OPERATION);
        let spent = spent.min(budget.operations);
        budget.operations -= spent;
        self.tally.work_units += spent;
        let mut index = 0;
        while let Some(flight) = self.cache.mesh().flights().get(index) {
            let maker = self.cache.mesh().maker_of_vertex(flight.vertex());
            let arrived = flight.is_to_parent() && flight.done() >= 1.0;
            match maker.filter(|&slot| arrived && self.cache.mesh().has_come_to_parent(slot)) {
                Some(slot) if budget.operations > 0 => {
                    self.collapse(slot);
                    budget.operations -= 1;
                    self.tally.work_units += 1;
                }
                _ => index += 1,
            }
        }
    }

    /// A step of a vertex in flight and of its sibling: as far as all allow that feel either, and both the same share of
    /// their ways, so that the faces between them open the right way round. The number of vertices moved.
    fn step(&mut self, index: usize) -> usize {
        let flight = self.cache.mesh().flights()[index];
        if let Some(slot) = self.cache.mesh().maker_of_vertex(flight.vertex())
            && flight.is_to_parent()
            && !self.cache.may_collapse(slot)
        {
            self.cache.stay(slot);
        }
        let flight = self.cache.mesh().flights()[index];
        let sibling = self.cache.mesh().sibling(&flight);
        if flight.done() >= 1.0 || sibling.is_some_and(|sibling| sibling < index) {
            // It waits for its sibling's collapse, or moves with it.
            return 0;
        }
        let share = self.allowed_share(index, sibling);
        for index in [Some(index), sibling].into_iter().flatten() {
            let mesh = self.cache.mesh();
            let flight = mesh.flights()[index];
            if mesh.around(&flight, &mut self.refinement.faces).is_some() {
                let done = flight.done() + share;
                self.cache.fly(index, done, &self.refinement.faces);
                self.carry_proxies();
            }
        }
        1 + usize::from(sibling.is_some())
    }

    /// The share of their ways that all who feel a vertex in flight and its sibling allow them in this tick; their proxies go
    /// gently then.
    fn allowed_share(&mut self, index: usize, sibling: Option<usize>) -> f64 {
        let mesh = self.cache.mesh();
        let Refinement {
            faces,
            faces_of_sibling,
            feelers,
            used,
            ..
        } = &mut self.refinement;
        let flight = mesh.flights()[index];
        let of_sibling = sibling.map(|index| mesh.flights()[index]);
        let is_whole = mesh.around(&flight, faces).is_some()
            && of_sibling.is_none_or(|flight| mesh.around(&flight, faces_of_sibling).is_some());
        if !is_whole {
            return 1.0;
        }
        let step = (flight, &*faces);
        let second = of_sibling.map(|flight| (flight, &*faces_of_sibling));
        let steps = [step, second.unwrap_or(step)];
        let steps = &steps[..1 + usize::from(second.is_some())];
        let mut share: f64 = 1.0;
        for (touch, feeler) in feelers {
            let follower = &self.touches[*touch].follower;
            let reaches = steps.iter().any(|(flight, around)| {
                let end = mesh.end_of(flight).as_dvec3();
                let space = box_of(mesh, around.deformed(), [end]);
                feeler.reaches(space) && follower.may_reach(space, AROUND)
            });
            if reaches {
                share = share.min(allowed_share(mesh, steps, feeler));
                used[*touch] = 1.0;
                self.touches[*touch]
                    .follower
                    .limit_step(feeler.proxy_step());
            }
        }
        share
    }

    /// Ends the flight of the split that took off last where those who feel it allow all of its way in this tick: what is
    /// that small need not keep a contact coarse until the next one.
    pub(crate) fn land_at_once(&mut self) {
        let mesh = self.cache.mesh();
        let Refinement {
            faces,
            faces_of_sibling,
            reached,
            used,
            ..
        } = &mut self.refinement;
        let Some([first, second]) = mesh.flights().last_chunk() else {
            return;
        };
        let is_whole =
            mesh.around(first, faces).is_some() && mesh.around(second, faces_of_sibling).is_some();
        if !is_whole {
            return;
        }
        let steps = [(*first, &*faces), (*second, &*faces_of_sibling)];
        let taken = |feeler: &PerceptionLimit| excess(mesh, &steps, feeler, 1.0);
        let mut all = reached.iter();
        if !all.all(|(touch, feeler)| used[*touch] + taken(feeler) <= AT_ONCE) {
            return;
        }
        for of_probe in reached.chunk_by(|(one, _), (other, _)| one == other) {
            let most = of_probe.iter().map(|(_, feeler)| taken(feeler));
            used[of_probe[0].0] += most.fold(0.0, f64::max);
        }
        let count = mesh.flights().len();
        for index in [count - 2, count - 1] {
            let mesh = self.cache.mesh();
            let flight = mesh.flights()[index];
            if mesh.around(&flight, &mut self.refinement.faces).is_some() {
                self.cache.fly(index, 1.0, &self.refinement.faces);
                self.carry_proxies();
            }
        }
        self.cache.land();
    }

    /// How a split is to be done.
    pub(crate) fn manner_of_split(&mut self, slot: Slot) -> Transition {
        let places = self.cache.mesh().children(slot);
        let manner = self.manner(slot, &places);
        self.tally.refused += u32::from(manner == Transition::Rejected);
        self.tally.postponed += u32::from(manner == Transition::Deferred);
        manner
    }

    /// How a split or collapse is to be done; `places` are the vertices that the faces get for corners.
    ///
    /// What is felt has its surroundings at rest: then every face turns on its way from how it was to how it will be, and
    /// not over.
    fn manner(&mut self, slot: Slot, places: &[Handle]) -> Transition {
        let Refinement {
            faces,
            feelers,
            reached,
            ..
        } = &mut self.refinement;
        let mesh = self.cache.mesh();
        // A record that does not fit is refused when it is performed.
        if feelers.is_empty() || mesh.patch(slot, faces).is_none() {
            return Transition::Immediate;
        }
        let space = space_of(mesh, faces, places);
        take_reached(reached, feelers, &self.touches, space, NEAR_FACTOR * AROUND);
        if reached.is_empty() && mesh.flights().is_empty() {
            // Nor can anything bring it nearer.
            return Transition::Immediate;
        }
        take_reached(reached, feelers, &self.touches, space, AROUND);
        if !is_perceptible(mesh, slot, faces, places, reached) {
            // The probe may come to where a face would be turned over, or the face to the probe.
            take_reached(reached, feelers, &self.touches, space, NEAR_FACTOR * AROUND);
            let folds =
                turns_over(mesh, slot, faces) && may_come_near(mesh, faces, places, reached);
            return if folds {
                Transition::Rejected
            } else {
                Transition::Immediate
            };
        }
        let flights = mesh.flights().len();
        // No more fly than a tick has operations.
        let has_room = mesh.may_take_off() && flights + 2 <= self.operations.max(2);
        if !has_room || mesh.any_in_flight(faces.deformed()) {
            Transition::Deferred
        } else if turns_over(mesh, slot, faces) {
            Transition::Rejected
        } else {
            for (touch, feeler) in reached {
                if feeler.reaches(space) {
                    self.touches[*touch]
                        .follower
                        .limit_step(feeler.proxy_step());
                }
            }
            Transition::Geomorph
        }
    }

    /// Performs the collapse that has waited longest, unless somebody feels it: then its vertices fly first.
    pub(crate) fn collapse_oldest(&mut self) -> Collapsed {
        let Some(slot) = self.cache.oldest_collapse() else {
            return Collapsed::None;
        };
        self.tally.work_units += 1;
        let parent = self.cache.mesh().parent(slot);
        match self.manner(slot, &[parent]) {
            Transition::Immediate => {
                self.collapse(slot);
                return Collapsed::Done;
            }
            Transition::Geomorph => self.cache.leave(slot),
            Transition::Deferred | Transition::Rejected => self.cache.postpone_collapse(slot),
        }
        Collapsed::Later
    }

    fn collapse(&mut self, slot: Slot) {
        self.cache.collapse(slot, &mut self.refinement.faces);
        self.carry_proxies();
        self.tally.ecols += 1;
    }
}

/// Takes over the feelers of the probes that what happens in a box may reach.
fn take_reached(
    reached: &mut Vec<(usize, PerceptionLimit)>,
    feelers: &[(usize, PerceptionLimit)],
    touches: &[ProbeObjectPair],
    space: [DVec3; 2],
    around: f64,
) {
    reached.clear();
    for of_probe in feelers.chunk_by(|(one, _), (other, _)| one == other) {
        let (touch, _) = of_probe[0];
        if touches[touch].follower.may_reach(space, around) {
            reached.extend_from_slice(of_probe);
        }
    }
}
