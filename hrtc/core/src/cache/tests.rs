//! Slots of a cache, and what is written of them.

use super::{Cache, LoadError, RegionKey};
use spm::{SpmParts, VspRecord};

/// Begins the model and the answer to a region whose closure is this VSP; its index.
fn begin(cache: &mut Cache, parts: &SpmParts, vsp: u32) -> usize {
    cache.begin_model(&parts.header).expect("it fits");
    for (v, vertex) in (0u32..).zip(&parts.base_vertices) {
        assert!(cache.set_base_vertex(v, vertex));
    }
    for (f, face) in (0u32..).zip(&parts.base_faces) {
        assert!(cache.set_base_face(f, face));
    }
    cache.refit();
    let region = cache.regions.request(RegionKey::prefix(1));
    let region = region.expect("the table is empty");
    cache.begin_answer(region).expect("it is requested");
    cache.add_to_closure(region, vsp, true).expect("it fits");
    region
}

/// Then the object loses its place, and another has it.
#[test]
fn a_record_whose_parent_is_missing_takes_no_slot() {
    let mut parts = SpmParts::hexagon();
    parts.header.vsps = 2;
    let first = parts.records[0];
    // It splits a vertex of the first.
    let second = VspRecord {
        i: 1,
        vs: parts.header.base_vertices,
        ..first
    };
    let mut cache = Cache::new(1 << 20);
    let mut entries = u32::MAX;
    let region = begin(&mut cache, &parts, second.i);
    for _ in 0..2 {
        let loaded = cache.load(region, &second, &mut entries);
        assert_eq!(loaded, Err(LoadError::Gap));
        cache.check();
    }
    cache.begin_clear();
    cache.go_on_unloading(&mut entries);
    assert!(!cache.is_clearing());
    let region = begin(&mut cache, &parts, first.i);
    let loaded = cache.load(region, &first, &mut entries);
    loaded.expect("it stands on the base mesh");
    cache.check();
}

/// So that a small mesh in a large cache takes memory as it is used.
#[test]
fn references_of_slots_that_were_never_used_are_not_written() {
    let parts = SpmParts::hexagon();
    let mut cache = Cache::new(1 << 20);
    assert_eq!(cache.references.len(), 0);
    let mut entries = u32::MAX;
    // The second time the slot is used again.
    for _ in 0..2 {
        let region = begin(&mut cache, &parts, 0);
        let loaded = cache.load(region, &parts.records[0], &mut entries);
        loaded.expect("it stands on the base mesh");
        cache.check();
        assert_eq!(cache.references.len(), 1);
        assert!(cache.references.capacity() >= cache.slots() as usize);
        cache.begin_clear();
        cache.go_on_unloading(&mut entries);
        assert!(!cache.is_clearing());
    }
}
