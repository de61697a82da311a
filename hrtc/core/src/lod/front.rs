//! What is asked for: the rings of the dial around the contact, or the whole model alike.

use crate::active::object::ActiveObject;
use crate::cache::RegionKey;
use crate::cache::base_mesh_store::Model;
use crate::contact::query::{Surface, closest_point};
use crate::contact::sphere_proxy::Contact;
use crate::lod::lod_controller::LodController;
use crate::lod::predict::{LEAD_TICKS, Predicted, RADII_AROUND, predict_beside};
use crate::streaming::subscriber::Outbox;
use scene::RefinementPlan;
use spm::ModelHeader;
use spm::RegionId;

/// Chunks that wait for the tick from which on nothing is asked for ahead of need.
const MAX_WAITING: usize = 8;

impl ActiveObject {
    /// The rings for a model: from the tolerance asked for up its ladder.
    pub(crate) fn dial_for(
        &self,
        header: &ModelHeader,
        area: f64,
        metres_per_unit: f64,
    ) -> LodController {
        LodController::new(header, (self.tolerance_m / metres_per_unit) as f32, area)
    }

    /// Asks for another expected error at the contact from the next tick on, metres.
    pub(crate) fn set_tolerance(&mut self, tolerance_m: f64) {
        self.tolerance_m = tolerance_m;
        if let Some((model, frame)) = self.known() {
            let finest = self.dial.as_ref().map_or(0, LodController::finest);
            let mut dial = self.dial_for(&model.header, model.area, frame.metres_per_unit);
            dial.set_finest(finest);
            self.dial = Some(dial);
        }
    }

    /// Steps of economy that the cache's size makes necessary now: 0 when nothing is done without.
    #[must_use]
    pub fn economy_steps(&self) -> u32 {
        self.refinement.economy.steps()
    }

    /// The greatest speed of what the finest ring could be, model units a tick, for the widest probe: above it the
    /// finest ring is raised. 0 without a model.
    #[must_use]
    pub fn greatest_speed(&self) -> f64 {
        let (Some((_, frame)), Some(dial)) = (self.known(), &self.dial) else {
            return 0.0;
        };
        let widest = self.touches.iter().map(|touch| touch.patch_m);
        let radius = widest.fold(0.0, f64::max) / frame.metres_per_unit;
        dial.limit(0, RADII_AROUND * radius, LEAD_TICKS, self.operations as f64)
    }

    /// The finest tolerance that is asked for now, model units.
    pub(crate) fn finest_tolerance(&self) -> f32 {
        self.dial
            .as_ref()
            .map_or(0.0, LodController::finest_tolerance)
    }

    /// Ticks that the slowest probe takes over a cell of the finest ring; infinite at rest.
    pub(crate) fn cell_ticks(&self) -> f64 {
        let cell = |dial: &LodController| dial.rings()[dial.finest()].grid.cell;
        let followed = self.touches.iter().filter(|touch| touch.is_followed);
        let slowest = followed
            .map(|touch| touch.predictor.pace())
            .reduce(f64::min);
        self.dial.as_ref().map_or(0.0, cell) / slowest.unwrap_or(0.0)
    }

    /// Predicts regions and writes the tick's requests; `waiting`: chunks that wait for the tick.
    pub(crate) fn predict(&mut self, tick: u64, waiting: usize, outbox: &mut Outbox) {
        self.refinement.begin();
        self.refinement.economy.recover(tick);
        if let Some((model, frame)) = self.known() {
            match self.refinement_plan {
                RefinementPlan::Local => self.predict_rings(&model, frame.metres_per_unit, tick),
                RefinementPlan::Global { lod } => {
                    if self.touches.iter().any(|touch| touch.goal.is_some()) {
                        self.want_globally(lod, tick);
                    }
                }
            }
        }
        let economy = &self.refinement.economy;
        // Answers come in the order of the questions: what is only ahead must not stand in the way of what is
        // needed next.
        let may_prefetch = economy.may_prefetch() && waiting < MAX_WAITING;
        let may_ask = economy.may_ask(tick) && self.subscriber.may_ask(&self.cache);
        let unknown = if may_ask {
            self.refinement.unknown()
        } else {
            &[]
        };
        let wanted = unknown
            .iter()
            .filter(|p| p.refine || may_prefetch)
            .map(|p| (p.key, crate::lod::refine::due(tick, p.ticks)));
        self.subscriber
            .requests(tick, &mut self.cache, wanted, outbox);
    }

    /// For each probe sets the finest ring by its speed and by room, then notes the regions of its rings. The finest
    /// of all is that of the dial: what one probe needs is not too fine for the others.
    fn predict_rings(&mut self, model: &Model, metres_per_unit: f64, tick: u64) {
        let Some(dial) = &mut self.dial else {
            return;
        };
        let (refinement, cache) = (&mut self.refinement, &mut self.cache);
        let rings = refinement.economy.has_rings();
        let raised = refinement.economy.raised();
        let mut finest = None;
        for touch in self.touches.iter_mut().filter(|touch| touch.is_followed) {
            let Some((device, motion)) = touch.motion(metres_per_unit, model.radius_max) else {
                continue;
            };
            let speed = touch.predictor.pace();
            let reach = RADII_AROUND * motion.radius + speed * LEAD_TICKS;
            dial.set_finest(touch.finest);
            let by_speed = dial.finest_at_speed(speed, reach, self.operations as f64);
            dial.set_finest(by_speed.max(raised));
            touch.finest = dial.finest();
            finest = Some(finest.map_or(touch.finest, |least: usize| least.min(touch.finest)));
            touch
                .predictor
                .predict(dial, rings, device, motion, |predicted| {
                    refinement.note(predicted, tick, cache);
                });
            for near in touch.beside.found() {
                let rings = rings && near.is_coarse;
                predict_beside(dial, rings, near.place, near.velocity, |predicted| {
                    refinement.note(predicted, tick, cache);
                });
            }
        }
        if let Some(finest) = finest {
            dial.set_finest(finest);
        }
    }

    /// Wants one block: the first splits of the sequence, or all that exceed a tolerance, as far as the cache
    /// holds them. What is there already stays until the block is done, so that nothing coarsens in between.
    fn want_globally(&mut self, lod: Option<u32>, tick: u64) {
        let Some(key) = self.global_key(lod) else {
            return;
        };
        let done = self.cache.regions.index(key).is_some_and(|index| {
            let region = self.cache.regions.at(index);
            region.wanted && region.refined
        });
        let wanted = Predicted {
            key,
            ticks: 0.0,
            refine: true,
        };
        self.refinement.note(wanted, tick, &mut self.cache);
        if !done && let Some(before) = self.global_before {
            if before != key && self.cache.regions.index(before).is_some() {
                let kept = Predicted {
                    key: before,
                    ..wanted
                };
                self.refinement.note(kept, tick, &mut self.cache);
            }
        } else if done {
            self.global_before = Some(key);
        }
    }

    /// The block that is wanted: what is asked for, cut to what the cache holds.
    fn global_key(&mut self, lod: Option<u32>) -> Option<RegionKey> {
        let model = self.model?;
        let dial = self.dial.as_mut()?;
        let (vsps, slots) = (model.header.vsps, self.cache.slots());
        let steps = self.refinement.economy.steps();
        if let Some(lod) = lod {
            // Each step that the room was too small for takes a quarter off.
            let count = f64::from(lod.min(vsps).min(slots)) * 0.75f64.powi(steps as i32);
            return Some(RegionKey::prefix(count as u32));
        }
        // More than n / 4^(level + 1) splits exceed a tolerance below the next rung: what surely does not fit
        // is not tried.
        let hopeless = |level: u32| vsps >> (2 * (level + 1)).min(31) > slots;
        let rings = dial.rings();
        let first = rings
            .iter()
            .position(|ring| !(hopeless(ring.level) || ring.tolerance == 0.0 && vsps > slots));
        dial.set_finest(first.unwrap_or(rings.len() - 1) + steps as usize);
        Some(RegionKey::new(RegionId::WHOLE, dial.finest_tolerance()))
    }

    /// The expected error of the front at a contact, model units: the tolerance of the finest region that holds
    /// it and is done; `None` where not even the coarsest is.
    pub(crate) fn tolerance_at(&self, contact: &Contact) -> Option<f32> {
        let dial = self.dial.as_ref()?;
        let is_done = |key: RegionKey| {
            let index = self.cache.regions.index(key)?;
            let region = self.cache.regions.at(index);
            (region.wanted && region.refined).then_some(())
        };
        dial.rings().iter().find_map(|ring| {
            let id = match self.refinement_plan {
                RefinementPlan::Local => ring.grid.region_of_point(contact.point),
                RefinementPlan::Global { .. } => RegionId::WHOLE,
            };
            is_done(RegionKey::new(id, ring.tolerance)).map(|()| ring.tolerance)
        })
    }

    /// Moves what the predictors will look at next onto the front as far as it is known, for the next tick; and looks what
    /// else of a tool may touch.
    pub(crate) fn look_ahead(&mut self) {
        let Some((model, frame)) = self.known() else {
            return;
        };
        let local = self.refinement_plan == RefinementPlan::Local;
        for touch in self.touches.iter_mut().filter(|touch| touch.is_followed) {
            let Some((middle, radius)) = touch.follower.patch() else {
                continue;
            };
            let (velocity, _) = touch.predictor.motion();
            let reach = radius + velocity.length() * RADII_AROUND * 60.0;
            let near = touch.clearance - model.radius_max <= reach;
            let surface = Surface {
                mesh: self.cache.mesh(),
                tree: self.cache.tree(),
            };
            if let (Some(goal), true) = (touch.goal, local) {
                let patch = touch.patch_m / frame.metres_per_unit;
                touch.beside.look(surface, &touch.follower, &goal, patch);
            }
            let landed = match touch.predictor.ahead(middle) {
                Some(ahead) if local && near && ahead.is_finite() => {
                    let hint = touch.hint.filter(|&face| surface.mesh.is_active(face));
                    closest_point(surface, ahead, hint)
                        .0
                        .map(|n| n.closest.point)
                }
                _ => None,
            };
            touch.predictor.land(landed);
        }
    }
}
