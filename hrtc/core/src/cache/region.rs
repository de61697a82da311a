//! A region and its state: the one place that changes the state of a region.
//!
//! ```text
//!             request            end_answer            want(true/false)
//!  (unknown) ---------> Requested ---------> Resident <----------------> (wanted)
//!                        ^  |                   |
//!             request    |  | begin_unload      | begin_unload
//!             _again     |  v                   v
//!                        |  Unwanting ---> Unloading ---> as its AfterUnload says:
//!                        |                                RequestAgain: ToRequestAgain
//!        ToRequestAgain -+                                Refuse, Reject: Refused
//!                                                         Release: ToRelease ---> (unknown,
//!                                                         once the station is told)
//!                                                         Forget: (unknown)
//! ```
//!
//! The station counts a region as subscribed from the request until it is told of the release.

use super::lists::{Cursor, List};
use super::region_key::RegionKey;

/// State of a region.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum RegionState {
    /// Requested; its closure or records are to come.
    Requested,
    /// Its closure is loaded.
    Resident,
    /// It is taken out of the set to be performed, some entries a tick, to be unloaded then.
    Unwanting,
    /// Its closure is being unloaded, some entries a tick.
    Unloading,
    /// Unloaded; the station is still to be told.
    ToRelease,
    /// Its answer built on records that were evicted: to be requested with every record.
    ToRequestAgain,
    /// Refused by the station, or its records do not fit the mesh: not requested again for a while.
    Refused,
}

/// What becomes of a region when its closure is unloaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum AfterUnload {
    /// The station is told that it is held no more.
    Release,
    /// It is forgotten without a word to the station.
    Forget,
    /// It is requested again, with every record.
    RequestAgain,
    /// It is not requested for a while: the station refused it.
    Refuse,
    /// It is not requested for a while: its records do not fit the mesh. Then the station, which
    /// holds it for subscribed, is told of its release.
    Reject,
}

/// A region in the table.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct Region {
    /// Its name.
    pub key: RegionKey,
    state: RegionState,
    /// Whether its closure is to be performed (set B of thesis Figure 5.17).
    pub wanted: bool,
    /// Entries of its closure that a change of `wanted`, or unloading, has still to go through.
    pub changing: u32,
    /// Whether all of it is performed; while wanted.
    pub refined: bool,
    /// What becomes of it; from when it is unloaded.
    after_unload: AfterUnload,
    /// Whether the first part of its answer has arrived; while requested.
    has_answer: bool,
    /// Tick when its unloading began; while refused that of the refusal.
    refused_at: u64,
    /// Its closure: slots, or ids of records that are still to come.
    pub closure: List,
    /// Records still to come.
    pub pending: u32,
    /// Next record to come, or next split to perform.
    pub cursor: Cursor,
    /// Tick when the prediction last named it.
    pub used_at: u64,
    /// Tick when the prediction last named it for refinement; 0 for never.
    pub needed: u64,
    /// Tick at which the contact was expected there when it was last predicted.
    pub due: u64,
    /// Splits to do when it became wanted, less those done for it since: a lower bound of those
    /// left.
    pub to_split: u32,
}

impl Region {
    /// A region that is requested at this moment.
    pub(super) fn requested(key: RegionKey) -> Self {
        Self {
            key,
            state: RegionState::Requested,
            wanted: false,
            changing: 0,
            refined: false,
            after_unload: AfterUnload::Forget,
            has_answer: false,
            refused_at: 0,
            closure: List::EMPTY,
            pending: 0,
            cursor: Cursor::start(&List::EMPTY),
            used_at: 0,
            needed: 0,
            due: 0,
            to_split: 0,
        }
    }

    /// Its state.
    #[must_use]
    pub fn state(&self) -> RegionState {
        self.state
    }

    /// Whether its closure is loaded and stays.
    #[must_use]
    pub fn is_resident(&self) -> bool {
        self.state == RegionState::Resident
    }

    /// Whether it is being unloaded.
    #[must_use]
    pub fn is_unloading(&self) -> bool {
        matches!(self.state, RegionState::Unwanting | RegionState::Unloading)
    }

    /// What becomes of it when it is unloaded, or became of it when it was.
    pub(super) fn after_unload(&self) -> AfterUnload {
        self.after_unload
    }

    /// Whether records of its answer are awaited: it is requested, and the first part has arrived.
    #[must_use]
    pub fn is_receiving(&self) -> bool {
        self.state == RegionState::Requested && self.has_answer
    }

    /// Whether all splits of its closure are performed.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.wanted && self.refined
    }

    /// Whether it was refused more than so many ticks ago.
    #[must_use]
    pub fn is_refused_before(&self, tick: u64, ticks: u64) -> bool {
        self.state == RegionState::Refused && tick > self.refused_at + ticks
    }

    /// The first part of its answer arrives; nothing of an earlier answer is loaded.
    pub(super) fn begin_answer(&mut self) {
        debug_assert_eq!(self.state, RegionState::Requested);
        self.has_answer = true;
    }

    /// Its answer is complete.
    pub(super) fn end_answer(&mut self) {
        debug_assert_eq!(self.state, RegionState::Requested);
        self.state = RegionState::Resident;
        self.cursor = Cursor::start(&self.closure);
    }

    /// It comes into the set to be performed, or leaves it: every entry of its closure is to be
    /// gone through.
    pub(super) fn want(&mut self, wanted: bool) {
        self.wanted = wanted;
        self.refined = false;
        self.to_split = 0;
        self.changing = self.closure.length();
        self.cursor = Cursor::start(&self.closure);
    }

    /// Its closure is to be unloaded, in this tick or in later ones.
    pub(super) fn begin_unload(&mut self, then: AfterUnload, tick: u64) {
        if !self.is_unloading() {
            self.state = RegionState::Unwanting;
        }
        self.after_unload = then;
        self.refused_at = tick;
    }

    /// It is not wanted any more: every entry of its closure is to be given up.
    pub(super) fn give_up(&mut self) {
        debug_assert!(!self.wanted && self.changing == 0);
        self.state = RegionState::Unloading;
        self.pending = 0;
        self.changing = self.closure.length();
        self.cursor = Cursor::start(&self.closure);
    }

    /// Its closure is unloaded: the station is to be told.
    pub(super) fn release(&mut self) {
        debug_assert!(!self.wanted && self.changing == 0);
        self.state = RegionState::ToRelease;
    }

    /// It is to be requested with every record.
    pub(super) fn ask_again(&mut self) {
        debug_assert!(self.state == RegionState::Unloading && self.changing == 0);
        self.state = RegionState::ToRequestAgain;
        self.has_answer = false;
    }

    /// It is requested with every record at this moment.
    pub(super) fn request_again(&mut self) {
        self.state = RegionState::Requested;
    }

    /// It cannot be had.
    pub(super) fn refuse(&mut self) {
        debug_assert!(self.state == RegionState::Unloading && self.changing == 0);
        self.state = RegionState::Refused;
    }
}
