//! The inputs of every tick of a client. A controller that is given them again gives the same
//! bits, so a tick can be timed several times, without a station beside it.

use haptic_device::Sample;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::{Controller, StageObserver, TickInputs, TickOutputs};

/// A tick: its inputs beside samples and chunks, and the hash of its outputs.
#[derive(Debug, Clone, Copy)]
struct Tick {
    tick: u64,
    /// Samples up to and with this tick.
    samples: usize,
    station: u64,
    is_stopping: bool,
    /// Whether the devices had gone to zero by themselves.
    was_cut: bool,
    /// Where it changed: bytes of the cache that may be in use.
    cache_limit: Option<usize>,
    /// Chunks that had arrived.
    chunks: usize,
    replay_hash: u64,
}

/// The inputs of a client's run, and the hash of every tick.
#[derive(Debug, Clone, Default)]
pub struct InputRecording {
    ticks: Vec<Tick>,
    samples: Vec<Option<Sample>>,
    chunks: Vec<InboxChunk>,
}

impl InputRecording {
    /// Ticks recorded.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ticks.len()
    }

    /// Whether nothing was recorded.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ticks.is_empty()
    }

    /// The replay hash after each tick.
    pub fn hashes(&self) -> impl Iterator<Item = u64> + '_ {
        self.ticks.iter().map(|tick| tick.replay_hash)
    }

    /// The inputs of a tick (an index of the recording): those of [`TickInputs`] without chunks,
    /// and how many chunks had arrived.
    #[must_use]
    pub fn inputs(&self, index: usize) -> Option<(TickInputs<'_>, usize)> {
        let tick = self.ticks.get(index)?;
        let before = index.checked_sub(1).map_or(0, |k| self.ticks[k].samples);
        let inputs = TickInputs {
            tick: tick.tick,
            samples: &self.samples[before..tick.samples],
            station: tick.station,
            chunks: [&[], &[]],
            stopping: tick.is_stopping,
        };
        Some((inputs, tick.chunks))
    }

    /// All chunks, in the order in which ticks took them.
    #[must_use]
    pub fn chunks(&self) -> &[InboxChunk] {
        &self.chunks
    }

    /// Adds a chunk that arrives behind all others.
    pub(crate) fn add_chunk(&mut self, chunk: InboxChunk) {
        self.chunks.push(chunk);
    }

    /// Adds a chunk that arrives before `waiting` others.
    pub(crate) fn add_chunk_before(&mut self, waiting: usize, chunk: InboxChunk) {
        self.chunks.insert(self.chunks.len() - waiting, chunk);
    }

    /// Adds a tick; see `Tick` for what the controller was told before it.
    pub(crate) fn add_tick(
        &mut self,
        inputs: &TickInputs<'_>,
        (was_cut, cache_limit): (bool, Option<usize>),
        replay_hash: u64,
    ) {
        self.samples.extend_from_slice(inputs.samples);
        self.ticks.push(Tick {
            tick: inputs.tick,
            samples: self.samples.len(),
            station: inputs.station,
            is_stopping: inputs.stopping,
            was_cut,
            cache_limit,
            chunks: self.chunks.len(),
            replay_hash,
        });
    }
}

/// A recording on its way through a fresh controller of the same plan.
#[derive(Debug)]
pub struct Playback<'a> {
    recording: &'a InputRecording,
    controller: Controller,
    outputs: TickOutputs,
    next: usize,
    /// Samples and chunks consumed.
    samples: usize,
    chunks: usize,
    is_wrapped: bool,
}

impl<'a> Playback<'a> {
    /// At the start of the recording.
    #[must_use]
    pub fn new(recording: &'a InputRecording, controller: Controller) -> Self {
        Self {
            recording,
            outputs: controller.new_outputs(),
            controller,
            next: 0,
            samples: 0,
            chunks: 0,
            is_wrapped: false,
        }
    }

    /// Gives the chunks of each tick in two halves, as a ring does at its wrap.
    #[must_use]
    pub fn wrapped(mut self) -> Self {
        self.is_wrapped = true;
        self
    }

    /// Index of the next tick in the recording.
    #[must_use]
    pub fn tick(&self) -> usize {
        self.next
    }

    /// Plays one tick, in which only the controller works. `None` at the end of the recording,
    /// else whether the tick gave the recorded bits.
    pub fn step(&mut self, observer: &mut impl StageObserver) -> Option<bool> {
        let tick = self.recording.ticks.get(self.next)?;
        let chunks = &self.recording.chunks[self.chunks..tick.chunks];
        let cut = if self.is_wrapped {
            chunks.len() / 2
        } else {
            chunks.len()
        };
        let (first, second) = chunks.split_at(cut);
        if tick.was_cut {
            self.controller.force_was_cut();
        }
        if let Some(bytes) = tick.cache_limit {
            self.controller.set_cache_limit(bytes);
        }
        let inputs = TickInputs {
            tick: tick.tick,
            samples: &self.recording.samples[self.samples..tick.samples],
            station: tick.station,
            chunks: [first, second],
            stopping: tick.is_stopping,
        };
        self.controller.tick(&inputs, &mut self.outputs, observer);
        self.chunks += self.outputs.chunks_consumed;
        self.samples = tick.samples;
        self.next += 1;
        Some(self.controller.replay_hash() == tick.replay_hash)
    }
}
