//! A touch: one probe and one object.

use crate::contact::motion::Twist;
use crate::contact::query::{Surface, Work};
use crate::contact::sphere_proxy::Contact;
use crate::force::effects::{Clock, ContactSample, Rendered, SurfaceEffects};
use crate::frame::ModelFrame;
use crate::lod::predict::{Motion, Predictor};
use crate::probe::Probe;
use crate::probe::forecast::ContactForecast;
use crate::probe::proxy_kind::{ProxyKind, ProxyStep};
use geometry::{Pose, Wrench};
use glam::DVec3;
use scene::{ProbeShape, SurfacePlan};
use spm::{Handle, NONE};

/// What a touch felt like in a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactState {
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
}

/// See the module.
#[derive(Debug)]
pub struct ProbeObjectPair {
    /// Radius of the ball, or of what a tool's tip touches at once, metres.
    pub patch_m: f64,
    /// Whether the probe is near enough to be followed.
    pub is_followed: bool,
    /// Tick when the probe was last in reach.
    pub near_at: u64,
    /// The probe in this tick, model frame and units.
    pub goal: Option<Pose>,
    pub follower: ProxyKind,
    pub predictor: Predictor,
    /// Where it may touch next, away from where it touches now.
    pub beside: ContactForecast,
    pub hint: Option<Handle>,
    /// Distance of the surface from the middle of the patch, model units.
    pub clearance: f64,
    /// The finest ring that is asked for around this probe.
    pub finest: usize,
    /// What it felt in the last tick; `None` in free space.
    pub felt: Option<ContactState>,
    /// What it renders in this tick, world: forces and torques about the probe's position, before account and gate.
    pub rendered: Option<Rendered>,
    /// The effects of the object's surface on this probe.
    pub effects: SurfaceEffects,
    /// Nearest point of the surface, model units.
    nearest: Option<DVec3>,
    /// Where the proxy begins, object's axes, metres, if that is not where the probe is.
    start: Option<Pose>,
}

impl ProbeObjectPair {
    /// `effects`: with room for the most that an object's surface has.
    pub fn new(shape: &ProbeShape, effects: SurfaceEffects) -> Self {
        Self {
            patch_m: shape.patch_m(),
            is_followed: false,
            near_at: 0,
            goal: None,
            follower: ProxyKind::new(shape),
            predictor: Predictor::new(),
            beside: ContactForecast::new(),
            hint: None,
            clearance: 0.0,
            finest: 0,
            felt: None,
            rendered: None,
            effects,
            nearest: None,
            start: None,
        }
    }

    /// Follows the probe from now on: its proxy is swept from `start` (object's axes, metres), where it is known to
    /// have been free, or else begins where the probe is.
    pub fn follow(&mut self, start: Option<Pose>) {
        self.is_followed = true;
        self.start = start;
        self.predictor.forget();
        self.beside = ContactForecast::new();
        self.follower.forget();
        self.hint = None;
        self.clearance = 0.0;
        self.finest = 0;
        self.felt = None;
        self.rendered = None;
        self.nearest = None;
    }

    /// Lets go of the probe.
    pub fn leave(&mut self) {
        self.is_followed = false;
        self.goal = None;
        self.follower.forget();
        self.felt = None;
        self.rendered = None;
        self.nearest = None;
    }

    /// Takes the pose of the probe in the world.
    pub fn aim(&mut self, frame: &ModelFrame, probe: Option<Pose>) {
        if !self.is_followed {
            return;
        }
        self.goal = probe.map(|pose| frame.pose_to_model(pose));
        if !self.follower.has_begun() {
            let start = self.start.take().map(|start| frame.object_to_model(start));
            self.follower
                .begin(self.patch_m, frame.metres_per_unit, start);
        }
    }

    /// What a prediction starts from; `None` without a probe.
    pub fn motion(&self, metres_per_unit: f64, radius_max: f64) -> Option<(DVec3, Motion)> {
        let device = self.goal?.position;
        let at_device = (device, self.patch_m / metres_per_unit);
        let (position, radius) = self.follower.patch().unwrap_or(at_device);
        let motion = Motion {
            position,
            radius,
            clearance: self.clearance - radius_max,
        };
        Some((device, motion))
    }

    /// Moves the proxy, in steps that cost no more than `most_work`, and measures the clearance.
    pub fn advance(&mut self, surface: Surface<'_>, most_work: u32) -> Option<ProxyStep> {
        let goal = self.goal?;
        let mut followed = self.follower.advance(surface, &goal, most_work);
        let hint = self.hint.filter(|&face| surface.mesh.is_active(face));
        let nearest = self.follower.nearest(surface, hint, &mut followed.work);
        if followed.contact.is_none() && self.follower.is_held() {
            followed.contact =
                nearest.map(|nearest| Contact::at(nearest.face, nearest.closest.point));
        }
        self.hint = nearest.map(|nearest| nearest.face);
        self.nearest = nearest.map(|nearest| nearest.closest.point);
        self.clearance = nearest.map_or(f64::INFINITY, |n| n.closest.distance_squared.sqrt());
        Some(followed)
    }

    /// The largest certified error of the faces that hold the probe, model units.
    pub fn certified(surface: Surface<'_>, contact: &Contact) -> f32 {
        let faces = contact.faces.iter().filter(|&&face| face != NONE);
        faces.fold(0.0f32, |most, &face| {
            most.max(surface.mesh.certified_error(face))
        })
    }

    /// Renders stiffness and damping of the surface where the probe touches, and what its effects make of them. Depth
    /// of the device behind the proxy, metres.
    pub fn render(
        &mut self,
        clock: Clock,
        (frame, before, plan): (&ModelFrame, Option<&Pose>, &SurfacePlan),
        surface: Surface<'_>,
        contact: &Contact,
        probe: &Probe,
        work: &mut Work,
    ) -> f64 {
        let Some(goal) = self.goal else {
            return 0.0;
        };
        let to_model = frame.pose.orientation.conjugate();
        let motion = probe.motion_along(before, &frame.pose);
        let velocity = Twist {
            linear: to_model * motion.linear / clock.period_s,
            angular: to_model * motion.angular / clock.period_s,
        };
        let scale = frame.metres_per_unit;
        let (depth, wrench, spring) = self.follower.render(&goal, scale, plan, &velocity);
        let mut rendered = Rendered::new(wrench, spring);
        if !self.effects.is_empty()
            && let Some(proxy) = self.follower.pose()
        {
            let sample = ContactSample {
                clock,
                surface,
                metres_per_unit: scale,
                origin: frame.origin * scale,
                to_world: frame.pose.orientation,
                point: contact.point * scale,
                middle: scale
                    * match self.follower {
                        ProxyKind::Ball(_) => proxy.position,
                        ProxyKind::Tool(_) => contact.point,
                    },
                proxy: Pose {
                    position: proxy.position * scale,
                    orientation: proxy.orientation,
                },
                arm: match self.follower {
                    ProxyKind::Ball(_) => DVec3::ZERO,
                    ProxyKind::Tool(_) => (contact.point - proxy.position) * scale,
                },
                device: goal.position * scale,
                velocity: velocity.linear,
                stiffness_n_per_m: plan.stiffness_n_per_m,
            };
            self.effects.render_contact(&sample, &mut rendered, work);
        }
        self.rendered = Some(rendered.turned(frame.pose.orientation));
        depth
    }

    /// Renders what the effects of the surface do where nothing is touched.
    pub fn render_near(&mut self, clock: Clock, frame: &ModelFrame) {
        if self.effects.is_empty() {
            return;
        }
        let (Some(nearest), Some((middle, radius))) = (self.nearest, self.follower.patch()) else {
            return;
        };
        let way = nearest - middle;
        let gap = (way.length() - radius) * frame.metres_per_unit;
        let force = self
            .effects
            .render_near(clock, gap, way.normalize_or_zero());
        if force != DVec3::ZERO {
            let pulls = Rendered {
                active: Wrench {
                    force,
                    torque: DVec3::ZERO,
                },
                ..Rendered::default()
            };
            self.rendered = Some(pulls.turned(frame.pose.orientation));
        }
    }
}
