//! After every split and collapse of a walk over fronts of real models, the boxes of the AB-tree
//! are those of a fresh refit, bit for bit.

use crate::common::{build, load, made_meshes, real_meshes_where};
use ab_tree::AbTree;
use rand::{RngCore, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use spm::{FrontWalk, SpmParts};

/// Up to half of the full mesh, to and fro, down, and up again.
fn walk(name: &str, parts: &SpmParts, operations: u32, random: &mut Xoshiro256PlusPlus) {
    let header = parts.header;
    let mut walk = FrontWalk::new(load(parts));
    let mut tree = AbTree::new(header.base_faces + 2 * header.vsps);
    tree.preconstruct(header.faces);
    for (face, base) in (0u32..).zip(&parts.base_faces) {
        assert!(tree.insert(face, base.leaf), "{name}");
    }
    tree.refit(|f| walk.mesh.face_box(f));
    tree.check(|f| walk.mesh.face_box(f));
    let mut most = 0;
    for k in 0..operations {
        let splits_of_ten = [9, 9, 5, 1, 8][(k * 5 / operations) as usize];
        if random.next_u32() % 10 < splits_of_ten {
            if walk.split(&mut || random.next_u32(), |_| true).is_none() {
                continue;
            }
            let out = &walk.out;
            for (&face, leaf) in out.made_or_removed().iter().zip(out.leaves) {
                assert!(tree.insert(face, leaf), "{name}");
            }
        } else {
            if walk.collapse(&mut || random.next_u32()).is_none() {
                continue;
            }
            for &face in walk.out.made_or_removed() {
                tree.remove(face);
            }
        }
        for &face in walk.out.deformed() {
            tree.deform(face);
        }
        tree.refit(|f| walk.mesh.face_box(f));
        tree.check(|f| walk.mesh.face_box(f));
        assert_eq!(tree.faces(), walk.mesh.active_faces(), "{name}");
        most = most.max(tree.faces());
    }
    println!("{name}: {operations} operations, at most {most} faces");
    assert!(header.vsps < 500 || most > 500, "{name}: {most}");
}

#[test]
fn boxes_equal_a_fresh_refit_after_every_operation() {
    let seed = 7;
    println!("seed {seed}");
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    for (name, mesh) in made_meshes() {
        walk(&name, &build(&mesh, Some(20)), 1500, &mut random);
    }
    let real = ["cow.obj", "fandisk.obj", "dragon25k.obj", "busted.stl"];
    for (name, mesh) in real_meshes_where(|name| real.contains(&name)) {
        walk(&name, &build(&mesh, None), 2500, &mut random);
    }
}
