//! Generated models: the bundled scene's shape, and those on which builders and fronts go wrong.

use glam::DVec3;
use spm_builder::SoupMesh;
use spm_builder::generate::{Shape, generate};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use ve_station::database::GENERATE_SEED;

/// What a case is called, and how it is made.
pub type HardMesh = (&'static str, fn() -> SoupMesh);

/// All cases.
pub const HARD_MESHES: [HardMesh; 8] = [
    ("relief", || generate(Shape::Relief, 100_000, GENERATE_SEED)),
    ("strip", || grid(20_000, 1, |_, _| true)),
    ("flat grid", || grid(128, 128, |_, _| true)),
    ("terrain with a lake", || {
        generate(Shape::Terrain, 60_000, 1)
    }),
    ("sieve", sieve),
    ("fans", fans),
    ("sponge", sponge),
    ("components", components),
];

/// A flat grid of squares, of which `keep` says which are there: every collapse costs the same.
fn grid(columns: u32, rows: u32, keep: impl Fn(u32, u32) -> bool) -> SoupMesh {
    let mut mesh = SoupMesh::default();
    for j in 0..=rows {
        for i in 0..=columns {
            mesh.positions.push([f64::from(i), f64::from(j), 0.0]);
        }
    }
    let at = |i: u32, j: u32| j * (columns + 1) + i;
    for j in 0..rows {
        for i in (0..columns).filter(|&i| keep(i, j)) {
            push_quad(
                &mut mesh,
                [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)],
            );
        }
    }
    mesh
}

fn push_quad(mesh: &mut SoupMesh, [a, b, c, d]: [u32; 4]) {
    mesh.triangles.extend([[a, b, c], [a, c, d]]);
}

/// Waves full of holes: most edges have one end on a rim.
fn sieve() -> SoupMesh {
    let mut mesh = grid(120, 120, |i, j| i % 3 != 1 || j % 3 != 1);
    for p in &mut mesh.positions {
        p[2] = 4.0 * (p[0] * 0.2).sin() * (p[1] * 0.15).cos();
    }
    mesh
}

/// Cones side by side, each a tip with so many faces that it is beyond what a split may move.
fn fans() -> SoupMesh {
    let (faces, rings) = (700u32, 6u32);
    let mut mesh = SoupMesh::default();
    for cone in 0..3 {
        let first = mesh.positions.len() as u32;
        let x = 2.5 * f64::from(cone);
        mesh.positions.push([x, 0.0, 1.0]);
        for ring in 1..=rings {
            let radius = f64::from(ring) / f64::from(rings);
            for k in 0..faces {
                let turn = TAU * f64::from(k) / f64::from(faces);
                mesh.positions
                    .push([x + radius * turn.cos(), radius * turn.sin(), 1.0 - radius]);
            }
        }
        let at = |ring: u32, k: u32| first + 1 + (ring - 1) * faces + k % faces;
        for k in 0..faces {
            mesh.triangles.push([first, at(1, k), at(1, k + 1)]);
            for ring in 1..rings {
                push_quad(
                    &mut mesh,
                    [
                        at(ring, k),
                        at(ring + 1, k),
                        at(ring + 1, k + 1),
                        at(ring, k + 1),
                    ],
                );
            }
        }
    }
    mesh
}

/// A Menger sponge of three levels: genus in the thousands, flat everywhere.
fn sponge() -> SoupMesh {
    let side = 27i32;
    let solid = |p: [i32; 3]| {
        p.iter().all(|x| (0..side).contains(x))
            && [1, 3, 9].iter().all(|&scale| {
                let middle = p.iter().filter(|&&x| x / scale % 3 == 1).count();
                middle < 2
            })
    };
    let mut mesh = SoupMesh::default();
    let mut known: BTreeMap<[i32; 3], u32> = BTreeMap::new();
    for index in 0..side.pow(3) {
        let cell = [index % side, index / side % side, index / side / side];
        if !solid(cell) {
            continue;
        }
        for axis in 0..3 {
            for far in [0, 1] {
                let mut beyond = cell;
                beyond[axis] += 2 * far - 1;
                if solid(beyond) {
                    continue;
                }
                let mut corner = |u: i32, v: i32| {
                    let mut p = cell;
                    p[axis] += far;
                    p[(axis + 1) % 3] += u;
                    p[(axis + 2) % 3] += v;
                    *known.entry(p).or_insert_with(|| {
                        mesh.positions.push(p.map(f64::from));
                        mesh.positions.len() as u32 - 1
                    })
                };
                let mut quad = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                if far == 0 {
                    quad.reverse();
                }
                push_quad(&mut mesh, quad);
            }
        }
    }
    mesh
}

/// Hundreds of small spheres: none can be simplified away, and most of the mesh is base mesh.
fn components() -> SoupMesh {
    let ball = generate(Shape::Sphere, 100, 1);
    let mut mesh = SoupMesh::default();
    for k in 0..400u32 {
        let first = mesh.positions.len() as u32;
        let centre = DVec3::new(f64::from(k % 20), f64::from(k / 20), f64::from(k % 7)) * 2.5;
        let moved = ball
            .positions
            .iter()
            .map(|&p| (DVec3::from_array(p) + centre).to_array());
        mesh.positions.extend(moved);
        let shifted = ball.triangles.iter().map(|t| t.map(|v| v + first));
        mesh.triangles.extend(shifted);
    }
    mesh
}
