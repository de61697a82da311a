//! What the counted work costs on this machine, measured before the first tick.
//!
//! The core is given the recorded inputs of a bundled scene (`patch.toml`: a ball and a tool on a
//! small relief), on the tick's core and with its rights, for [`CALIBRATION_NS`]. The time of each
//! stage beside what the costs of the reference machine say is the factor for the costs of that
//! stage ([`CostGroup`]). Between two ticks memory is read that pushes the patch out of the
//! processor's caches: in a run, a millisecond of other programs does. A tick in which another
//! program had the processor does not count, so that without real-time rights a busy machine is not
//! taken for a slow one. Stages have wall time all the same: asking for processor time takes longer
//! than some of them.

mod inputs;

pub use inputs::{InputsError, PatchInputs, PatchTick};

use crate::tuning::{
    CALIBRATION_BLOCK, CALIBRATION_NS, CALIBRATION_OTHERS_BYTES, CALIBRATION_OWN,
    CALIBRATION_WALL_NS,
};
use hrtc_core::governor::{CostGroup, WorkCosts};
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::streaming::subscriber::Identity;
use hrtc_core::{Controller, ControllerOptions, Stage, StageObserver, TickInputs, WrenchLimits};
use realtime::rights::{monotonic_ns, thread_cpu_ns};
use scene::{NoFiles, Overrides, ScenePlan, parse};
use std::hint::black_box;
use std::path::Path;

/// The scene of the patch.
pub const PATCH_SCENE: &str = include_str!("patch.toml");
/// Its inputs.
static PATCH: &[u8] = include_bytes!("patch.inputs");
/// The controller of the patch, as the station knew it.
pub const PATCH_IDENTITY: Identity = Identity {
    client: 7,
    incarnation: 8,
};
/// Largest force of its devices, newtons, and length of its tours, seconds.
pub const PATCH_DEVICE_N: f64 = 10.0;
/// See [`PATCH_DEVICE_N`].
pub const PATCH_SECONDS: f64 = 1.0;

/// What the groups take on the patch on the reference machine, as a part of
/// [`WorkCosts::REFERENCE`] (`rt-tests costs`, "patch"): a mesh in 16 MiB is farther away than the
/// patch. A tool of 960 faces on the dragon then takes 0.96 to 1.29 times what the costs say
/// (`governor.slowness` of three runs; 1.23 to 1.45 with 1.25 for queries, of older costs).
const PATCH_PARTS: [f64; CostGroup::ALL.len()] = [1.0, 0.85, 0.95, 0.8];
/// Numbers of 8 bytes in a line of the processor's caches.
const LINE: usize = 8;

/// Costs on this machine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// For each unit.
    pub costs: WorkCosts,
    /// How many times as long each group takes as on the reference machine.
    pub factors: [f64; CostGroup::ALL.len()],
    /// What each group took on the patch, as a part of the costs of the reference machine.
    pub patch: [f64; CostGroup::ALL.len()],
    /// Ticks that were timed, at least.
    pub ticks: usize,
}

/// The plan of the bundled scene.
///
/// # Errors
/// When the bundled scene is refused.
pub fn patch_plan() -> Result<ScenePlan, scene::SceneError> {
    let overrides = Overrides::default();
    parse(PATCH_SCENE, "patch", Path::new(""), &overrides, &NoFiles)
}

/// Measures on the calling thread. `slow`: how many times as long every stage is to take, for tests
/// of a slower machine. `None` when the bundled inputs do not fit this build.
#[must_use]
pub fn measure(slow: f64) -> Option<Measured> {
    let inputs = PatchInputs::from_bytes(PATCH).ok()?;
    let plan = patch_plan().ok()?;
    let timing = Timing::of_machine(slow);
    let mut blocks: Vec<[f64; CostGroup::ALL.len()]> = Vec::new();
    let mut ticks = 0;
    // Those before the caches are warm count too, and are too few to move the median.
    while play(&inputs, &plan, &timing, &mut |block| {
        ticks += CALIBRATION_BLOCK;
        blocks.push(block);
    }) {}
    if blocks.is_empty() {
        return None;
    }
    let patch: [f64; CostGroup::ALL.len()] =
        std::array::from_fn(|group| median(blocks.iter().map(|of| of[group])));
    let mut factors: [f64; CostGroup::ALL.len()] =
        std::array::from_fn(|group| patch[group] / PATCH_PARTS[group]);
    // Most of what every tick does is done in the shell: as much longer as the stages of the core.
    factors[CostGroup::Tick as usize] = median(factors[1..].iter().copied());
    let costs = WorkCosts::REFERENCE.scaled(factors);
    costs.is_valid().then_some(Measured {
        costs,
        factors,
        patch,
        ticks,
    })
}

/// The clocks of a measurement, and when it ends. A test has others.
struct Timing {
    /// How many times as long every stage is to take.
    slow: f64,
    /// Wall time and processor time of the thread, ns.
    clocks: [fn() -> u64; 2],
    /// When it ends by each, ns.
    ends: [u64; 2],
}

impl Timing {
    /// By the clocks of this machine, from now on.
    fn of_machine(slow: f64) -> Self {
        let clocks: [fn() -> u64; 2] = [monotonic_ns, thread_cpu_ns];
        let [wall, cpu] = clocks;
        Self {
            slow,
            clocks,
            ends: [wall() + CALIBRATION_WALL_NS, cpu() + CALIBRATION_NS],
        }
    }

    fn is_over(&self) -> bool {
        let mut clocks = self.clocks.iter().zip(self.ends);
        clocks.any(|(now, end)| now() > end)
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Plays the inputs once, and tells the factors of each block of touched ticks; whether there is
/// time for another pass.
fn play(
    inputs: &PatchInputs,
    plan: &ScenePlan,
    timing: &Timing,
    block: &mut impl FnMut([f64; CostGroup::ALL.len()]),
) -> bool {
    let options = ControllerOptions {
        limits: &[WrenchLimits::of_force(PATCH_DEVICE_N)],
        tour_seconds: PATCH_SECONDS,
    };
    let mut controller = Controller::new(plan, PATCH_IDENTITY, options);
    let mut outputs = controller.new_outputs();
    let mut waiting: Vec<InboxChunk> = Vec::new();
    let mut clock = GroupClock::new(timing);
    let mut charged = [0.0; CostGroup::ALL.len()];
    let mut in_block = 0;
    let others = vec![1u64; CALIBRATION_OTHERS_BYTES / size_of::<u64>()];
    let mut has_touched = false;
    for (tick, of) in (0u64..).zip(&inputs.ticks) {
        waiting.extend_from_slice(&of.chunks);
        let inputs = TickInputs {
            tick,
            samples: &of.samples,
            station: of.station,
            chunks: [&waiting, &[]],
            stopping: false,
        };
        if has_touched {
            black_box(others.iter().step_by(LINE).sum::<u64>());
        }
        let before = clock.ns;
        clock.begin_tick();
        controller.tick(&inputs, &mut outputs, &mut clock);
        let had_processor = clock.had_processor();
        waiting.drain(..outputs.chunks_consumed);
        has_touched |= outputs.record.contact;
        if !(outputs.record.contact && had_processor) {
            // What a touch costs is to be known.
            clock.ns = before;
            continue;
        }
        let spent = controller.governor().spent().by_group;
        charged
            .iter_mut()
            .zip(spent)
            .for_each(|(sum, ns)| *sum += ns);
        in_block += 1;
        // It goes on until it has work of every kind.
        if in_block >= CALIBRATION_BLOCK && charged.iter().all(|of| *of > 0.0) {
            block(std::array::from_fn(|k| clock.ns[k] as f64 / charged[k]));
            (charged, in_block, clock.ns) = ([0.0; 4], 0, [0; 4]);
            if timing.is_over() {
                return false;
            }
        }
    }
    // Inputs without a touch would be played for ever.
    !timing.is_over() && inputs.ticks.len() > CALIBRATION_BLOCK
}

/// Wall time of the stages of each group.
struct GroupClock<'a> {
    timing: &'a Timing,
    /// Wall time and processor time at the begin of the tick, ns.
    began: [u64; 2],
    last: u64,
    ns: [u64; CostGroup::ALL.len()],
}

impl<'a> GroupClock<'a> {
    fn new(timing: &'a Timing) -> Self {
        Self {
            timing,
            began: [0; 2],
            last: 0,
            ns: [0; CostGroup::ALL.len()],
        }
    }

    fn begin_tick(&mut self) {
        let [wall, cpu] = self.timing.clocks;
        // Asking lies within the processor time, so that it is no less than the wall time where the
        // thread keeps the processor.
        let cpu = cpu();
        self.last = wall();
        self.began = [self.last, cpu];
    }

    /// Whether the thread had the processor since the begin of the tick.
    fn had_processor(&self) -> bool {
        let [wall, cpu] = self.timing.clocks;
        let wall = wall().saturating_sub(self.began[0]);
        let cpu = cpu().saturating_sub(self.began[1]);
        wall as f64 <= CALIBRATION_OWN * cpu as f64
    }
}

impl StageObserver for GroupClock<'_> {
    fn ended(&mut self, stage: Stage) {
        let [wall, _] = self.timing.clocks;
        let now = wall();
        let group = match stage {
            Stage::BroadPhase | Stage::Force => CostGroup::Tick,
            Stage::Inbox => CostGroup::Inbox,
            Stage::Refine | Stage::Refit => CostGroup::Refine,
            Stage::Query => CostGroup::Query,
        };
        let taken = (self.timing.slow * (now - self.last) as f64) as u64;
        self.ns[group as usize] += taken;
        self.last = wall();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    #[test]
    fn the_bundled_tape_touches_and_refines_with_every_kind_of_work() {
        let inputs = PatchInputs::from_bytes(PATCH).expect("the inputs are of this build");
        let plan = patch_plan().expect("the scene is sound");
        let mut blocks = 0;
        play(&inputs, &plan, &endless(monotonic_ns), &mut |factors| {
            blocks += 1;
            assert!(
                factors.iter().all(|of| *of > 0.0 && of.is_finite()),
                "{factors:?}"
            );
        });
        assert!(blocks >= 4, "{blocks} blocks of touch");
    }

    /// A measurement without end by some wall clock.
    fn endless(wall: fn() -> u64) -> Timing {
        Timing {
            ends: [u64::MAX; 2],
            clocks: [wall, thread_cpu_ns],
            ..Timing::of_machine(1.0)
        }
    }

    /// As on a core that other threads keep busy: in every few ticks they have it again and again.
    #[test]
    fn the_time_of_other_programs_is_none_of_the_work() {
        thread_local! {
            static ASKED: Cell<[u64; 2]> = const { Cell::new([0; 2]) };
        }
        fn interrupted_ns() -> u64 {
            let [asked, lost] = ASKED.get();
            // A tick asks some 14 times, and a block has 16 ticks: each has some of both kinds.
            let lost = lost + 1_000_000_000 * u64::from(asked % 100 < 30);
            ASKED.set([asked + 1, lost]);
            monotonic_ns() + lost
        }
        let inputs = PatchInputs::from_bytes(PATCH).expect("the inputs are of this build");
        let plan = patch_plan().expect("the scene is sound");
        let factors = |wall: fn() -> u64| {
            let mut blocks = Vec::new();
            play(&inputs, &plan, &endless(wall), &mut |of| blocks.push(of));
            assert!(blocks.len() >= 2, "{} blocks of touch", blocks.len());
            [0, 1, 2, 3].map(|group| median(blocks.iter().map(|of: &[f64; 4]| of[group])))
        };
        let [alone, interrupted] = [monotonic_ns, interrupted_ns].map(factors);
        for (alone, interrupted) in alone.into_iter().zip(interrupted) {
            assert!(interrupted < 10.0 * alone, "{interrupted} and {alone}");
        }
    }

    #[test]
    fn a_machine_that_is_said_to_be_slower_measures_higher_costs() {
        let one = measure(1.0).expect("a measurement");
        let eight = measure(8.0).expect("a measurement");
        for (a, b) in one.factors.iter().zip(eight.factors) {
            assert!(b > 2.0 * a, "{a} and {b}");
        }
    }
}
