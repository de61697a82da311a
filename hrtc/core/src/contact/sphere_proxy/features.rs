//! The least distance of the faces around each vertex and edge. It tells local minima of the
//! distance in linear time.

use crate::contact::query::MAX_FACES;
use spm::{Handle, NONE};

/// Table entries per face: three vertices, three edges, and free entries that keep searches short.
const PLACES_PER_FACE: usize = 8;
const MAX_PLACES: usize = (PLACES_PER_FACE * MAX_FACES).next_power_of_two();
const FEWEST_PLACES: usize = 64;
const EMPTY: u64 = u64::MAX;

/// A hash table of vertices and edges, by open addressing.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Features {
    #[serde(with = "serde_big_array::BigArray")]
    keys: [u64; MAX_PLACES],
    #[serde(with = "serde_big_array::BigArray")]
    least: [f64; MAX_PLACES],
    /// Entries in use now, a power of two.
    places: usize,
}

impl Features {
    /// An empty table.
    pub fn new() -> Self {
        Self {
            keys: [EMPTY; MAX_PLACES],
            least: [0.0; MAX_PLACES],
            places: FEWEST_PLACES,
        }
    }

    /// Clears the table for a number of faces, at most [`MAX_FACES`].
    pub fn begin(&mut self, faces: usize) {
        let wanted = (PLACES_PER_FACE * faces).next_power_of_two();
        self.places = wanted.clamp(FEWEST_PLACES, MAX_PLACES);
        self.keys[..self.places].fill(EMPTY);
    }

    /// Notes a face and its distance.
    pub fn note(&mut self, vertices: [Handle; 3], distance: f64) {
        let [a, b, c] = vertices;
        for key in [
            key(a, a),
            key(b, b),
            key(c, c),
            key(a, b),
            key(b, c),
            key(c, a),
        ] {
            let place = self.place(key);
            if self.keys[place] == EMPTY {
                self.keys[place] = key;
                self.least[place] = distance;
            } else {
                self.least[place] = self.least[place].min(distance);
            }
        }
    }

    /// The least distance of the faces that hold a feature: two vertices and a [`NONE`] for an
    /// edge, one vertex and two for a vertex. Infinite if no face was noted, and for the inside of
    /// a face.
    pub fn least(&self, feature: [Handle; 3]) -> f64 {
        let mut vertices = feature.into_iter().filter(|&v| v != NONE);
        let key = match (vertices.next(), vertices.next(), vertices.next()) {
            (Some(a), None, _) => key(a, a),
            (Some(a), Some(b), None) => key(a, b),
            _ => return f64::INFINITY,
        };
        let place = self.place(key);
        if self.keys[place] == EMPTY {
            f64::INFINITY
        } else {
            self.least[place]
        }
    }

    /// The entry of a key, present or not: the table is never full.
    fn place(&self, key: u64) -> usize {
        let mask = self.places - 1;
        // Fibonacci hashing: the upper bits of the product are the mixed ones.
        let hash = key.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32;
        let mut place = hash as usize & mask;
        while self.keys[place] != EMPTY && self.keys[place] != key {
            place = (place + 1) & mask;
        }
        place
    }
}

fn key(a: Handle, b: Handle) -> u64 {
    u64::from(a.min(b)) << 32 | u64::from(a.max(b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_least_is_that_of_a_search_through_all_faces(
            faces in prop::collection::vec(([0u32..30, 0u32..30, 0u32..30], 0.0..1.0f64), 0..MAX_FACES),
            asked in [0u32..30, 0u32..30],
        ) {
            let mut features = Features::new();
            // The content of another tick does not matter.
            features.begin(MAX_FACES);
            features.note([1, 2, 3], 1e-9);
            features.begin(faces.len());
            for &(vertices, distance) in &faces {
                features.note(vertices, distance);
            }
            let least = |holds: &dyn Fn(&[u32; 3]) -> bool| {
                let held = faces.iter().filter(|(vertices, _)| holds(vertices));
                held.map(|&(_, distance)| distance).fold(f64::INFINITY, f64::min)
            };
            let [a, b] = asked;
            prop_assert_eq!(features.least([a, NONE, NONE]), least(&|v| v.contains(&a)));
            if a != b {
                let both = least(&|v| v.contains(&a) && v.contains(&b));
                prop_assert_eq!(features.least([NONE, a, b]), both);
            }
        }
    }
}
