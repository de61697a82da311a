//! The order of a tool's faces in its blocks.
//!
//! A block of level k stands for a run of `WIDTH^k` faces. Median splits lead to sets of other
//! sizes (7 or 8, 14 or 15, 29), so that runs would straddle them: a block that holds two ends of a
//! set that was cut is as wide as both. Here every cut is at a multiple of the runs on the level
//! below, so that every full run is one set of the cuts. Each cut is along the axis with the
//! smallest boxes: the expected number of tests is the sum of their areas (Goldsmith and Salmon
//! 1987).

use super::block_tree::WIDTH;
use glam::DVec3;

/// The box of a face, in the tool's axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct FaceBox {
    lower: DVec3,
    upper: DVec3,
}

impl FaceBox {
    const NOWHERE: Self = Self {
        lower: DVec3::INFINITY,
        upper: DVec3::NEG_INFINITY,
    };

    pub(super) fn of(corners: [DVec3; 3]) -> Self {
        let [a, b, c] = corners;
        Self {
            lower: a.min(b).min(c),
            upper: a.max(b).max(c),
        }
    }

    fn around(self, other: &Self) -> Self {
        Self {
            lower: self.lower.min(other.lower),
            upper: self.upper.max(other.upper),
        }
    }

    /// Half of the area of its surface.
    fn half_area(&self) -> f64 {
        let sides = self.upper - self.lower;
        sides.dot(DVec3::new(sides.y, sides.z, sides.x))
    }
}

/// The faces in the order of their blocks.
pub(super) fn block_order(boxes: &[FaceBox]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    let mut waiting = vec![(0, order.len())];
    while let Some((start, end)) = waiting.pop() {
        let set = &mut order[start..end];
        if set.len() <= WIDTH {
            // What a selection leaves in which order is its own affair.
            set.sort_unstable();
            continue;
        }
        let half = half_of(set.len());
        let costs = [0, 1, 2].map(|axis| cut(set, half, axis, boxes));
        let best = (1..3).fold(0, |best, axis| {
            let is_less = costs[axis] < costs[best];
            if is_less { axis } else { best }
        });
        cut(set, half, best, boxes);
        waiting.push((start, start + half));
        waiting.push((start + half, end));
    }
    order
}

/// The size of the first part of a set of more than a block: half of its runs, rounded up.
fn half_of(faces: usize) -> usize {
    let mut run = WIDTH;
    while run * WIDTH < faces {
        run *= WIDTH;
    }
    faces.div_ceil(run).div_ceil(2) * run
}

/// Cuts a set along an axis by the middles of boxes; ties go by number. The sum of the areas around
/// both parts, each times its faces.
fn cut(set: &mut [u32], half: usize, axis: usize, boxes: &[FaceBox]) -> f64 {
    let middle = |face: u32| {
        let FaceBox { lower, upper } = boxes[face as usize];
        lower[axis] + upper[axis]
    };
    set.select_nth_unstable_by(half, |&a, &b| {
        middle(a).total_cmp(&middle(b)).then(a.cmp(&b))
    });
    let (left, right) = set.split_at(half);
    let cost = |part: &[u32]| {
        let around = part.iter().fold(FaceBox::NOWHERE, |around, &face| {
            around.around(&boxes[face as usize])
        });
        part.len() as f64 * around.half_area()
    };
    cost(left) + cost(right)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    /// Faces around points on a ball.
    fn faces(count: usize, seed: u64) -> Vec<FaceBox> {
        let mut random = simulator::Random::new(seed);
        let mut along = || 2.0 * random.unit() - 1.0;
        let mut point = || DVec3::new(along(), along(), along());
        (0..count)
            .map(|_| {
                let at = point().normalize_or_zero();
                FaceBox::of([at, at + 0.02 * point(), at + 0.02 * point()])
            })
            .collect()
    }

    /// The areas of the blocks of faces in an order, on all levels.
    fn areas(order: &[u32], boxes: &[FaceBox]) -> f64 {
        let mut run = WIDTH;
        let mut sum = 0.0;
        while run < order.len() {
            for faces in order.chunks(run) {
                let around = faces.iter().map(|&face| boxes[face as usize]);
                sum += around
                    .fold(FaceBox::NOWHERE, |a, b| a.around(&b))
                    .half_area();
            }
            run *= WIDTH;
        }
        sum
    }

    proptest! {
        /// Each face once, whatever their number and place.
        #[test]
        fn every_face_has_one_place(count in 1usize..700, seed in 0u64..1000, flat in 0u8..3) {
            let mut boxes = faces(count, seed);
            if flat == 1 {
                boxes.fill(FaceBox::of([DVec3::ONE; 3]));
            }
            let order = block_order(&boxes);
            prop_assert_eq!(order.len(), count);
            let different: BTreeSet<u32> = order.iter().copied().collect();
            prop_assert_eq!(different.len(), count);
        }
    }

    /// Every cut is between two runs of the level below.
    #[test]
    fn a_cut_is_between_runs() {
        for faces in WIDTH + 1..5000 {
            let mut run = WIDTH;
            while run * WIDTH < faces {
                run *= WIDTH;
            }
            let half = half_of(faces);
            assert!(half.is_multiple_of(run) && (1..faces).contains(&half));
            assert!(half >= faces - half && half <= faces - half + 2 * run);
        }
    }

    /// The blocks are smaller than those of runs of sorted numbers or of faces along an axis.
    #[test]
    fn blocks_are_smaller_than_those_of_a_plain_order() {
        for (count, seed) in [(960, 1), (924, 2), (10_000, 3)] {
            let boxes = faces(count, seed);
            let ours = areas(&block_order(&boxes), &boxes);
            let mut along: Vec<u32> = (0..count as u32).collect();
            let middle = |face: &u32| boxes[*face as usize].lower.x;
            along.sort_by(|a, b| middle(a).total_cmp(&middle(b)));
            let plain = areas(&along, &boxes);
            assert!(ours < 0.5 * plain, "{count} faces: {ours} of {plain}");
        }
    }
}
