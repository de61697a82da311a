//! Requests of a tick, shared out among the sessions.

use crate::tuning::streaming::REQUESTS_PER_TICK;
use protocol::Request;

/// Requests of one tick; storage made once.
#[derive(Debug, Clone)]
pub struct Outbox {
    requests: Vec<Request>,
    /// Requests that there may be when the present session has used its quota.
    limit: usize,
}

impl Outbox {
    /// Empty, with room for the requests of so many sessions in a tick.
    #[must_use]
    pub fn new(sessions: usize) -> Self {
        Self {
            requests: Vec::with_capacity(REQUESTS_PER_TICK * sessions),
            limit: 0,
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
    }

    /// The quota of another session begins: `REQUESTS_PER_TICK` requests.
    pub fn begin_quota(&mut self) {
        let limit = self.requests.len() + REQUESTS_PER_TICK;
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
