//! The numbers that vertices and faces get in the file.

use crate::history::History;
use spm::{NONE, Sizes};

/// Ids of the file for vertices and faces of the history: the base mesh is numbered in the order of
/// the history, and the last collapse is the first split.
pub struct Ids {
    /// Sizes of the model.
    pub sizes: Sizes,
    /// Id of each vertex.
    pub vertex: Vec<u32>,
    face: Vec<u32>,
}

impl Ids {
    /// Ids of a history over a mesh of `faces` faces.
    pub fn new(history: &History, faces: u32) -> Self {
        let vsps = history.collapses.len() as u32;
        let mut vertex = vec![NONE; history.positions.len()];
        let mut face = vec![NONE; faces as usize];
        for left in &history.base {
            face[left.face as usize] = 0;
            for corner in left.corners {
                vertex[corner as usize] = 0;
            }
        }
        let number = |marked: &mut [u32]| {
            let mut count = 0;
            for id in marked.iter_mut().filter(|id| **id == 0) {
                *id = count;
                count += 1;
            }
            count
        };
        let sizes = Sizes {
            base_vertices: number(&mut vertex),
            base_faces: number(&mut face),
            vsps,
            faces,
        };
        for (collapse, i) in history.collapses.iter().zip((0..vsps).rev()) {
            vertex[collapse.vt as usize] = sizes.vt(i);
            vertex[collapse.vu as usize] = sizes.vt(i) + 1;
            face[collapse.fl as usize] = sizes.fl(i);
            if collapse.fr != NONE {
                face[collapse.fr as usize] = sizes.fl(i) + 1;
            }
        }
        Self {
            sizes,
            vertex,
            face,
        }
    }

    /// Id of a face; [`NONE`] of [`NONE`].
    pub fn face(&self, face: u32) -> u32 {
        if face == NONE {
            NONE
        } else {
            self.face[face as usize]
        }
    }
}
