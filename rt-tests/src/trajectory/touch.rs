//! A touch in a closed loop: the product's controller, and a hand along the tour of a seed.

use super::reference::come_to_rest;
use super::scene_model::SceneModel;
use super::virtual_scene::make_ready;
use crate::failure::Failure;
use simulator::{Hand, Simulation};
use ve_station::FileBytes;

/// Leads the hand along the tour, from a front that has come to rest at its first point; `each`
/// sees the simulation after every tick. The index of the first tick of the tour.
///
/// # Errors
/// One sentence when the model cannot be served or touched.
pub fn touch(
    model: &SceneModel,
    simulation: &mut Simulation<FileBytes>,
    seed: u64,
    seconds: f64,
    each: &mut dyn FnMut(&Simulation<FileBytes>),
) -> Result<u64, Failure> {
    let period_s = simulation.client().period_s();
    let no_tour = || Failure::Run(format!("the tour of {} has no point", model.mesh.name));
    let tour = model.tour(seed, seconds)?;
    let mut hand = Hand::new(model.plan.probes[0].device, period_s).along_tour(tour);
    let ready = make_ready(simulation)?;
    let frame = simulation.controller().frame().ok_or_else(no_tour)?;
    let rest = hand.start(&frame).ok_or_else(no_tour)?;
    come_to_rest(simulation, rest, ready)?;
    let start = simulation.tick();
    for tick in 0..(seconds / period_s).round() as u64 {
        let sample = hand.sample(tick, &frame).ok_or_else(no_tour)?;
        hand.feel(simulation.step(Some(sample)).wrenches[0]);
        each(simulation);
    }
    Ok(start)
}
