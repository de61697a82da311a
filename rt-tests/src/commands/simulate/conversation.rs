//! What the station and the controllers say to each other, judged by the numbers of their messages
//! (see `protocol`), beside both of them: each end may only go on from what has reached it without
//! a gap.
//!
//! | checked | broken by |
//! |---|---|
//! | the requests about an object count from 0 in each epoch, and epochs ascend | a request twice, or in no epoch |
//! | another station is asked in an epoch of its own | an epoch that goes on over a restart |
//! | a controller acknowledges no chunk behind a missing one | a chunk that is taken out of order |
//! | in an epoch in which a request is missing, a station says nothing but that | a belief that the controller does not share |

use super::trace::{Checked, ensure};
use protocol::{ChunkHeader, Request, RequestKind};
use simulator::{Client, Simulation};
use std::collections::{BTreeMap, BTreeSet};

/// A client and an object.
type Subject = (u64, u32);

/// Requests about an object as they came to the station.
#[derive(Debug)]
struct Heard {
    incarnation: u64,
    /// The incarnations before, whose late requests count no more: a run has fewer than the station
    /// keeps.
    former: BTreeSet<u64>,
    epoch: u32,
    /// Number of the next request.
    next: u64,
    /// Whether a request before the newest is missing.
    is_broken: bool,
}

/// Requests about an object as a controller sent them.
#[derive(Debug, Clone, Copy)]
struct Sent {
    /// The station that it saw.
    station: u64,
    epoch: u32,
    /// Number of the next request.
    next: u64,
}

/// The talk of all controllers with one station after another.
#[derive(Debug, Default)]
pub struct Conversation {
    heard: BTreeMap<Subject, Heard>,
    sent: BTreeMap<Subject, Sent>,
    /// Chunks that have arrived without a gap, by subject, station and epoch.
    arrived: BTreeMap<(Subject, u64, u32), u64>,
}

impl Conversation {
    /// The station was started again: it has heard nothing.
    pub fn restart_station(&mut self) {
        self.heard.clear();
    }

    /// A controller was started again: it has sent and received nothing.
    pub fn restart_client(&mut self, client: u64) {
        self.sent.retain(|subject, _| subject.0 != client);
        self.arrived.retain(|(subject, ..), _| subject.0 != client);
    }

    /// The station's side of a period.
    ///
    /// # Errors
    /// When the station answers in an epoch in which a request is missing.
    pub fn check_station<D: AsRef<[u8]>>(&mut self, simulation: &Simulation<D>) -> Checked {
        for request in simulation.asked() {
            self.hear(request);
        }
        for chunk in simulation.said() {
            let heard = self.heard.get(&(chunk.client, chunk.object));
            let is_broken = heard.is_some_and(|of| of.epoch == chunk.epoch && of.is_broken);
            let says_so = chunk.sequence == u64::MAX && chunk.count == 0;
            ensure(
                !is_broken || says_so,
                "silence after a lost request",
                || {
                    let ChunkHeader {
                        client,
                        object,
                        epoch,
                        sequence,
                        ..
                    } = chunk;
                    format!(
                        "chunk {sequence} of epoch {epoch} for object {object} of client {client}"
                    )
                },
            )?;
        }
        Ok(())
    }

    fn hear(&mut self, request: &Request) {
        let subject = (request.client, request.object);
        let fresh = |former| Heard {
            incarnation: request.incarnation,
            former,
            epoch: request.epoch,
            next: 0,
            is_broken: false,
        };
        let heard = self.heard.entry(subject);
        let heard = heard.or_insert_with(|| fresh(BTreeSet::new()));
        if request.incarnation != heard.incarnation {
            if heard.former.contains(&request.incarnation) {
                return;
            }
            let mut former = std::mem::take(&mut heard.former);
            former.insert(heard.incarnation);
            *heard = fresh(former);
        } else if request.epoch > heard.epoch {
            *heard = fresh(std::mem::take(&mut heard.former));
        } else if request.epoch < heard.epoch {
            return;
        }
        if heard.is_broken || request.sequence < heard.next {
            return;
        }
        heard.is_broken = request.sequence > heard.next;
        heard.next += 1;
        if !heard.is_broken && request.kind == RequestKind::Close as u32 {
            self.heard.remove(&subject);
        }
    }

    /// A controller's side, after its tick.
    ///
    /// # Errors
    /// The first check that does not hold.
    pub fn check_client(&mut self, client: &Client) -> Checked {
        for chunk in client.arrived() {
            let epoch = ((chunk.client, chunk.object), chunk.station, chunk.epoch);
            let next = self.arrived.entry(epoch).or_default();
            *next += u64::from(chunk.sequence == *next);
        }
        for request in client.outputs().outbox.requests() {
            self.send(request, client.station())?;
        }
        Ok(())
    }

    fn send(&mut self, request: &Request, station: u64) -> Checked {
        let subject = (request.client, request.object);
        let before = self.sent.get(&subject).copied();
        let of_epoch = before.filter(|of| of.epoch == request.epoch);
        let told = || {
            let Request {
                sequence, epoch, ..
            } = request;
            format!("request {sequence} of epoch {epoch} to station {station}, before: {before:?}")
        };
        ensure(
            of_epoch.is_none_or(|of| of.station == station),
            "an epoch for each station",
            told,
        )?;
        let ascends = before.is_none_or(|of| of.epoch <= request.epoch);
        let next = of_epoch.map_or(0, |of| of.next);
        ensure(
            ascends && request.sequence == next,
            "numbers of requests",
            told,
        )?;
        let arrived = self.arrived.get(&(subject, station, request.epoch));
        let arrived = arrived.copied().unwrap_or(0);
        ensure(request.consumed <= arrived, "chunks in their order", || {
            let taken = request.consumed;
            format!("{taken} chunks acknowledged, {arrived} have arrived without a gap")
        })?;
        let sent = Sent {
            station,
            epoch: request.epoch,
            next: next + 1,
        };
        self.sent.insert(subject, sent);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn request(epoch: u32, sequence: u64, consumed: u64) -> Request {
        Request {
            client: 7,
            incarnation: 1,
            epoch,
            sequence,
            consumed,
            ..Request::zeroed()
        }
    }

    #[test]
    fn requests_are_judged_by_their_numbers() {
        let check = |of: Checked| of.err().map(|(check, _)| check);
        let mut talk = Conversation::default();
        assert_eq!(check(talk.send(&request(1, 0, 0), 100)), None);
        assert_eq!(check(talk.send(&request(1, 1, 0), 100)), None);
        let again = check(talk.send(&request(1, 1, 0), 100));
        assert_eq!(again, Some("numbers of requests"));
        let other = check(talk.send(&request(1, 2, 0), 101));
        assert_eq!(other, Some("an epoch for each station"));
        assert_eq!(check(talk.send(&request(2, 0, 0), 101)), None);
        let early = check(talk.send(&request(2, 1, 1), 101));
        assert_eq!(early, Some("chunks in their order"));
    }

    #[test]
    fn a_late_request_of_any_former_incarnation_begins_no_epoch() {
        let mut talk = Conversation::default();
        for (incarnation, epoch) in [(1, 1), (2, 1), (2, 2), (3, 1)] {
            let now = Request {
                incarnation,
                ..request(epoch, 0, 0)
            };
            talk.hear(&now);
            let heard = &talk.heard[&(7, 0)];
            assert_eq!((heard.incarnation, heard.epoch), (incarnation, epoch));
            for former in 1..incarnation {
                // It would break the epoch of the living one.
                let late = Request {
                    incarnation: former,
                    ..request(9, 5, 0)
                };
                talk.hear(&late);
                let heard = &talk.heard[&(7, 0)];
                let is_left = heard.incarnation == incarnation && !heard.is_broken;
                assert!(is_left, "{former} after {incarnation}: {heard:?}");
            }
        }
    }

    #[test]
    fn an_epoch_is_broken_from_a_lost_request_on() {
        let mut talk = Conversation::default();
        let is_broken = |talk: &Conversation| talk.heard[&(7, 0)].is_broken;
        for (epoch, sequence, broken) in [
            (1, 0, false),
            (1, 0, false),
            (1, 1, false),
            (1, 3, true),
            (1, 2, true),
            (2, 0, false),
        ] {
            talk.hear(&request(epoch, sequence, 0));
            assert_eq!(
                is_broken(&talk),
                broken,
                "epoch {epoch}, request {sequence}"
            );
        }
    }
}
