//! The simplifier of meshoptimizer (zeux/meshoptimizer through the crate `meshopt`).

use glam::DVec3;
use meshopt::SimplifyOptions;
use std::collections::BTreeMap;

/// A mesh with its equal positions welded, as `meshopt_simplify` wants it.
#[derive(Debug)]
pub struct Welded {
    positions: Vec<[f32; 3]>,
    indices: Vec<u32>,
}

impl Welded {
    /// Welds corners of bit-equal position. The positions must come from f32, as a model's do.
    #[must_use]
    pub fn new(triangles: &[[DVec3; 3]]) -> Self {
        let mut known = BTreeMap::new();
        let mut positions = Vec::new();
        let indices = triangles
            .iter()
            .flatten()
            .map(|&corner| {
                let position = corner.as_vec3().to_array();
                *known.entry(position.map(f32::to_bits)).or_insert_with(|| {
                    positions.push(position);
                    positions.len() as u32 - 1
                })
            })
            .collect();
        Self { positions, indices }
    }

    /// Simplifies to `faces`, or to more where the simplifier finds no further collapse. Its
    /// default options; its limit on the error is lifted, so that the number of faces alone
    /// decides.
    #[must_use]
    pub fn simplify(&self, faces: u32) -> Vec<[DVec3; 3]> {
        let left = meshopt::simplify_decoder(
            &self.indices,
            &self.positions,
            3 * faces as usize,
            f32::MAX,
            SimplifyOptions::None,
            None,
        );
        let corner = |index: u32| glam::Vec3::from_array(self.positions[index as usize]).as_dvec3();
        left.chunks_exact(3)
            .map(|t| [corner(t[0]), corner(t[1]), corner(t[2])])
            .collect()
    }
}
