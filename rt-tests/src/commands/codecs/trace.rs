//! The chunks that a station sends in a touch.

use crate::failure::Failure;
use crate::trajectory::scene_model::SceneModel;
use crate::trajectory::touch as closed_loop;
use hrtc_core::streaming::chunk::InboxChunk;
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
    closed_loop::touch(model, &mut simulation, seed, seconds, &mut |_| ())?;
    Ok(Trace {
        sizes: model.mesh.file.model_header().sizes(),
        chunks: chunks.take(),
        vsps: simulation.outputs().record.vsps_received,
    })
}
