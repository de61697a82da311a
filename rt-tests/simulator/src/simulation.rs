//! One station and its clients on a simulated clock.

use crate::client::{Client, Drive};
use crate::link::Upward;
use crate::summary::Summary;
use geometry::Pose;
use glam::DVec3;
use haptic_device::Sample;
use hrtc_core::record::CoreRecord;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::{Controller, NoObserver, StageObserver, TickOutputs};
use protocol::{ChunkHeader, Request};
use scene::ScenePlan;
use station_core::station::{Message, ServedModel, ServedObject, Station};

/// Incarnation of the first station of a run.
pub const STATION: u64 = 100;

/// A station of a scene's objects; `None` when the model of an object is not among those given.
#[must_use]
pub fn station<D: AsRef<[u8]>>(
    plan: &ScenePlan,
    models: Vec<ServedModel<D>>,
    incarnation: u64,
) -> Option<Station<D>> {
    let served = |name: &str| models.iter().position(|model| model.name == name);
    let objects = plan.objects.iter().map(|object| {
        let name = object.model.name();
        Some(ServedObject {
            model: served(&name)?,
            name: Request::name_hash(&name),
        })
    });
    let objects = objects.collect::<Option<Vec<_>>>()?;
    Some(Station::new(incarnation, models, objects))
}

/// One station, its clients, and the clock: a step is a period of the loop.
///
/// The station answers what is due at a tick before the clients tick.
#[derive(Debug)]
pub struct Simulation<D> {
    clients: Vec<Client>,
    station: Option<Station<D>>,
    is_mute: bool,
    tick: u64,
    asked: Vec<Request>,
    said: Vec<ChunkHeader>,
}

impl<D: AsRef<[u8]>> Simulation<D> {
    /// A station and its first client, before the first tick.
    #[must_use]
    pub fn new(station: Station<D>, client: Client) -> Self {
        Self {
            clients: vec![client],
            station: Some(station),
            is_mute: false,
            tick: 0,
            asked: Vec::new(),
            said: Vec::new(),
        }
    }

    /// The same with one more client.
    #[must_use]
    pub fn with(mut self, client: Client) -> Self {
        self.clients.push(client);
        self
    }

    /// The first client.
    #[must_use]
    pub fn client(&self) -> &Client {
        &self.clients[0]
    }

    /// The first client, to change it.
    pub fn client_mut(&mut self) -> &mut Client {
        &mut self.clients[0]
    }

    /// The clients.
    #[must_use]
    pub fn clients(&self) -> &[Client] {
        &self.clients
    }

    /// The clients, to change them.
    pub fn clients_mut(&mut self) -> &mut [Client] {
        &mut self.clients
    }

    /// The clients alone.
    #[must_use]
    pub fn into_clients(self) -> Vec<Client> {
        self.clients
    }

    /// The controller of the first client.
    #[must_use]
    pub fn controller(&self) -> &Controller {
        self.client().controller()
    }

    /// The controller of the first client, to change its settings.
    pub fn controller_mut(&mut self) -> &mut Controller {
        self.client_mut().controller_mut()
    }

    /// The outputs of the last tick of the first client.
    #[must_use]
    pub fn outputs(&self) -> &TickOutputs {
        self.client().outputs()
    }

    /// Counts and extremes of the first client.
    #[must_use]
    pub fn summary(&self) -> &Summary {
        self.client().summary()
    }

    /// The last force on the first probe of the first client, newtons.
    #[must_use]
    pub fn force(&self) -> DVec3 {
        self.summary().force()
    }

    /// The station; `None` while it is stopped.
    #[must_use]
    pub fn station(&self) -> Option<&Station<D>> {
        self.station.as_ref()
    }

    /// Requests that came to the station in the last period, those of a client in their order.
    #[must_use]
    pub fn asked(&self) -> &[Request] {
        &self.asked
    }

    /// Headers of the chunks that the station sent in the last period, after it had heard what
    /// that client asked.
    #[must_use]
    pub fn said(&self) -> &[ChunkHeader] {
        &self.said
    }

    /// Index of the next tick.
    #[must_use]
    pub fn tick(&self) -> u64 {
        self.tick
    }

    /// Hash over all outputs of all clients so far.
    #[must_use]
    pub fn hash(&self) -> u64 {
        let hashes = self.clients.iter().map(|of| of.controller().replay_hash());
        // FNV-1a over words.
        hashes.fold(0xCBF2_9CE4_8422_2325, |all, hash| {
            (all ^ hash).wrapping_mul(0x0100_0000_01B3)
        })
    }

    /// Lets periods go by in which no client ticks and the station does nothing.
    pub fn skip(&mut self, periods: u64) {
        self.tick += periods;
    }

    /// Silences the station, or lets it speak again as it was. Meanwhile no client sees it, and
    /// messages that are due are lost.
    pub fn mute_station(&mut self, is_mute: bool) {
        self.is_mute = is_mute;
    }

    /// Stops the station; messages under way are lost.
    pub fn stop_station(&mut self) -> Option<Station<D>> {
        self.clients.iter_mut().for_each(|of| of.link().clear());
        self.station.take()
    }

    /// Starts a station in the place of the one before, whose messages under way are lost.
    pub fn start_station(&mut self, station: Station<D>) {
        self.stop_station();
        self.station = Some(station);
    }

    /// One period with the sample of the only probe.
    pub fn step(&mut self, sample: Option<Sample>) -> &TickOutputs {
        self.step_each(&[sample])
    }

    /// One period with the samples of all probes of the first client.
    pub fn step_each(&mut self, samples: &[Option<Sample>]) -> &TickOutputs {
        self.advance(Drive::Samples(samples), &mut NoObserver)
    }

    /// One period with the probes of the first client at these poses.
    pub fn step_poses(&mut self, poses: &[Option<Pose>]) -> &TickOutputs {
        let samples: Vec<_> = poses.iter().map(|pose| pose.map(sample_at)).collect();
        self.step_each(&samples)
    }

    /// One period with the probes of the first client at these places.
    pub fn step_places(&mut self, places: &[Option<DVec3>]) -> &TickOutputs {
        let poses: Vec<_> = places.iter().map(|place| place.map(Pose::at)).collect();
        self.step_poses(&poses)
    }

    /// One period with the only probe at a place.
    pub fn step_at(&mut self, place: DVec3) -> &TickOutputs {
        self.step(Some(sample_at(Pose::at(place))))
    }

    /// One period with the hands along their paths.
    pub fn step_led(&mut self) -> &TickOutputs {
        self.advance(Drive::Hands, &mut NoObserver)
    }

    /// One period with the hand of the first probe at a place; the loop stays closed.
    pub fn step_held(&mut self, place: DVec3) -> &TickOutputs {
        self.client_mut().hand(0).hold_at(Some(Pose::at(place)));
        self.step_led();
        self.client_mut().hand(0).hold_at(None);
        self.outputs()
    }

    /// One period of the first client; the others, if any, stall.
    pub fn advance(&mut self, drive: Drive<'_>, observer: &mut impl StageObserver) -> &TickOutputs {
        self.advance_each(&[Some(drive)], observer);
        self.outputs()
    }

    /// One period of every client that is given a drive; the others stall: their messages wait.
    pub fn advance_each(
        &mut self,
        drives: &[Option<Drive<'_>>],
        observer: &mut impl StageObserver,
    ) {
        self.exchange();
        let station = self.incarnation();
        for (client, drive) in self.clients.iter_mut().zip(drives) {
            if let Some(drive) = drive {
                let station = if client.link().is_cut() { 0 } else { station };
                client.tick(self.tick, station, *drive, observer);
            }
        }
        self.tick += 1;
    }

    /// Steps with these samples until the model is there and the front of the first client has
    /// not changed for `quiet_ticks`; `None` when that takes more than `max_ticks`.
    pub fn settle(
        &mut self,
        samples: &[Option<Sample>],
        quiet_ticks: u64,
        max_ticks: u64,
    ) -> Option<CoreRecord> {
        let mut quiet = 0;
        for _ in 0..max_ticks {
            let before = self.outputs().record.vsps_received;
            let record = self.step_each(samples).record;
            let changes = record.vsplits + record.ecols + record.geomorphing;
            let is_same = record.ready && changes == 0 && record.vsps_received == before;
            quiet = if is_same { quiet + 1 } else { 0 };
            if quiet == quiet_ticks {
                return Some(record);
            }
        }
        None
    }

    /// The incarnation that clients see; 0 for none.
    fn incarnation(&self) -> u64 {
        let seen = self.station.as_ref().filter(|_| !self.is_mute);
        seen.map_or(0, Station::incarnation)
    }

    /// Gives the station what is due, and the links what it sends.
    fn exchange(&mut self) {
        let tick = self.tick;
        self.asked.clear();
        self.said.clear();
        // `as` to the larger first: it is to wrap, not to saturate.
        let clock_us = (1e6 * self.client().period_s() * tick as f64) as u64 as u32;
        let mut station = self.station.as_mut().filter(|_| !self.is_mute);
        if let Some(station) = &mut station {
            station.tell_time(clock_us);
        }
        for client in &mut self.clients {
            let Some(station) = station.as_mut().filter(|_| !client.link().is_cut()) else {
                client.link().lose_due(tick);
                continue;
            };
            while let Some(message) = client.link().upward.receive(tick) {
                station.handle(match &message {
                    Upward::Request(request) => Message::Request(request),
                    Upward::Report(report) => Message::Contact(report),
                });
                if let Upward::Request(request) = message {
                    self.asked.push(request);
                }
            }
            while let Some((header, slots)) = station.poll(client.identity().client) {
                self.said.push(header);
                let sizes = station.sizes(header.object);
                let chunk = InboxChunk { header, slots };
                client.link().send_down(tick, chunk, sizes);
            }
        }
    }
}

fn sample_at(pose: Pose) -> Sample {
    Sample::at(pose)
}
