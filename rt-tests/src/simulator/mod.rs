//! Both pure cores in one process under a simulated clock: no thread, no transport, every run repeats bit by
//! bit and goes as fast as the machine can.
//!
//! | part | is |
//! |---|---|
//! | [`Simulator`] | a controller, a station, and a [`DelayLine`] each way; a step is a period |
//! | [`DelayLine`] | messages under way, each for a fixed number of periods |
//! | [`Hand`] | the simulated device, and the hand that leads it along a tour |
//! | [`InputRecording`] | every input of every tick, to put through a controller again |

mod hand;
mod line;
mod tape;

pub use hand::Hand;
pub use line::DelayLine;
pub use tape::{InputRecording, Playback};

use haptic_device::Sample;
use hrtc::connection::INBOX;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::streaming::subscriber::Identity;
use hrtc_core::{Controller, StageObserver, TickInputs, TickOutputs};
use protocol::{ChunkKind, ContactReport, Request};
use station_core::station::{Message, Station};

/// Periods that a message takes each way unless another delay is asked for.
pub const DELAY_TICKS: u64 = 2;
/// Incarnation of the first station of a run.
const STATION: u64 = 100;

/// Who the controller of a simulation is: the only client.
#[must_use]
pub fn identity() -> Identity {
    Identity {
        client: 7,
        incarnation: 8,
    }
}

/// Incarnation for the station of a simulation, which every chunk carries.
#[must_use]
pub fn station_incarnation() -> u64 {
    STATION
}

/// See the module.
#[derive(Debug)]
pub struct Simulator<D> {
    /// The controller.
    pub controller: Controller,
    /// The station.
    pub station: Station<D>,
    /// Index of the next tick.
    pub tick: u64,
    client: u64,
    requests: DelayLine<Request>,
    contacts: DelayLine<ContactReport>,
    chunks: DelayLine<InboxChunk>,
    inbox: Vec<InboxChunk>,
    outputs: TickOutputs,
    tape: Option<InputRecording>,
    mesh_bytes: u64,
    /// Whether the station is away.
    mute: bool,
}

impl<D: AsRef<[u8]>> Simulator<D> {
    /// Both cores on a link that takes `delay` periods each way.
    #[must_use]
    pub fn new(
        controller: Controller,
        identity: Identity,
        station: Station<D>,
        delay: u64,
    ) -> Self {
        let outputs = TickOutputs::new(controller.probes());
        Self {
            controller,
            station,
            tick: 0,
            client: identity.client,
            requests: DelayLine::new(delay),
            contacts: DelayLine::new(delay),
            chunks: DelayLine::new(delay),
            inbox: Vec::with_capacity(INBOX),
            outputs,
            tape: None,
            mesh_bytes: 0,
            mute: false,
        }
    }

    /// Takes the station away, with what is under way, or brings it back as it was.
    pub fn mute(&mut self, mute: bool) {
        self.mute = mute;
    }

    /// Records every input from now on; before the first step, or the tape is of no use.
    pub fn record(&mut self) {
        self.tape = Some(InputRecording::default());
    }

    /// What was recorded.
    pub fn take_tape(&mut self) -> Option<InputRecording> {
        self.tape.take()
    }

    /// One period with the sample of the only device.
    pub fn step(
        &mut self,
        sample: Option<Sample>,
        observer: &mut impl StageObserver,
    ) -> &TickOutputs {
        self.step_each(&[sample], observer)
    }

    /// One period with the samples of all devices.
    pub fn step_each(
        &mut self,
        samples: &[Option<Sample>],
        observer: &mut impl StageObserver,
    ) -> &TickOutputs {
        self.deliver();
        let inputs = TickInputs {
            tick: self.tick,
            samples,
            station: if self.mute {
                0
            } else {
                self.station.incarnation()
            },
            chunks: [&self.inbox, &[]],
            stopping: false,
        };
        self.controller.tick(&inputs, &mut self.outputs, observer);
        if let Some(tape) = &mut self.tape {
            tape.note(samples, inputs.station, self.outputs.record.replay_hash);
        }
        self.inbox.drain(..self.outputs.chunks_consumed);
        for request in self.outputs.outbox.requests() {
            self.requests.post(self.tick, *request);
        }
        for &report in &self.outputs.reports {
            self.contacts.post(self.tick, report);
        }
        self.tick += 1;
        &self.outputs
    }

    /// Bytes of the chunks that have arrived, without those that only tell a measured error.
    #[must_use]
    pub fn mesh_bytes(&self) -> u64 {
        self.mesh_bytes
    }

    /// What the last step gave.
    #[must_use]
    pub fn outputs(&self) -> &TickOutputs {
        &self.outputs
    }

    /// Hands over what is due, both ways.
    fn deliver(&mut self) {
        while let Some(request) = self.requests.take(self.tick) {
            if !self.mute {
                self.station.handle(Message::Request(&request));
            }
        }
        while let Some(report) = self.contacts.take(self.tick) {
            if !self.mute {
                self.station.handle(Message::Contact(&report));
            }
        }
        if self.mute {
            while self.chunks.take(self.tick).is_some() {}
            return;
        }
        while let Some((header, slots)) = self.station.poll(self.client) {
            self.chunks.post(self.tick, InboxChunk { header, slots });
        }
        while self.inbox.len() < INBOX {
            let Some(chunk) = self.chunks.take(self.tick) else {
                break;
            };
            if let Some(tape) = &mut self.tape {
                tape.arrived(chunk);
            }
            if chunk.header.kind != ChunkKind::Measured as u32 {
                self.mesh_bytes += size_of::<InboxChunk>() as u64;
            }
            self.inbox.push(chunk);
        }
    }
}
