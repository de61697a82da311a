//! A cache whose limit changes while a scene runs.

use std::sync::Arc;

/// From a time on, so many bytes of the cache may be in use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CacheChangePlan {
    /// Seconds from the start of the loop.
    pub at_s: f64,
    /// Bytes that may be in use, of those that were reserved at the start.
    pub bytes: usize,
}

/// The changes of a run, with the place of the next one.
#[derive(Debug, Clone)]
pub struct CacheTimetable {
    changes: Arc<[CacheChangePlan]>,
    next: usize,
}

impl CacheTimetable {
    /// Before the first change. `changes`: by ascending time.
    #[must_use]
    pub fn new(changes: Arc<[CacheChangePlan]>) -> Self {
        Self { changes, next: 0 }
    }

    /// The limit that begins by a time, seconds, and was not told yet; of several the last one.
    pub fn due(&mut self, t_s: f64) -> Option<usize> {
        let rest = &self.changes[self.next..];
        let due = rest.partition_point(|change| change.at_s <= t_s);
        self.next += due;
        Some(rest[due.checked_sub(1)?].bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_change_is_told_once_and_of_several_in_a_stall_the_last() {
        let changes = [(1.0, 10), (2.0, 20), (2.5, 30), (4.0, 40)];
        let changes = changes.map(|(at_s, bytes)| CacheChangePlan { at_s, bytes });
        let mut table = CacheTimetable::new(Arc::new(changes));
        let told = [0.0, 0.5, 1.0, 1.1, 3.0, 3.9, 9.0, 10.0].map(|t| table.due(t));
        let expected = [None, None, Some(10), None, Some(30), None, Some(40), None];
        assert_eq!(told, expected);
    }
}
