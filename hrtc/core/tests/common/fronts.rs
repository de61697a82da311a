//! Fronts and meshes for the tests of queries, each with all of its faces to look at.
#![allow(dead_code, reason = "every test file uses another part")]

use super::{model_or, real_model};
use ab_tree::{AbTree, leaf_key};
use geometry::{Pose, Similarity};
use glam::{DQuat, DVec3, Vec3};
use hrtc_core::contact::query::Surface;
use hrtc_core::contact::tool::ToolMesh;
use simulator::Random;
use spm::{ActiveMesh, Certified, ErrorScale, Handle, NONE, OperationFaces, SpmParts};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, SoupMesh, build_model, read_mesh};
use std::collections::BTreeMap;

/// A front with its tree, and its faces for the look at all.
pub struct Front {
    pub mesh: ActiveMesh,
    pub tree: AbTree,
    pub faces: Vec<(Handle, [DVec3; 3])>,
    pub lower: DVec3,
    pub upper: DVec3,
}

impl Front {
    /// Performs each legal split, ascending, with a chance in percent.
    pub fn new(parts: &SpmParts, chance: u64, random: &mut Random) -> Self {
        let header = &parts.header;
        let mut mesh = ActiveMesh::new(header.base_vertices, header.base_faces, header.vsps);
        let scale = ErrorScale::for_diagonal(header.diagonal);
        for (v, base) in (0u32..).zip(&parts.base_vertices) {
            mesh.set_base_vertex(v, base.position, scale.certified_of_base(base));
        }
        let mut tree = AbTree::new(header.base_faces + 2 * header.vsps);
        tree.preconstruct(header.faces);
        for (f, base) in (0u32..).zip(&parts.base_faces) {
            mesh.set_base_face(f, base.corners, base.neighbours)
                .expect("the builder's base mesh is good");
            assert!(tree.insert(f, base.leaf));
        }
        tree.refit(|f| mesh.face_box(f));
        for record in &parts.records {
            mesh.load(
                record.i,
                record,
                record.vs,
                record.fn_,
                scale.certified(record),
            );
        }
        let mut out = OperationFaces::new();
        for i in 0..header.vsps {
            if mesh.split_is_legal(i) && random.below(100) < chance {
                mesh.split(i, &mut out).expect("the builder's records fit");
                for (&face, leaf) in out.made_or_removed().iter().zip(out.leaves) {
                    assert!(tree.insert(face, leaf));
                }
                out.deformed().iter().for_each(|&f| tree.deform(f));
            }
        }
        Self::of(mesh, tree)
    }

    /// Undoes every fourth of the splits that may be undone when their turn comes, descending.
    pub fn undo_some(self, vsps: u32, random: &mut Random) -> Self {
        let (mut mesh, mut tree) = (self.mesh, self.tree);
        let mut out = OperationFaces::new();
        for i in (0..vsps).rev() {
            if mesh.collapse_is_legal(i) && random.below(4) == 0 {
                mesh.collapse(i, &mut out).expect("small fans");
                out.made_or_removed().iter().for_each(|&f| tree.remove(f));
                out.deformed().iter().for_each(|&f| tree.deform(f));
            }
        }
        Self::of(mesh, tree)
    }

    /// Any mesh as a front that has nothing to refine. Corners are rounded to f32.
    pub fn of_mesh(whole: &ToolMesh) -> Self {
        let count = whole.triangles.len() as u32;
        let mut mesh = ActiveMesh::new(whole.positions.len() as u32, count, 0);
        for (v, p) in (0u32..).zip(&whole.positions) {
            mesh.set_base_vertex(v, p.as_vec3().to_array(), Certified::EXACT);
        }
        let mut edges = BTreeMap::new();
        for (f, t) in (0u32..).zip(&whole.triangles) {
            for k in 0..3 {
                edges.insert((t[k], t[(k + 1) % 3]), f);
            }
        }
        for (f, t) in (0u32..).zip(&whole.triangles) {
            let across = |k: usize| edges.get(&(t[(k + 2) % 3], t[(k + 1) % 3]));
            let neighbours = [0, 1, 2].map(|k| across(k).copied().unwrap_or(NONE));
            mesh.set_base_face(f, *t, neighbours)
                .expect("the mesh of the test is good");
        }
        // Neighbours in the tree are neighbours in space.
        let centre = |f: &u32| -> DVec3 {
            let t = whole.triangles[*f as usize];
            t.iter().map(|&v| whole.positions[v as usize]).sum()
        };
        let mut order: Vec<u32> = (0..count).collect();
        median_order(&mut order, &centre);
        let mut tree = AbTree::new(count);
        tree.preconstruct(count);
        for (place, &f) in (0u32..).zip(&order) {
            assert!(tree.insert(f, leaf_key(place, count)));
        }
        Self::of(mesh, tree)
    }

    /// Any mesh and its tree.
    pub fn of(mesh: ActiveMesh, mut tree: AbTree) -> Self {
        tree.refit(|f| mesh.face_box(f));
        let mut faces = Vec::new();
        mesh.for_each_active_face(|f| faces.push((f, mesh.corners(f))));
        let (mut lower, mut upper) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for corner in faces.iter().flat_map(|(_, t)| t) {
            (lower, upper) = (lower.min(*corner), upper.max(*corner));
        }
        Self {
            mesh,
            tree,
            faces,
            lower,
            upper,
        }
    }

    pub fn surface(&self) -> Surface<'_> {
        Surface {
            mesh: &self.mesh,
            tree: &self.tree,
        }
    }

    pub fn diagonal(&self) -> f64 {
        self.lower.distance(self.upper)
    }

    pub fn any_face(&self, random: &mut Random) -> (Handle, [DVec3; 3]) {
        self.faces[random.below(self.faces.len() as u64) as usize]
    }

    /// Its faces as a mesh of a tool: face k of the tool is face k of `faces`.
    pub fn as_mesh(&self) -> ToolMesh {
        let mut mesh = ToolMesh::default();
        for (_, t) in &self.faces {
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(t);
            mesh.triangles.push([first, first + 1, first + 2]);
        }
        mesh
    }
}

fn median_order(set: &mut [u32], centre: &impl Fn(&u32) -> DVec3) {
    if set.len() < 2 {
        return;
    }
    let bounds = set.iter().map(centre);
    let low = bounds.clone().fold(DVec3::INFINITY, DVec3::min);
    let axis = (bounds.fold(DVec3::NEG_INFINITY, DVec3::max) - low).max_position();
    let half = set.len().div_ceil(2);
    set.select_nth_unstable_by(half, |a, b| {
        let along = centre(a)[axis].total_cmp(&centre(b)[axis]);
        along.then(a.cmp(b))
    });
    let (left, right) = set.split_at_mut(half);
    median_order(left, centre);
    median_order(right, centre);
}

/// A frame; the pose and scale must be good.
pub fn frame(position: DVec3, orientation: DQuat, metres_per_unit: f64) -> Similarity {
    let pose = Pose {
        position,
        orientation,
    };
    Similarity::new(pose, metres_per_unit).expect("a good frame")
}

/// A box of 12 faces.
pub fn box_mesh(half: DVec3) -> ToolMesh {
    let corner = |k: u32| {
        let side = |axis: u32| if k >> axis & 1 == 1 { 1.0 } else { -1.0 };
        half * DVec3::new(side(0), side(1), side(2))
    };
    let quads = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let cut = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    ToolMesh {
        positions: (0..8).map(corner).collect(),
        triangles: quads.into_iter().flat_map(cut).collect(),
    }
}

/// An open plate in the plane z = 0, `pieces` x `pieces` squares of two faces, normals up.
pub fn plate_mesh(half: f64, pieces: u32) -> ToolMesh {
    let place = |k: u32| half * (2.0 * f64::from(k) / f64::from(pieces) - 1.0);
    let mut mesh = ToolMesh::default();
    for y in 0..=pieces {
        for x in 0..=pieces {
            mesh.positions.push(DVec3::new(place(x), place(y), 0.0));
        }
    }
    let row = pieces + 1;
    for y in 0..pieces {
        for x in 0..pieces {
            let v = y * row + x;
            mesh.triangles.push([v, v + 1, v + row + 1]);
            mesh.triangles.push([v, v + row + 1, v + row]);
        }
    }
    mesh
}

/// Scales a mesh.
pub fn scaled(mesh: &ToolMesh, scale: f64) -> ToolMesh {
    ToolMesh {
        positions: mesh.positions.iter().map(|&p| p * scale).collect(),
        triangles: mesh.triangles.clone(),
    }
}

/// Made models, and real ones that are there, of about `faces` faces.
pub fn models(faces: u32) -> Vec<(String, SpmParts)> {
    let mut meshes: Vec<(String, SoupMesh)> = Vec::new();
    for shape in [Shape::Relief, Shape::Wedge, Shape::Torus] {
        meshes.push((format!("{shape:?}"), generate(shape, faces, 3)));
    }
    if let Some(path) = real_model("cow.obj") {
        let mesh = read_mesh(&path).expect("the model is read");
        meshes.push(("cow.obj".to_string(), mesh));
    }
    let options = BuildOptions {
        base_faces: Some(100),
        regions: None,
    };
    meshes
        .into_iter()
        .map(|(name, mesh)| {
            let parts = build_model(mesh, &options, &NoProgress).expect("the model is built");
            (name, parts)
        })
        .collect()
}

/// The full mesh of a real model, corners rounded to f32. Where its file is not there, which a
/// line then says, a generated relief of about `faces` faces stands in.
pub fn full_mesh(name: &str, faces: u32) -> ToolMesh {
    let soup = match model_or(name, "on a relief instead") {
        Some(path) => read_mesh(&path).expect("the model is read"),
        None => generate(Shape::Relief, faces, 3),
    };
    let rounded = |p: &[f64; 3]| Vec3::from_array(p.map(|x| x as f32)).as_dvec3();
    ToolMesh {
        positions: soup.positions.iter().map(rounded).collect(),
        triangles: soup.triangles.clone(),
    }
}
