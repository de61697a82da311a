//! Objects that move: free, on a hinge, on a rail, or driven.
//!
//! A body is stepped once a tick, before anything looks where it is, with what its touches gave to the devices in the
//! tick before, turned round: device and body feel the same force over the same period, so that momentum is kept to the
//! last bit of a sum. The steps are semi-implicit and of a fixed number of operations: springs and dampings of the
//! body's own are solved for (any of them is stable), the touch is explicit (its limit is checked by
//! [`scene::min_coupled_mass`]), speeds are limited. A step gives a body no more energy than the force times
//! the way that it then goes: `m (v' - v) = F T` leaves `(v'² - v²) m / 2 = F v' T - F² T² / 2 m`.
//!
//! What is asleep is not looked at and keeps its bits. It wakes when it is touched, and sleeps when it has been still
//! for a while; what is still is measured by its size. Bodies do not touch each other.
//!
//! | file | does |
//! |---|---|
//! | `body` | one body: its pose, its sleep |
//! | `free`, `hinge`, `rail`, `driven` | the ways to move |
//! | `rest` | springs and dampings of a body's own, solved for |
//! | `extent` | size and inertia of a model's box |
//! | `material` | the motion of what lies at a place |
//! | `report` | what became of them |

mod body;
mod driven;
mod extent;
mod free;
mod hinge;
mod material;
mod rail;
mod report;
mod spring_damper;

pub use body::Body;
pub use extent::Extent;
pub use material::material_motion;
pub use report::MovedObject;

use crate::force::passivity::CarriedWork;
use geometry::{Pose, Wrench};
use glam::DVec3;
use scene::{MAX_ACTIVE_OBJECTS, MAX_PROBES, ScenePlan};
use spm::NONE;
use std::collections::VecDeque;

/// Periods that a step makes good at the most; what was missed beyond is lost to the bodies.
const MAX_PERIODS: u64 = 20;
/// Objects whose box is looked for in a tick at the most.
const MAX_EXTENTS_PER_TICK: usize = 64;

/// What a touch gave to a device in a tick.
#[derive(Debug, Clone, Copy)]
struct Push {
    body: usize,
    probe: usize,
    /// On the device, about `at`: all of it, and of it what the energy account limits.
    wrenches: [Wrench; 2],
    /// World, metres.
    at: DVec3,
}

/// The bodies of a scene. Nothing is allocated after [`Movables::new`].
#[derive(Debug, Clone)]
pub struct Movables {
    /// In the order of the scene.
    bodies: Vec<Body>,
    /// The object of each.
    objects: Vec<u32>,
    /// The body of each object, [`NONE`] for what stands; empty when all do.
    of_object: Vec<u32>,
    /// Those that are to be stepped.
    awake: Vec<usize>,
    /// Those whose pose, or whose motion, changed in this tick.
    moved: Vec<usize>,
    pushes: Vec<Push>,
    carried: [[f64; 2]; MAX_PROBES],
    last_tick: Option<u64>,
    /// Objects whose box is not known.
    unknown: VecDeque<u32>,
}

impl Movables {
    /// Where the scene puts them.
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
            pushes: Vec::with_capacity(pushes),
            carried: [[0.0; 2]; MAX_PROBES],
            last_tick: None,
            unknown: objects.iter().copied().collect(),
            bodies,
            objects,
            of_object,
            awake,
        }
    }

    /// Whether everything stands.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty()
    }

    /// The body of an object; `None` for what stands.
    #[must_use]
    pub fn body(&self, object: u32) -> Option<&Body> {
        let body = *self.of_object.get(object as usize)?;
        self.bodies.get(body as usize)
    }

    /// Objects that move, and their bodies.
    pub fn iter(&self) -> impl Iterator<Item = (u32, &Body)> {
        self.objects.iter().copied().zip(&self.bodies)
    }

    /// How many are awake.
    #[must_use]
    pub fn awake(&self) -> usize {
        self.awake.len()
    }

    /// Looks for the boxes of some objects that are not known yet; one that is can be pushed from then on.
    pub fn set_extent(&mut self, extent: impl Fn(u32) -> Option<Extent>) {
        for _ in 0..MAX_EXTENTS_PER_TICK.min(self.unknown.len()) {
            let Some(object) = self.unknown.pop_front() else {
                return;
            };
            let Some(extent) = extent(object) else {
                self.unknown.push_back(object);
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

    /// One tick: every body that is awake goes on under what pushed it in the tick before.
    pub fn step(&mut self, tick: u64) {
        let periods = self.last_tick.map_or(1, |last| tick.saturating_sub(last));
        self.last_tick = Some(tick);
        self.moved.clear();
        self.moved.extend_from_slice(&self.awake);
        for &k in &self.awake {
            self.bodies[k].step(tick, periods.clamp(1, MAX_PERIODS) as u32);
        }
        let bodies = &self.bodies;
        self.awake.retain(|&k| bodies[k].is_awake());
        for push in self.pushes.drain(..) {
            if let Some(sums) = self.carried.get_mut(push.probe) {
                for (sum, wrench) in sums.iter_mut().zip(&push.wrenches) {
                    *sum += self.bodies[push.body].work_of(wrench, push.at).total();
                }
            }
        }
    }

    /// Objects whose pose, or whose motion, has changed in the last step.
    pub fn moved(&self) -> impl Iterator<Item = (u32, &Body)> {
        self.moved
            .iter()
            .map(|&k| (self.objects[k], &self.bodies[k]))
    }

    /// Work of a probe's forces over the motion of the material since the last call, joules: of all of them, and of
    /// what the energy account limits.
    pub fn take_carried_work(&mut self, probe: usize) -> [f64; 2] {
        let sums = self.carried.get_mut(probe);
        sums.map(std::mem::take).unwrap_or_default()
    }

    /// The work that a wrench on a device at a place would do over the motion of the material in the coming period.
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

    /// An object gave this to a probe's device at a place (world, metres) in this tick: what the energy account limits,
    /// and the rest.
    pub fn push(&mut self, object: u32, probe: usize, [limited, rest]: [Wrench; 2], at: DVec3) {
        let Some(&body) = self.of_object.get(object as usize) else {
            return;
        };
        let k = body as usize;
        let Some(body) = self.bodies.get_mut(k) else {
            return;
        };
        let wrench = limited + rest;
        let was_awake = body.is_awake();
        body.push(&reaction(&wrench), at);
        if body.is_awake() && !was_awake {
            self.awake.push(k);
        }
        if self.pushes.len() < self.pushes.capacity() {
            self.pushes.push(Push {
                body: k,
                probe,
                wrenches: [wrench, limited],
                at,
            });
        }
    }

    /// Every number of the poses of what is awake, for a hash.
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

/// What acts on the body when this acts on the device.
fn reaction(wrench: &Wrench) -> Wrench {
    Wrench {
        force: -wrench.force,
        torque: -wrench.torque,
    }
}
