//! The controller: the pure core of the haptic loop. Values in, values out; no clock, no I/O, no
//! allocation in a tick.

use crate::active::active_set::ActiveSet;
use crate::bodies::Movables;
use crate::governor::{Governor, MeasuredTick, WorkCosts};
use crate::horizons::Horizons;
use crate::lod::refine;
use crate::policy::Policy;
use crate::probe::Probe;
use crate::streaming::subscriber::Identity;
use crate::work::TickWork;
use haptic_device::{DegreesOfFreedom, MotionLimits};
use scene::{ProbePlan, ScenePlan};

/// The most that the device of a probe renders: above 0, and infinite where the scene's limit is to
/// count alone. Of both the least one counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WrenchLimits {
    /// Force, newtons.
    pub force_n: f64,
    /// Torque, newton metres.
    pub torque_nm: f64,
}

impl WrenchLimits {
    /// Those of the scene alone.
    pub const UNLIMITED: Self = Self {
        force_n: f64::INFINITY,
        torque_nm: f64::INFINITY,
    };

    /// No more force than this, newtons, above 0; as much torque as the scene allows.
    #[must_use]
    pub const fn of_force(force_n: f64) -> Self {
        Self {
            force_n,
            ..Self::UNLIMITED
        }
    }

    /// What both allow.
    #[must_use]
    pub fn within(self, other: Self) -> Self {
        Self {
            force_n: self.force_n.min(other.force_n),
            torque_nm: self.torque_nm.min(other.torque_nm),
        }
    }
}

/// What a controller is made for, beside its scene and its identity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControllerOptions<'a> {
    /// Limits of the device of each probe. A probe beyond the list has the least of it, so that one
    /// entry counts for all of them.
    pub limits: &'a [WrenchLimits],
    /// Length of the tours to ask for, seconds; 0 where the scene has none.
    pub tour_seconds: f64,
}

impl ControllerOptions<'_> {
    fn limits_of(&self, probe: usize) -> WrenchLimits {
        let weakest = || {
            let all = self.limits.iter().copied();
            all.fold(WrenchLimits::UNLIMITED, WrenchLimits::within)
        };
        self.limits.get(probe).copied().unwrap_or_else(weakest)
    }
}

/// State of the controller; see [`crate`] for its parts, and [`Controller::tick`] for its
/// algorithm.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct Controller {
    pub(crate) identity: Identity,
    pub(crate) operations: usize,
    pub(crate) period_s: f64,
    pub(crate) horizons: Horizons,
    pub(crate) work: TickWork,
    pub(crate) governor: Governor,
    pub(crate) policy: Policy,
    pub(crate) tolerance_m: f64,
    pub(crate) cache_bytes: usize,
    /// Bytes of the cache that may be in use now.
    pub(crate) cache_limit: usize,
    /// The most bytes that cache and base meshes took in a tick.
    pub(crate) most_bytes: u64,
    pub(crate) probes: Vec<Probe>,
    pub(crate) active: ActiveSet,
    pub(crate) movables: Movables,
    /// Index of the last tick.
    pub(crate) last_tick: Option<u64>,
    /// The same, but counting only ticks that were run: the time of the horizons of
    /// sessions and fronts.
    pub(crate) own_tick: u64,
    pub(crate) replay_hash: u64,
}

impl Controller {
    /// Everything sized from the plan; nothing is allocated after this.
    #[must_use]
    pub fn new(plan: &ScenePlan, identity: Identity, options: ControllerOptions<'_>) -> Self {
        // As each probe has it: with the limits of its device.
        let mut own = plan.clone();
        let new_probe = |(k, probe): (usize, &ProbePlan)| {
            let limits = options.limits_of(k);
            own.safety.torque_max_nm = plan.safety.torque_max_nm.min(limits.torque_nm);
            Probe::new(&own, probe, limits.force_n, options.tour_seconds)
        };
        let probes: Vec<Probe> = plan.probes.iter().enumerate().map(new_probe).collect();
        let movables = Movables::new(plan);
        let toured = probes.iter().filter_map(|probe| probe.tour.as_ref());
        let toured = toured.map(|tour| tour.object);
        Self {
            identity,
            operations: plan.loop_.operations,
            period_s: 1.0 / plan.loop_.rate_hz,
            horizons: Horizons::new(plan.loop_.rate_hz),
            work: TickWork::new(plan.loop_.rate_hz),
            governor: Governor::new(1.0 / plan.loop_.rate_hz, plan.loop_.operations),
            policy: Policy::new(plan.accuracy.policy, 1.0 / plan.loop_.rate_hz),
            tolerance_m: plan.accuracy.tolerance_m,
            cache_bytes: plan.cache_bytes,
            cache_limit: plan.cache_bytes,
            most_bytes: 0,
            active: ActiveSet::new(plan, identity, movables.iter().count(), toured),
            movables,
            probes,
            last_tick: None,
            own_tick: 0,
            replay_hash: 0,
        }
    }

    /// Says that the station is on another machine, before the first tick: until a round trip to it
    /// is measured, a question counts as lost after a second, and contacts are reported less often.
    /// Before, as for one on this machine, after [`protocol::ANSWER_TIMEOUT_MS`].
    pub fn station_is_far(&mut self) {
        self.horizons.report = self.horizons.far_report;
        self.active.meter.station_is_far();
    }

    /// Judges the samples of a probe by the limits of its device from now on; before, every pose
    /// whose numbers are usable is believed.
    pub fn set_motion_limits(&mut self, probe: usize, limits: MotionLimits) {
        if let Some(probe) = self.probes.get_mut(probe) {
            probe.set_motion_limits(limits);
        }
    }

    /// Says which directions the device of a probe renders; before, force and torque. What it does
    /// not render does no work in the probe's energy account.
    pub fn set_rendered(&mut self, probe: usize, rendered: DegreesOfFreedom) {
        if let Some(probe) = self.probes.get_mut(probe) {
            probe.renders_torque = rendered == DegreesOfFreedom::Six;
        }
    }

    /// Call before a tick when the devices went to zero by themselves since the last one, because
    /// their commands had expired, or when zero was written in place of its wrenches: the force
    /// rises again from zero along the ramp. An input of the tick as far as a replay is concerned.
    ///
    /// Where so many periods were skipped that a command of the last tick has expired in them
    /// ([`haptic_device::COMMAND_VALIDITY_S`]), the energy account books its work as long as it was
    /// valid; else the last wrench counts as none.
    pub fn force_was_cut(&mut self) {
        for probe in &mut self.probes {
            probe.force_was_cut();
        }
    }

    /// Keeps no points of the tours from now on, only their number: for a controller whose samples
    /// are recorded ones. Its ticks are the same, but [`Controller::tour_of`] gives no points. Not
    /// in a tick: it frees memory.
    pub fn drop_tour_points(&mut self) {
        for probe in &mut self.probes {
            if let Some(tour) = &mut probe.tour {
                tour.drop_points();
            }
        }
    }

    /// Counts with the costs of this machine, before the first tick; before, with those of the
    /// reference machine.
    pub fn set_costs(&mut self, costs: WorkCosts) {
        self.governor.set_costs(costs);
    }

    /// Call before a tick with what the last one took, if that is known: where it is longer than
    /// the costs say, or the devices leave less of a period, ticks do less. An input of the tick as
    /// far as a replay is concerned.
    pub fn note_work(&mut self, last: MeasuredTick) {
        self.governor.note_devices(f64::from(last.device_ns));
        self.governor.note_work(f64::from(last.work_ns));
    }

    /// Call before a tick: from it on so many bytes of the cache may be in use, of those of the
    /// start. What the contacts need stays as long as less will do; then it comes coarser. An input
    /// of the tick as far as a replay is concerned.
    pub fn set_cache_limit(&mut self, bytes: usize) {
        self.cache_limit = bytes.min(self.cache_bytes);
        self.active.set_cache_limit(self.cache_limit);
    }

    /// How much work the ticks may do, and why.
    #[must_use]
    pub fn governor(&self) -> &Governor {
        &self.governor
    }

    /// Work units that a tick may take at the most: the bound of
    /// [`crate::record::CoreRecord::work_units`].
    #[must_use]
    pub fn work_budget(&self) -> u32 {
        self.work.max_ingest(self.operations) + refine::max_work(self.operations, &self.work)
    }

    /// Units that all queries of a tick share, what [`crate::record::CoreRecord::query_work`] stays
    /// within: no step of a proxy and no search begins beyond its part.
    #[must_use]
    pub fn query_budget(&self) -> u32 {
        self.work.queries()
    }

    /// Whether every model is known that can be, so that any contact could be answered.
    pub(crate) fn is_ready(&self) -> bool {
        self.active.is_complete()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_probe_without_limits_of_its_own_has_the_least_of_the_others() {
        let limits = [(3.0, 0.2), (20.0, 0.1)];
        let limits = limits.map(|(force_n, torque_nm)| WrenchLimits { force_n, torque_nm });
        let of = |limits: &[WrenchLimits], probe: usize| {
            let options = ControllerOptions {
                limits,
                tour_seconds: 0.0,
            };
            options.limits_of(probe)
        };
        for (probe, own) in limits.iter().enumerate() {
            assert_eq!(of(&limits, probe), *own);
        }
        let least = WrenchLimits {
            force_n: 3.0,
            torque_nm: 0.1,
        };
        assert_eq!(of(&limits, 2), least);
        assert_eq!(of(&[], 0), WrenchLimits::UNLIMITED);
    }
}
