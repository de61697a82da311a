//! What the simulated hand intends over time: points of a scene's CSV, or a tour that the station
//! made.

use crate::contact::motion::Placement;
use crate::instance::ModelFrame;
use geometry::Pose;
use geometry::portable::slerp;
use glam::DVec3;
use haptic_device::Intent;
use protocol::TourPoint;

/// A place in a list of points in time.
#[derive(Debug, Clone, Copy, Default)]
pub struct Script {
    cursor: usize,
}

impl Script {
    /// The intent at `t` seconds along `points` (in the world); it rests before the first and after
    /// the last.
    ///
    /// Time must not go back. Moves on by as many points as lie between two calls.
    pub fn along_points(&mut self, points: &[(f64, Pose)], t: f64) -> Option<Intent> {
        self.along(points.len(), |k| points[k].0, |k| points[k].1, t)
    }

    /// The intent along a tour of an object with the given frame.
    pub fn along_tour(
        &mut self,
        points: &[TourPoint],
        frame: &ModelFrame,
        t: f64,
    ) -> Option<Intent> {
        let pose = |k: usize| {
            let point: &TourPoint = &points[k];
            // Tours are in the file's own frame: its origin is part of the position.
            let position = DVec3::from_array(point.position) - frame.origin;
            // An invalid quaternion leaves the object's own axes.
            let own = Pose::from_wxyz([0.0; 3], point.orientation_wxyz).unwrap_or(Pose::IDENTITY);
            Pose {
                position: frame.to_world(position),
                orientation: frame.pose.orientation * own.orientation,
            }
        };
        self.along(points.len(), |k| points[k].t, pose, t)
    }

    fn along(
        &mut self,
        length: usize,
        time: impl Fn(usize) -> f64,
        pose: impl Fn(usize) -> Pose,
        t: f64,
    ) -> Option<Intent> {
        let last = length.checked_sub(1)?;
        while self.cursor < last && time(self.cursor + 1) <= t {
            self.cursor += 1;
        }
        let from = pose(self.cursor);
        let start = time(self.cursor);
        if self.cursor == last || t < start {
            return Some(Intent::still(from));
        }
        let to = pose(self.cursor + 1);
        let span = time(self.cursor + 1) - start;
        let share = (t - start) / span;
        Some(Intent {
            pose: Pose {
                position: from.position.lerp(to.position, share),
                orientation: slerp(from.orientation, to.orientation, share),
            },
            velocity: (to.position - from.position) / span,
            angular_velocity: rotation(&from, &to) / span,
        })
    }
}

/// Rotation vector from a pose to another, by the shorter way, radians; zero where that is no
/// number.
fn rotation(from: &Pose, to: &Pose) -> DVec3 {
    let [from, to] = [from, to].map(|pose| Placement {
        centre: DVec3::ZERO,
        orientation: pose.orientation,
    });
    let turned = from.to(&to).angular;
    if turned.is_finite() {
        turned
    } else {
        DVec3::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    /// The axes of a tool follow the object's surface wherever the object is.
    #[test]
    fn a_tour_leads_in_the_frame_of_its_object() {
        let turn = DQuat::from_rotation_y(1.0);
        let own = DQuat::from_rotation_x(2.0);
        let frame = ModelFrame {
            pose: Pose {
                position: DVec3::X,
                orientation: turn,
            },
            metres_per_unit: 0.5,
            origin: DVec3::Z,
        };
        let point = TourPoint {
            t: 0.0,
            position: [0.0, 2.0, 1.0],
            orientation_wxyz: [own.w, own.x, own.y, own.z],
        };
        let intent = Script::default().along_tour(&[point], &frame, 0.0).unwrap();
        let expected = DVec3::X + turn * DVec3::new(0.0, 1.0, 0.5);
        assert!(intent.pose.position.distance(expected) < 1e-15);
        assert!(intent.pose.orientation.angle_between(turn * own) < 1e-7);
    }

    #[test]
    fn it_interpolates_and_rests_at_both_ends() {
        let points = [
            (1.0, Pose::at(DVec3::ZERO)),
            (2.0, Pose::at(DVec3::X)),
            (4.0, Pose::at(DVec3::X + DVec3::Y)),
        ];
        let mut script = Script::default();
        let mut at = |t| script.along_points(&points, t).unwrap();
        assert_eq!(at(0.0).velocity, DVec3::ZERO);
        assert_eq!(at(1.5).pose.position, DVec3::X * 0.5);
        assert_eq!(at(1.5).velocity, DVec3::X);
        assert_eq!(at(3.0).pose.position, DVec3::new(1.0, 0.5, 0.0));
        assert_eq!(at(9.0).pose.position, DVec3::new(1.0, 1.0, 0.0));
        assert_eq!(at(9.0).velocity, DVec3::ZERO);
        assert!(Script::default().along_points(&[], 0.0).is_none());
    }

    #[test]
    fn the_angular_velocity_leads_along_the_orientations() {
        let turn = |angle: f64| Pose {
            position: DVec3::ZERO,
            orientation: DQuat::from_axis_angle(DVec3::ONE.normalize(), angle),
        };
        // The quaternion of either sign is the same orientation.
        let negative = Pose {
            orientation: -turn(2.5).orientation,
            ..turn(2.5)
        };
        for (from, to) in [(turn(0.5), turn(2.5)), (turn(0.5), negative)] {
            let points = [(0.0, from), (0.5, to)];
            let at = |t| Script::default().along_points(&points, t).unwrap();
            let velocity = at(0.1).angular_velocity;
            assert!(velocity.distance(DVec3::ONE.normalize() * 4.0) < 1e-12);
            let step = DQuat::from_scaled_axis(velocity * 0.1);
            let led = step * at(0.1).pose.orientation;
            assert!(led.angle_between(at(0.2).pose.orientation) < 1e-7);
            assert_eq!(at(0.6).angular_velocity, DVec3::ZERO);
        }
    }
}
