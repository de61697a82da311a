//! One seed's run: the cores, the faults as they were drawn, and the checks.

mod cover;
pub mod quiet;
#[cfg(test)]
mod tests;

use super::conversation::Conversation;
use super::coverage::Coverage;
use super::deep;
use super::hands::{HOVER_TICKS, LIFT_TICKS};
use super::kind::Kind;
use super::library::{Bytes, Library};
use super::scenario::{BEFORE_HOLD_TICKS, Event, HOLD_TICKS, Scenario};
use super::side::{DEVICE_MAX_N, Side};
use super::trace::{Checked, Trace, ensure};
use crate::failure::Failure;
use glam::DVec3;
use haptic_device::MotionLimits;
use hrtc_core::streaming::subscriber::Identity;
use hrtc_core::{Fault, ModelFrame, NoObserver};
use protocol::{Hello, Role};
use simulator::{
    Client, ClientOptions, Drive, LinkModel, Random, STATION, SampleModel, Simulation, station,
};
use station_core::station::Station;

/// Ticks between two looks at everything.
const DEEP_TICKS: u64 = 100;
/// Length of the tours that are asked for, seconds.
const TOUR_S: f64 = 1.0;
/// Way of a hand in a tick to where it touches, once the object is there, metres.
const DESCENT_M: f64 = 1e-4;
/// How many times slower a processor gets at the most.
const SLOWEST: f64 = 4.0;
/// Least share of the cache that a limit leaves.
const LOWEST_LIMIT: f64 = 0.1;
/// Number of the first controller at the station.
const FIRST_CLIENT: u64 = 7;
/// Ticks by which a last press may be held longer, so that contact is half of the run: also where
/// a fault from the first tick on lets no hand touch before it.
const LONGER_TICKS: u64 = BEFORE_HOLD_TICKS + BEFORE_HOLD_TICKS / 10 - HOLD_TICKS;
/// Share of a whole run in contact, up to which its last press is held.
const CONTACT: f64 = 0.5;
/// Share of the time with faults in contact, below which a run has tested little: of what hands do
/// (see `hands`), nine tenths of the time are pressed in on the average.
const CONTACT_IN_FAULTS: f64 = 0.1;
/// Kinds that take the touch away, or let none begin, for as long as they please.
const WITHOUT_TOUCH: [Kind; 10] = [
    Kind::Damage,
    Kind::Cut,
    Kind::StationDown,
    Kind::OtherVersion,
    Kind::Rebuilt,
    Kind::ControllerRestart,
    Kind::Missing,
    Kind::SmallCache,
    Kind::Early,
    Kind::OtherScene,
];

/// See the module.
pub struct Run<'a> {
    /// The run, drawn.
    pub scenario: &'a Scenario,
    /// Models.
    pub library: &'a Library,
    /// Both cores.
    pub simulation: Simulation<Bytes>,
    /// The controllers.
    pub sides: Vec<Side>,
    /// What was reached.
    pub coverage: Coverage,
    /// Whether the station serves rebuilt models.
    pub is_rebuilt: bool,
    conversation: Conversation,
    random: Random,
    incarnation: u64,
    /// Ends of what lasts: the events that are on.
    lasting: Vec<Event>,
    is_quiet: bool,
    /// Ticks of all controllers, and those in contact, when the faults began and when they ended.
    at_faults: [[u64; 2]; 2],
}

/// What a run was like.
#[derive(Debug, Clone, Default)]
pub struct Outcome {
    /// Ticks of all controllers.
    pub ticks: u64,
    /// Of them in contact.
    pub contact: u64,
    /// Share in contact while faults were on; none where the run does not come to their end, or has
    /// a kind that takes the touch away.
    pub contact_in_faults: Option<f64>,
    /// Virtual time, ticks.
    pub length: u64,
    /// Largest work of the queries of a tick.
    pub query_work_max: u32,
    /// Hash over all outputs.
    pub hash: u64,
    /// What was reached.
    pub coverage: Coverage,
}

fn failed(failure: &Failure) -> (&'static str, String) {
    ("set-up", failure.to_string())
}

/// The forces on the probes of a controller, newtons.
#[must_use]
pub fn forces_of(client: &Client) -> Vec<DVec3> {
    let wrenches = client.outputs().wrenches.iter();
    wrenches.map(|wrench| wrench.force).collect()
}

/// The station of a scenario.
///
/// # Errors
/// When a model is not served.
pub fn new_station(
    scenario: &Scenario,
    library: &Library,
    is_rebuilt: bool,
    incarnation: u64,
) -> Result<Station<Bytes>, Failure> {
    let served = library.served(&scenario.plan, is_rebuilt)?;
    station(&scenario.plan, served, incarnation)
        .ok_or_else(|| Failure::Run("the station does not serve every model".to_string()))
}

/// A controller of a scenario.
#[must_use]
pub fn new_client(scenario: &Scenario, k: usize, incarnation: u64) -> Client {
    let options = ClientOptions {
        identity: Identity {
            client: FIRST_CLIENT + k as u64,
            incarnation,
        },
        device_max_n: DEVICE_MAX_N,
        tour_s: TOUR_S,
        link: LinkModel::default(),
        station_is_far: false,
        link_seed: scenario.seed ^ (k as u64) << 32 ^ incarnation << 40,
    };
    let mut client = Client::new(&scenario.plan, options);
    for probe in 0..scenario.plan.probes.len() {
        client
            .controller_mut()
            .set_motion_limits(probe, MotionLimits::HAND);
    }
    // As in the product: the devices go to zero in a long stall.
    client.expire_commands();
    client
}

impl<'a> Run<'a> {
    /// Before the first tick.
    ///
    /// # Errors
    /// When the scene cannot be served.
    pub fn new(scenario: &'a Scenario, library: &'a Library) -> Result<Self, Failure> {
        let count = scenario.hands.len();
        let station = new_station(scenario, library, false, STATION)?;
        let mut simulation = Simulation::new(station, new_client(scenario, 0, 1));
        for k in 1..count {
            simulation = simulation.with(new_client(scenario, k, 1));
        }
        let mut sides: Vec<Side> = (0..count).map(|_| Side::new(scenario)).collect();
        for (side, client) in sides.iter_mut().zip(simulation.clients_mut()) {
            if let Some(processor) = &mut side.processor {
                processor.start(client);
            }
        }
        Ok(Self {
            scenario,
            library,
            simulation,
            sides,
            coverage: Coverage::default(),
            is_rebuilt: false,
            conversation: Conversation::default(),
            random: Random::new(scenario.seed ^ 0xDEEB),
            incarnation: STATION,
            lasting: Vec::new(),
            is_quiet: false,
            at_faults: [[0; 2]; 2],
        })
    }

    /// The whole run.
    ///
    /// # Errors
    /// The first check that does not hold.
    ///
    /// # Panics
    /// When an invariant of the cores does not hold.
    pub fn all(&mut self, trace: &mut Trace) -> Result<Outcome, (&'static str, String)> {
        let mut end = self.scenario.ticks;
        let is_whole = self.scenario.is_whole;
        loop {
            let tick = self.simulation.tick();
            if tick >= end {
                let may_go_on = is_whole && end < self.scenario.ticks + LONGER_TICKS;
                if !may_go_on || self.contact_share() >= CONTACT + 0.01 {
                    break;
                }
                end += DEEP_TICKS;
            }
            trace.tick = tick;
            self.change(tick, trace)?;
            self.tick(tick, trace)?;
        }
        if is_whole {
            self.look(trace)?;
            quiet::check(self, trace)?;
            let share = self.contact_share();
            // The press at the end is held until it is so, so a touch that ends there is not.
            ensure(share >= CONTACT, "held at the end", || {
                format!("in contact {:.1} % of the time", 100.0 * share)
            })?;
            let share = self.contact_in_faults().unwrap_or(1.0);
            ensure(
                share >= CONTACT_IN_FAULTS,
                "touched during the faults",
                || format!("in contact {:.1} % of their time", 100.0 * share),
            )?;
        }
        Ok(self.outcome())
    }

    fn contact_share(&self) -> f64 {
        let [ticks, contact] = self.sum();
        contact as f64 / ticks.max(1) as f64
    }

    fn contact_in_faults(&self) -> Option<f64> {
        let is_judged = self.is_quiet && !WITHOUT_TOUCH.iter().any(|&of| self.scenario.has(of));
        let [[from, touched], [to, then]] = self.at_faults;
        is_judged.then(|| (then - touched) as f64 / (to - from).max(1) as f64)
    }

    fn sum(&self) -> [u64; 2] {
        let sum = |k: usize| self.sides.iter().map(|side| side.ticks[k]).sum();
        [sum(0), sum(1)]
    }

    fn outcome(&mut self) -> Outcome {
        for client in self.simulation.clients_mut() {
            self.coverage.link.add(&client.link().counts());
        }
        let [ticks, contact] = self.sum();
        let work = self.sides.iter().map(|side| side.watch.query_work_max);
        Outcome {
            ticks,
            contact,
            contact_in_faults: self.contact_in_faults(),
            length: self.simulation.tick(),
            query_work_max: work.max().unwrap_or(0),
            hash: self.simulation.hash(),
            coverage: self.coverage.clone(),
        }
    }

    // --- what happens --------------------------------------------------------------------------

    /// What begins and ends at a tick.
    fn change(&mut self, tick: u64, trace: &mut Trace) -> Checked {
        let scenario = self.scenario;
        let [from, to] = scenario.faulty;
        if tick == from {
            self.at_faults[0] = self.sum();
            self.disturb(scenario.link, scenario.samples);
            trace.event(format!(
                "faults on: {:?}; {:?}",
                scenario.link, scenario.samples
            ));
        }
        let ended = |event: &Event| event.to <= tick;
        let over: Vec<Event> = self.lasting.iter().copied().filter(ended).collect();
        self.lasting.retain(|event| event.to > tick);
        for event in over {
            self.end(event, trace)?;
        }
        if tick == to {
            self.be_quiet(trace)?;
        }
        let begins = |event: &&Event| event.from == tick;
        let starts: Vec<Event> = scenario.events.iter().filter(begins).copied().collect();
        for event in starts {
            self.begin(event, trace)?;
        }
        Ok(())
    }

    fn disturb(&mut self, link: LinkModel, samples: SampleModel) {
        for (k, client) in (0u64..).zip(self.simulation.clients_mut()) {
            let seed = self.random.bits() ^ k;
            client.link().disturb(link, seed);
            client.disturb_samples(samples, seed);
        }
    }

    fn begin(&mut self, event: Event, trace: &mut Trace) -> Checked {
        let Event { kind, client, .. } = event;
        trace.event(format!(
            "{} of controller {client}, until {}",
            kind.name(),
            event.to
        ));
        let is_of_one = matches!(
            kind,
            Kind::Cut
                | Kind::ControllerRestart
                | Kind::Stalls
                | Kind::OtherScene
                | Kind::Processor
                | Kind::CacheLimit
        );
        let touching = self.sides.iter().enumerate();
        let met = touching.filter(|(k, side)| side.is_touching && (*k == client || !is_of_one));
        self.coverage.met(kind, met.count() as u64);
        match kind {
            Kind::Cut => self.simulation.clients_mut()[client].link().cut(true),
            Kind::StationSilent => self.simulation.mute_station(true),
            Kind::StationRestart => self.start_station()?,
            Kind::StationDown => drop(self.simulation.stop_station()),
            Kind::OtherScene => {
                self.incarnation += 1;
                let other = Station::new(self.incarnation, Vec::new(), Vec::new());
                self.place_station(other);
                self.restart_client(client);
            }
            Kind::OtherVersion => {
                self.simulation.stop_station();
                let hello = Hello::of_version(u32::MAX, Role::Station, self.incarnation, 0);
                ensure(hello.read().is_err(), "hello of another version", || {
                    format!("{hello:?} is believed")
                })?;
            }
            Kind::Rebuilt => {
                self.is_rebuilt = !self.is_rebuilt;
                self.start_station()?;
            }
            Kind::ControllerRestart => self.restart_client(client),
            Kind::Stalls => self.sides[client].stalls_until = event.to,
            Kind::Processor => {
                let slow = SLOWEST.powf(self.random.unit());
                if let Some(processor) = &mut self.sides[client].processor {
                    processor.slow_down(slow);
                }
            }
            Kind::CacheLimit => {
                let share = LOWEST_LIMIT.powf(self.random.unit());
                self.limit_cache(client, share);
            }
            Kind::Tolerance => {
                let tolerance_m = 1e-4 * self.random.unit();
                for client in self.simulation.clients_mut() {
                    client.controller_mut().set_tolerance(tolerance_m);
                }
            }
            _ => {}
        }
        let is_instant = matches!(
            kind,
            Kind::StationRestart | Kind::Rebuilt | Kind::ControllerRestart
        );
        if !is_instant {
            self.lasting.push(event);
        }
        Ok(())
    }

    fn end(&mut self, event: Event, trace: &mut Trace) -> Checked {
        trace.event(format!(
            "{} of controller {} ends",
            event.kind.name(),
            event.client
        ));
        let is_on = |kind| self.lasting.iter().any(|other| other.kind == kind);
        let away = [Kind::StationDown, Kind::OtherVersion, Kind::OtherScene];
        match event.kind {
            Kind::Cut => self.simulation.clients_mut()[event.client]
                .link()
                .cut(false),
            Kind::StationSilent => self.simulation.mute_station(is_on(Kind::StationSilent)),
            kind if away.contains(&kind) && !away.into_iter().any(is_on) => {
                self.start_station()?;
            }
            Kind::Tolerance => self.ask_for_what_the_scene_asks(),
            Kind::CacheLimit => self.limit_cache(event.client, 1.0),
            Kind::Processor => {
                if let Some(processor) = &mut self.sides[event.client].processor {
                    processor.slow_down(1.0);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Lets a controller use a share of its cache from now on.
    fn limit_cache(&mut self, client: usize, share: f64) {
        let bytes = (share * self.scenario.plan.cache_bytes as f64) as usize;
        let client = &mut self.simulation.clients_mut()[client];
        client.controller_mut().set_cache_limit(bytes);
    }

    fn ask_for_what_the_scene_asks(&mut self) {
        let tolerance_m = self.scenario.plan.accuracy.tolerance_m;
        for client in self.simulation.clients_mut() {
            client.controller_mut().set_tolerance(tolerance_m);
        }
    }

    fn start_station(&mut self) -> Checked {
        self.incarnation += 1;
        let new = new_station(
            self.scenario,
            self.library,
            self.is_rebuilt,
            self.incarnation,
        );
        self.place_station(new.map_err(|failure| failed(&failure))?);
        Ok(())
    }

    fn place_station(&mut self, station: Station<Bytes>) {
        self.simulation.start_station(station);
        self.conversation.restart_station();
    }

    fn restart_client(&mut self, k: usize) {
        let side = &mut self.sides[k];
        side.restart(self.simulation.tick(), &self.scenario.hands[k]);
        let mut client = new_client(self.scenario, k, side.incarnation);
        self.conversation.restart_client(client.identity().client);
        let old = &mut self.simulation.clients_mut()[k];
        self.coverage.link.add(&old.link().counts());
        if !self.is_quiet && self.simulation.tick() >= self.scenario.faulty[0] {
            let seed = self.random.bits();
            client.link().disturb(self.scenario.link, seed);
            client.disturb_samples(self.scenario.samples, seed);
        }
        if let Some(processor) = &mut self.sides[k].processor {
            processor.start(&mut client);
        }
        let is_cut = self.simulation.clients_mut()[k].link().is_cut();
        client.link().cut(is_cut);
        self.simulation.clients_mut()[k] = client;
    }

    /// The faults end. A controller that met another model is started again, as its message says.
    fn be_quiet(&mut self, trace: &mut Trace) -> Checked {
        for event in std::mem::take(&mut self.lasting) {
            self.end(event, trace)?;
        }
        if self.simulation.station().is_none() {
            self.start_station()?;
        }
        self.is_quiet = true;
        self.at_faults[1] = self.sum();
        self.disturb(LinkModel::default(), SampleModel::default());
        self.ask_for_what_the_scene_asks();
        for k in 0..self.sides.len() {
            self.sides[k].stalls_until = 0;
            let fault = self.simulation.clients()[k].controller().fault();
            let by_right = self.scenario.has(Kind::Rebuilt) || self.scenario.has(Kind::Damage);
            if by_right {
                trace.event(format!("controller {k} is started again"));
                self.restart_client(k);
                self.sides[k].belief.is_true = true;
            } else {
                // A station of another scene has only just been replaced.
                let is_over =
                    fault == Some(Fault::UnknownModel) && self.scenario.has(Kind::OtherScene);
                ensure(fault.is_none() || is_over, "no fault of its own", || {
                    format!("{fault:?}")
                })?;
            }
        }
        trace.event("the faults end".to_string());
        Ok(())
    }

    // --- a tick --------------------------------------------------------------------------------

    fn tick(&mut self, tick: u64, trace: &mut Trace) -> Checked {
        let drives: Vec<Option<Drive<'_>>> = self
            .sides
            .iter()
            .map(|side| (side.stalls_until <= tick).then_some(Drive::Hands))
            .collect();
        for (k, drive) in drives.iter().enumerate() {
            // One that is started within a stall has its first tick after it.
            if drive.is_some() || !self.sides[k].is_new {
                self.lead(tick, k);
            }
        }
        self.simulation.advance_each(&drives, &mut NoObserver);
        self.conversation.check_station(&self.simulation)?;
        for k in (0..self.sides.len()).filter(|&k| drives[k].is_some()) {
            trace.client = k;
            trace.tick_of(k, &self.simulation.clients()[k], self.sides.len());
            self.check(tick, k)?;
            if tick.is_multiple_of(DEEP_TICKS) {
                self.look_at(k)?;
            }
        }
        Ok(())
    }

    /// Moves the hands of a controller on.
    fn lead(&mut self, tick: u64, k: usize) {
        if std::mem::take(&mut self.sides[k].is_new) {
            return;
        }
        let plan = &self.scenario.plan;
        let client = &mut self.simulation.clients_mut()[k];
        for (probe, path) in self.scenario.hands[k].iter().enumerate() {
            let object = path.object;
            let model = self.scenario.models[object];
            // Before it is felt, the hand waits over what will be.
            let held = client.controller().header_of(object).map(|of| of.model);
            let rebuilt = self.library.version(model, true).hash();
            let is_rebuilt = held.map_or(self.is_rebuilt, |held| held == rebuilt);
            let known = client.controller().frame_of(object);
            let frame = known.unwrap_or_else(|| {
                let of = &plan.objects[object];
                let version = self.library.version(model, is_rebuilt);
                // An object that moves does so before its model is known.
                let body = client.controller().movables().body(object as u32);
                let pose = body.map_or(of.pose, |body| body.pose());
                ModelFrame::new(pose, of.scale, &version.model.file.model_header())
            });
            let raised_m = &mut self.sides[k].raised_m[probe];
            let active = client.controller().active_object(object);
            if active.is_some_and(|of| of.is_ready()) {
                *raised_m = (*raised_m - DESCENT_M).max(0.0);
            }
            let height_m = plan.probes[probe].shape.tip_m() + *raised_m;
            let turns = self.scenario.has(Kind::Tools);
            let tick = tick.max(self.sides[k].waits_until[probe]);
            let pose = path.pose(tick, (&frame, is_rebuilt), height_m, turns);
            client.hand(probe).hold_at(Some(pose));
        }
    }

    /// The checks of every tick, and what was reached.
    fn check(&mut self, tick: u64, k: usize) -> Checked {
        let (side, client) = (&mut self.sides[k], &mut self.simulation.clients_mut()[k]);
        let periods = side.last_tick.map_or(1, |last| tick - last);
        side.last_tick = Some(tick);
        let probes = 0..self.scenario.plan.probes.len();
        let devices: Vec<_> = probes.map(|probe| client.hand(probe).state()).collect();
        side.watch.moved(&devices, periods)?;
        side.watch.check(client)?;
        if let Some(processor) = &mut side.processor {
            processor.tick(client)?;
        }
        self.conversation.check_client(client)?;
        let record = client.outputs().record;
        side.is_touching = record.contact;
        side.ticks[0] += 1;
        side.ticks[1] += u64::from(record.contact);
        if self.is_quiet {
            side.samples.push(client.samples().to_vec());
            side.forces.push(forces_of(client));
            if side.samples.len() as u64 == LIFT_TICKS + HOVER_TICKS {
                let contacts = client.outputs().contacts.iter();
                side.held = contacts.map(Option::is_some).collect();
            }
        }
        self.cover(tick, k);
        Ok(())
    }

    fn look_at(&mut self, k: usize) -> Checked {
        let client = &self.simulation.clients()[k];
        let (plan, belief) = (&self.scenario.plan, self.sides[k].belief);
        deep::check(client, plan, self.library, belief, &mut self.random)
    }

    fn look(&mut self, trace: &mut Trace) -> Checked {
        for k in 0..self.sides.len() {
            trace.client = k;
            self.look_at(k)?;
        }
        Ok(())
    }
}
