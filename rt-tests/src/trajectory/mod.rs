//! A touch recorded once in virtual time and replayed at many settings: equal poses, so that the
//! settings alone make the difference.
//!
//! | module | holds |
//! |---|---|
//! | [`scene_model`] | a model in its scene, and the same mesh never simplified as the reference |
//! | [`mod@reference`] | the device poses on the reference, and the forces that it gave |
//! | [`mod@touch`] | a touch in a closed loop with the product |
//! | [`mod@virtual_scene`] | a scene in virtual time, until it is ready |
//! | [`stage_times`] | the time of every stage of a tick, from recorded inputs |

pub mod reference;
pub mod scene_model;
pub mod stage_times;
pub mod touch;
pub mod virtual_scene;
