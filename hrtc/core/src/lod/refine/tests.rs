//! A split that would turn a face over waits for those behind it, however little a tick has time
//! for, and no longer.

use super::*;
use crate::cache::base_mesh_store::Model;
use crate::cache::{Cache, RegionKey};
use crate::lod::front::FrontStats;
use crate::observer::NoObserver;
use crate::perception::{ContactConditions, PerceptionLimit};
use crate::tuning::governor::LARGE_FACES;
use glam::{DVec3, Vec3};
use scene::{EffectPlan, NoFiles, Overrides, parse};
use spm::{RegionId, SpmParts};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, build_model};
use std::sync::Arc;

/// So coarse a base mesh that its first splits fold the terrain over.
const BASE_FACES: u32 = 100;
/// Faces and closure entries of a tick that has time for any split, and to look at all of them.
const FACES: u32 = 10_000;
const ENTRIES: u32 = 100_000;
/// Entries of a tick that has time for one of them behind a split that waits.
const FEW_ENTRIES: u32 = BEHIND_SHARE;
/// Faces of a tick that has time for one look only.
const FEW_FACES: u32 = OPERATION_FACES + LARGE_FACES;
/// Ticks of a test at the most.
const MAX_TICKS: u64 = 200_000;

/// A terrain, all of which is to be performed under a ball that perceives every split.
struct Scene {
    front: Front,
    contacts: Contacts,
    region: usize,
    tick: u64,
}

impl Scene {
    fn new(seed: u64) -> Self {
        println!("seed {seed}");
        let options = BuildOptions {
            base_faces: Some(BASE_FACES),
            ..BuildOptions::default()
        };
        let mesh = generate(Shape::Terrain, 2_500, seed);
        let parts = build_model(mesh, &options, &NoProgress).expect("the model is built");
        let text = "[[object]]\nmodel = \"terrain.spm\"\nsize_m = 0.1\n[[probe]]\n";
        let plan = parse(text, "test", "".as_ref(), &Overrides::default(), &NoFiles)
            .expect("the scene is good");
        let mut front = Front::new(&plan, 4 << 20);
        let region = load_all(&mut front.cache, &parts);
        let model = Model {
            header: parts.header,
            radius_max: 0.0,
            area: 1.0,
        };
        front.begin(model, 1.0);
        front.cache.regions.at_mut(region).needed = u64::MAX / 2;
        front.predictions.arrivals.push(region);
        let effects: Arc<[EffectPlan]> = Arc::from(Vec::new());
        let mut contacts = Contacts::new(&plan, Arc::from(vec![effects]));
        let places = parts.base_vertices.iter();
        let places = places.map(|vertex| Vec3::from_array(vertex.position).as_dvec3());
        let centre = places.sum::<DVec3>() / f64::from(parts.header.base_vertices);
        let limit = PerceptionLimit::new(&ContactConditions {
            centre,
            radius: parts.header.diagonal,
            up: DVec3::Z,
            metres_per_unit: 1.0,
            // So soft that a geomorph takes few ticks.
            stiffness_n_per_m: 1e-3,
            is_contact: true,
            force_n: 0.0,
            depth_m: 0.0,
            reserve_j: 0.0,
            period_s: 1e-3,
        });
        contacts.limits.push((0, limit));
        let mut scene = Self {
            front,
            contacts,
            region,
            tick: 0,
        };
        // All of it becomes wanted.
        scene.tick(FACES, ENTRIES);
        scene
    }

    /// A tick with so many faces and closure entries, and one operation.
    fn tick(&mut self, faces: u32, entries: u32) -> FrontStats {
        self.tick += 1;
        assert!(self.tick < MAX_TICKS);
        self.front.stats = FrontStats::default();
        let mut observer = NoObserver;
        let mut budget = Budget {
            observer: &mut observer,
            ingest: 0,
            unspent_ingest: 0,
            operations: 1,
            faces: 0,
            max_fan: 0,
            entries,
            prepaid: 0,
            upkeep: 0,
            forgotten: 0,
        };
        budget.set_faces(faces);
        self.front
            .refine(self.tick, &mut budget, &mut self.contacts);
        self.front.stats
    }

    /// Until no vertex moves.
    fn come_to_rest(&mut self) {
        while !self.front.cache.mesh().geomorphs().is_empty() {
            self.tick(FACES, 0);
        }
    }

    fn is_done(&self) -> bool {
        self.front.cache.regions.at(self.region).is_done()
    }

    /// What the next tick would do with a split, of `max_fan` faces at the most.
    fn transition(&mut self, slot: Slot, max_fan: u32) -> Transition {
        self.front.faces.set_limit(max_fan as usize);
        let contacts = &mut self.contacts;
        self.front.transition_of_split(slot, Folds::Wait, contacts)
    }

    /// Whether the next split would turn a face over: then the number of closure entries to the
    /// first one behind it that would be performed, if there is any. Ticks look for it anew.
    fn fold(&mut self, max_fan: u32) -> Option<Option<u32>> {
        self.front.behind = None;
        let mut entries = u32::MAX;
        let slot = self.front.cache.next_split(self.region, &mut entries)?;
        self.front.cache.defer_split(self.region);
        if self.transition(slot, max_fan) != Transition::Rejected {
            return None;
        }
        let (mut place, mut entries) = (None, u32::MAX);
        loop {
            let cache = &self.front.cache;
            let next = cache.next_split_behind(self.region, &mut place, &mut entries);
            let NextBehind::Legal(slot) = next else {
                return Some(None);
            };
            if self.transition(slot, max_fan).is_performed() {
                return Some(Some(u32::MAX - entries));
            }
        }
    }
}

/// Loads a model as one region; its index.
fn load_all(cache: &mut Cache, parts: &SpmParts) -> usize {
    cache.begin_model(&parts.header).expect("it fits");
    for (v, vertex) in (0u32..).zip(&parts.base_vertices) {
        assert!(cache.set_base_vertex(v, vertex));
    }
    for (f, face) in (0u32..).zip(&parts.base_faces) {
        assert!(cache.set_base_face(f, face));
    }
    cache.refit();
    let key = RegionKey::new(RegionId::WHOLE, 0.0);
    let region = cache.regions.request(key).expect("the table is empty");
    cache.begin_answer(region).expect("it is requested");
    for i in 0..parts.header.vsps {
        cache.add_to_closure(region, i, true).expect("it fits");
    }
    let mut entries = u32::MAX;
    for record in &parts.records {
        let loaded = cache.load(region, record, &mut entries);
        loaded.expect("the builder's records fit");
    }
    cache.end_answer(region).expect("all records have come");
    region
}

#[test]
fn a_split_waits_for_what_comes_far_behind_it_however_few_entries_a_tick_has() {
    let mut scene = Scene::new(5);
    let mut waited = 0;
    while waited < 8 && !scene.is_done() {
        scene.come_to_rest();
        let behind = scene.fold(FACES / 4).flatten();
        if behind.is_none_or(|entries| entries == 1) {
            scene.tick(FACES, ENTRIES);
            continue;
        }
        println!("tick {}: {behind:?} entries behind", scene.tick);
        waited += 1;
        loop {
            let stats = scene.tick(FACES, FEW_ENTRIES);
            assert_eq!(stats.passed, 0, "tick {}", scene.tick);
            if stats.vsplits > 0 {
                break;
            }
        }
    }
    assert!(waited > 0, "no split of this terrain waits for another one");
}

#[test]
fn where_none_comes_a_fold_is_passed_however_little_a_tick_has_time_for() {
    let mut passed = 0;
    for (seed, faces) in [(5, FACES), (5, FEW_FACES), (6, FACES), (6, FEW_FACES)] {
        let mut scene = Scene::new(seed);
        let max_fan = if faces == FACES {
            FACES / 4
        } else {
            LARGE_FACES
        };
        let cache = &scene.front.cache;
        let entries = u64::from(cache.regions.at(scene.region).closure.length());
        let mut of_scene = 0;
        while of_scene < 4 && !scene.is_done() {
            scene.come_to_rest();
            if scene.fold(max_fan) != Some(None) {
                scene.tick(FACES, ENTRIES);
                continue;
            }
            let begin = scene.tick;
            loop {
                let stats = scene.tick(faces, FEW_ENTRIES);
                assert_eq!(stats.vsplits, stats.passed, "tick {}", scene.tick);
                if stats.passed > 0 {
                    break;
                }
                // A turn for each entry and one for what it is behind, and some at the end.
                let ticks = scene.tick - begin;
                assert!(ticks <= 2 * entries + 8, "{ticks} ticks");
            }
            of_scene += 1;
        }
        println!("{faces} faces a tick: {of_scene} folds passed");
        passed += of_scene;
    }
    assert!(
        passed > 0,
        "no split of these terrains has to turn a face over"
    );
}
