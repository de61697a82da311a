//! A touch: one probe and one object.

use super::ModelFrame;
use crate::energy::Spring;
use crate::predict::{Motion, Predictor};
use crate::proxy::{Contact, Proxy};
use crate::query::{Surface, Work};
use glam::DVec3;
use shared::geometry::{Pose, Wrench};
use shared::scene::SurfacePlan;
use shared::spm::{Handle, NONE};

/// What a touch felt like in a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Felt {
    /// What holds the probe, model units.
    pub contact: Contact,
    /// Certified error of the faces that hold it, model units; 0 at full resolution.
    pub certified: f32,
    /// Expected error of the front there, metres; negative where not even the coarsest ring is done.
    pub tolerance_m: f64,
    /// Whether the contact is as accurate as was asked for.
    pub asked: bool,
    /// Depth of the device behind the proxy, metres.
    pub depth_m: f64,
    /// Force on the probe, newtons, before the gate.
    pub wrench: Wrench,
    /// What holds the device to the proxy.
    pub spring: Spring,
}

/// See the module.
#[derive(Debug)]
pub struct Touch {
    /// Radius of the probe, metres.
    pub radius_m: f64,
    /// Whether the probe is near enough to be followed.
    pub is_followed: bool,
    /// Tick when the probe was last in reach.
    pub near_at: u64,
    /// The probe in this tick, model frame and units.
    pub goal: Option<Pose>,
    pub proxy: Option<Proxy>,
    pub predictor: Predictor,
    pub hint: Option<Handle>,
    /// Distance of the surface from the centre of the proxy, model units.
    pub clearance: f64,
    /// The finest ring that is asked for around this probe.
    pub finest: usize,
    /// What it felt in the last tick; `None` in free space.
    pub felt: Option<Felt>,
    /// Where the proxy begins, world, metres, if that is not where the probe is.
    start: Option<DVec3>,
}

impl Touch {
    pub fn new(radius_m: f64) -> Self {
        Self {
            radius_m,
            is_followed: false,
            near_at: 0,
            goal: None,
            proxy: None,
            predictor: Predictor::new(),
            hint: None,
            clearance: 0.0,
            finest: 0,
            felt: None,
            start: None,
        }
    }

    /// Follows the probe from now on: its proxy is swept from `start` (world, metres), where it is known to have
    /// been free, or else begins where the probe is.
    pub fn follow(&mut self, start: Option<DVec3>) {
        self.is_followed = true;
        self.start = start;
        self.predictor.forget();
        self.proxy = None;
        self.hint = None;
        self.clearance = 0.0;
        self.finest = 0;
        self.felt = None;
    }

    /// Lets go of the probe.
    pub fn leave(&mut self) {
        self.is_followed = false;
        self.goal = None;
        self.proxy = None;
        self.felt = None;
    }

    /// Takes the pose of the probe in the world.
    pub fn aim(&mut self, frame: &ModelFrame, probe: Option<Pose>) {
        if !self.is_followed {
            return;
        }
        self.goal = probe.map(|pose| frame.pose_to_model(pose));
        if self.proxy.is_none() {
            let mut proxy = Proxy::new(self.radius_m / frame.metres_per_unit);
            if let Some(start) = self.start.take() {
                proxy.place(frame.to_model(start));
            }
            self.proxy = Some(proxy);
        }
    }

    /// What a prediction starts from; `None` without a probe.
    pub fn motion(&self, metres_per_unit: f64, radius_max: f64) -> Option<(DVec3, Motion)> {
        let device = self.goal?.position;
        let proxy = self.proxy.as_ref().filter(|proxy| proxy.is_placed());
        let motion = Motion {
            position: proxy.map_or(device, Proxy::position),
            radius: self.radius_m / metres_per_unit,
            clearance: self.clearance - radius_max,
        };
        Some((device, motion))
    }

    /// Moves the proxy, in steps that cost no more than `most_work`, and measures the clearance; the contact, what it
    /// cost, and the constraints that did not fit.
    pub fn advance(
        &mut self,
        surface: Surface<'_>,
        most_work: u32,
    ) -> (Option<Contact>, Work, u32) {
        let mut work = Work::default();
        let (Some(goal), Some(proxy)) = (self.goal, &mut self.proxy) else {
            return (None, work, 0);
        };
        let advance = proxy.advance(surface, goal.position, most_work);
        work.add(advance.work);
        let hint = self.hint.filter(|&face| surface.mesh.is_active(face));
        let nearest = proxy.nearest(surface, hint, &mut work);
        self.hint = nearest.map(|nearest| nearest.face);
        self.clearance = nearest.map_or(f64::INFINITY, |n| n.closest.distance_squared.sqrt());
        (advance.contact, work, advance.dropped)
    }

    /// The largest certified error of the faces that hold the probe, model units.
    pub fn certified(surface: Surface<'_>, contact: &Contact) -> f32 {
        let faces = contact.faces.iter().filter(|&&face| face != NONE);
        faces.fold(0.0f32, |most, &face| {
            most.max(surface.mesh.certified_error(face))
        })
    }

    /// Stiffness and damping of the surface: depth of the device behind the proxy, metres, the force on it, and the
    /// spring that it comes from.
    ///
    /// `velocity`: of the probe, m/s.
    pub fn render(
        &self,
        frame: &ModelFrame,
        surface: &SurfacePlan,
        velocity: DVec3,
    ) -> (f64, Wrench, Spring) {
        let mut wrench = Wrench::ZERO;
        let (Some(goal), Some(proxy)) = (self.goal, &self.proxy) else {
            return (0.0, wrench, Spring::default());
        };
        let out = frame.vector_to_world(proxy.position() - goal.position);
        let depth = out.length();
        if depth > 0.0 {
            let normal = out / depth;
            let spring = surface.stiffness_n_per_m * depth;
            let damper = -surface.damping_ns_per_m * velocity.dot(normal);
            // Damping never pulls: a wall does not stick.
            wrench.force = normal * (spring + damper).max(0.0);
        }
        let spring = Spring {
            stiffness_n_per_m: surface.stiffness_n_per_m,
            stored_j: 0.5 * surface.stiffness_n_per_m * depth * depth,
        };
        (depth, wrench, spring)
    }
}
