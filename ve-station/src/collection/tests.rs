use super::*;
use crate::generate::Shape;
use crate::testing::{model, model_bytes};
use glam::UVec3;
use proptest::prelude::*;
use std::collections::BTreeSet;

/// The smallest set that holds the seeds and every dependency of its members, found by repetition.
fn fixpoint(file: &SpmFile<Vec<u8>>, region: RegionId) -> Vec<u32> {
    let sizes = file.model_header().sizes();
    let mut set: BTreeSet<u32> = file
        .seeds(region)
        .unwrap()
        .unwrap_or_default()
        .iter()
        .copied()
        .collect();
    loop {
        let more: BTreeSet<u32> = set
            .iter()
            .flat_map(|&i| file.record(i).unwrap().dependencies(sizes))
            .filter(|i| !set.contains(i))
            .collect();
        if more.is_empty() {
            return set.into_iter().collect();
        }
        set.extend(more);
    }
}

#[test]
fn a_closure_is_the_least_front_that_holds_the_seeds_ascending() {
    for (shape, faces) in [
        (Shape::Sphere, 2000),
        (Shape::Terrain, 3000),
        (Shape::Torus, 1500),
    ] {
        let file = model(shape, faces, 8);
        let mut collection = Collection::new(file.model_header().vsps);
        assert!(!file.regions().is_empty());
        for &region in file.regions() {
            let closure = collection.closure(&file, RegionAt::full(region)).unwrap();
            assert!(closure.windows(2).all(|w| w[0] < w[1]));
            assert_eq!(closure, fixpoint(&file, region), "{shape} {region:?}");
        }
    }
}

#[test]
fn a_cell_without_faces_is_empty_and_a_cell_outside_of_the_grid_is_refused() {
    let file = model(Shape::Sphere, 2000, 8);
    let mut collection = Collection::new(file.model_header().vsps);
    let middle = RegionId::of_cell(UVec3::splat(4));
    assert_eq!(
        collection.closure(&file, RegionAt::full(middle)),
        Ok(Vec::new())
    );
    for foreign in [RegionId::of_cell(UVec3::new(8, 0, 0)), RegionId(u32::MAX)] {
        let error = collection
            .closure(&file, RegionAt::full(foreign))
            .unwrap_err();
        assert_eq!(error, CollectError::UnknownRegion(RegionAt::full(foreign)));
        assert_eq!(error.refusal(), Refusal::UnknownRegion);
    }
}

#[test]
fn a_damaged_block_refuses_the_regions_that_need_it_and_no_others() {
    let bytes = model_bytes(Shape::Terrain, 20_000, 16);
    let sound = SpmFile::open(bytes.clone()).unwrap();
    let last = sound.model_header().vsps - 1;
    // The last record's bytes, found by content: damage the block that holds it.
    let record = sound.record(last).unwrap();
    let place = bytes
        .windows(64)
        .position(|w| w == bytemuck::bytes_of(&record))
        .unwrap();
    let mut damaged = bytes;
    damaged[place + 40] ^= 1;
    let damaged = SpmFile::open(damaged).unwrap();
    let mut collection = Collection::new(last + 1);
    let (mut refused, mut served) = (0, 0);
    for &region in sound.regions() {
        let truth = collection.closure(&sound, RegionAt::full(region)).unwrap();
        match collection.closure(&damaged, RegionAt::full(region)) {
            Ok(closure) => {
                assert_eq!(closure, truth);
                served += 1;
            }
            Err(error) => {
                assert_eq!(error.refusal(), Refusal::DamagedBlock);
                assert!(error.to_string().contains("block"), "{error}");
                refused += 1;
            }
        }
    }
    assert!(
        refused > 0 && served > 0,
        "{refused} refused, {served} served"
    );
}

proptest! {
    #[test]
    fn residency_lacks_exactly_what_no_held_region_contains(
        steps in prop::collection::vec((0usize..8, any::<bool>()), 1..60),
    ) {
        // Eight overlapping "closures" over 40 VSPs.
        let closures: Vec<Vec<u32>> =
            (0..8u32).map(|k| (0..40).filter(|i| (i * 7 + k * k) % 5 < 2).collect()).collect();
        let mut residency = Residency::default();
        let mut held = BTreeSet::new();
        for (k, insert) in steps {
            let region = RegionAt::full(RegionId(k as u32));
            let before: BTreeSet<u32> =
                held.iter().flat_map(|&h: &usize| closures[h].clone()).collect();
            if insert {
                let lacking = residency.insert(region, &closures[k], 40);
                let expected: Vec<u32> =
                    closures[k].iter().copied().filter(|i| !before.contains(i)).collect();
                prop_assert_eq!(lacking, expected);
                held.insert(k);
            } else {
                residency.remove(region, &closures[k]);
                held.remove(&k);
            }
            prop_assert_eq!(residency.holds(region), insert);
        }
    }
}
