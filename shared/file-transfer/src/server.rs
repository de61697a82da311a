//! The station's end: files, and the questions for their chunks.

use crate::Chunk;
use crate::tuning::{MAX_OUTSTANDING, MAX_QUESTIONS};
use bytemuck::Zeroable;
use protocol::{
    CHUNK_SLOTS, ChunkSlot, FILE_CHUNK_BYTES, FileAsk, FileChunk, FileHash, MAX_CLIENTS, Request,
    file_chunks,
};
use std::collections::{BTreeMap, VecDeque};

/// What happened since the start. Totals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FileCounters {
    /// Questions.
    pub questions: u64,
    /// Questions ignored: too many clients ask at once, or for chunks beyond the file's end.
    pub ignored: u64,
    /// Questions for files that there are not.
    pub refused: u64,
    /// Chunks handed out.
    pub chunks: u64,
}

/// A question that is not answered to its end: its next chunk stands first.
#[derive(Debug, Clone, Copy)]
struct Waiting {
    ask: FileAsk,
    /// Content hash; `None` when there is no such file.
    found: Option<FileHash>,
}

/// Files that controllers may ask for.
#[derive(Debug, Clone)]
pub struct FileServer {
    station: u64,
    scene: FileHash,
    files: BTreeMap<FileHash, Vec<u8>>,
    /// By client, in the order in which they came.
    waiting: BTreeMap<u64, VecDeque<Waiting>>,
    counters: FileCounters,
}

impl FileServer {
    /// The files of a station of this incarnation; `scene` is the one that stands for all.
    #[must_use]
    pub fn new(station: u64, scene: FileHash, files: BTreeMap<FileHash, Vec<u8>>) -> Self {
        Self {
            station,
            scene,
            files,
            waiting: BTreeMap::new(),
            counters: FileCounters::default(),
        }
    }

    /// No file at all: every question is refused.
    #[must_use]
    pub fn empty(station: u64) -> Self {
        Self::new(station, FileHash::SCENE, BTreeMap::new())
    }

    /// What happened so far.
    #[must_use]
    pub fn counters(&self) -> FileCounters {
        self.counters
    }

    /// Clients to whom something is to be sent.
    pub fn clients(&self) -> impl Iterator<Item = u64> + '_ {
        self.waiting.keys().copied()
    }

    /// Takes a question in; other requests are left alone. Whatever it holds, the worst that
    /// happens is that it is counted and ignored.
    pub fn handle(&mut self, request: &Request) {
        let Some(mut ask) = FileAsk::of(request) else {
            return;
        };
        self.counters.questions += 1;
        let file = if ask.file == FileHash::SCENE {
            self.scene
        } else {
            ask.file
        };
        let content = self.files.get(&file);
        let end = content.map_or(1, |content| file_chunks(content.len() as u64));
        match content {
            None => {
                self.counters.refused += 1;
                (ask.first, ask.count) = (0, 1);
            }
            Some(_) => {
                let left = end.saturating_sub(ask.first).min(MAX_OUTSTANDING);
                ask.count = u64::from(ask.count).min(left) as u32;
            }
        }
        let is_full = self.waiting.len() == MAX_CLIENTS;
        if ask.count == 0 || (is_full && !self.waiting.contains_key(&ask.client)) {
            self.counters.ignored += 1;
            return;
        }
        let waiting = self.waiting.entry(ask.client).or_default();
        if waiting.len() == MAX_QUESTIONS {
            waiting.pop_front();
        }
        waiting.push_back(Waiting {
            ask,
            found: content.map(|_| file),
        });
    }

    /// Drops what a client asked for.
    pub fn drop_questions(&mut self, client: u64) {
        self.waiting.remove(&client);
    }

    /// The next chunk for a client; `None` when all is sent.
    pub fn poll(&mut self, client: u64) -> Option<Chunk> {
        let questions = self.waiting.get_mut(&client)?;
        let first = questions.front_mut()?;
        let Waiting { ask, found } = *first;
        first.ask.first += 1;
        first.ask.count -= 1;
        if first.ask.count == 0 {
            questions.pop_front();
        }
        if questions.is_empty() {
            self.waiting.remove(&client);
        }
        let mut chunk = FileChunk {
            file: ask.file,
            index: ask.first,
            chunks: 0,
            bytes: 0,
            question: ask.question,
        };
        let mut slots = [ChunkSlot::zeroed(); CHUNK_SLOTS];
        if let Some((file, content)) = found.and_then(|file| self.files.get_key_value(&file)) {
            let begin = ask.first as usize * FILE_CHUNK_BYTES;
            let end = content.len().min(begin + FILE_CHUNK_BYTES);
            let bytes = &content[begin..end];
            bytemuck::cast_slice_mut(&mut slots)[..bytes.len()].copy_from_slice(bytes);
            chunk.file = *file;
            chunk.chunks = u32::try_from(file_chunks(content.len() as u64)).unwrap_or(u32::MAX);
            chunk.bytes = bytes.len() as u32;
            self.counters.chunks += 1;
        }
        Some((chunk.header(self.station, client, &slots), slots))
    }
}
