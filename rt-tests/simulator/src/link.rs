//! The link between a client and the station.

use crate::messages::LinkCounts;
use crate::random::Random;
use hrtc_core::streaming::chunk::InboxChunk;
use protocol::{
    CHUNK_SLOTS, ChunkDecoder, ChunkEncoder, ChunkHeader, ChunkKind, ChunkSlot, CompactError,
    ContactReport, Request, RequestKind,
};
use spm::Sizes;
use std::collections::VecDeque;
use std::fmt;

/// Properties of a link, the same in both directions. The default delays by 2 ticks, has no
/// faults and no limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkModel {
    /// Ticks from the sender to the receiver.
    pub delay_ticks: u64,
    /// Largest further delay, ticks; uniform from 0. The order of the messages stays.
    pub jitter_ticks: u64,
    /// Probability that a message is lost.
    pub loss: f64,
    /// Probability that a message arrives twice.
    pub duplicates: f64,
    /// Probability that a message overtakes the one before it.
    pub reordering: f64,
    /// Probability that a bit of a chunk's slots is flipped. Requests and reports stay whole.
    pub damage: f64,
    /// Throughput of each direction, bytes a tick; infinite for no limit.
    pub bytes_per_tick: f64,
    /// Messages that wait for the wire travel together, up to so many bytes, and arrive at once, as
    /// through a tunnel; 0 where each travels alone.
    pub batch_bytes: usize,
    /// Whether chunks travel compact, as to another machine.
    pub is_compact: bool,
}

impl Default for LinkModel {
    fn default() -> Self {
        Self {
            delay_ticks: 2,
            jitter_ticks: 0,
            loss: 0.0,
            duplicates: 0.0,
            reordering: 0.0,
            damage: 0.0,
            bytes_per_tick: f64::INFINITY,
            batch_bytes: 0,
            is_compact: false,
        }
    }
}

impl LinkModel {
    /// This link of 1 kHz for a loop of another rate: its times, to the nearest tick, and its
    /// throughput are the same in seconds. A delay stays one of a tick at least.
    #[must_use]
    pub fn at_rate(self, rate_hz: f64) -> Self {
        let ticks = |of: u64| ((of as f64 * rate_hz / 1e3).round() as u64).max(of.min(1));
        Self {
            delay_ticks: ticks(self.delay_ticks),
            jitter_ticks: ticks(self.jitter_ticks),
            bytes_per_tick: self.bytes_per_tick * 1e3 / rate_hz,
            ..self
        }
    }
}

/// A message of a client to the station.
#[derive(Debug, Clone, Copy)]
#[expect(clippy::large_enum_variant, reason = "most messages are requests")]
pub(crate) enum Upward {
    Request(Request),
    Report(ContactReport),
}

/// A message as the link sees it.
pub(crate) trait Payload: Copy {
    /// Its size.
    fn bytes(&self) -> usize;
    /// Its index in [`MESSAGES`](crate::MESSAGES).
    fn kind(&self) -> usize;
    /// Flips a random bit, where a link may damage such a message; whether it did.
    fn flip_bit(&mut self, random: &mut Random) -> bool;
}

impl Payload for Upward {
    fn bytes(&self) -> usize {
        match self {
            Self::Request(request) => size_of_val(request.words()),
            Self::Report(_) => size_of::<ContactReport>(),
        }
    }

    fn kind(&self) -> usize {
        match self {
            Self::Request(request) => match RequestKind::from_code(request.kind) {
                Some(RequestKind::Model) => 1,
                Some(RequestKind::Regions) => 2,
                Some(RequestKind::Tour) => 3,
                Some(RequestKind::Close) => 4,
                Some(RequestKind::Quarters) => 5,
                Some(RequestKind::Credit | RequestKind::File) | None => 0,
            },
            Self::Report(_) => 6,
        }
    }

    fn flip_bit(&mut self, _: &mut Random) -> bool {
        false
    }
}

/// A chunk on its way to a client.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Downward {
    header: ChunkHeader,
    slots: [ChunkSlot; CHUNK_SLOTS],
    /// Slots that travel; fewer than all when it is compact.
    used: usize,
}

impl Payload for Downward {
    fn bytes(&self) -> usize {
        size_of::<ChunkHeader>() + self.used * size_of::<ChunkSlot>()
    }

    fn kind(&self) -> usize {
        match ChunkKind::from_code(self.header.kind) {
            Some(ChunkKind::Model) => 7,
            Some(ChunkKind::Answers | ChunkKind::File) | None => 8,
            Some(ChunkKind::Measured) => 9,
            Some(ChunkKind::Tour) => 10,
            Some(ChunkKind::Refused) => 11,
            Some(ChunkKind::Quarters) => 12,
        }
    }

    fn flip_bit(&mut self, random: &mut Random) -> bool {
        let slot = random.below(self.used as u64) as usize;
        let words = &mut self.slots[slot].words;
        let word = random.below(words.len() as u64) as usize;
        words[word] ^= 1 << random.below(32);
        true
    }
}

/// One direction: messages under way, in the order in which they arrive.
#[derive(Debug, Clone)]
pub(crate) struct DelayLine<T> {
    /// Tick of arrival and message; ticks ascend.
    under_way: VecDeque<(u64, T)>,
    /// Time at which all that was sent is on the wire, ticks.
    free_at: f64,
    /// The newest batch.
    batch: Batch,
    counts: LinkCounts,
}

/// Messages that travel together.
#[derive(Debug, Clone, Copy, Default)]
struct Batch {
    /// Time at which they go onto the wire, ticks.
    begins_at: f64,
    bytes: usize,
    /// How many are under way.
    messages: usize,
}

impl<T> Default for DelayLine<T> {
    fn default() -> Self {
        Self {
            under_way: VecDeque::new(),
            free_at: 0.0,
            batch: Batch::default(),
            counts: LinkCounts::default(),
        }
    }
}

impl<T: Payload> DelayLine<T> {
    /// Sends a message at a tick.
    pub fn send(&mut self, tick: u64, mut message: T, model: &LinkModel, random: &mut Random) {
        let start = self.free_at.max(tick as f64);
        self.free_at = start + message.bytes() as f64 / model.bytes_per_tick;
        let batch = &mut self.batch;
        let waits = batch.begins_at > tick as f64;
        if !waits || batch.bytes + message.bytes() > model.batch_bytes {
            *batch = Batch {
                begins_at: start,
                ..Batch::default()
            };
        }
        batch.bytes += message.bytes();
        let kind = message.kind();
        self.counts.sent[kind] += 1;
        if random.happens(model.loss) {
            self.counts.lost[kind] += 1;
            self.counts.lost_by_chance[kind] += 1;
            return;
        }
        if random.happens(model.damage) && message.flip_bit(random) {
            self.counts.damaged[kind] += 1;
        }
        let mut due = self.free_at.floor() as u64 + model.delay_ticks;
        if model.jitter_ticks > 0 {
            due += random.below(model.jitter_ticks + 1);
        }
        due = self.under_way.back().map_or(due, |last| due.max(last.0));
        let before = self.under_way.len() - self.batch.messages.min(self.under_way.len());
        for (of_batch, _) in self.under_way.iter_mut().skip(before) {
            *of_batch = due;
        }
        let copies = if random.happens(model.duplicates) {
            self.counts.doubled[kind] += 1;
            2
        } else {
            1
        };
        for _ in 0..copies {
            self.under_way.push_back((due, message));
        }
        self.batch.messages += copies;
        let last = self.under_way.len() - 1;
        if last > 0 && random.happens(model.reordering) {
            self.under_way.swap(last, last - 1);
            // One that was sent twice only changes places with its own copy.
            self.counts.overtook[kind] += u64::from(copies == 1);
            self.under_way[last - 1].0 = due;
            self.under_way[last].0 = due;
        }
    }

    /// The next message if it is due at a tick.
    pub fn receive(&mut self, tick: u64) -> Option<T> {
        let (due, _) = self.under_way.front()?;
        if *due > tick {
            return None;
        }
        self.under_way.pop_front().map(|(_, message)| message)
    }

    /// Loses the messages that are due at a tick.
    pub fn lose_due(&mut self, tick: u64) {
        while let Some(message) = self.receive(tick) {
            self.counts.lost[message.kind()] += 1;
        }
    }

    /// Loses everything under way.
    pub fn clear(&mut self) {
        for (_, message) in self.under_way.drain(..) {
            self.counts.lost[message.kind()] += 1;
        }
        self.free_at = 0.0;
        self.batch = Batch::default();
    }
}

/// Changes chunks on their way to a client.
type Tamper = Box<dyn FnMut(&mut InboxChunk)>;

/// Both directions between a client and the station.
pub struct Link {
    model: LinkModel,
    random: Random,
    /// Whether nothing crosses: the client does not see the station, and what is due is lost.
    is_cut: bool,
    tamper: Option<Tamper>,
    pub(crate) upward: DelayLine<Upward>,
    downward: DelayLine<Downward>,
    /// The station's end, for chunks that travel compact, and the client's.
    encoder: ChunkEncoder,
    decoder: ChunkDecoder,
    bytes_down: u64,
}

impl Link {
    /// A link with nothing under way; the seed decides on its faults.
    #[must_use]
    pub fn new(model: LinkModel, seed: u64) -> Self {
        Self {
            model,
            random: Random::new(seed),
            is_cut: false,
            tamper: None,
            upward: DelayLine::default(),
            downward: DelayLine::default(),
            encoder: ChunkEncoder::default(),
            decoder: ChunkDecoder::default(),
            bytes_down: 0,
        }
    }

    /// Its properties.
    #[must_use]
    pub fn model(&self) -> &LinkModel {
        &self.model
    }

    /// Changes its properties for messages sent from now on.
    pub fn set_model(&mut self, model: LinkModel) {
        self.model = model;
    }

    /// The same with a new seed.
    pub fn disturb(&mut self, model: LinkModel, seed: u64) {
        self.model = model;
        self.random = Random::new(seed);
    }

    /// Cuts it, or mends it.
    pub fn cut(&mut self, is_cut: bool) {
        self.is_cut = is_cut;
    }

    /// What it did to the messages of both directions so far.
    #[must_use]
    pub fn counts(&self) -> LinkCounts {
        let mut counts = self.upward.counts;
        counts.add(&self.downward.counts);
        counts
    }

    /// Whether nothing crosses.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        self.is_cut
    }

    /// Changes every chunk that the station sends from now on, before the link's own faults.
    pub fn tamper(&mut self, change: impl FnMut(&mut InboxChunk) + 'static) {
        self.tamper = Some(Box::new(change));
    }

    /// Ends [`Link::tamper`].
    pub fn stop_tampering(&mut self) {
        self.tamper = None;
    }

    /// Sends a message to the station.
    pub(crate) fn send_up(&mut self, tick: u64, message: Upward) {
        self.upward
            .send(tick, message, &self.model, &mut self.random);
    }

    /// Sends a chunk to the client; `sizes` are those of its model.
    pub(crate) fn send_down(&mut self, tick: u64, mut chunk: InboxChunk, sizes: Option<Sizes>) {
        if let Some(tamper) = &mut self.tamper {
            tamper(&mut chunk);
        }
        let InboxChunk { header, slots } = chunk;
        let mut sent = Downward {
            header,
            slots,
            used: CHUNK_SLOTS,
        };
        if self.model.is_compact
            && let Some(compact) = self.encoder.encode(&header, &slots, sizes)
        {
            sent.used = compact.len();
            sent.slots[..sent.used].copy_from_slice(&compact);
        }
        self.downward
            .send(tick, sent, &self.model, &mut self.random);
    }

    /// The next chunk if it is due at a tick.
    pub(crate) fn receive_down(&mut self, tick: u64) -> Option<InboxChunk> {
        while let Some(sent) = self.downward.receive(tick) {
            self.bytes_down += sent.bytes() as u64;
            let Downward {
                header,
                slots,
                used,
            } = sent;
            if !self.model.is_compact && used == CHUNK_SLOTS {
                return Some(InboxChunk { header, slots });
            }
            match self.decoder.decode(&header, &slots[..used]) {
                Ok(slots) => return Some(InboxChunk { header, slots }),
                Err(CompactError::Gap) => {
                    let (header, slots) = header.of_gap();
                    return Some(InboxChunk { header, slots });
                }
                Err(_) => {}
            }
        }
        None
    }

    /// Bytes of the chunks that came to the client, headers too.
    #[must_use]
    pub fn bytes_down(&self) -> u64 {
        self.bytes_down
    }

    /// Loses what is due, both ways.
    pub(crate) fn lose_due(&mut self, tick: u64) {
        self.upward.lose_due(tick);
        self.downward.lose_due(tick);
    }

    /// Loses everything under way, both ways.
    pub(crate) fn clear(&mut self) {
        self.upward.clear();
        self.downward.clear();
    }
}

impl fmt::Debug for Link {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Link")
            .field("model", &self.model)
            .field("random", &self.random)
            .field("is_cut", &self.is_cut)
            .field("is_tampered", &self.tamper.is_some())
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Payload for char {
        fn bytes(&self) -> usize {
            10
        }

        fn kind(&self) -> usize {
            0
        }

        fn flip_bit(&mut self, _: &mut Random) -> bool {
            *self = '!';
            true
        }
    }

    /// Sends letters, one a tick from tick 0 on, and gives what arrives with its ticks.
    fn received(letters: &str, model: LinkModel, seed: u64) -> Vec<(u64, char)> {
        let (mut line, mut random) = (DelayLine::default(), Random::new(seed));
        let mut letters = letters.chars();
        let mut arrived = Vec::new();
        for tick in 0..100 {
            while let Some(letter) = line.receive(tick) {
                arrived.push((tick, letter));
            }
            if let Some(letter) = letters.next() {
                line.send(tick, letter, &model, &mut random);
            }
        }
        arrived
    }

    fn letters(arrived: &[(u64, char)]) -> String {
        arrived.iter().map(|&(_, letter)| letter).collect()
    }

    #[test]
    fn messages_arrive_in_order_when_they_are_due() {
        let expected = [(2, 'a'), (3, 'b'), (4, 'c')];
        assert_eq!(received("abc", LinkModel::default(), 1), expected);
    }

    #[test]
    fn jitter_keeps_the_order() {
        let model = LinkModel {
            jitter_ticks: 5,
            ..LinkModel::default()
        };
        let arrived = received("abcdefghijklmnop", model, 1);
        assert_eq!(letters(&arrived), "abcdefghijklmnop");
        let late = |&(tick, letter): &(u64, char)| tick - (letter as u64 - u64::from(b'a'));
        assert!(arrived.iter().all(|of| (2..=7).contains(&late(of))));
        assert!(arrived.iter().any(|of| late(of) > 2));
    }

    #[test]
    fn each_fault_does_what_it_says() {
        let none = LinkModel::default();
        let lost = LinkModel { loss: 1.0, ..none };
        assert_eq!(received("abc", lost, 1), []);
        let twice = LinkModel {
            duplicates: 1.0,
            ..none
        };
        assert_eq!(letters(&received("abc", twice, 1)), "aabbcc");
        let damaged = LinkModel {
            damage: 1.0,
            ..none
        };
        assert_eq!(letters(&received("abc", damaged, 1)), "!!!");
        let mixed = LinkModel {
            reordering: 1.0,
            ..none
        };
        // The first message is overtaken by all others, and arrives with the last.
        assert_eq!(letters(&received("abc", mixed, 1)), "bca");
    }

    #[test]
    fn what_was_done_to_the_messages_is_counted() {
        let model = LinkModel {
            loss: 0.5,
            duplicates: 1.0,
            ..LinkModel::default()
        };
        let (mut line, mut random) = (DelayLine::default(), Random::new(1));
        for tick in 0..100 {
            line.send(tick, 'a', &model, &mut random);
        }
        let [sent, lost, doubled] = [
            line.counts.sent[0],
            line.counts.lost[0],
            line.counts.doubled[0],
        ];
        assert_eq!((sent, lost + doubled), (100, 100));
        assert!(lost > 20 && doubled > 20, "{lost} {doubled}");
        line.clear();
        assert_eq!(line.counts.lost[0], lost + 2 * doubled);
        assert_eq!(line.counts.lost_by_chance[0], lost);
    }

    #[test]
    fn what_was_not_done_is_not_counted() {
        let model = LinkModel {
            duplicates: 1.0,
            reordering: 1.0,
            ..LinkModel::default()
        };
        assert_eq!(letters(&received("abc", model, 1)), "aabbcc");
        let (mut line, mut random) = (DelayLine::default(), Random::new(1));
        for letter in "abc".chars() {
            line.send(0, letter, &model, &mut random);
        }
        assert_eq!((line.counts.doubled[0], line.counts.overtook[0]), (3, 0));
        // No bit of a report is flipped.
        let model = LinkModel {
            damage: 1.0,
            ..LinkModel::default()
        };
        let report = Upward::Report(ContactReport {
            client: 1,
            tick: 0,
            probe: 0,
            object: 0,
            position: [0.0; 3],
            orientation_wxyz: [1.0, 0.0, 0.0, 0.0],
            contact: [0.0; 3],
            force: [0.0; 3],
        });
        let mut line = DelayLine::default();
        line.send(0, report, &model, &mut random);
        let counts = line.counts;
        assert_eq!((counts.sent[6], counts.damaged), (1, [0; 13]));
    }

    #[test]
    fn a_throttled_link_queues() {
        let model = LinkModel {
            bytes_per_tick: 5.0,
            ..LinkModel::default()
        };
        let expected = [(4, 'a'), (6, 'b'), (8, 'c')];
        assert_eq!(received("abc", model, 1), expected);
    }

    #[test]
    fn what_waits_for_the_wire_arrives_in_batches() {
        let model = LinkModel {
            bytes_per_tick: 4.0,
            batch_bytes: 25,
            ..LinkModel::default()
        };
        // The first goes at once; the others wait, and two fit into a batch.
        let expected = [(4, 'a'), (9, 'b'), (9, 'c'), (14, 'd'), (14, 'e')];
        assert_eq!(received("abcde", model, 1), expected);
    }

    #[test]
    fn the_seed_decides_on_the_faults() {
        let model = LinkModel {
            loss: 0.5,
            duplicates: 0.5,
            reordering: 0.5,
            ..LinkModel::default()
        };
        let run = |seed| received("abcdefghijklmnopqrstuvwxyz", model, seed);
        assert_eq!(run(1), run(1));
        assert_ne!(run(1), run(2));
    }
}
