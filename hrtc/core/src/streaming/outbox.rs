//! Requests of a tick, shared out among the sessions.

use crate::tuning::streaming::REQUESTS_PER_TICK;
use protocol::Request;

/// Requests of one tick; storage made once.
///
/// The sessions of a tick may make so many in all, in their order. One of them is kept for the
/// session whose turn it is, so that none starves behind those before it.
#[derive(Debug, Clone)]
pub struct Outbox {
    requests: Vec<Request>,
    /// Requests that there may be when the sessions of the tick are through.
    most: usize,
    /// Requests that there may be when the present session is through.
    limit: usize,
    /// Predicted regions that were looked at for them.
    looked_at: u32,
}

impl Outbox {
    /// Empty, with room for the requests of so many sessions in a tick.
    #[must_use]
    pub fn new(sessions: usize) -> Self {
        let room = REQUESTS_PER_TICK * sessions;
        Self {
            requests: Vec::with_capacity(room),
            most: room,
            limit: 0,
            looked_at: 0,
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
        self.looked_at = 0;
        self.most = self.requests.capacity();
    }

    /// The sessions may make so many requests from now on, at least one, until the outbox is
    /// emptied.
    pub fn share_out(&mut self, requests: usize) {
        let most = self.requests.len().saturating_add(requests.max(1));
        self.most = most.min(self.requests.capacity());
    }

    /// The turn of a session begins; so many requests are kept for others.
    pub fn begin_session(&mut self, kept: usize) {
        let own = self.requests.len() + REQUESTS_PER_TICK;
        self.limit = own.min(self.most.saturating_sub(kept));
    }

    /// Whether the present session may make another request.
    #[must_use]
    pub fn has_room(&self) -> bool {
        self.requests.len() < self.limit
    }

    /// Predicted regions that the sessions looked at since it was emptied, asked for or not.
    #[must_use]
    pub fn looked_at(&self) -> u32 {
        self.looked_at
    }

    /// So many more were looked at.
    pub fn has_looked_at(&mut self, regions: u32) {
        self.looked_at += regions;
    }

    /// Adds a request of the present session.
    pub fn push(&mut self, request: Request) {
        debug_assert!(self.requests.len() < self.requests.capacity());
        self.requests.push(request);
    }
}

/// The one of so many sessions whose turn it is in a tick; `None` without any. The turns have no
/// fixed order: predictions come in rounds of some ticks, and an order could give one session the
/// same part of every round. Multiples of the golden ratio fall into every part of a range equally
/// often (Fibonacci hashing).
#[must_use]
pub(crate) fn turn_of(tick: u64, sessions: usize) -> Option<u64> {
    (tick.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32).checked_rem(sessions as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn no_more_requests_are_made_than_there_is_time_for_and_none_starves(
            sessions in 1usize..20, allowed in 0usize..12, closed in 0usize..4,
        ) {
            let mut outbox = Outbox::new(2 * sessions.max(closed));
            for turn in 0..sessions {
                outbox.clear();
                outbox.begin_session(0);
                for _ in 0..closed {
                    outbox.push(Request::zeroed());
                }
                outbox.share_out(allowed);
                for session in 0..sessions {
                    outbox.begin_session(usize::from(session < turn));
                    let before = outbox.requests().len();
                    while outbox.has_room() {
                        outbox.push(Request::zeroed());
                    }
                    let made = outbox.requests().len() - before;
                    prop_assert!(made <= REQUESTS_PER_TICK);
                    prop_assert!(session != turn || made > 0, "it is its turn");
                }
                let made = outbox.requests().len() - closed;
                prop_assert_eq!(made, allowed.max(1).min(REQUESTS_PER_TICK * sessions));
            }
        }
    }

    #[test]
    fn each_session_has_its_turn_in_every_part_of_every_round() {
        for (sessions, round) in (1..9).flat_map(|k| (1..40).map(move |round| (k, round))) {
            for phase in 0..round {
                let mut turns = vec![0; sessions];
                for k in 0..100 * sessions as u64 {
                    let turn = turn_of(k * round + phase, sessions);
                    turns[turn.unwrap_or(0) as usize] += 1;
                }
                // Of 100 each: 47 at the least.
                assert!(turns.iter().all(|&of| of > 40), "{round}: {turns:?}");
            }
        }
        assert_eq!(turn_of(3, 0), None);
    }
}
