//! `rt-tests costs`: what a unit of the tick's counted work costs on this machine.
//!
//! It measures as a controller does before its first tick ([`hrtc::calibration`]), but without its
//! rights and several times. The costs of the reference machine in the code are those that this
//! printed there: those of the queries by a fit of the times of ticks (`fit`), the others by the
//! bundled patch.

mod fit;

use crate::failure::{Chosen, Failure};
use crate::processes::stop::{is_set, stop_flag};
use crate::report::output::print_either;
use crate::report::quantile::median;
use crate::report::table::Table;
use crate::scenes::prepare_models;
use clap::Args;
use fit::{QueryFit, query_fits};
use hrtc::calibration::{
    Measured, PATCH_DEVICE_N, PATCH_IDENTITY, PATCH_SECONDS, PatchInputs, PatchTick, measure,
    patch_plan,
};
use hrtc_core::governor::{CostGroup, Governor, TickLoad, WorkCosts};
use scene::ScenePlan;
use serde::Serialize;
use simulator::{Client, ClientOptions, Drive, STATION, Simulation, station};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// Measurements.
const REPEATS: usize = 9;
/// Ticks of the patch.
const PATCH_TICKS: u64 = 500;

/// Arguments of `rt-tests costs`.
#[derive(Debug, Args)]
pub struct CostsArgs {
    /// Write the inputs of the bundled patch anew instead, for hrtc/src/calibration/patch.inputs
    #[arg(long, value_name = "FILE")]
    pub write: Option<PathBuf>,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
}

/// What is printed as JSON.
#[derive(Debug, Serialize)]
pub struct Costs {
    /// Median cost of each unit, ns.
    pub unit_ns: BTreeMap<&'static str, f64>,
    /// Cost of each unit on the reference machine, ns.
    pub reference_ns: BTreeMap<&'static str, f64>,
    /// Largest over least of the measurements, for each unit.
    pub spread: BTreeMap<&'static str, f64>,
    /// What tick, inbox, refinement and queries took on the bundled patch, as a part of the costs
    /// of the reference machine; medians.
    pub patch: [f64; CostGroup::ALL.len()],
    /// Ticks that one measurement timed, at least.
    pub ticks: usize,
    /// What the governor itself takes of a tick, ns.
    pub governor_ns: f64,
    /// What queries cost by their counts.
    pub queries: Vec<QueryFit>,
}

/// Runs the command.
///
/// # Errors
/// One sentence, with its status.
pub fn costs(args: &CostsArgs) -> Result<(), Failure> {
    if let Some(path) = &args.write {
        return write(path);
    }
    let stop = stop_flag()?;
    let measured = (0..REPEATS).map(|_| check_stop(&stop).map(|()| measure(1.0)));
    let measured: Result<Option<Vec<Measured>>, Failure> = measured.collect();
    let Some(measured) = measured? else {
        return Err(Failure::Run(
            "the bundled inputs do not fit this build: rt-tests costs --write hrtc/src/calibration/patch.inputs"
                .to_string(),
        ));
    };
    let found = Costs::of(&measured, query_fits(&stop)?);
    print_either(args.json, &words(&found), &found)
}

/// # Errors
/// When the command is to end: what was cut short is no measure.
fn check_stop(stop: &AtomicBool) -> Result<(), Failure> {
    if is_set(stop) {
        return Err(Failure::Run("ended on request".to_string()));
    }
    Ok(())
}

impl Costs {
    fn of(measured: &[Measured], queries: Vec<QueryFit>) -> Self {
        let mut by_name: BTreeMap<&'static str, Vec<f64>> = BTreeMap::new();
        for (name, ns) in measured.iter().flat_map(|of| of.costs.named()) {
            by_name.entry(name).or_default().push(ns);
        }
        for costs in by_name.values_mut() {
            costs.sort_unstable_by(f64::total_cmp);
        }
        let of_each = |value: fn(&[f64]) -> f64| {
            let each = by_name.iter();
            each.map(|(&name, costs)| (name, value(costs))).collect()
        };
        Self {
            unit_ns: of_each(|costs| costs[costs.len() / 2]),
            spread: of_each(|costs| costs[costs.len() - 1] / costs[0]),
            reference_ns: WorkCosts::REFERENCE.named().into_iter().collect(),
            patch: std::array::from_fn(|group| {
                let parts: Vec<f64> = measured.iter().map(|of| of.patch[group]).collect();
                median(&parts)
            }),
            ticks: measured.iter().map(|of| of.ticks).min().unwrap_or(0),
            governor_ns: governor_ns(),
            queries,
        }
    }
}

/// What a tick of the governor takes, ns: the median of blocks of ticks with a ball and a tool.
fn governor_ns() -> f64 {
    const BLOCK: u64 = 10_000;
    let mut governor = Governor::new(1e-3, 96);
    let mut block = || {
        let began = Instant::now();
        for tick in 0..BLOCK {
            governor.note_devices(std::hint::black_box(0.0));
            governor.note_work(std::hint::black_box(2e5));
            governor.begin_tick(std::hint::black_box([1, 1]));
            governor.set_load(&TickLoad::from(std::hint::black_box([1, 1])));
            governor.end_queries(tick, std::hint::black_box(false), true);
        }
        began.elapsed().as_nanos() as f64 / BLOCK as f64
    };
    let blocks: Vec<f64> = (0..REPEATS).map(|_| block()).collect();
    median(&blocks)
}

fn words(found: &Costs) -> String {
    let mut table = Table::new(1, "unit | here, ns | spread | reference machine, ns");
    for (name, ns) in &found.unit_ns {
        table.row([
            (*name).to_string(),
            format!("{ns:.0}"),
            format!("{:.2}", found.spread[name]),
            format!("{:.0}", found.reference_ns[name]),
        ]);
    }
    let mut fits = Table::new(
        1,
        "queries by their counts, ns | pair | search | step | of the reference | time over the fit p50 | p99",
    );
    for of in &found.queries {
        let [pair, search, step] = of.fitted_ns.map(|ns| format!("{ns:.0}"));
        let reference = of.reference_ns.map(|ns| format!("{ns:.0}")).join(", ");
        let [middle, slow] = [of.over_fit.p50, of.over_fit.p99].map(|ratio| format!("{ratio:.2}"));
        fits.row([
            of.scene.to_string(),
            pair,
            search,
            step,
            reference,
            middle,
            slow,
        ]);
    }
    let [tick, inbox, refinement, queries] = found.patch;
    format!(
        "cost of a unit of counted work, median of {REPEATS} measurements\n\n{table}\npatch, its time over that of the reference machine's costs: tick {tick:.2}, inbox {inbox:.2}, refinement {refinement:.2}, queries {queries:.2}\nthe governor itself: {:.0} ns a tick\n\n{fits}",
        found.governor_ns
    )
}

/// Lets the bundled scene run in virtual time and writes the controller's inputs.
fn write(path: &Path) -> Result<(), Failure> {
    let plan = patch_plan().map_err(|error| Failure::Input(error.to_string()))?;
    prepare_models(&plan)?;
    let inputs = record(&plan)?;
    let bytes = inputs
        .to_bytes()
        .map_err(|error| Failure::Run(error.to_string()))?;
    let wrong = |error: std::io::Error| Failure::write_at(Chosen::By("--write"), path, &error);
    std::fs::write(path, &bytes).map_err(wrong)?;
    println!(
        "{} ticks, {} bytes in {}",
        inputs.ticks.len(),
        bytes.len(),
        path.display()
    );
    Ok(())
}

fn record(plan: &ScenePlan) -> Result<PatchInputs, Failure> {
    let models = prepare_models(plan)?.models;
    let not_served = || Failure::Run("the bundled scene is not served".to_string());
    let station = station(plan, models, STATION).ok_or_else(not_served)?;
    let options = ClientOptions {
        identity: PATCH_IDENTITY,
        device_max_n: PATCH_DEVICE_N,
        tour_s: PATCH_SECONDS,
        ..ClientOptions::default()
    };
    let mut simulation = Simulation::new(station, Client::new(plan, options));
    simulation.client_mut().record();
    for _ in 0..PATCH_TICKS {
        simulation.advance(Drive::Hands, &mut hrtc_core::NoObserver);
    }
    let recording = simulation.client_mut().take_recording().unwrap_or_default();
    let mut arrived = 0;
    let ticks = (0..recording.len()).filter_map(|k| {
        let (inputs, chunks) = recording.inputs(k)?;
        let new = recording.chunks()[arrived..chunks].to_vec();
        arrived = chunks;
        Some(PatchTick {
            samples: inputs.samples.to_vec(),
            station: inputs.station,
            chunks: new,
        })
    });
    Ok(PatchInputs {
        ticks: ticks.collect(),
    })
}
