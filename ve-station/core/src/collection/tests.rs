use super::*;
use crate::testing::{model, model_bytes};
use geometry::Aabb;
use glam::UVec3;
use proptest::prelude::*;
use spm::{ModelHeader, VspRecord};
use spm_builder::generate::Shape;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::LazyLock;

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
        assert!(!file.regions().is_empty());
        for &region in file.regions() {
            let closure = closure(&file, RegionAt::full(region)).unwrap();
            assert!(closure.windows(2).all(|w| w[0] < w[1]));
            assert_eq!(closure, fixpoint(&file, region), "{shape} {region:?}");
        }
    }
}

#[test]
fn a_cell_without_faces_is_empty_and_a_cell_outside_of_the_grid_is_refused() {
    let file = model(Shape::Sphere, 2000, 8);
    let middle = RegionId::of_cell(UVec3::splat(4));
    assert_eq!(closure(&file, RegionAt::full(middle)), Ok(Vec::new()));
    for foreign in [RegionId::of_cell(UVec3::new(8, 0, 0)), RegionId(u32::MAX)] {
        let error = closure(&file, RegionAt::full(foreign)).unwrap_err();
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
    let (mut refused, mut served) = (0, 0);
    for &region in sound.regions() {
        let truth = closure(&sound, RegionAt::full(region)).unwrap();
        match closure(&damaged, RegionAt::full(region)) {
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

fn take_in(residency: &mut Residency, region: RegionAt, closure: &mut [u32]) {
    if residency.hold(region) {
        for i in closure {
            if residency.add(*i) {
                *i |= MISSING;
            }
        }
    }
}

fn give_up(residency: &mut Residency, region: RegionAt, closure: &[u32]) {
    if residency.release(region) {
        closure.iter().for_each(|&i| residency.subtract(i));
    }
}

/// A cell of a model of ten million VSPs costs what the cell costs.
#[test]
fn residency_takes_memory_for_what_is_held() {
    let mut residency = Residency::default();
    let region = RegionAt::full(RegionId(1));
    let mut closure: Vec<u32> = (0..300).chain(9_000_000..9_001_000).collect();
    take_in(&mut residency, region, &mut closure);
    assert!(closure.iter().all(|i| i & MISSING != 0));
    assert!(residency.bytes() < 16_384, "{}", residency.bytes());
    let ids: Vec<u32> = closure.iter().map(|i| i & !MISSING).collect();
    give_up(&mut residency, region, &ids);
    assert_eq!(residency.bytes(), 0);
}

proptest! {
    #[test]
    fn a_search_in_parts_finds_what_one_in_a_piece_finds(
        tolerance in 0.0..0.1f32, part in 1u32..200, which in 0usize..1000,
    ) {
        let file = &NAIVE[1].file;
        let regions = file.regions();
        for asked in [
            RegionAt::tolerance(RegionId::WHOLE, tolerance),
            RegionAt::full(regions[which % regions.len()]),
        ] {
            let mut search = Search::new(file, asked).unwrap();
            while !search.step(file, part).unwrap() {}
            prop_assert_eq!(search.into_closure(), closure(file, asked).unwrap());
        }
    }

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
                let mut marked = closures[k].clone();
                take_in(&mut residency, region, &mut marked);
                let lacking: Vec<u32> =
                    marked.iter().filter(|&i| i & MISSING != 0).map(|i| i & !MISSING).collect();
                let expected: Vec<u32> =
                    closures[k].iter().copied().filter(|i| !before.contains(i)).collect();
                prop_assert_eq!(lacking, expected);
                held.insert(k);
            } else {
                give_up(&mut residency, region, &closures[k]);
                held.remove(&k);
            }
            prop_assert_eq!(residency.holds(region), insert);
        }
    }
}

/// A model with everything that defines closures at tolerances, found the slow way from the records
/// and faces.
struct Naive {
    file: SpmFile<Vec<u8>>,
    /// E and reach of each VSP, straight from the definition.
    errors: Vec<f64>,
    reach: Vec<[u16; 6]>,
    dependencies: Vec<Vec<u32>>,
    scale: BoundsScale,
}

impl Naive {
    fn new(shape: Shape, faces: u32) -> Self {
        let file = model(shape, faces, 16);
        let header = file.model_header();
        let sizes = header.sizes();
        let records: Vec<VspRecord> = (0..sizes.vsps).map(|i| file.record(i).unwrap()).collect();
        let split_of: BTreeMap<u32, u32> = records.iter().map(|r| (r.vs, r.i)).collect();
        // From every vertex all the way up: what it is, or which full face touches it, is reached
        // by every split of an ancestor, its own included.
        let mut boxes = vec![Aabb::EMPTY; records.len()];
        let mut add = |vertex: u32, bounds: Aabb| {
            let mut at = Some(vertex);
            while let Some(v) = at {
                if let Some(&i) = split_of.get(&v) {
                    boxes[i as usize] = boxes[i as usize].union(bounds);
                }
                at = sizes.creator_of_vertex(v).map(|i| records[i as usize].vs);
            }
        };
        for vertex in 0..sizes.vt(sizes.vsps) {
            add(
                vertex,
                Aabb::of_points([file.vertex_position(vertex).unwrap()]),
            );
        }
        for position in 0..header.faces {
            let face = file.full_face(position).unwrap();
            let corners = face.corners.map(|v| file.vertex_position(v).unwrap());
            for corner in face.corners {
                add(corner, Aabb::of_triangle(corners));
            }
        }
        let codes = ErrorScale::for_diagonal(header.diagonal);
        let scale = BoundsScale::new(header.lower, header.upper);
        Self {
            errors: records.iter().map(|r| codes.decode(r.e)).collect(),
            reach: boxes.iter().map(|b| scale.encode(b)).collect(),
            dependencies: records
                .iter()
                .map(|r| r.dependencies(sizes).collect())
                .collect(),
            scale,
            file,
        }
    }

    fn closure(&self, asked: RegionAt) -> BTreeSet<u32> {
        let tolerance = f32::from_bits(asked.tolerance_bits);
        let grid = self.file.model_header().grid_of(tolerance);
        let grown = 2.0 * f64::from(tolerance);
        let is_wanted = |i: u32| {
            let (lower, upper) = grid.cell_box(asked.region);
            let near = asked.region == RegionId::WHOLE
                || self
                    .scale
                    .meets(self.reach[i as usize], lower - grown, upper + grown);
            near && self.errors[i as usize] > f64::from(tolerance)
        };
        let n = self.errors.len() as u32;
        let mut set: BTreeSet<u32> = (0..n).filter(|&i| is_wanted(i)).collect();
        // Dependencies come first: one pass from the last to the first takes all in.
        for i in (0..n).rev() {
            if set.contains(&i) {
                set.extend(&self.dependencies[i as usize]);
            }
        }
        set
    }

    fn is_front(&self, set: &BTreeSet<u32>) -> bool {
        let of = |i: &u32| self.dependencies[*i as usize].iter();
        set.iter().all(|i| of(i).all(|d| set.contains(d)))
    }
}

static NAIVE: LazyLock<Vec<Naive>> = LazyLock::new(|| {
    let shapes = [
        (Shape::Relief, 4000),
        (Shape::Torus, 2500),
        (Shape::Terrain, 3000),
    ];
    shapes.map(|(shape, faces)| Naive::new(shape, faces)).into()
});

/// A tolerance of the model: that of a level, something near one, or any share of the
/// diagonal.
fn tolerance_of(header: &ModelHeader, kind: u8, share: f64) -> f32 {
    let rungs: Vec<f32> = header.level_tolerances[1..]
        .iter()
        .copied()
        .filter(|r| r.is_finite())
        .collect();
    let rung = rungs[(share * rungs.len() as f64) as usize % rungs.len()];
    match kind {
        0 => rung,
        1 => rung.next_down(),
        2 => rung * 1.4,
        _ => (header.diagonal * 10f64.powf(-7.0 * share)) as f32,
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn a_closure_at_a_tolerance_is_what_its_definition_says(
        model in 0usize..3, kind in 0u8..4, share in 0.0..1.0f64,
        cells in prop::collection::vec(prop::array::uniform3(0.0..1.0f64), 1..5),
    ) {
        let naive = &NAIVE[model];
        let header = naive.file.model_header();
        let tolerance = tolerance_of(&header, kind, share);
        prop_assume!(tolerance > 0.0);
            let mut held = BTreeSet::new();
        let whole = RegionAt::tolerance(RegionId::WHOLE, tolerance);
        let everywhere = naive.closure(whole);
        let most = f64::from(tolerance);
        prop_assert_eq!(everywhere.len(), naive.errors.iter().filter(|&&e| e > most).count());
        let cells = cells.into_iter().map(|at| {
            let counts = UVec3::from_array(header.grid_of(tolerance).cells);
            RegionId::of_cell((DVec3::from_array(at) * counts.as_dvec3()).as_uvec3())
        });
        for region in cells.chain([RegionId::WHOLE]) {
            let asked = RegionAt::tolerance(region, tolerance);
            let search = Search::complete(&naive.file, asked).unwrap();
            let looked_at = search.looked_at();
            let closure = search.into_closure();
            prop_assert!(looked_at <= u64::from(header.base_vertices) + 2 * closure.len() as u64);
            prop_assert!(closure.windows(2).all(|w| w[0] < w[1]));
            let closure: BTreeSet<u32> = closure.into_iter().collect();
            prop_assert_eq!(&closure, &naive.closure(asked), "{}", asked);
            // Nothing finer than what was asked for, and so within the global front of the
            // tolerance.
            prop_assert!(closure.is_subset(&everywhere));
            held.extend(closure);
            prop_assert!(naive.is_front(&held), "a union of closures is a front");
        }
        let coarser = closure(&naive.file, RegionAt::tolerance(RegionId::WHOLE, tolerance * 1.5))
            .unwrap();
        prop_assert!(coarser.iter().all(|i| everywhere.contains(i)), "coarser is less");
    }

    #[test]
    fn any_request_is_answered_or_refused(
        region in any::<u32>(),
        bits in any::<u32>(),
        small in any::<bool>(),
    ) {
        let naive = &NAIVE[0];
        let header = naive.file.model_header();
        let region = RegionId(if small { region & 0x00f0_3c0f } else { region });
        for region in [region, RegionId::WHOLE, RegionId::PREFIX] {
            let asked = RegionAt { region, tolerance_bits: bits };
            let tolerance = f32::from_bits(bits);
            let is_tolerance = tolerance >= 0.0 && tolerance.is_finite();
            match closure(&naive.file, asked) {
                Ok(closure) => {
                    prop_assert!(region == RegionId::PREFIX || is_tolerance);
                    prop_assert!(closure.iter().all(|&i| i < header.vsps));
                }
                Err(error) => match error.refusal() {
                    Refusal::Tolerance => prop_assert!(!is_tolerance && region != RegionId::PREFIX),
                    refusal => {
                        prop_assert_eq!(refusal, Refusal::UnknownRegion);
                        prop_assert!(!header.grid_of(tolerance).contains(region));
                    }
                },
            }
        }
    }
}

#[test]
fn close_to_tolerance_0_nothing_is_missing_that_the_owned_faces_need() {
    for naive in NAIVE.iter() {
        let header = naive.file.model_header();
        let sizes = header.sizes();
        let (mut full_sum, mut small_sum) = (0, 0);
        let mut needed: BTreeMap<RegionId, BTreeSet<u32>> = BTreeMap::new();
        for position in 0..header.faces {
            let face = naive.file.full_face(position).unwrap();
            let corners = naive.file.leaf_corners(position).unwrap();
            let makers = face.corners.map(|v| sizes.creator_of_vertex(v));
            header.grid.for_each_owner(corners, |region| {
                let of_region = needed.entry(region).or_default();
                of_region.extend(makers.iter().flatten());
                of_region.extend(sizes.creator_of_face(face.face));
            });
        }
        for (region, needed) in needed {
            let small = RegionAt::tolerance(region, f32::MIN_POSITIVE);
            let near = closure(&naive.file, small).unwrap();
            let has_error = |i: &&u32| naive.errors[**i as usize] > f64::from(f32::MIN_POSITIVE);
            for i in needed.iter().filter(has_error) {
                assert!(near.binary_search(i).is_ok(), "{small} lacks {i}");
            }
            small_sum += near.len();
            full_sum += closure(&naive.file, RegionAt::full(region)).unwrap().len();
        }
        println!(
            "closures at 0+ hold {:.2} of those at 0",
            small_sum as f64 / full_sum as f64
        );
    }
}

#[test]
fn prefixes_are_cut_at_the_whole_and_the_whole_at_0_is_everything() {
    let file = &NAIVE[1].file;
    let n = file.model_header().vsps;
    let prefix = |count| {
        let asked = RegionAt {
            region: RegionId::PREFIX,
            tolerance_bits: count,
        };
        closure(file, asked).unwrap()
    };
    for count in [0, 1, n - 1, n, n + 1, u32::MAX] {
        assert!(prefix(count).into_iter().eq(0..count.min(n)));
    }
    let whole = RegionAt::tolerance(RegionId::WHOLE, 0.0);
    assert!(closure(file, whole).unwrap().into_iter().eq(0..n));
    let coarsest = RegionAt::tolerance(RegionId::WHOLE, f32::MAX);
    assert!(closure(file, coarsest).unwrap().is_empty());
}
