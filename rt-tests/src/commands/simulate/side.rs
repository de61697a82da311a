//! A controller of a run, with what is known about it.

use super::checks::Watch;
use super::deep::Belief;
use super::hands::{HOVER_M, HandPath};
use super::kind::Kind;
use super::processor::Processor;
use super::scenario::{Scenario, stream};
use glam::DVec3;
use haptic_device::Sample;

/// Largest force of the devices, newtons.
pub const DEVICE_MAX_N: f64 = 10.0;

/// A controller with what is known about it.
#[derive(Debug)]
pub struct Side {
    /// Checks of every tick.
    pub watch: Watch,
    /// What it runs on, where its speed changes.
    pub processor: Option<Processor>,
    /// What may be believed of it.
    pub belief: Belief,
    /// Starts so far.
    pub incarnation: u64,
    /// Ticks, and those in contact.
    pub ticks: [u64; 2],
    /// The tick before which it stalls.
    pub(super) stalls_until: u64,
    /// Its last tick.
    pub(super) last_tick: Option<u64>,
    /// Whether it touched after its last tick.
    pub(super) is_touching: bool,
    /// By how much each hand stays higher than its path, metres: until the object can be touched.
    pub(super) raised_m: Vec<f64>,
    /// The tick before which each hand waits over that tick's place of its path.
    pub(super) waits_until: Vec<u64>,
    /// Whether it has not begun its first tick, in which what moves comes to where it is by then.
    pub(super) is_new: bool,
    /// What its samples had gone through before this tick.
    pub(super) samples_before: [u64; 4],
    /// What its link had done to messages before this tick.
    pub(super) messages_before: [u64; 4],
    /// Which probes still touched at the end of the wait before the last press: a proxy on the far
    /// side of a thin part, through which the hand has gone.
    pub held: Vec<bool>,
    /// Forces on its probes in the quiet end, by tick, newtons.
    pub forces: Vec<Vec<DVec3>>,
    /// Its samples of the quiet end, by tick.
    pub samples: Vec<Vec<Option<Sample>>>,
}

impl Side {
    /// Before its first tick.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let plan = &scenario.plan;
        let has_accounts = [Kind::Effects, Kind::Movables, Kind::Tools]
            .iter()
            .all(|kind| !scenario.has(*kind));
        Self {
            watch: Watch::new(plan, DEVICE_MAX_N, scenario.samples.noise_m, has_accounts),
            processor: scenario.has(Kind::Processor).then(|| {
                let random = stream(scenario.seed ^ 0x5EED, Kind::Processor);
                let is_undisturbed = |kind: &Kind| {
                    *kind == Kind::Processor || (kind.is_of_scene() && *kind != Kind::SmallCache)
                };
                let only_it = scenario.kinds.iter().all(is_undisturbed);
                Processor::new(random, 1.0 / plan.loop_.rate_hz, only_it)
            }),
            belief: Belief {
                is_true: !scenario.has(Kind::Damage),
            },
            incarnation: 1,
            ticks: [0, 0],
            stalls_until: 0,
            last_tick: None,
            is_touching: false,
            raised_m: vec![HOVER_M; plan.probes.len()],
            waits_until: vec![0; plan.probes.len()],
            is_new: false,
            samples_before: [0; 4],
            messages_before: [0; 4],
            held: Vec::new(),
            forces: Vec::new(),
            samples: Vec::new(),
        }
    }

    /// It is started again at a tick. Nobody can tell on which side of a surface a hand is that
    /// begins inside: its user lets it begin in free space.
    pub(super) fn restart(&mut self, tick: u64, paths: &[HandPath]) {
        self.incarnation += 1;
        self.watch.restart();
        self.raised_m.fill(HOVER_M);
        self.is_new = true;
        for (until, path) in self.waits_until.iter_mut().zip(paths) {
            *until = path.next_open(tick);
        }
        self.samples_before = [0; 4];
        self.messages_before = [0; 4];
    }
}
