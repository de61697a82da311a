//! The chunks that a station sends in a touch.

use crate::failure::Failure;
use crate::trajectory::reference::{come_to_rest, make_ready};
use crate::trajectory::scene_model::SceneModel;
use hrtc_core::streaming::chunk::InboxChunk;
use simulator::Hand;
use spm::Sizes;
use std::cell::RefCell;
use std::rc::Rc;

/// What was sent, in order.
#[derive(Debug)]
pub struct Trace {
    /// Sizes of the model.
    pub sizes: Sizes,
    /// Its chunks.
    pub chunks: Vec<InboxChunk>,
    /// Records in them.
    pub vsps: u64,
}

/// Touches a model along the tour of a seed, with a cache of so many bytes, in virtual time.
///
/// # Errors
/// One sentence when the model cannot be served or touched.
pub fn touch(
    model: &SceneModel,
    seed: u64,
    seconds: f64,
    cache_bytes: usize,
) -> Result<Trace, Failure> {
    let mut plan = model.plan.clone();
    plan.cache_bytes = cache_bytes;
    let mut simulation = model.simulation(&plan)?;
    let chunks = Rc::new(RefCell::new(Vec::new()));
    let sent = Rc::clone(&chunks);
    let link = simulation.client_mut().link();
    link.tamper(move |chunk| sent.borrow_mut().push(*chunk));
    let period_s = 1.0 / plan.loop_.rate_hz;
    let no_tour = || Failure::Run(format!("the tour of {} has no point", model.mesh.name));
    let tour = model.tour(seed, seconds)?;
    let mut hand = Hand::new(plan.probes[0].device, period_s).along_tour(tour);
    let ready = make_ready(&mut simulation)?;
    let frame = simulation.controller().frame().ok_or_else(no_tour)?;
    let rest = hand.start(&frame).ok_or_else(no_tour)?;
    come_to_rest(&mut simulation, rest, ready)?;
    for tick in 0..(seconds / period_s).round() as u64 {
        let sample = hand.sample(tick, &frame).ok_or_else(no_tour)?;
        hand.feel(simulation.step(Some(sample)).wrenches[0]);
    }
    Ok(Trace {
        sizes: model.mesh.file.model_header().sizes(),
        chunks: chunks.take(),
        vsps: simulation.outputs().record.vsps_received,
    })
}
