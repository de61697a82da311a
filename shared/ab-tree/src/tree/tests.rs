//! Any order of operations leaves the boxes of a fresh refit.

use super::super::key::leaf_key;
use super::*;
use glam::Vec3;
use proptest::prelude::*;
use std::collections::BTreeSet;

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
        prop_assert!(tree.nodes.len() <= full as usize);
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

/// So that a recording's twin, and its keyframes, are as large as what a run has used.
#[test]
fn nodes_that_were_never_used_are_not_written() {
    let mut tree = AbTree::new(1 << 16);
    tree.preconstruct(8);
    for face in 0..4 {
        assert!(tree.insert(face, leaf_key(face, 8)));
    }
    assert_eq!(tree.nodes.len(), 3);
    assert!(tree.nodes.capacity() >= 1 << 16);
    tree.remove(0);
    assert!(tree.insert(0, leaf_key(0, 8)));
    assert_eq!(tree.nodes.len(), 3, "a free one is used again");
}

/// What happened to leaves since the last refit, by their keys.
#[derive(Default)]
struct Touched(Vec<u32>);

impl Touched {
    /// Boxes that a refit has to take: those of the faces that are new or were deformed, and of all
    /// nodes above these and above those that were removed.
    fn boxes(&self, tree: &AbTree) -> u32 {
        let is_above = |key: u32, leaf: u32| {
            let below = depth(leaf).checked_sub(depth(key));
            below.is_some_and(|below| leaf >> below == key)
        };
        let mut boxes = 0;
        let mut stack: Vec<Child> = tree.root().into_iter().collect();
        while let Some(child) = stack.pop() {
            let Child::Node(id) = child else { continue };
            for child in tree.node(id).children() {
                let key = tree.key_of(child);
                boxes += u32::from(self.0.iter().any(|&leaf| is_above(key, leaf)));
                stack.push(child);
            }
        }
        boxes
    }
}

/// A tree over `full` faces, its faces' versions, and what was done.
struct Scene {
    full: u32,
    tree: AbTree,
    versions: Vec<u32>,
    touched: Touched,
}

impl Scene {
    fn new(full: u32) -> Self {
        let mut tree = AbTree::new(full);
        tree.preconstruct(full);
        Self {
            full,
            tree,
            versions: vec![0; full as usize],
            touched: Touched::default(),
        }
    }

    /// Inserts a face, or removes or deforms the one that is there.
    fn change(&mut self, face: u32, removes: bool) {
        let leaf = leaf_key(face, self.full);
        let is_there = self.tree.leaf_of(face) != 0;
        match (is_there, removes) {
            (false, true) => return,
            (true, true) => self.tree.remove(face),
            (true, false) => {
                self.versions[face as usize] += 1;
                self.tree.deform(face);
            }
            (false, false) => assert!(self.tree.insert(face, leaf)),
        }
        self.touched.0.push(leaf);
    }

    /// Empties it and forgets what was done.
    fn clear(&mut self) {
        self.tree.begin_clear();
        self.tree.forget_faces(0..self.full);
        self.touched.0.clear();
    }

    /// Refits, checks everything, and that nothing is left to do; the boxes that were taken.
    fn refit(&mut self) -> u32 {
        let due = self.touched.boxes(&self.tree);
        let versions = &self.versions;
        let taken = self.tree.refit(|f| some_box(f, versions[f as usize]));
        self.tree.check(|f| some_box(f, versions[f as usize]));
        let of_nodes = &self.tree.deformed[..self.tree.nodes.len()];
        assert!(of_nodes.iter().all(|&flags| flags == 0));
        if let Some(Child::Node(_)) = self.tree.root() {
            assert_eq!(taken, due, "each box above a change is taken once");
            let again = self.tree.refit(|_| unreachable!("no face is deformed"));
            assert_eq!(again, 0);
        }
        self.touched.0.clear();
        taken
    }
}

proptest! {
    /// Many changes between two refits, so that nodes that wait for one are released, taken again
    /// elsewhere and released again: each refit is that of the tree as it is, takes each box above
    /// a change once and no other.
    #[test]
    fn a_refit_takes_the_boxes_above_the_changes_and_no_other(
        full in 1u32..60,
        changes in prop::collection::vec(
            prop::collection::vec((0u32..60, any::<bool>()), 0..80),
            1..8,
        ),
        cleared in 0usize..16,
    ) {
        let mut scene = Scene::new(full);
        for (k, batch) in changes.iter().enumerate() {
            for &(face, removes) in batch {
                scene.change(face % full, removes);
            }
            if k == cleared {
                scene.clear();
            }
            scene.refit();
        }
    }

    /// Theorem 2, in leaves, whatever is deformed how often.
    #[test]
    fn a_refit_takes_no_more_nodes_than_theorem_2_allows(
        full in 2u32..600,
        deformed in prop::collection::vec(0u32..600, 1..200),
    ) {
        let mut scene = Scene::new(full);
        (0..full).for_each(|face| scene.change(face, false));
        scene.refit();
        deformed.iter().for_each(|face| scene.change(face % full, false));
        let faces: BTreeSet<u32> = deformed.iter().map(|face| face % full).collect();
        let k = faces.len() as u32;
        let each = full.next_power_of_two().ilog2() - k.ilog2() + 2;
        prop_assert!(scene.refit() < k * each);
    }
}

/// A node that waits for the refit is released, and taken again at another depth, where nothing of
/// what it waited for is left.
#[test]
fn a_listed_node_that_is_released_and_taken_again_is_refitted_where_it_is() {
    let mut scene = Scene::new(8);
    // All but one of the right half.
    for face in [0, 1, 2, 3, 4] {
        scene.change(face, false);
    }
    scene.refit();
    let node_of = |scene: &Scene, face: usize| scene.tree.face_node[face];
    let left = node_of(&scene, 0);
    assert_eq!(depth(scene.tree.node(left).key()), 2);
    scene.change(0, false);
    scene.change(0, true);
    assert_eq!(scene.tree.free, left);
    assert_ne!(
        scene.tree.deformed[left as usize], 0,
        "it waits all the same"
    );
    // Above the face that was alone on the right, a level higher.
    scene.change(7, false);
    assert_eq!(node_of(&scene, 7), left);
    assert_eq!(depth(scene.tree.node(left).key()), 1);
    // Two faces of it, its own box, and that of the node above 1, 2 and 3 and that below.
    let due = scene.touched.boxes(&scene.tree);
    assert_eq!(scene.refit(), due);
}

/// What waits for a refit is no more after all was removed, or the tree was cleared.
#[test]
fn nothing_of_an_emptied_tree_is_refitted() {
    for clears in [false, true] {
        let mut scene = Scene::new(16);
        (0..16).for_each(|face| scene.change(face, false));
        match clears {
            true => scene.clear(),
            false => (0..16).for_each(|face| scene.change(face, true)),
        }
        assert!(scene.tree.root().is_none());
        for face in [3, 9] {
            scene.change(face, false);
        }
        scene
            .touched
            .0
            .retain(|&leaf| [leaf_key(3, 16), leaf_key(9, 16)].contains(&leaf));
        assert_eq!(scene.refit(), 2);
    }
}
