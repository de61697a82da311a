//! How far a search or the steps of a proxy may go.

/// Tells whether the time of a tick is over: an input, since nothing here has a clock.
pub trait Deadline {
    /// Whether it is over.
    fn is_over(&mut self) -> bool;
}

/// What a search, or the steps of a proxy, may take: an amount of work, and the time until a
/// deadline, which is asked about each time that so much of the work is done. A number alone is
/// that amount of work, without a deadline.
pub struct Limit<'a> {
    max_work: u32,
    deadline: Option<&'a mut dyn Deadline>,
    /// Work from one question to the next, and where the next is due.
    interval: u32,
    asks_at: u32,
    is_over: bool,
}

impl<'a> Limit<'a> {
    /// Up to an amount of work; a deadline is asked about once an `interval` of work, at least 1.
    #[must_use]
    pub fn new(max_work: u32, interval: u32, deadline: &'a mut dyn Deadline) -> Self {
        Self {
            max_work,
            deadline: Some(deadline),
            interval,
            asks_at: interval,
            is_over: false,
        }
    }

    /// The amount of work.
    #[must_use]
    pub fn max_work(&self) -> u32 {
        self.max_work
    }

    /// The same deadline with another amount of work.
    pub fn with_work(&mut self, max_work: u32) -> Limit<'_> {
        Limit {
            max_work,
            deadline: self.deadline.as_mut().map(|deadline| &mut **deadline as _),
            interval: self.interval,
            asks_at: self.interval,
            is_over: self.is_over,
        }
    }

    /// Whether the time is over, whatever was done.
    pub fn is_over(&mut self) -> bool {
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
        self.is_over()
    }
}

impl From<u32> for Limit<'_> {
    fn from(max_work: u32) -> Self {
        Self {
            max_work,
            deadline: None,
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
        assert!(!limit.is_reached(99) && limit.is_reached(100) && !limit.is_over());
        let mut deadline = After(2);
        let mut limit = Limit::new(100, 10, &mut deadline);
        let reached: Vec<u32> = (0..=100).filter(|&done| limit.is_reached(done)).collect();
        // Asked at 10, 20 and 30, where it is over, and where it is over it stays so.
        assert_eq!(reached.first(), Some(&30));
        assert!(limit.is_over() && limit.with_work(50).is_over());
        assert_eq!(limit.with_work(50).max_work(), 50);
    }
}
