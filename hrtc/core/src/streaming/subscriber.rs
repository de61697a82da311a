//! The mesh subscriber: requests out, chunks in, epochs and credit (see `shared::protocol`).

use crate::cache::{Cache, RegionKey, RegionState};
use protocol::{
    CREDIT_CHUNKS, ChunkHeader, REGIONS_PER_REQUEST, RegionAction, RegionAsk, Request, RequestKind,
    TourAsk,
};
use spm::NONE;

/// Answers that may be outstanding: no more than the credit lets come before the next word from here, so that
/// what is asked for next is still what is needed most.
const OUTSTANDING: u32 = CREDIT_CHUNKS as u32;
/// Share of the credit that is consumed before the station is told without another reason.
const CREDIT_STEP: u64 = 4;
/// Releases that may wait for the next request: half of what it holds.
const MAX_RELEASES: usize = REGIONS_PER_REQUEST / 2;
/// Ticks for which a refused region is not asked for again ...
const REFUSED_TICKS: u64 = 2000;
/// ... and places of the region table a tick that are looked at for one.
const REFUSED_WINDOW: usize = 4;
/// Requests of a session in a tick at the most.
pub const REQUESTS_PER_TICK: usize = 4;

/// Who this client is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Identity {
    /// The client.
    pub client: u64,
    /// Its incarnation: another one after every restart.
    pub incarnation: u64,
}

/// What a conversation with the station is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Session {
    /// Object of the scene.
    pub object: u32,
    /// Hash of the model's name in the scene.
    pub name: u64,
}

/// What a received chunk is to this epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reception {
    /// The next one: to be consumed.
    Next,
    /// Of another client, station or epoch, or a repetition: to be dropped.
    Stale,
    /// Chunks before it are missing.
    Gap,
}

/// Requests of one tick; storage made once.
#[derive(Debug, Clone)]
pub struct Outbox {
    requests: Vec<Request>,
    /// Requests that there may be when the present session has had its share.
    most: usize,
}

impl Outbox {
    /// Empty, with room for the requests of so many sessions in a tick.
    #[must_use]
    pub fn new(sessions: usize) -> Self {
        Self {
            requests: Vec::with_capacity(REQUESTS_PER_TICK * sessions),
            most: 0,
        }
    }

    /// The requests.
    #[must_use]
    pub fn requests(&self) -> &[Request] {
        &self.requests
    }

    /// Empties it for the next tick.
    pub fn clear(&mut self) {
        self.requests.clear();
        self.most = 0;
    }

    /// Another session has the word: it may make [`REQUESTS_PER_TICK`] requests.
    pub fn next_session(&mut self) {
        let most = self.requests.len() + REQUESTS_PER_TICK;
        self.most = most.min(self.requests.capacity());
    }

    fn has_room(&self) -> bool {
        self.requests.len() < self.most
    }

    fn push(&mut self, request: Request) {
        debug_assert!(self.requests.len() < self.requests.capacity());
        self.requests.push(request);
    }
}

/// The subscriber's state.
#[derive(Debug, Clone)]
pub struct Subscriber {
    identity: Identity,
    session: Session,
    /// Chunks that may be under way.
    credit: u64,
    station: u64,
    epoch: u32,
    sent: u64,
    next_chunk: u64,
    consumed: u64,
    consumed_told: u64,
    model: u64,
    model_asked: bool,
    tour: Option<TourAsk>,
    tour_asked: bool,
    /// Place in the region table up to which held regions were declared in this epoch.
    declared: usize,
    outstanding: u32,
    outstanding_high_water: u32,
    last_progress: u64,
    timeout_ticks: u64,
    /// Places in the region table of regions to be released.
    releases: [u32; MAX_RELEASES],
    release_count: usize,
    releases_high_water: usize,
    /// Places in the region table of regions to be asked for again.
    resends: [u32; OUTSTANDING as usize],
    resend_count: usize,
    /// Where in the region table the search for refused regions goes on.
    refused_hand: usize,
    /// Regions asked for so far.
    pub subscribed: u64,
    /// Regions asked for again, with every record, because their answer counted on records that were gone.
    pub resent: u64,
    /// Epochs ended by a gap, a timeout or another station, while something was outstanding or held.
    pub resubscribed: u64,
}

impl Subscriber {
    /// A subscriber that has not met a station and has no object yet. `timeout_ticks`: silence after which it asks
    /// again.
    #[must_use]
    pub fn new(identity: Identity, timeout_ticks: u64) -> Self {
        Self {
            identity,
            session: Session {
                object: NONE,
                name: 0,
            },
            credit: CREDIT_CHUNKS,
            station: 0,
            epoch: 0,
            sent: 0,
            next_chunk: 0,
            consumed: 0,
            consumed_told: 0,
            model: 0,
            model_asked: false,
            tour: None,
            tour_asked: false,
            declared: 0,
            outstanding: 0,
            outstanding_high_water: 0,
            last_progress: 0,
            timeout_ticks,
            releases: [0; MAX_RELEASES],
            release_count: 0,
            releases_high_water: 0,
            resends: [0; OUTSTANDING as usize],
            resend_count: 0,
            refused_hand: 0,
            subscribed: 0,
            resent: 0,
            resubscribed: 0,
        }
    }

    /// Begins a session about an object, in an epoch that no session about it has had; its totals go on.
    pub fn begin_session(&mut self, session: Session, epoch: u32, tick: u64) {
        self.session = session;
        self.epoch = epoch;
        self.model = 0;
        self.tour = None;
        self.start(tick);
    }

    /// Tells the station that the session ends, as far as that is heard; the epoch that it ends in.
    pub fn close(&mut self, outbox: &mut Outbox, tick: u64) -> u32 {
        outbox.next_session();
        if self.sent > 0 && outbox.has_room() {
            let request = self.request(RequestKind::Close);
            self.send(outbox, request, tick, false);
        }
        self.epoch
    }

    /// Sets how many chunks may be under way from now on; at least one.
    pub fn set_credit(&mut self, chunks: u64) {
        self.credit = chunks.clamp(1, CREDIT_CHUNKS);
    }

    /// Takes what the heartbeat says; a new incarnation ends the epoch.
    ///
    /// Returns whether the epoch ended.
    pub fn observe(&mut self, station: u64, tick: u64, cache: &mut Cache) -> bool {
        let waiting = self.outstanding > 0
            || (self.model_asked && self.model == 0)
            || (self.tour_asked && self.tour.is_some());
        let silent = waiting && tick.saturating_sub(self.last_progress) > self.timeout_ticks;
        let another = station != 0 && station != self.station;
        if another {
            self.station = station;
        }
        if another || (silent && station != 0) {
            self.end_epoch(tick, cache);
            return true;
        }
        false
    }

    /// Ends the epoch: forgets what is under way, and declares and asks anew.
    pub fn end_epoch(&mut self, tick: u64, cache: &mut Cache) {
        if self.sent > 0 {
            self.resubscribed += 1;
        }
        self.epoch = self.epoch.wrapping_add(1);
        self.start(tick);
        for place in 0..cache.regions.capacity() {
            match cache.regions.get(place).map(|region| region.state) {
                Some(RegionState::Asked | RegionState::ToAskAgain) => {
                    cache.let_go(place, u32::MAX);
                    cache.regions.remove(place);
                }
                // A station that starts the epoch anew does not believe in it any more.
                Some(RegionState::ToRelease) => cache.regions.remove(place),
                _ => {}
            }
        }
    }

    /// Everything of an epoch as it is at its start.
    fn start(&mut self, tick: u64) {
        self.sent = 0;
        self.next_chunk = 0;
        self.consumed = 0;
        self.consumed_told = 0;
        self.model_asked = false;
        self.tour_asked = false;
        self.declared = 0;
        self.outstanding = 0;
        self.release_count = 0;
        self.resend_count = 0;
        self.last_progress = tick;
    }

    /// What a chunk is to this epoch; a next one is to be consumed with [`Subscriber::consumed`].
    #[must_use]
    pub fn receive(&self, header: &ChunkHeader) -> Reception {
        let ours = header.client == self.identity.client
            && header.object == self.session.object
            && header.station == self.station
            && header.epoch == self.epoch;
        if !ours || header.sequence < self.next_chunk {
            Reception::Stale
        } else if header.sequence > self.next_chunk {
            Reception::Gap
        } else {
            Reception::Next
        }
    }

    /// Counts the chunk that [`Subscriber::receive`] called the next one.
    pub fn consumed(&mut self, tick: u64) {
        self.next_chunk += 1;
        self.consumed += 1;
        self.last_progress = tick;
    }

    /// The model has arrived.
    pub fn model_is(&mut self, model: u64) {
        self.model = model;
    }

    /// Asks for a tour as soon as possible, and again after every loss until [`Subscriber::tour_is_here`].
    pub fn ask_tour(&mut self, tour: TourAsk) {
        self.tour = Some(tour);
        self.tour_asked = false;
    }

    /// The tour is complete.
    pub fn tour_is_here(&mut self) {
        self.tour = None;
    }

    /// An asked region was answered, refused or given up.
    pub fn answered(&mut self) {
        self.outstanding = self.outstanding.saturating_sub(1);
    }

    /// The asked region at a place of the table is to be asked for again, with every record. It stays
    /// outstanding, so there is room for it.
    pub fn ask_again(&mut self, place: usize) {
        if self.resend_count < self.resends.len() {
            self.resends[self.resend_count] = place as u32;
            self.resend_count += 1;
        }
    }

    /// Whether another release can be told.
    #[must_use]
    pub fn may_release(&self) -> bool {
        self.release_count < MAX_RELEASES
    }

    /// The region at a place of the table is now to be released; the caller has asked whether it may be.
    pub fn release(&mut self, place: usize) {
        self.releases[self.release_count] = place as u32;
        self.release_count += 1;
        self.releases_high_water = self.releases_high_water.max(self.release_count);
    }

    /// The most answers outstanding, and releases that waited to be told, at once; and how many there may be.
    #[must_use]
    pub fn high_water(&self) -> [(usize, usize); 2] {
        [
            (self.outstanding_high_water as usize, OUTSTANDING as usize),
            (self.releases_high_water, MAX_RELEASES),
        ]
    }

    /// Whether regions may be asked for.
    #[must_use]
    pub fn may_ask(&self, cache: &Cache) -> bool {
        self.station != 0
            && self.model != 0
            && self.outstanding < OUTSTANDING
            && self.declared >= cache.regions.capacity()
    }

    fn request(&self, kind: RequestKind) -> Request {
        let mut request: Request = bytemuck::Zeroable::zeroed();
        request.client = self.identity.client;
        request.incarnation = self.identity.incarnation;
        request.sequence = self.sent;
        request.consumed = self.consumed;
        request.model = self.model;
        request.name = self.session.name;
        request.epoch = self.epoch;
        request.kind = kind as u32;
        request.object = self.session.object;
        request.credit = self.credit as u32;
        request
    }

    fn send(&mut self, outbox: &mut Outbox, request: Request, tick: u64, expects: bool) {
        if expects && self.outstanding == 0 {
            self.last_progress = self.last_progress.max(tick);
        }
        self.sent += 1;
        self.consumed_told = self.consumed;
        outbox.push(request);
    }

    /// Writes this tick's requests: model, tour, held regions, releases, then `wanted` in its order.
    pub fn requests(
        &mut self,
        tick: u64,
        cache: &mut Cache,
        wanted: impl Iterator<Item = (RegionKey, u64)>,
        outbox: &mut Outbox,
    ) {
        outbox.next_session();
        if self.station == 0 {
            return;
        }
        if self.model == 0 {
            if !self.model_asked {
                self.model_asked = true;
                let request = self.request(RequestKind::Model);
                self.send(outbox, request, tick, true);
            }
        } else {
            if let (Some(tour), false) = (self.tour, self.tour_asked) {
                self.tour_asked = true;
                let mut request = self.request(RequestKind::Tour);
                request.tour = tour;
                self.send(outbox, request, tick, true);
            }
            self.declare(tick, cache, outbox);
            self.ask(tick, cache, wanted, outbox);
        }
        let step = (self.credit / CREDIT_STEP).max(1);
        if self.consumed - self.consumed_told >= step && outbox.has_room() {
            let request = self.request(RequestKind::Credit);
            self.send(outbox, request, tick, false);
        }
    }

    /// Tells a new epoch which regions are held.
    fn declare(&mut self, tick: u64, cache: &Cache, outbox: &mut Outbox) {
        while self.declared < cache.regions.capacity() && outbox.has_room() {
            let mut request = self.request(RequestKind::Regions);
            while self.declared < cache.regions.capacity()
                && (request.count as usize) < REGIONS_PER_REQUEST
            {
                if let Some(region) = cache.regions.get(self.declared)
                    && region.state == RegionState::Held
                {
                    push(&mut request, region.key, RegionAction::Held);
                }
                self.declared += 1;
            }
            if request.count == 0 {
                return;
            }
            self.send(outbox, request, tick, false);
        }
    }

    fn ask(
        &mut self,
        tick: u64,
        cache: &mut Cache,
        mut wanted: impl Iterator<Item = (RegionKey, u64)>,
        outbox: &mut Outbox,
    ) {
        if self.declared < cache.regions.capacity() || !outbox.has_room() {
            return;
        }
        let mut request = self.request(RequestKind::Regions);
        for &place in &self.releases[..self.release_count] {
            let place = place as usize;
            push(
                &mut request,
                cache.regions.at(place).key,
                RegionAction::Release,
            );
            cache.regions.remove(place);
        }
        self.release_count = 0;
        let again = self.resend(cache, &mut request);
        self.forgive(tick, cache);
        let mut asked = 0;
        while (request.count as usize) < REGIONS_PER_REQUEST
            && self.outstanding + asked < OUTSTANDING
        {
            let Some((key, due)) = wanted.next() else {
                break;
            };
            if cache.regions.index(key).is_some() {
                continue;
            }
            let Some(index) = cache.regions.add(key) else {
                break;
            };
            cache.regions.touch(index, tick);
            let region = cache.regions.at_mut(index);
            region.state = RegionState::Asked;
            region.due = due;
            push(&mut request, key, RegionAction::Subscribe);
            asked += 1;
        }
        if request.count > 0 {
            self.send(outbox, request, tick, asked + again > 0);
            self.outstanding += asked;
            self.outstanding_high_water = self.outstanding_high_water.max(self.outstanding);
            self.subscribed += u64::from(asked);
        }
    }

    /// Asks again, with every record, for regions whose answer was of no use; they are outstanding still. Their
    /// number.
    fn resend(&mut self, cache: &mut Cache, request: &mut Request) -> u32 {
        let mut again = 0;
        while (request.count as usize) < REGIONS_PER_REQUEST && self.resend_count > 0 {
            self.resend_count -= 1;
            let place = self.resends[self.resend_count] as usize;
            let region = cache.regions.at_mut(place);
            region.state = RegionState::Asked;
            push(request, region.key, RegionAction::Resend);
            again += 1;
        }
        self.resent += u64::from(again);
        again
    }

    /// Forgets that a region was refused long ago, so that it may be asked for again.
    fn forgive(&mut self, tick: u64, cache: &mut Cache) {
        let capacity = cache.regions.capacity();
        for _ in 0..REFUSED_WINDOW.min(capacity) {
            let place = self.refused_hand;
            self.refused_hand = (place + 1) % capacity;
            let old = cache.regions.get(place).is_some_and(|region| {
                region.state == RegionState::Refused && tick > region.refused_at + REFUSED_TICKS
            });
            if old {
                cache.regions.remove(place);
                break;
            }
        }
    }
}

fn push(request: &mut Request, region: RegionKey, action: RegionAction) {
    request.regions[request.count as usize] = RegionAsk {
        region: region.id.0,
        tolerance_bits: region.tolerance_bits,
        action: action as u32,
    };
    request.count += 1;
}
