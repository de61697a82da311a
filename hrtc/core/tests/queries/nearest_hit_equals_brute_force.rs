//! Queries through the AB-tree find what a look at every active face finds, on random fronts of
//! made and real models at several scales; at full resolution, what parry's own tree finds.

use crate::common::fronts::Front;
use crate::common::real_model;
use geometry::closest_point_on_triangle;
use glam::{DVec3, Vec3};
use hrtc_core::contact::query::{closest_point, closest_point_within, faces_within, swept_sphere};
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;
use simulator::Random;
use spm::{Handle, SpmParts};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, SoupMesh, build_model, read_mesh};

/// A random front, some of whose splits were undone again.
fn some_front(parts: &SpmParts, chance: u64, random: &mut Random) -> Front {
    let front = Front::new(parts, chance, random);
    if chance < 100 {
        front.undo_some(parts.header.vsps, random)
    } else {
        front
    }
}

/// A point near a random face, in the box, outside it, or far away.
fn some_point(front: &Front, random: &mut Random) -> DVec3 {
    let (lower, upper) = (front.lower, front.upper);
    let size = front.diagonal();
    let spread = random.vector();
    match random.below(8) {
        0 => lower.lerp(upper, 0.5) + spread * size,
        1 => lower.lerp(upper, 0.5) + spread * size * 1000.0,
        2 | 3 => (lower + upper) * 0.5 + spread * (upper - lower) * 0.5,
        4 => front.any_face(random).1[0],
        _ => {
            let [a, b, c] = front.any_face(random).1;
            (a + b + c) / 3.0 + spread * size * 0.01
        }
    }
}

/// Made models at three scales, and real ones.
fn models() -> Vec<(String, SpmParts)> {
    let mut meshes: Vec<(String, SoupMesh)> = Vec::new();
    for shape in [Shape::Relief, Shape::Terrain, Shape::Wedge, Shape::Torus] {
        for scale in [1e-4, 1.0, 1e4] {
            let mut mesh = generate(shape, 2000, 3);
            for p in &mut mesh.positions {
                *p = p.map(|x| x * scale);
            }
            meshes.push((format!("{shape:?} times {scale}"), mesh));
        }
    }
    for name in ["cow.obj", "fandisk.obj", "rocker-arm.obj", "bunny20k.obj"] {
        if let Some(path) = real_model(name) {
            let mesh = read_mesh(&path).expect("the model is read");
            meshes.push((name.to_string(), mesh));
        }
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

/// Calls `check` with fronts from coarse to full.
fn for_each_front(
    seed: u64,
    chances: &[u64],
    mut check: impl FnMut(&str, &Front, &SpmParts, &mut Random),
) {
    println!("seed {seed}");
    let mut random = Random::new(seed);
    for (name, parts) in models() {
        for &chance in chances {
            let front = some_front(&parts, chance, &mut random);
            check(&name, &front, &parts, &mut random);
        }
    }
}

#[test]
fn the_closest_point_is_that_of_all_faces_with_and_without_a_hint() {
    for_each_front(21, &[0, 60, 97, 100], |name, front, _, random| {
        for _ in 0..60 {
            let point = some_point(front, random);
            let least = front
                .faces
                .iter()
                .map(|&(_, t)| closest_point_on_triangle(t, point).distance_squared)
                .fold(f64::INFINITY, f64::min);
            let near = closest_point(front.surface(), point, None).0;
            let hint = near.map(|n| n.face);
            for hint in [None, hint, Some(front.any_face(random).0)] {
                let nearest = closest_point(front.surface(), point, hint)
                    .0
                    .expect("the front has faces");
                // The box of a face may round to a little nearer or farther than the face.
                let found = nearest.closest.distance_squared;
                let rounding = 1e-14 * point.distance_squared(front.lower);
                assert!((found - least).abs() <= rounding, "{name}: {found} {least}");
                let own = closest_point_on_triangle(front.mesh.corners(nearest.face), point);
                assert_eq!(own, nearest.closest, "{name}");
                assert!(front.mesh.is_active(nearest.face), "{name}");
            }
        }
    });
}

#[test]
fn a_search_that_is_cut_says_so_and_gives_what_it_has_seen_the_hint_at_least() {
    for_each_front(25, &[0, 60, 100], |name, front, _, random| {
        for _ in 0..20 {
            let point = some_point(front, random);
            let hint = front.any_face(random).0;
            let (whole, cost) = closest_point(front.surface(), point, Some(hint));
            let at_hint = closest_point_on_triangle(front.mesh.corners(hint), point);
            let cost = cost.nodes + cost.faces;
            for most in 0..=cost + 1 {
                let (nearest, work, is_complete) =
                    closest_point_within(front.surface(), point, Some(hint), most);
                let found = nearest.expect("the hint is tested always");
                assert!(work.nodes + work.faces <= most.max(1), "{name}");
                assert!(found.closest.distance_squared <= at_hint.distance_squared);
                assert!(is_complete || most <= cost, "{name}: {most} of {cost}");
                assert!(!is_complete || (most >= cost && nearest == whole), "{name}");
            }
        }
    });
}

#[test]
fn faces_within_a_distance_are_those_of_all_faces() {
    for_each_front(22, &[0, 60, 97, 100], |name, front, _, random| {
        for k in 0..40 {
            let point = some_point(front, random);
            let distance = front.diagonal() * [0.01, 0.05, 0.3, 2.0][k % 4] * random.unit();
            let mut expected: Vec<Handle> = front
                .faces
                .iter()
                .filter(|&&(_, t)| {
                    closest_point_on_triangle(t, point).distance_squared <= distance * distance
                })
                .map(|&(face, _)| face)
                .collect();
            let mut found = Vec::new();
            faces_within(front.surface(), point, distance, |face, closest| {
                let own = closest_point_on_triangle(front.mesh.corners(face), point);
                assert_eq!(own, closest, "{name}");
                found.push(face);
                distance
            });
            found.sort_unstable();
            expected.sort_unstable();
            assert_eq!(found, expected, "{name}");
        }
    });
}

/// First fraction of the motion at which the sphere touches the face while it approaches, by
/// sections: the distance is convex along the motion, so there is one approach.
fn first_contact(t: [DVec3; 3], start: DVec3, motion: DVec3, radius: f64) -> Option<f64> {
    let gap = |s: f64| {
        closest_point_on_triangle(t, start + motion * s)
            .distance_squared
            .sqrt()
            - radius
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..90 {
        let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if gap(a) <= gap(b) { high = b } else { low = a }
    }
    if gap(0.0) <= 0.0 {
        // It overlaps at the start: stopped only if it approaches, or if its centre lies on the
        // face.
        let offset = start - closest_point_on_triangle(t, start).point;
        let approaches = offset == DVec3::ZERO || offset.dot(motion) < 0.0;
        return approaches.then_some(0.0);
    }
    if gap(low) > 0.0 {
        return None;
    }
    let (mut outside, mut inside) = (0.0, low);
    for _ in 0..90 {
        let middle = (outside + inside) * 0.5;
        if gap(middle) > 0.0 {
            outside = middle
        } else {
            inside = middle
        }
    }
    Some(outside)
}

#[test]
fn a_swept_sphere_stops_where_it_first_touches_any_face() {
    let (mut hits, mut free) = (0, 0);
    for_each_front(23, &[0, 60, 97, 100], |name, front, _, random| {
        for k in 0..30 {
            let size = front.diagonal();
            let radius = size * [0.002, 0.01, 0.05][k % 3];
            let start = some_point(front, random);
            // Towards the model, or anywhere.
            let motion = if k % 2 == 0 {
                front.any_face(random).1[0] - start
            } else {
                random.vector() * size * 0.3
            };
            let mut expected: Option<f64> = None;
            for &(_, t) in &front.faces {
                // Faces that the path stays away from for certain.
                let (low, high) = (start.min(start + motion), start.max(start + motion));
                let (a, b) = (t[0].min(t[1]).min(t[2]), t[0].max(t[1]).max(t[2]));
                let reach = radius * 1.001;
                if (a - reach).cmpgt(high).any() || (b + reach).cmplt(low).any() {
                    continue;
                }
                if let Some(s) = first_contact(t, start, motion, radius)
                    && expected.is_none_or(|least| s < least)
                {
                    expected = Some(s);
                }
            }
            let found = swept_sphere(front.surface(), start, motion, radius).0;
            // A graze is found short of the touch, and so is one that is none by a hair.
            let moved = |s: f64| s * motion.length();
            match (found, expected) {
                (None, None) => free += 1,
                (Some(hit), Some(s)) => {
                    let off = moved(hit.fraction) - moved(s);
                    assert!(
                        off <= 1e-7 * radius,
                        "{name}: {off} too far, radius {radius}"
                    );
                    assert!(
                        off >= -2e-3 * radius,
                        "{name}: {off} short, radius {radius}"
                    );
                    hits += 1;
                }
                (hit, touch) => {
                    // Both ways only for grazes: the other one's least gap is nothing.
                    let s = hit.map(|h| h.fraction).or(touch).unwrap_or(0.0);
                    let centre = start + motion * s;
                    let nearest = closest_point(front.surface(), centre, None).0;
                    let gap = nearest.map_or(f64::INFINITY, |n| {
                        n.closest.distance_squared.sqrt() - radius
                    });
                    assert!(
                        gap.abs() <= 1e-6 * radius,
                        "{name}: found {hit:?}, expected {touch:?}, gap {gap}, radius {radius}"
                    );
                }
            }
        }
    });
    println!("{hits} hits, {free} free");
    assert!(hits > 500 && free > 200, "{hits} hits, {free} free");
}

#[test]
fn at_full_resolution_the_closest_point_is_as_near_as_the_one_parry_finds() {
    for_each_front(24, &[100], |name, front, parts, random| {
        assert_eq!(front.tree.faces(), parts.header.faces, "{name}");
        // In units of the diagonal: parry's tolerances are absolute.
        let size = front.diagonal();
        let mut vertices: Vec<DVec3> = Vec::new();
        let mut faces: Vec<[u32; 3]> = Vec::new();
        for face in &parts.full_faces {
            let first = vertices.len() as u32;
            faces.push([first, first + 1, first + 2]);
            let at = |v: u32| Vec3::from_array(parts.position(v)).as_dvec3() / size;
            vertices.extend(face.corners.map(at));
        }
        let peer = TriMesh::new(vertices, faces).expect("the full mesh has faces");
        for _ in 0..100 {
            let point = some_point(front, random);
            let theirs = peer
                .project_local_point(point / size, false)
                .point
                .distance(point / size);
            let ours = closest_point(front.surface(), point, None)
                .0
                .map_or(f64::INFINITY, |n| n.closest.distance_squared.sqrt() / size);
            assert!(
                (ours - theirs).abs() <= 1e-9 * (1.0 + theirs),
                "{name}: {ours} {theirs}"
            );
        }
    });
}
