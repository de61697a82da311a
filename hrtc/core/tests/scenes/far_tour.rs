//! A tour over a thin line: it comes once, whatever ends an epoch, and keeps nothing waiting.

use crate::common::{Place, World, places_on_tour, plan, spm, station, world};
use protocol::{ChunkHeader, ChunkKind, TourPoint};
use simulator::{Client, ClientOptions, LinkModel, STATION, Simulation};
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};
use std::collections::BTreeMap;

/// Seconds of the tour.
const TOUR_S: f64 = 20.0;
/// Bytes a tick of 0.25 Mbit/s.
const THIN: f64 = 31.25;
/// Ticks within which anything arrives.
const MAX_START: u64 = 30_000;
/// Ticks for which the hand stays at a place while it waits.
const STAY: u64 = 6000;
/// Batches of a tunnel, bytes.
const BATCH_BYTES: usize = 8192;
/// Ticks for which everything is lost.
const LOST: u64 = 100;
/// Bytes of a point at the most, with heads of chunks; 64 are in memory.
const MAX_POINT_BYTES: f64 = 41.0;
/// Chunks of a tour that may be before an answer: a third of what may be under way.
const MAX_TOURS: u64 = 5;
/// Ticks on the line at the most from the station to the controller, beside the wire's delay.
const MAX_QUEUE: u64 = 500;

fn model() -> Vec<u8> {
    let mesh = generate(Shape::Relief, 60_000, 1);
    spm(mesh, &BuildOptions::default())
}

/// A thin line to a station far away.
fn thin(round_trip_ticks: u64) -> LinkModel {
    LinkModel {
        delay_ticks: round_trip_ticks / 2,
        bytes_per_tick: THIN,
        batch_bytes: BATCH_BYTES,
        is_compact: true,
        ..LinkModel::default()
    }
}

/// A world, and what its line brought.
struct Run {
    world: World,
    places: [Place; 3],
    /// Tick when the station sent each chunk of an epoch.
    sent: BTreeMap<(u64, u32, u64), u64>,
    /// Longest way of a chunk, ticks.
    longest_way: u64,
    /// Points of the tour that came, repeated ones too.
    points: u64,
    /// Most chunks of the tour that came in a row while the station owed an answer, and those that
    /// came last.
    most_tours: u64,
    tours: u64,
}

fn key(header: &ChunkHeader) -> (u64, u32, u64) {
    (header.station, header.epoch, header.sequence)
}

impl Run {
    fn begin(model: &[u8], link: LinkModel) -> Self {
        let plan = plan("");
        let options = ClientOptions {
            tour_s: TOUR_S,
            link,
            station_is_far: true,
            ..ClientOptions::default()
        };
        let station = station(&plan, model, STATION);
        Self {
            world: Simulation::new(station, Client::new(&plan, options)),
            places: places_on_tour(&plan, model, [1.0, 3.0, 6.0]),
            sent: BTreeMap::new(),
            longest_way: 0,
            points: 0,
            most_tours: 0,
            tours: 0,
        }
    }

    fn is_whole(&self) -> bool {
        self.world.controller().tour().is_some()
    }

    fn tour(&self) -> &[TourPoint] {
        self.world.controller().tour().expect("it is whole")
    }

    /// A tick in which the hand waits, first here and then there.
    fn wait(&mut self) {
        let place = self.places[(self.world.tick() / STAY) as usize % self.places.len()];
        self.tick(|world| _ = world.step_held(place.above));
    }

    fn tick(&mut self, step: impl FnOnce(&mut World)) {
        let tick = self.world.tick();
        assert!(tick < MAX_START, "the tour arrives");
        step(&mut self.world);
        for header in self.world.said() {
            self.sent.insert(key(header), tick);
        }
        if self.world.outputs().record.synchronised {
            self.tours = 0;
        }
        for header in self.world.client().arrived() {
            if let Some(sent) = self.sent.get(&key(header)) {
                self.longest_way = self.longest_way.max(tick - sent);
            }
            if header.kind == ChunkKind::Tour as u32 {
                self.points += u64::from(header.count);
                self.tours += 1;
            } else if header.kind == ChunkKind::Answers as u32 {
                self.tours = 0;
            }
            self.most_tours = self.most_tours.max(self.tours);
        }
    }

    fn wait_for_half(&mut self) {
        while 2 * self.points < (TOUR_S / 0.005) as u64 {
            self.wait();
        }
        assert!(!self.is_whole());
    }

    fn wait_for_all(&mut self) {
        while !self.is_whole() {
            self.wait();
        }
    }

    /// Ticks until the tour touches for the first time.
    fn touch(&mut self) -> u64 {
        let begin = self.world.tick();
        while !self.world.step_led().record.contact {
            assert!(self.world.tick() < begin + MAX_START, "the tour touches");
        }
        self.world.tick() - begin
    }
}

/// The tour, and ticks until it touches, without a line.
fn truth(model: &[u8]) -> (Vec<TourPoint>, u64) {
    let mut world = world(&plan(""), model, TOUR_S);
    while world.controller().tour().is_none() {
        world.step_led();
    }
    let points = world.controller().tour().expect("it is whole").to_vec();
    let begin = world.tick();
    while !world.step_led().record.contact {}
    (points, world.tick() - begin)
}

#[test]
fn a_tour_over_a_thin_line_begins_once_and_fills_the_line() {
    let model = model();
    let (points, approach) = truth(&model);
    for round_trip in [20, 100] {
        let mut run = Run::begin(&model, thin(round_trip));
        let (mut ready, mut before) = (0, 0);
        while !run.is_whole() {
            let is_ready = run.world.outputs().record.ready;
            // Without a hand nothing but the tour is asked for.
            run.tick(|world| _ = world.step(None));
            if !is_ready {
                ready = run.world.tick();
                before = run.world.client_mut().link().bytes_down();
            }
        }
        let ticks = run.world.tick() - ready;
        let bytes = run.world.client_mut().link().bytes_down() - before;
        let each = bytes as f64 / points.len() as f64;
        let on_line = bytes as f64 / THIN;
        let touch = run.touch();
        println!(
            "{round_trip} ms: the tour {ticks} ticks after the base mesh, {on_line:.0} on the line for {each:.1} bytes a point; first touch {touch} ticks later, locally {approach}; longest way {} ticks",
            run.longest_way,
        );
        assert!(run.tour() == points, "{round_trip} ms: the same to the bit");
        assert_eq!(run.world.summary().last.resubscribed, 0, "one epoch");
        assert_eq!(run.points, points.len() as u64, "none comes twice");
        assert!(each < MAX_POINT_BYTES, "{round_trip} ms: {each}");
        let most = 1.25 * on_line + 3.0 * round_trip as f64;
        assert!(ticks as f64 <= most, "{round_trip} ms: the line is busy");
        assert!(touch <= approach + MAX_QUEUE, "{round_trip} ms: {touch}");
        assert!(run.longest_way <= round_trip / 2 + MAX_QUEUE);
    }
}

/// The hand moves for 188 ticks before it touches; one that appeared where it begins to move would
/// not be full, even at 100 ms.
#[test]
fn a_hand_that_waits_where_its_tour_begins_lands_at_full_resolution() {
    let model = model();
    for round_trip in [100, 130, 160] {
        let line = LinkModel {
            bytes_per_tick: 8.0 * THIN,
            ..thin(round_trip)
        };
        let mut run = Run::begin(&model, line);
        let mut waits = 0;
        while !run.is_whole() {
            run.tick(|world| _ = world.step_led());
            let begins = run.world.controller().tour_begin_of(0).is_some();
            waits += u64::from(begins);
        }
        let moves = run.touch();
        println!("{round_trip} ms: the hand waits for {waits} ticks, and moves for {moves}");
        assert!(waits > round_trip, "{round_trip} ms: {waits}");
        assert!(
            run.world.outputs().record.contact_full,
            "{round_trip} ms: it lands after {moves} ticks"
        );
    }
}

#[test]
fn what_is_asked_for_does_not_wait_behind_a_tour() {
    let model = model();
    for round_trip in [20, 100] {
        let mut run = Run::begin(&model, thin(round_trip));
        run.wait_for_all();
        let vsps = run.world.outputs().record.vsps_received;
        println!(
            "{round_trip} ms: {vsps} VSPs before the tour was whole, answers behind at most {} chunks of it",
            run.most_tours,
        );
        assert_eq!(run.world.summary().last.resubscribed, 0, "one epoch");
        assert!(vsps > 1000, "{round_trip} ms: regions come meanwhile");
        assert!(run.most_tours <= MAX_TOURS, "{round_trip} ms");
    }
}

#[test]
fn a_tour_goes_on_after_a_restart_of_the_station_where_it_was() {
    let model = model();
    let (points, _) = truth(&model);
    for round_trip in [20, 100] {
        let mut run = Run::begin(&model, thin(round_trip));
        run.wait_for_half();
        run.world
            .start_station(station(&plan(""), &model, STATION + 1));
        run.wait_for_all();
        println!("{round_trip} ms: {} points came", run.points);
        assert!(run.tour() == points, "{round_trip} ms: the same to the bit");
        assert_eq!(run.world.summary().last.resubscribed, 1);
        assert_eq!(run.points, points.len() as u64, "none comes twice");
    }
}

#[test]
fn a_tour_goes_on_after_an_epoch_where_it_was() {
    let model = model();
    let (points, _) = truth(&model);
    for round_trip in [20, 100] {
        let mut run = Run::begin(&model, thin(round_trip));
        run.wait_for_half();
        // A chunk is lost, and those behind it are of no use.
        let lossy = LinkModel {
            loss: 1.0,
            ..thin(round_trip)
        };
        run.world.client_mut().link().set_model(lossy);
        (0..LOST).for_each(|_| run.wait());
        run.world.client_mut().link().set_model(thin(round_trip));
        run.wait_for_all();
        println!("{round_trip} ms: {} points came", run.points);
        assert!(run.tour() == points, "{round_trip} ms: the same to the bit");
        assert!(run.world.summary().last.resubscribed > 0);
        // What was under way comes again, and no more.
        let most = MAX_QUEUE as f64 * THIN / 37.0;
        assert!(run.points as f64 <= points.len() as f64 + most);
    }
}
