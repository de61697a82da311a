//! How far a search or the steps of a proxy may go.

/// Tells whether the time of a tick is over: an input, since nothing here has a clock.
pub trait Deadline {
    /// Whether it is over.
    fn is_over(&mut self) -> bool;
}

/// What a search, or the steps of a proxy, may take: an amount of work, and the time until a
/// deadline. A number alone is that amount of work, without a deadline.
pub struct Limit<'a> {
    max_work: u32,
    deadline: Option<&'a mut dyn Deadline>,
    /// Work that is done whatever the time, and that from one question to the next.
    floor: u32,
    interval: u32,
    asks_at: u32,
    is_over: bool,
}

impl<'a> Limit<'a> {
    /// Up to an amount of work; the deadline is asked about once so much work is done as is done in
    /// any case (`floor`), and again after each `interval`.
    #[must_use]
    pub fn new(max_work: u32, [floor, interval]: [u32; 2], deadline: &'a mut dyn Deadline) -> Self {
        Self {
            max_work,
            deadline: Some(deadline),
            floor,
            interval,
            asks_at: floor,
            is_over: false,
        }
    }

    /// The amount of work.
    #[must_use]
    pub fn max_work(&self) -> u32 {
        self.max_work
    }

    /// So much was done that is no part of what is done in any case.
    pub fn begin_after(&mut self, done: u32) {
        self.floor = self.floor.saturating_add(done);
        self.asks_at = self.asks_at.saturating_add(done);
    }

    /// The limit of a part, of another amount of work, that begins when so much is done.
    pub fn part(&mut self, done: u32, max_work: u32) -> Limit<'_> {
        let floor = self.floor.saturating_sub(done);
        Limit {
            max_work,
            deadline: self.deadline.as_mut().map(|deadline| &mut **deadline as _),
            floor,
            interval: self.interval,
            asks_at: floor.max(self.interval),
            is_over: self.is_over,
        }
    }

    /// Whether the time is over for more than so much work.
    pub fn is_out_of_time(&mut self, done: u32) -> bool {
        if done < self.floor {
            return false;
        }
        let deadline = self.deadline.as_mut();
        self.is_over = self.is_over || deadline.is_some_and(|deadline| deadline.is_over());
        self.is_over
    }

    /// Whether nothing more may begin after so much work.
    #[inline]
    pub fn is_reached(&mut self, done: u32) -> bool {
        done >= self.max_work || (done >= self.asks_at && self.ask(done))
    }

    #[cold]
    fn ask(&mut self, done: u32) -> bool {
        self.asks_at = done.saturating_add(self.interval);
        self.is_out_of_time(done)
    }
}

impl From<u32> for Limit<'_> {
    fn from(max_work: u32) -> Self {
        Self {
            max_work,
            deadline: None,
            floor: u32::MAX,
            interval: u32::MAX,
            asks_at: u32::MAX,
            is_over: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over after so many questions.
    struct After(u32);

    impl Deadline for After {
        fn is_over(&mut self) -> bool {
            let is_over = self.0 == 0;
            self.0 = self.0.saturating_sub(1);
            is_over
        }
    }

    #[test]
    fn work_or_time_is_the_limit_and_time_is_asked_about_now_and_then() {
        let mut limit = Limit::from(100);
        assert!(!limit.is_reached(99) && limit.is_reached(100));
        assert!(!limit.is_out_of_time(100));
        let mut deadline = After(2);
        let mut limit = Limit::new(100, [20, 10], &mut deadline);
        let reached: Vec<u32> = (0..=100).filter(|&done| limit.is_reached(done)).collect();
        // Asked at 20, 30 and 40, where it is over, and then it stays so.
        assert_eq!(reached.first(), Some(&40));
        assert!(limit.is_out_of_time(20));
        // What is done in any case is done in parts, too.
        assert!(!limit.is_out_of_time(19) && !limit.part(5, 50).is_out_of_time(14));
        assert!(limit.part(5, 50).is_out_of_time(15));
        assert_eq!(limit.part(5, 50).max_work(), 50);
        assert!(limit.part(5, 12).is_reached(12));
        let mut deadline = After(0);
        let mut limit = Limit::new(100, [20, 10], &mut deadline);
        limit.begin_after(7);
        assert!(!limit.is_reached(26) && !limit.is_out_of_time(26));
        assert!(!limit.part(7, 50).is_out_of_time(19) && limit.part(7, 50).is_out_of_time(20));
        assert!(limit.is_reached(27) && limit.is_out_of_time(27));
    }
}
