//! Chunks on a thin line: as few slots as their content needs.
//!
//! A chunk of [`CHUNK_SLOTS`] slots is plain; one of fewer is compact: its slots are the bytes of a
//! range coder, zeros behind them. Header and checksum are those of the plain chunk, which the
//! reader makes again to the bit: what was damaged on the way is noticed as ever.
//!
//! Coder and decoder learn from the chunks of one epoch of one object at one station, from its
//! first compact one on; a plain chunk makes them begin anew. So the chunks of an epoch are read in
//! their order or not at all, and any gap ends the epoch anyway ([`CompactError::Gap`]). A record
//! that was sent before in the epoch costs next to nothing; a session keeps less than 2 MB for all
//! of that.
//!
//! `rt-tests codecs` chose it: 32.2 bytes of records and closures a VSP received, on the mean of
//! the shared models in touches with a cache of 4 MiB, in slots and with headers; 190.1 plain, 53.4
//! with zstd over all chunks as one stream, 54.5 with zstd on planes of differences.
//!
//! | module | content |
//! |---|---|
//! | `range_coder` | bits by their probabilities |
//! | `numbers` | numbers by such bits |
//! | `answers` | chunks of answers: heads and ids of their parts |
//! | `records` | their records |
//! | `points` | chunks of points of a path |
//! | `words` | all other chunks |

mod answers;
mod numbers;
mod points;
mod range_coder;
mod records;
mod words;

use crate::wire::{CHUNK_SLOTS, ChunkHeader, ChunkKind, ChunkSlot, MAX_SESSIONS};
use answers::{AnswersModel, pack, unpack};
use bytemuck::Zeroable;
use points::PointsModel;
use range_coder::{Bit, BitReader, BitWriter, Code};
use records::Bases;
use spm::Sizes;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use thiserror::Error;
use words::WordsModel;

#[cfg(test)]
mod tests;

/// Stations whose sessions are kept: one is in use, others answer too where several serve a domain,
/// and those of one that was restarted stay until their place is needed.
const MAX_STATIONS: usize = 4;

/// Reasons not to take a chunk. It is dropped; what was read before stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum CompactError {
    /// No chunk has so many slots.
    #[error("a chunk has an unknown length")]
    Length,
    /// It is not what was sent.
    #[error("a chunk is damaged")]
    Damaged,
    /// It came before, or it is of an epoch that is over.
    #[error("a chunk came twice")]
    Repeated,
    /// Chunks before it are missing or were damaged: nothing of its epoch can be read any more.
    /// Whoever waits for it learns that from [`ChunkHeader::of_gap`].
    #[error("chunks before a compact one are missing")]
    Gap,
}

/// What is known of the chunks of an epoch.
#[derive(Debug)]
struct Session {
    epoch: u32,
    /// Number of the next chunk.
    next: u64,
    /// Whether a chunk was damaged: nothing can be read until a plain one comes.
    is_lost: bool,
    /// When it was used last, in chunks of all sessions.
    used: u64,
    /// From the first compact chunk on.
    model: Option<Box<Model>>,
}

/// Station and object: chunks of others are no part of a session.
type Subject = (u64, u32);

fn subject(header: &ChunkHeader) -> Subject {
    (header.station, header.object)
}

/// The sessions of a client. Several stations may send to it on the one topic that it has.
#[derive(Debug, Default)]
struct Sessions {
    all: BTreeMap<Subject, Session>,
    used: u64,
}

impl Sessions {
    fn get(&self, header: &ChunkHeader) -> Option<&Session> {
        self.all.get(&subject(header))
    }

    /// Begins anew with a chunk, before it is coded.
    fn begin(&mut self, header: &ChunkHeader) -> &mut Session {
        let subject = subject(header);
        if !self.all.contains_key(&subject) {
            self.make_room(header.station);
        }
        let session = Session {
            epoch: header.epoch,
            next: header.sequence,
            is_lost: false,
            used: 0,
            model: None,
        };
        let session = match self.all.entry(subject) {
            Entry::Vacant(place) => place.insert(session),
            Entry::Occupied(place) => {
                let place = place.into_mut();
                *place = session;
                place
            }
        };
        self.used += 1;
        session.used = self.used;
        session
    }

    /// Makes room for a further session of a station: of its own the stalest goes, and of too many
    /// stations the stalest with all of its sessions.
    fn make_room(&mut self, station: u64) {
        let own = self.all.iter().filter(|((of, _), _)| *of == station);
        let (count, stalest) = (
            own.clone().count(),
            own.min_by_key(|(_, session)| session.used),
        );
        if let Some((&stalest, _)) = stalest {
            if count >= MAX_SESSIONS {
                self.all.remove(&stalest);
            }
            return;
        }
        let mut last_used = BTreeMap::<u64, u64>::new();
        for (&(of, _), session) in &self.all {
            let last = last_used.entry(of).or_default();
            *last = session.used.max(*last);
        }
        let stalest = last_used.iter().min_by_key(|(_, used)| **used);
        if let Some((&stalest, _)) = stalest.filter(|_| last_used.len() >= MAX_STATIONS) {
            self.all.retain(|&(of, _), _| of != stalest);
        }
    }

    /// Begins anew behind a plain chunk.
    fn begin_after(&mut self, header: &ChunkHeader) {
        let session = self.begin(header);
        session.next = header.sequence.wrapping_add(1);
    }

    /// The session that a chunk goes on.
    fn going_on(&mut self, header: &ChunkHeader) -> Option<&mut Session> {
        let session = self.all.get_mut(&subject(header))?;
        let is_next = (session.epoch, session.next) == (header.epoch, header.sequence);
        let goes_on = is_next && !session.is_lost;
        self.used += 1;
        session.used = self.used;
        goes_on.then_some(session)
    }
}

impl Session {
    /// Whether a chunk of its subject came before.
    fn is_past(&self, header: &ChunkHeader) -> bool {
        let is_repeated = header.epoch == self.epoch && header.sequence < self.next;
        header.epoch < self.epoch || is_repeated
    }
}

/// The station's end: makes the chunks of one client compact.
#[derive(Debug, Default)]
pub struct ChunkEncoder {
    sessions: Sessions,
    has_sent: bool,
}

impl ChunkEncoder {
    /// The slots of a sealed chunk that is sent next; `None` when it is to be sent as it is.
    /// `sizes` are those of its model, if they are known: records are smaller by it.
    ///
    /// The first chunk is plain: the far end of a tunnel makes its memory as large as the largest
    /// chunk so far, and so does that once.
    #[must_use]
    pub fn encode(
        &mut self,
        header: &ChunkHeader,
        slots: &[ChunkSlot; CHUNK_SLOTS],
        sizes: Option<Sizes>,
    ) -> Option<Vec<ChunkSlot>> {
        let is_first = !std::mem::replace(&mut self.has_sent, true);
        let session = if header.sequence == 0 {
            Some(self.sessions.begin(header))
        } else {
            self.sessions.going_on(header)
        };
        let compact = session.filter(|_| !is_first).and_then(|session| {
            session.next += 1;
            let mut writer = BitWriter::new();
            let model = session.model.get_or_insert_default();
            model.encode(&mut writer, header, slots, sizes);
            in_slots(&writer.finish())
        });
        if compact.is_none() {
            self.sessions.begin_after(header);
        }
        compact
    }
}

/// What coder and decoder have learnt from the chunks of an epoch.
#[derive(Debug, Default)]
struct Model {
    bases: Option<Bases>,
    is_packed: Bit,
    answers: AnswersModel,
    points: PointsModel,
    words: WordsModel,
}

impl Model {
    fn encode(
        &mut self,
        writer: &mut BitWriter,
        header: &ChunkHeader,
        slots: &[ChunkSlot; CHUNK_SLOTS],
        sizes: Option<Sizes>,
    ) {
        let bases = self.bases(writer, Bases::of(sizes));
        let is_answers = header.kind == ChunkKind::Answers as u32;
        // Packed again to the same bits, or sent as words.
        let parts = unpack(header.count, slots).filter(|_| is_answers);
        let parts = parts.filter(|parts| pack(parts) == Some((header.count, *slots)));
        writer.bit(parts.is_some(), &mut self.is_packed);
        match parts {
            Some(parts) => {
                self.answers.code(writer, &parts, bases);
            }
            None => {
                self.others(writer, header, slots);
            }
        }
    }

    /// The slots that came in `sent`, if they are those that were sealed.
    fn decode(
        &mut self,
        header: &ChunkHeader,
        sent: &[ChunkSlot],
    ) -> Option<[ChunkSlot; CHUNK_SLOTS]> {
        let mut reader = BitReader::new(bytemuck::cast_slice(sent));
        let slots = self.decode_any(&mut reader, header);
        slots.filter(|slots| header.is_sound(slots))
    }

    fn decode_any(
        &mut self,
        reader: &mut BitReader<'_>,
        header: &ChunkHeader,
    ) -> Option<[ChunkSlot; CHUNK_SLOTS]> {
        let bases = self.bases(reader, Bases::default());
        if reader.bit(false, &mut self.is_packed) {
            let parts = self.answers.code(reader, &[], bases)?;
            let (_, slots) = pack(&parts)?;
            return Some(slots);
        }
        let none = [ChunkSlot::zeroed(); CHUNK_SLOTS];
        Some(self.others(reader, header, &none))
    }

    /// Chunks of no packed answers.
    fn others(
        &mut self,
        code: &mut impl Code,
        header: &ChunkHeader,
        given: &[ChunkSlot; CHUNK_SLOTS],
    ) -> [ChunkSlot; CHUNK_SLOTS] {
        if header.kind == ChunkKind::Tour as u32 {
            self.points.code(code, given)
        } else {
            self.words.code(code, given)
        }
    }

    /// Where the ids of records begin: told once.
    fn bases(&mut self, code: &mut impl Code, given: Bases) -> Bases {
        *self.bases.get_or_insert_with(|| Bases {
            vertices: code.even(given.vertices, u32::BITS),
            faces: code.even(given.faces, u32::BITS),
        })
    }
}

/// Bytes in as few slots as they need, if these are fewer than all.
fn in_slots(bytes: &[u8]) -> Option<Vec<ChunkSlot>> {
    // No slot at all would be no message.
    let count = bytes.len().div_ceil(size_of::<ChunkSlot>()).max(1);
    if count >= CHUNK_SLOTS {
        return None;
    }
    let mut slots = vec![ChunkSlot::zeroed(); count];
    bytemuck::cast_slice_mut(&mut slots)[..bytes.len()].copy_from_slice(bytes);
    Some(slots)
}

/// The client's end: makes plain chunks of what a [`ChunkEncoder`] sends.
#[derive(Debug, Default)]
pub struct ChunkDecoder {
    sessions: Sessions,
}

impl ChunkDecoder {
    /// The slots of the chunk of this header that came in `sent`, plain or compact.
    ///
    /// For any bytes it takes a bounded time and memory, and gives a chunk that was sealed or an
    /// error.
    ///
    /// # Errors
    /// The chunk is to be dropped.
    pub fn decode(
        &mut self,
        header: &ChunkHeader,
        sent: &[ChunkSlot],
    ) -> Result<[ChunkSlot; CHUNK_SLOTS], CompactError> {
        if let Ok(slots) = <[ChunkSlot; CHUNK_SLOTS]>::try_from(sent) {
            return self.plain(header, slots);
        }
        if sent.is_empty() || sent.len() > CHUNK_SLOTS {
            return Err(CompactError::Length);
        }
        let session = self.sessions.get(header);
        if session.is_some_and(|session| session.is_past(header)) {
            return Err(CompactError::Repeated);
        }
        if header.sequence == 0 {
            return self.first(header, sent);
        }
        let session = self.sessions.going_on(header).ok_or(CompactError::Gap)?;
        let model = session.model.get_or_insert_default();
        let Some(slots) = model.decode(header, sent) else {
            session.is_lost = true;
            session.model = None;
            return Err(CompactError::Damaged);
        };
        session.next += 1;
        Ok(slots)
    }

    /// Begins anew with the first chunk of an epoch, once it is known to be sound: beside a damaged
    /// epoch of far ahead all that comes later would count as repeated.
    fn first(
        &mut self,
        header: &ChunkHeader,
        sent: &[ChunkSlot],
    ) -> Result<[ChunkSlot; CHUNK_SLOTS], CompactError> {
        let mut model = Box::<Model>::default();
        let slots = model.decode(header, sent).ok_or(CompactError::Damaged)?;
        let session = self.sessions.begin(header);
        session.next += 1;
        session.model = Some(model);
        Ok(slots)
    }

    /// Checks a plain chunk and begins anew after it.
    fn plain(
        &mut self,
        header: &ChunkHeader,
        slots: [ChunkSlot; CHUNK_SLOTS],
    ) -> Result<[ChunkSlot; CHUNK_SLOTS], CompactError> {
        if !header.is_sound(&slots) {
            return Err(CompactError::Damaged);
        }
        let session = self.sessions.get(header);
        if !session.is_some_and(|session| session.is_past(header)) {
            self.sessions.begin_after(header);
        }
        Ok(slots)
    }
}
