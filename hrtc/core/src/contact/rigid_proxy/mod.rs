//! The proxy (god-object) of a rigid tool: the pose that the tool would have if it could not enter
//! the object, in six degrees of freedom.
//!
//! The motion from the proxy to the device is projected onto the motions that the contacts allow
//! ([`projection`]). The metric is that of the tool's mass, so that a rotation weighs as much as
//! the displacement of the tool's surface that it causes. The proxy then moves along the projected
//! motion until the first pair of faces stops it (`sweep`): the constraint-based method of Ortega
//! 2007. No threshold is an absolute length; all are fractions of the tool's size.
//!
//! Contacts act at a contact offset of half a step of the device's encoder, between 1e-4 and 1e-3
//! of the tool's radius of gyration; the sweep stops at half of it. So a resting contact does not
//! stop a sweep, and every crossing does. The tool feels thicker by the contact offset. While the
//! surface moves under the tool, the offset is as large as the motion that the surface may make in
//! a tick.
//!
//! | file | content |
//! |---|---|
//! | `shape` | the tool's mesh about its centre |
//! | `bounding_balls` | balls that bound it |
//! | `look_ahead` | how far ahead candidates are collected |
//! | `look_ahead_tube` | the motion and the margin for which candidate pairs are known |
//! | `neighbourhood` | candidate pairs of faces, collected once and reused (Verlet list) |
//! | `contacts` | local minima of the distance |
//! | `projection` | the quadratic program |
//! | `sweep` | conservative advancement |
//! | `steps` | the steps of a tick |
//! | `look` | the contacts that a step obeys |
//! | `coupling_target` | the end of the coupling, and how far it may go in a tick |
//! | `mesh_change` | faces that splits and collapses moved near the tool |
//! | `nearest` | the nearest points of tool and surface, for what acts before they touch |
//! | `answer` | the result of a tick |

mod answer;
mod bounding_balls;
mod contacts;
mod coupling_target;
mod depenetration;
mod look;
mod look_ahead;
mod look_ahead_tube;
mod mesh_change;
mod nearest;
mod neighbourhood;
pub mod projection;
mod shape;
mod steps;
mod sweep;
#[cfg(test)]
mod tests;

pub use answer::ToolAdvance;
pub use bounding_balls::MAX_BALLS;
pub use contacts::ToolContact;
pub use coupling_target::Imperceptible;
pub use nearest::NearestPair;
pub use neighbourhood::{MAX_PAIRS, MAX_SURFACE_FACES};
pub use shape::ToolProxyError;
pub use steps::StepSettings;

use crate::contact::coupling::{Coupling, about};
use crate::contact::motion::{Placement, Twist};
use crate::contact::query::{Limit, Surface};
use crate::contact::tool::Tool;
use bounding_balls::{Ball, bounding_balls};
use contacts::Contacts;
use coupling_target::Estimate;
use depenetration::EscapesTried;
use geometry::portable::hypot;
use geometry::{BoxPair, Pose, Wrench};
use glam::DVec3;
use look_ahead::LookAhead;
use mesh_change::{MeshChange, operation_meets_ball};
use neighbourhood::Neighbourhood;
use projection::{HalfSpace, MAX_HALF_SPACES};
use shape::ToolShape;
use spm::{ActiveMesh, Handle, OperationFaces};
use steps::MAX_STOPS;
use sweep::Open;

/// Contact offset while the surface moves, at most, as a fraction of the imperceptible change of a
/// deflection: twice the share of one geomorphing vertex (see [`crate::perception`]), since several
/// may move one face.
const MOVING_OFFSET: f64 = 0.625;
/// Share of that which is left a tick after the surface has come to rest.
const OFFSET_LEFT: f64 = 0.5;

/// A ball around a part of a probe; model frame and units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Centre with the tool at the proxy.
    pub centre: DVec3,
    /// Centre with the tool at the device.
    pub goal: DVec3,
    /// Radius.
    pub radius: f64,
}

/// State of the proxy with respect to the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
enum State {
    /// Not placed yet.
    Nowhere,
    /// Placed, but not known to be clear of the surface: it moves with the device, without force.
    Inside,
    /// No face of the tool meets the surface.
    Clear,
    /// The surface moved into the tool or over it, and no way out was found, or more faces are near
    /// than there is room for: it stays.
    Stuck,
}

/// The proxy of a tool, in the frame and units of the model. Nothing allocates after
/// [`ToolProxy::new`].
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct ToolProxy {
    tool: Tool,
    scale: f64,
    settings: StepSettings,
    shape: ToolShape,
    balls: Vec<Ball>,
    near: Neighbourhood,
    contacts: Contacts,
    half_spaces: Vec<HalfSpace>,
    /// Pairs that stopped a step of this tick.
    stops: Vec<usize>,
    /// Pairs that the sweep examines more than once.
    open: Vec<Open>,
    mesh_change: MeshChange,
    /// Advance of the surface towards the tool that is expected in a tick, by that of late, model
    /// units. Contacts act at this distance, so that the surface pushes the tool instead of meeting
    /// it.
    moving_offset: f64,
    state: State,
    /// Whether it was placed, and has not begun there yet.
    is_placed_anew: bool,
    /// Where the surface has carried the tool's anchor, if it has passed over it; see
    /// `depenetration`.
    carried_anchor: Option<DVec3>,
    /// Of a depenetration that takes several ticks.
    escapes_tried: Option<EscapesTried>,
    /// Of a jump that takes several ticks to decide: where to.
    jump_to: Option<Placement>,
    /// The normal of the face that the tool was found to meet last, on the side of its anchor.
    met_on: DVec3,
    at: Placement,
    goal: Placement,
    /// End of the coupling.
    coupling_target: Placement,
    /// Deflection of the coupling with the device of this tick and the target of the last.
    deflection: Twist,
    /// What this tick estimates, if it ends early.
    estimate: Option<Estimate>,
    /// That of the last tick.
    assumed: Option<Estimate>,
    /// What a hand cannot perceive of the coupling.
    imperceptible: Imperceptible,
    /// How far ahead candidates are collected.
    look_ahead: LookAhead,
    /// Whether the last collection has not been used by a step: the step comes before a new
    /// collection.
    has_unused_collection: bool,
    /// Whether the last tick had no time for all of its first step: this one goes on with it.
    has_unfinished_step: bool,
    /// Largest motion of the device in a tick since the proxy last reached it, model units.
    pace: f64,
    /// Total motion of the device since the proxy last reached it, model units.
    device_travel: f64,
    /// Cost of the last step, in node pairs: what the next one is expected to cost.
    step_cost: u32,
    rejected: u64,
}

impl ToolProxy {
    /// A proxy of a tool, not placed yet. `scale`: model units per unit of the tool.
    ///
    /// # Errors
    /// If tool or scale give no length.
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
            moving_offset: 0.0,
            state: State::Nowhere,
            carried_anchor: None,
            escapes_tried: None,
            jump_to: None,
            met_on: DVec3::ZERO,
            at: nowhere,
            goal: nowhere,
            coupling_target: nowhere,
            deflection: Twist::default(),
            estimate: None,
            assumed: None,
            imperceptible: Imperceptible::NOTHING,
            look_ahead: LookAhead::new(shape.gyration),
            is_placed_anew: false,
            has_unused_collection: false,
            has_unfinished_step: false,
            pace: 0.0,
            device_travel: 0.0,
            step_cost: 0,
            rejected: 0,
            tool,
            scale,
            settings: StepSettings::PRODUCT,
            shape,
        })
    }

    /// Restarts, not placed yet, for a model of another scale. Allocates nothing.
    ///
    /// # Errors
    /// If the scale gives no length.
    pub fn begin(&mut self, scale: f64) -> Result<(), ToolProxyError> {
        if !(scale.is_normal() && scale > 0.0) {
            return Err(ToolProxyError::NoExtent);
        }
        // All of the tool is gone through: not again for each object of the same scale.
        if scale != self.scale {
            self.shape.rescale(&self.tool, scale);
            self.scale = scale;
        }
        if !(self.shape.gyration.is_normal() && self.shape.radius.is_finite()) {
            return Err(ToolProxyError::NoExtent);
        }
        self.invalidate();
        self.mesh_change = MeshChange::new();
        self.moving_offset = 0.0;
        self.state = State::Nowhere;
        self.is_placed_anew = false;
        self.carried_anchor = None;
        // It is in the units of the model before.
        self.imperceptible = Imperceptible::NOTHING;
        self.contacts.clear();
        self.look_ahead = LookAhead::new(self.shape.gyration);
        self.pace = 0.0;
        self.device_travel = 0.0;
        self.step_cost = 0;
        self.estimate = None;
        Ok(())
    }

    /// Steps with other settings from now on, to compare them.
    pub fn set_steps(&mut self, settings: StepSettings) {
        self.settings = settings;
    }

    /// Whether the proxy has been placed.
    #[must_use]
    pub fn is_placed(&self) -> bool {
        self.state != State::Nowhere
    }

    /// Pose of the tool's own frame, model units.
    #[must_use]
    pub fn pose(&self) -> Pose {
        self.pose_at(&self.at)
    }

    /// Balls that together bound the tool, with their centres at the proxy and at a pose of the
    /// device; model units.
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

    /// Whether an event within a box (model frame and units) may be near the tool. True if unknown.
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

    /// Centre of the tool's surface at the proxy, model units: contacts have their arms from there.
    #[must_use]
    pub fn centre(&self) -> DVec3 {
        self.at.centre
    }

    /// Distance at which contacts act, model units. The tool feels thicker by this; more while the
    /// surface moves.
    #[must_use]
    pub fn contact_offset(&self) -> f64 {
        self.static_offset().max(self.moving_offset)
    }

    /// Contact offset on a surface that does not move, model units: the quantization error of the
    /// device's position, if that is neither too small nor too large for the tool.
    #[must_use]
    pub fn static_offset(&self) -> f64 {
        let gyration = self.shape.gyration;
        let [least, most] = self.settings.contact_offset.map(|of| of * gyration);
        // Not `clamp`, which has a panic.
        self.imperceptible.quantization.max(least).min(most)
    }

    /// Number of invalid poses so far.
    #[must_use]
    pub fn rejected(&self) -> u64 {
        self.rejected
    }

    /// Largest number of face pairs, of faces of the surface and of contacts in a step, each with
    /// its capacity.
    #[must_use]
    pub fn high_water(&self) -> [(usize, usize); 3] {
        let [pairs, faces] = self.near.high_water();
        [
            (pairs, MAX_PAIRS),
            (faces, MAX_SURFACE_FACES),
            (self.contacts.high_water(), MAX_HALF_SPACES),
        ]
    }

    /// Lower bound of the distance to the surface, model units, from what the last tick examined.
    #[must_use]
    pub fn clearance(&self) -> f64 {
        self.near.clearance(&self.shape)
    }

    /// All pairs of faces nearer than this are among [`ToolProxy::known_pairs`], model units;
    /// negative if nothing is known.
    #[must_use]
    pub fn known_margin(&self) -> f64 {
        self.near.tube.left()
    }

    /// Candidate pairs: a face of the surface and a face of the tool.
    pub fn known_pairs(&self) -> impl Iterator<Item = (Handle, u32)> + '_ {
        self.near.handles()
    }

    fn pose_at(&self, at: &Placement) -> Pose {
        Pose {
            position: at.centre - at.orientation * self.shape.centre,
            orientation: at.orientation,
        }
    }

    /// `None` for an invalid pose.
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

    /// Places the proxy without a sweep; the next [`Self::advance`] goes from there to the device.
    /// If it meets the surface there, it moves with the device until it is clear. False for an
    /// invalid pose.
    pub fn place(&mut self, pose: &Pose) -> bool {
        let Some(at) = self.placement(pose) else {
            self.rejected += 1;
            return false;
        };
        self.at = at;
        self.goal = at;
        self.coupling_target = at;
        self.state = State::Inside;
        self.is_placed_anew = true;
        self.carried_anchor = None;
        self.jump_to = None;
        self.mesh_change = MeshChange::new();
        self.invalidate();
        true
    }

    /// Notes a split or collapse that was just performed. Candidate pairs near it are updated; if
    /// the surface moved into the tool, the next tick depenetrates it on the side where it was.
    pub fn carry(&mut self, mesh: &ActiveMesh, operation: &OperationFaces) {
        let (centre, radius) = (self.at.centre, self.shape.radius);
        if self.state == State::Nowhere {
            return;
        }
        if self.state == State::Inside {
            // It has a side only where it was placed.
            if self.is_placed_anew && self.carry_anchor(mesh, operation) {
                (self.is_placed_anew, self.carried_anchor) = (false, None);
            }
            self.mesh_change
                .note(&mut self.near, &self.shape, centre, mesh, operation);
            return;
        }
        // The pairs around where it may jump to do not tell what is near a tool that is stuck here.
        let is_elsewhere = self.jump_to.is_some();
        if is_elsewhere && operation_meets_ball(mesh, operation, centre, radius) {
            self.near.invalidate_all();
        }
        let is_carried = self.carry_anchor(mesh, operation);
        self.mesh_change
            .note(&mut self.near, &self.shape, centre, mesh, operation);
        if is_carried {
            self.mesh_change
                .passed_over_anchor(mesh.displacement(operation));
        }
    }

    /// Sets what a hand cannot perceive of the coupling, or the device cannot tell; nothing before
    /// the first call.
    pub fn set_imperceptible(&mut self, imperceptible: Imperceptible) {
        self.imperceptible = imperceptible;
    }

    /// One tick: as close to `goal` (the device, model units) as the surface allows, at a cost of
    /// at most `limit` node pairs. The next ticks do the remaining work, from a safe placement;
    /// the ending says so.
    pub fn advance<'a>(
        &mut self,
        surface: Surface<'_>,
        goal: &Pose,
        limit: impl Into<Limit<'a>>,
    ) -> ToolAdvance {
        let mut limit = limit.into();
        let budget = limit.max_work();
        let mut answer = ToolAdvance::new();
        let Some(goal) = self.placement(goal) else {
            self.rejected += 1;
            answer.rejected = true;
            return answer;
        };
        let motion = self.lead_to(goal);
        let travelled = motion.farthest(self.shape.radius);
        let mesh_change = self.mesh_change.take();
        let most = self.imperceptible_change(self.length_of(&self.deflection));
        let moving = mesh_change.expected_push(MOVING_OFFSET * most);
        self.moving_offset = moving.max(OFFSET_LEFT * self.moving_offset);
        if mesh_change.is_there() {
            let first_changed = if mesh_change.is_new() {
                let first_changed = self.update(surface, &mesh_change, budget, &mut answer);
                limit.begin_after(answer.spent);
                first_changed
            } else {
                None
            };
            // Before it is clear, it has no side.
            let may_have_met = self.state != State::Inside
                && (mesh_change.may_have_met() || self.carried_anchor.is_some());
            let known = (&mesh_change, first_changed);
            if may_have_met && !self.depenetrate(surface, known, &mut limit, &mut answer) {
                // The proxy stays until a tick can decide.
                self.mesh_change = mesh_change.kept();
                self.stops.clear();
                answer.is_stuck = self.state == State::Stuck;
                self.coupling_target = match self.state {
                    State::Stuck => self.at,
                    _ => self.target_allowed_by_contacts(&mut answer),
                };
                self.limit_change(&motion);
                return answer;
            }
        }
        answer.is_stuck = self.state == State::Stuck;
        let is_placed_anew = self.state == State::Inside && self.is_placed_anew;
        if is_placed_anew && !self.begin_where_placed(surface, &mut limit, &mut answer) {
            // No force until then.
            self.coupling_target = self.goal;
            return answer;
        }
        match self.state {
            State::Clear => {
                let limit = limit.part(0, budget);
                self.take_steps(surface, travelled, limit, &mut answer);
                self.limit_change(&motion);
            }
            _ => {
                let had_force = self.state == State::Stuck;
                self.jump_when_clear(surface, &mut limit, &mut answer);
                self.coupling_target = if had_force { self.at } else { self.goal };
                self.limit_change(&motion);
            }
        }
        debug_assert!(answer.spent <= budget);
        answer
    }

    /// Begins a tick in which the device is there. Returns its motion.
    fn lead_to(&mut self, goal: Placement) -> Twist {
        if self.state == State::Nowhere {
            self.at = goal;
            self.goal = goal;
            self.coupling_target = goal;
            self.state = State::Inside;
        }
        let motion = self.goal.to(&goal);
        self.deflection = goal.to(&self.coupling_target);
        self.assumed = self.estimate.take();
        self.device_travel += motion.farthest(self.shape.radius);
        self.goal = goal;
        motion
    }

    /// Whether the surface keeps the proxy from the device, in contact or stuck.
    #[must_use]
    pub fn is_blocked(&self) -> bool {
        matches!(self.state, State::Clear | State::Stuck) && self.coupling_target != self.goal
    }

    /// Deflection of the coupling in the metric of the tool's mass, model units. Proxy lag from a
    /// tick that stopped early is not part of it.
    #[must_use]
    pub fn deflection(&self) -> f64 {
        self.length_of(&self.goal.to(&self.coupling_target))
    }

    /// Motion of the tool's centre from the device to the proxy, model units.
    #[must_use]
    pub fn penetration(&self) -> Twist {
        self.goal.to(&self.at)
    }

    /// Length of a motion in the metric of the tool's mass, model units.
    fn length_of(&self, motion: &Twist) -> f64 {
        let turned = motion.angular * self.shape.gyration;
        hypot(motion.linear.length(), turned.length())
    }

    /// From the tool's centre to the device's position, with the tool at the device; model units.
    #[must_use]
    pub fn device_arm(&self) -> DVec3 {
        -(self.goal.orientation * self.shape.centre)
    }

    /// Force and torque of the coupling on the device, in the model's axes, the torque about the
    /// device's position. `velocity` is that of the device's position, metres and radians per
    /// second.
    #[must_use]
    pub fn wrench(&self, coupling: &Coupling, metres_per_unit: f64, velocity: &Twist) -> Wrench {
        let [wrench, _] = self.wrenches(coupling, metres_per_unit, velocity);
        wrench
    }

    /// The same with damping, and of the spring alone.
    #[must_use]
    pub fn wrenches(
        &self,
        coupling: &Coupling,
        metres_per_unit: f64,
        velocity: &Twist,
    ) -> [Wrench; 2] {
        if !self.is_blocked() {
            return [Wrench::ZERO; 2];
        }
        let deflection = self.goal.to(&self.coupling_target);
        let deflection = Twist {
            linear: deflection.linear * metres_per_unit,
            ..deflection
        };
        let arm = self.device_arm() * metres_per_unit;
        let velocity = Twist {
            linear: velocity.linear - velocity.angular.cross(arm),
            ..*velocity
        };
        let gyration = self.shape.gyration * metres_per_unit;
        let wrenches = coupling.wrenches(&deflection, &velocity, gyration);
        wrenches.map(|wrench| about(&wrench, arm))
    }
}
