//! The proxy of a tool: where the tool would be if it could not enter the object, in six degrees of freedom.
//!
//! After Ortega, Redon and Coquillart 2007: the motion from the proxy to the device is projected onto what the contacts
//! allow ([`projection`]), in the metric of the tool's mass, so that a rotation weighs as the way that it moves the
//! surface of the tool; then the proxy goes along it as far as no face passes another (`sweep`). Nothing
//! depends on an absolute length: what is small is small beside the tool.
//!
//! Contacts act at a rest distance of a ten-thousandth of the tool's radius of gyration, the sweep stops at half of it:
//! so a resting contact is not a touch, and every crossing is. The tool feels that much thicker than its mesh. While the
//! surface under it moves the distance is what the surface may do in a tick.
//!
//! | file | does |
//! |---|---|
//! | `motion` | twists and placements |
//! | `shape` | the tool's mesh about its centre |
//! | `cover` | balls that hold it |
//! | `corridor` | a motion and what is beside it |
//! | `neighbourhood` | pairs of faces near each other, gathered once and reused |
//! | `contacts` | local minima of the distance |
//! | `projection` | the quadratic program |
//! | `sweep` | conservative advancement |
//! | `follow` | the steps of a tick |
//! | `hold` | where the coupling holds it while a tick ends on the way |
//! | `advance` | what a tick gives |
//! | `coupling` | force and torque |

mod answer;
mod bounding_balls;
mod contacts;
mod coupling_target;
mod look_ahead_tube;
mod mesh_change;
mod neighbourhood;
pub mod projection;
mod shape;
mod steps;
mod sweep;

pub use answer::ToolAdvance;
pub use bounding_balls::MAX_BALLS;
pub use contacts::ToolContact;
pub use neighbourhood::{MAX_PAIRS, MAX_SURFACE_FACES};

use crate::contact::coupling::{Coupling, about};
use crate::contact::motion::{Placement, Twist};
use crate::contact::query::{Body, Surface, first_pair};
use crate::contact::tool::{RelativePath, Tool, for_each_face_near};
use crate::perception::StepLimit;
use bounding_balls::{Ball, bounding_balls};
use contacts::Contacts;
use geometry::{BoxPair, Pose, Similarity, Wrench, triangle_pair};
use glam::DVec3;
use mesh_change::MeshChange;
use neighbourhood::Neighbourhood;
use projection::{HalfSpace, MAX_HALF_SPACES};
use shape::ToolShape;
use spm::{ActiveMesh, Handle, OperationFaces};
use steps::MAX_STOPS;
use sweep::Open;
use thiserror::Error;

/// What the budget counts, in pairs of nodes of equal cost (measured): a pair of faces that may meet, ...
const TESTED: u32 = 3;
/// ... and so many faces of the tool that are moved.
const FACES_MOVED: u32 = 4;
/// Distance at which contacts act, as a fraction of the radius of gyration.
const CONTACT_OFFSET: f64 = 1e-4;
/// What the surface may do in a tick while it moves, as a fraction of how far the tool may slide then: twice what one
/// vertex in flight may (see [`crate::perception`]), since more than one may move a face.
const MOVING_OFFSET: f64 = 0.625;

/// Why a tool cannot be a probe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum ToolProxyError {
    /// No length to measure by.
    #[error("the tool has no extent, or the scale is not a positive number")]
    NoExtent,
}

/// A ball around a part of a probe; model frame and units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Its middle at the proxy.
    pub centre: DVec3,
    /// Its middle at the device.
    pub goal: DVec3,
    /// Its radius.
    pub radius: f64,
}

/// Whether the proxy is free of the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Not placed yet.
    Nowhere,
    /// Placed, and not seen clear of the surface yet: it goes with the device, without a force.
    Inside,
    /// No face of it meets the surface.
    Clear,
    /// The surface has moved into it and there was no way out: it stays until the device is clear.
    Stuck,
}

/// The tool that stays outside, in the model's frame and units. Nothing allocates after [`ToolProxy::new`].
#[derive(Debug, Clone)]
pub struct ToolProxy {
    tool: Tool,
    scale: f64,
    shape: ToolShape,
    balls: Vec<Ball>,
    near: Neighbourhood,
    contacts: Contacts,
    half_spaces: Vec<HalfSpace>,
    /// Pairs that have stopped a step of this tick.
    stops: Vec<usize>,
    /// Pairs that a sweep looks at more than once.
    open: Vec<Open>,
    mesh_change: MeshChange,
    state: State,
    at: Placement,
    goal: Placement,
    step_limit: StepLimit,
    /// Whether it was kept from going farther by that.
    is_behind: bool,
    /// Where the contacts let it go, were it not for its own limits: there it is held.
    coupling_target: Placement,
    /// Whether that was a guess in the tick before, and how far the coupling is stretched from there.
    is_estimate: bool,
    deflection: Twist,
    /// How far the coupling may be stretched without being felt.
    imperceptible: f64,
    /// Share of what is gathered ahead that the budget allowed last.
    look_ahead_scale: f64,
    /// Whether what is gathered waits for its first step: that is taken before anything is gathered again.
    has_unused_collection: bool,
    /// The farthest that the device went in a tick since the tool was with it.
    peak_step: f64,
    /// How far the device has gone in all since then.
    device_travel: f64,
    /// Whether the last tick has come to no step: the next one comes to one, whatever it has spent.
    has_skipped_step: bool,
    /// What the last part of a gathering has cost.
    last_cost: u32,
    /// How much farther ahead than the device goes in a tick it looks in free air, to catch up.
    catch_up_factor: f64,
    rejected: u64,
}

impl ToolProxy {
    /// A proxy of a tool, not placed yet; `scale` is the length of the tool's unit in units of the model.
    ///
    /// # Errors
    /// When tool or scale give no length.
    pub fn new(tool: Tool, scale: f64) -> Result<Self, ToolProxyError> {
        if !(scale.is_normal() && scale > 0.0) {
            return Err(ToolProxyError::NoExtent);
        }
        let shape = ToolShape::new(&tool, scale);
        if !(shape.gyration.is_normal() && shape.radius.is_finite()) {
            return Err(ToolProxyError::NoExtent);
        }
        let nowhere = Placement::NOWHERE;
        Ok(Self {
            balls: bounding_balls(&tool),
            near: Neighbourhood::new(&shape),
            contacts: Contacts::new(),
            half_spaces: Vec::with_capacity(MAX_HALF_SPACES),
            stops: Vec::with_capacity(MAX_STOPS),
            open: Vec::with_capacity(MAX_PAIRS),
            mesh_change: MeshChange::new(),
            state: State::Nowhere,
            at: nowhere,
            goal: nowhere,
            step_limit: StepLimit::FREE,
            is_behind: false,
            coupling_target: nowhere,
            is_estimate: false,
            deflection: Twist::default(),
            imperceptible: 0.0,
            look_ahead_scale: 1.0,
            has_unused_collection: false,
            peak_step: 0.0,
            device_travel: 0.0,
            has_skipped_step: false,
            last_cost: 0,
            catch_up_factor: 1.0,
            rejected: 0,
            tool,
            scale,
            shape,
        })
    }

    /// Begins anew, not placed yet, for a model of another scale: nothing is allocated.
    ///
    /// # Errors
    /// When the scale gives no length.
    pub fn begin(&mut self, scale: f64) -> Result<(), ToolProxyError> {
        if !(scale.is_normal() && scale > 0.0) {
            return Err(ToolProxyError::NoExtent);
        }
        self.shape.rescale(&self.tool, scale);
        if !(self.shape.gyration.is_normal() && self.shape.radius.is_finite()) {
            return Err(ToolProxyError::NoExtent);
        }
        self.scale = scale;
        self.invalidate();
        self.mesh_change = MeshChange::new();
        self.state = State::Nowhere;
        self.contacts.clear();
        self.look_ahead_scale = 1.0;
        self.step_limit = StepLimit::FREE;
        self.is_behind = false;
        self.catch_up_factor = 1.0;
        self.peak_step = 0.0;
        self.device_travel = 0.0;
        self.has_skipped_step = false;
        self.is_estimate = false;
        Ok(())
    }

    /// Whether it has been placed.
    #[must_use]
    pub fn is_placed(&self) -> bool {
        self.state != State::Nowhere
    }

    /// Its pose, model units: that of the tool's own frame.
    #[must_use]
    pub fn pose(&self) -> Pose {
        self.pose_at(&self.at)
    }

    /// Balls that together hold the tool, their middles where the proxy is and where it would be at a pose of the device;
    /// model units.
    pub fn parts(&self, goal: &Pose) -> impl Iterator<Item = Part> + use<'_> {
        let (proxy, goal) = (self.pose(), *goal);
        self.balls.iter().map(move |ball| {
            let [centre, goal] =
                [proxy, goal].map(|pose| pose.transform_point(ball.centre * self.scale));
            Part {
                centre,
                goal,
                radius: ball.radius * self.scale,
            }
        })
    }

    /// Whether what happens in a box (model frame and units) may come near the tool, as far as is known.
    #[must_use]
    pub fn may_reach(&self, [lower, upper]: [DVec3; 2]) -> bool {
        let space = BoxPair::twice_widened(lower.as_vec3a(), upper.as_vec3a());
        self.near.may_reach(&self.shape, &space.get(0))
    }

    /// Radius of gyration of the tool's surface about its centre, model units.
    #[must_use]
    pub fn gyration(&self) -> f64 {
        self.shape.gyration
    }

    /// Distance at which contacts act, model units: by so much the tool feels thicker than it is; more while the surface
    /// moves.
    #[must_use]
    pub fn contact_offset(&self) -> f64 {
        self.static_offset().max(self.moving_offset())
    }

    /// The same where nothing moves.
    fn static_offset(&self) -> f64 {
        CONTACT_OFFSET * self.shape.gyration
    }

    /// How far the surface may come in a tick, model units: as long as it moves contacts act at that distance, so that it
    /// pushes the tool and does not come to meet it.
    fn moving_offset(&self) -> f64 {
        MOVING_OFFSET * self.step_limit.limit()
    }

    /// Poses that were none.
    #[must_use]
    pub fn rejected(&self) -> u64 {
        self.rejected
    }

    /// The most pairs of faces and contacts that a step had; and how many fit.
    #[must_use]
    pub fn high_water(&self) -> [(usize, usize); 2] {
        [
            (self.near.high_water(), MAX_PAIRS),
            (self.contacts.high_water(), MAX_HALF_SPACES),
        ]
    }

    /// The surface is nowhere nearer than this, model units, as far as the last tick has looked.
    #[must_use]
    pub fn clearance(&self) -> f64 {
        self.near.clearance(&self.shape)
    }

    /// All pairs of faces nearer than this where it is are among [`ToolProxy::known_pairs`], model units; negative where
    /// nothing is known.
    #[must_use]
    pub fn known_margin(&self) -> f64 {
        self.near.tube.left()
    }

    /// Pairs of faces that are held against each other: one of the surface and one of the tool.
    pub fn known_pairs(&self) -> impl Iterator<Item = (Handle, u32)> + '_ {
        self.near.handles()
    }

    fn pose_at(&self, at: &Placement) -> Pose {
        Pose {
            position: at.centre - at.orientation * self.shape.centre,
            orientation: at.orientation,
        }
    }

    /// `None` for what is no pose.
    fn placement(&self, pose: &Pose) -> Option<Placement> {
        let length = pose.orientation.length();
        if !(pose.is_finite() && length.is_normal()) {
            return None;
        }
        let orientation = pose.orientation / length;
        let centre = pose.position + orientation * self.shape.centre;
        centre.is_finite().then_some(Placement {
            centre,
            orientation,
        })
    }

    /// Puts it somewhere without a sweep, as at the first sample. Where it meets the surface there, it goes with the
    /// device until it does not. Whether the pose is one.
    pub fn place(&mut self, pose: &Pose) -> bool {
        let Some(at) = self.placement(pose) else {
            self.rejected += 1;
            return false;
        };
        self.at = at;
        self.goal = at;
        self.coupling_target = at;
        self.state = State::Inside;
        self.invalidate();
        true
    }

    /// Notes a split or collapse that was just performed: what it moves near the tool is looked at anew, and where the
    /// surface has moved into the tool, the next tick puts it out on the side where it was.
    pub fn carry(&mut self, mesh: &ActiveMesh, operation: &OperationFaces) {
        if self.state == State::Clear {
            self.mesh_change
                .note(&mut self.near, &self.shape, self.at.centre, mesh, operation);
        }
    }

    /// The surface that it touches moves in this tick: beyond what keeps it outside and the device's own motion no point of
    /// it goes farther than `slide`, model units, until it has caught up.
    pub fn limit_step(&mut self, max_step: f64) {
        self.step_limit.tighten(max_step);
    }

    /// So far, model units, the coupling may be stretched without being felt; nothing until that is said.
    pub fn set_imperceptible(&mut self, imperceptible: f64) {
        self.imperceptible = imperceptible;
    }

    /// Whether it is behind since it was softened.
    #[must_use]
    pub fn is_behind(&self) -> bool {
        self.is_behind
    }

    /// One tick: as close to `goal` (the device, model units) as the surface lets it, at the cost of no more than `budget`
    /// pairs of nodes. What that leaves is done in the next ticks, from a safe place; the ending says so.
    pub fn advance(&mut self, surface: Surface<'_>, goal: &Pose, budget: u32) -> ToolAdvance {
        let mut answer = ToolAdvance::new();
        let Some(goal) = self.placement(goal) else {
            self.rejected += 1;
            answer.rejected = true;
            return answer;
        };
        if self.state == State::Nowhere {
            self.at = goal;
            self.goal = goal;
            self.state = State::Inside;
        }
        let travelled = self.goal.to(&goal).farthest(self.shape.radius);
        self.deflection = goal.to(&self.coupling_target);
        self.device_travel += travelled;
        self.goal = goal;
        let start = self.at;
        let mesh_change = self.mesh_change.take();
        if mesh_change.is_there() {
            self.update(surface, &mesh_change, budget, &mut answer);
            if mesh_change.may_have_met()
                && !self.depenetrate(surface, &mesh_change, budget, &mut answer)
            {
                // It stays until a tick can tell.
                self.mesh_change = mesh_change;
                self.stops.clear();
                self.coupling_target = self.target_allowed_by_contacts(&mut answer);
                self.limit_target_rate(travelled);
                return answer;
            }
        }
        match self.state {
            State::Clear => {
                self.take_steps(surface, &start, travelled, budget, &mut answer);
                self.limit_target_rate(travelled);
            }
            _ => {
                self.jump_when_clear(surface, budget, &mut answer);
                self.coupling_target = self.at;
                self.is_estimate = false;
            }
        }
        answer
    }

    /// Whether the tool meets the surface somewhere; `None` when the budget does not tell.
    fn meets(
        &mut self,
        surface: Surface<'_>,
        at: &Placement,
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> Option<bool> {
        self.put_tool(at);
        answer.spent += self.tool.faces() / FACES_MOVED;
        // Here a pair of nodes costs half; that pays for the pairs of faces to which they lead.
        let most = budget.saturating_sub(answer.spent);
        let (pair, ending, work) = first_pair(&surface, &self.tool, most, None);
        answer.work.add(work);
        answer.spent += work.node_pairs + TESTED * work.faces;
        if pair.is_none() && !ending.is_complete() {
            answer.ending = ending;
            return None;
        }
        Some(pair.is_some())
    }

    /// Whether the tool, which met nothing before, meets the surface where it is; `None` when the budget does not tell.
    fn meets_what_changed(
        &mut self,
        surface: Surface<'_>,
        mesh_change: &MeshChange,
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> Option<bool> {
        let (here, to_query) = (self.at, Similarity::new(self.pose_at(&self.at), self.scale));
        let (Some(changed), Some(to_query)) = (mesh_change.changed(), to_query) else {
            return self.meets(surface, &here, budget, answer);
        };
        let path = RelativePath::new([here.centre; 2], [here.rotation(); 2]);
        let (mut is_met, mut tested) = (false, 0);
        for &face in changed.iter().filter(|&&face| surface.has(face)) {
            let corners = surface.corners(face);
            let cost = for_each_face_near(&self.shape.blocks, &path, corners, 0.0, |own| {
                let corners_of_tool = self
                    .tool
                    .triangle(own)
                    .map(|v| self.tool.local_vertices()[v as usize]);
                tested += 1;
                is_met = triangle_pair(corners, corners_of_tool.map(|p| to_query.point(p))).meets();
                !is_met
            });
            answer.spent += cost;
            if is_met {
                break;
            }
        }
        answer.work.faces += tested;
        answer.spent += TESTED * tested;
        Some(is_met)
    }

    /// Moves the mesh to a placement.
    fn put_tool(&mut self, at: &Placement) {
        if let Some(to_query) = Similarity::new(self.pose_at(at), self.scale) {
            self.tool.place(&to_query);
        }
    }

    /// Goes to the device if the tool is clear of the surface there.
    fn jump_when_clear(&mut self, surface: Surface<'_>, budget: u32, answer: &mut ToolAdvance) {
        let goal = self.goal;
        let clear = self.meets(surface, &goal, budget, answer) == Some(false);
        if clear || self.state == State::Inside {
            self.at = goal;
            self.device_travel = 0.0;
        }
        if clear {
            self.state = State::Clear;
            self.invalidate();
            self.contacts.clear();
        }
    }

    /// After the surface has moved: where it meets the tool, the tool goes out on its side. False when the budget does not
    /// tell whether it does.
    fn depenetrate(
        &mut self,
        surface: Surface<'_>,
        mesh_change: &MeshChange,
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> bool {
        let here = self.at;
        match self.meets_what_changed(surface, mesh_change, budget, answer) {
            Some(true) => {}
            known => return known.is_some(),
        }
        for escape in mesh_change.escapes(self.static_offset(), self.moving_offset()) {
            let out = Placement {
                centre: here.centre + escape,
                ..here
            };
            match self.meets(surface, &out, budget, answer) {
                Some(true) => {}
                None => return false,
                Some(false) => {
                    self.near.spend(&out, &here.to(&out), self.shape.radius);
                    self.at = out;
                    return true;
                }
            }
        }
        self.state = State::Stuck;
        true
    }

    /// Whether the surface holds it back from the device, in contact or caught.
    #[must_use]
    pub fn is_blocked(&self) -> bool {
        matches!(self.state, State::Clear | State::Stuck) && self.coupling_target != self.goal
    }

    /// How far the coupling is stretched, in the metric of the tool's mass, model units. What the tool only has not had
    /// the time to go is no part of it.
    #[must_use]
    pub fn deflection(&self) -> f64 {
        self.length_of(&self.goal.to(&self.coupling_target))
    }

    /// Length of a motion in the metric of the tool's mass, model units.
    fn length_of(&self, motion: &Twist) -> f64 {
        let turned = motion.angular * self.shape.gyration;
        motion.linear.length().hypot(turned.length())
    }

    /// Force and torque of the coupling on the device, in the model's axes, the torque about the position of the
    /// device's pose. `velocity` is that of the device's position, metres and radians a second.
    #[must_use]
    pub fn wrench(&self, coupling: &Coupling, metres_per_unit: f64, velocity: &Twist) -> Wrench {
        if !self.is_blocked() {
            return Wrench::ZERO;
        }
        let deflection = self.goal.to(&self.coupling_target);
        let deflection = Twist {
            linear: deflection.linear * metres_per_unit,
            ..deflection
        };
        // From the tool's centre to the device's position.
        let arm = -(self.goal.orientation * self.shape.centre) * metres_per_unit;
        let velocity = Twist {
            linear: velocity.linear - velocity.angular.cross(arm),
            ..*velocity
        };
        let gyration = self.shape.gyration * metres_per_unit;
        about(&coupling.wrench(&deflection, &velocity, gyration), arm)
    }
}
