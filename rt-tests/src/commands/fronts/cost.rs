//! What a split and a collapse cost with the update of the AB-tree: single ones, and batches as a
//! tick does them, whose mean hides the slow ones.

use crate::failure::Failure;
use crate::models::Model;
use crate::models::local_front::LocalFront;
use crate::models::path::path;
use crate::models::surface::Surface;
use crate::report::quantile::sort;
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

/// Nanoseconds an operation, ascending: of each that was timed, or the mean of each batch.
#[derive(Debug, Clone, Default)]
pub struct Timed {
    /// Of splits.
    pub split_ns: Vec<f64>,
    /// Of collapses.
    pub collapse_ns: Vec<f64>,
    /// Splits in all entries.
    pub splits: u64,
}

impl Timed {
    /// Splits and collapses, up to so many at a time, until the front is that of the wanted cells.
    fn time(&mut self, front: &mut LocalFront<'_>, most: u32, clock: u64) -> Result<(), Failure> {
        self.splits += each(&mut self.split_ns, clock, &mut || front.split_some(most))?;
        each(&mut self.collapse_ns, clock, &mut || {
            Ok(front.collapse_some(most))
        })?;
        Ok(())
    }
}

/// Times some operations until none is left; how many there were.
fn each(
    ns: &mut Vec<f64>,
    clock: u64,
    some: &mut dyn FnMut() -> Result<u32, Failure>,
) -> Result<u64, Failure> {
    let mut all = 0;
    loop {
        let start = thread_cpu_ns();
        let done = some()?;
        let taken = (thread_cpu_ns() - start).saturating_sub(clock);
        if done == 0 {
            return Ok(all);
        }
        ns.push(taken as f64 / f64::from(done));
        all += u64::from(done);
    }
}

/// What was timed.
#[derive(Debug, Clone, Default)]
pub struct Cost {
    /// One at a time, each with its own update of the tree.
    pub single: Timed,
    /// Up to [`BATCH`] with one update.
    pub batch: Timed,
    /// What reading the clock twice takes, nanoseconds; it is taken off.
    pub clock_ns: u64,
}

/// Moves a contact over the model at full resolution and times single operations at every other
/// point, batches at the others, in processor time of this thread.
///
/// # Errors
/// When a region cannot be loaded.
pub fn cost(model: &Model, full: &Surface, random: &mut impl Rng) -> Result<Cost, Failure> {
    let mut found = Cost::default();
    let header = model.file.model_header();
    let metre = longest_side(model) / OBJECT_M;
    let mut front = LocalFront::new(model)?;
    found.clock_ns = clock_cost();
    if header.vsps == 0 {
        return Ok(found);
    }
    for (k, near) in path(full, STEP_M * metre, STEPS, random)
        .into_iter()
        .enumerate()
    {
        let cells = front.cells_near(near.point, 0.0, REFINED_M * metre);
        front.want(&cells)?;
        let (timed, most) = if k.is_multiple_of(2) {
            (&mut found.single, 1)
        } else {
            (&mut found.batch, BATCH)
        };
        timed.time(&mut front, most, found.clock_ns)?;
    }
    for timed in [&mut found.single, &mut found.batch] {
        sort(&mut timed.split_ns);
        sort(&mut timed.collapse_ns);
    }
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
