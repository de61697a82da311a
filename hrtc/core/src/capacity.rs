//! Capacities that the controller allocated at start, and the most of each that was ever in use.

use crate::controller::Controller;
use crate::probe::pair::ProbeObjectPair;
use serde::{Deserialize, Serialize};

/// A storage of fixed size. Where one is full, contacts become coarser or refine later.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Capacity {
    /// Its content.
    pub name: String,
    /// How many fit.
    pub capacity: u64,
    /// The most that were ever in it at once.
    pub high_water: u64,
}

impl Capacity {
    /// A capacity with its high-water mark.
    #[must_use]
    pub fn new(name: &str, capacity: usize, high_water: usize) -> Self {
        Self {
            name: name.to_string(),
            capacity: capacity as u64,
            high_water: high_water as u64,
        }
    }
}

impl Controller {
    /// Capacities and high-water marks, for the end of a run: it allocates. Of several places for
    /// active objects, and of the objects and proxies that had them, the largest of each counts.
    #[must_use]
    pub fn capacities(&self) -> Vec<Capacity> {
        let mut all: Vec<(&str, (usize, usize))> = Vec::new();
        let mut note = |name, (most, room): (usize, usize)| match all
            .iter_mut()
            .find(|(other, _)| *other == name)
        {
            Some((_, (before, capacity))) => {
                *before = most.max(*before);
                *capacity = room.max(*capacity);
            }
            None => all.push((name, (most, room))),
        };
        for active in &self.active.objects {
            let cache = active.front.cache.high_water();
            let [wanted, unknown] = active.front.high_water();
            note("splits in the cache", cache.splits);
            note("faces of the front and its tree", cache.faces);
            note("blocks of closures", cache.blocks);
            note("regions known", cache.regions);
            note("regions to be refined", wanted);
            note("regions predicted in a tick", unknown);
            note(
                "answers under way",
                active.session.subscriber().high_water(),
            );
            let releases = active.front.cache.regions.releases_high_water();
            note("releases to be told", releases);
            let pairs = active.contacts.pairs.iter();
            for (name, most) in pairs.flat_map(ProbeObjectPair::high_water) {
                note(name, most);
            }
        }
        let tours = self.probes.iter().filter_map(|probe| probe.tour.as_ref());
        for points in tours.map(|tour| &tour.points) {
            note("points of the tour", (points.len(), points.capacity()));
        }
        if self.active.objects.len() < self.active.instances.len() {
            note("slots of base meshes kept", self.active.store.high_water());
        }
        all.into_iter()
            .map(|(name, (most, room))| Capacity::new(name, room, most))
            .collect()
    }

    /// The most bytes that cache and base meshes took in a tick: the largest
    /// [`crate::record::CoreRecord::cache_bytes`].
    #[must_use]
    pub fn bytes_high_water(&self) -> usize {
        self.most_bytes as usize
    }
}
