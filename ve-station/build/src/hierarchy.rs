//! The vertex hierarchy and the tolerance levels, from finished records.
//!
//! One pass over the faces and one over the records, from the last to the first: children come
//! after their parents. Memory: 28 B a vertex (box, and the VSP that splits it) while it runs, 20 B
//! a VSP of result.

use geometry::Aabb;
use glam::Vec3;
use spm::{BoundsScale, ErrorScale, LEVELS, NONE, RegionGrid, SpmParts, VspNode, VspRecord};

/// Fills in `base_splits` and `hierarchy` of parts whose meshes and records are complete.
pub fn add_hierarchy(parts: &mut SpmParts) {
    let sizes = parts.header.sizes();
    let at = |parts: &SpmParts, vertex: u32| Vec3::from_array(parts.position(vertex));
    let vertices = sizes.vt(sizes.vsps) as usize;
    let mut boxes = vec![Aabb::EMPTY; vertices];
    for face in &parts.full_faces {
        let bounds = Aabb::of_triangle(face.corners.map(|v| at(parts, v)));
        for corner in face.corners {
            let of_corner = &mut boxes[corner as usize];
            *of_corner = of_corner.union(bounds);
        }
    }
    let scale = BoundsScale::new(parts.header.lower, parts.header.upper);
    let mut splits = vec![NONE; vertices];
    let mut nodes: Vec<VspNode> = Vec::with_capacity(parts.records.len());
    for record in parts.records.iter().rev() {
        let (vs, vt) = (record.vs as usize, sizes.vt(record.i) as usize);
        let own = at(parts, record.vs);
        let reach = boxes[vt].union(boxes[vt + 1]).union(Aabb {
            lower: own,
            upper: own,
        });
        boxes[vs] = reach;
        splits[vs] = record.i;
        nodes.push(VspNode {
            children: [splits[vt], splits[vt + 1]],
            bounds: scale.encode(&reach),
        });
    }
    nodes.reverse();
    splits.truncate(sizes.base_vertices as usize);
    parts.hierarchy = nodes;
    parts.base_splits = splits;
}

/// The tolerances of the levels (see [`spm::ModelHeader::level_tolerances`]): for every level of
/// the grid the smallest decoded code that at most n / 4^level VSPs exceed, rounded up to f32.
/// Infinite where more than that have the largest code, which is beyond any tolerance.
pub fn level_tolerances(
    records: &[VspRecord],
    scale: ErrorScale,
    grid: &RegionGrid,
) -> [f32; LEVELS] {
    let mut counts = vec![0u64; 1 << 16];
    for record in records {
        counts[usize::from(record.e)] += 1;
    }
    let mut tolerances = [f32::INFINITY; LEVELS];
    tolerances[0] = 0.0;
    // From the largest code down: what exceeds a code only grows.
    let (mut exceed, mut code) = (0u64, u16::MAX);
    for level in (1..LEVELS as u32).rev() {
        if grid.at_level(level).is_none() {
            continue;
        }
        let allowed = records.len() as u64 >> (2 * level);
        while code > 0 && exceed + counts[usize::from(code)] <= allowed {
            exceed += counts[usize::from(code)];
            code -= 1;
        }
        tolerances[level as usize] = rounded_up(scale.decode(code));
    }
    tolerances
}

fn rounded_up(exact: f64) -> f32 {
    let rounded = exact as f32;
    if f64::from(rounded) < exact {
        rounded.next_up()
    } else {
        rounded
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use spm::CertifiedCode;

    fn tolerances(codes: &[u16]) -> [f32; LEVELS] {
        let record = |&e: &u16| VspRecord {
            i: 0,
            vs: 0,
            fn_: [NONE; 4],
            leaf_l: 0,
            leaf_r: NONE,
            pos_t: [0.0; 3],
            pos_u: [0.0; 3],
            certified: [CertifiedCode::default(); 2],
            e,
        };
        let records: Vec<VspRecord> = codes.iter().map(record).collect();
        let grid = RegionGrid::new(DVec3::ZERO, DVec3::ONE, 8).unwrap();
        level_tolerances(&records, ErrorScale::for_diagonal(1.0), &grid)
    }

    /// A grid of eight cells a side has three levels above it.
    #[test]
    fn a_few_errors_beyond_the_scale_take_no_level_away() {
        const CODE: u16 = 50_000;
        let code = rounded_up(ErrorScale::for_diagonal(1.0).decode(CODE));
        let mut codes = [CODE; 1000];
        assert_eq!(
            tolerances(&codes)[..5],
            [0.0, code, code, code, f32::INFINITY]
        );
        codes[..10].fill(u16::MAX);
        assert_eq!(
            tolerances(&codes)[..5],
            [0.0, code, code, code, f32::INFINITY]
        );
        // More than a 64th, and less than a 16th, is beyond.
        codes[..40].fill(u16::MAX);
        let beyond = f32::INFINITY;
        assert_eq!(tolerances(&codes)[..5], [0.0, code, code, beyond, beyond]);
    }
}
