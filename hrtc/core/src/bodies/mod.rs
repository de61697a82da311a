//! Movable objects: free, on a hinge, on a rail, or driven.
//!
//! A body is stepped once a tick, before any other stage reads its pose. Its load is the reaction
//! to the wrenches that its contacts gave to the devices in the last tick. Body and device get
//! opposite forces for the same period, so that momentum is conserved up to the rounding of a sum.
//!
//! A step is semi-implicit and takes a fixed number of operations:
//!
//! - The spring and damper of the body itself are implicit, so they are stable at any value.
//! - The contact force is explicit. [`scene::min_coupled_mass`] bounds the stiffness for which that
//!   is stable, when a scene is read.
//! - Linear and angular speed are limited.
//!
//! Missed ticks are made up for in as many steps as there were periods, up to a share of what a
//! tick has time for; then the steps are longer. That is stable for each kind of motion: without a
//! load, spring and damper only take energy; a pendulum's step is not longer than its weight allows
//! (`hinge`), and what a free body turns by gives it no energy (`free`).
//!
//! A force F adds no more kinetic energy than its work over the displacement `v' T` that follows:
//! `m (v' - v) = F T` implies `m (v'² - v²) / 2 = F v' T - F² T² / (2 m)`.
//!
//! A sleeping body is not stepped and keeps every bit of its pose. A contact wakes it. It sleeps
//! again after a time without load and motion; the threshold is relative to its size. Bodies do not
//! collide with each other.
//!
//! | module | content |
//! |---|---|
//! | `body` | one body: pose, load, sleep |
//! | `free`, `hinge`, `rail`, `driven` | the kinds of motion |
//! | `spring_damper` | implicit spring and damper of a coordinate |
//! | `extent` | size and inertia of a model's box |
//! | `material` | motion of the material at a place |
//! | `report` | final poses and statistics |

mod body;
mod driven;
mod extent;
mod free;
mod hinge;
mod material;
mod rail;
mod report;
mod spring_damper;

use crate::horizons::Horizons;
use crate::tuning::bodies::{MAX_EXTENTS_PER_TICK, MAX_STEP_PERIODS, STEPS_A_TICK};
pub use body::Body;
pub use extent::Extent;
pub use material::material_motion;
pub use report::MovedObject;

use crate::force::limiter::Passed;
use crate::force::passivity::CarriedWork;
use geometry::{Pose, Wrench};
use glam::DVec3;
use scene::{MAX_ACTIVE_OBJECTS, MAX_PROBES, ScenePlan};
use spm::NONE;
use std::collections::VecDeque;

/// The wrench that a contact gave to a device in a tick.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Push {
    /// Index into the bodies.
    body: usize,
    probe: usize,
    /// On the device, about `at`: the whole wrench, and the part that the energy account limits.
    wrenches: [Wrench; 2],
    /// Position of the device, world, metres.
    at: DVec3,
}

/// The bodies of a scene. It does not allocate after [`Movables::new`].
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Movables {
    /// In the order of the scene.
    bodies: Vec<Body>,
    /// Object of each body.
    objects: Vec<u32>,
    /// Body of each object, [`NONE`] for a fixed one; empty in a scene of fixed objects.
    of_object: Vec<u32>,
    /// Bodies to be stepped.
    awake: Vec<usize>,
    /// Bodies that the last step moved or stopped.
    moved: Vec<usize>,
    /// Steps that all bodies took in it.
    steps: usize,
    /// Wrenches of this tick; their work is known after the next step.
    #[serde(with = "spm::reserved")]
    pushes: Vec<Push>,
    /// Work of each probe's wrenches over the motion of the material since it was last taken,
    /// joules: the whole, and the limited part.
    carried: [[f64; 2]; MAX_PROBES],
    last_tick: Option<u64>,
    /// Periods for which a wrench on a device is valid.
    validity: u64,
    /// Objects whose box is not known yet.
    unknown: VecDeque<u32>,
    /// Models that were known when the look at these began, and how many of them were looked at
    /// since: the last ones.
    looked_at: (usize, usize),
}

impl Movables {
    /// Bodies at their poses in the scene.
    #[must_use]
    pub fn new(plan: &ScenePlan) -> Self {
        let period_s = 1.0 / plan.loop_.rate_hz;
        let mut of_object = Vec::new();
        let (mut bodies, mut objects) = (Vec::new(), Vec::new());
        for (k, object) in plan.objects.iter().enumerate() {
            let Some(movable) = object.movable else {
                continue;
            };
            if of_object.is_empty() {
                of_object = vec![NONE; plan.objects.len()];
            }
            of_object[k] = bodies.len() as u32;
            bodies.push(Body::new(movable, object.pose, period_s));
            objects.push(k as u32);
        }
        let mut awake = Vec::with_capacity(bodies.len());
        awake.extend((0..bodies.len()).filter(|&k| bodies[k].is_awake()));
        let pushes = if bodies.is_empty() {
            0
        } else {
            MAX_ACTIVE_OBJECTS * MAX_PROBES
        };
        Self {
            moved: Vec::with_capacity(bodies.len()),
            steps: 0,
            pushes: Vec::with_capacity(pushes),
            carried: [[0.0; 2]; MAX_PROBES],
            last_tick: None,
            validity: Horizons::new(plan.loop_.rate_hz).validity,
            unknown: objects.iter().copied().collect(),
            looked_at: (0, 0),
            bodies,
            objects,
            of_object,
            awake,
        }
    }

    /// Whether the scene has no movable object.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty()
    }

    /// Body of an object; `None` for a fixed one.
    #[must_use]
    pub fn body(&self, object: u32) -> Option<&Body> {
        let body = *self.of_object.get(object as usize)?;
        self.bodies.get(body as usize)
    }

    /// Movable objects and their bodies, in the order of the scene.
    pub fn iter(&self) -> impl Iterator<Item = (u32, &Body)> {
        self.objects.iter().copied().zip(&self.bodies)
    }

    /// Number of awake bodies.
    #[must_use]
    pub fn awake(&self) -> usize {
        self.awake.len()
    }

    /// Steps that all bodies took in this tick: one each, and more where ticks were missed.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Requests the boxes of up to 64 objects that have none yet; each once for every number of
    /// models that are `known`. `extent` returns `None` while a box is unknown. A body can be
    /// pushed once its box is known.
    pub fn set_extent(&mut self, known: usize, extent: impl Fn(u32) -> Option<Extent>) {
        if self.looked_at.0 != known {
            self.looked_at = (known, 0);
        }
        let left = self.unknown.len() - self.looked_at.1;
        for _ in 0..MAX_EXTENTS_PER_TICK.min(left) {
            let Some(object) = self.unknown.pop_front() else {
                return;
            };
            let Some(extent) = extent(object) else {
                self.unknown.push_back(object);
                self.looked_at.1 += 1;
                continue;
            };
            let k = self.of_object[object as usize] as usize;
            let was_awake = self.bodies[k].is_awake();
            self.bodies[k].set_extent(extent);
            if self.bodies[k].is_awake() && !was_awake {
                self.awake.push(k);
            }
        }
    }

    /// Steps every awake body to `tick` under the load of the last tick, and adds up the work of
    /// that load over the motion. It lasts through missed ticks as long as a wrench on a device
    /// does; then the bodies coast.
    pub fn step(&mut self, tick: u64) {
        let periods = self.last_tick.map_or(1, |last| tick.saturating_sub(last));
        let loaded = periods.clamp(1, self.validity);
        let rest = periods.saturating_sub(loaded);
        let [loaded, coasting] = [loaded, rest].map(|of| u32::try_from(of).unwrap_or(u32::MAX));
        self.last_tick = Some(tick);
        self.moved.clear();
        self.moved.extend_from_slice(&self.awake);
        if periods > 1 {
            self.share_out_steps();
        }
        let mut steps = 0;
        for &k in &self.awake {
            steps += self.bodies[k].step(tick.saturating_sub(rest), loaded);
        }
        self.add_carried_work();
        if rest > 0 {
            for &k in &self.awake {
                steps += self.bodies[k].coast(tick, coasting);
            }
        }
        self.steps = steps as usize;
        let bodies = &self.bodies;
        self.awake.retain(|&k| bodies[k].is_awake());
    }

    /// Shares out the steps that make up for missed ticks, before and after the load ends. A body
    /// that a hand pushes is stepped as finely as one alone.
    fn share_out_steps(&mut self) {
        let share = STEPS_A_TICK / 2 / self.awake.len().max(1);
        let share = share.clamp(1, MAX_STEP_PERIODS as usize) as u32;
        for &k in &self.awake {
            self.bodies[k].set_most_steps(share);
        }
        for push in &self.pushes {
            self.bodies[push.body].set_most_steps(MAX_STEP_PERIODS);
        }
    }

    /// Adds up the work of the last wrenches over the last step.
    fn add_carried_work(&mut self) {
        for push in self.pushes.drain(..) {
            if let Some(sums) = self.carried.get_mut(push.probe) {
                for (sum, wrench) in sums.iter_mut().zip(&push.wrenches) {
                    *sum += self.bodies[push.body].work_of(wrench, push.at).total();
                }
            }
        }
    }

    /// Objects that the last step moved or stopped, and their bodies.
    pub fn moved(&self) -> impl Iterator<Item = (u32, &Body)> {
        self.moved
            .iter()
            .map(|&k| (self.objects[k], &self.bodies[k]))
    }

    /// Work of a probe's wrenches over the motion of the material since the last call, joules: of
    /// the whole wrenches, and of the parts that the energy account limits.
    pub fn take_carried_work(&mut self, probe: usize) -> [f64; 2] {
        let sums = self.carried.get_mut(probe);
        sums.map(std::mem::take).unwrap_or_default()
    }

    /// Predicted work of a wrench on a device at a place (world, metres) over the motion of the
    /// material in the coming period. The reaction of the wrench is part of the prediction.
    #[must_use]
    pub fn work_ahead(&self, object: u32, wrench: &Wrench, at: DVec3) -> CarriedWork {
        let body = self.body(object);
        let tick = self.last_tick.unwrap_or(0) + 1;
        body.map_or(CarriedWork::default(), |body| {
            let mut next = body.clone();
            next.push(&reaction(wrench), at);
            next.step(tick, 1);
            next.work_of(wrench, at)
        })
    }

    /// Records the wrenches that an object gave in this tick to a probe's device at a place (world,
    /// metres), and loads its body with the reaction. `limited` passed the energy account, `rest`
    /// is the active wrench. A device that does not render torque gets no work from it.
    pub fn push(&mut self, object: u32, probe: usize, given: [(Wrench, Passed); 2], at: DVec3) {
        let Some(&body) = self.of_object.get(object as usize) else {
            return;
        };
        let k = body as usize;
        let Some(body) = self.bodies.get_mut(k) else {
            return;
        };
        // The body feels the force that was passed at its contact; the device may have less of its
        // torque, or none.
        let [limited, rest] = given.map(|(wrench, passed)| wrench * passed.force);
        let was_awake = body.is_awake();
        body.push(&reaction(&(limited + rest)), at);
        if body.is_awake() && !was_awake {
            self.awake.push(k);
        }
        let [limited, rest] = given.map(|(wrench, passed)| passed.scale(&wrench));
        if self.pushes.len() < self.pushes.capacity() {
            self.pushes.push(Push {
                body: k,
                probe,
                wrenches: [limited + rest, limited],
                at,
            });
        }
    }

    /// Position and quaternion (x, y, z, w) of every awake body, for a hash.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        self.awake.iter().flat_map(|&k| {
            let Pose {
                position,
                orientation,
            } = self.bodies[k].pose();
            let numbers = [position.x, position.y, position.z];
            numbers.into_iter().chain(orientation.to_array())
        })
    }
}

/// Wrench on the body from the wrench on the device.
fn reaction(wrench: &Wrench) -> Wrench {
    Wrench {
        force: -wrench.force,
        torque: -wrench.torque,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene::{MAX_MOVABLES, NoFiles, Overrides, parse};
    use std::cell::Cell;
    use std::path::Path;

    const ROD: Extent = Extent {
        middle: DVec3::ZERO,
        sides: DVec3::new(0.1, 0.01, 0.01),
    };
    const MASS_KG: f64 = 0.5;
    const FORCE_N: f64 = 20.0;

    /// As many free rods as may move, which nothing slows down; their boxes are not known.
    fn rods() -> Movables {
        let text = format!(
            r#"
[[object]]
generate = {{ shape = "plate", faces = 1000 }}
size_m = 0.1
grid = {{ counts = [8, 4, 4], spacing_m = 1.0 }}
movable = {{ free = {{ mass_kg = {MASS_KG}, damping_ns_per_m = 0.0, damping_nms_per_rad = 0.0 }} }}
[[probe]]
"#
        );
        let (folder, overrides) = (Path::new(""), Overrides::default());
        let plan = parse(&text, "rods", folder, &overrides, &NoFiles).unwrap();
        assert_eq!(plan.objects.len(), MAX_MOVABLES);
        Movables::new(&plan)
    }

    /// The same; the first ones are pushed, so that they fly off and tumble, and have taken a step.
    fn tumbling(pushed: u32) -> Movables {
        let mut movables = rods();
        while !movables.unknown.is_empty() {
            movables.set_extent(1, |_| Some(ROD));
        }
        for object in 0..pushed {
            push(&mut movables, object);
        }
        movables.step(1);
        assert_eq!(movables.steps(), pushed as usize);
        movables
    }

    /// A hand is pushed by an object.
    fn push(movables: &mut Movables, object: u32) {
        let at = movables.body(object).unwrap().pose().position;
        let wrench = Wrench {
            force: DVec3::X * -FORCE_N,
            torque: DVec3::new(0.1, 1.5, 0.05),
        };
        let whole = Passed::of(&wrench, &wrench);
        movables.push(object, 0, [(wrench, whole), (Wrench::ZERO, whole)], at);
    }

    fn joules(movables: &Movables) -> f64 {
        movables.iter().map(|(_, body)| body.kinetic_j()).sum()
    }

    #[test]
    fn an_unknown_box_is_requested_again_when_another_model_is_known() {
        let mut movables = rods();
        let requested = Cell::new(0);
        let request = |_| {
            requested.set(requested.get() + 1);
            None
        };
        for (known, due) in [(0, MAX_MOVABLES), (0, MAX_MOVABLES), (1, 2 * MAX_MOVABLES)] {
            for _ in 0..MAX_MOVABLES.div_ceil(MAX_EXTENTS_PER_TICK) + 1 {
                movables.set_extent(known, request);
            }
            assert_eq!(requested.get(), due, "{known} known");
        }
        // One that comes in the middle of a look begins it anew.
        movables.set_extent(2, request);
        for _ in 0..MAX_MOVABLES.div_ceil(MAX_EXTENTS_PER_TICK) {
            movables.set_extent(3, |_| Some(ROD));
        }
        assert!(movables.unknown.is_empty());
    }

    #[test]
    fn many_bodies_share_the_steps_after_a_stall_and_gain_no_energy() {
        let mut movables = tumbling(MAX_MOVABLES as u32);
        let place = |movables: &Movables| movables.body(7).unwrap().pose().position;
        let (joules_before, from) = (joules(&movables), place(&movables));
        movables.step(301);
        assert_eq!(movables.steps(), STEPS_A_TICK);
        let after = joules(&movables);
        assert!(
            after <= (1.0 + 1e-9) * joules_before,
            "{joules_before} J, then {after} J"
        );
        let due = FORCE_N * 1e-3 / MASS_KG * 0.3;
        let went = (place(&movables) - from).x;
        assert!((went / due - 1.0).abs() < 1e-9, "{went} m of {due} m");
        // What is pushed keeps its steps, under the load and after it.
        for object in 0..3 {
            push(&mut movables, object);
        }
        movables.step(601);
        let own = 3 * 2 * (MAX_STEP_PERIODS as usize - 1);
        assert_eq!(movables.steps(), STEPS_A_TICK + own);
        movables.step(602);
        assert_eq!(movables.steps(), MAX_MOVABLES);
    }

    #[test]
    fn few_bodies_take_all_steps_after_a_stall() {
        let mut movables = tumbling(6);
        movables.step(301);
        assert_eq!(movables.steps(), 6 * 2 * MAX_STEP_PERIODS as usize);
    }

    #[test]
    fn a_stall_is_one_tick_to_whoever_looks_at_a_body() {
        let mut movables = tumbling(3);
        let mut tick = 1;
        for (ticks, periods) in (2..).zip([1, 18, 40, 300, 1000]) {
            let last = movables.body(0).unwrap().pose();
            tick += periods;
            movables.step(tick);
            let body = movables.body(0).unwrap();
            assert_ne!(body.pose(), last, "{periods}");
            assert_eq!(body.before(), Some(last), "{periods}");
            assert_eq!(body.since(), periods);
            assert_eq!(body.awake_ticks(), ticks, "{periods}");
        }
    }
}
