//! AB-tree order: the order in which the builder keeps the full mesh from here on, and the file
//! stores it.
//!
//! What is near in space is then near in memory too, whatever order the mesh file had:
//! simplification, error sampling and regions all walk over neighbours.

use crate::manifold::ManifoldMesh;
use crate::tuning::regions::FACES_A_BRANCH;
use geometry::Aabb;
use glam::{DVec3, Vec3};
use spm::NONE;

/// The same mesh with its faces in AB-tree order and its vertices in the order in which the faces
/// first use them.
#[must_use]
pub fn in_tree_order(mesh: ManifoldMesh) -> ManifoldMesh {
    let order = tree_order(&mesh);
    let mut number = vec![NONE; mesh.positions.len()];
    let mut positions = Vec::with_capacity(mesh.positions.len());
    let mut copies = Vec::with_capacity(mesh.positions.len());
    let mut locked = Vec::with_capacity(mesh.positions.len());
    let mut triangles = Vec::with_capacity(order.len());
    for face in order {
        triangles.push(mesh.triangles[face as usize].map(|vertex| {
            let number = &mut number[vertex as usize];
            if *number == NONE {
                *number = positions.len() as u32;
                positions.push(mesh.positions[vertex as usize]);
                copies.push(mesh.copies[vertex as usize]);
                locked.push(mesh.locked[vertex as usize]);
            }
            *number
        }));
    }
    ManifoldMesh {
        positions,
        triangles,
        copies,
        locked,
        summary: mesh.summary,
    }
}

/// A face while it is put in order.
#[derive(Clone, Copy)]
struct Placed {
    /// Three times the centroid: the same order, exactly rounded alike for all.
    centroid: DVec3,
    bounds: Aabb,
    face: u32,
}

/// Faces in AB-tree order (thesis 3.1.2.2): the set is split at the median along the longest axis
/// of its box, the first half rounded up; ties go by number, so that the order is unique.
fn tree_order(mesh: &ManifoldMesh) -> Vec<u32> {
    let mut faces: Vec<Placed> = mesh
        .triangles
        .iter()
        .zip(0u32..)
        .map(|(t, face)| {
            let corners = t.map(|v| Vec3::from_array(mesh.positions[v as usize]));
            Placed {
                centroid: corners[0].as_dvec3() + corners[1].as_dvec3() + corners[2].as_dvec3(),
                bounds: Aabb::of_triangle(corners),
                face,
            }
        })
        .collect();
    sort(&mut faces);
    faces.into_iter().map(|placed| placed.face).collect()
}

/// As deep as the tree: at most 30 levels.
fn sort(mut set: &mut [Placed]) {
    while set.len() > 1 {
        let bounds = set
            .iter()
            .fold(Aabb::EMPTY, |all, placed| all.union(placed.bounds));
        let sides = bounds.upper.as_dvec3() - bounds.lower.as_dvec3();
        let axis = if sides.x >= sides.y && sides.x >= sides.z {
            0
        } else if sides.y >= sides.z {
            1
        } else {
            2
        };
        let half = set.len().div_ceil(2);
        set.select_nth_unstable_by(half, |a, b| {
            let along = a.centroid[axis].total_cmp(&b.centroid[axis]);
            along.then(a.face.cmp(&b.face))
        });
        let (left, right) = set.split_at_mut(half);
        if left.len() < FACES_A_BRANCH {
            sort(left);
        } else {
            rayon::join(|| sort(left), || sort(&mut *right));
            return;
        }
        set = right;
    }
}
