//! Everything that the controller sized at start, and how much of it was ever in use.

use super::Controller;
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
    /// Capacities and high-water marks, for the end of a run: it allocates.
    #[must_use]
    pub fn capacities(&self) -> Vec<Capacity> {
        let cache = self.cache.high_water();
        let [wanted, unknown] = self.refinement.high_water();
        let mut all = vec![
            Capacity::new("splits in the cache", cache.splits.1, cache.splits.0),
            Capacity::new("blocks of closures", cache.blocks.1, cache.blocks.0),
            Capacity::new("regions known", cache.regions.1, cache.regions.0),
            Capacity::new("regions to be refined", wanted.1, wanted.0),
            Capacity::new("regions predicted in a tick", unknown.1, unknown.0),
        ];
        if self.tour.is_some() {
            let (length, capacity) = (self.path.len(), self.path.capacity());
            all.push(Capacity::new("points of the tour", capacity, length));
        }
        all
    }
}
