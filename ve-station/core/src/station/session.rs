//! What the station knows of one session: a client and an object.

use super::Chunk;
use super::answer::{Job, blank};
use super::path_generator::PathGenerator;
use super::region_at;
use crate::collection::{RegionAt, Residency};
use protocol::{CHUNK_SLOTS, CREDIT_CHUNKS, ChunkKind, MeasuredError, RegionAsk, Request};
use std::collections::VecDeque;

/// Questions of one session that may wait for an answer.
pub const MAX_JOBS: usize = 1 << 14;
/// Measured errors that fit into a chunk, and that wait for credit at the most; more replace the
/// oldest.
const MAX_MEASURED: usize = 2 * CHUNK_SLOTS;
/// So many measured errors are sent at once ...
const MEASURED_BATCH: usize = 16;
/// ... or those of so many ticks.
const MEASURED_TICKS: u64 = 50;

/// What becomes of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Accepted {
    /// It is the next one.
    Yes,
    /// It belongs to the past, or to an epoch that is broken.
    Stale,
    /// Something before it was lost: the epoch is broken now.
    Broken,
    /// It claims to have consumed what was never sent: the epoch is broken now.
    Damaged,
}

/// One client's conversation about one object.
#[derive(Debug)]
pub struct Session {
    pub client: u64,
    pub object: u32,
    incarnation: u64,
    /// The incarnation before: its late requests must not undo the new one's.
    former: Option<u64>,
    pub epoch: u32,
    broken: bool,
    /// Number of the next request.
    next: u64,
    /// Chunks of the epoch handed out.
    pub sent: u64,
    /// Chunks of the epoch acknowledged.
    consumed: u64,
    /// Chunks that may be under way.
    credit: u64,
    /// When it was last heard, in messages.
    pub last_heard: u64,
    pub jobs: VecDeque<Job>,
    /// Tours asked for: rolled while nothing else is to be answered.
    pub tours: VecDeque<PathGenerator>,
    /// The tour rolled last, whole or in part: whoever lost its chunks asks for it again.
    pub rolled: Option<PathGenerator>,
    /// What of the object's model the client is believed to hold.
    pub residency: Residency,
    measured: VecDeque<MeasuredError>,
    /// The probe that touched last.
    measured_probe: u32,
    /// Whether the measured errors go out even if they are few.
    flush: bool,
}

impl Session {
    pub fn new(request: &Request) -> Self {
        Self {
            client: request.client,
            object: request.object,
            incarnation: request.incarnation,
            former: None,
            epoch: request.epoch,
            broken: false,
            next: 0,
            sent: 0,
            consumed: 0,
            credit: 0,
            last_heard: 0,
            jobs: VecDeque::new(),
            tours: VecDeque::new(),
            rolled: None,
            residency: Residency::default(),
            measured: VecDeque::new(),
            measured_probe: 0,
            flush: false,
        }
    }

    /// Checks the place of a request in the conversation and takes its acknowledgement.
    pub fn accept(&mut self, request: &Request, heard: u64) -> Accepted {
        if request.incarnation != self.incarnation {
            if self.former == Some(request.incarnation) {
                return Accepted::Stale;
            }
            self.former = Some(self.incarnation);
            self.incarnation = request.incarnation;
            self.start_epoch(request.epoch);
        } else if request.epoch > self.epoch {
            self.start_epoch(request.epoch);
        } else if request.epoch < self.epoch {
            return Accepted::Stale;
        }
        self.last_heard = heard;
        if self.broken || request.sequence < self.next {
            return Accepted::Stale;
        }
        if request.sequence > self.next {
            self.break_epoch();
            return Accepted::Broken;
        }
        if request.consumed > self.sent {
            self.break_epoch();
            return Accepted::Damaged;
        }
        self.next += 1;
        self.consumed = self.consumed.max(request.consumed);
        self.credit = u64::from(request.credit).min(CREDIT_CHUNKS);
        Accepted::Yes
    }

    fn start_epoch(&mut self, epoch: u32) {
        self.epoch = epoch;
        self.break_epoch();
        self.broken = false;
        self.next = 0;
        self.sent = 0;
        self.consumed = 0;
    }

    /// Clears queue and belief, and waits for the next epoch. Of a tour what is rolled is kept.
    pub fn break_epoch(&mut self) {
        self.broken = true;
        self.jobs.clear();
        self.rolled = self.tours.pop_front().or(self.rolled.take());
        self.tours.clear();
        self.residency = Residency::default();
        self.measured.clear();
        self.flush = false;
    }

    /// Whether more is asked for than may wait.
    pub fn asks_too_much(&self) -> bool {
        self.jobs.len() + self.tours.len() > MAX_JOBS
    }

    pub fn has_credit(&self) -> bool {
        !self.broken && self.sent - self.consumed < self.credit
    }

    /// Queues the question for a region, unless it waits already. `whole`: with every record.
    ///
    /// An answer that has begun is broken off, and given anew with every record: who asks again
    /// lost it.
    pub fn subscribe(&mut self, model: usize, ask: RegionAsk, mut whole: bool) {
        let waiting = self.jobs.iter_mut().find(|j| j.is_of(region_at(&ask)));
        if let Some(Job::Region {
            answer,
            whole: waiting_whole,
            ..
        }) = waiting
        {
            if answer.is_none() {
                *waiting_whole |= whole;
                return;
            }
            whole = true;
            self.cancel(region_at(&ask));
        }
        self.jobs.push_back(Job::Region {
            model,
            ask,
            whole,
            answer: None,
        });
    }

    /// Drops the question for a region, answered in part or not at all.
    pub fn cancel(&mut self, region: RegionAt) {
        self.jobs.retain(|j| !j.is_of(region));
    }

    pub fn push_measured(&mut self, probe: u32, error: MeasuredError) {
        if self.broken {
            return;
        }
        if self.measured.len() == MAX_MEASURED {
            self.measured.pop_front();
        }
        self.measured.push_back(error);
        self.measured_probe = probe;
    }

    /// Sends what is there when it was this probe that touched: its contact ended.
    pub fn flush_measured(&mut self, probe: u32) {
        self.flush |= !self.measured.is_empty() && self.measured_probe == probe;
    }

    /// The waiting measured errors, when they are enough or old enough.
    pub fn measured_chunk(&mut self) -> Option<Chunk> {
        let (first, last) = (self.measured.front()?, self.measured.back()?);
        let due = self.flush
            || self.measured.len() >= MEASURED_BATCH
            || last.tick.saturating_sub(first.tick) >= MEASURED_TICKS;
        if !due {
            return None;
        }
        let (mut header, mut slots) = blank(ChunkKind::Measured, self.object);
        let words: &mut [MeasuredError] = bytemuck::cast_slice_mut(&mut slots);
        for (place, error) in words.iter_mut().zip(self.measured.drain(..)) {
            *place = error;
            header.count += 1;
        }
        header.last = 1;
        self.flush = false;
        Some((header, slots))
    }
}
