//! What follows a probe outside of an object: the proxy of its ball, or of its tool. Model frame
//! and units.

use crate::contact::coupling::Coupling;
use crate::contact::motion::Twist;
use crate::contact::query::{
    Deadline, Limit, MAX_FACES, Nearest, PairWork, Surface, Work, closest_point_within,
};
use crate::contact::rigid_proxy::projection::MAX_ACTIVE;
use crate::contact::rigid_proxy::{
    Imperceptible, NearestPair, Part, StepSettings, ToolContact, ToolProxy,
};
use crate::contact::sphere_proxy::{Contact, MAX_CONSTRAINTS, MAX_PUSHING, Proxy};
use crate::contact::tool::{Tool, ToolMesh};
use crate::force::effects::contact_set::Push;
use crate::force::passivity::CouplingSpring;
use crate::tuning::governor::{MIN_BALL_UNITS, MIN_TOOL_UNITS};
use crate::tuning::probe::{BALL_INTERVAL, PAIRS_A_UNIT, TOOL_INTERVAL};
use geometry::portable::hypot;
use geometry::{Pose, Wrench};
use glam::DVec3;
use mutants::{Mutant, is};
use scene::{ProbeShape, SurfacePlan};
use spm::{ActiveMesh, Handle, NONE, OperationFaces};

/// See the module.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub enum ProxyKind {
    /// Of a ball.
    Ball(Box<SphereKind>),
    /// Of a tool.
    Tool(Box<ToolKind>),
}

/// The proxy of a ball; none until it begins.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct SphereKind {
    proxy: Option<Proxy>,
    /// The most faces near, and half-spaces, of its proxies before this one.
    most: [usize; 2],
}

/// The proxy of a tool, in metres until it begins, and where it touches.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct ToolKind {
    proxy: ToolProxy,
    has_room: bool,
    /// The middle of what it touched last, if it does.
    touched: Option<DVec3>,
    /// The contacts that push it, the one that pushes most first.
    pushing: [ToolContact; MAX_ACTIVE],
    pushing_count: usize,
    /// Radius of what the tip touches at once, and of what is touched now.
    patch: f64,
    spread: f64,
}

/// Result of a tick.
#[derive(Debug, Clone, Copy)]
pub struct ProxyStep {
    /// The contact that holds it; `None` in free space.
    pub contact: Option<Contact>,
    /// Cost, in units.
    pub work: Work,
    /// Constraints that did not fit.
    pub dropped: u32,
    /// Whether the budget left something to the next tick.
    pub unfinished: bool,
    /// Whether it left a part of its way to the next tick though the budget had room.
    pub early: bool,
    /// Contacts that should have stopped an earlier step.
    pub late_contacts: u32,
    /// Whether it is a tool that knows no way out of the surface.
    pub stuck: bool,
}

impl ProxyStep {
    const NOTHING: Self = Self {
        contact: None,
        work: Work { nodes: 0, faces: 0 },
        dropped: 0,
        unfinished: false,
        early: false,
        late_contacts: 0,
        stuck: false,
    };
}

impl ProxyKind {
    /// Of a shape, not begun. Everything is allocated now.
    ///
    /// A mesh that cannot be a tool, which a validated scene does not have, leaves a ball.
    pub fn new(shape: &ProbeShape) -> Self {
        let tool = ToolMesh::of_shape(shape).and_then(|mesh| Tool::new(&mesh).ok());
        let proxy = tool.and_then(|tool| ToolProxy::new(tool, 1.0).ok());
        match proxy {
            None => Self::Ball(Box::new(SphereKind {
                proxy: None,
                most: [0; 2],
            })),
            Some(proxy) => Self::Tool(Box::new(ToolKind {
                proxy,
                has_room: false,
                touched: None,
                pushing: [ToolContact::NONE; MAX_ACTIVE],
                pushing_count: 0,
                patch: 0.0,
                spread: 0.0,
            })),
        }
    }

    /// Nothing is followed any more.
    pub fn invalidate(&mut self) {
        match self {
            Self::Ball(ball) => {
                ball.most = ball.high_water();
                ball.proxy = None;
            }
            Self::Tool(tool) => tool.has_room = false,
        }
    }

    /// Whether it follows.
    pub fn has_room(&self) -> bool {
        match self {
            Self::Ball(ball) => ball.proxy.is_some(),
            Self::Tool(tool) => tool.has_room,
        }
    }

    /// Begins at an object whose unit is so many metres. `patch`: radius of the ball, or of what
    /// the tip touches, metres; `start`: where the proxy was free, if that is not where the probe
    /// will be.
    pub fn begin(&mut self, patch: f64, metres_per_unit: f64, start: Option<Pose>) {
        let patch = patch / metres_per_unit;
        match self {
            Self::Ball(ball) => {
                let mut proxy = Proxy::new(patch);
                if let Some(start) = start {
                    proxy.place(start.position);
                }
                ball.proxy = Some(proxy);
            }
            Self::Tool(tool) => {
                tool.has_room = tool.proxy.begin(1.0 / metres_per_unit).is_ok();
                tool.touched = None;
                tool.pushing_count = 0;
                (tool.patch, tool.spread) = (patch, patch);
                if let (Some(start), true) = (start, tool.has_room) {
                    tool.proxy.place(&start);
                }
            }
        }
    }

    /// Steps of a tool with other settings from now on.
    pub fn set_steps(&mut self, settings: StepSettings) {
        if let Self::Tool(tool) = self {
            tool.proxy.set_steps(settings);
        }
    }

    /// Whether it is of a tool: its steps cost many times those of a ball.
    pub fn is_tool(&self) -> bool {
        matches!(self, Self::Tool(_))
    }

    /// The proxy of a tool that has begun.
    pub fn tool(&self) -> Option<&ToolProxy> {
        match self {
            Self::Ball(_) => None,
            Self::Tool(tool) => tool.has_room.then_some(&tool.proxy),
        }
    }

    /// Whether it has a place.
    pub fn is_placed(&self) -> bool {
        match self {
            Self::Ball(ball) => ball.proxy.as_ref().is_some_and(Proxy::is_placed),
            Self::Tool(tool) => tool.has_room && tool.proxy.is_placed(),
        }
    }

    /// Where the probe would be if it could not enter the object.
    pub fn position(&self) -> Option<DVec3> {
        match self {
            _ if !self.is_placed() => None,
            Self::Ball(ball) => ball.proxy.as_ref().map(Proxy::position),
            Self::Tool(tool) => Some(tool.proxy.pose().position),
        }
    }

    /// Where the coupling of the device ends.
    fn coupling_end(&self) -> Option<DVec3> {
        match self {
            Self::Ball(ball) if self.is_placed() => ball.proxy.as_ref().map(Proxy::settled),
            _ => self.position(),
        }
    }

    /// The proxy; the axes of a ball are the model's.
    pub fn pose(&self) -> Option<Pose> {
        match self {
            Self::Ball(_) => self.position().map(Pose::at),
            Self::Tool(tool) => self.is_placed().then(|| tool.proxy.pose()),
        }
    }

    /// Middle and radius of the ball that holds what is touched, or would be.
    pub fn patch(&self) -> Option<(DVec3, f64)> {
        let position = self.position()?;
        Some(match self {
            Self::Ball(ball) => (position, ball.proxy.as_ref().map_or(0.0, Proxy::radius)),
            Self::Tool(tool) => (tool.touched.unwrap_or(position), tool.spread),
        })
    }

    /// The forces of the contacts of a tool, in metres and newtons, and their number: as far as
    /// they explain the surface's wrench on it about its position. None for a ball, whose force is
    /// that of its contact.
    pub fn pushes(&self, wrench: &Wrench, metres_per_unit: f64) -> ([Push; MAX_ACTIVE], usize) {
        let mut pushes = [Push::NONE; MAX_ACTIVE];
        let Self::Tool(tool) = self else {
            return (pushes, 0);
        };
        let contacts = &tool.pushing[..tool.pushing_count];
        let newtons = tool.newtons_per_multiplier(contacts, wrench, metres_per_unit);
        for (push, contact) in pushes.iter_mut().zip(contacts) {
            *push = Push {
                point: contact.point * metres_per_unit,
                force: contact.normal * (contact.multiplier * newtons),
            };
        }
        (pushes, contacts.len())
    }

    /// Certified error of a face that holds a tool, from when it was found near, model units;
    /// infinite for any other.
    pub fn bound_of(&self, face: Handle) -> f32 {
        let Self::Tool(tool) = self else {
            return f32::INFINITY;
        };
        let mut contacts = tool.pushing[..tool.pushing_count].iter();
        let held_by = contacts.find(|contact| contact.face == face);
        held_by.map_or(f32::INFINITY, |contact| contact.certified)
    }

    /// Size of a wrench about the position in the metric of the coupling, newtons.
    pub fn wrench_size(&self, wrench: &Wrench, metres_per_unit: f64) -> f64 {
        let size = wrench.force.length();
        match self {
            Self::Ball(_) => size,
            Self::Tool(tool) => {
                let torque = tool.torque_about_centre(wrench, metres_per_unit);
                hypot(size, torque.length())
            }
        }
    }

    /// Balls that together hold what may touch.
    pub fn parts(&self, goal: &Pose) -> impl Iterator<Item = Part> + use<'_> {
        let (ball, tool) = match self {
            _ if !self.is_placed() => (None, None),
            Self::Ball(ball) => (ball.proxy.as_ref(), None),
            Self::Tool(tool) => (None, Some(tool.proxy.parts(goal))),
        };
        let goal = goal.position;
        let ball = ball.map(|proxy| Part {
            centre: proxy.position(),
            goal,
            radius: proxy.radius(),
        });
        ball.into_iter().chain(tool.into_iter().flatten())
    }

    /// Whether something that happens in a box may be near, `around` times what the tip touches
    /// around it: a tool fills its parts only in part.
    pub fn may_reach(&self, [lower, upper]: [DVec3; 2], around: f64) -> bool {
        match self {
            Self::Ball(_) => true,
            Self::Tool(tool) => {
                let margin = around * tool.patch;
                tool.proxy.may_reach([lower - margin, upper + margin])
            }
        }
    }

    /// Takes it along with a split or collapse that was just performed.
    pub fn carry(&mut self, mesh: &ActiveMesh, operation: &OperationFaces) {
        match self {
            Self::Ball(ball) => {
                if let Some(proxy) = &mut ball.proxy {
                    proxy.carry(mesh, operation);
                }
            }
            Self::Tool(tool) if tool.has_room => tool.proxy.carry(mesh, operation),
            Self::Tool(_) => {}
        }
    }

    /// A ball slides no farther beyond the device's motion than this in a tick.
    pub fn limit_slide(&mut self, slide: f64) {
        if let Self::Ball(ball) = self
            && let Some(proxy) = &mut ball.proxy
        {
            proxy.limit_slide(slide);
        }
    }

    /// What is not felt of the coupling of a tool to the device.
    pub fn set_imperceptible(&mut self, imperceptible: Imperceptible) {
        if let Self::Tool(tool) = self {
            tool.proxy.set_imperceptible(imperceptible);
        }
    }

    /// As close to the device as the surface lets it, in steps that take no more than `max_work`
    /// and end when a deadline says so.
    pub fn advance(
        &mut self,
        surface: Surface<'_>,
        goal: &Pose,
        max_work: u32,
        deadline: &mut dyn Deadline,
    ) -> ProxyStep {
        match self {
            Self::Ball(ball) => ball.proxy.as_mut().map_or(ProxyStep::NOTHING, |proxy| {
                let limit = Limit::new(max_work, [MIN_BALL_UNITS as u32, BALL_INTERVAL], deadline);
                let advance = proxy.advance(surface, goal.position, limit);
                ProxyStep {
                    contact: advance.contact,
                    work: advance.work,
                    dropped: advance.dropped,
                    unfinished: advance.is_cut,
                    early: false,
                    late_contacts: 0,
                    stuck: false,
                }
            }),
            Self::Tool(tool) if tool.has_room => {
                let budget = max_work.saturating_mul(PAIRS_A_UNIT);
                let floor = MIN_TOOL_UNITS as u32 * PAIRS_A_UNIT;
                let limit = Limit::new(budget, [floor, TOOL_INTERVAL], deadline);
                tool.advance(surface, goal, limit)
            }
            Self::Tool(_) => ProxyStep::NOTHING,
        }
    }

    /// Whether it is held though nothing touches it: a tool that was caught, or that had no work
    /// left to move, or a ball that goes gently.
    pub fn is_held(&self) -> bool {
        match self {
            Self::Ball(ball) => ball.proxy.as_ref().is_some_and(Proxy::is_behind),
            Self::Tool(tool) => tool.has_room && tool.proxy.is_blocked(),
        }
    }

    /// The face nearest to the middle of the patch, the cost, and whether the search is complete;
    /// see [`closest_point_within`].
    pub fn nearest(
        &self,
        surface: Surface<'_>,
        hint: Option<Handle>,
        max_work: u32,
    ) -> (Option<Nearest>, Work, bool) {
        let none = (None, Work::default(), true);
        match self {
            Self::Ball(ball) => ball
                .proxy
                .as_ref()
                .map_or(none, |proxy| proxy.nearest(surface, hint, max_work)),
            Self::Tool(_) => self.patch().map_or(none, |(middle, _)| {
                closest_point_within(surface, middle, hint, max_work)
            }),
        }
    }

    /// [`ToolProxy::nearest_within`] with so many units; `None` for a ball.
    pub fn nearest_pair(
        &self,
        surface: Surface<'_>,
        reach: f64,
        before: Option<[Handle; 2]>,
        max_work: u32,
    ) -> Option<(Option<NearestPair>, Work, bool)> {
        let tool = self.tool()?;
        // The faces before are one pair.
        let most = max_work.saturating_mul(PAIRS_A_UNIT);
        let Some(most) = most.checked_sub(PairWork::FACE_PAIR) else {
            return Some((None, Work::default(), false));
        };
        let mut limit = Limit::from(most);
        let (nearest, work, is_complete) = tool.nearest_within(surface, reach, before, &mut limit);
        let work = in_units(work.node_pairs, work.cost());
        Some((nearest, work, is_complete))
    }

    /// Depth of the device behind the proxy, metres; the wrench on it about its position in the
    /// model's axes, with damping and without; and the spring that it comes from. `velocity`: of
    /// the device's position, metres and radians a second, model's axes.
    pub fn render(
        &self,
        goal: &Pose,
        metres_per_unit: f64,
        surface: &SurfacePlan,
        velocity: &Twist,
    ) -> (f64, [Wrench; 2], CouplingSpring) {
        let Some(end) = self.coupling_end() else {
            return (0.0, [Wrench::ZERO; 2], CouplingSpring::default());
        };
        let out = (end - goal.position) * metres_per_unit;
        let depth = out.length();
        let coupling = Coupling {
            stiffness_n_per_m: surface.stiffness_n_per_m,
            damping_ns_per_m: surface.damping_ns_per_m,
        };
        let (wrenches, stretch) = match self {
            // A ball has no axes: its coupling is that of a body without extent.
            Self::Ball(_) => {
                let stretch = Twist {
                    linear: out,
                    angular: DVec3::ZERO,
                };
                (coupling.wrenches(&stretch, velocity, 0.0), depth)
            }
            Self::Tool(tool) => (
                tool.proxy.wrenches(&coupling, metres_per_unit, velocity),
                tool.proxy.deflection() * metres_per_unit,
            ),
        };
        let wrenches = wrenches.map(|wrench| match () {
            () if is(Mutant::ToolTorque) && self.is_tool() => wrench.without_torque(),
            () if is(Mutant::ToolStiff) && self.is_tool() => wrench * 3.0,
            () => wrench,
        });
        let spring = CouplingSpring {
            stiffness_n_per_m: surface.stiffness_n_per_m,
            stored_j: 0.5 * surface.stiffness_n_per_m * stretch * stretch,
            raised_j: 0.0,
        };
        (depth, wrenches, spring)
    }

    /// What has a limit: its name, the most that there was so far, and the limit.
    pub fn high_water(&self) -> [Option<(&'static str, (usize, usize))>; 3] {
        match self {
            Self::Ball(ball) => {
                let [faces, planes] = ball.high_water();
                [
                    Some(("faces near the probe", (faces, MAX_FACES))),
                    Some(("half-spaces of the proxy", (planes, MAX_CONSTRAINTS))),
                    None,
                ]
            }
            Self::Tool(tool) => {
                let [pairs, faces, contacts] = tool.proxy.high_water();
                [
                    Some(("pairs of faces near the tool", pairs)),
                    Some(("faces near the tool", faces)),
                    Some(("contacts of the tool", contacts)),
                ]
            }
        }
    }
}

impl SphereKind {
    /// The most faces near, and half-spaces, of all its proxies so far.
    fn high_water(&self) -> [usize; 2] {
        let Some(proxy) = &self.proxy else {
            return self.most;
        };
        let [faces, planes] = proxy.high_water().map(|(most, _)| most);
        [self.most[0].max(faces), self.most[1].max(planes)]
    }
}

impl ToolKind {
    /// Force of a contact with a multiplier of 1: stiffness times metres a unit where the coupling
    /// is at rest and the proxy is where the contacts allow. Damping, a share that is unpaid, and a
    /// tick that stopped early change it: the sum of the contacts' wrenches is the multiple of
    /// theirs that is nearest to the wrench, in the metric of the coupling.
    fn newtons_per_multiplier(
        &self,
        contacts: &[ToolContact],
        wrench: &Wrench,
        metres_per_unit: f64,
    ) -> f64 {
        let [mut force, mut torque] = [DVec3::ZERO; 2];
        for contact in contacts {
            let push = contact.normal * contact.multiplier;
            force += push;
            torque += contact.arm.cross(push);
        }
        let torque = torque / self.proxy.gyration();
        let about_centre = self.torque_about_centre(wrench, metres_per_unit);
        let along = force.dot(wrench.force) + torque.dot(about_centre);
        let newtons = along / (force.length_squared() + torque.length_squared());
        // Contacts that do not push have no force, nor has a wrench that is no number.
        if newtons > 0.0 && newtons.is_finite() {
            newtons
        } else {
            0.0
        }
    }

    /// Torque of a wrench about the tool's centre over the radius of gyration, newtons. Both are
    /// the device's, for which the wrench is: the proxy may have other axes.
    fn torque_about_centre(&self, wrench: &Wrench, metres_per_unit: f64) -> DVec3 {
        let from_centre = self.proxy.device_arm();
        let torque = wrench.torque / metres_per_unit + from_centre.cross(wrench.force);
        torque / self.proxy.gyration()
    }

    fn advance(&mut self, surface: Surface<'_>, goal: &Pose, limit: Limit<'_>) -> ProxyStep {
        let advance = self.proxy.advance(surface, goal, limit);
        let contacts = advance.contacts();
        self.touched = middle(contacts);
        self.pushing_count = contacts.len();
        self.pushing[..contacts.len()].copy_from_slice(contacts);
        if let Some(middle) = self.touched {
            let farthest = contacts.iter().fold(0.0, |most, contact| {
                contact.point.distance(middle).max(most)
            });
            self.spread = farthest + self.patch;
        } else {
            self.spread = self.patch;
        }
        ProxyStep {
            contact: contact_of(contacts),
            work: in_units(advance.work.node_pairs, advance.spent),
            dropped: advance.dropped,
            unfinished: !advance.ending.is_complete(),
            early: advance.ending.is_complete() && advance.is_unsettled,
            late_contacts: advance.late_contacts,
            stuck: advance.is_stuck,
        }
    }
}

fn middle(contacts: &[ToolContact]) -> Option<DVec3> {
    let sum: DVec3 = contacts.iter().map(|contact| contact.point).sum();
    (!contacts.is_empty()).then(|| sum / contacts.len() as f64)
}

/// The work of a tool that cost so many pairs of nodes, of which so many were visited, in units.
fn in_units(visited: u32, cost: u32) -> Work {
    let nodes = visited / PAIRS_A_UNIT;
    let all = cost.div_ceil(PAIRS_A_UNIT).max(nodes);
    Work {
        nodes,
        faces: all - nodes,
    }
}

/// The contacts of a tool as one: where what pushes most does. The nearest would be any of them:
/// all are as near, but for rounding.
fn contact_of(contacts: &[ToolContact]) -> Option<Contact> {
    let strongest = contacts.first()?;
    let mut faces = [NONE; MAX_PUSHING];
    for (place, contact) in faces.iter_mut().zip(contacts) {
        *place = contact.face;
    }
    Some(Contact {
        face: strongest.face,
        point: strongest.point,
        faces,
    })
}

#[cfg(test)]
mod tests;
