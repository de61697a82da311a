//! Named faults in the product, each at one line, to show that the tests find them.
//!
//! Without the feature `on` no fault can be chosen, and [`is`] is a constant: nothing of a mutant
//! is compiled into the product. `rt-tests` has the feature `mutants`, which turns it on:
//! `rt-tests simulate --mutants` and `rt-tests stability --mutants`.

#![forbid(unsafe_code)]

#[cfg(feature = "on")]
use std::sync::Mutex;
#[cfg(feature = "on")]
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

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
    /// The energy account lets a third of each force pass.
    Mute,
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
    /// A wrench goes out a period late.
    LateForce,
    /// A contact less deep than a tenth of a millimetre has no force.
    DeadZone,
    /// The motion of a ball is not swept, and no face on its way is known.
    Sweep,
    /// The first half-space of a projection is not obeyed.
    Plane,
    /// Motions below an absolute length are taken for none.
    ShortMotion,
    /// Splits and collapses under a probe happen at once, and a tool feels them at once.
    Geomorph,
    /// Faces may be turned over under a probe.
    Folds,
    /// Without a station there is no force.
    Silence,
    /// Every sample that is finite is taken for a motion.
    Spike,
    /// A vibration has a phase of its own, which no recording holds.
    WallClock,
    /// A texture too fine for the loop is rendered.
    Alias,
    /// A shaded force turns at once.
    Shading,
    /// Effects come and go at once.
    Switch,
    /// An effect that is off is called.
    Unlisted,
    /// What sticks gives way a little in every tick.
    FrictionCreep,
    /// The probes on a surface share one state of its friction.
    FrictionShared,
    /// A movable object gets half of what its probe gets.
    Reaction,
    /// A movable object never sleeps.
    Restless,
    /// The builder counts nothing that it drops.
    Rejects,
    /// A tool passes all faces of the object but one in 64.
    ToolPairs,
    /// A tool has no torque.
    ToolTorque,
    /// A tool is held three times as stiffly as its surface is.
    ToolStiff,
}

impl Mutant {
    /// All of them.
    pub const ALL: [Self; 41] = [
        Self::Clamp,
        Self::Slew,
        Self::Fault,
        Self::Sign,
        Self::Passivity,
        Self::Mute,
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
        Self::LateForce,
        Self::DeadZone,
        Self::Sweep,
        Self::Plane,
        Self::ShortMotion,
        Self::Geomorph,
        Self::Folds,
        Self::Silence,
        Self::Spike,
        Self::WallClock,
        Self::Alias,
        Self::Shading,
        Self::Switch,
        Self::Unlisted,
        Self::FrictionCreep,
        Self::FrictionShared,
        Self::Reaction,
        Self::Restless,
        Self::Rejects,
        Self::ToolPairs,
        Self::ToolTorque,
        Self::ToolStiff,
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

/// Times that it was asked so far: a state that no recording holds.
#[cfg(feature = "on")]
#[must_use]
pub fn count() -> u64 {
    static ASKED: AtomicU64 = AtomicU64::new(0);
    ASKED.fetch_add(1, Ordering::Relaxed)
}

/// Puts a vector in the place of the last one that was put there: a state that all share.
#[cfg(feature = "on")]
#[must_use]
pub fn exchange(vector: [f64; 3]) -> [f64; 3] {
    static SHARED: Mutex<[f64; 3]> = Mutex::new([0.0; 3]);
    SHARED
        .lock()
        .map_or(vector, |mut shared| std::mem::replace(&mut shared, vector))
}

/// Nothing in this build.
#[cfg(not(feature = "on"))]
#[inline(always)]
#[must_use]
pub const fn count() -> u64 {
    0
}

/// The same vector in this build.
#[cfg(not(feature = "on"))]
#[inline(always)]
#[must_use]
pub const fn exchange(vector: [f64; 3]) -> [f64; 3] {
    vector
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
