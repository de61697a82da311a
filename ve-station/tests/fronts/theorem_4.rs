//! Thesis, Theorem 4: any legal order of the same splits and collapses ends in the same mesh; and
//! what makes it true: legality is a property of the front, and the front fixes the mesh.

use crate::common::{build, load, made_meshes, random_front, real_meshes_where};
use rand::{RngCore, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use spm::{ActiveMesh, Face, FrontWalk, OperationFaces, SpmParts};
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
            let mut walk = FrontWalk::new(load(&parts));
            let (mut splits, mut collapses) = (0u32, 0u32);
            // Some splits that the front does not hold come in and go out again.
            while ascending.performed() > 0 && splits < 2 * ascending.performed() {
                let what = random.next_u32() % 10;
                if what < 3 {
                    collapses += u32::from(walk.collapse(&mut || random.next_u32()).is_some());
                } else {
                    splits += 1;
                    let any = what < 4;
                    if walk
                        .split(&mut || random.next_u32(), |i| any || wanted(i))
                        .is_none()
                    {
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
                        walk.mesh.collapse(i, &mut walk.out).unwrap();
                        collapses += 1;
                    }
                    !legal
                });
                walk.performed.append(&mut foreign);
            }
            while walk.split(&mut || random.next_u32(), wanted).is_some() {
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

#[test]
fn legality_by_counters_equals_the_adjacency_tests_of_the_thesis() {
    let seed = 5;
    println!("seed {seed}");
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    for (name, parts) in models() {
        let vsps = parts.header.vsps;
        let mut walk = FrontWalk::new(load(&parts));
        // Checks, and how many of them said yes, of splits and of collapses.
        let mut counts = [[0u32; 2]; 2];
        let every = 1 + vsps / 40;
        for step in 0..3 * vsps {
            // Up, then to and fro.
            let up = step < vsps || step % 2 == 0;
            if up {
                walk.split(&mut || random.next_u32(), |_| true);
            } else {
                walk.collapse(&mut || random.next_u32());
            }
            if step % every != 0 {
                continue;
            }
            let mesh = &walk.mesh;
            for i in 0..vsps {
                if mesh.is_performed(i) {
                    let legal = mesh.collapse_is_legal(i);
                    assert_eq!(
                        legal,
                        mesh.collapse_is_legal_by_adjacency(i),
                        "{name}: collapse {i}"
                    );
                    counts[1][0] += 1;
                    counts[1][1] += u32::from(legal);
                } else {
                    let legal = mesh.split_is_legal(i);
                    assert_eq!(
                        legal,
                        mesh.split_is_legal_by_adjacency(i),
                        "{name}: split {i}"
                    );
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
                    .creator_of_vertex(vertex)
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
        let mut mesh = load(&parts);
        for record in &parts.records {
            let free = record.dependencies(parts.header.sizes()).next().is_none();
            let legal = mesh.split_is_legal_by_adjacency(record.i);
            assert_eq!(legal, free, "{name}");
        }
        mesh.split(0, &mut OperationFaces::new()).unwrap();
        assert!(mesh.collapse_is_legal_by_adjacency(0) && !mesh.split_is_legal_by_adjacency(0));
    }
}

/// Thesis Figure 5.7 B is dead code: see [`FrontWalk::force`].
#[test]
fn no_split_ever_needs_a_collapse_first() {
    let seed = 8;
    println!("seed {seed}");
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    for (name, parts) in models() {
        let vsps = parts.header.vsps;
        let (mut forced, mut waited, mut longest) = (0, 0, 0);
        for (chance, down) in [(0, false), (80, false), (98, false), (20, true), (60, true)] {
            let front = random_front(&parts, &mut random, chance, down);
            let mut walk = FrontWalk::new(front);
            for _ in 0..200 {
                let i = random.next_u32() % vsps;
                if walk.mesh.is_performed(i) {
                    continue;
                }
                let at_once = walk.mesh.split_is_legal(i);
                let (legal, splits) = walk.force(i);
                assert!(legal, "{name}: VSP {i} after {splits} splits");
                assert!(walk.mesh.is_performed(i) && (splits == 1) == at_once);
                forced += 1;
                waited += u32::from(!at_once);
                longest = longest.max(splits);
            }
            walk.mesh.check();
        }
        println!(
            "{name}: {forced} splits, {waited} of them not legal at once, at most {longest} with them"
        );
        assert!(vsps < 100 || waited > 100, "{name}: {waited}");
    }
}
