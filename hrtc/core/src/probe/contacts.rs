//! Contacts of an active object: a pair with each probe.

use super::Probe;
use super::pair::ProbeObjectPair;
use crate::budget::QueryBudget;
use crate::contact::query::Surface;
use crate::contact::rigid_proxy::Imperceptible;
use crate::contact::sphere_proxy::Contact;
use crate::force::effects::{Clock, SurfaceEffects};
use crate::force::passivity::EnergyAccount;
use crate::instance::{ModelFrame, ObjectInstance};
use crate::perception::{ContactConditions, OF_PROXY, PerceptionLimit, STEP_N_PER_S};
use glam::DVec3;
use scene::{EffectPlan, ProbePlan, ScenePlan};
use spm::{ActiveMesh, OperationFaces};
use std::sync::Arc;

/// Contact between the proxy of a probe and an object, before its accuracy is known.
#[derive(Debug, Clone, Copy)]
pub struct Touch {
    /// Contact, model units.
    pub contact: Contact,
    /// Certified error of the faces that hold the proxy, model units; 0 at full resolution.
    pub certified: f32,
    /// Depth of the device behind the proxy, metres.
    pub depth_m: f64,
}

/// Contacts of an active object.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct Contacts {
    /// One for each probe.
    pub pairs: Vec<ProbeObjectPair>,
    /// Perception limits of this tick, with the index of the probe: one for each part of a probe
    /// that may touch.
    pub limits: Vec<(usize, PerceptionLimit)>,
    /// Proxies of this tick whose budget left a part of their motion to the next one.
    pub unfinished: u32,
    /// Those of them that are balls.
    pub unfinished_balls: u32,
    /// Tools of this tick that left a part of their motion to the next one though the budget had
    /// room.
    pub early: u32,
    /// Contacts of tools in this tick that an earlier tick should have found.
    pub late_contacts: u32,
    /// Tools of this tick that are stuck.
    pub stuck: u32,
    /// Constraints of the proxies that did not fit, total.
    pub dropped_constraints: u64,
    period_s: f64,
    /// Whether perceptible splits and collapses are geomorphed.
    has_geomorphs: bool,
    /// Effects of each object's surface.
    effects: Arc<[Arc<[EffectPlan]>]>,
}

impl Contacts {
    /// No probe near; everything is allocated now. `effects`: those of each object's surface.
    #[must_use]
    pub fn new(plan: &ScenePlan, effects: Arc<[Arc<[EffectPlan]>]>) -> Self {
        let room = effects.iter().map(|of| of.len()).max().unwrap_or(0);
        let new_pair = |probe: &ProbePlan| {
            let account = EnergyAccount::new(probe.device.encoder_m, 1.0 / plan.loop_.rate_hz);
            let account = plan.safety.passivity.then_some(account);
            let effects = SurfaceEffects::with_room(room, account);
            ProbeObjectPair::new(&probe.shape, effects)
        };
        Self {
            pairs: plan.probes.iter().map(new_pair).collect(),
            limits: Vec::with_capacity(plan.probes.len() * crate::contact::rigid_proxy::MAX_BALLS),
            unfinished: 0,
            unfinished_balls: 0,
            early: 0,
            late_contacts: 0,
            stuck: 0,
            dropped_constraints: 0,
            period_s: 1.0 / plan.loop_.rate_hz,
            has_geomorphs: plan.accuracy.geomorph,
            effects,
        }
    }

    /// The object is assigned: no probe is near, and the effects are those of its surface.
    pub fn assign(&mut self, object: u32) {
        self.end();
        for pair in &mut self.pairs {
            pair.effects.assign(&self.effects[object as usize]);
        }
    }

    /// No probe is near any more.
    pub fn end(&mut self) {
        self.limits.clear();
        self.pairs.iter_mut().for_each(ProbeObjectPair::end);
    }

    /// A tick begins.
    pub fn begin_tick(&mut self) {
        self.unfinished = 0;
        self.unfinished_balls = 0;
        self.early = 0;
        self.late_contacts = 0;
        self.stuck = 0;
    }

    /// Whether a probe touches the object.
    #[must_use]
    pub fn any_contact(&self) -> bool {
        self.pairs.iter().any(|pair| pair.contact.is_some())
    }

    /// Takes the poses of the probes, and updates the perception limits.
    pub fn update(&mut self, frame: &ModelFrame, instance: &ObjectInstance, probes: &[Probe]) {
        for (pair, probe) in self.pairs.iter_mut().zip(probes) {
            pair.update(frame, probe.pose);
            pair.surface_moves = false;
        }
        self.limits.clear();
        if !self.has_geomorphs {
            return;
        }
        for (k, (pair, probe)) in self.pairs.iter_mut().zip(probes).enumerate() {
            let Some(goal) = pair.goal.filter(|_| pair.is_near) else {
                continue;
            };
            let mut conditions = ContactConditions {
                centre: goal.position,
                radius: 0.0,
                up: DVec3::ZERO,
                metres_per_unit: frame.metres_per_unit,
                stiffness_n_per_m: instance.surface.stiffness_n_per_m,
                is_contact: pair.contact.is_some(),
                force_n: 0.0,
                depth_m: 0.0,
                reserve_j: 0.0,
                period_s: self.period_s,
            };
            if let (Some(contact), Some(rendered)) = (&pair.contact, &pair.rendered) {
                conditions.force_n = rendered.passive.force.length();
                conditions.depth_m = contact.depth_m;
                conditions.reserve_j = probe.energy.reserve(rendered.spring);
            }
            let first = self.limits.len();
            for part in pair.proxy.parts(&goal) {
                (conditions.centre, conditions.radius, conditions.up) =
                    (part.centre, part.radius, part.centre - part.goal);
                self.limits.push((k, PerceptionLimit::new(&conditions)));
            }
            if let Some((_, limit)) = self.limits.get(first) {
                pair.proxy.limit_slide(limit.proxy_step());
            }
        }
    }

    /// Whether an operation within a box may be near a probe, `around` times the radius of its
    /// patch around it.
    #[must_use]
    pub fn may_reach(&self, probe: usize, space: [DVec3; 2], around: f64) -> bool {
        self.pairs[probe].proxy.may_reach(space, around)
    }

    /// Collects the limits of the probes that an operation within a box may reach.
    pub fn collect_reached(
        &self,
        reached: &mut Vec<(usize, PerceptionLimit)>,
        space: [DVec3; 2],
        around: f64,
    ) {
        reached.clear();
        for of_probe in self.limits.chunk_by(|(one, _), (other, _)| one == other) {
            let (probe, _) = of_probe[0];
            if self.may_reach(probe, space, around) {
                reached.extend_from_slice(of_probe);
            }
        }
    }

    /// Notes that the surface under a probe moves in this tick.
    pub fn note_surface_motion(&mut self, probe: usize) {
        self.pairs[probe].surface_moves = true;
    }

    /// Moves the proxies along with the split, collapse or geomorph that was just performed.
    pub fn carry(&mut self, mesh: &ActiveMesh, operation: &OperationFaces) {
        for pair in &mut self.pairs {
            pair.proxy.carry(mesh, operation);
        }
    }

    /// Advances the proxy of a probe, measures its clearance and renders the forces of the pair.
    /// `None` in free space.
    pub fn advance(
        &mut self,
        probe: (usize, &Probe),
        (frame, instance): (&ModelFrame, &ObjectInstance),
        surface: Surface<'_>,
        tick: u64,
        budget: &mut QueryBudget,
    ) -> Option<Touch> {
        let (k, probe) = probe;
        let clock = Clock {
            tick,
            period_s: self.period_s,
        };
        let pair = &mut self.pairs[k];
        pair.begin_tick();
        if !pair.is_near {
            return None;
        }
        let stiffness = instance.surface.stiffness_n_per_m;
        let step_n = OF_PROXY * STEP_N_PER_S * self.period_s;
        let imperceptible = Imperceptible {
            step: step_n / stiffness / frame.metres_per_unit,
            quantization: 0.5 * probe.energy.encoder_m() / frame.metres_per_unit,
            period_s: self.period_s,
        };
        pair.proxy.set_imperceptible(imperceptible);
        budget.begin_pair(k);
        let step = pair.advance(surface, budget)?;
        self.dropped_constraints += u64::from(step.dropped);
        self.unfinished += u32::from(step.unfinished);
        self.unfinished_balls += u32::from(step.unfinished && !pair.proxy.is_tool());
        self.early += u32::from(step.early);
        self.late_contacts += step.late_contacts;
        self.stuck += u32::from(step.stuck);
        let Some(contact) = step.contact else {
            pair.render_near(clock, frame, surface, budget);
            return None;
        };
        pair.note_contact_offset(frame.metres_per_unit);
        let certified = pair.certified(surface, &contact);
        let place = (frame, instance.before.as_ref(), &instance.surface);
        let depth_m = pair.render(clock, place, surface, &contact, probe, budget);
        Some(Touch {
            contact,
            certified,
            depth_m,
        })
    }
}
