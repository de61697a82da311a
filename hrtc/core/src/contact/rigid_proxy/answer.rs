//! What a tick of the proxy gives.

use super::contacts::ToolContact;
use super::projection::MAX_ACTIVE;
use crate::contact::query::{Ending, PairWork};

/// What a tick of the proxy gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolAdvance {
    pub(super) contacts: [ToolContact; MAX_ACTIVE],
    pub(super) contact_count: usize,
    /// Whether everything near was looked at. If not, the proxy has stayed where it is safe.
    pub ending: Ending,
    /// Whether a part of its way is left to the next tick: for want of budget, as the ending says, or since a tick that has
    /// spent a share of it begins nothing more, so that none costs much more than others.
    pub is_on_its_way: bool,
    /// What gathering and tests of the whole tool cost, in pairs of nodes and of faces.
    pub work: PairWork,
    /// What all of it cost, in pairs of nodes of equal cost: what the budget counts.
    pub spent: u32,
    /// Steps taken.
    pub steps: u32,
    /// Contacts that did not fit.
    pub dropped: u32,
    /// Whether the device's pose was not a pose: the proxy has stayed.
    pub rejected: bool,
}

impl ToolAdvance {
    pub(super) fn new() -> Self {
        Self {
            contacts: [ToolContact::NONE; MAX_ACTIVE],
            contact_count: 0,
            ending: Ending::Complete,
            is_on_its_way: false,
            work: PairWork::default(),
            spent: 0,
            steps: 0,
            dropped: 0,
            rejected: false,
        }
    }

    /// The contacts that push; none in free space.
    #[must_use]
    pub fn contacts(&self) -> &[ToolContact] {
        &self.contacts[..self.contact_count]
    }
}
