//! Every input of every tick of a simulation. A controller that is given them again gives the same bits, so
//! that a tick can be timed several times, without a station beside it.

use haptic_device::Sample;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::{Controller, StageObserver, TickInputs, TickOutputs};

/// The inputs of one tick beside the chunks, and what the tick gave.
#[derive(Debug, Clone, Copy)]
struct Noted {
    /// Samples, since the start.
    sampled: usize,
    station: u64,
    /// Chunks that had arrived, since the start.
    arrived: usize,
    replay_hash: u64,
}

/// The inputs of a run.
#[derive(Debug, Clone, Default)]
pub struct InputRecording {
    ticks: Vec<Noted>,
    samples: Vec<Option<Sample>>,
    chunks: Vec<InboxChunk>,
}

impl InputRecording {
    /// A chunk has arrived.
    pub(super) fn arrived(&mut self, chunk: InboxChunk) {
        self.chunks.push(chunk);
    }

    /// A tick is over.
    pub(super) fn note(&mut self, samples: &[Option<Sample>], station: u64, replay_hash: u64) {
        self.samples.extend_from_slice(samples);
        self.ticks.push(Noted {
            sampled: self.samples.len(),
            station,
            arrived: self.chunks.len(),
            replay_hash,
        });
    }

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
}

/// A tape on its way through a fresh controller of the same plan.
#[derive(Debug)]
pub struct Playback<'a> {
    tape: &'a InputRecording,
    controller: Controller,
    outputs: TickOutputs,
    tick: usize,
    /// Samples and chunks consumed, since the start.
    sampled: usize,
    consumed: usize,
}

impl<'a> Playback<'a> {
    /// At the start of the tape.
    #[must_use]
    pub fn new(tape: &'a InputRecording, controller: Controller) -> Self {
        Self {
            tape,
            outputs: TickOutputs::new(controller.probes()),
            controller,
            tick: 0,
            sampled: 0,
            consumed: 0,
        }
    }

    /// The tick that comes next.
    #[must_use]
    pub fn tick(&self) -> usize {
        self.tick
    }

    /// One tick, between whose inputs and outputs only the controller works; `None` at the end of the tape,
    /// else whether it gave the bits that were recorded.
    pub fn step(&mut self, observer: &mut impl StageObserver) -> Option<bool> {
        let noted = self.tape.ticks.get(self.tick)?;
        let inputs = TickInputs {
            tick: self.tick as u64,
            samples: &self.tape.samples[self.sampled..noted.sampled],
            station: noted.station,
            chunks: [&self.tape.chunks[self.consumed..noted.arrived], &[]],
            stopping: false,
        };
        self.controller.tick(&inputs, &mut self.outputs, observer);
        self.consumed += self.outputs.chunks_consumed;
        self.sampled = noted.sampled;
        self.tick += 1;
        Some(self.controller.replay_hash() == noted.replay_hash)
    }
}
