use super::*;
use crate::generate::{Shape, generate};
use crate::manifold::ManifoldMesh;
use crate::progress::NoProgress;
use crate::{assemble, clean, cut_to_manifold, order, simplify};
use geometry::closest_point_on_triangle;
use spm::{Certified, ErrorScale, NONE};
use std::collections::BTreeMap;

fn mesh(shape: Shape, faces: u32) -> ManifoldMesh {
    let cleaned = clean(generate(shape, faces, 3)).expect("a shape has faces");
    order::in_tree_order(cut_to_manifold(&cleaned))
}

fn simplified(mesh: &ManifoldMesh) -> History {
    let scale = ErrorScale::for_diagonal(assemble::bounds_of(mesh).diagonal());
    simplify::simplify(mesh, 100, scale, &NoProgress)
}

/// The corners of the faces of a front, by code of t: every vertex of the full mesh goes up to its
/// active ancestor.
fn front(mesh: &ManifoldMesh, history: &History, code: u16) -> Vec<[u32; 3]> {
    let made = history.full_vertices..;
    let mut parent = BTreeMap::new();
    for ((made, collapse), &expected) in made.zip(&history.collapses).zip(&history.expected) {
        if expected <= code {
            parent.extend([collapse.vt, collapse.vu].map(|child| (child, made)));
        }
    }
    let active = |mut vertex: u32| {
        while let Some(&above) = parent.get(&vertex) {
            vertex = above;
        }
        vertex
    };
    let faces = mesh.triangles.iter().map(|corners| corners.map(active));
    faces
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .collect()
}

/// Some codes of E, from fine to coarse.
fn some_codes(history: &History) -> Vec<u16> {
    let mut codes = history.expected.clone();
    codes.sort_unstable();
    let last = codes.len() - 1;
    [0.2, 0.5, 0.8, 0.95, 0.99, 1.0]
        .map(|share| codes[(last as f64 * share) as usize])
        .to_vec()
}

fn samples(corners: [DVec3; 3]) -> impl Iterator<Item = DVec3> {
    let weights = (0..=4).flat_map(|a| (0..=4 - a).map(move |b| [a, b, 4 - a - b]));
    weights.map(move |w| (0..3).map(|k| corners[k] * (f64::from(w[k]) / 4.0)).sum())
}

fn distance(corners: [DVec3; 3], point: DVec3) -> f64 {
    closest_point_on_triangle(corners, point)
        .distance_squared
        .sqrt()
}

#[test]
fn a_front_and_the_full_mesh_are_as_near_as_its_faces_say() {
    for (shape, faces) in [
        (Shape::Sphere, 800),
        (Shape::Torus, 1200),
        (Shape::Relief, 1000),
        (Shape::Terrain, 1000),
        (Shape::Wedge, 700),
    ] {
        let mesh = mesh(shape, faces);
        let history = simplified(&mesh);
        let full_vertices = history.full_vertices;
        let at = |v: u32| Vec3::from_array(history.positions[v as usize]).as_dvec3();
        let radius = |v: u32| {
            let made = v.checked_sub(full_vertices);
            made.map_or(0.0, |made| history.radius[made as usize])
        };
        let begin_of = |v: u32| {
            let made = v.checked_sub(full_vertices);
            made.map_or(0, |made| history.expected[made as usize])
        };
        let mut end: BTreeMap<u32, u16> = BTreeMap::new();
        for (collapse, &code) in history.collapses.iter().zip(&history.expected) {
            end.extend([collapse.vt, collapse.vu].map(|child| (child, code)));
        }
        let full: Vec<_> = mesh.triangles.iter().map(|t| t.map(at)).collect();
        let rounding = 1e-13 * assemble::bounds_of(&mesh).diagonal();
        let (mut coarse, mut close) = (0, 0);
        for code in some_codes(&history) {
            let mut front_faces = Vec::new();
            for corners in front(&mesh, &history, code) {
                let largest = corners.map(radius).into_iter().fold(0.0, f64::max);
                let begin = corners.map(begin_of).into_iter().max().unwrap_or(0);
                let by = |v: u32| {
                    let end = end.get(&v).copied().unwrap_or(u16::MAX);
                    history.close[v as usize] * Certified::growth(begin, end)
                };
                let bound = corners.map(by).into_iter().fold(largest, f64::min);
                coarse += u32::from(largest > 0.0);
                close += u32::from(bound < 0.25 * largest);
                front_faces.push((corners.map(at), bound + rounding));
            }
            for &(corners, bound) in &front_faces {
                for point in samples(corners) {
                    let near = |face: &[DVec3; 3]| distance(*face, point) <= bound;
                    assert!(
                        full.iter().any(near),
                        "{shape} at {code}: {point} beyond {bound}"
                    );
                }
            }
            for point in full.iter().flat_map(|&face| samples(face)) {
                let near = |face: &([DVec3; 3], f64)| distance(face.0, point) <= face.1;
                assert!(
                    front_faces.iter().any(near),
                    "{shape} at {code}: {point} is left out"
                );
            }
        }
        assert!(
            2 * close > coarse,
            "{shape}: {close} of {coarse} faces are close"
        );
    }
}

/// The faces across the side opposite each corner.
fn neighbours(mesh: &ManifoldMesh) -> Vec<[u32; 3]> {
    let side = |face: &[u32; 3], k: usize| (face[(k + 1) % 3], face[(k + 2) % 3]);
    let sides = |(f, face): (u32, _)| [0, 1, 2].map(|k| (side(face, k), f));
    let by_side: BTreeMap<_, u32> = (0..).zip(&mesh.triangles).flat_map(sides).collect();
    let across = |face: &[u32; 3], k| {
        let (from, to) = side(face, k);
        by_side.get(&(to, from)).copied().unwrap_or(NONE)
    };
    let of = |face| [0, 1, 2].map(|k| across(face, k));
    mesh.triangles.iter().map(of).collect()
}

#[test]
fn a_detour_leads_from_foot_to_foot_and_strays_no_farther_than_a_plane() {
    let mesh = mesh(Shape::Torus, 1500);
    let history = simplified(&mesh);
    let full = FullSurface::new(&mesh.positions, &mesh.triangles, neighbours(&mesh));
    let (boundary, descendants) = (Boundary::new(&full), Descendants::new(&history));
    let feet = feet(&history, &full, &boundary, &descendants);
    let traces = Traces {
        full: &full,
        boundary,
        descendants: &descendants,
    };
    let at = |v: u32| Vec3::from_array(history.positions[v as usize]).as_dvec3();
    let mut nearer = 0;
    for [a, b, _] in front(&mesh, &history, u16::MAX) {
        let edge = Edge {
            ends: [a, b],
            at: [at(a), at(b)],
            feet: [a, b].map(|v| &feet[v as usize]),
        };
        let (mut around, mut straight) = (Paths::default(), Paths::default());
        let limit = edge.at[0].distance_squared(edge.at[1]);
        let detour = traces.detour(&edge, limit, &mut around).expect("a way");
        if let Some(plane) = traces.trace(&edge, limit, &mut straight) {
            assert!(detour <= plane * (1.0 + 1e-9), "{detour} beyond {plane}");
            nearer += u32::from(detour < plane);
        }
        let mut face = edge.feet[0].face;
        for (left, right) in around.crossings {
            let corners = full.triangles()[face as usize];
            let side =
                (0..3).find(|&k| [corners[(k + 1) % 3], corners[(k + 2) % 3]] == [right, left]);
            face = full.neighbours()[face as usize][side.expect("a side of the face")];
        }
        assert_eq!(face, edge.feet[1].face);
    }
    assert!(nearer > 0);
}

#[test]
fn the_corners_of_a_face_are_the_active_ancestors_for_every_tolerance() {
    let mesh = mesh(Shape::Relief, 800);
    let history = simplified(&mesh);
    let fronts = Fronts::new(&history);
    let mut all: Vec<[u32; 3]> = Vec::new();
    for &corners in &mesh.triangles {
        fronts.for_each_corners(corners, |corners, _, _| all.push(corners));
    }
    let mut expected: Vec<[u32; 3]> = Vec::new();
    let mut codes = history.expected.clone();
    codes.push(0);
    codes.sort_unstable();
    codes.dedup();
    for code in codes {
        expected.extend(front(&mesh, &history, code));
    }
    for list in [&mut all, &mut expected] {
        list.sort_unstable();
        list.dedup();
    }
    assert_eq!(all, expected);
}

#[test]
fn bounds_are_the_same_bits_for_any_number_of_threads() {
    let mesh = mesh(Shape::Terrain, 12_000);
    let bounds = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let history = pool.expect("threads").install(|| simplified(&mesh));
        let bits = history.close.iter().map(|bound| bound.to_bits());
        bits.collect::<Vec<u64>>()
    };
    assert_eq!(bounds(1), bounds(3));
}

#[test]
fn a_patch_is_where_traces_go_round_not_as_often_as_outside() {
    let mesh = mesh(Shape::Sphere, 800);
    let full = FullSurface::new(&mesh.positions, &mesh.triangles, neighbours(&mesh));
    let rings = Rings::new(&full, mesh.positions.len());
    let plane = Plane::new([DVec3::ZERO, DVec3::X, DVec3::Y], 0.0);
    let mut search = Search::new(mesh.positions.len());
    let away = |v: u32| plane.see(full.position(v)).away;
    let round = |v: u32| rings.of(v).iter().map(move |&beside| (v, beside));
    let backward = |v: u32| round(v).map(|(left, right)| (right, left));
    let mut wound = |sides: Vec<Crossing>| {
        let found = search.farthest_wound(sides.into_iter(), &rings, (&full, &plane), 10);
        (
            found,
            search.inside().iter().map(|of| of.0).collect::<Vec<_>>(),
        )
    };
    for v in (0..mesh.positions.len() as u32).step_by(7) {
        // Another one with which it shares neighbours.
        let beyond = rings.of(v).iter().flat_map(|&beside| rings.of(beside));
        let is_beyond = |u: &u32| *u != v && !rings.of(v).contains(u);
        let u = beyond.copied().find(is_beyond).expect("the sphere goes on");
        let (found, inside) = wound(round(v).chain(backward(u)).collect());
        assert_eq!(found, Some(away(v).max(away(u))), "an eight");
        assert_eq!(inside.len(), 2);
        let (found, inside) = wound(round(v).chain(round(v)).collect());
        assert_eq!((found, inside), (Some(away(v)), vec![v]), "twice");
        let (found, inside) = wound(round(v).chain(backward(v)).collect());
        assert_eq!((found, inside), (Some(0.0), vec![]), "there and back");
        assert_eq!(wound(round(v).skip(1).collect()).0, None, "not closed");
    }
    assert_eq!(wound(Vec::new()).0, None);
}
