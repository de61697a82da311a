//! How many cells the grid of a model has when nobody says so.

use crate::manifold::ManifoldMesh;
use crate::tuning::regions::{
    CELLS_A_FACE, CROWDED_FACES, FACES_A_REGION, FACES_A_TASK, MIN_FACES_A_REGION, SURELY_TOO_MANY,
    TYPICAL_FACES,
};
use glam::DVec3;
use rayon::prelude::*;
use spm::RegionGrid;

/// The coarsest grid whose occupied regions own few faces: at median, and where half of the faces
/// are; or the finest whose faces are not scattered over too many. Where others are crowded in that
/// grid, the coarsest that shares them out too, if its regions still own some faces.
pub fn default_grid(lower: DVec3, upper: DVec3, mesh: &ManifoldMesh) -> Option<RegionGrid> {
    let mut divisions = 1;
    let mut coarser = None;
    // The coarsest that is right but for a crowd: what a finer one has to be better than.
    let mut kept = None;
    loop {
        let grid = RegionGrid::new(lower, upper, divisions)?;
        let finest = divisions == RegionGrid::MAX_DIVISIONS;
        let cells: f64 = grid.cells.map(f64::from).iter().product();
        // Not counted while even the mean of all cells is far beyond.
        let too_many = mesh.triangles.len() as f64 > SURELY_TOO_MANY * FACES_A_REGION * cells;
        if !too_many {
            let owned = Owned::count(&grid, mesh);
            if owned.pairs > CELLS_A_FACE * mesh.triangles.len() && coarser.is_some() {
                return kept.or(coarser);
            }
            // Every touch of a floor that is cut into cells of a face or two pays for it.
            if kept.is_some() && owned.pairs < MIN_FACES_A_REGION * owned.regions {
                return kept;
            }
            let few = owned.median <= FACES_A_REGION && owned.typical <= TYPICAL_FACES;
            if few && owned.crowded <= CROWDED_FACES {
                return Some(grid);
            }
            kept = kept.or(few.then_some(grid));
        }
        if finest {
            return kept.or(Some(grid));
        }
        coarser = Some(grid);
        divisions *= 2;
    }
}

/// What the regions of a grid own.
struct Owned {
    /// Pairs of a face and a region that owns it.
    pairs: usize,
    /// Regions that own a face.
    regions: usize,
    /// Faces of an occupied region at median.
    median: f64,
    /// Faces of the region in which the median face lies: a floor of two triangles occupies many
    /// regions, and what stands on it a few.
    typical: f64,
    /// Faces of the region up to which 95 % of the pairs of face and region are: on a floor of many
    /// triangles lies the median face too.
    crowded: f64,
}

impl Owned {
    fn count(grid: &RegionGrid, mesh: &ManifoldMesh) -> Self {
        let owners_of = |faces: &[[u32; 3]]| {
            let mut owners = Vec::with_capacity(faces.len() * 3 / 2);
            for t in faces {
                grid.for_each_owner(mesh.corners(t), |region| owners.push(region.0));
            }
            owners
        };
        let chunks = mesh.triangles.par_chunks(FACES_A_TASK);
        let mut owners: Vec<u32> = chunks.flat_map_iter(owners_of).collect();
        owners.par_sort_unstable();
        let mut counts: Vec<usize> = owners.chunk_by(|a, b| a == b).map(<[u32]>::len).collect();
        counts.sort_unstable();
        // Of the region up to which the smaller ones have so many of 20 pairs of face and region.
        let up_to = |twentieths: usize| {
            let mut passed = 0usize;
            let found = counts.iter().find(|&&count| {
                passed += count;
                20 * passed > twentieths * owners.len()
            });
            found.copied().unwrap_or(0) as f64
        };
        Self {
            pairs: owners.len(),
            regions: counts.len(),
            median: counts[counts.len() / 2] as f64,
            typical: up_to(10),
            crowded: up_to(19),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clean::clean;
    use crate::generate::{Shape, generate};
    use crate::manifold::cut_to_manifold;
    use crate::mesh::SoupMesh;
    use crate::order;
    use spm::RegionId;
    use std::collections::BTreeMap;

    /// A cylinder with a fan of so many faces on each cap.
    fn cylinder(ring: u32) -> ManifoldMesh {
        let mut mesh = SoupMesh {
            positions: vec![[0.0, 0.0, -0.5], [0.0, 0.0, 0.5]],
            triangles: Vec::new(),
        };
        for k in 0..ring {
            let angle = std::f64::consts::TAU * f64::from(k) / f64::from(ring);
            let (sin, cos) = angle.sin_cos();
            mesh.positions.extend([-0.5, 0.5].map(|z| [cos, sin, z]));
            let (a, b) = (2 + 2 * k, 2 + 2 * ((k + 1) % ring));
            let sides = [
                [0, b, a],
                [1, a + 1, b + 1],
                [a, b, a + 1],
                [b, b + 1, a + 1],
            ];
            mesh.triangles.extend(sides);
        }
        ordered(mesh)
    }

    fn ordered(mesh: SoupMesh) -> ManifoldMesh {
        order::in_tree_order(cut_to_manifold(&clean(mesh).unwrap()))
    }

    fn grid_of(mesh: &ManifoldMesh) -> RegionGrid {
        let bounds = crate::assemble::bounds_of(mesh);
        default_grid(bounds.lower.as_dvec3(), bounds.upper.as_dvec3(), mesh).unwrap()
    }

    #[test]
    fn a_small_object_on_a_large_floor_is_shared_out_among_regions() {
        let mut mesh = generate(Shape::Sphere, 20_000, 1);
        let first = mesh.positions.len() as u32;
        let corners = [[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]];
        let corners = corners.map(|[x, y]| [x, y, -2.0]);
        mesh.positions.extend(corners);
        let floor = [[0, 1, 2], [0, 2, 3]];
        mesh.triangles.extend(floor.map(|t| t.map(|k| first + k)));
        let mesh = ordered(mesh);
        let owned = Owned::count(&grid_of(&mesh), &mesh);
        assert!(owned.typical <= TYPICAL_FACES, "{}", owned.typical);
        assert!(owned.pairs <= CELLS_A_FACE * mesh.triangles.len());
    }

    /// A ball over a floor of side 100, which has more faces than it: so the median face is one of
    /// the floor.
    fn ball_over_a_floor(faces: u32, radius: f64) -> ManifoldMesh {
        let mut mesh = generate(Shape::Plate, 60_000, 1);
        for position in &mut mesh.positions {
            *position = position.map(|x| 50.0 * x);
        }
        let first = mesh.positions.len() as u32;
        let ball = generate(Shape::Sphere, faces, 1);
        // Off the walls of all cells: they would cut it in four.
        let above =
            |p: [f64; 3]| (DVec3::from(p) * radius + DVec3::new(0.03, 0.02, 2.0)).to_array();
        mesh.positions.extend(ball.positions.into_iter().map(above));
        let of_ball = ball.triangles.iter().map(|t| t.map(|v| first + v));
        mesh.triangles.extend(of_ball);
        ordered(mesh)
    }

    /// Faces of each region.
    fn owned_faces(grid: &RegionGrid, mesh: &ManifoldMesh) -> Vec<usize> {
        let mut owned: BTreeMap<RegionId, usize> = BTreeMap::new();
        for t in &mesh.triangles {
            grid.for_each_owner(mesh.corners(t), |region| {
                *owned.entry(region).or_default() += 1;
            });
        }
        owned.into_values().collect()
    }

    #[test]
    fn a_small_object_on_a_floor_of_many_faces_is_shared_out_too() {
        let mesh = ball_over_a_floor(40_000, 1.0);
        let grid = grid_of(&mesh);
        let owned = owned_faces(&grid, &mesh);
        let (most, faces) = (owned.iter().max().unwrap(), mesh.triangles.len());
        println!("{} divisions: {most} of {faces} faces", grid.divisions);
        assert!(20 * most <= faces, "{most} of {faces}");
        assert!(owned.iter().sum::<usize>() <= CELLS_A_FACE * faces);
    }

    /// It lies in one cell of every grid.
    #[test]
    fn what_no_grid_shares_out_cuts_no_floor_up() {
        let mesh = ball_over_a_floor(20_000, 0.01);
        let grid = grid_of(&mesh);
        let (regions, faces) = (owned_faces(&grid, &mesh).len(), mesh.triangles.len());
        println!("{} divisions: {regions} regions", grid.divisions);
        assert!(
            regions * MIN_FACES_A_REGION <= faces,
            "{regions} of {faces}"
        );
    }

    #[test]
    fn what_regions_own_grows_with_the_faces_of_a_fan_and_not_with_their_square() {
        for ring in [500, 1000, 2000, 4000, 8000, 16_000] {
            let mesh = cylinder(ring);
            let grid = grid_of(&mesh);
            let Owned { pairs, median, .. } = Owned::count(&grid, &mesh);
            println!(
                "{ring}: {} divisions, {pairs} pairs, median {median}",
                grid.divisions
            );
            assert!(
                pairs <= CELLS_A_FACE * mesh.triangles.len(),
                "{ring}: {pairs}"
            );
        }
    }
}
