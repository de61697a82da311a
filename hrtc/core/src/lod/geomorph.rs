//! Geomorphs: splits and collapses that a probe would perceive move their vertices in small steps,
//! see [`crate::perception`].

use super::front::Front;
use crate::budget::Budget;
use crate::perception::{
    AROUND, NEAR_FACTOR, PerceptionLimit, Step, allowed_share, box_of, excess, is_perceptible,
    may_come_near, space_of, turns_over,
};
use crate::probe::contacts::Contacts;
use crate::tuning::governor::{LARGE_FACES, OPERATION_FACES};
use crate::tuning::lod::{FACES_PER_WAIT, IMMEDIATE_SHARE, STEPS_PER_OPERATION};
use mutants::{Mutant, is};
use spm::{Geomorph, Handle, OperationError, Slot};

/// How a split or collapse is to be performed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transition {
    /// In one step: no probe perceives it.
    Immediate,
    /// By a geomorph of its vertices.
    Geomorph,
    /// Not in this tick: faces around it still move, or there is no room.
    Deferred,
    /// Not while another split may come first: a face near a probe would be turned over.
    Rejected,
}

impl Transition {
    /// Whether it is performed in this tick.
    #[must_use]
    pub fn is_performed(self) -> bool {
        matches!(self, Self::Immediate | Self::Geomorph)
    }
}

/// What happens to a split or collapse that would turn a face over near a probe.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Folds {
    /// It waits: others around it may take the fold away.
    Wait,
    /// It is performed like any other: a face may turn over, as slowly as the surface may move.
    Pass,
}

/// Outcome for the collapse that has waited longest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CollapseOutcome {
    /// None waits.
    None,
    /// It is performed.
    Done,
    /// A probe perceives it: its geomorph begins, or it waits on.
    Later,
}

impl Front {
    /// Steps every geomorph, unless the time is over before; then collapses the pairs whose
    /// vertices have come to their parents.
    pub(super) fn step_geomorphs(
        &mut self,
        tick: u64,
        budget: &mut Budget,
        contacts: &mut Contacts,
    ) {
        let geomorphs = self.cache.mesh().geomorphs();
        let count = geomorphs.len();
        let waits = self.without_turn.take();
        let waits = waits.and_then(|of| geomorphs.iter().position(|one| one.vertex() == of));
        let max_steps = (budget.operations * STEPS_PER_OPERATION) as usize;
        // Where a tick has no time for all, they take turns.
        let is_short = count > max_steps || count > (budget.faces / LARGE_FACES) as usize;
        let first = waits.unwrap_or(if is_short { tick as usize } else { 0 });
        let (mut steps, mut k) = (0, 0);
        while k < count && steps < max_steps && budget.faces > 0 {
            // One moves in any case, so that a machine that is always late gets on.
            if steps > 0 && budget.is_over() {
                let geomorphs = self.cache.mesh().geomorphs();
                let mut left = (k..count).map(|k| &geomorphs[(first + k) % count]);
                let next = left.find(|geomorph| geomorph.done() < 1.0);
                self.without_turn = next.map(Geomorph::vertex);
                break;
            }
            steps += self.step_geomorph((first + k) % count, budget, contacts);
            k += 1;
        }
        self.cache.finish_geomorphs();
        let spent = (steps as u32).div_ceil(STEPS_PER_OPERATION);
        let spent = spent.min(budget.operations);
        budget.operations -= spent;
        self.stats.work_units += spent;
        self.collapse_arrived(budget, contacts);
    }

    /// Collapses the pairs whose vertices have come to their parents.
    fn collapse_arrived(&mut self, budget: &mut Budget, contacts: &mut Contacts) {
        let mut index = 0;
        while let Some(geomorph) = self.cache.mesh().geomorphs().get(index) {
            let creator = self.cache.mesh().creator_of_vertex(geomorph.vertex());
            let arrived = geomorph.is_to_parent() && geomorph.done() >= 1.0;
            match creator.filter(|&slot| arrived && self.cache.mesh().has_reached_parent(slot)) {
                Some(slot) if budget.has_operations() => {
                    self.faces
                        .set_limit((budget.faces - OPERATION_FACES) as usize);
                    if !self.collapse(slot, contacts) {
                        // The fans have become too large meanwhile: the pair parts again.
                        self.cache.cancel_collapse(slot);
                        index += 1;
                    }
                    self.charge_operation(budget);
                    self.stats.work_units += 1;
                }
                _ => index += 1,
            }
        }
    }

    /// Steps a geomorph and that of its sibling: by the largest share of their displacements that
    /// every perception limit admits. The share is the same for both, so that the faces between
    /// them open the right way round. Where there is no time for the faces around both, they stay.
    /// Returns the number of vertices moved.
    fn step_geomorph(
        &mut self,
        index: usize,
        budget: &mut Budget,
        contacts: &mut Contacts,
    ) -> usize {
        let geomorph = self.cache.mesh().geomorphs()[index];
        if let Some(slot) = self.cache.mesh().creator_of_vertex(geomorph.vertex())
            && geomorph.is_to_parent()
            && !self.cache.may_collapse(slot)
        {
            self.cache.cancel_collapse(slot);
        }
        let geomorph = self.cache.mesh().geomorphs()[index];
        let sibling = self.cache.mesh().sibling_geomorph(&geomorph);
        if geomorph.done() >= 1.0 || sibling.is_some_and(|sibling| sibling < index) {
            // It waits for its sibling's collapse, or moves with it.
            return 0;
        }
        let around = self.find_faces_around(&geomorph, sibling, budget);
        let Some(around) = around.filter(|&around| around <= budget.faces) else {
            self.charge(around.unwrap_or(budget.faces) / FACES_PER_WAIT, budget);
            return 0;
        };
        let share = self.share_of_step(index, sibling, contacts);
        self.move_geomorphs(index, sibling, share, contacts);
        self.charge(around, budget);
        1 + usize::from(sibling.is_some())
    }

    /// Finds the faces around a geomorphing vertex and its sibling. Returns their number; `None`
    /// where there is no time for the faces of one of them.
    fn find_faces_around(
        &mut self,
        geomorph: &Geomorph,
        sibling: Option<usize>,
        budget: &Budget,
    ) -> Option<u32> {
        let mesh = self.cache.mesh();
        let of_sibling = sibling.map(|index| mesh.geomorphs()[index]);
        let [faces, others] = [&mut self.faces, &mut self.faces_of_sibling];
        faces.set_limit(budget.faces as usize);
        others.set_limit(budget.faces as usize);
        mesh.faces_around_geomorph(geomorph, faces)?;
        let mut around = faces.deformed().len();
        if let Some(other) = of_sibling {
            mesh.faces_around_geomorph(&other, others)?;
            around += others.deformed().len();
        }
        Some(around as u32)
    }

    /// Moves a geomorphing vertex and its sibling, whose faces were found, by a share of their
    /// displacements, and the proxies with them.
    fn move_geomorphs(
        &mut self,
        index: usize,
        sibling: Option<usize>,
        share: f64,
        contacts: &mut Contacts,
    ) {
        let pair = [Some(index), sibling];
        for (index, faces) in pair.into_iter().zip([&self.faces, &self.faces_of_sibling]) {
            if let Some(index) = index {
                let done = self.cache.mesh().geomorphs()[index].done() + share;
                self.cache.step_geomorph(index, done, faces);
                contacts.carry(self.cache.mesh(), faces);
            }
        }
    }

    /// The share of their displacements that a geomorph and that of its sibling, whose faces were
    /// found, may move in this tick; proxies that perceive them are limited in their steps.
    fn share_of_step(
        &mut self,
        index: usize,
        sibling: Option<usize>,
        contacts: &mut Contacts,
    ) -> f64 {
        if contacts.limits.is_empty() {
            return 1.0;
        }
        let mesh = self.cache.mesh();
        let Self {
            faces,
            faces_of_sibling,
            used,
            ..
        } = self;
        let geomorph = mesh.geomorphs()[index];
        let of_sibling = sibling.map(|index| mesh.geomorphs()[index]);
        let step = (geomorph, &*faces);
        let second = of_sibling.map(|other| (other, &*faces_of_sibling));
        let box_of_step = |(geomorph, around): Step<'_>| {
            let end = mesh.geomorph_target(&geomorph).as_dvec3();
            box_of(mesh, around.deformed(), [end])
        };
        let own_box = box_of_step(step);
        let boxes = [own_box, second.map_or(own_box, box_of_step)];
        let steps = [step, second.unwrap_or(step)];
        let count = 1 + usize::from(second.is_some());
        let (steps, boxes) = (&steps[..count], &boxes[..count]);
        let mut share: f64 = 1.0;
        for k in 0..contacts.limits.len() {
            let (probe, limit) = contacts.limits[k];
            let is_reached = boxes
                .iter()
                .any(|&space| limit.reaches(space) && contacts.may_reach(probe, space, AROUND));
            if is_reached {
                share = share.min(allowed_share(mesh, steps, &limit));
                used[probe] = 1.0;
                contacts.note_surface_motion(probe);
            }
        }
        share
    }

    /// Finishes the geomorph that began last where the perception limits admit all of it in this
    /// tick, so that a small one does not keep a contact coarse until the next tick.
    pub(super) fn finish_small_geomorph(&mut self, budget: &mut Budget, contacts: &mut Contacts) {
        let Some([first, second]) = self.cache.mesh().geomorphs().last_chunk().copied() else {
            return;
        };
        let count = self.cache.mesh().geomorphs().len();
        let around = self.find_faces_around(&first, Some(count - 1), budget);
        let Some(around) = around.filter(|&around| around <= budget.faces) else {
            return;
        };
        let mesh = self.cache.mesh();
        let Self {
            faces,
            faces_of_sibling,
            reached,
            used,
            ..
        } = self;
        let steps = [(first, &*faces), (second, &*faces_of_sibling)];
        let taken = |limit: &PerceptionLimit| excess(mesh, &steps, limit, 1.0);
        let mut all = reached.iter();
        if !all.all(|(probe, limit)| used[*probe] + taken(limit) <= IMMEDIATE_SHARE) {
            return;
        }
        for of_probe in reached.chunk_by(|(one, _), (other, _)| one == other) {
            let shares = of_probe.iter().map(|(_, limit)| taken(limit));
            used[of_probe[0].0] += shares.fold(0.0, f64::max);
        }
        self.move_geomorphs(count - 2, Some(count - 1), 1.0, contacts);
        self.charge(around, budget);
        self.cache.finish_geomorphs();
    }

    /// The transition for a split.
    pub(super) fn transition_of_split(
        &mut self,
        slot: Slot,
        folds: Folds,
        contacts: &mut Contacts,
    ) -> Transition {
        let places = self.cache.mesh().children(slot);
        let transition = self.transition(slot, &places, folds, contacts);
        self.stats.rejected += u32::from(transition == Transition::Rejected);
        self.stats.deferred += u32::from(transition == Transition::Deferred);
        transition
    }

    /// The transition for a split or collapse; `places` are the vertices that the faces get for
    /// corners.
    ///
    /// A geomorph begins only where the faces around it are at rest: then every face turns steadily
    /// from how it was to how it will be, and over only where [`Folds::Pass`] lets it.
    fn transition(
        &mut self,
        slot: Slot,
        places: &[Handle],
        folds: Folds,
        contacts: &mut Contacts,
    ) -> Transition {
        let Self { faces, reached, .. } = self;
        let mesh = self.cache.mesh();
        if contacts.limits.is_empty() || is(Mutant::Geomorph) {
            return Transition::Immediate;
        }
        match mesh.patch(slot, faces) {
            Ok(()) => {}
            Err(OperationError::TooManyFaces(_)) => return Transition::Deferred,
            // A record that does not fit is refused when it is performed.
            Err(OperationError::Damaged(_)) => return Transition::Immediate,
        }
        let space = space_of(mesh, faces, places);
        contacts.collect_reached(reached, space, NEAR_FACTOR * AROUND);
        if reached.is_empty() && mesh.geomorphs().is_empty() {
            // Nor can anything bring it nearer.
            return Transition::Immediate;
        }
        contacts.collect_reached(reached, space, AROUND);
        if !is_perceptible(mesh, slot, faces, places, reached) {
            // The probe may come to where a face would be turned over, or the face to the probe.
            contacts.collect_reached(reached, space, NEAR_FACTOR * AROUND);
            let waits = (folds == Folds::Wait || mesh.any_geomorphing(faces.deformed()))
                && turns_over(mesh, slot, faces)
                && may_come_near(mesh, faces, places, reached);
            return if waits {
                Transition::Rejected
            } else {
                Transition::Immediate
            };
        }
        let count = mesh.geomorphs().len();
        // No more geomorphs than a tick has operations.
        let has_room = mesh.can_start_geomorph() && count + 2 <= (self.operations as usize).max(2);
        if !has_room || mesh.any_geomorphing(faces.deformed()) {
            Transition::Deferred
        } else if folds == Folds::Wait && turns_over(mesh, slot, faces) {
            Transition::Rejected
        } else {
            for (probe, limit) in reached {
                if limit.reaches(space) {
                    contacts.note_surface_motion(*probe);
                }
            }
            Transition::Geomorph
        }
    }

    /// Performs the collapse that has waited longest; if a probe perceives it, a geomorph comes
    /// first.
    pub(super) fn collapse_oldest(
        &mut self,
        budget: &mut Budget,
        contacts: &mut Contacts,
    ) -> CollapseOutcome {
        let Some(slot) = self.cache.oldest_collapse() else {
            return CollapseOutcome::None;
        };
        self.stats.work_units += 1;
        self.faces.set_limit(budget.max_fan as usize);
        let parent = self.cache.mesh().parent(slot);
        let outcome = match self.transition(slot, &[parent], Folds::Wait, contacts) {
            Transition::Immediate if self.collapse(slot, contacts) => CollapseOutcome::Done,
            transition => {
                match transition {
                    Transition::Geomorph => self.cache.start_collapse(slot),
                    // Immediate: its fans are too large on this front.
                    _ => self.cache.defer_collapse(slot),
                }
                CollapseOutcome::Later
            }
        };
        self.charge_operation(budget);
        outcome
    }

    /// Performs a collapse; false when its fans are too large on this front.
    fn collapse(&mut self, slot: Slot, contacts: &mut Contacts) -> bool {
        let is_done = self.cache.collapse(slot, &mut self.faces).is_ok();
        if is_done {
            contacts.carry(self.cache.mesh(), &self.faces);
            self.stats.ecols += 1;
        }
        is_done
    }
}
