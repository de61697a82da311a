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
        let [answers, releases] = self.subscriber.high_water();
        let mut all = vec![
            ("splits in the cache", cache.splits),
            ("faces of the front and its tree", cache.faces),
            ("blocks of closures", cache.blocks),
            ("regions known", cache.regions),
            ("regions to be refined", wanted),
            ("regions predicted in a tick", unknown),
            ("answers under way", answers),
            ("releases to be told", releases),
        ];
        if let Some(proxy) = &self.proxy {
            let [faces, planes] = proxy.high_water();
            all.push(("faces near the probe", faces));
            all.push(("half-spaces of the proxy", planes));
        }
        if self.tour.is_some() {
            let points = (self.path.len(), self.path.capacity());
            all.push(("points of the tour", points));
        }
        all.into_iter()
            .map(|(name, (most, room))| Capacity::new(name, room, most))
            .collect()
    }
}
