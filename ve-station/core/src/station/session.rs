//! What the station knows of one session: a client and an object.

use super::Chunk;
use super::answer::{Answer, Job, blank};
use super::path_generator::PathGenerator;
use super::region_at;
use super::residency_change::ResidencyChange;
use crate::collection::{CollectError, RegionAt, Residency, Search};
pub use crate::tuning::service::MAX_JOBS;
use crate::tuning::service::{
    MANY_CREDIT, MAX_CONTACTS, MAX_FORMER, MAX_HELD, MAX_MEASURED, MAX_MEASURED_US, MEASURED_BATCH,
    MEASURED_CREDIT, MEASURED_US, MIN_TOUR_CREDIT, TOUR_SHARE,
};
use mutants::{Mutant, is};
use protocol::{ChunkKind, ContactReport, MAX_CREDIT_CHUNKS, MeasuredError, RegionAsk, Request};
use spm::SpmFile;
use std::collections::VecDeque;

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
    /// Incarnations before, the last ones: their late requests must not undo the new one's.
    former: VecDeque<u64>,
    pub epoch: u32,
    broken: bool,
    /// Whether the client is still to be told so.
    tells_broken: bool,
    /// Number of the next request.
    next: u64,
    /// Chunks of the epoch handed out.
    pub sent: u64,
    /// Chunks of the epoch acknowledged.
    consumed: u64,
    /// Chunks that may be under way.
    credit: u64,
    /// Whether the next chunk has waited for credit.
    pub waits_for_credit: bool,
    /// The station's clock at the last chunk, or at the first question that waits since, if later.
    pub silent_since_us: u32,
    /// When it was last heard, in messages.
    pub last_heard: u64,
    pub jobs: VecDeque<Job>,
    /// Changes of the residency that come before them.
    pub residency_changes: VecDeque<ResidencyChange>,
    /// The search that was under way when an epoch ended, and its model: the next epoch asks again.
    kept: Option<(usize, Search)>,
    /// Tours asked for: rolled while nothing else is to be answered.
    pub tours: VecDeque<PathGenerator>,
    /// The tour rolled last, whole or in part: whoever lost its chunks asks for it again.
    pub rolled: Option<PathGenerator>,
    /// What of the object's model the client is believed to hold.
    pub residency: Residency,
    /// Contacts that are to be measured, and where they ended.
    pub contacts: VecDeque<ContactReport>,
    measured: VecDeque<MeasuredError>,
    /// The station's clock when the first of them was measured: ticks are as long as the client's
    /// loop makes them.
    measured_since_us: u32,
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
            former: VecDeque::new(),
            epoch: request.epoch,
            broken: false,
            tells_broken: false,
            next: 0,
            sent: 0,
            consumed: 0,
            credit: 0,
            waits_for_credit: false,
            silent_since_us: 0,
            last_heard: 0,
            jobs: VecDeque::new(),
            residency_changes: VecDeque::new(),
            kept: None,
            contacts: VecDeque::new(),
            tours: VecDeque::new(),
            rolled: None,
            residency: Residency::default(),
            measured: VecDeque::new(),
            measured_since_us: 0,
            measured_probe: 0,
            flush: false,
        }
    }

    /// Checks the place of a request in the conversation and takes its acknowledgement.
    pub fn accept(&mut self, request: &Request, heard: u64) -> Accepted {
        if request.incarnation != self.incarnation {
            if self.former.contains(&request.incarnation) {
                return Accepted::Stale;
            }
            if self.former.len() == MAX_FORMER {
                self.former.pop_front();
            }
            self.former.push_back(self.incarnation);
            self.incarnation = request.incarnation;
            self.start_epoch(request.epoch);
        } else if request.epoch > self.epoch {
            self.start_epoch(request.epoch);
        } else if request.epoch < self.epoch {
            return Accepted::Stale;
        }
        self.last_heard = heard;
        if request.sequence < self.next {
            return Accepted::Stale;
        }
        self.credit = u64::from(request.credit).min(MAX_CREDIT_CHUNKS);
        let is_damaged = request.consumed > self.sent;
        if !is_damaged {
            self.consumed = self.consumed.max(request.consumed);
        }
        if self.broken {
            return Accepted::Stale;
        }
        if request.sequence > self.next && !is(Mutant::LostRequest) {
            self.break_epoch();
            return Accepted::Broken;
        }
        if is_damaged {
            self.break_epoch();
            return Accepted::Damaged;
        }
        self.next += 1;
        Accepted::Yes
    }

    fn start_epoch(&mut self, epoch: u32) {
        self.epoch = epoch;
        self.break_epoch();
        self.broken = false;
        self.tells_broken = false;
        self.next = 0;
        self.sent = 0;
        self.consumed = 0;
        self.waits_for_credit = false;
    }

    /// Clears queue and belief, tells the client, and waits for its next epoch. Of a tour what is
    /// rolled is kept, of an answer the search: else a closure that takes longer than a client's
    /// patience would never be found.
    pub fn break_epoch(&mut self) {
        self.tells_broken |= !self.broken;
        self.broken = true;
        if let Some(Job::Region {
            model,
            answer: Some(answer),
            ..
        }) = self.jobs.pop_front()
        {
            let search = answer.into_search().map(|search| (model, search));
            self.kept = search.or(self.kept.take());
        }
        self.jobs.clear();
        self.residency_changes.clear();
        self.contacts.clear();
        self.rolled = self.tours.pop_front().or(self.rolled.take());
        self.tours.clear();
        self.residency = Residency::default();
        self.measured.clear();
        self.flush = false;
    }

    /// Whether more is asked for than may wait.
    pub fn asks_too_much(&self) -> bool {
        self.jobs.len() + self.tours.len() > MAX_JOBS
            || self.residency_changes.len() > MAX_HELD
            || self.residency.regions() > MAX_HELD
    }

    /// Begins the answer for a region, where a search for it was broken off from there.
    ///
    /// # Errors
    /// As those of [`Search::new`].
    pub fn begin_answer<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
        model: usize,
        region: RegionAt,
    ) -> Result<Answer, CollectError> {
        let is_kept = |(of, search): &mut (usize, Search)| *of == model && search.asked() == region;
        let search = match self.kept.take_if(is_kept) {
            Some((_, search)) => search,
            None => Search::new(file, region)?,
        };
        Ok(Answer::new(search))
    }

    /// Whether something is to be answered.
    pub fn is_asked(&self) -> bool {
        !self.jobs.is_empty() || !self.tours.is_empty()
    }

    /// For how long its client has heard nothing although it waits, microseconds.
    pub fn silence_us(&self, clock_us: u32) -> u32 {
        clock_us.wrapping_sub(self.silent_since_us)
    }

    /// Whether it may send a chunk now. Notes when it could but for the credit.
    pub fn may_send(&mut self) -> bool {
        let has_credit = self.has_credit();
        self.waits_for_credit |= !has_credit && self.is_asked();
        has_credit && !self.broken
    }

    /// Whether the client is to be told now that the epoch is broken: once an epoch.
    pub fn take_broken(&mut self) -> bool {
        self.has_credit() && std::mem::take(&mut self.tells_broken)
    }

    fn has_credit(&self) -> bool {
        self.sent - self.consumed < self.credit
    }

    /// The tour asked for first, where a chunk of it may be sent.
    pub fn next_tour(&mut self) -> Option<PathGenerator> {
        let most = if self.credit >= MANY_CREDIT {
            self.credit
        } else {
            self.credit.div_ceil(TOUR_SHARE).max(MIN_TOUR_CREDIT)
        };
        let has_room = self.sent - self.consumed < most;
        if has_room {
            self.tours.pop_front()
        } else {
            None
        }
    }

    /// Queues the question for a region, unless it waits already. `whole`: with every record.
    ///
    /// What waits or is under way comes whole, or a gap ends the epoch: so it is given anew only to
    /// who has no use for it, and with every record. What was searched for it is not searched
    /// again.
    pub fn subscribe(&mut self, model: usize, ask: RegionAsk, whole: bool) {
        let waiting = self.jobs.iter_mut().find(|j| j.is_of(region_at(&ask)));
        if let Some(Job::Region {
            answer,
            whole: waiting_whole,
            ..
        }) = waiting
        {
            if whole {
                *waiting_whole = true;
                answer.iter_mut().for_each(|answer| answer.again());
            }
            return;
        }
        self.jobs.push_back(Job::Region {
            model,
            ask,
            whole,
            answer: None,
        });
    }

    /// Gives up a region, whether it is held, asked for, or answered in part.
    pub fn release(&mut self, model: usize, region: RegionAt) {
        let place = self.jobs.iter().position(|job| job.is_of(region));
        let job = place.and_then(|place| self.jobs.remove(place));
        if let Some(Job::Region {
            answer: Some(answer),
            ..
        }) = job
            && let Some(taken_in) = answer.taken_in()
        {
            // What it took in is known, and no more than that.
            self.residency.release(region);
            self.residency_changes
                .push_back(ResidencyChange::Forget(taken_in));
            return;
        }
        self.residency_changes.push_back(ResidencyChange::Released {
            model,
            region,
            change: None,
        });
    }

    /// Notes a contact that is to be measured, or that one ended.
    pub fn push_contact(&mut self, report: &ContactReport) {
        if self.broken {
            return;
        }
        if self.contacts.len() == MAX_CONTACTS {
            self.contacts.pop_front();
        }
        self.contacts.push_back(*report);
    }

    /// Keeps an error that was measured at this time of the station's clock.
    pub fn push_measured(&mut self, probe: u32, error: MeasuredError, clock_us: u32) {
        if self.broken {
            return;
        }
        if self.measured.is_empty() {
            self.measured_since_us = clock_us;
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

    /// The waiting measured errors, when they are enough, or old enough at this time of the
    /// station's clock, whether others followed or the probe went elsewhere.
    pub fn measured_chunk(&mut self, clock_us: u32) -> Option<Chunk> {
        if self.measured.is_empty() {
            return None;
        }
        let time_us = clock_us.wrapping_sub(self.measured_since_us);
        // Where few chunks may be under way, few are spent on this: answers wait behind them.
        let (most, longest_us) = if self.credit >= MEASURED_CREDIT {
            (MEASURED_BATCH, MEASURED_US)
        } else {
            (MAX_MEASURED, MAX_MEASURED_US)
        };
        let due = self.flush || self.measured.len() >= most || time_us >= longest_us;
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
