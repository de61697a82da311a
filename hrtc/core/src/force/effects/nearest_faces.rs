//! The nearest faces of a search, as many as there is room for.

use crate::tuning::force::MAX_SHADING_FACES;
use glam::DVec3;

/// A face and its place in a search.
#[derive(Debug, Clone, Copy)]
pub struct FaceNear {
    /// Unit normal; zero without area.
    pub normal: DVec3,
    /// Area that counts, square model units.
    pub area: f64,
    /// Cosine between its normal and the direction to the centre.
    pub faces: f64,
    /// Squared distance from the centre, square model units.
    pub distance_squared: f64,
}

impl FaceNear {
    const NONE: Self = Self {
        normal: DVec3::ZERO,
        area: 0.0,
        faces: 0.0,
        distance_squared: 0.0,
    };
}

/// Faces of a search in the order in which they came; once full a heap, the farthest first.
pub struct NearestFaces {
    faces: [FaceNear; MAX_SHADING_FACES],
    count: usize,
    room: usize,
    within: f64,
    is_cut: bool,
}

impl NearestFaces {
    /// No faces of a search up to a distance, one of so many searches that share the room.
    pub fn new(within: f64, searches: usize) -> Self {
        let room = (MAX_SHADING_FACES / searches.max(1)).max(1);
        Self {
            faces: [FaceNear::NONE; MAX_SHADING_FACES],
            count: 0,
            room,
            within,
            is_cut: false,
        }
    }

    /// Takes a face in, if it is one of the nearest. Returns the distance up to which the search
    /// goes on.
    pub fn add(&mut self, face: FaceNear) -> f64 {
        if self.count < self.room {
            self.faces[self.count] = face;
            self.count += 1;
            return self.within;
        }
        if !self.is_cut {
            self.is_cut = true;
            for place in (0..self.count / 2).rev() {
                self.sink(place);
            }
        }
        if face.distance_squared < self.farthest_squared() {
            self.faces[0] = face;
            self.sink(0);
        }
        self.farthest_squared().sqrt().min(self.within)
    }

    /// How many there is room for.
    pub fn room(&self) -> usize {
        self.room
    }

    /// The faces.
    pub fn all(&self) -> &[FaceNear] {
        &self.faces[..self.count]
    }

    /// Whether there were more than there is room for.
    pub fn is_cut(&self) -> bool {
        self.is_cut
    }

    /// Squared distance of the farthest face of a full heap.
    pub fn farthest_squared(&self) -> f64 {
        self.faces[0].distance_squared
    }

    /// Moves a face down to its place in the heap.
    fn sink(&mut self, mut place: usize) {
        loop {
            let children = [2 * place + 1, 2 * place + 2].into_iter();
            let farther = |&a: &usize, &b: &usize| {
                let [a, b] = [a, b].map(|k| self.faces[k].distance_squared);
                a.total_cmp(&b)
            };
            let Some(child) = children.filter(|&k| k < self.count).max_by(farther) else {
                return;
            };
            if self.faces[child].distance_squared <= self.faces[place].distance_squared {
                return;
            }
            self.faces.swap(child, place);
            place = child;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_nearest_are_kept_in_any_order(
            distances in prop::collection::vec(0.0..1.0f64, 1..200), searches in 1..200usize,
        ) {
            let mut nearest = NearestFaces::new(1.0, searches);
            let room = nearest.room;
            let mut sorted = Vec::new();
            let mut within = 1.0;
            for &distance in &distances {
                // What is farther a search leaves out.
                if distance <= within {
                    within = nearest.add(FaceNear {
                        distance_squared: distance * distance,
                        ..FaceNear::NONE
                    });
                    prop_assert!(within <= 1.0);
                }
                sorted.push(distance * distance);
            }
            sorted.sort_by(f64::total_cmp);
            sorted.truncate(room);
            let mut kept: Vec<f64> = nearest.all().iter().map(|of| of.distance_squared).collect();
            prop_assert_eq!(nearest.is_cut(), distances.len() > room);
            if nearest.is_cut() {
                prop_assert_eq!(sorted.last(), Some(&nearest.farthest_squared()));
            }
            kept.sort_by(f64::total_cmp);
            prop_assert_eq!(kept, sorted);
        }
    }
}
