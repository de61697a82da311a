//! What a link did to messages, by their kinds.

/// Kinds of messages, in the order of [`LinkCounts`].
pub const MESSAGES: [&str; 13] = [
    "credit",
    "ask for a model",
    "ask for regions",
    "ask for a tour",
    "close",
    "ask for quarters",
    "contact report",
    "model",
    "answers",
    "measured errors",
    "tour",
    "refusal",
    "quarters",
];

/// What a link did to the messages of each kind of [`MESSAGES`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LinkCounts {
    /// Sent.
    pub sent: [u64; MESSAGES.len()],
    /// Lost on the way, by a link that was cut, or by a station that was silent or ended.
    pub lost: [u64; MESSAGES.len()],
    /// Of them on the way, by chance.
    pub lost_by_chance: [u64; MESSAGES.len()],
    /// Sent twice.
    pub doubled: [u64; MESSAGES.len()],
    /// Overtook the one before it.
    pub overtook: [u64; MESSAGES.len()],
    /// Damaged.
    pub damaged: [u64; MESSAGES.len()],
}

impl LinkCounts {
    /// Adds the counts of another link.
    pub fn add(&mut self, other: &Self) {
        let pairs = [
            (&mut self.sent, &other.sent),
            (&mut self.lost, &other.lost),
            (&mut self.lost_by_chance, &other.lost_by_chance),
            (&mut self.doubled, &other.doubled),
            (&mut self.overtook, &other.overtook),
            (&mut self.damaged, &other.damaged),
        ];
        for (sums, counts) in pairs {
            for (sum, count) in sums.iter_mut().zip(counts) {
                *sum += count;
            }
        }
    }
}
