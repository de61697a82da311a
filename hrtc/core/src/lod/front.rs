//! The front of an active object: its cache, the regions that are wanted, and their refinement.
//!
//! | file | does |
//! |---|---|
//! | `front` | state, and the accuracy that a contact has |
//! | `prediction` | names the regions that the probes will need |
//! | `refine` | splits, collapses, and the order of both |
//! | `room` | collapses and unloads regions where slots are short |
//! | `geomorph` | moves vertices so slowly that no probe perceives it |

use super::approach::Approach;
use super::lod_controller::{LodController, Ring};
use super::memory_pressure::MemoryPressure;
use super::predict::Sources;
use super::predictions::Predictions;
use crate::cache::base_mesh_store::Model;
use crate::cache::{AfterUnload, Cache, Cursor, RegionKey};
use crate::contact::query::Surface;
use crate::contact::rigid_proxy::MAX_BALLS;
use crate::contact::sphere_proxy::Contact;
use crate::horizons::Horizons;
use crate::perception::PerceptionLimit;
use crate::policy::{Detail, Seen};
use crate::probe::contacts::Contacts;
use crate::tuning::active::REACH_RADII;
use crate::tuning::lod::MAX_WANTED;
use crate::tuning::memory_pressure::STEPS_BEFORE_COARSER;
use crate::tuning::prediction::RADII_AROUND;
use crate::work::TickWork;
use scene::{RefinementPlan, ScenePlan};
use spm::{Handle, NONE, OperationFaces, RegionId, Slot};

/// The model that the front approximates.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct FrontModel {
    /// Header, largest R and area.
    pub model: Model,
    /// Metres a model unit.
    pub metres_per_unit: f64,
    /// The tolerances asked for around a contact.
    pub lod: LodController,
}

/// Work of a front in a tick.
#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
pub struct FrontStats {
    /// Splits performed.
    pub vsplits: u32,
    /// Collapses performed.
    pub ecols: u32,
    /// Work units spent.
    pub work_units: u32,
    /// Faces that operations and geomorphs changed, with what each operation counts more.
    pub faces: u32,
    /// Closure entries gone through.
    pub entries: u32,
    /// Splits that were due, and for which there was no time.
    pub left: u32,
    /// Perceptible splits that wait for room, or for a geomorph beside them.
    pub deferred: u32,
    /// Perceptible splits that would turn a face over.
    pub rejected: u32,
    /// Of these, the ones performed after all.
    pub passed: u32,
}

/// How far the splits behind one that would turn a face over were looked at, in ticks so far: none
/// of these came first when its turn was.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(super) struct LookBehind {
    /// The region that both are of, and its name: another may get its place in the table.
    pub region: usize,
    pub key: RegionKey,
    /// The split that waits.
    pub slot: Slot,
    /// The entry of the closure that was looked at last; none before the first.
    pub place: Option<Cursor>,
    /// Whether that was the last one of the closure.
    pub is_over: bool,
    /// The most faces that a split might change when one of these had to wait; 0 before. A tick
    /// with time for more looks at all of them anew.
    pub max_fan: u32,
}

impl LookBehind {
    /// Whether it is behind this split of a region.
    pub fn is_of(&self, region: usize, slot: Slot) -> bool {
        (self.region, self.slot) == (region, slot)
    }
}

/// Accuracy of the front at a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accuracy {
    /// Expected error, metres; negative where not even the coarsest ring is done.
    pub tolerance_m: f64,
    /// Whether it is the accuracy that was asked for.
    pub is_as_asked: bool,
}

/// See the module.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct Front {
    /// The loaded and the refined front.
    pub cache: Cache,
    pub(super) model: Option<FrontModel>,
    /// Operations a tick at the most.
    max_operations: f64,
    /// Operations a tick that there is time for.
    pub(super) operations: f64,
    /// How fine it may be for want of time.
    pub(super) detail: Detail,
    /// Steps by which less is asked for since time is short.
    pub(super) time_steps: u32,
    /// Splits, and collapses, a tick where nothing is urgent.
    pub(super) min_operations: u32,
    pub(super) plan: RefinementPlan,
    tolerance_m: f64,
    /// Prediction for each probe.
    pub(super) approaches: Vec<Approach>,
    /// Indices of wanted regions (set B of thesis Figure 5.17).
    pub(super) wanted: Vec<usize>,
    /// Wanted regions that are still to be refined, sorted by urgency.
    pub(super) queue: Vec<u64>,
    /// The look behind a split that goes on in the next tick.
    pub(super) behind: Option<LookBehind>,
    pub(super) predictions: Predictions,
    pub(super) faces: OperationFaces,
    /// Faces around the other vertex of a geomorphing pair.
    pub(super) faces_of_sibling: OperationFaces,
    /// Perception limits, with the index of the probe, that an operation may reach.
    pub(super) reached: Vec<(usize, PerceptionLimit)>,
    /// Share of each probe's limit that is used up in this tick.
    pub(super) used: Vec<f64>,
    /// The vertex whose geomorph has the first turn, since the time of the last tick was over
    /// before it had one.
    pub(super) without_turn: Option<Handle>,
    pub(super) pressure: MemoryPressure,
    /// While the cache is over its limit: the least bytes in use so far, and since which tick.
    pub(super) excess: Option<(usize, u64)>,
    pub(super) horizons: Horizons,
    /// The block of the whole model that was done last.
    pub(super) last_block: Option<RegionKey>,
    /// Work of this tick.
    pub stats: FrontStats,
    /// Regions refused so far, and the last one.
    pub refused_regions: u64,
    /// Id of the last refused region; [`NONE`] before the first.
    pub last_refused: u32,
    pub(super) wanted_high_water: usize,
}

impl Front {
    /// No model yet; everything is allocated now. `bytes`: size of the cache.
    #[must_use]
    pub fn new(plan: &ScenePlan, bytes: usize) -> Self {
        let probes = plan.probes.len();
        let horizons = Horizons::new(plan.loop_.rate_hz);
        Self {
            cache: Cache::new(bytes),
            model: None,
            max_operations: plan.loop_.operations as f64,
            operations: plan.loop_.operations as f64,
            detail: Detail::at_start(plan.accuracy.policy),
            time_steps: 0,
            min_operations: TickWork::new(plan.loop_.rate_hz).min_operations,
            plan: plan.accuracy.refinement,
            tolerance_m: plan.accuracy.tolerance_m,
            approaches: (0..probes).map(|_| Approach::new(&horizons)).collect(),
            wanted: Vec::with_capacity(MAX_WANTED),
            queue: Vec::with_capacity(MAX_WANTED),
            behind: None,
            predictions: Predictions::new(probes, horizons.prediction.looks),
            faces: OperationFaces::new(),
            faces_of_sibling: OperationFaces::new(),
            reached: Vec::with_capacity(probes * MAX_BALLS),
            used: vec![0.0; probes],
            without_turn: None,
            pressure: MemoryPressure::new(horizons.pressure),
            excess: None,
            horizons,
            last_block: None,
            stats: FrontStats::default(),
            refused_regions: 0,
            last_refused: NONE,
            wanted_high_water: 0,
        }
    }

    /// Forgets the model, the cache over several ticks ([`Cache::go_on_clearing`]); totals and
    /// high-water marks stay. Nothing is freed or allocated.
    pub fn begin_clear(&mut self) {
        self.cache.begin_clear();
        self.model = None;
        self.wanted.clear();
        self.queue.clear();
        self.behind = None;
        self.predictions.clear();
        self.without_turn = None;
        self.pressure = MemoryPressure::new(self.horizons.pressure);
        self.last_block = None;
        if let Detail::Splits(share) = &mut self.detail {
            *share = 0.0;
        }
    }

    /// The base mesh in the cache is complete: refinement may begin.
    pub fn begin(&mut self, model: Model, metres_per_unit: f64) {
        let lod = self.lod_for(&model, metres_per_unit);
        self.model = Some(FrontModel {
            model,
            metres_per_unit,
            lod,
        });
    }

    fn lod_for(&self, model: &Model, metres_per_unit: f64) -> LodController {
        let tolerance = (self.tolerance_m / metres_per_unit) as f32;
        LodController::new(&model.header, tolerance, model.area)
    }

    /// Asks for another expected error at the contact from the next tick on, metres.
    pub fn set_tolerance(&mut self, tolerance_m: f64) {
        self.tolerance_m = tolerance_m;
        if let Some(FrontModel {
            model,
            metres_per_unit,
            lod,
        }) = self.model.take()
        {
            let mut next = self.lod_for(&model, metres_per_unit);
            next.set_finest(lod.finest());
            self.model = Some(FrontModel {
                model,
                metres_per_unit,
                lod: next,
            });
        }
    }

    /// There is time for so many operations a tick, after so many steps by which less is asked for.
    pub fn set_time(&mut self, operations: f64, steps: u32) {
        self.operations = operations;
        self.time_steps = steps;
    }

    /// Whether another step for want of time would change what is asked for.
    #[must_use]
    pub fn can_ask_for_less(&self) -> bool {
        match self.plan {
            RefinementPlan::Local => {
                let is_finer = |lod: &LodController| lod.finest() + 1 < lod.rings().len();
                self.time_steps < STEPS_BEFORE_COARSER || self.lod().is_some_and(is_finer)
            }
            // Only what is loaded ahead goes.
            RefinementPlan::Global { .. } => self.time_steps == 0,
        }
    }

    /// It may be so fine.
    pub fn set_detail(&mut self, detail: Detail) {
        self.detail = detail;
    }

    /// How fine it may be for want of time.
    #[must_use]
    pub fn detail(&self) -> Detail {
        self.detail
    }

    /// What a policy goes by, of the probe that needs it most; `None` away from every probe.
    #[must_use]
    pub fn seen(&self, importance: f64, contacts: &Contacts) -> Option<Seen> {
        let of = self.model.as_ref()?;
        let pairs = contacts.pairs.iter().zip(&self.approaches);
        let near = pairs.filter(|(pair, _)| pair.is_near);
        let seen = near.map(|(pair, approach)| {
            let speed = approach.predictor.mean_speed();
            let radius = pair.patch_m / of.metres_per_unit;
            let reach = REACH_RADII * radius + speed * self.horizons.reach;
            Seen {
                importance,
                distance: pair.clearance.max(0.0) / reach,
                speed: speed * self.horizons.rate_hz / of.model.header.diagonal,
            }
        });
        seen.min_by(|a, b| a.distance.total_cmp(&b.distance))
    }

    /// Predicts from these sources from now on.
    pub fn set_sources(&mut self, sources: Sources) {
        for approach in &mut self.approaches {
            approach.predictor.set_sources(sources);
        }
    }

    /// The model, once its base mesh is complete.
    #[must_use]
    pub fn model(&self) -> Option<&FrontModel> {
        self.model.as_ref()
    }

    /// The tolerances asked for, once the model is known.
    #[must_use]
    pub fn lod(&self) -> Option<&LodController> {
        self.model.as_ref().map(|of| &of.lod)
    }

    /// The refined mesh and its tree.
    #[must_use]
    pub fn surface(&self) -> Surface<'_> {
        Surface {
            mesh: self.cache.mesh(),
            tree: self.cache.tree(),
        }
    }

    /// Steps of memory pressure now: 0 while the cache has room for everything.
    #[must_use]
    pub fn pressure_steps(&self) -> u32 {
        self.pressure.steps()
    }

    /// The cache could not hold a record or closure that was to come.
    pub fn starve(&mut self, tick: u64) {
        self.pressure.starve(tick);
    }

    /// The finest tolerance that is asked for now, model units.
    #[must_use]
    pub fn finest_tolerance(&self) -> f32 {
        self.lod().map_or(0.0, LodController::finest_tolerance)
    }

    /// The greatest speed that the finest ring admits for a patch of this radius (metres), model
    /// units a tick: above it the finest ring is raised. 0 without a model.
    #[must_use]
    pub fn greatest_speed(&self, widest_m: f64) -> f64 {
        let Some(of) = &self.model else {
            return 0.0;
        };
        let radius = widest_m / of.metres_per_unit;
        let reach = RADII_AROUND * radius;
        let lead = self.horizons.prediction.lead;
        of.lod.limit(0, reach, lead, self.max_operations)
    }

    /// Ticks that the slowest probe takes over a cell of the finest ring; infinite at rest.
    pub(super) fn cell_ticks(&self, contacts: &Contacts) -> f64 {
        let cell = |lod: &LodController| lod.rings()[lod.finest()].grid.cell;
        let pairs = contacts.pairs.iter().zip(&self.approaches);
        let near = pairs.filter(|(pair, _)| pair.is_near);
        let slowest = near
            .map(|(_, approach)| approach.predictor.mean_speed())
            .reduce(f64::min);
        self.lod().map_or(0.0, cell) / slowest.unwrap_or(0.0)
    }

    /// A probe comes near: its prediction begins.
    pub fn begin_approach(&mut self, probe: usize) {
        self.approaches[probe].begin();
    }

    /// Periods were skipped since the last prediction.
    pub fn skip_periods(&mut self, periods: u64) {
        for approach in &mut self.approaches {
            approach.predictor.skip_periods(periods);
            approach.forecast.skip_periods(periods);
        }
    }

    /// The answer to a requested region is complete: if the region is needed it need not wait for
    /// its next prediction.
    pub fn region_arrived(&mut self, index: usize, tick: u64) {
        self.predictions.region_arrived(index, tick, &self.cache);
    }

    /// Gives up a region that cannot be used; after a while it may be requested again. Returns
    /// whether its answer was outstanding.
    pub fn refuse(&mut self, region: usize, why: AfterUnload, tick: u64) -> bool {
        let was_outstanding = self.cache.begin_unload(region, why, tick);
        self.last_refused = self.cache.regions.at(region).key.id.0;
        self.refused_regions += 1;
        was_outstanding
    }

    /// Regions wanted, and kept to be requested, at once, at the most; and how many there may be.
    #[must_use]
    pub fn high_water(&self) -> [(usize, usize); 2] {
        [
            (self.wanted_high_water, MAX_WANTED),
            self.predictions.high_water(),
        ]
    }

    /// The accuracy at a probe's contact of this certified error, model units; notes what it misses
    /// for want of room.
    pub fn accuracy_at(&mut self, probe: usize, contact: &Contact, certified: f32) -> Accuracy {
        let missing = self.missing_at(probe, contact, certified);
        self.pressure.record_contact(missing);
        let reached = if certified == 0.0 {
            Some(0.0)
        } else {
            self.tolerance_at(contact)
        };
        // A face that still moves is not what was asked for.
        let faces = contact.faces.iter().take_while(|&&face| face != NONE);
        let is_moving = self
            .cache
            .mesh()
            .any_geomorphing(&contact.faces[..faces.count()]);
        let reached = reached.filter(|_| !is_moving);
        let scale = self.model.as_ref().map_or(0.0, |of| of.metres_per_unit);
        Accuracy {
            tolerance_m: reached.map_or(-1.0, |t| f64::from(t) * scale),
            is_as_asked: self.is_as_asked(certified, reached),
        }
    }

    /// The error of a contact for want of room, in errors of the next coarser ring. Of a region
    /// that is here it is that of its ring: what is missing then is time, or the probe is in the
    /// way.
    fn missing_at(&self, probe: usize, contact: &Contact, certified: f32) -> f64 {
        let Some(lod) = self.lod() else {
            return 0.0;
        };
        let finest = match self.plan {
            RefinementPlan::Local => self.approaches[probe].finest,
            RefinementPlan::Global { .. } => lod.finest(),
        };
        let Some(ring) = lod.rings().get(finest) else {
            return 0.0;
        };
        let index = self.cache.regions.index(self.key_at(ring, contact));
        let is_here = index.is_some_and(|index| self.cache.regions.at(index).is_resident());
        let error = if is_here {
            certified.min(ring.tolerance)
        } else if certified.is_nan() {
            // There is no bound, which is not to count as no error.
            f32::INFINITY
        } else {
            certified
        };
        match (self.plan, lod.rings().get(finest + 1)) {
            (RefinementPlan::Local, Some(next)) => f64::from(error) / f64::from(next.tolerance),
            (RefinementPlan::Local, None) => 0.0,
            // A block that finds no room once never does.
            (RefinementPlan::Global { .. }, _) if is_here || error == 0.0 => 0.0,
            (RefinementPlan::Global { .. }, _) => f64::INFINITY,
        }
    }

    /// The region of a ring that holds a contact.
    fn key_at(&self, ring: &Ring, contact: &Contact) -> RegionKey {
        let id = match self.plan {
            RefinementPlan::Local => ring.grid.region_of_point(contact.point),
            RefinementPlan::Global { .. } => RegionId::WHOLE,
        };
        RegionKey::new(id, ring.tolerance)
    }

    /// Whether a contact of this certified error and reached tolerance, model units, is what was
    /// asked for.
    fn is_as_asked(&self, certified: f32, reached: Option<f32>) -> bool {
        match (self.plan, &self.model) {
            (RefinementPlan::Global { lod: Some(count) }, Some(of)) => {
                let count = count.min(of.model.header.vsps);
                certified == 0.0 || self.is_done(RegionKey::prefix(count))
            }
            _ => reached.is_some_and(|t| self.lod().is_some_and(|lod| t <= lod.asked())),
        }
    }

    /// The expected error of the front at a contact, model units: the tolerance of the finest
    /// region that holds it and is done; `None` where not even the coarsest is.
    fn tolerance_at(&self, contact: &Contact) -> Option<f32> {
        self.lod()?.rings().iter().find_map(|ring| {
            let is_done = self.is_done(self.key_at(ring, contact));
            is_done.then_some(ring.tolerance)
        })
    }

    /// Whether all splits of a region are performed now.
    pub(super) fn is_done(&self, key: RegionKey) -> bool {
        let index = self.cache.regions.index(key);
        index.is_some_and(|index| self.cache.regions.at(index).is_done())
    }
}
