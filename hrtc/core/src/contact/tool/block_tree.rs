//! The tree over a tool's faces with eight boxes per node (a block), in the tool's axes. A box of
//! the surface is tested against eight boxes at once, so that a face of the surface finds the
//! tool's faces near it in three or four tests.

use geometry::Aabb;
use glam::{DVec3, Vec3A, Vec4, Vec4Swizzles};

/// Largest number of blocks on the highest level.
const TOP: usize = 2;
/// Boxes per block, and its logarithm.
pub(crate) const WIDTH: usize = 1 << LOG_WIDTH;
const LOG_WIDTH: usize = 3;
/// Relative rounding error of comparisons in f32, with a margin.
const ROUNDING: f64 = 64.0 * f32::EPSILON as f64;

/// Eight boxes: lower and upper bounds per axis, in two halves.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Block {
    lower: [[Vec4; 2]; 3],
    upper: [[Vec4; 2]; 3],
}

impl Block {
    /// Empty boxes.
    const NOWHERE: Self = Self {
        lower: [[Vec4::INFINITY; 2]; 3],
        upper: [[Vec4::NEG_INFINITY; 2]; 3],
    };

    fn set(&mut self, slot: usize, aabb: &Aabb) {
        let (half, lane) = (slot / 4, slot % 4);
        for axis in 0..3 {
            self.lower[axis][half][lane] = aabb.lower[axis];
            self.upper[axis][half][lane] = aabb.upper[axis];
        }
    }

    fn union(&self) -> Aabb {
        let lower = self.lower.map(|[a, b]| a.min(b).min_element());
        let upper = self.upper.map(|[a, b]| a.max(b).max_element());
        Aabb {
            lower: lower.into(),
            upper: upper.into(),
        }
    }
}

/// The corners of eight faces: coordinates per corner, in two halves.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Corners([[[Vec4; 2]; 3]; 3]);

impl Corners {
    /// Degenerate faces.
    const NONE: Self = Self([[[Vec4::ZERO; 2]; 3]; 3]);

    fn set(&mut self, slot: usize, corners: [DVec3; 3]) {
        let (half, lane) = (slot / 4, slot % 4);
        for (place, corner) in self.0.iter_mut().zip(corners) {
            for axis in 0..3 {
                place[axis][half][lane] = corner[axis] as f32;
            }
        }
    }
}

/// A distance, rounded up.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Distance {
    rounded: f32,
    squared: Vec4,
}

impl Distance {
    pub(crate) fn new(distance: f64) -> Self {
        let squared = distance * distance * (1.0 + ROUNDING);
        Self {
            rounded: (distance * (1.0 + ROUNDING)) as f32,
            // The square of a very small number may be rounded to 0, that of a very large one to
            // infinity.
            squared: Vec4::splat((squared as f32 + f32::MIN_POSITIVE).min(f32::MAX)),
        }
    }
}

/// A box and a distance.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BoxWithin {
    lower: [Vec4; 3],
    upper: [Vec4; 3],
    squared: Vec4,
}

impl BoxWithin {
    /// `size` bounds the coordinates from which `lower` and `upper` were computed.
    #[inline]
    pub(crate) fn new([lower, upper]: [Vec3A; 2], size: f32, distance: &Distance) -> Self {
        let rounding = Vec3A::splat(ROUNDING as f32 * size);
        let (low, high) = (lower - rounding, upper + rounding);
        let splat = |p: Vec3A| [Vec4::splat(p.x), Vec4::splat(p.y), Vec4::splat(p.z)];
        Self {
            lower: splat(low),
            upper: splat(high),
            squared: distance.squared,
        }
    }

    /// The same for two boxes, in the first two components of each vector.
    #[inline]
    pub(crate) fn both(
        [lower, upper]: [[Vec4; 3]; 2],
        size: Vec4,
        distance: &Distance,
    ) -> [Self; 2] {
        let rounding = ROUNDING as f32 * size;
        let (low, high) = (lower.map(|p| p - rounding), upper.map(|p| p + rounding));
        let squared = distance.squared;
        [
            Self {
                lower: low.map(|p| p.xxxx()),
                upper: high.map(|p| p.xxxx()),
                squared,
            },
            Self {
                lower: low.map(|p| p.yyyy()),
                upper: high.map(|p| p.yyyy()),
                squared,
            },
        ]
    }

    /// The boxes of a block within the distance, as bits.
    #[inline]
    fn of(&self, block: &Block) -> u32 {
        let half = |half: usize| {
            let squared = [0, 1, 2].map(|axis| {
                let beyond = block.lower[axis][half] - self.upper[axis];
                let before = self.lower[axis] - block.upper[axis][half];
                let gap = beyond.max(before).max(Vec4::ZERO);
                gap * gap
            });
            let [x, y, z] = squared;
            (x + y + z).min(Vec4::MAX).cmple(self.squared).bitmask()
        };
        half(0) | half(1) << 4
    }
}

/// All points within a distance of an interval along a direction.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slab {
    direction: [Vec4; 3],
    absolute: [Vec4; 3],
    low: Vec4,
    high: Vec4,
}

impl Slab {
    /// Around points along a direction of at most unit length. `size` bounds the coordinates from
    /// which these and the boxes were computed.
    #[inline]
    pub(crate) fn new(
        direction: Vec3A,
        points: [Vec3A; 6],
        distance: &Distance,
        size: f32,
    ) -> Self {
        let [a, b, c, p, q, r] = points.map(|point| direction.dot(point));
        let low = a.min(b).min(c).min(p.min(q).min(r));
        let high = a.max(b).max(c).max(p.max(q).max(r));
        let more = distance.rounded + ROUNDING as f32 * (size + distance.rounded);
        let axes = direction.to_array().map(Vec4::splat);
        Self {
            direction: axes,
            absolute: axes.map(Vec4::abs),
            low: Vec4::splat(low - more),
            high: Vec4::splat(high + more),
        }
    }

    /// The faces of a block that may be inside, as bits.
    #[inline]
    fn of_faces(&self, faces: &Corners) -> u32 {
        let [x, y, z] = self.direction;
        let half = |half: usize| {
            let [a, b, c] = faces
                .0
                .map(|p| x * p[0][half] + y * p[1][half] + z * p[2][half]);
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            (low.cmple(self.high) & high.cmpge(self.low)).bitmask()
        };
        half(0) | half(1) << 4
    }

    /// The boxes of a block that may be inside, as bits.
    #[inline]
    fn of(&self, block: &Block) -> u32 {
        let half = |half: usize| {
            let (mut at, mut reach) = (Vec4::ZERO, Vec4::ZERO);
            for axis in 0..3 {
                let (lower, upper) = (block.lower[axis][half], block.upper[axis][half]);
                at += self.direction[axis] * (lower + upper);
                reach += self.absolute[axis] * (upper - lower);
            }
            let (low, high) = (0.5 * (at - reach), 0.5 * (at + reach));
            (low.cmple(self.high) & high.cmpge(self.low)).bitmask()
        };
        half(0) | half(1) << 4
    }
}

/// The tree over a tool's faces.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub(crate) struct Blocks {
    /// Faces in the order of the tool's tree.
    order: Vec<u32>,
    /// The blocks of faces, then the blocks of blocks, up to one or two.
    blocks: Vec<Block>,
    /// The faces of each block of faces.
    faces: Vec<Corners>,
    /// First block of each level.
    levels: Vec<usize>,
    extent: f32,
}

/// Bits for a block's index on its level: more than the faces of a tool.
const PLACE_BITS: usize = 24;
/// Capacity of a set.
pub(crate) const MAX_BLOCKS: usize = 16;
/// A block is opened if at most this many of its boxes are near; with more, the next box of the
/// surface decides better.
const OPENED: u32 = 2;
/// Capacity for unopened blocks: a set, and all but one of each level of the largest tool.
const WAITING: usize = MAX_BLOCKS + 8 * WIDTH;

/// Blocks of a tool that contain everything near a box: a traversal of the other body's tree
/// carries them down. Of the numbers, which are levels and indices, so many are valid as are
/// counted with them.
pub(crate) type BlockSet = [u32; MAX_BLOCKS];

/// Level and index in one number.
fn block_at(level: usize, place: usize) -> u32 {
    (level << PLACE_BITS | place) as u32
}

/// Level and index of a block.
fn level_and_place(block: u32) -> (usize, usize) {
    let block = block as usize;
    (block >> PLACE_BITS, block & ((1 << PLACE_BITS) - 1))
}

impl Blocks {
    /// A tree over faces in spatial order; without boxes.
    pub(crate) fn new(order: Vec<u32>) -> Self {
        let (mut levels, mut count) = (vec![0], order.len().div_ceil(WIDTH));
        let (faces, mut whole) = (vec![Corners::NONE; count], count);
        while count > TOP {
            levels.push(whole);
            count = count.div_ceil(WIDTH);
            whole += count;
        }
        Self {
            order,
            blocks: vec![Block::NOWHERE; whole],
            faces,
            levels,
            extent: 0.0,
        }
    }

    /// Updates the boxes from the corners of the faces.
    pub(crate) fn refit(&mut self, corners: impl Fn(u32) -> [DVec3; 3]) {
        for (place, &face) in self.order.iter().enumerate() {
            let corners @ [a, b, c] = corners(face);
            self.faces[place / WIDTH].set(place % WIDTH, corners);
            let (lower, upper) = (a.min(b).min(c), a.max(b).max(c));
            let rounding = ROUNDING * lower.abs().max(upper.abs());
            let aabb = Aabb {
                lower: (lower - rounding).as_vec3(),
                upper: (upper + rounding).as_vec3(),
            };
            self.blocks[place / WIDTH].set(place % WIDTH, &aabb);
        }
        for level in 1..self.levels.len() {
            let (below, begin) = (self.levels[level - 1], self.levels[level]);
            for place in below..begin {
                let union = self.blocks[place].union();
                let up = place - below;
                self.blocks[begin + up / WIDTH].set(up % WIDTH, &union);
            }
        }
        let top = self.levels.last().map_or(0, |&top| top);
        let farthest = |block: &Block| {
            let Aabb { lower, upper } = block.union();
            lower.abs().max(upper.abs()).max_element()
        };
        self.extent = self.blocks[top..].iter().map(farthest).fold(0.0, f32::max);
    }

    /// Bound of the absolute coordinates of all boxes.
    pub(crate) fn extent(&self) -> f32 {
        self.extent
    }

    /// The set of all blocks, and how many these are.
    pub(crate) fn whole(&self) -> (BlockSet, usize) {
        let (mut set, top) = ([0; MAX_BLOCKS], self.levels.len() - 1);
        let count = self.count_on(top);
        for (place, block) in set[..count].iter_mut().enumerate() {
            *block = block_at(top, place);
        }
        (set, count)
    }

    fn count_on(&self, level: usize) -> usize {
        let end = self.levels.get(level + 1).copied();
        end.unwrap_or(self.blocks.len()) - self.levels[level]
    }

    /// Writes the part of a set that may be near to `found`, which has room for [`MAX_BLOCKS`], and
    /// returns how many blocks these are; adds the number of blocks tested to `cost`.
    #[inline]
    pub(crate) fn within(
        &self,
        near: &BoxWithin,
        set: &[u32],
        found: &mut [u32],
        cost: &mut u32,
    ) -> usize {
        let mut count = 0;
        *cost += set.len() as u32;
        for (k, &block) in set.iter().enumerate() {
            let (level, place) = level_and_place(block);
            let mut which = near.of(&self.blocks[self.levels[level] + place]);
            if which == 0 {
                continue;
            }
            let room = MAX_BLOCKS - count - (set.len() - k - 1);
            let below = which.count_ones();
            if level <= 1 || below > OPENED || below as usize > room {
                found[count] = block;
                count += 1;
                continue;
            }
            let most = self.count_on(level - 1);
            while which != 0 {
                let place = WIDTH * place + which.trailing_zeros() as usize;
                which &= which - 1;
                // An empty box may seem near at the largest numbers.
                if place < most {
                    found[count] = block_at(level - 1, place);
                    count += 1;
                }
            }
        }
        count
    }

    /// Whether any face may be near.
    pub(crate) fn any(&self, near: &BoxWithin) -> bool {
        let mut found = false;
        let (whole, count) = self.whole();
        let whole = &whole[..count];
        self.faces(near, (whole, || []), 0, &mut 0, [u32::MAX, 0], |_| {
            found = true;
            false
        });
        found
    }

    /// Calls `visit` with the faces of a set that may be near and inside all slabs, in the order of
    /// the tool's tree from the place `from` on, until it returns false; adds the number of blocks
    /// tested, and what each face costs, to `cost`. If that would exceed `most`, returns the place
    /// at which to continue. The slabs are computed when a box is near.
    #[inline]
    pub(crate) fn faces<const N: usize>(
        &self,
        near: &BoxWithin,
        (set, slabs): (&[u32], impl Fn() -> [Slab; N]),
        from: u32,
        cost: &mut u32,
        [most, of_face]: [u32; 2],
        mut visit: impl FnMut(u32) -> bool,
    ) -> Option<u32> {
        let mut waiting = [0u32; WAITING];
        let (mut count, mut made) = (set.len(), None);
        for (entry, &block) in waiting.iter_mut().zip(set.iter().rev()) {
            *entry = block;
        }
        while count > 0 {
            count -= 1;
            let (level, place) = level_and_place(waiting[count]);
            let [first, end] =
                [place, place + 1].map(|at| (at as u64) << (LOG_WIDTH * (level + 1)));
            if end <= u64::from(from) {
                continue;
            }
            if *cost >= most {
                return Some(from.max(first as u32));
            }
            *cost += 1;
            let block = &self.blocks[self.levels[level] + place];
            let mut which = near.of(block);
            if which == 0 {
                continue;
            }
            for slab in made.get_or_insert_with(&slabs).iter() {
                which &= if level > 0 {
                    slab.of(block)
                } else {
                    slab.of_faces(&self.faces[place])
                };
            }
            if level > 0 {
                // The last first, so that the first is the next.
                while which != 0 {
                    let slot = which.ilog2();
                    which ^= 1 << slot;
                    let below = WIDTH * place + slot as usize;
                    if below < self.count_on(level - 1) {
                        waiting[count] = block_at(level - 1, below);
                        count += 1;
                    }
                }
                continue;
            }
            while which != 0 {
                let below = WIDTH * place + which.trailing_zeros() as usize;
                which &= which - 1;
                if below < from as usize {
                    continue;
                }
                if let Some(&face) = self.order.get(below) {
                    if *cost + of_face > most {
                        return Some(below as u32);
                    }
                    *cost += of_face;
                    if !visit(face) {
                        return None;
                    }
                }
            }
        }
        None
    }
}
