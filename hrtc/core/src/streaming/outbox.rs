//! Requests of a tick, shared out among the sessions.

use crate::tuning::streaming::REQUESTS_PER_TICK;
use protocol::Request;

/// Requests of one tick; storage made once.
#[derive(Debug, Clone)]
pub struct Outbox {
    requests: Vec<Request>,
    /// Requests that there may be when the present session has used its quota.
    limit: usize,
    /// Requests that each session may make.
    quota: usize,
}

impl Outbox {
    /// Empty, with room for the requests of so many sessions in a tick.
    #[must_use]
    pub fn new(sessions: usize) -> Self {
        Self {
            requests: Vec::with_capacity(REQUESTS_PER_TICK * sessions),
            limit: 0,
            quota: REQUESTS_PER_TICK,
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
        self.limit = 0;
        self.quota = REQUESTS_PER_TICK;
    }

    /// Each session may make so many requests from now on, at least one and at most
    /// `REQUESTS_PER_TICK`, until the outbox is emptied.
    pub fn set_quota(&mut self, requests: usize) {
        self.quota = requests.clamp(1, REQUESTS_PER_TICK);
    }

    /// The quota of another session begins.
    pub fn begin_quota(&mut self) {
        let limit = self.requests.len() + self.quota;
        self.limit = limit.min(self.requests.capacity());
    }

    /// Whether the present session may make another request.
    #[must_use]
    pub fn has_room(&self) -> bool {
        self.requests.len() < self.limit
    }

    /// Adds a request of the present session.
    pub fn push(&mut self, request: Request) {
        debug_assert!(self.requests.len() < self.requests.capacity());
        self.requests.push(request);
    }
}
