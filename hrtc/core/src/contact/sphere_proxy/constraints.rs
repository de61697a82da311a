//! The half-spaces around the proxy, and the faces in reach without one.
//!
//! A face is linearised to the half-space beyond which its nearest point is closer than the radius.
//! That is safe along any motion, for the whole face is behind it, but constrains too much if the
//! nearest point is on an edge shared with a nearer face: a sphere sliding over a plate would halve
//! its motion at every edge. So only local minima of the distance get a half-space (Johnson &
//! Willemsen 2003). The other faces are tested along the motion itself, if it leaves their
//! half-space.

use crate::contact::query::{MAX_FACES, NearFace, NearFaces, Work};
use crate::contact::sphere_proxy::features::Features;
use crate::contact::sphere_proxy::projection::Plane;
use geometry::ClosestPoint;
use glam::DVec3;
use mutants::{Mutant, is};
use spm::{Handle, NONE};

/// Capacity for half-spaces; the deepest are kept, the others counted.
pub const MAX_CONSTRAINTS: usize = 64;

/// A face in reach.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Candidate {
    near: NearFace,
    plane: Plane,
    point: DVec3,
    distance: f64,
    /// Corners of the simplex that contains the nearest point; [`NONE`] for the others.
    feature: [Handle; 3],
    has_plane: bool,
}

/// Half-spaces of displacements from the proxy.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Constraints {
    #[serde(with = "serde_big_array::BigArray")]
    candidates: [Candidate; MAX_FACES],
    candidate_count: usize,
    features: Features,
    #[serde(with = "serde_big_array::BigArray")]
    planes: [Plane; MAX_CONSTRAINTS],
    /// The candidate of each plane.
    #[serde(with = "serde_big_array::BigArray")]
    sources: [usize; MAX_CONSTRAINTS],
    count: usize,
    high_water: usize,
    dropped: u32,
}

const NO_PLANE: Plane = Plane {
    normal: DVec3::ZERO,
    offset: 0.0,
};

impl Constraints {
    /// No half-spaces.
    pub fn new() -> Self {
        let candidate = Candidate {
            near: NearFace::NONE,
            plane: NO_PLANE,
            point: DVec3::ZERO,
            distance: 0.0,
            feature: [NONE; 3],
            has_plane: false,
        };
        Self {
            candidates: [candidate; MAX_FACES],
            candidate_count: 0,
            features: Features::new(),
            planes: [NO_PLANE; MAX_CONSTRAINTS],
            sources: [0; MAX_CONSTRAINTS],
            count: 0,
            high_water: 0,
            dropped: 0,
        }
    }

    /// Largest number of half-spaces so far.
    pub fn high_water(&self) -> usize {
        self.high_water
    }

    /// The half-spaces.
    pub fn planes(&self) -> &[Plane] {
        &self.planes[..self.count]
    }

    /// Half-spaces beyond the capacity.
    pub fn dropped(&self) -> u32 {
        self.dropped
    }

    /// The face of a half-space, and its point nearest to the proxy.
    pub fn source(&self, plane: usize) -> (Handle, DVec3) {
        let candidate = &self.candidates[self.sources[plane]];
        (candidate.near.face, candidate.point)
    }

    /// Linearises every face within radius + `reach` of `position`; that ball must be covered.
    ///
    /// Half-spaces have the local minima of the distance, and every face nearer than `inside`, in
    /// which a split may have left the ball: it would stop any sweep towards it at once, and the
    /// ball would stick.
    pub fn linearise(
        &mut self,
        near: &NearFaces,
        position: DVec3,
        [radius, inside]: [f64; 2],
        reach: f64,
    ) -> Work {
        self.count = 0;
        self.dropped = 0;
        self.candidate_count = 0;
        let work = near.within(position, radius + reach, |face, closest| {
            if let Some(candidate) = Candidate::of(face, &closest, position, radius)
                && self.candidate_count < MAX_FACES
            {
                self.candidates[self.candidate_count] = candidate;
                self.candidate_count += 1;
            }
        });
        self.features.begin(self.candidate_count);
        for candidate in &self.candidates[..self.candidate_count] {
            self.features
                .note(candidate.near.vertices, candidate.distance);
        }
        for k in 0..self.candidate_count {
            // A local minimum: no nearer face holds the feature of the nearest point.
            let Candidate {
                feature, distance, ..
            } = self.candidates[k];
            let has_plane = self.features.least(feature) >= distance || distance < inside;
            self.candidates[k].has_plane = has_plane;
            if has_plane && (k > 0 || !is(Mutant::Constraint)) {
                self.add(k);
            }
        }
        self.high_water = self.high_water.max(self.count);
        work
    }

    /// Adds a half-space; if full, the one with the most room is dropped.
    fn add(&mut self, candidate: usize) {
        let plane = self.candidates[candidate].plane;
        let place = if self.count < MAX_CONSTRAINTS {
            self.count += 1;
            self.count - 1
        } else {
            self.dropped += 1;
            let mut loosest = 0;
            for k in 1..MAX_CONSTRAINTS {
                if self.planes[k].offset < self.planes[loosest].offset {
                    loosest = k;
                }
            }
            if self.planes[loosest].offset >= plane.offset {
                return;
            }
            loosest
        };
        self.planes[place] = plane;
        self.sources[place] = candidate;
    }

    /// The half-space with the least room, if a face is closer than the radius.
    pub fn deepest(&self) -> Option<usize> {
        let deepest = (0..self.count)
            .max_by(|&a, &b| self.planes[a].offset.total_cmp(&self.planes[b].offset))?;
        (self.planes[deepest].offset > 0.0).then_some(deepest)
    }

    /// The free fraction of a motion that obeys every half-space, with respect to the faces without
    /// one.
    pub fn free_fraction(&self, position: DVec3, motion: DVec3, radius: f64) -> (f64, Work) {
        let mut fraction = 1.0;
        let mut work = Work::default();
        for candidate in &self.candidates[..self.candidate_count] {
            let plane = &candidate.plane;
            let inside = plane.normal.dot(motion) * fraction >= plane.offset.min(0.0);
            if candidate.has_plane || inside {
                continue;
            }
            work.faces += 1;
            if let Some(t) = candidate
                .near
                .first_contact(position, motion, radius, fraction)
            {
                fraction = t;
            }
        }
        (fraction, work)
    }
}

impl Candidate {
    /// `None` for a face without area through the centre: it has no side.
    fn of(near: &NearFace, closest: &ClosestPoint, position: DVec3, radius: f64) -> Option<Self> {
        let distance = closest.distance_squared.sqrt();
        let away = position - closest.point;
        // A centre exactly on a face has no side; the face's own normal decides.
        let normal = if distance > 0.0 {
            away / distance
        } else {
            let [a, b, c] = near.corners;
            (b - a).cross(c - a).try_normalize()?
        };
        let mut feature = near.vertices;
        for (vertex, weight) in feature.iter_mut().zip(closest.weights) {
            if weight == 0.0 {
                *vertex = NONE;
            }
        }
        Some(Self {
            near: *near,
            plane: Plane {
                normal,
                offset: radius - distance,
            },
            point: closest.point,
            distance,
            feature,
            has_plane: false,
        })
    }
}
