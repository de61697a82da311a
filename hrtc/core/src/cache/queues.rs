//! Free slots, and the queues of what may be collapsed and evicted.

use super::{Cache, Queue, References};
use mutants::{Mutant, is};
use spm::{NONE, Slot};

impl Cache {
    /// A slot for a record: one that came back, or the next that was never in use, which counts as
    /// used from [`Cache::begin_references`] on.
    pub(super) fn take_slot(&mut self) -> Option<Slot> {
        if !self.has_slot() {
            return None;
        }
        if self.headroom() <= 0 {
            self.evict(self.evictions.first);
        }
        Some(self.free.pop().unwrap_or(self.slots_used))
    }

    /// Gives a slot back that no record was put into.
    pub(super) fn give_back(&mut self, slot: Slot) {
        if slot < self.slots_used {
            self.free.push(slot);
        }
    }

    /// A record that one region holds is in a slot now.
    pub(super) fn begin_references(&mut self, slot: Slot) {
        let references = References {
            held: 1,
            ..References::default()
        };
        match self.references.get_mut(slot as usize) {
            Some(place) => *place = references,
            None => self.references.push(references),
        }
        self.slots_used = self.slots_used.max(slot + 1);
    }

    /// Slots without a record.
    pub(super) fn free_slots(&self) -> u32 {
        self.free.len() as u32 + (self.slots - self.slots_used)
    }

    /// Slots that a record could go to now, free or to be evicted: at least this many.
    #[must_use]
    pub fn has_slot(&self) -> bool {
        let headroom = self.headroom();
        headroom > 0 || (headroom == 0 && self.evictions.first != NONE)
    }

    /// Performed splits that nothing needs any more and that may be collapsed now.
    #[must_use]
    pub fn to_collapse(&self) -> u32 {
        self.collapses.count
    }

    /// Sets how many records may be on their way from a station so far away that it hears late of
    /// what was released.
    pub fn set_in_transit(&mut self, records: u32) {
        self.in_transit = records;
    }

    /// Whether less than an eighth of the slots, or a sixteenth of list blocks or places for
    /// regions is free. Where records may be on their way from a station far away, as many slots
    /// are kept as these, up to a third: the larger part is for what is refined.
    ///
    /// Slots count as free when they may be evicted without releasing anything. Enough of them at
    /// hand is what lets a fast probe load without waiting for room, and keeps what was released
    /// until no answer counts on it any more: those that were sent before the station heard of it.
    #[must_use]
    pub fn is_nearly_full(&self) -> bool {
        let headroom = self.headroom();
        let slots = (i64::from(self.loaded) + headroom).max(0);
        let kept = (slots / 8).max(i64::from(self.in_transit).min(slots / 3));
        let slots = headroom + i64::from(self.evictions.count) < kept;
        slots || self.lists.is_nearly_full() || self.regions.is_nearly_full()
    }

    pub(super) fn evict(&mut self, slot: Slot) {
        self.unqueue(slot);
        let dependencies = self.mesh.dependencies(slot);
        if !is(Mutant::StaleId) {
            self.ids.remove(self.mesh.id(slot));
        }
        self.mesh.unload(slot);
        for dependency in dependencies {
            self.references[dependency as usize].loaded_dependents -= 1;
            self.requeue(dependency);
        }
        self.loaded -= 1;
        self.evicted += 1;
        self.free.push(slot);
    }

    pub(super) fn requeue_with_dependencies(&mut self, slot: Slot) {
        self.requeue(slot);
        for dependency in self.mesh.dependencies(slot) {
            self.requeue(dependency);
        }
    }

    /// Puts a slot into the queue that its references say, if it is not there.
    pub(super) fn requeue(&mut self, slot: Slot) {
        let references = self.references[slot as usize];
        let performed = self.mesh.is_performed(slot);
        let queue = if performed {
            let may = self.may_collapse(slot) && !references.leaving;
            if may { Queue::Collapses } else { Queue::None }
        } else if references.held == 0
            && (references.loaded_dependents == 0 || is(Mutant::Dependency))
        {
            Queue::Evictions
        } else {
            Queue::None
        };
        if queue == references.queue {
            return;
        }
        self.unqueue(slot);
        let ends = match queue {
            Queue::None => return,
            Queue::Collapses => &mut self.collapses,
            Queue::Evictions => &mut self.evictions,
        };
        ends.count += 1;
        let last = std::mem::replace(&mut ends.last, slot);
        if last == NONE {
            ends.first = slot;
        } else {
            self.references[last as usize].next = slot;
        }
        let references = &mut self.references[slot as usize];
        references.queue = queue;
        references.previous = last;
        references.next = NONE;
    }

    fn unqueue(&mut self, slot: Slot) {
        let References {
            queue,
            previous,
            next,
            ..
        } = self.references[slot as usize];
        let ends = match queue {
            Queue::None => return,
            Queue::Collapses => &mut self.collapses,
            Queue::Evictions => &mut self.evictions,
        };
        ends.count -= 1;
        if previous == NONE {
            ends.first = next;
        }
        if next == NONE {
            ends.last = previous;
        }
        if previous != NONE {
            self.references[previous as usize].next = next;
        }
        if next != NONE {
            self.references[next as usize].previous = previous;
        }
        self.references[slot as usize].queue = Queue::None;
    }
}
