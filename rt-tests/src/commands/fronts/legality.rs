//! Random walks over fronts: legality by counters beside the adjacency test, and every invariant on
//! the way.

use crate::models::Model;
use crate::models::front_walk::WalkWithTree;
use rand::Rng;
use serde::Serialize;
use spm::ActiveMesh;
use std::collections::BTreeMap;

/// Splits and collapses of a walk.
pub const OPERATIONS: u32 = 100_000;
/// How often all invariants of mesh and tree are checked, and the legality of every VSP.
const CHECKS: u32 = 20;
/// VSPs whose legality is asked after every operation.
const ASKED: u32 = 8;

/// What a walk found.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Legality {
    /// Splits performed.
    pub splits: u32,
    /// Splits undone.
    pub collapses: u32,
    /// How often the two tests were compared.
    pub comparisons: u64,
    /// How often they differed.
    pub mismatches: u64,
    /// Splits that were not legal after their missing dependencies were performed by splits alone
    /// (thesis Figure 5.7 B would need a collapse there).
    pub needed_a_collapse: u32,
    /// Fronts whose faces are not the image of the full mesh under active ancestors.
    pub wrong_images: u32,
}

/// Walks up and down between base mesh and full mesh.
///
/// # Panics
/// When an invariant of mesh or tree does not hold.
pub fn walk(model: &Model, random: &mut impl Rng) -> Legality {
    let mut found = Legality::default();
    if model.file.model_header().vsps == 0 {
        return found;
    }
    let mut walked = WalkWithTree::new(model);
    let mut draw = || random.next_u32();
    for step in 0..OPERATIONS {
        // Up, to and fro near the top, down, to and fro, and up again.
        let splits_of_ten = [10, 9, 6, 5, 1, 5, 9, 5][(step * 8 / OPERATIONS) as usize];
        let up = draw() % 10 < splits_of_ten;
        match walked.step(up, &mut draw) {
            Some(true) => found.splits += 1,
            Some(false) => found.collapses += 1,
            None => break,
        }
        let WalkWithTree { walk, .. } = &walked;
        for _ in 0..ASKED {
            compare(&walk.mesh, draw() % walk.vsps(), &mut found);
        }
        if step % (OPERATIONS / CHECKS) == 0 || step + 1 == OPERATIONS {
            walked.refit();
            let WalkWithTree { walk, tree } = &walked;
            tree.check(|face| walk.mesh.face_box(face));
            walk.mesh.check();
            for i in 0..walk.vsps() {
                compare(&walk.mesh, i, &mut found);
            }
            found.wrong_images += u32::from(!is_image(model, &walk.mesh));
            // On a copy: the walk goes on from where it is.
            let mut copy = walk.clone();
            for _ in 0..20 {
                let i = draw() % copy.vsps();
                let waits = !copy.mesh.is_performed(i);
                found.needed_a_collapse += u32::from(waits && !copy.force(i).0);
            }
        }
    }
    found
}

fn compare(mesh: &ActiveMesh, i: u32, found: &mut Legality) {
    let split = (mesh.split_is_legal(i), mesh.split_is_legal_by_adjacency(i));
    let collapse = (
        mesh.collapse_is_legal(i),
        mesh.collapse_is_legal_by_adjacency(i),
    );
    for (by_counters, by_adjacency) in [split, collapse] {
        found.comparisons += 1;
        found.mismatches += u64::from(by_counters != by_adjacency);
    }
}

/// For every vertex of the full mesh its active ancestor.
#[must_use]
pub fn ancestors(model: &Model, mesh: &ActiveMesh) -> Vec<u32> {
    let sizes = model.file.model_header().sizes();
    let mut ancestor: Vec<u32> = (0..model.positions.len() as u32).collect();
    // Makers come before what they make: one pass.
    for record in &model.records {
        if !mesh.is_performed(record.i) {
            let vt = sizes.vt(record.i) as usize;
            let above = ancestor[record.vs as usize];
            ancestor[vt] = above;
            ancestor[vt + 1] = above;
        }
    }
    ancestor
}

/// Whether the active faces are the full mesh's with each corner replaced by its active ancestor,
/// without those that have become an edge or a point: what any front must be, whatever led to it
/// (Theorem 4).
#[must_use]
pub fn is_image(model: &Model, mesh: &ActiveMesh) -> bool {
    let ancestor = ancestors(model, mesh);
    let turned = |mut corners: [u32; 3]| {
        let least = (0..3).min_by_key(|&k| corners[k]).unwrap_or(0);
        corners.rotate_left(least);
        corners
    };
    let mut image: BTreeMap<u32, [u32; 3]> = BTreeMap::new();
    for place in 0..model.full_faces.len() as u32 {
        let Ok(face) = model.file.full_face(place) else {
            return false;
        };
        let corners = face.corners.map(|v| ancestor[v as usize]);
        let [a, b, c] = corners;
        if a != b && b != c && c != a {
            image.insert(face.face, turned(corners));
        }
    }
    let mut same = true;
    let mut count = 0;
    mesh.for_each_active_face(|face| {
        count += 1;
        same &= image.get(&face) == Some(&turned(mesh.face(face).corners));
    });
    same && count == image.len()
}

/// The longest chain of dependencies.
#[must_use]
pub fn chain(model: &Model) -> u32 {
    let sizes = model.file.model_header().sizes();
    let mut level = vec![0u32; model.records.len()];
    for record in &model.records {
        let below = record.dependencies(sizes).map(|d| level[d as usize]).max();
        level[record.i as usize] = 1 + below.unwrap_or(0);
    }
    level.into_iter().max().unwrap_or(0)
}
