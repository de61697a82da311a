//! A random walk over fronts with an AB-tree beside it.

use crate::models::Model;
use ab_tree::AbTree;
use spm::FrontWalk;

/// A walk, and the tree over its front; the tree's boxes are those of its last refit.
#[derive(Debug)]
pub struct WalkWithTree {
    /// The walk.
    pub walk: FrontWalk,
    /// The tree.
    pub tree: AbTree,
}

impl WalkWithTree {
    /// At the base mesh of a model.
    ///
    /// # Panics
    /// When a leaf code occurs twice.
    #[must_use]
    pub fn new(model: &Model) -> Self {
        let header = model.file.model_header();
        let mut tree = AbTree::new(header.base_faces + 2 * header.vsps);
        tree.preconstruct(header.faces);
        for (face, base) in (0u32..).zip(model.file.base_faces()) {
            assert!(tree.insert(face, base.leaf), "a leaf code occurs twice");
        }
        Self {
            walk: FrontWalk::new(model.active_mesh()),
            tree,
        }
    }

    /// A random split where `up`, else a random collapse; at an end of the walk the other. Whether
    /// it was a split, `None` when there is neither.
    ///
    /// # Panics
    /// When a leaf code occurs twice.
    pub fn step(&mut self, up: bool, draw: &mut impl FnMut() -> u32) -> Option<bool> {
        let was_split = if up && self.split(draw) {
            true
        } else if self.walk.collapse(draw).is_some() {
            for &face in self.walk.out.made_or_removed() {
                self.tree.remove(face);
            }
            false
        } else if self.split(draw) {
            true
        } else {
            return None;
        };
        for &face in self.walk.out.deformed() {
            self.tree.deform(face);
        }
        Some(was_split)
    }

    /// Brings the boxes up to date.
    pub fn refit(&mut self) {
        let mesh = &self.walk.mesh;
        self.tree.refit(|face| mesh.face_box(face));
    }

    fn split(&mut self, draw: &mut impl FnMut() -> u32) -> bool {
        if self.walk.split(draw, |_| true).is_none() {
            return false;
        }
        let out = &self.walk.out;
        for (&face, leaf) in out.made_or_removed().iter().zip(out.leaves) {
            assert!(self.tree.insert(face, leaf), "a leaf code occurs twice");
        }
        true
    }
}
