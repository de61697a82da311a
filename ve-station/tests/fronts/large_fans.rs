//! Vertices with hundreds and thousands of faces: caps of cylinders, tips of cones.

use crate::common::{active_faces, build, load, refine};
use spm::{ActiveMesh, Handle, OperationError, OperationFaces, Slot, SpmParts};
use spm_builder::SoupMesh;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Sizes of fans on both sides of what one operation may change, and far beyond it.
const RINGS: [u32; 4] = [500, 600, 1200, 4000];

/// A closed cylinder with a fan of so many faces on each cap.
fn cylinder(ring: u32) -> SoupMesh {
    let mut mesh = SoupMesh {
        positions: vec![[0.0, 0.0, -0.5], [0.0, 0.0, 0.5]],
        triangles: Vec::new(),
    };
    for k in 0..ring {
        let angle = TAU * f64::from(k) / f64::from(ring);
        for height in [-0.5, 0.5] {
            mesh.positions.push([angle.cos(), angle.sin(), height]);
        }
        let (a, b) = (2 + 2 * k, 2 + 2 * ((k + 1) % ring));
        mesh.triangles.extend([
            [0, b, a],
            [1, a + 1, b + 1],
            [a, b, a + 1],
            [b, b + 1, a + 1],
        ]);
    }
    mesh
}

/// The mesh of the parts with everything performed.
fn full(parts: &SpmParts) -> ActiveMesh {
    let mut mesh = load(parts);
    refine(&mut mesh, parts);
    mesh
}

/// Undoes whatever is performed from a VSP on.
fn undo_from(vsp: Slot, mesh: &mut ActiveMesh, vsps: u32) {
    let mut out = OperationFaces::new();
    for i in (vsp..vsps).rev() {
        if mesh.is_performed(i) {
            mesh.collapse(i, &mut out).unwrap();
        }
    }
}

/// What depends on a VSP, directly or not, ascending.
fn dependents(mesh: &ActiveMesh, vsp: Slot, vsps: u32) -> Vec<Slot> {
    let mut above = vec![vsp];
    for i in vsp + 1..vsps {
        if mesh
            .dependencies(i)
            .any(|d| above.binary_search(&d).is_ok())
        {
            above.push(i);
        }
    }
    above.split_off(1)
}

/// The faces around each vertex of the front.
fn fans(mesh: &ActiveMesh) -> BTreeMap<Handle, u32> {
    let mut count = BTreeMap::new();
    mesh.for_each_active_face(|face| {
        for corner in mesh.face(face).corners {
            *count.entry(corner).or_insert(0) += 1;
        }
    });
    count
}

/// The VSPs that make the middles of the caps, of a mesh with everything performed.
fn creators_of_tips(full: &ActiveMesh, ring: u32) -> Vec<Slot> {
    let large = fans(full).into_iter().filter(|&(_, faces)| faces >= ring);
    let tips: Vec<Handle> = large.map(|(vertex, _)| vertex).collect();
    assert_eq!(tips.len(), 2, "the middles of the caps keep their fans");
    let creator = |&tip: &Handle| full.creator_of_vertex(tip);
    tips.iter().filter_map(creator).collect()
}

#[test]
fn a_collapse_of_too_large_a_fan_waits_and_the_front_stays_legal() {
    let mut postponed = 0;
    for ring in RINGS {
        let parts = build(&cylinder(ring), Some(50));
        let vsps = parts.header.vsps;
        let mut out = OperationFaces::new();
        let fresh = full(&parts);
        for vsp in creators_of_tips(&fresh, ring) {
            let mut mesh = fresh.clone();
            let above = dependents(&mesh, vsp, vsps);
            for &i in above.iter().rev() {
                mesh.collapse(i, &mut out).unwrap();
            }
            let before = active_faces(&mesh);
            match mesh.collapse(vsp, &mut out) {
                Ok(()) => mesh.split(vsp, &mut out).unwrap(),
                Err(error) => {
                    assert_eq!(error, OperationError::TooManyFaces(vsp), "ring {ring}");
                    postponed += 1;
                }
            }
            mesh.check();
            assert_eq!(active_faces(&mesh), before, "ring {ring}");
            // It only waits: once everything finer is gone it is performed.
            undo_from(vsp, &mut mesh, vsps);
            mesh.check();
            assert!(!mesh.is_performed(vsp));
        }
    }
    assert!(
        postponed > 0,
        "no fan was too large: the test tests nothing"
    );
}

#[test]
fn a_split_of_too_large_a_fan_waits_and_is_no_damage() {
    let mut postponed = 0;
    for ring in RINGS {
        let parts = build(&cylinder(ring), Some(50));
        let vsps = parts.header.vsps;
        let mut out = OperationFaces::new();
        let fresh = full(&parts);
        for vsp in creators_of_tips(&fresh, ring) {
            let mut mesh = load(&parts);
            let above = dependents(&mesh, vsp, vsps);
            let others = (0..vsps).filter(|i| *i != vsp && above.binary_search(i).is_err());
            for i in others {
                mesh.split(i, &mut out).unwrap();
            }
            assert!(mesh.split_is_legal(vsp));
            if let Err(error) = mesh.split(vsp, &mut out) {
                assert_eq!(error, OperationError::TooManyFaces(vsp), "ring {ring}");
                postponed += 1;
                mesh.check();
                // It only waits: once the ring is coarse again it is performed, then the rest.
                undo_from(vsp, &mut mesh, vsps);
                mesh.split(vsp, &mut out).unwrap();
            }
            for i in 0..vsps {
                if !mesh.is_performed(i) {
                    mesh.split(i, &mut out).unwrap();
                }
            }
            mesh.check();
            assert_eq!(active_faces(&mesh), active_faces(&fresh), "ring {ring}");
        }
    }
    assert!(
        postponed > 0,
        "no fan was too large: the test tests nothing"
    );
}
