//! One direction of a simulated link.

use std::collections::VecDeque;

/// Messages under way, in order, each due a fixed number of periods after it was posted.
#[derive(Debug, Clone)]
pub struct DelayLine<T> {
    delay: u64,
    under_way: VecDeque<(u64, T)>,
}

impl<T> DelayLine<T> {
    /// An empty line that takes `delay` periods.
    #[must_use]
    pub fn new(delay: u64) -> Self {
        Self {
            delay,
            under_way: VecDeque::new(),
        }
    }

    /// Puts a message on its way at a tick.
    pub fn post(&mut self, tick: u64, message: T) {
        self.under_way.push_back((tick + self.delay, message));
    }

    /// The next message if it is due at a tick.
    pub fn take(&mut self, tick: u64) -> Option<T> {
        let due = self.under_way.front().is_some_and(|(due, _)| *due <= tick);
        due.then(|| self.under_way.pop_front())?
            .map(|(_, message)| message)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_come_in_order_and_not_before_they_are_due() {
        let mut line = DelayLine::new(2);
        line.post(5, 'a');
        line.post(6, 'b');
        assert_eq!(line.take(6), None);
        assert_eq!((line.take(7), line.take(7)), (Some('a'), None));
        assert_eq!((line.take(9), line.take(9)), (Some('b'), None));
    }
}
