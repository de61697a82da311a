//! Faults that keep the controller from going on with a model.

use crate::cache::CacheError;
use thiserror::Error;

/// Fault that keeps the controller from going on with a model. Contact with other models goes on,
/// and with this one as far as its mesh has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error, serde::Serialize, serde::Deserialize)]
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
        "the station cannot make a tour of this model (its own message says why): lower the speed (a tour goes at most 20 lengths of the object a second), the tour's depth_m or the radius of the probe (neither may be longer than the object), build the SPM file anew, or give the scene a path with trajectory = {{ csv = \"FILE\" }}"
    )]
    NoTour,
    /// The station has no place for another controller.
    #[error(
        "the station serves as many controllers as it can ({}): stop one of them, or start another station in a --domain of its own",
        protocol::MAX_CLIENTS
    )]
    NoPlace,
    /// The station came back with another model under the same name.
    #[error(
        "the model was rebuilt: the station now serves another one under the same name, and contact goes on with the mesh that is here; restart the controller"
    )]
    AnotherModel,
}

impl Fault {
    /// Whether nothing more is asked of the station about the object.
    #[must_use]
    pub fn ends_session(self) -> bool {
        self != Self::NoTour
    }
}
