//! The time of every stage of every tick: recorded inputs through a fresh controller, several
//! times.
//!
//! The recordings take turns in blocks, so that a slow moment of the machine slows them all.

use super::scene_model::SceneModel;
use crate::failure::Failure;
use hrtc_core::{Controller, Stage, StageObserver};
use realtime::rights::thread_cpu_ns;
use scene::ScenePlan;
use simulator::{InputRecording, Playback};

/// Times that every tick is done; its time is the least of them. The work is the same bits each
/// time, so what differs is the machine.
pub const REPEATS: usize = 5;
/// Ticks of one setting before the next has its turn.
const BLOCK: usize = 256;
/// Stages of a tick.
pub const STAGES: usize = hrtc::tick_record::STAGES.len();

/// Processor time of the thread at the end of each stage.
#[derive(Debug, Clone, Copy)]
struct StageClock {
    last: u64,
    /// What one reading costs, ns: the clock is a system call.
    reading: u64,
    ns: [u32; STAGES],
}

impl StageClock {
    fn new() -> Self {
        let readings = (0..2000).map(|_| {
            let before = thread_cpu_ns();
            thread_cpu_ns() - before
        });
        Self {
            last: 0,
            reading: readings.min().unwrap_or(0),
            ns: [0; STAGES],
        }
    }
}

impl StageObserver for StageClock {
    fn ended(&mut self, stage: Stage) {
        let now = thread_cpu_ns();
        let taken = (now - self.last).saturating_sub(self.reading);
        self.ns[stage as usize] = u32::try_from(taken).unwrap_or(u32::MAX);
        self.last = thread_cpu_ns();
    }
}

/// Nanoseconds of every stage of every tick of each recording, the least of [`REPEATS`].
///
/// # Errors
/// When a replay does not give the recorded bits.
pub fn least_ns(
    recorded: &[(&InputRecording, &ScenePlan)],
) -> Result<Vec<Vec<[u32; STAGES]>>, Failure> {
    least_ns_with(recorded, &|k| SceneModel::controller(recorded[k].1))
}

/// The same with a fresh controller, as the recorded one was, for each recording by its place.
///
/// # Errors
/// When a replay does not give the recorded bits.
pub fn least_ns_with(
    recorded: &[(&InputRecording, &ScenePlan)],
    controller: &dyn Fn(usize) -> Controller,
) -> Result<Vec<Vec<[u32; STAGES]>>, Failure> {
    let mut least: Vec<Vec<[u32; STAGES]>> = recorded
        .iter()
        .map(|(inputs, _)| vec![[u32::MAX; STAGES]; inputs.len()])
        .collect();
    let mut clock = StageClock::new();
    for _ in 0..REPEATS {
        let mut playbacks: Vec<Playback<'_>> = recorded
            .iter()
            .enumerate()
            .map(|(k, (inputs, _))| Playback::new(inputs, controller(k)))
            .collect();
        let mut running = true;
        while running {
            running = false;
            for (playback, least) in playbacks.iter_mut().zip(&mut least) {
                running |= play_block(playback, least, &mut clock)?;
            }
        }
    }
    Ok(least)
}

/// Plays a block of one setting; whether there is more.
fn play_block(
    playback: &mut Playback<'_>,
    least: &mut [[u32; STAGES]],
    clock: &mut StageClock,
) -> Result<bool, Failure> {
    for _ in 0..BLOCK {
        let tick = playback.tick();
        clock.last = thread_cpu_ns();
        match playback.step(clock) {
            None => return Ok(false),
            Some(false) => {
                return Err(Failure::Run(format!(
                    "tick {tick} of a replay gives other bits than it gave before: please report this"
                )));
            }
            Some(true) => {}
        }
        // The least of the whole, not of each stage: a tick's stages stay those of one and the same
        // tick.
        let sum = |ns: &[u32; STAGES]| ns.iter().map(|&ns| u64::from(ns)).sum::<u64>();
        if sum(&clock.ns) < sum(&least[tick]) {
            least[tick] = clock.ns;
        }
    }
    Ok(true)
}
