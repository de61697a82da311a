//! Which objects are near which probes: the boxes of all objects against a ball around each probe.
//!
//! An object is found as soon as any front of it may be near: a coarse one may stick out of the box
//! by a margin. Which of them are nearest goes by the boxes alone, which hold the full meshes: by
//! boxes that are grown, objects that touch each other would be all at distance 0.
//!
//! The boxes lie in one array a coordinate, so that the compiler compares several at once: three
//! balls take 0.4 µs among a hundred boxes and 4 µs among a thousand. That is little enough to do
//! without an order or a tree of them; it costs the same in every tick, and nothing has to be kept
//! up to date when something moves.

use glam::DVec3;
use scene::MAX_PROBES;
use std::cmp::Ordering;

/// Pairs of an object and a probe that one search finds at the most; of more the nearest are kept.
/// Each probe has an equal share of them, so that none loses its pairs to one in a crowd.
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

/// An object of which a front may meet a probe's ball.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Near {
    /// Index of the object.
    pub object: usize,
    /// Index of the probe.
    pub probe: usize,
    /// Distance of the box from the centre of the ball, metres; 0 inside.
    pub distance: f64,
}

impl Near {
    /// The nearest first. Of equal distance the first object: the order is that of the scene.
    fn order(a: &Self, b: &Self) -> Ordering {
        a.distance
            .total_cmp(&b.distance)
            .then(a.object.cmp(&b.object))
            .then(a.probe.cmp(&b.probe))
    }
}

/// The boxes of all objects, in the world.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct BroadPhase {
    lower: [Vec<f64>; 3],
    upper: [Vec<f64>; 3],
    /// By how much the coarsest front of each object may stick out of its box, metres.
    margins: Vec<f64>,
    /// Objects that move, and how far each may go in a tick, metres.
    #[serde(with = "spm::reserved")]
    displacements: Vec<(usize, f64)>,
    /// Squared distances of one ball.
    distances: Vec<f64>,
    #[serde(with = "spm::reserved")]
    near: Vec<Near>,
}

impl BroadPhase {
    /// Room for some objects, which are nowhere until they are placed; of them so many may move.
    #[must_use]
    pub fn new(objects: usize, moving: usize) -> Self {
        Self {
            lower: [(); 3].map(|()| vec![f64::INFINITY; objects]),
            upper: [(); 3].map(|()| vec![f64::NEG_INFINITY; objects]),
            margins: vec![0.0; objects],
            displacements: Vec::with_capacity(moving),
            distances: vec![0.0; objects],
            // Beside the shares of all balls, as much again of the one that is searched.
            near: Vec::with_capacity(2 * MAX_NEAR),
        }
    }

    /// Places an object's box: its corners, world, metres, and by how much a front may stick out of
    /// it, metres.
    pub fn place(&mut self, object: usize, lower: DVec3, upper: DVec3, margin: f64) {
        for axis in 0..3 {
            self.lower[axis][object] = lower[axis];
            self.upper[axis][object] = upper[axis];
        }
        self.margins[object] = margin;
    }

    /// By how much a front of an object may stick out of its box, metres; 0 before it is placed.
    #[must_use]
    pub fn margin(&self, object: usize) -> f64 {
        self.margins[object]
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

    /// All pairs of an object and a ball that meet within so many ticks, nearest first; of a ball
    /// no more than its share of [`MAX_NEAR`], the nearest. A ball that is not finite meets
    /// nothing; of more than [`MAX_PROBES`] the first count.
    pub fn find(&mut self, balls: impl IntoIterator<Item = Ball>, ticks: f64) -> &[Near] {
        let mut finite = [None; MAX_PROBES];
        let given = balls.into_iter().filter(|ball| ball.centre.is_finite());
        for (place, ball) in finite.iter_mut().zip(given) {
            *place = Some(ball);
        }
        self.near.clear();
        let quota = MAX_NEAR / finite.iter().flatten().count().max(1);
        for ball in finite.iter().flatten() {
            self.measure(ball.centre);
            self.find_near(ball, ticks, quota);
        }
        self.near.sort_unstable_by(Near::order);
        &self.near
    }

    /// Adds the nearest objects of a ball, the distances from which are measured.
    fn find_near(&mut self, ball: &Ball, ticks: f64, quota: usize) {
        let mut nearest = Nearest::new(&mut self.near, ball.probe, quota);
        let measured = self.distances.iter().zip(&self.margins);
        for (object, (&squared, &margin)) in measured.enumerate() {
            let reach = ball.radius + margin;
            if squared <= reach * reach {
                nearest.meet(object, squared);
            }
        }
        // A movable object may approach it.
        for &(object, displacement) in &self.displacements {
            let squared = self.distances[object];
            let reach = ball.radius + self.margins[object];
            let farther = reach + displacement * ticks;
            if squared > reach * reach && squared <= farther * farther {
                nearest.meet(object, squared);
            }
        }
        nearest.finish();
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
}

/// The nearest objects of a ball so far: the end of a list, with squared distances. It takes twice
/// as many as are kept before it drops the farthest half, so that an object costs the same however
/// many are met.
struct Nearest<'a> {
    near: &'a mut Vec<Near>,
    /// Where they begin in it.
    first: usize,
    probe: usize,
    /// How many are kept.
    quota: usize,
    /// The farthest that was kept, as squared distance and object: none beyond it can be.
    cut: (f64, usize),
}

impl<'a> Nearest<'a> {
    fn new(near: &'a mut Vec<Near>, probe: usize, quota: usize) -> Self {
        Self {
            first: near.len(),
            near,
            probe,
            quota,
            cut: (f64::INFINITY, usize::MAX),
        }
    }

    /// An object at a squared distance.
    fn meet(&mut self, object: usize, squared: f64) {
        if (squared, object) >= self.cut {
            return;
        }
        self.near.push(Near {
            object,
            probe: self.probe,
            distance: squared,
        });
        if self.near.len() - self.first >= 2 * self.quota {
            self.select();
        }
    }

    /// Leaves the nearest of them.
    fn select(&mut self) {
        let all = &mut self.near[self.first..];
        if all.len() <= self.quota {
            return;
        }
        let (_, farthest, _) = all.select_nth_unstable_by(self.quota - 1, Near::order);
        self.cut = (farthest.distance, farthest.object);
        self.near.truncate(self.first + self.quota);
    }

    /// The search is over.
    fn finish(mut self) {
        self.select();
        for near in &mut self.near[self.first..] {
            near.distance = near.distance.sqrt();
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
            balls in prop::collection::vec(
                (prop::array::uniform3(-1.2..1.2f64), 0.0..1.2f64),
                0..=MAX_PROBES,
            ),
        ) {
            let mut phase = BroadPhase::new(boxes.len(), 0);
            for (object, (lower, sides)) in boxes.iter().enumerate() {
                let lower = DVec3::from_array(*lower);
                phase.place(object, lower, lower + DVec3::from_array(*sides), 0.0);
            }
            let balls: Vec<Ball> = balls
                .into_iter()
                .enumerate()
                .map(|(probe, (centre, radius))| Ball { probe, centre: centre.into(), radius })
                .collect();
            let quota = MAX_NEAR / balls.len().max(1);
            let mut expected: Vec<Near> = Vec::new();
            for ball in &balls {
                let mut of_ball = Vec::new();
                for (object, (lower, sides)) in boxes.iter().enumerate() {
                    let lower = DVec3::from_array(*lower);
                    let upper = lower + DVec3::from_array(*sides);
                    let nearest = ball.centre.clamp(lower, upper);
                    let distance = nearest.distance(ball.centre);
                    if (distance - ball.radius).abs() > 1e-9 && distance < ball.radius {
                        of_ball.push(Near { object, probe: ball.probe, distance });
                    }
                }
                of_ball.sort_by(|a, b| a.distance.total_cmp(&b.distance));
                expected.extend(of_ball.into_iter().take(quota));
            }
            expected.sort_by(|a, b| a.distance.total_cmp(&b.distance));
            let found = phase.find(balls.iter().copied(), 10.0).to_vec();
            prop_assert!(found.windows(2).all(|w| w[0].distance <= w[1].distance));
            prop_assert_eq!(found.len(), expected.len());
            for (found, expected) in found.iter().zip(&expected) {
                prop_assert!((found.distance - expected.distance).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_probe_in_a_crowd_leaves_another_its_object() {
        let crowd = 100;
        let mut phase = BroadPhase::new(crowd + 1, 0);
        for object in 0..crowd {
            phase.place(object, DVec3::splat(-1.0), DVec3::ONE, 0.0);
        }
        phase.place(crowd, DVec3::splat(10.0), DVec3::splat(11.0), 0.0);
        let room = phase.near.capacity();
        let ball = |probe, centre| Ball {
            probe,
            centre,
            radius: 1.0,
        };
        let inside = ball(0, DVec3::ZERO);
        let beside = ball(1, DVec3::new(10.5, 10.5, 9.5));
        for balls in [[inside, beside], [beside, inside]] {
            let found = phase.find(balls, 1.0);
            let of = |probe: usize| found.iter().filter(move |near| near.probe == probe);
            let others: Vec<usize> = of(1).map(|near| near.object).collect();
            assert_eq!(others, [crowd]);
            // Of equal distance the first of the scene.
            let objects: Vec<usize> = of(0).map(|near| near.object).collect();
            assert!(objects.iter().copied().eq(0..MAX_NEAR / 2), "{objects:?}");
        }
        assert_eq!(phase.near.capacity(), room, "nothing was allocated");
    }

    #[test]
    fn of_many_objects_the_nearest_are_kept_whatever_their_order() {
        let many = 300;
        for step in [1, 7, many - 1] {
            let mut phase = BroadPhase::new(many, 1);
            for object in 0..many {
                // Distances are all different, in another order with each step.
                let lower = DVec3::X * (1 + object * step % many) as f64;
                phase.place(object, lower, lower + DVec3::ONE, 0.0);
            }
            let ball = Ball {
                probe: 2,
                centre: DVec3::ZERO,
                radius: many as f64,
            };
            phase.set_displacements([(0, 1.0)].into_iter());
            let found = phase.find([ball], 10.0).iter();
            let distances: Vec<f64> = found.map(|near| near.distance).collect();
            let due: Vec<f64> = (1..=MAX_NEAR).map(|k| k as f64).collect();
            assert_eq!(distances, due, "{step}");
        }
    }

    #[test]
    fn what_is_nowhere_or_not_finite_is_near_to_nothing() {
        let mut phase = BroadPhase::new(2, 0);
        phase.place(1, DVec3::ZERO, DVec3::ONE, 0.0);
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
            phase.place(object, lower, lower + 0.5, 0.0);
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

    /// Four tiles that touch each other, and a fifth one that may come.
    #[test]
    fn a_margin_finds_an_object_and_ranks_none() {
        let mut phase = BroadPhase::new(5, 1);
        for (object, (x, y)) in [(0.0, 0.0), (-1.0, 0.0), (0.0, -1.0), (-1.0, -1.0)]
            .into_iter()
            .enumerate()
        {
            let lower = DVec3::new(x, y, 0.0);
            phase.place(object, lower, lower + DVec3::ONE, 0.5);
        }
        phase.place(4, DVec3::X * 2.0, DVec3::X * 2.0 + DVec3::ONE, 0.5);
        phase.set_displacements([(4, 0.1)].into_iter());
        let (a, b) = (0.45, 0.4);
        let ball = |radius| Ball {
            probe: 0,
            centre: DVec3::new(a, b, 0.5),
            radius,
        };
        let mut found = |radius, ticks| -> Vec<(usize, f64)> {
            let near = phase.find([ball(radius)], ticks).iter();
            near.map(|near| (near.object, near.distance)).collect()
        };
        let across = (a * a + b * b).sqrt();
        let of_floor = [(0, 0.0), (2, b), (1, a), (3, across)];
        // The margin goes around a box as a ball does: the corner of a larger box is farther.
        assert_eq!(found(0.01, 1.0), of_floor[..3]);
        assert_eq!(found(0.2, 1.0), of_floor);
        let with_fifth: Vec<_> = of_floor.into_iter().chain([(4, 2.0 - a)]).collect();
        for (radius, ticks) in [(1.04, 0.0), (0.2, 8.4)] {
            assert_eq!(found(radius, ticks), of_floor, "{radius} {ticks}");
        }
        for (radius, ticks) in [(1.06, 0.0), (0.2, 8.6)] {
            assert_eq!(found(radius, ticks), with_fifth, "{radius} {ticks}");
        }
        assert_eq!((0..5).map(|k| phase.margin(k)).sum::<f64>(), 2.5);
    }
}
