//! Faults that keep the controller from going on with a model.

use crate::cache::CacheError;
use thiserror::Error;

/// Fault that keeps the controller from going on with a model. It keeps ticking without that model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum Fault {
    /// The cache is too small.
    #[error(transparent)]
    Cache(#[from] CacheError),
    /// The station does not know the model that the scene names.
    #[error(
        "the station serves another scene: it does not know this object's model; start both with the same scene and the same --model"
    )]
    UnknownModel,
    /// The model's head or base mesh makes no sense.
    #[error("the model's header or base mesh is damaged: build the SPM file anew")]
    DamagedModel,
    /// The station cannot make the tour that the scene asks for.
    #[error(
        "the station cannot make a tour of this model (its own message says why): build the SPM file anew, or give the scene a path with trajectory = {{ csv = \"FILE\" }}"
    )]
    NoTour,
    /// The station came back with another model under the same name.
    #[error("the station now serves another model under the same name: restart the controller")]
    AnotherModel,
}
