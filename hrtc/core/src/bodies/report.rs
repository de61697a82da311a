//! What became of the bodies, for the end of a run.

use super::Movables;
use serde::{Deserialize, Serialize};

/// Where an object that was pushed, or driven, came to.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct MovedObject {
    /// Object of the scene.
    pub object: u64,
    /// Its position in the end, world, metres.
    pub position_m: [f64; 3],
    /// Its orientation in the end, w first.
    pub orientation_wxyz: [f64; 4],
    /// Angle between how it is in the end and how the scene puts it, radians.
    pub turned_rad: f64,
    /// How far the middle of its box ever was from where the scene puts it, metres.
    pub farthest_m: f64,
    /// Ticks that it was awake.
    pub awake_ticks: u64,
}

impl Movables {
    /// Every body that was ever awake. It allocates.
    #[must_use]
    pub fn report(&self) -> Vec<MovedObject> {
        let ever = self.iter().filter(|(_, body)| body.awake_ticks() > 0);
        ever.map(|(object, body)| {
            let pose = body.pose();
            MovedObject {
                object: u64::from(object),
                position_m: pose.position.to_array(),
                orientation_wxyz: pose.wxyz(),
                turned_rad: body.home().orientation.angle_between(pose.orientation),
                farthest_m: body.farthest(),
                awake_ticks: body.awake_ticks(),
            }
        })
        .collect()
    }
}
