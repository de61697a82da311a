//! Named faults in the product, each at one line, to show that the tests find them.
//!
//! Without the feature `on` no fault can be chosen, and [`is`] is a constant: nothing of a mutant
//! is compiled into the product. `rt-tests` has the feature `mutants`, which turns it on.

#![forbid(unsafe_code)]

#[cfg(feature = "on")]
use std::sync::atomic::{AtomicUsize, Ordering};

/// A fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mutant {
    /// A wrench may be twice as large as its limit.
    Clamp,
    /// A wrench may change at once.
    Slew,
    /// Forces go on after a fault of a model.
    Fault,
    /// A contact's force points the other way.
    Sign,
    /// The energy account lets everything pass.
    Passivity,
    /// Samples that are not finite are taken.
    NotFinite,
    /// A tick may do four times as many splits.
    Budget,
    /// A region that is loaded does not hold the records that were there before.
    Reference,
    /// A record may be evicted that another one stands on.
    Dependency,
    /// An evicted record keeps its place under its id.
    StaleId,
    /// Boxes do not follow faces that move.
    Box,
    /// The face of a collapse stays in the tree.
    TreeFace,
    /// Certified errors of loaded records are 0.
    Certified,
    /// Silence of the station never ends an epoch.
    Timeout,
    /// A new station goes on in the epoch of the old one.
    NewStation,
    /// Chunks after a lost one are taken as the next ones.
    Gap,
    /// A ball does not see the half-space that holds it best.
    Constraint,
    /// A station goes on in its epoch where a request was lost.
    LostRequest,
}

impl Mutant {
    /// All of them.
    pub const ALL: [Self; 18] = [
        Self::Clamp,
        Self::Slew,
        Self::Fault,
        Self::Sign,
        Self::Passivity,
        Self::NotFinite,
        Self::Budget,
        Self::Reference,
        Self::Dependency,
        Self::StaleId,
        Self::Box,
        Self::TreeFace,
        Self::Certified,
        Self::Timeout,
        Self::NewStation,
        Self::Gap,
        Self::Constraint,
        Self::LostRequest,
    ];
}

/// The chosen one, counted from 1; 0 for none.
#[cfg(feature = "on")]
static CHOSEN: AtomicUsize = AtomicUsize::new(0);

/// Puts a fault into the whole process, or takes it out; runs that are under way change too.
#[cfg(feature = "on")]
pub fn choose(mutant: Option<Mutant>) {
    CHOSEN.store(mutant.map_or(0, |of| of as usize + 1), Ordering::SeqCst);
}

/// Whether a fault is in.
#[cfg(feature = "on")]
#[inline]
#[must_use]
pub fn is(mutant: Mutant) -> bool {
    CHOSEN.load(Ordering::Relaxed) == mutant as usize + 1
}

/// Whether a fault is in: never in this build.
#[cfg(not(feature = "on"))]
#[inline(always)]
#[must_use]
pub const fn is(_: Mutant) -> bool {
    false
}

#[cfg(all(test, feature = "on"))]
mod tests {
    use super::*;

    #[test]
    fn the_chosen_one_is_in_and_no_other() {
        for chosen in Mutant::ALL {
            choose(Some(chosen));
            for other in Mutant::ALL {
                assert_eq!(is(other), other == chosen);
            }
        }
        choose(None);
        assert!(Mutant::ALL.iter().all(|&mutant| !is(mutant)));
    }
}
