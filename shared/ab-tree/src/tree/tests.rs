//! Any order of operations leaves the boxes of a fresh refit.

use super::super::key::leaf_key;
use super::*;
use glam::Vec3;
use proptest::prelude::*;

fn some_box(face: u32, version: u32) -> Aabb {
    let mut h = (u64::from(face) << 20 | u64::from(version)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let mut next = || {
        h ^= h >> 29;
        h = h.wrapping_mul(0xBF58_476D_1CE4_E5B9);
        (h >> 40) as f32 / 1e4
    };
    let lower = Vec3::new(next(), next(), next());
    Aabb {
        lower,
        upper: lower + Vec3::new(next(), next(), next()),
    }
}

proptest! {
    /// Any order of insertions, removals and deformations, refitted at any time, leaves the boxes
    /// of a fresh refit and one node fewer than faces.
    #[test]
    fn boxes_equal_a_fresh_refit_after_any_operations(
        full in 1u32..300,
        operations in prop::collection::vec((0u32..300, 0u32..4), 1..200),
    ) {
        let mut tree = AbTree::new(full);
        tree.preconstruct(full);
        let mut versions = vec![0u32; full as usize];
        let mut present = vec![false; full as usize];
        let mut last = 0;
        for (face, what) in operations {
            let face = face % full;
            let f = face as usize;
            match what {
                0 | 1 if !present[f] => {
                    // Another face, in the tree or not, or none.
                    let near = (7 * face + 3 * last) % (full + 1);
                    prop_assert!(tree.insert_near(face, leaf_key(face, full), near));
                    last = face;
                    present[f] = true;
                }
                0 if present[f] => {
                    tree.remove(face);
                    present[f] = false;
                }
                2 if present[f] => {
                    versions[f] += 1;
                    tree.deform(face);
                }
                _ => {
                    tree.refit(|g| some_box(g, versions[g as usize]));
                    tree.check(|g| some_box(g, versions[g as usize]));
                }
            }
        }
        tree.refit(|g| some_box(g, versions[g as usize]));
        tree.check(|g| some_box(g, versions[g as usize]));
        prop_assert_eq!(tree.faces() as usize, present.iter().filter(|&&p| p).count());
        prop_assert!(tree.fresh <= full);
    }
}

#[test]
fn a_code_that_is_taken_or_no_leaf_is_refused() {
    let mut tree = AbTree::new(8);
    tree.preconstruct(4);
    assert!(tree.insert(0, leaf_key(1, 4)));
    assert!(!tree.insert(1, leaf_key(1, 4)));
    assert!(!tree.insert(1, 2));
    assert!(tree.insert(1, leaf_key(2, 4)));
    assert!(!tree.insert(2, leaf_key(2, 4)));
    assert!(!tree.insert_near(2, leaf_key(2, 4), 1) && !tree.insert_near(2, 3, 0));
    tree.refit(|f| some_box(f, 0));
    tree.check(|f| some_box(f, 0));
}
