//! Final poses and statistics of the bodies, for the end of a run.

use super::Movables;
use geometry::portable::turn_between;
use serde::{Deserialize, Serialize};

/// Final pose and statistics of one movable object.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct MovedObject {
    /// Index of the object in the scene.
    pub object: u64,
    /// Final position, world, metres.
    pub position_m: [f64; 3],
    /// Final orientation, a unit quaternion, w first.
    pub orientation_wxyz: [f64; 4],
    /// Angle between the final orientation and that in the scene, radians, 0 to π.
    pub turned_rad: f64,
    /// Largest distance of the middle of its box from its place in the scene, metres.
    pub farthest_m: f64,
    /// Number of ticks that it was awake.
    pub awake_ticks: u64,
}

impl Movables {
    /// An entry for every body that was ever awake. It allocates.
    #[must_use]
    pub fn report(&self) -> Vec<MovedObject> {
        let ever = self.iter().filter(|(_, body)| body.awake_ticks() > 0);
        ever.map(|(object, body)| {
            let pose = body.pose();
            MovedObject {
                object: u64::from(object),
                position_m: pose.position.to_array(),
                orientation_wxyz: pose.wxyz(),
                turned_rad: turn_between(body.home().orientation, pose.orientation),
                farthest_m: body.farthest(),
                awake_ticks: body.awake_ticks(),
            }
        })
        .collect()
    }
}
