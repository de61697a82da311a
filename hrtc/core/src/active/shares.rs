//! What the active objects share: bytes of the cache, and chunks under way.

use super::active_set::ActiveSet;

impl ActiveSet {
    /// So many bytes of cache may be in use from now on, of those that were shared out at the
    /// start: what the stored base meshes leave, in the same parts.
    pub fn set_cache_limit(&mut self, bytes: usize) {
        let shared = bytes.saturating_sub(self.store.bytes());
        let part = shared / self.objects.len();
        for object in &mut self.objects {
            object.front.set_cache_limit(part);
        }
    }

    /// Shares out the chunks that may be under way: one to an object out of reach, the others in
    /// equal parts to the rest.
    pub(super) fn share_credit(&mut self, tick: u64) {
        let used = self.objects.iter().filter(|of| of.instance.is_some());
        let needed = used.clone().filter(|of| of.needed == tick).count() as u64;
        let idle = used.count() as u64 - needed;
        let window = self.meter.window();
        let share = window.saturating_sub(idle) / needed.max(1);
        for object in &mut self.objects {
            let is_needed = object.needed == tick;
            object.session.set_credit(if is_needed { share } else { 1 });
        }
    }
}
