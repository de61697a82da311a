//! How often a closed surface winds around a point is the solid angle of all its faces, over that
//! of a sphere; whichever way the ray goes and however far the front is refined.

use crate::common::fronts::{Front, box_mesh};
use glam::DVec3;
use hrtc_core::contact::query::winding;
use hrtc_core::contact::tool::{ToolMesh, capsule_mesh};
use simulator::Random;
use spm_builder::{BuildOptions, NoProgress, SoupMesh, build_model};
use std::f64::consts::TAU;

/// Sum of the solid angles of all faces (Van Oosterom and Strackee 1983) over a sphere's.
fn brute_winding(front: &Front, point: DVec3) -> f64 {
    let half_angle = |corners: &[DVec3; 3]| {
        let [a, b, c] = corners.map(|corner| corner - point);
        let [x, y, z] = [a, b, c].map(DVec3::length);
        let down = x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y;
        a.dot(b.cross(c)).atan2(down)
    };
    let sum: f64 = front.faces.iter().map(|(_, t)| half_angle(t)).sum();
    sum / TAU
}

/// A box in a box, whose faces look outwards or inwards.
fn box_in_box(looks_outwards: bool) -> ToolMesh {
    let mut mesh = box_mesh(DVec3::ONE);
    let inner = box_mesh(DVec3::splat(0.6));
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(inner.positions);
    mesh.triangles.extend(inner.triangles.iter().map(|t| {
        let mut t = t.map(|v| v + first);
        if !looks_outwards {
            t.swap(1, 2);
        }
        t
    }));
    mesh
}

/// A capsule, each of whose splits is done or not.
fn refined_capsule(random: &mut Random) -> Front {
    let capsule = capsule_mesh(0.8, 2.4, 24, 20);
    let mesh = SoupMesh {
        positions: capsule.positions.iter().map(|p| p.to_array()).collect(),
        triangles: capsule.triangles,
    };
    let options = BuildOptions {
        base_faces: Some(32),
        regions: None,
    };
    let parts = build_model(mesh, &options, &NoProgress).expect("the model is built");
    Front::new(&parts, 50, random)
}

#[test]
fn winding_is_the_solid_angle() {
    let mut random = Random::new(3);
    let fronts = [
        Front::of_mesh(&box_in_box(true)),
        Front::of_mesh(&box_in_box(false)),
        refined_capsule(&mut random),
    ];
    let mut seen = [[0; 3]; 3];
    for (front, seen) in fronts.iter().zip(&mut seen) {
        for _ in 0..2000 {
            let from = 1.3 * random.vector();
            let to = from + 8.0 * random.vector().normalize();
            let sum = brute_winding(front, from);
            let (found, work) = winding(front.surface(), from, to, u32::MAX);
            // No ray of these meets an edge, and no point is on a face.
            let found = found.expect("the ray is clear of the edges");
            assert!(
                (sum - f64::from(found)).abs() < 0.01,
                "{from}: {sum}, {found}"
            );
            seen[found as usize] += 1;
            let (cut, _) = winding(front.surface(), from, to, work.nodes + work.faces - 1);
            assert_eq!(cut, None, "the work is limited");
        }
    }
    // Outside, within one, within both; the cavity counts as outside.
    assert!(seen[0].iter().all(|&n| n > 100), "{seen:?}");
    for [outside, once, twice] in &seen[1..] {
        assert!(*outside > 100 && *once > 100 && *twice == 0, "{seen:?}");
    }
}

#[test]
fn a_ray_through_a_corner_or_from_a_face_tells_nothing() {
    let front = Front::of_mesh(&box_mesh(DVec3::ONE));
    let ask = |from, to| winding(front.surface(), from, to, u32::MAX).0;
    assert_eq!(ask(DVec3::ZERO, DVec3::splat(3.0)), None);
    assert_eq!(ask(DVec3::X, DVec3::new(3.0, 0.3, 0.2)), None);
    assert_eq!(ask(DVec3::ZERO, DVec3::new(3.0, 0.3, 0.2)), Some(1));
}
