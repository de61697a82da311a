//! Thesis, Theorem 4: any legal order of the same splits and collapses ends in the same mesh; and what makes it
//! true: legality is a property of the front, and the front fixes the mesh.

mod common;

use common::{Walk, build, load, made_meshes, random_front, real_meshes_where};
use rand::{RngCore, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use shared::spm::{ActiveMesh, Face, NONE, OperationFaces, SpmParts};
use std::collections::BTreeMap;

/// Made meshes and four real ones, built to small bases so that most of each is splits.
fn models() -> Vec<(String, SpmParts)> {
    let real = ["cow.obj", "fandisk.obj", "bunny20k.obj", "busted.stl"];
    made_meshes()
        .into_iter()
        .chain(real_meshes_where(|name| real.contains(&name)))
        .map(|(name, mesh)| (name, build(&mesh, Some(20))))
        .filter(|(_, parts)| parts.header.vsps > 0)
        .collect()
}

/// The active faces, with corners and neighbours.
fn faces(mesh: &ActiveMesh) -> BTreeMap<u32, Face> {
    let mut all = BTreeMap::new();
    mesh.for_each_active_face(|f| {
        all.insert(f, *mesh.face(f));
    });
    all
}

#[test]
fn any_legal_order_of_the_splits_of_a_front_ends_in_the_same_mesh() {
    let seed = 4;
    println!("seed {seed}");
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    for (name, parts) in models() {
        for (chance, down) in [(90, false), (99, false), (50, true)] {
            let ascending = random_front(&parts, &mut random, chance, down);
            let wanted = |i: u32| ascending.is_performed(i);
            let mut walk = Walk::new(&parts);
            let (mut splits, mut collapses) = (0u32, 0u32);
            // Some splits that the front does not hold come in and go out again.
            while ascending.performed() > 0 && splits < 2 * ascending.performed() {
                let what = random.next_u32() % 10;
                if what < 3 {
                    collapses += u32::from(walk.collapse(&mut random).is_some());
                } else {
                    splits += 1;
                    let any = what < 4;
                    if walk.split(&mut random, |i| any || wanted(i)).is_none() {
                        break;
                    }
                }
                if (splits + collapses).is_multiple_of(1 + parts.header.vsps / 50) {
                    walk.mesh.check();
                }
            }
            loop {
                // In any order: one round undoes what nothing depends on any more.
                let (keep, foreign) = walk.performed.iter().partition(|&&i| wanted(i));
                let mut foreign: Vec<u32> = foreign;
                walk.performed = keep;
                if foreign.is_empty() {
                    break;
                }
                foreign.retain(|&i| {
                    let legal = walk.mesh.collapse_is_legal(i);
                    if legal {
                        walk.mesh.collapse(i, &mut walk.out);
                        collapses += 1;
                    }
                    !legal
                });
                walk.performed.append(&mut foreign);
            }
            while walk.split(&mut random, wanted).is_some() {
                splits += 1;
            }
            walk.mesh.check();
            assert!(faces(&walk.mesh) == faces(&ascending), "{name}");
            assert_eq!(walk.mesh.performed(), ascending.performed(), "{name}");
            println!(
                "{name}: front of {}, {splits} splits, {collapses} collapses",
                ascending.performed()
            );
        }
    }
}

/// A record with the ids that its handles have: slots are VSP numbers.
struct Adjacency<'a> {
    mesh: &'a ActiveMesh,
    parts: &'a SpmParts,
}

impl Adjacency<'_> {
    /// The face across the edge `from` -> `to` of an active face; `None` when it has no such edge.
    fn across(&self, face: u32, from: u32, to: u32) -> Option<u32> {
        let Face {
            corners,
            neighbours,
        } = *self.mesh.face(face);
        (0..3)
            .find(|&k| corners[k] == from && corners[(k + 1) % 3] == to)
            .map(|k| neighbours[(k + 2) % 3])
    }

    /// Whether `vertex` has an edge with `leaving` on its left and `entering` on its right, as recorded.
    fn side_by_side(&self, vertex: u32, leaving: u32, entering: u32) -> bool {
        let corner = |face: u32| {
            let corners = self.mesh.face(face).corners;
            let k = corners.iter().position(|&c| c == vertex)?;
            Some((corners[(k + 1) % 3], corners[(k + 2) % 3]))
        };
        let there = |face: u32| face == NONE || self.mesh.is_active(face);
        if !there(leaving) || !there(entering) {
            return false;
        }
        let left = leaving == NONE
            || corner(leaving)
                .is_some_and(|(far, _)| self.across(leaving, vertex, far) == Some(entering));
        let right = entering == NONE
            || corner(entering)
                .is_some_and(|(_, far)| self.across(entering, far, vertex) == Some(leaving));
        left && right
    }

    /// Thesis 5.2.3 after Hoppe 97: the split vertex is active, and so are fn0..fn3, adjacent as recorded.
    fn split_is_legal(&self, i: u32) -> bool {
        let record = &self.parts.records[i as usize];
        let [fn0, fn1, fn2, fn3] = record.fn_;
        self.side_by_side(record.vs, fn0, fn1)
            && (!record.has_right_face() || self.side_by_side(record.vs, fn3, fn2))
    }

    /// The same: vt and vu are active, and the neighbours of fl and fr are fn0..fn3.
    fn collapse_is_legal(&self, i: u32) -> bool {
        let (sizes, record) = (self.parts.header.sizes(), &self.parts.records[i as usize]);
        let (vt, fl) = (sizes.vt(i), sizes.fl(i));
        let (vu, fr) = (vt + 1, fl + 1);
        let [fn0, fn1, fn2, fn3] = record.fn_;
        let intact = |face: u32, from: u32, to: u32, ahead: u32, behind: u32, other: u32| {
            let corners = self.mesh.face(face).corners;
            let third = corners.iter().find(|&&c| c != from && c != to);
            third.is_some_and(|&third| {
                self.across(face, from, to) == Some(other)
                    && self.across(face, to, third) == Some(ahead)
                    && self.across(face, third, from) == Some(behind)
            })
        };
        let has_right = record.has_right_face();
        self.mesh.is_active(fl)
            && intact(fl, vt, vu, fn1, fn0, if has_right { fr } else { NONE })
            && (!has_right || intact(fr, vu, vt, fn2, fn3, fl))
    }
}

#[test]
fn legality_by_counters_equals_the_adjacency_tests_of_the_thesis() {
    let seed = 5;
    println!("seed {seed}");
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    for (name, parts) in models() {
        let vsps = parts.header.vsps;
        let mut walk = Walk::new(&parts);
        // Checks, and how many of them said yes, of splits and of collapses.
        let mut counts = [[0u32; 2]; 2];
        let every = 1 + vsps / 40;
        for step in 0..3 * vsps {
            // Up, then to and fro.
            let up = step < vsps || step % 2 == 0;
            if up {
                walk.split(&mut random, |_| true);
            } else {
                walk.collapse(&mut random);
            }
            if step % every != 0 {
                continue;
            }
            let mesh = &walk.mesh;
            let adjacency = Adjacency {
                mesh,
                parts: &parts,
            };
            for i in 0..vsps {
                if mesh.is_performed(i) {
                    let legal = mesh.collapse_is_legal(i);
                    assert_eq!(
                        legal,
                        adjacency.collapse_is_legal(i),
                        "{name}: collapse {i}"
                    );
                    counts[1][0] += 1;
                    counts[1][1] += u32::from(legal);
                } else {
                    let legal = mesh.split_is_legal(i);
                    assert_eq!(legal, adjacency.split_is_legal(i), "{name}: split {i}");
                    counts[0][0] += 1;
                    counts[0][1] += u32::from(legal);
                }
            }
        }
        println!("{name}: checks and legal, of splits and collapses: {counts:?}");
        let both = counts.iter().all(|&[all, yes]| yes > 0 && yes < all);
        assert!(vsps < 100 || both, "{name}: {counts:?}");
    }
}

#[test]
fn the_image_of_the_full_mesh_under_active_ancestors_is_the_front() {
    let seed = 6;
    println!("seed {seed}");
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let turned = |mut corners: [u32; 3]| {
        let least = (0..3).min_by_key(|&k| corners[k]).unwrap();
        corners.rotate_left(least);
        corners
    };
    for (name, parts) in models() {
        let sizes = parts.header.sizes();
        for (chance, down) in [
            (80, false),
            (97, false),
            (100, false),
            (30, true),
            (95, true),
        ] {
            let mesh = random_front(&parts, &mut random, chance, down);
            let ancestor = |mut vertex: u32| {
                while let Some(i) = sizes
                    .maker_of_vertex(vertex)
                    .filter(|&i| !mesh.is_performed(i))
                {
                    vertex = parts.records[i as usize].vs;
                }
                vertex
            };
            let image: BTreeMap<u32, [u32; 3]> = parts
                .full_faces
                .iter()
                .map(|f| (f.face, f.corners.map(ancestor)))
                .filter(|(_, [a, b, c])| a != b && b != c && c != a)
                .map(|(face, corners)| (face, turned(corners)))
                .collect();
            let active: BTreeMap<u32, [u32; 3]> = faces(&mesh)
                .into_iter()
                .map(|(face, f)| (face, turned(f.corners)))
                .collect();
            assert!(image == active, "{name} at {chance} %");
        }
    }
}

#[test]
fn a_split_out_of_turn_is_seen_by_both_tests() {
    // The oracle itself: on the base mesh exactly the splits without dependencies are legal.
    for (name, parts) in models() {
        let mesh = load(&parts);
        let adjacency = Adjacency {
            mesh: &mesh,
            parts: &parts,
        };
        let mut out = OperationFaces::new();
        for record in &parts.records {
            let free = record.dependencies(parts.header.sizes()).next().is_none();
            assert_eq!(adjacency.split_is_legal(record.i), free, "{name}");
        }
        let mut mesh = mesh.clone();
        mesh.split(0, &mut out).unwrap();
        let adjacency = Adjacency {
            mesh: &mesh,
            parts: &parts,
        };
        assert!(adjacency.collapse_is_legal(0) && !adjacency.split_is_legal(0));
    }
}
