//! Which VSPs a region needs, so that inside its cell the refined surface is the full mesh's.
//!
//! A region starts from the VSPs that made the faces it owns and their corners (thesis 5.3.1.1).
//! Their closure makes every owned face, but others may still be coarse there, and on about one
//! region in a hundred of a real scan such a face pokes into the cell. So the seeds are extended
//! until none can:
//!
//! - The *descendant bounds* of a vertex are the box of its position and those of all its
//!   descendants, the bounds of a face the convex hull of its corners' boxes.
//! - While the closure leaves a face with a corner to split whose bounds overlap the cell, the VSP
//!   that splits its corner with the largest box becomes a seed.
//!
//! That is enough for *every* front that holds the closure, unions with closures of other regions
//! and half-refined fronts among them. The corners of a face of such a front descend from the
//! corners of one face of the closure's own front (from all three, from the two ends of an edge, or
//! from one): so it lies in that face's bounds. If these miss the cell, so does the face; if
//! not, nothing is left to split there, and the face is one of the full mesh. Hence the faces that
//! overlap a loaded cell are exactly those of the full mesh that do. (Splitting until no *face* of
//! the closure's own front overlaps the cell costs less, up to 0.1 % more VSPs instead of 1 to 5 %,
//! but left two of 66 blocks of 3 x 3 x 3 regions of the dragon with a coarse face in a loaded
//! cell.)
//!
//! Cells without a face of the full mesh that a face of the base mesh overlaps become regions too,
//! the *empty* ones: once loaded they are as empty as they look. A cell that only faces between
//! the base and the full mesh ever enter has no region, and of it nothing is promised. (None of
//! 3600 such cells beside loaded ones held a face: `loaded_cells_are_the_full_mesh.rs`.)
//!
//! Regions are searched in parallel, each by itself.
//!
//! Memory: 28 B a vertex (box, and the VSP that splits it), 12 B a face (corners), 8 B a VSP and
//! search; a search itself keeps no more than one closure.

use crate::ids::Ids;
use crate::manifold::ManifoldMesh;
use crate::progress::Progress;
use crate::tuning::regions::{FACES_A_TASK, MAX_SEARCHES, REGIONS_A_BATCH, REGIONS_A_TURN};
use geometry::Aabb;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use spm::{BaseFace, BaseVertex};
use spm::{NONE, RegionGrid, RegionId, VspRecord};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The region index and what is counted of it.
#[derive(Debug, Default)]
pub struct Regions {
    /// All regions, ascending.
    pub regions: Vec<RegionId>,
    /// Start of each region's seeds, and the end of the last one's.
    pub seed_offsets: Vec<u32>,
    /// Seeds, ascending in each region.
    pub seeds: Vec<u32>,
    /// Regions that own no face and keep their cell clear.
    pub empty: u64,
    /// Mean closure of a region that owns faces, VSPs.
    pub closure_mean: f64,
    /// Largest closure of a region, VSPs.
    pub closure_max: u32,
}

/// The model as far as regions need it.
pub struct Model<'a> {
    /// The grid.
    pub grid: &'a RegionGrid,
    /// The full mesh, in tree order.
    pub mesh: &'a ManifoldMesh,
    /// Its ids.
    pub ids: &'a Ids,
    /// Vertices of the base mesh.
    pub base_vertices: &'a [BaseVertex],
    /// Faces of the base mesh.
    pub base_faces: &'a [BaseFace],
    /// Records, ascending.
    pub records: &'a [VspRecord],
}

/// Key of a region that owns faces, above those of its seeds.
const OWNS: u32 = NONE;
/// Key of a region that a face of the base mesh overlaps.
const TO_CLEAR: u32 = NONE - 1;

/// Finds all regions, their seeds and the sizes of their closures.
pub fn regions_of(model: &Model<'_>, progress: &dyn Progress) -> Regions {
    let keys = keys(model);
    let bounds = DescendantBounds::new(model);
    let mut searches: Vec<Search> = (0..rayon::current_num_threads().min(MAX_SEARCHES))
        .map(|_| Search::new(model, &bounds))
        .collect();
    let regions: Vec<&[u64]> = keys.chunk_by(|a, b| a >> 32 == b >> 32).collect();
    progress.phase("clearing cells", regions.len() as u64);
    let mut found = Regions {
        seed_offsets: vec![0],
        seeds: Vec::with_capacity(keys.len()),
        ..Regions::default()
    };
    let (mut owning, mut sum) = (0u64, 0u64);
    for batch in regions.chunks(REGIONS_A_BATCH) {
        for extended in extend_all(&mut searches, batch) {
            if extended.owns {
                owning += 1;
                sum += u64::from(extended.closure);
            } else {
                found.empty += 1;
            }
            found.closure_max = found.closure_max.max(extended.closure);
            found.seeds.extend(extended.seeds);
            found.seed_offsets.push(found.seeds.len() as u32);
            found.regions.push(extended.region);
        }
        progress.done(found.regions.len() as u64);
    }
    found.closure_mean = sum as f64 / owning.max(1) as f64;
    found
}

/// A region with all its seeds.
struct Extended {
    region: RegionId,
    seeds: Vec<u32>,
    /// Size of its closure, VSPs.
    closure: u32,
    /// Whether it owns faces.
    owns: bool,
}

/// Extends the seeds of regions, each given by its keys; in their order, whoever did which.
fn extend_all(searches: &mut [Search<'_>], regions: &[&[u64]]) -> Vec<Extended> {
    let turns: Vec<&[&[u64]]> = regions.chunks(REGIONS_A_TURN).collect();
    let next = AtomicUsize::new(0);
    let mut done: Vec<(usize, Vec<Extended>)> = searches
        .par_iter_mut()
        .with_max_len(1)
        .flat_map_iter(|search| {
            let mut done = Vec::new();
            loop {
                let turn = next.fetch_add(1, Ordering::Relaxed);
                let Some(regions) = turns.get(turn) else {
                    return done;
                };
                let extended = regions.iter().map(|keys| search.extend(keys)).collect();
                done.push((turn, extended));
            }
        })
        .collect();
    done.sort_unstable_by_key(|&(turn, _)| turn);
    done.into_iter()
        .flat_map(|(_, extended)| extended)
        .collect()
}

/// For every region the VSPs that made the faces which it owns, and the corners of these, then what
/// it is there for; ascending.
fn keys(model: &Model<'_>) -> Vec<u64> {
    let key = |region: RegionId, vsp: u32| u64::from(region.0) << 32 | u64::from(vsp);
    let sizes = model.ids.sizes;
    // Faces that are near in the tree share regions and creators: each task keeps one of each.
    let keys_of = |(task, faces): (usize, &[[u32; 3]])| {
        let mut keys: Vec<u64> = Vec::with_capacity(faces.len() * 6);
        for (t, face) in faces.iter().zip((task * FACES_A_TASK) as u32..) {
            let [a, b, c] = t.map(|v| sizes.creator_of_vertex(model.ids.vertex[v as usize]));
            let creators = [sizes.creator_of_face(model.ids.face(face)), a, b, c];
            model.grid.for_each_owner(model.mesh.corners(t), |region| {
                keys.push(key(region, OWNS));
                keys.extend(creators.iter().flatten().map(|&vsp| key(region, vsp)));
            });
        }
        keys.sort_unstable();
        keys.dedup();
        keys
    };
    let chunks = model.mesh.triangles.par_chunks(FACES_A_TASK);
    let mut keys: Vec<u64> = chunks.enumerate().flat_map_iter(keys_of).collect();
    for base in model.base_faces {
        let position = |v: u32| Vec3::from_array(model.base_vertices[v as usize].position);
        let corners = base.corners.map(|v| position(v).as_dvec3());
        let mut to_clear = |region| keys.push(key(region, TO_CLEAR));
        model.grid.for_each_owner(corners, &mut to_clear);
    }
    keys.par_sort_unstable();
    keys.dedup();
    keys
}

#[derive(Clone, Copy)]
struct Step {
    stamp: u32,
    vs: u32,
}

/// What all searches look into.
struct DescendantBounds {
    /// The VSP that splits each vertex, [`NONE`] for a vertex of the full mesh.
    split_of: Vec<u32>,
    /// Box of each vertex and its descendants.
    of_vertex: Vec<Aabb>,
    /// Box of the bounds of each face of the base mesh that is not of the full mesh, and its id.
    base: Vec<(Aabb, u32)>,
    /// Corners of each face of the full mesh, vertex ids, by face id; [`NONE`] where an id has no
    /// face.
    corners: Vec<[u32; 3]>,
}

impl DescendantBounds {
    fn new(model: &Model<'_>) -> Self {
        let sizes = model.ids.sizes;
        let point = |p: [f32; 3]| Aabb::of_points([Vec3::from_array(p)]);
        let of_base = model.base_vertices.iter().map(|v| point(v.position));
        let mut of_vertex: Vec<Aabb> = Vec::with_capacity(sizes.vt(sizes.vsps) as usize);
        of_vertex.extend(of_base);
        let of_records = model.records.iter().flat_map(|r| [r.pos_t, r.pos_u]);
        of_vertex.extend(of_records.map(point));
        let mut split_of = vec![NONE; of_vertex.len()];
        // Children have larger ids than their parents.
        for record in model.records.iter().rev() {
            split_of[record.vs as usize] = record.i;
            let vt = sizes.vt(record.i) as usize;
            let children = of_vertex[vt].union(of_vertex[vt + 1]);
            let own = &mut of_vertex[record.vs as usize];
            *own = own.union(children);
        }
        let mut corners = vec![[NONE; 3]; sizes.fl(sizes.vsps) as usize];
        for (face, t) in (0u32..).zip(&model.mesh.triangles) {
            let ids = t.map(|v| model.ids.vertex[v as usize]);
            corners[model.ids.face(face) as usize] = ids;
        }
        let base = (0u32..)
            .zip(model.base_faces)
            .filter(|(face, base)| base.corners != corners[*face as usize])
            .map(|(face, base)| {
                let [a, b, c] = base.corners.map(|v| of_vertex[v as usize]);
                (a.union(b).union(c), face)
            })
            .collect();
        Self {
            split_of,
            of_vertex,
            base,
            corners,
        }
    }
}

/// Searches closures and the faces that they leave coarse.
struct Search<'a> {
    model: &'a Model<'a>,
    bounds: &'a DescendantBounds,
    /// Of each VSP: the region, counted from 1, whose closure last took it in, and the vertex that
    /// it splits. (Side by side: the way up from a vertex is most of the work, and records are far
    /// apart.)
    steps: Vec<Step>,
    stamp: u32,
    /// The closure; also the queue of its search.
    closure: Vec<u32>,
    /// Faces that may still be coarse inside the cell.
    suspects: Vec<u32>,
}

impl<'a> Search<'a> {
    fn new(model: &'a Model<'a>, bounds: &'a DescendantBounds) -> Self {
        Self {
            model,
            bounds,
            steps: model
                .records
                .iter()
                .map(|record| Step {
                    stamp: 0,
                    vs: record.vs,
                })
                .collect(),
            stamp: 0,
            closure: Vec::new(),
            suspects: Vec::new(),
        }
    }

    fn bounds_of(&self, corners: [u32; 3]) -> [Aabb; 3] {
        corners.map(|v| self.bounds.of_vertex[v as usize])
    }

    /// Adds to the seeds of a region, given by its keys, what keeps its cell clear; they end
    /// ascending.
    fn extend(&mut self, keys: &[u64]) -> Extended {
        let region = RegionId((keys[0] >> 32) as u32);
        let low = keys.iter().map(|&key| key as u32);
        let mut seeds: Vec<u32> = low.filter(|&vsp| vsp < TO_CLEAR).collect();
        let (lower, upper) = self.model.grid.cell_box(region);
        self.stamp += 1;
        self.closure.clear();
        let near = self.bounds.base.iter();
        let near = near.filter(|(bounds, _)| overlap(bounds, lower, upper));
        self.suspects.extend(near.map(|&(_, face)| face));
        let mut suspects = std::mem::take(&mut self.suspects);
        let sizes = self.model.ids.sizes;
        let (mut seeded, mut searched) = (0, 0);
        loop {
            for &seed in &seeds[seeded..] {
                self.visit(seed);
            }
            seeded = seeds.len();
            while let Some(&i) = self.closure.get(searched) {
                searched += 1;
                let fl = sizes.fl(i);
                suspects.extend([fl, fl + 1]);
                for dependency in self.model.records[i as usize].dependencies(sizes) {
                    self.visit(dependency);
                }
            }
            // The bounds of a face only shrink by splits: a face that misses the cell stays out.
            suspects.retain(|&face| match self.split_against(face, lower, upper) {
                Some(vsp) => {
                    seeds.push(vsp);
                    true
                }
                None => false,
            });
            if suspects.is_empty() {
                break;
            }
        }
        self.suspects = suspects;
        seeds.sort_unstable();
        seeds.dedup();
        Extended {
            region,
            seeds,
            closure: self.closure.len() as u32,
            owns: keys.last().is_some_and(|&key| key as u32 == OWNS),
        }
    }

    /// The split that a face needs so that neither it nor what comes of it is coarse in the box;
    /// `None` when it needs none.
    fn split_against(&self, face: u32, lower: DVec3, upper: DVec3) -> Option<u32> {
        let full = self.bounds.corners[face as usize];
        if full[0] == NONE {
            return None;
        }
        let corners = full.map(|v| self.active_ancestor(v));
        if corners == full || bounds_miss_box(self.bounds_of(corners), lower, upper) {
            return None;
        }
        corners
            .into_iter()
            .filter(|&v| self.bounds.split_of[v as usize] != NONE)
            .max_by(|&a, &b| {
                let size = |v: u32| self.bounds.of_vertex[v as usize].diagonal();
                size(a).total_cmp(&size(b))
            })
            .map(|v| self.bounds.split_of[v as usize])
    }

    fn visit(&mut self, vsp: u32) {
        let step = &mut self.steps[vsp as usize];
        if step.stamp != self.stamp {
            step.stamp = self.stamp;
            self.closure.push(vsp);
        }
    }

    /// The ancestor of a vertex that is active in the front of the closure.
    fn active_ancestor(&self, mut vertex: u32) -> u32 {
        while let Some(i) = self.model.ids.sizes.creator_of_vertex(vertex) {
            let step = self.steps[i as usize];
            if step.stamp == self.stamp {
                break;
            }
            vertex = step.vs;
        }
        vertex
    }
}

/// Whether two boxes share a point; what misses here overlaps no region either, bit for bit.
fn overlap(bounds: &Aabb, lower: DVec3, upper: DVec3) -> bool {
    bounds.lower.as_dvec3().cmple(upper).all() && bounds.upper.as_dvec3().cmpge(lower).all()
}

/// Whether the convex hull of three boxes surely misses a box: separating axes of the box and of
/// the triangle of the three centres, the half sides of the three taken off.
///
/// Not all axes of the hull, so it may say no where a gap is; and wherever it says yes the gap is
/// wider than what [`RegionGrid::overlaps`] takes for rounding.
fn bounds_miss_box(boxes: [Aabb; 3], lower: DVec3, upper: DVec3) -> bool {
    let [a, b, c] = boxes;
    if !overlap(&a.union(b).union(c), lower, upper) {
        return true;
    }
    let (middle, half) = ((lower + upper) * 0.5, (upper - lower) * 0.5);
    let centres = boxes.map(|h| (h.lower.as_dvec3() + h.upper.as_dvec3()) * 0.5 - middle);
    let halves = boxes.map(|h| (h.upper.as_dvec3() - h.lower.as_dvec3()) * 0.5);
    let separated = |axis: DVec3| {
        let along = axis.abs();
        let radius = half.dot(along);
        let slack = 64.0
            * f64::EPSILON
            * (radius
                + centres
                    .iter()
                    .map(|p| along.dot(p.abs()))
                    .fold(0.0, f64::max));
        let reach = |sign: f64| {
            (0..3)
                .map(|k| sign * axis.dot(centres[k]) - along.dot(halves[k]))
                .fold(f64::INFINITY, f64::min)
        };
        reach(1.0) > radius + slack || reach(-1.0) > radius + slack
    };
    let [p, q, r] = centres;
    let edges = [q - p, r - q, p - r];
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    separated(edges[0].cross(edges[1]))
        || edges
            .iter()
            .any(|edge| axes.iter().any(|&axis| separated(edge.cross(axis))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array)
    }

    proptest! {
        /// A triangle with one corner in each of three boxes that miss a cell misses it as well.
        #[test]
        fn a_triangle_in_boxes_that_miss_a_cell_misses_it(
            extents in prop::array::uniform3((vector(), vector(), 0.0..0.5f64)),
            weights in prop::array::uniform3(prop::array::uniform3(0.0..=1.0f32)),
            exponent in -6..6i32,
        ) {
            let scale = 10f64.powi(exponent);
            let boxes = extents.map(|(a, b, size)| {
                Aabb::of_points([(a * scale).as_vec3(), (a + b * size).as_vec3() * scale as f32])
            });
            let grid = RegionGrid::new(DVec3::splat(-scale), DVec3::splat(scale), 8).unwrap();
            let mut corners = [DVec3::ZERO; 3];
            for k in 0..3 {
                let inside = boxes[k].lower
                    + (boxes[k].upper - boxes[k].lower) * Vec3::from_array(weights[k]);
                corners[k] = inside.clamp(boxes[k].lower, boxes[k].upper).as_dvec3();
            }
            let mut missed = 0;
            for cell in 0..512u32 {
                let position = glam::UVec3::new(cell & 7, cell >> 3 & 7, cell >> 6);
                let region = RegionId::of_cell(position);
                let (lower, upper) = grid.cell_box(region);
                if bounds_miss_box(boxes, lower, upper) {
                    missed += 1;
                    prop_assert!(!grid.overlaps(region, corners), "{region:?}");
                }
            }
            prop_assert!(missed > 0);
        }
    }
}
