//! Meshes as they come: cut, torn, in a thousand pieces. They build, what was done is counted, and
//! what a cut may open on a coarse front is bounded.

use crate::common::{active_faces, build, grid, input_faces, load, random_front, refine};
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use spm::{ActiveMesh, ErrorScale, SpmParts};
use spm_builder::SoupMesh;
use std::collections::BTreeMap;

/// The walls of a block of rooms, each of `fine` x `fine` squares: four walls meet in every inner
/// edge.
fn rooms(count: u32, fine: u32) -> SoupMesh {
    let mut mesh = SoupMesh::default();
    let mut numbers: BTreeMap<[u32; 3], u32> = BTreeMap::new();
    let side = count * fine;
    for axis in 0..3 {
        for layer in 0..=count {
            let mut corner = |i: u32, j: u32| {
                let mut place = [0; 3];
                place[axis] = layer * fine;
                place[(axis + 1) % 3] = i;
                place[(axis + 2) % 3] = j;
                *numbers.entry(place).or_insert_with(|| {
                    // Not quite flat, and the same wherever a place is named from.
                    let [x, y, z] = place.map(f64::from);
                    let bump = 0.05 * (x * 1.7 + y * 2.3 + z * 3.1).sin();
                    mesh.positions.push([x + bump, y - bump, z + bump]);
                    mesh.positions.len() as u32 - 1
                })
            };
            for i in 0..side {
                for j in 0..side {
                    let square = [
                        corner(i, j),
                        corner(i + 1, j),
                        corner(i + 1, j + 1),
                        corner(i, j + 1),
                    ];
                    let [a, b, c, d] = square;
                    mesh.triangles.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
    }
    mesh
}

/// Tetrahedra far from each other.
fn tetrahedra(count: u32) -> SoupMesh {
    let mut mesh = SoupMesh::default();
    for k in 0..count {
        let (x, y) = (f64::from(k % 100) * 2.0, f64::from(k / 100) * 2.0);
        let first = mesh.positions.len() as u32;
        mesh.positions.extend([
            [x, y, 0.0],
            [x + 1.0, y, 0.0],
            [x, y + 1.0, 0.0],
            [x, y, 1.0],
        ]);
        let corners = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        mesh.triangles.extend(corners.map(|t| t.map(|v| first + v)));
    }
    mesh
}

fn check_refinement(name: &str, mesh: &SoupMesh, parts: &SpmParts) {
    let mut active = load(parts);
    active.check();
    refine(&mut active, parts);
    active.check();
    assert!(active_faces(&active) == input_faces(mesh), "{name}");
}

/// Full-mesh vertices at one place, where there are several.
fn copies(parts: &SpmParts) -> Vec<Vec<u32>> {
    let mut vertices: Vec<u32> = parts.full_faces.iter().flat_map(|f| f.corners).collect();
    vertices.sort_unstable();
    vertices.dedup();
    let mut places: BTreeMap<[u32; 3], Vec<u32>> = BTreeMap::new();
    for v in vertices {
        let place = parts.position(v).map(f32::to_bits);
        places.entry(place).or_default().push(v);
    }
    places.into_values().filter(|v| v.len() > 1).collect()
}

fn ancestor(mesh: &ActiveMesh, parts: &SpmParts, mut vertex: u32) -> u32 {
    let sizes = parts.header.sizes();
    while let Some(i) = sizes
        .creator_of_vertex(vertex)
        .filter(|&i| !mesh.is_performed(i))
    {
        vertex = parts.records[i as usize].vs;
    }
    vertex
}

/// The widest crack on a front; each lip must be within R of where it belongs.
fn widest_crack(mesh: &ActiveMesh, parts: &SpmParts, copies: &[Vec<u32>]) -> f64 {
    let mut widest = 0.0f64;
    for group in copies {
        let seam = mesh.position(group[0]).as_dvec3();
        let lips: Vec<_> = group
            .iter()
            .map(|&v| {
                let lip = ancestor(mesh, parts, v);
                let position = mesh.position(lip).as_dvec3();
                let bound = f64::from(mesh.radius(lip)) * (1.0 + 1e-6);
                assert!(position.distance(seam) <= bound, "a lip beyond its R");
                position
            })
            .collect();
        for a in &lips {
            for b in &lips {
                widest = widest.max(a.distance(*b));
            }
        }
    }
    widest
}

#[test]
fn cuts_open_no_crack_or_one_no_wider_than_reported() {
    let seed = 8;
    println!("seed {seed}");
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let few = grid(30, 30, |i, j| (i / 3 + j / 3) % 2 == 0);
    // All copies locked, some of them, none.
    let meshes = [
        ("few cuts", few, true, false),
        ("rooms", rooms(5, 6), true, true),
        ("many rooms", rooms(8, 3), false, true),
    ];
    for (name, mesh, some_locked, some_cracks) in meshes {
        let parts = build(&mesh, Some(300));
        check_refinement(name, &mesh, &parts);
        let copies = copies(&parts);
        let summary = parts.summary;
        assert!(copies.len() > 50, "{name}: nothing was cut");
        assert_eq!(summary.locked_vertices > 0, some_locked, "{name}");
        assert_eq!(summary.cracks_max > 0.0, some_cracks, "{name}");
        let mut widest = 0.0f64;
        for (chance, down) in [(0, false), (70, false), (97, false), (30, true), (90, true)] {
            let front = random_front(&parts, &mut random, chance, down);
            front.check();
            let crack = widest_crack(&front, &parts, &copies);
            assert!(crack <= summary.cracks_max, "{name}: {crack}");
            widest = widest.max(crack);
        }
        println!(
            "{name}: {} faces, base {}, {} copies, crack {widest} of {} on a diagonal of {}",
            parts.header.faces,
            parts.header.base_faces,
            copies.len(),
            summary.cracks_max,
            parts.header.diagonal
        );
        // The bound says something: random fronts come near it.
        assert!(!some_cracks || widest * 10.0 > summary.cracks_max);
        // Nor is it beyond what is certified: both lips within the largest R.
        let scale = ErrorScale::for_diagonal(parts.header.diagonal);
        let radii = parts
            .base_vertices
            .iter()
            .map(|v| f64::from(scale.certified_of_base(v).radius));
        assert!(summary.cracks_max <= 2.0 * radii.fold(0.0, f64::max));
    }
}

#[test]
fn a_third_of_the_edges_not_manifold_leaves_a_small_base_mesh() {
    // Too many copies to lock one; the sheets that cross stay whole, so that they simplify.
    let mesh = rooms(8, 3);
    let parts = build(&mesh, Some(500));
    check_refinement("rooms", &mesh, &parts);
    println!("{:?}", parts.summary);
    assert!(parts.summary.cut_vertices > 4000);
    assert!(
        parts.header.base_faces <= 600,
        "{} left",
        parts.header.base_faces
    );
    assert!(parts.header.dependency_depth <= 40);
    // Half as many are locked in part: two faces for each, and what the others leave.
    let parts = build(&rooms(6, 3), Some(500));
    let (faces, locked) = (parts.header.base_faces, parts.summary.locked_vertices);
    assert!(
        locked > 0 && u64::from(faces) <= 600 + 2 * locked,
        "{faces} left"
    );
}

#[test]
fn thousands_of_components_are_all_there_on_every_front() {
    let mesh = tetrahedra(5000);
    let parts = build(&mesh, None);
    // A tetrahedron is the least that a closed surface is.
    assert_eq!(parts.header.base_faces, 20_000);
    assert_eq!(parts.header.vsps, 0);
    let mut many = SoupMesh::default();
    for k in 0..3000 {
        let first = many.positions.len() as u32;
        let sheet = grid(3, 3, |_, _| true);
        let moved = sheet.positions.iter().map(|p| [p[0], p[1], f64::from(k)]);
        many.positions.extend(moved);
        let triangles = sheet.triangles.iter().map(|t| t.map(|v| first + v));
        many.triangles.extend(triangles);
    }
    let parts = build(&many, None);
    println!("{} faces left of 3000 sheets", parts.header.base_faces);
    assert!((3000..=12_000).contains(&parts.header.base_faces));
    check_refinement("sheets", &many, &parts);
}

#[test]
fn folded_inverted_and_doubled_faces_build() {
    // A flat sheet with a fold, a flipped face, a doubled one and its back side.
    let mut mesh = grid(20, 20, |_, _| true);
    mesh.positions[210][0] += 3.0;
    mesh.triangles[100].swap(1, 2);
    let copy = mesh.triangles[300];
    mesh.triangles.push(copy);
    mesh.triangles.push([copy[0], copy[2], copy[1]]);
    let parts = build(&mesh, Some(20));
    check_refinement("folds", &mesh, &parts);
    assert_eq!(parts.summary.duplicate_faces, 1);
    assert!(parts.summary.cut_vertices > 0);
    assert_eq!(parts.summary.cracks_max, 0.0);
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    for chance in [50, 90] {
        random_front(&parts, &mut random, chance, false).check();
    }
}
