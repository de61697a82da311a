//! One body: its kind of motion, its pose, its load, and its sleep.

use super::driven::Driven;
use super::extent::Extent;
use super::free::Free;
use super::hinge::Hinge;
use super::material::material_motion;
use super::rail::Rail;
use crate::force::passivity::CarriedWork;
use crate::tuning::bodies::{
    DISPLACEMENT_LEFT_PER_MS, MAX_SIZES_PER_PERIOD, MAX_STEP_PERIODS, MAX_TURN_PER_PERIOD, STILL_S,
    STILL_SIZES_PER_S,
};
use geometry::portable::pow;
use geometry::{Pose, Wrench};
use glam::DVec3;
use mutants::{Mutant, is};
use scene::MovablePlan;

/// Length of a step, and its speed limits.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Step {
    /// Seconds.
    pub period_s: f64,
    /// Largest speed, m/s.
    pub fastest: f64,
    /// Largest angular speed, rad/s.
    pub fastest_turn: f64,
    /// Share of the displacement bound that is left after a period.
    pub displacement_left: f64,
    /// Whether it is longer than a period.
    pub is_long: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
enum Kind {
    /// At rest until its box is known.
    Unknown,
    Free(Free),
    Hinge(Hinge),
    Rail(Rail),
    Driven(Driven),
}

/// A body of a scene.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Body {
    plan: MovablePlan,
    /// Pose in the scene.
    home: Pose,
    kind: Kind,
    step: Step,
    /// Most steps that make up for missed ticks.
    most_steps: u32,
    extent: Option<Extent>,
    pose: Pose,
    /// Pose before the last step; `None` if the step did not change it.
    before: Option<Pose>,
    /// Periods since that pose.
    since: u64,
    /// Sum of the wrenches since the last step, world, the torque about [`Body::centre`].
    load: Wrench,
    is_awake: bool,
    /// Time without load and motion, seconds.
    still_s: f64,
    /// Bound of the displacement of any point of the box in a period, metres.
    max_displacement: f64,
    awake_ticks: u64,
    /// Largest distance of the middle of the box from its place in the scene, metres.
    farthest: f64,
}

impl Body {
    /// A body at its pose in the scene. A driven body moves from the first tick on; any other rests
    /// until [`Self::set_extent`].
    #[must_use]
    pub fn new(plan: MovablePlan, home: Pose, period_s: f64) -> Self {
        let kind = match &plan {
            MovablePlan::Driven(driven) => Kind::Driven(Driven::new(driven, home)),
            _ => Kind::Unknown,
        };
        let is_awake = matches!(&kind, Kind::Driven(driven) if driven.moves());
        Self {
            plan,
            home,
            kind,
            step: Step {
                period_s,
                fastest: 0.0,
                fastest_turn: MAX_TURN_PER_PERIOD / period_s,
                displacement_left: pow(DISPLACEMENT_LEFT_PER_MS, 1e3 * period_s),
                is_long: false,
            },
            most_steps: MAX_STEP_PERIODS,
            extent: None,
            pose: home,
            before: None,
            since: 1,
            load: Wrench::ZERO,
            is_awake,
            still_s: 0.0,
            max_displacement: 0.0,
            awake_ticks: 0,
            farthest: 0.0,
        }
    }

    /// Sets its box, and with it its size and inertia. Later calls change nothing.
    pub fn set_extent(&mut self, extent: Extent) {
        if self.extent.is_some() {
            return;
        }
        self.extent = Some(extent);
        self.step.fastest = MAX_SIZES_PER_PERIOD * extent.size() / self.step.period_s;
        self.kind = match &self.plan {
            MovablePlan::Free(plan) => Kind::Free(Free::new(plan, self.home, &extent)),
            MovablePlan::Hinge(plan) => Kind::Hinge(Hinge::new(plan, self.home, &extent)),
            MovablePlan::Rail(plan) => Kind::Rail(Rail::new(plan, self.home)),
            MovablePlan::Driven(_) => self.kind,
        };
        let falls = |plan: &MovablePlan| {
            let mass = plan.mass();
            mass.is_some_and(|mass| mass.gravity_m_per_s2 != DVec3::ZERO)
        };
        self.is_awake |= falls(&self.plan);
    }

    /// Pose in this tick.
    #[must_use]
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// Pose in the scene.
    #[must_use]
    pub fn home(&self) -> Pose {
        self.home
    }

    /// Pose before the last step; `None` if the step did not change it.
    #[must_use]
    pub fn before(&self) -> Option<Pose> {
        self.before
    }

    /// Whether it takes steps.
    #[must_use]
    pub fn is_awake(&self) -> bool {
        self.is_awake
    }

    /// Periods since the pose of [`Body::before`].
    #[must_use]
    pub fn since(&self) -> u64 {
        self.since
    }

    /// Bound of the displacement of any point of its box in a period, metres.
    ///
    /// Of a driven body it follows from the largest speed. Of any other it is the largest recent
    /// displacement, which decays by 3 % a millisecond; after missed ticks at least what follows
    /// from its speed.
    #[must_use]
    pub fn max_displacement(&self) -> f64 {
        self.max_displacement
    }

    /// Number of steps so far.
    #[must_use]
    pub fn awake_ticks(&self) -> u64 {
        self.awake_ticks
    }

    /// Largest distance so far of the middle of its box from its place in the scene, metres.
    #[must_use]
    pub fn farthest(&self) -> f64 {
        self.farthest
    }

    /// Mean velocity of the middle of its box in the last step, m/s.
    #[must_use]
    pub fn velocity(&self) -> DVec3 {
        let went = |before: Pose| self.middle(&self.pose) - self.middle(&before);
        let seconds = self.since as f64 * self.step.period_s;
        self.before.map_or(DVec3::ZERO, went) / seconds
    }

    /// Kinetic energy, joules; 0 for a driven body.
    #[must_use]
    pub fn kinetic_j(&self) -> f64 {
        match &self.kind {
            Kind::Free(free) => free.kinetic_j(),
            Kind::Hinge(hinge) => hinge.kinetic_j(),
            Kind::Rail(rail) => rail.kinetic_j(),
            Kind::Driven(_) | Kind::Unknown => 0.0,
        }
    }

    /// Reference point of the torque of its load, world, metres.
    fn centre(&self) -> DVec3 {
        match &self.kind {
            Kind::Free(free) => free.middle,
            Kind::Hinge(hinge) => hinge.anchor,
            Kind::Rail(_) | Kind::Driven(_) | Kind::Unknown => self.pose.position,
        }
    }

    /// Middle of its box at a pose, world, metres.
    fn middle(&self, pose: &Pose) -> DVec3 {
        let middle = self.extent.map_or(DVec3::ZERO, |extent| extent.middle);
        pose.transform_point(middle)
    }

    /// Adds a wrench about a place (world, metres) to the load of the next step, and wakes it. A
    /// wrench that is not finite is ignored; so is any wrench on a driven body or one without a
    /// box.
    pub fn push(&mut self, wrench: &Wrench, at: DVec3) {
        if !wrench.is_finite() || matches!(self.kind, Kind::Driven(_) | Kind::Unknown) {
            return;
        }
        let arm = at - self.centre();
        self.load.force += wrench.force;
        self.load.torque += wrench.torque + arm.cross(wrench.force);
        self.is_awake = true;
        self.still_s = 0.0;
    }

    /// Makes up for missed ticks in so many steps at the most from now on, at least 1 and at most
    /// `MAX_STEP_PERIODS`.
    pub(super) fn set_most_steps(&mut self, steps: u32) {
        self.most_steps = steps.clamp(1, MAX_STEP_PERIODS);
    }

    /// Steps to `tick`, `periods` after the last step, in no more steps than were shared out to it,
    /// which are longer then. A pendulum has not swung on for longer than its steps allow. Returns
    /// how many it took.
    pub fn step(&mut self, tick: u64, periods: u32) -> u32 {
        let mut steps = periods.clamp(1, self.most_steps);
        let longest = match &self.kind {
            Kind::Hinge(hinge) => hinge.longest_step_s().max(self.step.period_s),
            _ => f64::INFINITY,
        };
        let period_s = self.step.period_s * (f64::from(periods) / f64::from(steps));
        let step = Step {
            period_s: period_s.min(longest),
            is_long: steps < periods,
            ..self.step
        };
        let load = std::mem::take(&mut self.load);
        let last = self.pose;
        match &mut self.kind {
            Kind::Unknown => steps = 0,
            Kind::Driven(driven) => {
                self.pose = driven.pose(tick as f64 * self.step.period_s);
                steps = 1;
            }
            kind => {
                for _ in 0..steps {
                    match kind {
                        Kind::Free(free) => free.step(&load, &step),
                        Kind::Hinge(hinge) => hinge.step(&load, &step),
                        Kind::Rail(rail) => rail.step(&load, &step),
                        Kind::Driven(_) | Kind::Unknown => {}
                    }
                }
                self.pose = match kind {
                    Kind::Free(free) => free.pose(),
                    Kind::Hinge(hinge) => hinge.pose(),
                    Kind::Rail(rail) => rail.pose(),
                    Kind::Driven(_) | Kind::Unknown => last,
                };
            }
        }
        self.before = (self.pose != last).then_some(last);
        self.since = u64::from(periods);
        self.awake_ticks += 1;
        self.note_displacement(&last);
        if !matches!(self.kind, Kind::Driven(_)) {
            self.sleep_if_still(periods, load == Wrench::ZERO);
        }
        steps
    }

    /// Goes on to `tick`, `periods` later, without a load: both steps are one to whoever looks.
    /// Returns how many it took.
    pub fn coast(&mut self, tick: u64, periods: u32) -> u32 {
        if !self.is_awake {
            return 0;
        }
        let (before, since, last) = (self.before, self.since, self.pose);
        let steps = self.step(tick, periods);
        // It is the same tick.
        self.awake_ticks -= 1;
        self.since += since;
        self.before = before.or((self.pose != last).then_some(last));
        // What has moved in this tick sleeps in a later one.
        self.is_awake |= self.before.is_some();
        steps
    }

    /// Updates the largest distance and the displacement bound.
    fn note_displacement(&mut self, last: &Pose) {
        let Some(extent) = self.extent else {
            return;
        };
        let middle = self.middle(&self.pose);
        let home = self.middle(&self.home);
        self.farthest = self.farthest.max(middle.distance(home));
        if let Kind::Driven(driven) = &self.kind {
            self.max_displacement = driven.fastest(home, extent.radius()) * self.step.period_s;
            return;
        }
        let motion = material_motion(last, &self.pose, middle);
        // Of a period, also where one step made up for many.
        let periods = self.since.max(1) as f64;
        let left = pow(self.step.displacement_left, periods) * self.max_displacement;
        let mean = motion.farthest(extent.radius()) / periods;
        // Over many it may have turned by more than half a turn, of which the rest is seen.
        let now = if self.since > 1 {
            self.displacement_ahead(extent.radius())
        } else {
            mean
        };
        self.max_displacement = mean.max(now).max(left);
    }

    /// Bound of the displacement of a point within `radius` (metres) of its middle in a period at
    /// its present speed, metres.
    fn displacement_ahead(&self, radius: f64) -> f64 {
        let [speed, turning] = match &self.kind {
            Kind::Free(free) => free.speeds(),
            Kind::Hinge(hinge) => hinge.speeds(),
            Kind::Rail(rail) => [rail.speed(), 0.0],
            Kind::Driven(_) | Kind::Unknown => [0.0; 2],
        };
        (speed + turning * radius) * self.step.period_s
    }

    /// Puts it to sleep when it has been without load and motion for long enough.
    fn sleep_if_still(&mut self, periods: u32, is_free: bool) {
        let Some(extent) = self.extent else {
            return;
        };
        let seconds = f64::from(periods) * self.step.period_s;
        let motion = self.before.map_or(0.0, |before| {
            let middle = self.middle(&self.pose);
            material_motion(&before, &self.pose, middle).farthest(extent.radius())
        });
        let is_still = is_free
            && !is(Mutant::Restless)
            && motion <= STILL_SIZES_PER_S * extent.size() * seconds;
        self.still_s = if is_still {
            self.still_s + seconds
        } else {
            0.0
        };
        if self.still_s < STILL_S {
            return;
        }
        match &mut self.kind {
            Kind::Free(free) => free.stop(),
            Kind::Hinge(hinge) => hinge.stop(),
            Kind::Rail(rail) => rail.stop(),
            Kind::Driven(_) | Kind::Unknown => {}
        }
        self.is_awake = false;
        self.before = None;
        self.max_displacement = 0.0;
    }

    /// Work of a wrench at a place (world, metres) over the motion of the material there in the
    /// last step.
    #[must_use]
    pub fn work_of(&self, wrench: &Wrench, at: DVec3) -> CarriedWork {
        let Some(before) = self.before else {
            return CarriedWork::default();
        };
        let motion = material_motion(&before, &self.pose, at);
        CarriedWork {
            pushed_j: wrench.force.dot(motion.linear),
            turned_j: wrench.torque.dot(motion.angular),
            most_j: wrench.force.length() * motion.linear.length()
                + wrench.torque.length() * motion.angular.length(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene::{FreePlan, HingePlan, MassPlan, RailPlan, SpringDamperPlan};

    const PERIOD_S: f64 = 1e-3;

    /// Without weight.
    const MASS: MassPlan = MassPlan {
        mass_kg: 0.1,
        inertia_kgm2: None,
        gravity_m_per_s2: DVec3::ZERO,
    };
    const LOOSE: SpringDamperPlan = SpringDamperPlan {
        spring: 0.0,
        damping: Some(0.0),
    };

    /// A cube of 0.1 m after a step of so many periods in which it was pushed at its middle.
    fn pushed_by(plan: MovablePlan, push: &Wrench, periods: u32) -> Body {
        let mut body = Body::new(plan, Pose::IDENTITY, PERIOD_S);
        body.set_extent(Extent {
            middle: DVec3::ZERO,
            sides: DVec3::splat(0.1),
        });
        body.push(push, DVec3::ZERO);
        body.step(u64::from(periods), periods);
        body
    }

    fn along(force: DVec3) -> Wrench {
        Wrench {
            force,
            torque: DVec3::ZERO,
        }
    }

    /// A body on a rail that was pushed by 1 N for a period.
    fn pushed(linear: SpringDamperPlan) -> Body {
        let plan = MovablePlan::Rail(RailPlan {
            mass: MASS,
            axis: DVec3::Z,
            linear,
            limits_m: None,
        });
        pushed_by(plan, &along(DVec3::Z), 1)
    }

    /// A drawer that is pushed to its stop in a stall, and rests there until the end of it.
    #[test]
    fn what_comes_to_rest_within_a_stall_has_moved_in_it() {
        let plan = MovablePlan::Rail(RailPlan {
            mass: MASS,
            axis: DVec3::Z,
            linear: LOOSE,
            limits_m: Some([0.0, 0.01]),
        });
        let mut body = pushed_by(plan, &along(DVec3::Z * 3.0), 30);
        body.coast(600, 570);
        assert_eq!(body.pose().position, DVec3::Z * 0.01);
        assert_eq!(body.before(), Some(Pose::IDENTITY));
        assert_eq!(body.since(), 600);
        body.step(601, 1);
        assert_eq!(body.before(), None);
        assert!(!body.is_awake());
    }

    /// A cube may turn by any angle in a stall, of which only the shorter way is seen.
    #[test]
    fn after_a_stall_of_any_length_no_corner_moves_beyond_the_bound() {
        let plan = MovablePlan::Free(FreePlan {
            mass: MASS,
            linear: LOOSE,
            angular: LOOSE,
        });
        let twist = Wrench {
            force: DVec3::ZERO,
            torque: DVec3::Z * 15.0,
        };
        for push in [along(DVec3::Z * 20.0), twist] {
            for periods in [1u32, 18, 40, 300, 1000] {
                let mut body = pushed_by(plan, &push, 1);
                let tick = 1 + u64::from(periods);
                body.coast(tick, periods);
                let (bound, before) = (body.max_displacement(), body.pose());
                body.step(tick + 1, 1);
                let corner = |pose: Pose| pose.transform_point(DVec3::splat(0.05));
                let went = corner(body.pose()).distance(corner(before));
                assert!(
                    went > 0.0 && went <= bound * (1.0 + 1e-9),
                    "{push:?}, {periods}: {went} m of {bound} m"
                );
            }
        }
    }

    /// Its weight is a torque that a step of a tenth of a second would not follow.
    #[test]
    fn a_lid_that_hangs_gains_no_energy_in_a_stall_of_any_length() {
        for side in [0.01, 0.03, 0.05, 0.3] {
            for periods in [18, 300, 1000, 2000, 5000, 60_000] {
                let plan = MovablePlan::Hinge(HingePlan {
                    mass: MassPlan {
                        gravity_m_per_s2: DVec3::Z * -9.81,
                        ..MASS
                    },
                    axis: DVec3::X,
                    anchor_m: DVec3::ZERO,
                    angular: LOOSE,
                    limits_rad: None,
                });
                let mut body = Body::new(plan, Pose::IDENTITY, PERIOD_S);
                body.set_extent(Extent {
                    middle: DVec3::Z * (-0.5 * side),
                    sides: DVec3::splat(side),
                });
                let push = Wrench {
                    force: DVec3::ZERO,
                    torque: DVec3::X * (20.0 * side * side),
                };
                body.push(&push, DVec3::ZERO);
                body.step(1, 1);
                let pushed_j = body.kinetic_j();
                assert!(pushed_j > 0.0);
                let mut tick = 1;
                for _ in 0..4 {
                    tick += u64::from(periods);
                    body.step(tick, periods);
                    // Symplectic Euler keeps an energy that is off by the step's share.
                    let joules = body.kinetic_j();
                    assert!(
                        joules < 2.0 * pushed_j,
                        "{side} m, {periods}: {joules} of {pushed_j} J"
                    );
                }
            }
        }
    }

    /// A long step may turn it by any angle.
    #[test]
    fn a_rod_that_tumbles_gains_no_energy_in_a_stall_of_any_length() {
        for (most_steps, periods) in [(1, 18), (1, 100), (1, 300), (20, 300), (20, 1000)] {
            let plan = MovablePlan::Free(FreePlan {
                mass: MASS,
                linear: LOOSE,
                angular: LOOSE,
            });
            let mut body = Body::new(plan, Pose::IDENTITY, PERIOD_S);
            body.set_extent(Extent {
                middle: DVec3::ZERO,
                sides: DVec3::new(0.1, 0.01, 0.01),
            });
            body.set_most_steps(most_steps);
            let push = Wrench {
                force: DVec3::ZERO,
                torque: DVec3::new(0.02, 0.3, 0.01),
            };
            body.push(&push, DVec3::ZERO);
            assert_eq!(body.step(1, 1), 1);
            let mut tick = 1;
            for _ in 0..4 {
                let before_j = body.kinetic_j();
                tick += u64::from(periods);
                assert_eq!(body.step(tick, periods), most_steps.min(periods));
                let joules = body.kinetic_j();
                assert!(
                    joules > 0.0 && joules <= (1.0 + 1e-9) * before_j,
                    "{most_steps} steps of {periods}: {joules} of {before_j} J"
                );
            }
        }
    }

    #[test]
    fn a_body_moves_through_a_stall_of_any_length() {
        let held = SpringDamperPlan {
            spring: 1.0,
            damping: None,
        };
        for (linear, within) in [(LOOSE, 1e-12), (held, 0.05)] {
            for periods in [1u32, 18, 300] {
                let mut smooth = pushed(linear);
                let mut stalled = pushed(linear);
                let start = smooth.pose().position.z;
                for tick in 0..periods {
                    smooth.step(u64::from(tick) + 2, 1);
                }
                stalled.coast(u64::from(periods) + 1, periods);
                let [a, b] = [&smooth, &stalled].map(|body| body.pose().position.z);
                let size = a.abs().max(start);
                assert!((a - b).abs() <= within * size, "{periods}: {a} m, {b} m");
                let mean = b / (f64::from(periods + 1) * PERIOD_S);
                assert!((stalled.velocity().z - mean).abs() < 1e-9, "{periods}");
            }
        }
    }
}
