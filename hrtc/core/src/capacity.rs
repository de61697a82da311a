//! Everything that the controller sized at start, and how much of it was ever in use.

use crate::controller::Controller;
use serde::{Deserialize, Serialize};

/// Something of fixed size. What runs full is never exceeded: it makes the touch coarser or slower to refine.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Capacity {
    /// What it holds.
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
    /// Capacities and high-water marks, for the end of a run: it allocates. Of several seats, whose capacities are
    /// equal, the fullest counts.
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
        for seat in &self.seats {
            let cache = seat.cache.high_water();
            let [wanted, unknown] = seat.refinement.high_water();
            let [answers, releases] = seat.subscriber.high_water();
            note("splits in the cache", cache.splits);
            note("faces of the front and its tree", cache.faces);
            note("blocks of closures", cache.blocks);
            note("regions known", cache.regions);
            note("regions to be refined", wanted);
            note("regions predicted in a tick", unknown);
            note("answers under way", answers);
            note("releases to be told", releases);
            let touches = seat.touches.iter();
            for (name, most) in touches.filter_map(|t| t.follower.high_water()).flatten() {
                note(name, most);
            }
        }
        let tours = self.probes.iter().filter_map(|probe| probe.tour.as_ref());
        for points in tours.map(|tour| &tour.points) {
            note("points of the tour", (points.len(), points.capacity()));
        }
        if self.seats.len() < self.placings.len() {
            note("slots of base meshes kept", self.library.high_water());
        }
        all.into_iter()
            .map(|(name, (most, room))| Capacity::new(name, room, most))
            .collect()
    }

    /// The most bytes that cache and base meshes ever took.
    #[must_use]
    pub fn bytes_high_water(&self) -> usize {
        let seats = self.seats.iter().map(|seat| seat.cache.bytes_high_water());
        seats.sum::<usize>() + self.library.bytes_used()
    }
}
