//! A probe-object pair: proxy, contact state and forces.

use crate::budget::QueryBudget;
use crate::contact::motion::Twist;
use crate::contact::query::{Nearest, Surface, Work, closest_point_within};
use crate::contact::rigid_proxy::{NearestPair, ToolProxy};
use crate::contact::sphere_proxy::Contact;
use crate::costs::QueryWork;
use crate::force::effects::free_space::Gap;
use crate::force::effects::{Clock, ContactSample, Rendered, SurfaceEffects};
use crate::force::paid_coupling::PaidCoupling;
use crate::force::passivity::CouplingSpring;
use crate::instance::ModelFrame;
use crate::probe::Probe;
use crate::probe::proxy_kind::{ProxyKind, ProxyStep};
use geometry::{Pose, Wrench};
use glam::DVec3;
use mutants::{Mutant, is};
use scene::{ProbeShape, SurfacePlan};
use spm::{Handle, NONE};

/// Nodes and faces that a search for a place beside the proxy may visit.
const OUTSIDE_WORK: u32 = 128;
/// Rounding of a distance: a ball at rest on a surface is nearer by it than its radius.
const ROUNDING: f64 = 1e-6;

/// Contact state of a pair in a tick.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ContactState {
    /// Contact of the proxy, model units.
    pub contact: Contact,
    /// Certified error of the faces that hold it, model units; 0 at full resolution, not a number
    /// without a bound.
    pub certified: f32,
    /// Expected error of the front there, metres; negative where not even the coarsest ring is
    /// done.
    pub tolerance_m: f64,
    /// Whether the contact is as accurate as was asked for.
    pub is_as_asked: bool,
    /// Depth of the device behind the proxy, metres.
    pub depth_m: f64,
    /// Share of the force that is paid for, 0 to 1.
    pub paid: f64,
}

/// One probe and one object.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct ProbeObjectPair {
    /// Radius of the ball, or of what a tool's tip touches at once, metres.
    pub patch_m: f64,
    /// Whether the probe is near, so that its proxy is stepped.
    pub is_near: bool,
    /// Tick when the probe was last in reach.
    pub near_at: u64,
    /// The probe in this tick, model frame and units.
    pub goal: Option<Pose>,
    pub proxy: ProxyKind,
    /// The face nearest to the middle of the patch in the last tick.
    pub hint: Option<Handle>,
    /// Distance of the surface from the middle of the patch, model units.
    pub clearance: f64,
    /// Contact state of the last step; `None` in free space.
    pub contact: Option<ContactState>,
    /// Forces of this tick, world: forces and torques about the probe's position, before account
    /// and force limiter.
    pub rendered: Option<Rendered>,
    /// The effects of the object's surface on this probe.
    pub effects: SurfaceEffects,
    /// Nearest point of the surface, model units.
    nearest: Option<DVec3>,
    /// Where surface and tool were nearest to each other, and the tool's pose then, if that was
    /// looked for last.
    nearest_pair: Option<(NearestPair, Pose)>,
    /// Position of the proxy when the clearance was measured.
    measured_at: Option<DVec3>,
    /// Where the proxy begins, object's axes, metres, if that is not where the probe is.
    start: Option<Pose>,
    /// What of the coupling is paid for; model axes.
    coupling: PaidCoupling,
    /// Whether the surface moves under the probe in this tick, by a geomorph.
    pub surface_moves: bool,
    /// Largest distance from a surface at rest at which contacts of its tool acted, metres.
    pub contact_offset_m: f64,
}

impl ProbeObjectPair {
    /// `effects`: with room for the most that an object's surface has.
    pub fn new(shape: &ProbeShape, effects: SurfaceEffects) -> Self {
        Self {
            patch_m: shape.patch_m(),
            is_near: false,
            near_at: 0,
            goal: None,
            proxy: ProxyKind::new(shape),
            hint: None,
            clearance: 0.0,
            contact: None,
            rendered: None,
            effects,
            nearest: None,
            nearest_pair: None,
            measured_at: None,
            start: None,
            coupling: PaidCoupling::default(),
            surface_moves: false,
            contact_offset_m: 0.0,
        }
    }

    /// The probe comes near: its proxy is swept from `start` (object's axes, metres), where it is
    /// known to have been free, or else begins where the probe is.
    pub fn begin(&mut self, start: Option<Pose>) {
        self.is_near = true;
        self.start = start;
        self.proxy.invalidate();
        self.hint = None;
        self.clearance = 0.0;
        self.contact = None;
        self.rendered = None;
        self.nearest = None;
        self.nearest_pair = None;
    }

    /// The proxy has not begun yet, for want of a model: it will from here; see [`Self::begin`].
    pub fn waits(&mut self, start: Option<Pose>) {
        if !self.proxy.has_room() {
            self.start = start;
        }
    }

    /// A place beside the proxy, and on its side of the surface, at which the probe is outside of
    /// every front of the object; model frame and units. `around`: radius of a ball around the
    /// probe's position that holds it; `bulge`: by how much one front may stick out over another;
    /// `work` grows.
    ///
    /// It is straight away from the nearest point of the surface. `None` where the ball is not free
    /// at the proxy (a tool that touches), or the place is not: in a pocket it may be beyond the
    /// other wall.
    pub fn outside(
        &self,
        surface: Surface<'_>,
        [around, bulge]: [f64; 2],
        work: &mut Work,
    ) -> Option<Pose> {
        let proxy = self.proxy.pose()?;
        let hint = self.hint.filter(|&face| surface.mesh.is_active(face));
        let mut nearest = |place: DVec3| {
            let (found, cost, is_complete) =
                closest_point_within(surface, place, hint, OUTSIDE_WORK);
            work.add(cost);
            found.filter(|_| is_complete).map(|found| found.closest)
        };
        let surface_at = nearest(proxy.position)?.point;
        let away = proxy.position - surface_at;
        let distance = away.length();
        // One radius farther than it has to be: the surface may rise a little beside that point.
        // The ball around the proxy and the free one around the place hold the way between them.
        let free = around + bulge;
        let far = free + around;
        let is_free = distance >= (1.0 - ROUNDING) * around;
        if !is_free || !far.is_finite() {
            return None;
        }
        if distance >= far {
            return Some(proxy);
        }
        let position = surface_at + away * (far / distance);
        let clear = nearest(position)?.distance_squared.sqrt();
        (clear >= free).then_some(Pose { position, ..proxy })
    }

    /// The probe is far: its proxy ends.
    pub fn end(&mut self) {
        self.is_near = false;
        self.goal = None;
        self.proxy.invalidate();
        self.contact = None;
        self.rendered = None;
        self.nearest = None;
        self.nearest_pair = None;
    }

    /// The contact of this tick is to be found.
    pub fn begin_tick(&mut self) {
        self.contact = None;
        self.rendered = None;
        self.coupling.begin_tick();
    }

    /// Takes the pose of the probe in the world.
    pub fn update(&mut self, frame: &ModelFrame, probe: Option<Pose>) {
        if !self.is_near {
            return;
        }
        self.goal = probe.map(|pose| frame.pose_to_model(pose));
        if !self.proxy.has_room() {
            let start = self.start.take().map(|start| frame.object_to_model(start));
            self.proxy.begin(self.patch_m, frame.metres_per_unit, start);
        }
    }

    /// Notes the distance at which the contacts of a tool act in this tick.
    pub fn note_contact_offset(&mut self, metres_per_unit: f64) {
        if let Some(tool) = self.proxy.tool() {
            let offset_m = tool.static_offset() * metres_per_unit;
            self.contact_offset_m = self.contact_offset_m.max(offset_m);
        }
    }

    /// Share of the coupling's force that is paid for, 0 to 1.
    pub fn paid(&self) -> f64 {
        self.coupling.share()
    }

    /// The proxy of a tool that is near.
    pub fn tool(&self) -> Option<&ToolProxy> {
        self.proxy.tool().filter(|_| self.is_near)
    }

    /// Position of the device, and middle and radius of the patch that touches or would touch,
    /// model units; `None` without a probe.
    pub fn patch(&self, metres_per_unit: f64) -> Option<(DVec3, (DVec3, f64))> {
        let device = self.goal?.position;
        let at_device = (device, self.patch_m / metres_per_unit);
        Some((device, self.proxy.patch().unwrap_or(at_device)))
    }

    /// Moves the proxy, and measures the clearance, as far as the budget goes.
    pub fn advance(&mut self, surface: Surface<'_>, budget: &mut QueryBudget) -> Option<ProxyStep> {
        let goal = self.goal?;
        let kind = if self.proxy.is_tool() {
            QueryWork::Tool
        } else {
            QueryWork::Ball
        };
        let most = budget.left(kind);
        let mut step = self.proxy.advance(surface, &goal, most, budget);
        budget.charge(kind, step.work);
        let hint = self.hint.filter(|&face| surface.mesh.is_active(face));
        let most = budget.left(QueryWork::Search);
        let (nearest, work, is_complete) = self.proxy.nearest(surface, hint, most);
        budget.charge(QueryWork::Search, work);
        self.hint = nearest.map(|nearest| nearest.face);
        let point = nearest.map(|nearest| nearest.closest.point);
        // Of what is touched a point is known, even where no search has found one yet.
        let touched = step.contact.map(|contact| contact.point);
        self.nearest = if is_complete {
            point
        } else {
            self.nearer_of(point, self.nearest.or(touched))
        };
        if step.contact.is_none() && self.proxy.is_held() {
            let at = |found: Nearest| Contact::at(found.face, found.closest.point);
            // A late search without a hint may end before the first face: then the last point holds
            // on, of no face that is known.
            let last = self.nearest.map(|point| Contact::at(NONE, point));
            step.contact = nearest.map(at).or(last);
        }
        let clearance = nearest.map_or(f64::INFINITY, |n| n.closest.distance_squared.sqrt());
        self.clearance = if is_complete {
            clearance
        } else {
            // Nothing has come nearer than by the motion since.
            let (last, now) = (self.measured_at, self.proxy.position());
            let moved = last.zip(now).map_or(f64::INFINITY, |(a, b)| a.distance(b));
            clearance.min((self.clearance - moved).max(0.0))
        };
        self.measured_at = self.proxy.position();
        Some(step)
    }

    /// The nearer of two points. A search that was cut short may have missed what it found before.
    fn nearer_of(&self, one: Option<DVec3>, other: Option<DVec3>) -> Option<DVec3> {
        let Some((middle, _)) = self.proxy.patch() else {
            return one;
        };
        let nearer = |a: &DVec3, b: &DVec3| {
            let [a, b] = [a, b].map(|point| point.distance_squared(middle));
            a.total_cmp(&b)
        };
        one.into_iter().chain(other).min_by(nearer)
    }

    /// The largest certified error of the faces that hold the probe, model units: of a ball where
    /// they hold it. Not a number where there is no bound: no face holds it, or a ball one that is
    /// gone.
    ///
    /// A tool that has no time to look anew is held on by faces that are gone; the full mesh is as
    /// it was, so their bounds are, too.
    pub fn certified(&self, surface: Surface<'_>, contact: &Contact) -> f32 {
        let ball = self.proxy.position().filter(|_| !self.proxy.is_tool());
        let faces = contact.faces.iter().filter(|&&face| face != NONE);
        let bounds = faces.map(|&face| {
            let bound = match ball {
                _ if !surface.mesh.is_active(face) => self.proxy.bound_of(face),
                _ if face == contact.face => surface.mesh.certified_distance(face, contact.point),
                Some(middle) => surface.mesh.certified_distance(face, middle),
                None => surface.mesh.certified_error(face),
            };
            if bound.is_finite() { bound } else { f32::NAN }
        });
        let most = |a: f32, b: f32| if a.is_nan() || a > b { a } else { b };
        bounds.reduce(most).unwrap_or(f32::NAN)
    }

    /// Renders stiffness and damping of the surface at the contact, then its effects. Returns the
    /// depth of the device behind the proxy, metres.
    pub fn render(
        &mut self,
        clock: Clock,
        (frame, before, plan): (&ModelFrame, Option<&Pose>, &SurfacePlan),
        surface: Surface<'_>,
        contact: &Contact,
        probe: &Probe,
        budget: &mut QueryBudget,
    ) -> f64 {
        let Some(goal) = self.goal else {
            return 0.0;
        };
        let to_model = frame.pose.orientation.conjugate();
        let [moved, a_period] = probe.motion_along(before, &frame.pose).map(|of| Twist {
            linear: to_model * of.linear,
            angular: to_model * of.angular,
        });
        let velocity = a_period.times(1.0 / clock.period_s);
        let scale = frame.metres_per_unit;
        let place = (&goal, scale, plan);
        let (depth, wrench, spring) = self.couple(place, [&moved, &velocity], clock.period_s);
        let sign = match () {
            () if is(Mutant::Sign) => -1.0,
            () if is(Mutant::DeadZone) && depth < 1e-4 => 0.0,
            () => 1.0,
        };
        let mut rendered = Rendered::new(wrench * sign, spring);
        if !self.effects.is_empty()
            && let Some(proxy) = self.proxy.pose()
        {
            let in_metres = |pose: Pose| Pose {
                position: pose.position * scale,
                ..pose
            };
            let (pushes, count) = self.proxy.pushes(&rendered.passive, scale);
            let of_spring = (2.0 * spring.stiffness_n_per_m * spring.stored_j).sqrt();
            let size = self.proxy.wrench_size(&rendered.passive, scale);
            let sample = ContactSample {
                max_work: budget.left(QueryWork::Effects),
                clock,
                periods: probe.periods(),
                goes_on: probe.goes_on(),
                is_interrupted: probe.was_interrupted(),
                surface,
                metres_per_unit: scale,
                origin: frame.origin * scale,
                to_world: frame.pose.orientation,
                point: contact.point * scale,
                middle: (!self.proxy.is_tool()).then_some(proxy.position * scale),
                pushes: &pushes[..count],
                gyration_m: self.tool().map_or(0.0, |tool| tool.gyration() * scale),
                device: in_metres(goal),
                proxy: in_metres(proxy),
                velocity: velocity.linear,
                angular: velocity.angular,
                moved: moved.times(1.0 / probe.periods()[1].max(1) as f64),
                stiffness_n_per_m: plan.stiffness_n_per_m,
                paid_n_per_m: spring.stiffness_n_per_m,
                undamped: of_spring / size,
            };
            let mut work = Work::default();
            self.effects
                .render_contact(&sample, &mut rendered, &mut work);
            budget.charge(QueryWork::Effects, work);
        }
        self.rendered = Some(rendered.turned(frame.pose.orientation));
        depth
    }

    /// [`ProxyKind::render`], as far as the spring is paid for: what damping takes on every stroke
    /// is no energy of the spring, and pays for none. `moved`: see [`PaidCoupling::pay`].
    fn couple(
        &mut self,
        (goal, scale, plan): (&Pose, f64, &SurfacePlan),
        [moved, velocity]: [&Twist; 2],
        period_s: f64,
    ) -> (f64, Wrench, CouplingSpring) {
        let (depth, [whole, undamped], spring) = self.proxy.render(goal, scale, plan, velocity);
        let (coupled, moves) = ((undamped, spring), self.surface_moves);
        let (_, spring) = self.coupling.pay(coupled, moved, moves, period_s);
        (depth, whole * self.coupling.share(), spring)
    }

    /// What has a limit: its name, the most that there was, and the limit.
    pub fn high_water(&self) -> impl Iterator<Item = (&'static str, (usize, usize))> + use<> {
        let effects = self.effects.high_water();
        let proxy = self.proxy.high_water().into_iter().flatten();
        proxy.chain(effects.into_iter().flatten())
    }

    /// Renders the effects of the surface in free space.
    pub fn render_near(
        &mut self,
        clock: Clock,
        frame: &ModelFrame,
        surface: Surface<'_>,
        budget: &mut QueryBudget,
    ) {
        if self.effects.is_empty() {
            return;
        }
        let reach_m = self.effects.reach_m(clock);
        let gap = (reach_m > 0.0)
            .then(|| self.gap(frame, surface, reach_m, budget))
            .flatten();
        // The contact is over, too, where it is not known what is near.
        let wrench = self.effects.render_near(clock, gap.as_ref());
        if wrench != Wrench::ZERO {
            let pulls = Rendered {
                active: wrench,
                ..Rendered::default()
            };
            self.rendered = Some(pulls.turned(frame.pose.orientation));
        }
    }

    /// The space between probe and surface, of a tool if it is no wider than `reach_m`. Contacts of
    /// a tool act at a distance, at which it touches.
    fn gap(
        &mut self,
        frame: &ModelFrame,
        surface: Surface<'_>,
        reach_m: f64,
        budget: &mut QueryBudget,
    ) -> Option<Gap> {
        let scale = frame.metres_per_unit;
        if !self.proxy.is_tool() {
            let (middle, radius) = self.proxy.patch()?;
            let outward = self.nearest? - middle;
            return Some(Gap {
                width_m: (outward.length() - radius) * scale,
                towards: outward.normalize_or_zero(),
                arm: DVec3::ZERO,
            });
        }
        let tool = self.tool().filter(|tool| tool.is_placed())?;
        let (offset, pose) = (tool.contact_offset(), tool.pose());
        let reach = reach_m / scale + offset;
        let before = self.nearest_pair.map(|(pair, at)| pair.moved(&at, &pose));
        let faces = before.map(|pair| pair.faces);
        let most = budget.left(QueryWork::ToolSearch);
        let (found, work, is_complete) = self.proxy.nearest_pair(surface, reach, faces, most)?;
        budget.charge(QueryWork::ToolSearch, work);
        // A search that was cut short may have missed what it found before.
        let known = before.filter(|_| !is_complete);
        let nearer =
            |a: &NearestPair, b: &NearestPair| a.distance_squared.total_cmp(&b.distance_squared);
        let nearest = found.into_iter().chain(known).min_by(nearer);
        self.nearest_pair = nearest.map(|nearest| (nearest, pose));
        let NearestPair { points, .. } = nearest?;
        let [on_surface, on_tool] = points;
        let outward = on_surface - on_tool;
        Some(Gap {
            width_m: (outward.length() - offset).max(0.0) * scale,
            towards: outward.normalize_or_zero(),
            arm: (on_tool - pose.position) * scale,
        })
    }
}

#[cfg(test)]
mod tests;
