//! What there is to see in a tick, sent where it changed.

use super::super::legend::{DEVICE, NORMAL, PROXY};
use super::super::moment::{
    Body, Moment, ShownObject, ShownProbe, Touch, shown_object, shown_probes,
};
use super::super::sight::{Sight, half_width};
use super::layout::Eye;
use super::shapes::{FACE_BYTES, color, largest_error, mesh, point, rgb, transform};
use super::touch::Near;
use super::{TIMELINE, WORLD};
use geometry::Pose;
use glam::DVec3;
use hrtc::recorder::Twin;
use hrtc::tick_record::TickRecord;
use hrtc_core::contact::tool::ToolMesh;
use hrtc_core::{Controller, ModelFrame};
use picture::Color;
use rerun::components::FillMode;
use rerun::{
    Arrows3D, Boxes3D, Clear, Ellipsoids3D, LineStrips3D, Radius, RecordingStream,
    RecordingStreamResult,
};
use scene::{ProbeShape, ScenePlan};
use std::collections::{BTreeMap, BTreeSet};

/// Force on the hand.
const FORCE: Color = [250, 250, 250];
/// Cells asked for ahead, and those in which a touch is predicted.
const SUBSCRIBED: Color = [88, 92, 98];
const PREDICTED: Color = [250, 140, 40];
/// Width of the lines of cells, points of the screen.
const CELL_POINTS: f32 = 0.5;
/// Width of the lines of bodies, points of the screen.
const BODY_POINTS: f32 = 0.6;
/// Distance of the eye from the middle of the scene, diagonals of its box.
const EYE_DISTANCE: f64 = 1.0;
/// The force that the longest arrow stands for is the greatest one so far, and at least such a
/// share of the limit.
const LEAST_SCALE: f64 = 0.1;
/// Length of an arrow of the greatest force, and of a normal, as shares of the touched object.
const FORCE_SHARE: f64 = 0.8;
const NORMAL_SHARE: f64 = 0.1;
/// Radius of the shaft of an arrow, as a share of its greatest length.
const SHAFT: f64 = 0.02;

/// Boxes of cells: middles and halves of their sides.
type Cells = Vec<([f32; 3], [f32; 3])>;

/// An object as it was sent last.
struct Sent {
    /// Its faces in its own axes, metres.
    shown: ShownObject,
    pose: Pose,
    /// Subscribed cells, and those in which a touch is predicted.
    cells: [Cells; 2],
}

/// Lengths of arrows, metres.
#[derive(Debug, Clone, Copy)]
pub struct Arrows {
    /// Of the greatest force.
    pub force: f64,
    /// Of a normal.
    pub normal: f64,
}

/// All that is shown in space.
pub struct Space {
    /// The force of the longest arrow, newtons.
    scale_n: f64,
    bodies: Vec<Body>,
    sent: BTreeMap<usize, Sent>,
    /// Whether a part of a probe is seen now, by its entity.
    seen: BTreeMap<String, bool>,
    near: Near,
    /// From where the scene is seen, once something was touched: the touched side.
    pub eye: Option<Eye>,
}

impl Space {
    /// Nothing is sent yet. The limit of the force is in newtons.
    #[must_use]
    pub fn new(plan: &ScenePlan, force_max_n: f64) -> Self {
        Self {
            scale_n: LEAST_SCALE * force_max_n,
            bodies: plan.probes.iter().map(|of| Body::new(&of.shape)).collect(),
            sent: BTreeMap::new(),
            seen: BTreeMap::new(),
            near: Near::default(),
            eye: None,
        }
    }

    /// Shows the tick that the twin has just run; bytes of meshes sent.
    ///
    /// # Errors
    /// When the stream refuses.
    pub fn show(
        &mut self,
        stream: &RecordingStream,
        plan: &ScenePlan,
        record: &TickRecord,
        twin: &Twin,
    ) -> RecordingStreamResult<usize> {
        let seconds = record.tick as f64 / plan.loop_.rate_hz;
        stream.set_duration_secs(TIMELINE, seconds);
        let mut bytes = 0;
        for object in 0..plan.objects.len() {
            bytes += self.show_object(stream, twin.controller(), object)?;
        }
        let mut moment = Moment {
            seconds,
            objects: Vec::new(),
            probes: shown_probes(plan, record, twin),
        };
        for (k, probe) in moment.probes.iter().enumerate() {
            self.scale_n = self.scale_n.max(probe.force.length());
            let size = probe.touch.as_ref().map_or(0.0, |of| self.size(of.object));
            let arrows = Arrows {
                force: FORCE_SHARE * size,
                normal: NORMAL_SHARE * size,
            };
            self.show_probe(stream, &format!("{WORLD}/probe_{k}"), (k, probe), arrows)?;
        }
        let seen = self.near.probe(&moment);
        let touched = moment.probes[seen].touch.as_ref();
        if let Some(object) = touched.map(|of| of.object).or(self.near.object) {
            moment.objects.extend(self.placed(object));
        }
        let shape = &plan.probes[seen].shape;
        if self.eye.is_none() && moment.probes[seen].touch.is_some() {
            self.eye = Some(self.eye_of(&moment, seen, shape));
        }
        let (root, arrows, patch) = self.near.show(stream, &moment, seen, shape)?;
        self.show_probe(stream, root, (seen, &moment.probes[seen]), arrows)?;
        Ok(bytes + patch)
    }

    /// An object as it was sent last, in the world.
    fn placed(&self, object: usize) -> Option<ShownObject> {
        let sent = self.sent.get(&object)?;
        let mut shown = sent.shown.clone();
        for face in &mut shown.faces {
            face.corners = face.corners.map(|of| sent.pose.transform_point(of));
        }
        Some(shown)
    }

    /// All objects, seen from the side that a probe touches.
    fn eye_of(&self, moment: &Moment, probe: usize, shape: &ProbeShape) -> Eye {
        let probe = &moment.probes[probe];
        let sight = Sight::of_probe(moment, probe, half_width(moment, probe, shape));
        let objects = self.sent.values().flat_map(|of| {
            let corners = of.shown.faces.iter().flat_map(|face| face.corners);
            corners.map(|corner| of.pose.transform_point(corner))
        });
        let (low, high) = box_around(objects);
        let target = 0.5 * (low + high);
        Eye {
            position: target + EYE_DISTANCE * low.distance(high) * sight.eye,
            target,
            up: sight.up,
        }
    }

    /// The diagonal of an object's box, metres.
    fn size(&self, object: usize) -> f64 {
        let faces = self.sent.get(&object).map_or(&[][..], |of| &of.shown.faces);
        let (low, high) = box_around(faces.iter().flat_map(|face| face.corners));
        low.distance(high)
    }

    fn show_object(
        &mut self,
        stream: &RecordingStream,
        controller: &Controller,
        object: usize,
    ) -> RecordingStreamResult<usize> {
        let Some(frame) = controller.frame_of(object) else {
            return Ok(0);
        };
        let path = format!("{WORLD}/object_{object}");
        let before = self.sent.get(&object);
        let is_active = controller
            .active_object(object)
            .is_some_and(|of| of.is_ready());
        // A mesh at rest is the base mesh as it was.
        let is_at_rest = before.is_some_and(|of| !of.shown.is_active && !is_active);
        let shown = match before {
            Some(of) if is_at_rest => of.shown.clone(),
            _ => shown_object(controller, object, &in_own_axes(&frame)),
        };
        let mut bytes = 0;
        if before.is_none_or(|of| of.shown != shown) {
            bytes = shown.faces.len() * FACE_BYTES;
            let largest = largest_error(&shown.faces);
            let faces = shown.faces.iter();
            let faces = faces.map(|face| (face.corners, color(face, largest)));
            stream.log(format!("{path}/mesh"), &mesh(faces))?;
        }
        if before.is_none_or(|of| of.pose != frame.pose) {
            stream.log(path.as_str(), &transform(&frame.pose))?;
        }
        let cells = cells(controller, object, &in_own_axes(&frame));
        let kinds = [("subscribed", SUBSCRIBED), ("predicted", PREDICTED)];
        for (k, (name, color)) in kinds.into_iter().enumerate() {
            let were = before.map_or(&[][..], |of| &of.cells[k]);
            if were != cells[k] {
                let (middles, halves): (Vec<_>, Vec<_>) = cells[k].iter().copied().unzip();
                let boxes = Boxes3D::from_centers_and_half_sizes(middles, halves)
                    .with_colors([rgb(color)])
                    .with_radii([Radius::new_ui_points(CELL_POINTS)])
                    .with_fill_mode(FillMode::MajorWireframe);
                stream.log(format!("{path}/{name}"), &boxes)?;
            }
        }
        let pose = frame.pose;
        self.sent.insert(object, Sent { shown, pose, cells });
        Ok(bytes)
    }

    /// A probe below an entity: device, proxy, force and normals.
    fn show_probe(
        &mut self,
        stream: &RecordingStream,
        root: &str,
        (k, probe): (usize, &ShownProbe),
        arrows: Arrows,
    ) -> RecordingStreamResult<()> {
        let poses = [("device", &probe.device), ("proxy", &probe.proxy)];
        for (name, pose) in poses {
            self.show_body(stream, format!("{root}/{name}"), k, pose.as_ref())?;
        }
        let names = ["force", "normal"].map(|name| format!("{root}/{name}"));
        let Some(touch) = &probe.touch else {
            for name in names {
                if self.seen.insert(name.clone(), false) == Some(true) {
                    stream.log(name, &Clear::flat())?;
                }
            }
            return Ok(());
        };
        for name in &names {
            self.seen.insert(name.clone(), true);
        }
        let [force, normal] = names;
        stream.log(force, &self.force(probe, touch, arrows))?;
        stream.log(normal, &normals(touch, arrows))
    }

    fn force(&self, probe: &ShownProbe, touch: &Touch, arrows: Arrows) -> Arrows3D {
        let first = touch.contacts.first().map(|of| of.point);
        let at = first.or(probe.position()).unwrap_or_default();
        let vector = probe.force / self.scale_n * arrows.force;
        Arrows3D::from_vectors([point(vector)])
            .with_origins([point(at)])
            .with_radii([(SHAFT * arrows.force) as f32])
            .with_colors([rgb(FORCE)])
            .with_labels([format!("{:.2} N", probe.force.length())])
    }

    /// The body of a probe, sent when it appears, and moved.
    fn show_body(
        &mut self,
        stream: &RecordingStream,
        path: String,
        k: usize,
        pose: Option<&Pose>,
    ) -> RecordingStreamResult<()> {
        let was_seen = self.seen.insert(path.clone(), pose.is_some());
        let Some(pose) = pose else {
            return match was_seen {
                Some(true) => stream.log(path, &Clear::flat()),
                _ => Ok(()),
            };
        };
        stream.log(path.as_str(), &transform(pose))?;
        if was_seen == Some(true) {
            return Ok(());
        }
        let is_proxy = path.ends_with("proxy");
        let color = if is_proxy { PROXY } else { DEVICE };
        match &self.bodies[k] {
            Body::Ball(radius) => {
                let fill = if is_proxy {
                    FillMode::DenseWireframe
                } else {
                    FillMode::Solid
                };
                let ball = Ellipsoids3D::from_radii([*radius as f32])
                    .with_colors([rgb(color)])
                    .with_line_radii([Radius::new_ui_points(BODY_POINTS)])
                    .with_fill_mode(fill);
                stream.log(path, &ball)
            }
            // Lines too: the force begins within it.
            Body::Tool(tool) => stream.log(path, &tool_edges(tool).with_colors([rgb(color)])),
        }
    }
}

/// Each edge of a tool once.
fn tool_edges(tool: &ToolMesh) -> LineStrips3D {
    let sides = |[a, b, c]: [u32; 3]| [(a, b), (b, c), (c, a)];
    let all = tool.triangles.iter().flat_map(|&corners| sides(corners));
    let edges: BTreeSet<_> = all.map(|(a, b)| (a.min(b), a.max(b))).collect();
    let corner = |v: u32| point(tool.positions[v as usize]);
    LineStrips3D::new(edges.into_iter().map(|(a, b)| [corner(a), corner(b)]))
        .with_radii([Radius::new_ui_points(BODY_POINTS)])
}

/// Least and greatest coordinates of points.
fn box_around(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    let ends = points.map(|at| (at, at));
    let ends = ends.reduce(|(low, high), (at, _)| (low.min(at), high.max(at)));
    ends.unwrap_or_default()
}

/// The frame of a model in its object's own axes, metres.
fn in_own_axes(frame: &ModelFrame) -> ModelFrame {
    ModelFrame {
        pose: Pose::IDENTITY,
        ..*frame
    }
}

fn normals(touch: &Touch, arrows: Arrows) -> Arrows3D {
    let contacts = touch.contacts.iter();
    Arrows3D::from_vectors(contacts.map(|of| point(arrows.normal * of.normal)))
        .with_origins(touch.contacts.iter().map(|of| point(of.point)))
        .with_radii([(0.5 * SHAFT * arrows.force) as f32])
        .with_colors([rgb(NORMAL)])
}

/// Cells of an active object: those that were asked for ahead only, and those to be refined.
fn cells(controller: &Controller, object: usize, frame: &ModelFrame) -> [Cells; 2] {
    let mut cells: [Cells; 2] = Default::default();
    let active = controller.active_object(object).filter(|of| of.is_ready());
    let (Some(active), Some(header)) = (active, controller.header_of(object)) else {
        return cells;
    };
    let regions = &active.cache().regions;
    for region in regions.indices().map(|index| regions.at(index)) {
        let Some(tolerance) = region.key.tolerance() else {
            continue;
        };
        let grid = header.grid_of(tolerance);
        if grid.contains(region.key.id) {
            let (low, high) = grid.cell_box(region.key.id);
            let middle = frame.to_world(0.5 * (low + high));
            let half = 0.5 * (high - low) * frame.metres_per_unit;
            cells[usize::from(region.wanted)].push((point(middle), point(half)));
        }
    }
    cells
}
