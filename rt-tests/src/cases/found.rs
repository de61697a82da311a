//! The size of a run of a case, and its result.

use super::bench::Fault;
use rand_xoshiro::Xoshiro256PlusPlus;

/// How much is run.
#[derive(Debug, Clone, Copy)]
pub struct Size {
    /// Whether the full set is run.
    pub full: bool,
}

impl Size {
    /// A number for the quick set, and one for the full set.
    #[must_use]
    pub fn of(&self, quick: u64, full: u64) -> u64 {
        if self.full { full } else { quick }
    }
}

/// Everything that a run of a case is given.
#[derive(Debug)]
pub struct Trial<'a> {
    /// How much is run.
    pub size: &'a Size,
    /// The source of all that is random.
    pub random: &'a mut Xoshiro256PlusPlus,
    /// The fault put in.
    pub fault: Fault,
}

/// What a case came to.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    /// The worst value seen.
    pub value: f64,
    /// Measurements made.
    pub passes: u64,
}

impl Found {
    /// Nothing seen; the value starts here.
    #[must_use]
    pub fn new(value: f64) -> Self {
        Self { value, passes: 0 }
    }

    /// Of what was seen the largest counts; what is no number counts as infinite.
    pub fn most(&mut self, value: f64) {
        let value = if value.is_nan() { f64::INFINITY } else { value };
        self.value = self.value.max(value);
        self.passes += 1;
    }

    /// Without a touch nothing was shown.
    pub fn count_touch(&mut self, touched: bool) {
        if !touched {
            self.most(f64::INFINITY);
        }
    }

    /// What went wrong is counted.
    pub fn count(&mut self, wrong: bool) {
        self.value += f64::from(u8::from(wrong));
        self.passes += 1;
    }
}
