//! Which VSPs a region needs, so that inside its cell the refined surface is the full mesh's.
//!
//! A region starts from the VSPs that made the faces it owns and their corners (thesis 5.3.1.1). Their
//! closure makes every owned face, but others may still be coarse there, and on about one region in a
//! hundred of a real scan such a face pokes into the cell. So the seeds are extended until none can:
//!
//! - The *hull* of a vertex is the box of its position and those of all its descendants, the hull of a face
//!   the convex hull of its corners' hulls.
//! - While the closure leaves a face with a corner to split whose hull overlaps the cell, the VSP that splits
//!   its corner with the largest hull becomes a seed.
//!
//! That is enough for *every* front that holds the closure, unions with closures of other regions and
//! half-refined fronts among them. The corners of a face of such a front descend from the corners of one face of
//! the closure's own front (from all three, from the two ends of an edge, or from one): so it lies in that
//! face's hull. If the hull misses the cell, so does the face; if not, nothing is left to split there, and
//! the face is one of the full mesh. Hence the faces that overlap a loaded cell are exactly those of the full
//! mesh that do. (Splitting until no *face* of the closure's own front overlaps the cell costs less, up to 0.1 %
//! more VSPs instead of 1 to 5 %, but left two of 66 blocks of 3 x 3 x 3 regions of the dragon with a
//! coarse face in a loaded cell.)
//!
//! Cells without a face of the full mesh that a face of the base mesh overlaps become regions too, the
//! *cleared* ones: once loaded they are as empty as they look. A cell that only faces between the base and the
//! full mesh ever enter has no region, and of it nothing is promised. (None of 3600 such cells beside loaded
//! ones held a face: `loaded_cells_are_the_full_mesh.rs`.)
//!
//! Memory: 28 B a vertex (hull, and the VSP that splits it), 12 B a face (corners), 8 B a VSP; the search
//! itself keeps no more than one closure.

use super::Progress;
use super::spm::Ids;
use glam::{DVec3, Vec3};
use shared::geometry::Aabb;
use shared::protocol::{BaseFace, BaseVertex};
use shared::spm::{NONE, RegionGrid, RegionId, Sizes, VspRecord};

/// The most faces that an occupied region should own at median: about 128. Halving the cells divides it by three
/// to four, so 40 to 140 come out; larger regions refine what the probe never touches (the dragon with 156
/// took twice the splits a tick that it takes with 42).
const FACES_A_REGION: f64 = 140.0;

/// The coarsest grid whose occupied regions own no more than that at median, or the finest there is.
pub fn default_grid(lower: DVec3, upper: DVec3, corners: &[[Vec3; 3]]) -> Option<RegionGrid> {
    let mut divisions = 1;
    loop {
        let grid = RegionGrid::new(lower, upper, divisions)?;
        let finest = divisions == RegionGrid::MOST_DIVISIONS;
        if finest || median_faces(&grid, corners) <= FACES_A_REGION {
            return Some(grid);
        }
        divisions *= 2;
    }
}

fn median_faces(grid: &RegionGrid, corners: &[[Vec3; 3]]) -> f64 {
    let mut owners: Vec<u32> = Vec::with_capacity(corners.len() * 2);
    for t in corners {
        grid.for_each_owner(t.map(|p| p.as_dvec3()), |region| owners.push(region.0));
    }
    owners.sort_unstable();
    let mut counts: Vec<usize> = owners.chunk_by(|a, b| a == b).map(<[u32]>::len).collect();
    let middle = counts.len() / 2;
    counts.select_nth_unstable(middle);
    counts[middle] as f64
}

/// The region index and what is counted of it.
#[derive(Debug, Default)]
pub struct Regions {
    /// All regions, ascending.
    pub regions: Vec<RegionId>,
    /// Start of each region's seeds, and the end of the last one's.
    pub seed_offsets: Vec<u32>,
    /// Seeds, ascending in each region.
    pub seeds: Vec<u32>,
    /// Regions that own no face and are only cleared.
    pub cleared: u64,
    /// Mean closure of a region that owns faces, VSPs.
    pub closure_mean: f64,
    /// Largest closure of a region, VSPs.
    pub closure_max: u32,
}

/// The model as far as regions need it.
pub struct Model<'a> {
    /// The grid.
    pub grid: &'a RegionGrid,
    /// Sizes.
    pub sizes: Sizes,
    /// Vertices of the base mesh.
    pub base_vertices: &'a [BaseVertex],
    /// Faces of the base mesh.
    pub base_faces: &'a [BaseFace],
    /// Records, ascending.
    pub records: &'a [VspRecord],
    /// Corners of each face of the full mesh, vertex ids, by face id; [`NONE`] where an id has no face.
    pub corners: Vec<[u32; 3]>,
}

impl Model<'_> {
    fn position(&self, vertex: u32) -> Vec3 {
        Vec3::from_array(match self.sizes.maker_of_vertex(vertex) {
            None => self.base_vertices[vertex as usize].position,
            Some(i) if vertex == self.sizes.vt(i) => self.records[i as usize].pos_t,
            Some(i) => self.records[i as usize].pos_u,
        })
    }

    fn positions(&self, corners: [u32; 3]) -> [DVec3; 3] {
        corners.map(|v| self.position(v).as_dvec3())
    }
}

/// Corners of each face of the full mesh by face id.
pub fn corners_by_id(triangles: &[[u32; 3]], ids: &Ids) -> Vec<[u32; 3]> {
    let mut corners = vec![[NONE; 3]; ids.sizes.fl(ids.sizes.vsps) as usize];
    for (face, t) in (0u32..).zip(triangles) {
        corners[ids.face(face) as usize] = t.map(|v| ids.vertex[v as usize]);
    }
    corners
}

/// Key of a region that owns faces, above those of its seeds.
const OWNS: u32 = NONE;
/// Key of a region that a face of the base mesh overlaps.
const TO_CLEAR: u32 = NONE - 1;

/// Finds all regions, their seeds and the sizes of their closures.
pub fn regions_of(model: &Model<'_>, progress: &dyn Progress) -> Regions {
    let keys = keys(model);
    let mut search = Search::new(model);
    let mut found = Regions {
        seed_offsets: vec![0],
        seeds: Vec::with_capacity(keys.len()),
        ..Regions::default()
    };
    progress.phase("clearing cells", keys.len() as u64);
    let (mut owning, mut sum, mut done) = (0u64, 0u64, 0);
    let mut seeds: Vec<u32> = Vec::new();
    for of_region in keys.chunk_by(|a, b| a >> 32 == b >> 32) {
        let region = RegionId((of_region[0] >> 32) as u32);
        let low = of_region.iter().map(|&key| key as u32);
        seeds.extend(low.filter(|&vsp| vsp < TO_CLEAR));
        let closure = search.extend(region, &mut seeds);
        if of_region.last().is_some_and(|&key| key as u32 == OWNS) {
            owning += 1;
            sum += u64::from(closure);
        } else {
            found.cleared += 1;
        }
        found.closure_max = found.closure_max.max(closure);
        found.seeds.append(&mut seeds);
        found.seed_offsets.push(found.seeds.len() as u32);
        found.regions.push(region);
        done += of_region.len() as u64;
        progress.done(done);
    }
    found.closure_mean = sum as f64 / owning.max(1) as f64;
    found
}

/// For every region the VSPs that made the faces which it owns, and the corners of these, then what it is
/// there for; ascending.
fn keys(model: &Model<'_>) -> Vec<u64> {
    let key = |region: RegionId, vsp: u32| u64::from(region.0) << 32 | u64::from(vsp);
    let sizes = model.sizes;
    let mut keys: Vec<u64> = Vec::new();
    for (face, &corners) in (0u32..).zip(&model.corners) {
        if corners[0] == NONE {
            continue;
        }
        let [a, b, c] = corners.map(|v| sizes.maker_of_vertex(v));
        let makers = [sizes.maker_of_face(face), a, b, c];
        let owners = model.positions(corners);
        model.grid.for_each_owner(owners, |region| {
            keys.push(key(region, OWNS));
            keys.extend(makers.iter().flatten().map(|&vsp| key(region, vsp)));
        });
    }
    for base in model.base_faces {
        let owners = model.positions(base.corners);
        let mut to_clear = |region| keys.push(key(region, TO_CLEAR));
        model.grid.for_each_owner(owners, &mut to_clear);
    }
    keys.sort_unstable();
    keys.dedup();
    keys
}

#[derive(Clone, Copy)]
struct Step {
    stamp: u32,
    vs: u32,
}

/// Searches closures and the faces that they leave coarse.
struct Search<'a> {
    model: &'a Model<'a>,
    /// The VSP that splits each vertex, [`NONE`] for a vertex of the full mesh.
    split_of: Vec<u32>,
    /// Box of each vertex and its descendants.
    hulls: Vec<Aabb>,
    /// Box of the hull of each face of the base mesh that is not of the full mesh, and its id.
    base: Vec<(Aabb, u32)>,
    /// Of each VSP: the region, counted from 1, whose closure last took it in, and the vertex that it
    /// splits. (Side by side: the way up from a vertex is most of the work, and records are far apart.)
    steps: Vec<Step>,
    stamp: u32,
    /// The closure; also the queue of its search.
    closure: Vec<u32>,
    /// Faces that may still be coarse inside the cell.
    suspects: Vec<u32>,
}

impl<'a> Search<'a> {
    fn new(model: &'a Model<'a>) -> Self {
        let sizes = model.sizes;
        let vertices = sizes.vt(sizes.vsps);
        let mut split_of = vec![NONE; vertices as usize];
        let mut hulls: Vec<Aabb> = (0..vertices)
            .map(|v| Aabb::of_points([model.position(v)]))
            .collect();
        // Children have larger ids than their parents.
        for record in model.records.iter().rev() {
            split_of[record.vs as usize] = record.i;
            let vt = sizes.vt(record.i) as usize;
            let children = hulls[vt].union(hulls[vt + 1]);
            let hull = &mut hulls[record.vs as usize];
            *hull = hull.union(children);
        }
        let mut search = Self {
            model,
            split_of,
            hulls,
            base: Vec::new(),
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
        };
        search.base = (0u32..)
            .zip(model.base_faces)
            .filter(|(face, base)| base.corners != model.corners[*face as usize])
            .map(|(face, base)| {
                let [a, b, c] = search.hulls_of(base.corners);
                (a.union(b).union(c), face)
            })
            .collect();
        search
    }

    fn hulls_of(&self, corners: [u32; 3]) -> [Aabb; 3] {
        corners.map(|v| self.hulls[v as usize])
    }

    /// Adds to the seeds of a region what keeps its cell clear; they end ascending. Returns the size of the
    /// closure.
    fn extend(&mut self, region: RegionId, seeds: &mut Vec<u32>) -> u32 {
        let (lower, upper) = self.model.grid.cell_box(region);
        self.stamp += 1;
        self.closure.clear();
        let near = self
            .base
            .iter()
            .filter(|(hull, _)| overlap(hull, lower, upper));
        self.suspects.extend(near.map(|&(_, face)| face));
        let mut suspects = std::mem::take(&mut self.suspects);
        let (mut seeded, mut searched) = (0, 0);
        loop {
            for &seed in &seeds[seeded..] {
                self.visit(seed);
            }
            seeded = seeds.len();
            while let Some(&i) = self.closure.get(searched) {
                searched += 1;
                let fl = self.model.sizes.fl(i);
                suspects.extend([fl, fl + 1]);
                for dependency in self.model.records[i as usize].dependencies(self.model.sizes) {
                    self.visit(dependency);
                }
            }
            // The hull of a face only shrinks by splits, so who is acquitted stays so.
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
        self.closure.len() as u32
    }

    /// The split that a face needs so that neither it nor what comes of it is coarse in the box; `None`
    /// when it needs none.
    fn split_against(&self, face: u32, lower: DVec3, upper: DVec3) -> Option<u32> {
        let full = self.model.corners[face as usize];
        if full[0] == NONE {
            return None;
        }
        let corners = full.map(|v| self.active_ancestor(v));
        if corners == full || hulls_miss_box(self.hulls_of(corners), lower, upper) {
            return None;
        }
        corners
            .into_iter()
            .filter(|&v| self.split_of[v as usize] != NONE)
            .max_by(|&a, &b| {
                let size = |v: u32| self.hulls[v as usize].diagonal();
                size(a).total_cmp(&size(b))
            })
            .map(|v| self.split_of[v as usize])
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
        while let Some(i) = self.model.sizes.maker_of_vertex(vertex) {
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
fn overlap(hull: &Aabb, lower: DVec3, upper: DVec3) -> bool {
    hull.lower.as_dvec3().cmple(upper).all() && hull.upper.as_dvec3().cmpge(lower).all()
}

/// Whether the convex hull of three boxes surely misses a box: separating axes of the box and of the
/// triangle of the three centres, the half sides of the three taken off.
///
/// Not all axes of the hull, so it may say no where a gap is; and wherever it says yes the gap is wider than
/// what [`RegionGrid::overlaps`] takes for rounding.
fn hulls_miss_box(hulls: [Aabb; 3], lower: DVec3, upper: DVec3) -> bool {
    let [a, b, c] = hulls;
    if !overlap(&a.union(b).union(c), lower, upper) {
        return true;
    }
    let (middle, half) = ((lower + upper) * 0.5, (upper - lower) * 0.5);
    let centres = hulls.map(|h| (h.lower.as_dvec3() + h.upper.as_dvec3()) * 0.5 - middle);
    let halves = hulls.map(|h| (h.upper.as_dvec3() - h.lower.as_dvec3()) * 0.5);
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
        fn what_lies_in_a_hull_that_misses_a_cell_misses_it(
            boxes in prop::array::uniform3((vector(), vector(), 0.0..0.5f64)),
            weights in prop::array::uniform3(prop::array::uniform3(0.0..=1.0f32)),
            exponent in -6..6i32,
        ) {
            let scale = 10f64.powi(exponent);
            let hulls = boxes.map(|(a, b, size)| {
                Aabb::of_points([(a * scale).as_vec3(), (a + b * size).as_vec3() * scale as f32])
            });
            let grid = RegionGrid::new(DVec3::splat(-scale), DVec3::splat(scale), 8).unwrap();
            let mut corners = [DVec3::ZERO; 3];
            for k in 0..3 {
                let inside = hulls[k].lower
                    + (hulls[k].upper - hulls[k].lower) * Vec3::from_array(weights[k]);
                corners[k] = inside.clamp(hulls[k].lower, hulls[k].upper).as_dvec3();
            }
            let mut missed = 0;
            for cell in 0..512u32 {
                let region = RegionId::of_cell(glam::UVec3::new(cell & 7, cell >> 3 & 7, cell >> 6));
                let (lower, upper) = grid.cell_box(region);
                if hulls_miss_box(hulls, lower, upper) {
                    missed += 1;
                    prop_assert!(!grid.overlaps(region, corners), "{region:?}");
                }
            }
            prop_assert!(missed > 0);
        }
    }
}
