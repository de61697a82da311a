//! The result of a tick of the proxy.

use super::contacts::ToolContact;
use super::projection::MAX_ACTIVE;
use crate::contact::query::{Ending, PairWork};

/// The result of a tick of the proxy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolAdvance {
    pub(super) contacts: [ToolContact; MAX_ACTIVE],
    pub(super) contact_count: usize,
    /// Whether everything near was examined. If not, the proxy stayed at a safe placement.
    pub ending: Ending,
    /// Whether a part of the motion remains for the next tick: for lack of budget before the first
    /// step, as the ending says, or after some steps.
    pub is_unsettled: bool,
    /// Cost of collections and of tests of the whole tool.
    pub work: PairWork,
    /// Total cost in node pairs: what the budget counts.
    pub spent: u32,
    /// Steps taken.
    pub steps: u32,
    /// Active contacts that the coupling of the tick before passed through: they were found late.
    /// The most of any step, and of the estimate with which a tick ends early.
    pub late_contacts: u32,
    /// Whether the surface had moved into the tool or over it, and no way out was known at first:
    /// the tool waits, and jumps when there is one that passes through no face.
    pub is_stuck: bool,
    /// Contacts beyond the capacity.
    pub dropped: u32,
    /// Whether the device's pose was invalid; then the proxy stayed.
    pub rejected: bool,
}

impl ToolAdvance {
    pub(super) fn new() -> Self {
        Self {
            contacts: [ToolContact::NONE; MAX_ACTIVE],
            contact_count: 0,
            ending: Ending::Complete,
            is_unsettled: false,
            work: PairWork::default(),
            spent: 0,
            steps: 0,
            late_contacts: 0,
            is_stuck: false,
            dropped: 0,
            rejected: false,
        }
    }

    /// The budget does not suffice.
    pub(super) fn run_out<T>(&mut self) -> Option<T> {
        self.ending = Ending::OutOfBudget { unvisited: 1 };
        None
    }

    /// The active contacts, the one that pushes most first; none in free space.
    #[must_use]
    pub fn contacts(&self) -> &[ToolContact] {
        &self.contacts[..self.contact_count]
    }
}
