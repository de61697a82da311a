//! A scene in virtual time: its station and its controller, with the hands of the scene.

use crate::failure::Failure;
use crate::scenes::prepare_models;
use scene::ScenePlan;
use simulator::{Client, ClientOptions, STATION, Simulation, station};
use ve_station::FileBytes;

/// Ticks after which models that do not arrive are given up.
pub const MAX_START_TICKS: u64 = 2_000_000;

/// A scene before its first tick, and how its controller was made; `seconds`: of a scripted tour.
///
/// # Errors
/// When a model cannot be opened.
pub fn virtual_scene(
    plan: &ScenePlan,
    seconds: f64,
) -> Result<(Simulation<FileBytes>, ClientOptions), Failure> {
    let models = prepare_models(plan)?.models;
    let station = station(plan, models, STATION)
        .ok_or_else(|| Failure::Run(format!("{}: a model is not served", plan.name)))?;
    let options = ClientOptions {
        tour_s: seconds,
        ..ClientOptions::default()
    };
    let simulation = Simulation::new(station, Client::new(plan, options));
    Ok((simulation, options))
}

/// Ticks without the device until the base mesh is there; their number.
///
/// # Errors
/// When the controller cannot go on with the model, or it does not arrive.
pub fn make_ready<D: AsRef<[u8]>>(simulation: &mut Simulation<D>) -> Result<u64, Failure> {
    ready_after(simulation, |simulation| simulation.step(None).record.ready)
}

/// The same with the hands of the scene.
///
/// # Errors
/// The same.
pub fn make_ready_led<D: AsRef<[u8]>>(simulation: &mut Simulation<D>) -> Result<u64, Failure> {
    ready_after(simulation, |simulation| simulation.step_led().record.ready)
}

fn ready_after<D: AsRef<[u8]>>(
    simulation: &mut Simulation<D>,
    is_ready: impl Fn(&mut Simulation<D>) -> bool,
) -> Result<u64, Failure> {
    while !is_ready(simulation) {
        if let Some(fault) = simulation.controller().fault() {
            return Err(Failure::Run(fault.to_string()));
        }
        if simulation.tick() > MAX_START_TICKS {
            return Err(Failure::Run("the model does not arrive".to_string()));
        }
    }
    Ok(simulation.tick())
}
