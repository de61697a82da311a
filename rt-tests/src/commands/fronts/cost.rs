//! What a split and a collapse cost with the update of the AB-tree, in batches as a tick does them:
//! each single one, and the means of the batches, which hide the slow ones.

use crate::clocks::{Clocks, Reading};
use crate::failure::Failure;
use crate::models::Model;
use crate::models::local_front::{BatchObserver, BatchPart, LocalFront};
use crate::models::path::path;
use crate::models::surface::Surface;
use crate::report::quantile::sort;
use rand::Rng;

/// Splits, or collapses, of a batch: K of the loop's default.
const BATCH: u32 = 32;
/// Steps of the path, and their length on an object of [`OBJECT_M`].
const STEPS: u32 = 600;
const STEP_M: f64 = 1e-3;
/// Longest side of the object, metres.
pub const OBJECT_M: f64 = 0.15;
/// Cells within this distance of the contact are refined: a probe of 1 mm and what lies before it.
const REFINED_M: f64 = 2.5e-3;

/// Nanoseconds an operation, ascending: of each single one with its share of its batch's update of
/// the tree, and the means of the batches.
#[derive(Debug, Clone, Default)]
pub struct Times {
    /// Of each.
    pub single_ns: Vec<f64>,
    /// Of each batch, the mean.
    pub batch_ns: Vec<f64>,
}

/// What was timed.
#[derive(Debug, Clone, Default)]
pub struct Cost {
    /// Splits.
    pub splits: Times,
    /// Collapses.
    pub collapses: Times,
    /// What reading the clock takes, nanoseconds; it is taken off.
    pub clock_ns: u64,
}

/// Times the parts of a batch.
struct BatchClock {
    clocks: Clocks,
    start: Reading,
    /// Of each operation.
    operations: Vec<f64>,
    refit: f64,
}

impl BatchObserver for BatchClock {
    fn begins(&mut self) {
        self.start = Clocks::start();
    }

    fn ended(&mut self, part: BatchPart) {
        let ns = self.clocks.since(self.start);
        match part {
            BatchPart::Operation => self.operations.push(ns),
            BatchPart::Refit => self.refit = ns,
        }
    }
}

impl Times {
    /// Times batches until nothing is left to do.
    fn add(
        &mut self,
        clock: &mut BatchClock,
        mut batch: impl FnMut(&mut BatchClock) -> Result<u32, Failure>,
    ) -> Result<(), Failure> {
        loop {
            clock.operations.clear();
            let done = f64::from(batch(clock)?);
            if done == 0.0 {
                return Ok(());
            }
            let share = clock.refit / done;
            let single = clock.operations.iter().map(|ns| ns + share);
            self.single_ns.extend(single);
            let sum: f64 = clock.operations.iter().sum();
            self.batch_ns.push(sum / done + share);
        }
    }
}

/// Moves a contact over the model at full resolution and times every operation and every update of
/// the tree.
///
/// # Errors
/// When a region cannot be loaded.
pub fn cost(model: &Model, full: &Surface, random: &mut impl Rng) -> Result<Cost, Failure> {
    let mut found = Cost::default();
    let header = model.file.model_header();
    let metre = longest_side(model) / OBJECT_M;
    let mut front = LocalFront::new(model)?;
    let clocks = Clocks::new();
    let mut clock = BatchClock {
        clocks,
        start: Clocks::start(),
        operations: Vec::with_capacity(BATCH as usize),
        refit: 0.0,
    };
    found.clock_ns = clocks.cost_ns();
    if header.vsps == 0 {
        return Ok(found);
    }
    for near in path(full, STEP_M * metre, STEPS, random) {
        let cells = front.cells_near(near.point, 0.0, REFINED_M * metre);
        front.want(&cells)?;
        found
            .splits
            .add(&mut clock, |clock| front.split_observed(BATCH, clock))?;
        found.collapses.add(
            &mut clock,
            |clock| Ok(front.collapse_observed(BATCH, clock)),
        )?;
    }
    for times in [&mut found.splits, &mut found.collapses] {
        sort(&mut times.single_ns);
        sort(&mut times.batch_ns);
    }
    Ok(found)
}

/// Longest side of a model's box, model units.
#[must_use]
pub fn longest_side(model: &Model) -> f64 {
    ve_station::inspect::longest_side(&model.file.model_header())
}
