//! What the counted work costs on this machine, measured before the first tick.
//!
//! The core is given the recorded inputs of a bundled scene (`patch.toml`: a ball and a tool on a
//! small relief), on the tick's core and with its rights, for [`CALIBRATION_NS`]. The time of each
//! stage beside what the costs of the reference machine say is the factor for the costs of that
//! stage ([`CostGroup`]). Between two ticks memory is read that pushes the patch out of the
//! processor's caches: in a run, a millisecond of other programs does.

mod inputs;

pub use inputs::{InputsError, PatchInputs, PatchTick};

use crate::tuning::{CALIBRATION_BLOCK, CALIBRATION_NS, CALIBRATION_OTHERS_BYTES};
use hrtc_core::governor::{CostGroup, WorkCosts};
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::streaming::subscriber::Identity;
use hrtc_core::{Controller, Stage, StageObserver, TickInputs, TickOutputs};
use realtime::rights::monotonic_ns;
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
    /// Ticks that were timed.
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
    let until = monotonic_ns() + CALIBRATION_NS;
    let mut blocks: Vec<[f64; CostGroup::ALL.len()]> = Vec::new();
    let mut ticks = 0;
    // The first pass warms caches up.
    while play(&inputs, &plan, slow, until, &mut |block| {
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
    slow: f64,
    until: u64,
    block: &mut impl FnMut([f64; CostGroup::ALL.len()]),
) -> bool {
    let mut controller = Controller::new(plan, PATCH_IDENTITY, PATCH_DEVICE_N, PATCH_SECONDS);
    let mut outputs = TickOutputs::new(controller.probes());
    let mut waiting: Vec<InboxChunk> = Vec::new();
    let mut clock = GroupClock::new(slow);
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
        clock.last = monotonic_ns();
        let before = clock.ns;
        controller.tick(&inputs, &mut outputs, &mut clock);
        waiting.drain(..outputs.chunks_consumed);
        has_touched |= outputs.record.contact;
        if !outputs.record.contact {
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
        if in_block == CALIBRATION_BLOCK {
            block(std::array::from_fn(|k| clock.ns[k] as f64 / charged[k]));
            (charged, in_block, clock.ns) = ([0.0; 4], 0, [0; 4]);
            if monotonic_ns() > until {
                return false;
            }
        }
    }
    // Inputs without a touch would be played for ever.
    monotonic_ns() < until && inputs.ticks.len() > CALIBRATION_BLOCK
}

/// Wall time of the stages of each group.
struct GroupClock {
    slow: f64,
    last: u64,
    ns: [u64; CostGroup::ALL.len()],
}

impl GroupClock {
    fn new(slow: f64) -> Self {
        Self {
            slow,
            last: monotonic_ns(),
            ns: [0; CostGroup::ALL.len()],
        }
    }
}

impl StageObserver for GroupClock {
    fn ended(&mut self, stage: Stage) {
        let now = monotonic_ns();
        let group = match stage {
            Stage::BroadPhase | Stage::Force => CostGroup::Tick,
            Stage::Inbox => CostGroup::Inbox,
            Stage::Refine | Stage::Refit => CostGroup::Refine,
            Stage::Query => CostGroup::Query,
        };
        let taken = (self.slow * (now - self.last) as f64) as u64;
        self.ns[group as usize] += taken;
        self.last = monotonic_ns();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bundled_tape_touches_and_refines_with_every_kind_of_work() {
        let inputs = PatchInputs::from_bytes(PATCH).expect("the inputs are of this build");
        let plan = patch_plan().expect("the scene is sound");
        let mut blocks = 0;
        let until = u64::MAX;
        play(&inputs, &plan, 1.0, until, &mut |factors| {
            blocks += 1;
            assert!(
                factors.iter().all(|of| *of > 0.0 && of.is_finite()),
                "{factors:?}"
            );
        });
        assert!(blocks >= 4, "{blocks} blocks of touch");
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
