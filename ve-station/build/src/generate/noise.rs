//! Gradient noise (after Perlin 2002) with hashed gradients: smooth, seeded, no tables.

use glam::{DVec3, I64Vec3};

/// A field of smooth random values.
#[derive(Debug, Clone, Copy)]
pub(super) struct Noise {
    seed: u64,
}

impl Noise {
    pub(super) fn new(seed: u64) -> Self {
        Self { seed }
    }

    /// A sum of octaves, each twice as fine and `gain` times as high; about -1 to 1.
    pub(super) fn fractal(&self, point: DVec3, octaves: u32, gain: f64) -> f64 {
        let (mut sum, mut height, mut at) = (0.0, 1.0, point);
        for octave in 0..octaves {
            // Shifted, so that the lattices of the octaves do not coincide.
            sum += height * self.single(at + DVec3::splat(0.37 * f64::from(octave)));
            height *= gain;
            at *= 2.0;
        }
        sum
    }

    fn single(&self, point: DVec3) -> f64 {
        let cell = point.floor();
        let inside = point - cell;
        let fade = inside * inside * inside * (inside * (inside * 6.0 - 15.0) + 10.0);
        let mut value = 0.0;
        for corner in 0..8 {
            let offset = DVec3::new(
                f64::from(corner & 1),
                f64::from(corner >> 1 & 1),
                f64::from(corner >> 2),
            );
            let weight = (DVec3::ONE - offset) + (offset * 2.0 - 1.0) * fade;
            let gradient = self.gradient((cell + offset).as_i64vec3());
            value += weight.x * weight.y * weight.z * gradient.dot(inside - offset);
        }
        value
    }

    /// One of the twelve directions to the edges of a cube.
    fn gradient(&self, lattice: I64Vec3) -> DVec3 {
        let mut hash = self.seed;
        for x in lattice.to_array() {
            hash = scramble(hash ^ x as u64);
        }
        let sign = |bit: u32| if hash >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let (a, b) = (sign(0), sign(1));
        match (hash >> 8) % 3 {
            0 => DVec3::new(a, b, 0.0),
            1 => DVec3::new(0.0, a, b),
            _ => DVec3::new(b, 0.0, a),
        }
    }
}

/// The finaliser of splitmix64 (Steele, Lea and Flood 2014).
fn scramble(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
}
