//! The client's end: one file, asked for until it is whole.

use crate::tuning::{
    CHUNKS_A_QUESTION, FIRST_TIMEOUT, MAX_DAMAGED, MAX_OUTSTANDING, MAX_QUESTIONS, MAX_TIMEOUT,
    MIN_TIMEOUT, ROUND_TRIP_SHARE, VARIATION_SHARE, VARIATIONS,
};
use protocol::{
    CHUNK_SLOTS, ChunkHeader, ChunkSlot, FILE_CHUNK_BYTES, FileAsk, FileChunk, FileHash, Request,
};
use std::ops::Range;
use std::time::Duration;
use thiserror::Error;

/// Why a file does not come: one sentence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum DownloadError {
    /// The station has no such file.
    #[error("the station has no file {0}: its scene has changed meanwhile, start again")]
    Unknown(FileHash),
    /// The station has no scene to give.
    #[error(
        "the station gives away no scene (it says why where it runs): start with the scene file instead"
    )]
    NoScene,
    /// Larger than this side takes.
    #[error(
        "a file of the station's scene has {bytes} bytes, more than the {most} that are taken: start with the scene file instead"
    )]
    TooLarge {
        /// Its size; at least so many.
        bytes: u64,
        /// The largest that is taken.
        most: u64,
    },
    /// Its content is not what its hash says, time and again.
    #[error(
        "a file of the station's scene arrived {MAX_DAMAGED} times with another content than its hash says: restart the station, and if it stays so, copy the scene and start with the scene file"
    )]
    Damaged,
}

/// A question under way.
#[derive(Debug, Clone)]
struct Asked {
    question: u32,
    chunks: Range<u64>,
    at: Duration,
    /// Whether one of its chunks came.
    is_answered: bool,
}

/// What is known of the file, from its first chunk on.
#[derive(Debug, Clone)]
struct Found {
    file: FileHash,
    content: Vec<u8>,
    /// Bytes of the last chunk, when it came.
    last: Option<usize>,
    is_here: Vec<bool>,
    here: u64,
    /// All chunks before this one are here.
    whole_to: u64,
}

/// One file that is being asked for. Times are those of one clock, from any start.
///
/// Every station of a domain hears the questions and answers them; what another one says than that
/// which is listened to is left alone, else the file would be made of two.
#[derive(Debug, Clone)]
pub struct Download {
    client: u64,
    /// Incarnation of the station.
    station: u64,
    wanted: FileHash,
    max_bytes: u64,
    found: Option<Found>,
    outstanding: Vec<Asked>,
    next_question: u32,
    /// When it began, or the last chunk came that was new.
    heard: Duration,
    /// Smoothed round trip and its mean deviation, seconds.
    round_trip: Option<(f64, f64)>,
    /// Silences in a row.
    silences: u32,
    /// New chunks so far, also those of contents that were thrown away.
    chunks: u64,
    damaged: u32,
    is_whole: bool,
}

impl Download {
    /// Nothing of a file yet, which the station of this incarnation is to give; `max_bytes` are
    /// taken at the most.
    #[must_use]
    pub fn new(client: u64, station: u64, wanted: FileHash, max_bytes: u64, now: Duration) -> Self {
        Self {
            client,
            station,
            wanted,
            max_bytes,
            found: None,
            outstanding: Vec::new(),
            next_question: 0,
            heard: now,
            round_trip: None,
            silences: 0,
            chunks: 0,
            damaged: 0,
            is_whole: false,
        }
    }

    /// The same client's next file of the same station: numbers of questions and chunks and the
    /// measured round trip go on.
    #[must_use]
    pub fn next(&self, wanted: FileHash, max_bytes: u64, now: Duration) -> Self {
        Self {
            next_question: self.next_question,
            round_trip: self.round_trip,
            chunks: self.chunks,
            ..Self::new(self.client, self.station, wanted, max_bytes, now)
        }
    }

    /// Listens to the station of another incarnation from now on, as where it was restarted: what
    /// is here stays, and what is under way is asked for again.
    pub fn listen_to(&mut self, station: u64) {
        self.station = station;
        self.outstanding.clear();
        self.silences = 0;
    }

    /// Whether all of it is here and its hash is right.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.is_whole
    }

    /// Content hash of the file, as soon as it is known.
    #[must_use]
    pub fn file(&self) -> Option<FileHash> {
        self.found.as_ref().map(|found| found.file)
    }

    /// Hands over the content of a whole file; nothing of one that is not whole.
    #[must_use]
    pub fn take_content(&mut self) -> Vec<u8> {
        let found = self.found.as_mut().filter(|_| self.is_whole);
        found.map_or_else(Vec::new, |found| std::mem::take(&mut found.content))
    }

    /// Bytes that are here.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let found = self.found.as_ref();
        found.map_or(0, |found| found.here * FILE_CHUNK_BYTES as u64)
    }

    /// New chunks that came, also those of contents that were thrown away.
    #[must_use]
    pub fn chunks(&self) -> u64 {
        self.chunks
    }

    /// When something new was heard last, or when it began.
    #[must_use]
    pub fn heard(&self) -> Duration {
        self.heard
    }

    /// The next question, as long as there is one to ask: call until `None`.
    pub fn ask(&mut self, now: Duration) -> Option<Request> {
        if self.is_whole {
            return None;
        }
        if !self.outstanding.is_empty()
            && now.saturating_sub(self.asked_or_heard()) > self.timeout()
        {
            // Nothing came for too long: all of it counts as lost.
            self.outstanding.clear();
            self.silences += 1;
        }
        let chunks = self.next_range()?;
        self.next_question = self.next_question.wrapping_add(1);
        let question = self.next_question;
        let count = (chunks.end - chunks.start) as u32;
        let ask = FileAsk {
            client: self.client,
            file: self.found.as_ref().map_or(self.wanted, |of| of.file),
            first: chunks.start,
            count,
            question,
        };
        self.outstanding.push(Asked {
            question,
            chunks,
            at: now,
            is_answered: false,
        });
        Some(ask.request())
    }

    /// Takes a chunk in; one that is not of this file or station, or not sound, changes nothing.
    ///
    /// # Errors
    /// When the file cannot be had: one sentence.
    pub fn take(
        &mut self,
        header: &ChunkHeader,
        slots: &[ChunkSlot; CHUNK_SLOTS],
        now: Duration,
    ) -> Result<(), DownloadError> {
        let is_ours = (header.client, header.station) == (self.client, self.station);
        let chunk = FileChunk::of(header).filter(|_| is_ours);
        let Some(chunk) = chunk.filter(|_| !self.is_whole && header.is_sound(slots)) else {
            return Ok(());
        };
        let mut asked = self.outstanding.iter_mut();
        let asked = asked.find(|asked| asked.question == chunk.question);
        let Some(asked) = asked else {
            // Of a question that counts as lost, or of another download: it may be of use still.
            return self.put(chunk, slots, now);
        };
        if chunk.chunks == 0 {
            // The station was restarted with another scene: what stands for it is asked for anew.
            if self.wanted == FileHash::SCENE && chunk.file != FileHash::SCENE {
                self.start_over();
                return Ok(());
            }
            return Err(match self.wanted {
                FileHash::SCENE => DownloadError::NoScene,
                hash => DownloadError::Unknown(hash),
            });
        }
        if !std::mem::replace(&mut asked.is_answered, true) {
            let seconds = now.saturating_sub(asked.at).as_secs_f64();
            self.measure(seconds);
        }
        self.put(chunk, slots, now)
    }

    /// Puts a chunk into its place, and looks whether the file is whole.
    fn put(
        &mut self,
        chunk: FileChunk,
        slots: &[ChunkSlot; CHUNK_SLOTS],
        now: Duration,
    ) -> Result<(), DownloadError> {
        let is_wanted = self.wanted == FileHash::SCENE || chunk.file == self.wanted;
        let chunks = u64::from(chunk.chunks);
        let bytes = chunk.bytes as usize;
        let is_last = chunks.checked_sub(1) == Some(chunk.index);
        let fits = bytes == FILE_CHUNK_BYTES
            || (is_last && bytes < FILE_CHUNK_BYTES && (bytes > 0 || chunks == 1));
        if !is_wanted || chunk.index >= chunks || !fits {
            return Ok(());
        }
        if let Some(found) = &self.found
            && (found.file != chunk.file || found.is_here.len() as u64 != chunks)
        {
            return Ok(());
        }
        let rest = if is_last { bytes as u64 } else { 0 };
        let (least, most) = (
            (chunks - 1) * FILE_CHUNK_BYTES as u64 + rest,
            self.max_bytes,
        );
        if least > most {
            return Err(DownloadError::TooLarge { bytes: least, most });
        }
        let found = self.found.get_or_insert_with(|| Found::new(chunk));
        if !found.take(chunk, slots) {
            return Ok(());
        }
        self.chunks += 1;
        self.heard = now;
        self.silences = 0;
        let found = &*found;
        self.outstanding
            .retain(|asked| !found.has_all(&asked.chunks));
        self.check_whole()
    }

    /// Checks the content's hash when all of it is here.
    fn check_whole(&mut self) -> Result<(), DownloadError> {
        let Some(found) = self.found.as_mut().filter(|found| found.is_full()) else {
            return Ok(());
        };
        found.cut();
        self.is_whole = FileHash::of(&found.content) == found.file;
        if self.is_whole {
            return Ok(());
        }
        self.damaged += 1;
        if self.damaged >= MAX_DAMAGED {
            return Err(DownloadError::Damaged);
        }
        self.start_over();
        Ok(())
    }

    fn start_over(&mut self) {
        self.found = None;
        self.outstanding.clear();
    }

    /// Chunks to ask for next: the first that are neither here nor under way.
    fn next_range(&self) -> Option<Range<u64>> {
        let Some(found) = &self.found else {
            // Nobody knows how many there are.
            return self.outstanding.is_empty().then_some(0..CHUNKS_A_QUESTION);
        };
        let missing = |asked: &Asked| found.missing(&asked.chunks);
        let outstanding: u64 = self.outstanding.iter().map(missing).sum();
        let is_busy = outstanding + CHUNKS_A_QUESTION > MAX_OUTSTANDING;
        if is_busy || self.outstanding.len() == MAX_QUESTIONS {
            return None;
        }
        let is_open = |&chunk: &u64| {
            let is_asked = |asked: &Asked| asked.chunks.contains(&chunk);
            !found.is_here[chunk as usize] && !self.outstanding.iter().any(is_asked)
        };
        let end = found.is_here.len() as u64;
        let first = (found.whole_to..end).find(is_open)?;
        let most = end.min(first + CHUNKS_A_QUESTION);
        let count = (first..most).take_while(is_open).count() as u64;
        Some(first..first + count)
    }

    /// When the youngest question was asked, or something new was heard.
    fn asked_or_heard(&self) -> Duration {
        let asked = self.outstanding.iter().map(|asked| asked.at);
        asked.fold(self.heard, Duration::max)
    }

    /// Silence after which what is under way counts as lost.
    fn timeout(&self) -> Duration {
        let measured = match self.round_trip {
            None => FIRST_TIMEOUT,
            Some((smoothed, variation)) => {
                let seconds = (smoothed + VARIATIONS * variation).min(MAX_TIMEOUT.as_secs_f64());
                Duration::from_secs_f64(seconds)
            }
        };
        let doubled = measured.max(MIN_TIMEOUT) * (1 << self.silences.min(5));
        doubled.min(MAX_TIMEOUT)
    }

    /// Takes a measured round trip in, as RFC 6298 does.
    fn measure(&mut self, seconds: f64) {
        self.round_trip = Some(match self.round_trip {
            None => (seconds, seconds / 2.0),
            Some((smoothed, variation)) => (
                smoothed + (seconds - smoothed) * ROUND_TRIP_SHARE,
                variation + ((seconds - smoothed).abs() - variation) * VARIATION_SHARE,
            ),
        });
    }
}

impl Found {
    /// Room for the file of a chunk.
    fn new(chunk: FileChunk) -> Self {
        let chunks = chunk.chunks as usize;
        Self {
            file: chunk.file,
            content: vec![0; chunks * FILE_CHUNK_BYTES],
            last: None,
            is_here: vec![false; chunks],
            here: 0,
            whole_to: 0,
        }
    }

    /// Puts a chunk into its place; whether it is new.
    fn take(&mut self, chunk: FileChunk, slots: &[ChunkSlot; CHUNK_SLOTS]) -> bool {
        let index = chunk.index as usize;
        if std::mem::replace(&mut self.is_here[index], true) {
            return false;
        }
        let bytes = &bytemuck::cast_slice(slots)[..chunk.bytes as usize];
        let begin = index * FILE_CHUNK_BYTES;
        self.content[begin..begin + bytes.len()].copy_from_slice(bytes);
        if index + 1 == self.is_here.len() {
            self.last = Some(bytes.len());
        }
        self.here += 1;
        let beyond = self.is_here[self.whole_to as usize..].iter();
        self.whole_to += beyond.take_while(|is_here| **is_here).count() as u64;
        true
    }

    fn is_full(&self) -> bool {
        self.here == self.is_here.len() as u64
    }

    /// Cuts what is beyond the file's end.
    fn cut(&mut self) {
        let last = self.last.unwrap_or(0);
        let bytes = (self.is_here.len() - 1) * FILE_CHUNK_BYTES + last;
        self.content.truncate(bytes);
    }

    fn missing(&self, chunks: &Range<u64>) -> u64 {
        let inside = chunks.start as usize..self.is_here.len().min(chunks.end as usize);
        let of = self.is_here.get(inside).unwrap_or_default();
        of.iter().filter(|is_here| !**is_here).count() as u64
    }

    fn has_all(&self, chunks: &Range<u64>) -> bool {
        self.missing(chunks) == 0
    }
}
