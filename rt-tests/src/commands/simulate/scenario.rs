//! What a seed draws: which kinds of faults are on and how heavy, the scene, the hands, and what
//! happens when (swarm testing, Groce 2012: a seed with few kinds reaches what one with all does
//! not).
//!
//! Each kind draws from a stream of its own, so that dropping one leaves the others as they were.

use super::hands::{HOVER_TICKS, HandPath, LIFT_TICKS, PRESS_TICKS};
use super::kind::Kind;
use super::library::Library;
use super::scenes;
use super::standing_tool::StandingTool;
use crate::failure::Failure;
use scene::ScenePlan;
use simulator::{LinkModel, Random, SampleModel};
use std::collections::BTreeSet;

/// Ticks until which most runs have no fault: the models arrive and the hands touch.
const WARM_UP_TICKS: u64 = 600;
/// Shortest time with faults, ticks.
const MIN_FAULTY_TICKS: u64 = 3_200;
/// By how much longer it may be, ticks.
const FAULTY_TICKS_RANGE: u64 = 800;
/// Ticks for which the last press is held.
pub const HOLD_TICKS: u64 = 700;
/// Ticks before the last press is held, at the most.
pub const BEFORE_HOLD_TICKS: u64 =
    MIN_FAULTY_TICKS + FAULTY_TICKS_RANGE + LIFT_TICKS + HOVER_TICKS + PRESS_TICKS;
/// Share of the seeds that draw a kind, where nothing else is said.
const SHARE: f64 = 0.2;

/// What is left of a seed's run: everything, or what a failing run still needs to fail.
#[derive(Debug, Clone, PartialEq)]
pub struct Reduction {
    /// Kinds that may be on; `None` for all.
    pub only: Option<BTreeSet<Kind>>,
    /// Factor of all weights, 0 to 1.
    pub weight: f64,
    /// Ticks after which the run ends; `None` for its own length.
    pub ticks: Option<u64>,
}

impl Default for Reduction {
    fn default() -> Self {
        Self {
            only: None,
            weight: 1.0,
            ticks: None,
        }
    }
}

/// Something that begins at a tick and ends at another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    /// What.
    pub kind: Kind,
    /// The controller it concerns, where it concerns one.
    pub client: usize,
    /// Its first tick.
    pub from: u64,
    /// The first tick after it.
    pub to: u64,
}

/// A run, drawn.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// Its seed.
    pub seed: u64,
    /// The kinds that are on, ascending.
    pub kinds: BTreeSet<Kind>,
    /// The scene of every controller.
    pub plan: ScenePlan,
    /// Numbers of the models of its objects.
    pub models: Vec<usize>,
    /// Paths of the hands of each controller, one a probe.
    pub hands: Vec<Vec<HandPath>>,
    /// The link of every controller, during the faults.
    pub link: LinkModel,
    /// The devices, during the faults.
    pub samples: SampleModel,
    /// What happens, by its first tick.
    pub events: Vec<Event>,
    /// First tick with faults, and the first without.
    pub faulty: [u64; 2],
    /// Ticks, unless contact is too short by then.
    pub ticks: u64,
    /// Whether it comes to its end, where everything is to have converged.
    pub is_whole: bool,
}

impl Scenario {
    /// Draws a seed.
    ///
    /// # Errors
    /// When the scene is refused.
    pub fn draw(seed: u64, reduction: &Reduction, library: &Library) -> Result<Self, Failure> {
        let mut random = Random::new(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x5157);
        let kinds = draw_kinds(seed, &mut random, reduction);
        let length = MIN_FAULTY_TICKS + random.below(FAULTY_TICKS_RANGE);
        let start = if kinds.contains(&Kind::Early) {
            0
        } else {
            WARM_UP_TICKS
        };
        let of_kind = |kind| stream(seed, kind);
        let scene = scenes::draw(&kinds, random.bits(), library)?;
        let controllers = if kinds.contains(&Kind::Controllers) {
            2 + of_kind(Kind::Controllers).below(3) as usize
        } else {
            1
        };
        let mut hand = Random::new(random.bits());
        let objects = scene.plan.objects.len();
        let hands = (0..controllers).map(|_| {
            let probes = 0..scene.plan.probes.len();
            let paths = probes.map(|k| {
                let object = k % objects;
                let versions = [false, true].map(|of| library.version(scene.models[object], of));
                let depth_m = 1e-3 + 7e-3 * hand.unit();
                let tool = StandingTool::of_shape(&scene.plan.probes[k].shape);
                HandPath::draw(object, versions, tool.as_ref(), depth_m, length, &mut hand)
            });
            paths.collect()
        });
        let hands = hands.collect();
        let faults = Faults {
            seed,
            kinds: &kinds,
            weight: reduction.weight,
            window: [start, length],
            controllers,
        };
        let end = length + LIFT_TICKS + HOVER_TICKS + PRESS_TICKS + HOLD_TICKS;
        Ok(Self {
            seed,
            plan: scene.plan,
            models: scene.models,
            hands,
            link: faults.link(),
            samples: faults.samples(),
            events: faults.events(),
            faulty: [start, length],
            ticks: reduction.ticks.map_or(end, |ticks| ticks.min(end)),
            is_whole: reduction.ticks.is_none_or(|ticks| ticks >= end),
            kinds,
        })
    }

    /// Whether a kind is on.
    #[must_use]
    pub fn has(&self, kind: Kind) -> bool {
        self.kinds.contains(&kind)
    }
}

/// The stream of a kind.
pub fn stream(seed: u64, kind: Kind) -> Random {
    Random::new(seed.wrapping_mul(0x0100_0000_01B3) ^ (kind as u64 + 1).wrapping_mul(0xA5A5_A5A5))
}

/// The kinds of a seed: few or many.
fn draw_kinds(seed: u64, random: &mut Random, reduction: &Reduction) -> BTreeSet<Kind> {
    // From one kind in ten seeds to one in two.
    let share = SHARE * (0.5 + 2.0 * random.unit());
    let drawn = Kind::all().iter().copied().filter(|&kind| {
        let share = match kind {
            Kind::Early | Kind::Rebuilt | Kind::Damage => 0.5 * share,
            _ => share,
        };
        stream(seed, kind).happens(share)
    });
    let allowed = |kind: &Kind| reduction.only.as_ref().is_none_or(|of| of.contains(kind));
    drawn.filter(allowed).collect()
}

/// The faults of a seed.
struct Faults<'a> {
    seed: u64,
    kinds: &'a BTreeSet<Kind>,
    weight: f64,
    window: [u64; 2],
    controllers: usize,
}

impl Faults<'_> {
    /// Its stream beyond the draw of the kind itself, where it is on.
    fn of(&self, kind: Kind) -> Option<Random> {
        self.kinds.contains(&kind).then(|| {
            let mut random = stream(self.seed, kind);
            random.bits();
            random
        })
    }

    /// Up to a most, and mostly much less: the exponent is uniform over two decades.
    fn weighted(&self, random: &mut Random, most: f64) -> f64 {
        self.weight * most * 0.01_f64.powf(random.unit())
    }

    fn probability(&self, kind: Kind, most: f64) -> f64 {
        self.of(kind)
            .map_or(0.0, |mut random| self.weighted(&mut random, most))
    }

    fn link(&self) -> LinkModel {
        let mut link = LinkModel {
            loss: self.probability(Kind::Loss, 0.1),
            duplicates: self.probability(Kind::Duplicates, 0.3),
            reordering: self.probability(Kind::Reordering, 0.2),
            damage: self.probability(Kind::Damage, 0.1),
            is_compact: self.kinds.contains(&Kind::Compact),
            ..LinkModel::default()
        };
        if let Some(mut random) = self.of(Kind::Delay) {
            link.delay_ticks += self.weighted(&mut random, 80.0) as u64;
            link.jitter_ticks = 1 + self.weighted(&mut random, 60.0) as u64;
        }
        if let Some(mut random) = self.of(Kind::Bandwidth) {
            // 1 kB to 16 kB a tick: 1 to 16 MB/s.
            link.bytes_per_tick = 1e3 * 16f64.powf(random.unit()) / self.weight.max(1e-3);
        }
        link
    }

    fn samples(&self) -> SampleModel {
        let mut samples = SampleModel {
            noise_m: self.probability(Kind::Noise, 3e-5),
            spikes: self.probability(Kind::Spikes, 0.02),
            nonsense: self.probability(Kind::Nonsense, 0.02),
            silence: self.probability(Kind::Missing, 0.02),
            ..SampleModel::default()
        };
        if let Some(mut random) = self.of(Kind::Spikes) {
            random.bits();
            samples.spike_m = 10f64.powf(-3.0 + 4.0 * random.unit());
        }
        if let Some(mut random) = self.of(Kind::Missing) {
            random.bits();
            samples.silent_ticks = 1 + self.weighted(&mut random, 150.0) as u64;
        }
        samples
    }

    /// The events of each kind that has some, by their first tick.
    fn events(&self) -> Vec<Event> {
        // How often at the most, and for how many ticks at the most.
        let kinds = [
            (Kind::Cut, 3, 600),
            (Kind::StationSilent, 3, 600),
            (Kind::StationRestart, 3, 1),
            (Kind::StationDown, 2, 600),
            (Kind::OtherVersion, 1, 500),
            (Kind::Rebuilt, 1, 1),
            (Kind::ControllerRestart, 2, 1),
            (Kind::Stalls, 12, 120),
            (Kind::Tolerance, 4, 400),
            (Kind::OtherScene, 1, 300),
            (Kind::Processor, 3, 1_500),
            (Kind::CacheLimit, 3, 1_500),
        ];
        let mut events = Vec::new();
        for (kind, most, longest) in kinds {
            let Some(mut random) = self.of(kind) else {
                continue;
            };
            let count = 1 + random.below(most);
            for _ in 0..count {
                let [start, end] = self.window;
                let from = start + random.below(end - start);
                let length = (self.weighted(&mut random, longest as f64) as u64).max(1);
                events.push(Event {
                    kind,
                    client: random.below(self.controllers as u64) as usize,
                    from,
                    to: (from + length).min(end),
                });
            }
        }
        // The same model is not rebuilt while its station is away, and so on: one after another.
        events.sort_by_key(|event| (event.from, event.kind));
        events
    }
}
