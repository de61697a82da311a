//! The active front by ids of the file, which do not depend on the slots of the cache.

use hrtc_core::Controller;
use hrtc_core::cache::Cache;
use std::collections::BTreeSet;

/// Ids of the performed splits, ascending: the refined front.
#[must_use]
pub fn refined_front(cache: &Cache) -> Vec<u32> {
    let performed = (0..cache.slots()).filter(|&slot| cache.mesh().is_performed(slot));
    let mut ids: Vec<u32> = performed.map(|slot| cache.mesh().id(slot)).collect();
    ids.sort_unstable();
    ids
}

/// Ids of the active faces of the first object; none before its model is there.
///
/// # Panics
/// When a face is active twice.
#[must_use]
pub fn front_faces(controller: &Controller) -> BTreeSet<u32> {
    let base_faces = controller.header().map_or(0, |header| header.base_faces);
    let mesh = controller.cache().mesh();
    let mut faces = BTreeSet::new();
    mesh.for_each_active_face(|face| {
        let id = mesh.creator_of_face(face).map_or(face, |slot| {
            base_faces + 2 * mesh.id(slot) + (face - mesh.fl(slot))
        });
        assert!(faces.insert(id), "face {id} is active twice");
    });
    faces
}
