//! What the active objects share: bytes of the cache, and chunks under way.

use super::active_set::ActiveSet;
use super::object::ActiveObject;
use crate::instance::ObjectInstance;

/// Weight of each of `places` in the shares of the cache. Where every object has its own, half of
/// the cache is shared out by importance, so that a base mesh finds room in the least part too;
/// else places change hands and are equal.
pub(super) fn weights_of(instances: &[ObjectInstance], places: usize) -> Vec<f64> {
    if instances.len() == places {
        let importances = instances.iter().map(|of| of.importance);
        let mean = importances.clone().sum::<f64>() / places as f64;
        importances.map(|of| 0.5 * (of + mean)).collect()
    } else {
        vec![1.0; places]
    }
}

/// The part of a place in bytes that are shared out by weight.
pub(super) fn part_of(bytes: usize, weights: &[f64], place: usize) -> usize {
    let sum: f64 = weights.iter().sum();
    (bytes as f64 * weights[place] / sum) as usize
}

impl ActiveSet {
    /// Bytes to be shared out of which the least part is so many.
    pub fn bytes_for_least(&self, part: usize) -> usize {
        let sum: f64 = self.weights.iter().sum();
        let least = self.weights.iter().copied().fold(f64::INFINITY, f64::min);
        (part as f64 * sum / least).ceil() as usize
    }

    /// The operations of a tick that the object at a place may count on: all of them, but for one
    /// that is less important than another near a probe.
    pub fn operations_of(&self, place: usize, operations: f64) -> f64 {
        let near = self.objects.iter().filter(|of| of.is_near());
        let greatest = near.map(ActiveObject::importance).fold(0.0, f64::max);
        let importance = self.objects[place].importance();
        if importance < greatest {
            operations * (importance / greatest)
        } else {
            operations
        }
    }

    /// So many bytes of cache may be in use from now on, of those that were shared out at the
    /// start: what the stored base meshes leave, in the same parts.
    pub fn set_cache_limit(&mut self, bytes: usize) {
        let shared = bytes.saturating_sub(self.store.bytes());
        for (k, object) in self.objects.iter_mut().enumerate() {
            object
                .front
                .set_cache_limit(part_of(shared, &self.weights, k));
        }
    }

    /// Shares out the chunks that may be under way: one to an object out of reach, the rest by
    /// importance to the others.
    pub(super) fn share_credit(&mut self, tick: u64) {
        let used = self.objects.iter().filter(|of| of.instance.is_some());
        let needed = used.clone().filter(|of| of.needed == tick);
        let weights: f64 = needed.clone().map(ActiveObject::importance).sum();
        let idle = used.count() as u64 - needed.count() as u64;
        let window = self.meter.window();
        let shared = window.saturating_sub(idle) as f64;
        for object in &mut self.objects {
            let is_needed = object.needed == tick;
            let share = (shared * object.importance() / weights) as u64;
            object.session.set_credit(if is_needed { share } else { 1 });
        }
    }
}
