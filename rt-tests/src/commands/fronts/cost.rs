//! What a split and a collapse cost with the update of the AB-tree, in batches as a tick does them.

use crate::failure::Failure;
use crate::models::Model;
use crate::models::local_front::LocalFront;
use crate::models::path::path;
use crate::models::surface::Surface;
use rand::Rng;
use realtime::rights::thread_cpu_ns;

/// Splits, or collapses, of a batch: K of the loop's default.
const BATCH: u32 = 32;
/// Steps of the path, and their length on an object of [`OBJECT_M`].
const STEPS: u32 = 600;
const STEP_M: f64 = 1e-3;
/// Longest side of the object, metres.
pub const OBJECT_M: f64 = 0.15;
/// Cells within this distance of the contact are refined: a probe of 1 mm and what lies before it.
const REFINED_M: f64 = 2.5e-3;

/// Nanoseconds an operation, one entry a batch, ascending.
#[derive(Debug, Clone, Default)]
pub struct Cost {
    /// Of splits.
    pub split_ns: Vec<f64>,
    /// Of collapses.
    pub collapse_ns: Vec<f64>,
    /// Splits in all batches.
    pub splits: u64,
}

/// Moves a contact over the model at full resolution and times each batch, in processor time of
/// this thread.
///
/// # Errors
/// When a region cannot be loaded.
pub fn cost(model: &Model, full: &Surface, random: &mut impl Rng) -> Result<Cost, Failure> {
    let mut found = Cost::default();
    let header = model.file.model_header();
    let metre = longest_side(model) / OBJECT_M;
    let mut front = LocalFront::new(model)?;
    let clock = clock_cost();
    let batches = |ns: &mut Vec<f64>, batch: &mut dyn FnMut() -> Result<u32, Failure>| loop {
        let start = thread_cpu_ns();
        let done = batch()?;
        let taken = (thread_cpu_ns() - start).saturating_sub(clock);
        if done == 0 {
            return Ok::<(), Failure>(());
        }
        ns.push(taken as f64 / f64::from(done));
    };
    if header.vsps == 0 {
        return Ok(found);
    }
    for near in path(full, STEP_M * metre, STEPS, random) {
        let cells = front.cells_near(near.point, 0.0, REFINED_M * metre);
        front.want(&cells)?;
        let splits = &mut found.splits;
        batches(&mut found.split_ns, &mut || {
            let done = front.split_some(BATCH)?;
            *splits += u64::from(done);
            Ok(done)
        })?;
        batches(&mut found.collapse_ns, &mut || {
            Ok(front.collapse_some(BATCH))
        })?;
    }
    found.split_ns.sort_unstable_by(f64::total_cmp);
    found.collapse_ns.sort_unstable_by(f64::total_cmp);
    Ok(found)
}

/// Longest side of a model's box, model units.
#[must_use]
pub fn longest_side(model: &Model) -> f64 {
    ve_station::inspect::longest_side(&model.file.model_header())
}

/// What reading the clock twice takes, nanoseconds.
fn clock_cost() -> u64 {
    let mut taken: Vec<u64> = (0..201)
        .map(|_| {
            let start = thread_cpu_ns();
            thread_cpu_ns() - start
        })
        .collect();
    taken.sort_unstable();
    taken[100]
}
