//! Prediction of the regions that the probes will need: rings around the contact, or blocks of the
//! whole model.

use super::cells::Motion;
use super::front::{Front, FrontModel};
use super::predict::{Predicted, predict_forecast};
use super::predictions::Unknown;
use crate::budget::QueryBudget;
use crate::cache::{Cache, RegionKey};
use crate::contact::query::closest_point_within;
use crate::contact::sphere_proxy::MAX_PUSHING;
use crate::costs::QueryWork;
use crate::policy::Detail;
use crate::probe::contacts::Contacts;
use crate::probe::pair::ProbeObjectPair;
use crate::tuning::memory_pressure::STEPS_BEFORE_COARSER;
use crate::tuning::prediction::{BLOCK_SHARE, MAX_WAITING, RADII_AROUND};
use geometry::closest_point_on_triangle;
use glam::DVec3;
use scene::RefinementPlan;
use spm::{ActiveMesh, NONE, RegionId};

impl Front {
    /// Predicts the regions that the probes will need, and marks those that are known. `lead`: by
    /// how many ticks the link is farther than a local one; `between`: ticks between two requests.
    pub fn predict(&mut self, tick: u64, (lead, between): (f64, u64), contacts: &Contacts) {
        self.predictions.keep_latest(tick, between);
        self.pressure.recover(tick);
        if self.model.is_none() {
            return;
        }
        match self.plan {
            RefinementPlan::Local => self.predict_rings(tick, lead, contacts),
            RefinementPlan::Global { lod } => {
                if contacts.pairs.iter().any(|pair| pair.goal.is_some()) {
                    self.predict_block(lod, tick);
                }
            }
        }
    }

    /// Whether regions may be requested in this tick.
    #[must_use]
    pub fn may_request(&self, tick: u64) -> bool {
        self.pressure.may_ask(tick)
    }

    /// Predicted regions that are to be requested, most urgent first; they are put in order when
    /// they are asked for. `waiting`: received chunks that wait for the tick. The cache is given
    /// back, since the subscriber enters them.
    pub fn requests(
        &mut self,
        may_request: bool,
        waiting: usize,
    ) -> (&mut Cache, impl Iterator<Item = Unknown>) {
        // Answers come in the order of the requests: what is only ahead must not delay what is
        // needed next.
        let may_prefetch =
            self.pressure.may_prefetch() && self.time_steps == 0 && waiting < MAX_WAITING;
        let unknown = self.predictions.unknown(may_request);
        // None that is needed comes after one that is only ahead.
        let wanted = unknown.take_while(move |of| of.is_needed || may_prefetch);
        (&mut self.cache, wanted)
    }

    /// For each probe sets the finest ring by time and by memory pressure, then notes the
    /// regions of its rings. The finest of all is that of the object: what one probe needs is not
    /// too fine for the others.
    fn predict_rings(&mut self, tick: u64, lead: f64, contacts: &Contacts) {
        let Self {
            model:
                Some(FrontModel {
                    model,
                    metres_per_unit,
                    lod,
                }),
            predictions,
            cache,
            approaches,
            pressure,
            time_steps,
            horizons,
            ..
        } = self
        else {
            return;
        };
        let (operations, detail) = (self.operations, self.detail);
        let rings = pressure.has_rings() && *time_steps < STEPS_BEFORE_COARSER;
        let for_time = time_steps.saturating_sub(STEPS_BEFORE_COARSER) as usize;
        let raised = pressure.raised().max(for_time);
        let mut finest = None;
        let pairs = contacts.pairs.iter().zip(approaches);
        for (pair, approach) in pairs.filter(|(pair, _)| pair.is_near) {
            let Some((device, (position, radius))) = pair.patch(*metres_per_unit) else {
                continue;
            };
            let motion = Motion {
                position,
                radius,
                clearance: pair.clearance - model.radius_max,
            };
            let speed = approach.predictor.mean_speed();
            let reach = RADII_AROUND * motion.radius + speed * horizons.prediction.lead;
            lod.set_finest(approach.finest);
            let by_time = match detail {
                Detail::Fitting => lod.finest_at_speed(speed, reach, operations),
                Detail::Splits(share) => lod.finest_of_splits(share),
            };
            lod.set_finest(by_time.max(raised));
            approach.finest = lod.finest();
            finest =
                Some(finest.map_or(approach.finest, |least: usize| least.min(approach.finest)));
            let predictor = &mut approach.predictor;
            predictor.set_lead(lead);
            predictor.set_touched(touched_by_ball(pair, cache.mesh(), position));
            predictor.predict(lod, rings, device, motion, |predicted| {
                predictions.note(predicted, tick, cache);
            });
            for near in approach.forecast.found() {
                let rings = rings && near.is_coarse;
                let motion = (near.place, near.velocity);
                predict_forecast(lod, rings, motion, &horizons.prediction, |predicted| {
                    predictions.note(predicted, tick, cache);
                });
            }
        }
        if let Some(finest) = finest {
            lod.set_finest(finest);
        }
    }

    /// Names one block: the first splits of the sequence, or all that exceed a tolerance, as far as
    /// the cache holds them. The block before stays until this one is done, so that nothing
    /// coarsens in between; but not while more of the cache is in use than may be: until it goes
    /// this one finds no room.
    fn predict_block(&mut self, lod: Option<u32>, tick: u64) {
        let Some(key) = self.block_key(lod) else {
            return;
        };
        let is_done = self.is_done(key);
        let wanted = Predicted {
            key,
            ticks: 0.0,
            leaves: f64::INFINITY,
            refine: true,
        };
        self.predictions.note(wanted, tick, &mut self.cache);
        if is_done {
            self.last_block = Some(key);
        } else if let Some(before) = self.last_block
            && before != key
            && self.cache.regions.index(before).is_some()
            && !self.cache.is_over_limit()
        {
            let kept = Predicted {
                key: before,
                ..wanted
            };
            self.predictions.note(kept, tick, &mut self.cache);
        }
    }

    /// The block that is wanted: what is asked for, cut to the capacity of the cache.
    fn block_key(&mut self, lod: Option<u32>) -> Option<RegionKey> {
        let FrontModel {
            model, lod: rings, ..
        } = self.model.as_mut()?;
        let (vsps, slots) = (model.header.vsps, self.cache.slots());
        let steps = self.pressure.steps();
        if let Some(count) = lod {
            let count = f64::from(count.min(vsps).min(slots)) * BLOCK_SHARE.powi(steps as i32);
            return Some(RegionKey::prefix(count as u32));
        }
        // More than n / 4^(level + 1) splits exceed a tolerance below the next tolerance level: a
        // block that surely does not fit is not tried.
        let is_hopeless = |level: u32| vsps >> (2 * (level + 1)).min(31) > slots;
        let first = rings
            .rings()
            .iter()
            .position(|ring| !(is_hopeless(ring.level) || ring.tolerance == 0.0 && vsps > slots));
        let coarsest = rings.rings().len() - 1;
        rings.set_finest(first.unwrap_or(coarsest) + steps as usize);
        Some(RegionKey::new(RegionId::WHOLE, rings.finest_tolerance()))
    }

    /// Looks where other parts of a tool may touch next, and moves the probe's prediction onto the
    /// front as far as the front is known, for the next tick.
    pub fn look_ahead(&mut self, probe: usize, contacts: &Contacts, budget: &mut QueryBudget) {
        let Self {
            model:
                Some(FrontModel {
                    model,
                    metres_per_unit,
                    ..
                }),
            cache,
            approaches,
            plan,
            horizons,
            ..
        } = self
        else {
            return;
        };
        let is_local = *plan == RefinementPlan::Local;
        let surface = crate::contact::query::Surface {
            mesh: cache.mesh(),
            tree: cache.tree(),
        };
        let (pair, approach) = (&contacts.pairs[probe], &mut approaches[probe]);
        let Some((middle, radius)) = pair.proxy.patch() else {
            return;
        };
        let (velocity, _) = approach.predictor.motion();
        let landing = horizons.prediction.landing + approach.predictor.lead();
        let reach = radius + velocity.length() * RADII_AROUND * landing;
        let is_close = pair.clearance - model.radius_max <= reach;
        if let (Some(goal), true) = (pair.goal, is_local) {
            let patch = pair.patch_m / *metres_per_unit;
            let part = (&pair.proxy, &goal, patch);
            approach.forecast.look(surface, part, budget);
        }
        let mut project = |ahead: DVec3| {
            let most = budget.for_look_ahead();
            if !(is_local && is_close && ahead.is_finite()) || most == 0 {
                return None;
            }
            let hint = pair.hint.filter(|&face| surface.mesh.is_active(face));
            let (nearest, work, is_complete) = closest_point_within(surface, ahead, hint, most);
            budget.charge(QueryWork::Search, work);
            nearest.filter(|_| is_complete).map(|n| n.closest.point)
        };
        let ahead = approach.predictor.ahead(middle);
        let landed = ahead.map(|point| point.and_then(&mut project));
        approach.predictor.project_onto_front(landed);
    }
}

/// Places of the surface that hold a ball whose middle is here, or the one nearest to it, as far as
/// their faces are still there; none of a tool, whose patch is where it touches.
fn touched_by_ball(
    pair: &ProbeObjectPair,
    mesh: &ActiveMesh,
    middle: DVec3,
) -> [Option<DVec3>; MAX_PUSHING] {
    let mut places = [None; MAX_PUSHING];
    if pair.proxy.is_tool() {
        return places;
    }
    let mut nearest = [NONE; MAX_PUSHING];
    nearest[0] = pair.hint.unwrap_or(NONE);
    let holding = pair.contact.map(|of| of.contact.faces);
    let faces = holding.unwrap_or(nearest).into_iter();
    let active = faces.filter(|&face| face != NONE && mesh.is_active(face));
    for (place, face) in places.iter_mut().zip(active) {
        let closest = closest_point_on_triangle(mesh.corners(face), middle);
        *place = Some(closest.point);
    }
    places
}
