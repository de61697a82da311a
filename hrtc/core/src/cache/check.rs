//! Every invariant of a cache, for tests.

use super::{Cache, Cursor, PENDING, Queue, RegionState};

impl Cache {
    /// Checks every invariant of mesh, tree, counts and queues; for tests, it allocates.
    ///
    /// # Panics
    /// With the first thing found wrong.
    pub fn check(&self) {
        self.mesh.check();
        self.tree.check(|face| self.mesh.face_box(face));
        assert_eq!(self.tree.faces(), self.mesh.active_faces());
        let slots = self.slots as usize;
        let (mut held, mut wanted) = (vec![0u16; slots], vec![0u16; slots]);
        for index in self.regions.indices() {
            let region = self.regions.at(index);
            let mut cursor = Cursor::start(&region.closure);
            let mut pending = 0;
            let length = region.closure.length();
            let leaving = region.state() == RegionState::Unloading;
            let mut place = 0;
            while let Some(item) = self.lists.get(&region.closure, cursor) {
                // What a change has not gone through yet is as it was.
                let is_done = place < length - region.changing;
                place += 1;
                if item & PENDING == 0 {
                    held[item as usize] += u16::from(!(leaving && is_done));
                    wanted[item as usize] += u16::from(!leaving && region.wanted == is_done);
                } else if !leaving {
                    pending += 1;
                }
                cursor = self.lists.next(cursor);
            }
            assert_eq!(pending, region.pending, "records to come");
        }
        // Slots that were never in use are free too.
        let mut free: Vec<bool> = (0..slots)
            .map(|slot| slot >= self.slots_used as usize)
            .collect();
        for &slot in &self.free {
            free[slot as usize] = true;
        }
        let dependents = self.dependents(&free);
        for slot in 0..self.slots {
            if free[slot as usize] {
                assert!(!self.mesh.is_performed(slot));
                continue;
            }
            let references = &self.references[slot as usize];
            assert_eq!(self.ids.get(self.mesh.id(slot)), Some(slot), "id of a slot");
            assert_eq!(references.held, held[slot as usize], "holders");
            assert_eq!(references.wanted, wanted[slot as usize], "wanters");
            let dependents = dependents[slot as usize];
            assert_eq!(references.loaded_dependents, dependents, "dependents");
            let is_unused = !self.mesh.is_performed(slot) && references.held == 0;
            assert_eq!(
                references.queue == Queue::Evictions,
                is_unused && dependents == 0,
                "only what no record stands on may be evicted"
            );
            let idle = self.may_collapse(slot) && !references.leaving;
            assert_eq!(references.queue == Queue::Collapses, idle);
            let vt = self.mesh.vt(slot);
            let geomorphs = |v| {
                self.mesh
                    .geomorphs()
                    .iter()
                    .any(|f| f.vertex() == v && f.is_to_parent())
            };
            assert_eq!(
                references.leaving,
                geomorphs(vt) || geomorphs(vt + 1),
                "it geomorphs"
            );
            assert_eq!(geomorphs(vt), geomorphs(vt + 1), "both go to their parent");
        }
        assert_eq!(self.free_slots() + self.loaded, self.slots, "slots");
    }

    /// Loaded records that stand on each slot.
    fn dependents(&self, free: &[bool]) -> Vec<u16> {
        let mut dependents = vec![0u16; free.len()];
        for slot in (0..self.slots).filter(|&slot| !free[slot as usize]) {
            for dependency in self.mesh.dependencies(slot) {
                dependents[dependency as usize] += 1;
            }
        }
        dependents
    }
}
