//! What there is to see in a tick: objects with their fronts, probes, contacts, forces.

use geometry::{Pose, closest_point_on_triangle};
use glam::DVec3;
use hrtc::recorder::Twin;
use hrtc::tick_record::TickRecord;
use hrtc_core::contact::tool::ToolMesh;
use hrtc_core::{ActiveObject, Controller, ModelFrame};
use scene::{ProbeShape, ScenePlan};
use spm::NONE;

/// How fine a face is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fineness {
    /// A face of the base mesh as it is.
    Base,
    /// A face with a refined corner.
    Refined,
    /// A face of the full mesh.
    Original,
}

/// A face of a front.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShownFace {
    /// Its corners in the world, metres.
    pub corners: [DVec3; 3],
    /// How fine it is.
    pub fineness: Fineness,
    /// Its certified error, metres; infinite where it is not known.
    pub certified_m: f64,
}

/// An object.
#[derive(Debug, Clone, PartialEq)]
pub struct ShownObject {
    /// Object of the scene.
    pub object: usize,
    /// Whether it has a front of its own now; else its base mesh is shown, or the box of its model.
    pub is_active: bool,
    /// Its faces.
    pub faces: Vec<ShownFace>,
}

/// A contact with a face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShownContact {
    /// Where, in the world, metres.
    pub point: DVec3,
    /// Normal of the face, of length 1.
    pub normal: DVec3,
}

/// A touch of a probe.
#[derive(Debug, Clone, PartialEq)]
pub struct Touch {
    /// Object of the scene.
    pub object: usize,
    /// The contact that holds the probe most; of a ball the others after it.
    pub contacts: Vec<ShownContact>,
    /// Depth of the device behind the proxy, metres.
    pub depth_m: f64,
    /// Certified error at the contact, metres; not a number without a bound.
    pub certified_m: f64,
    /// Whether every face that holds the probe is one of the full mesh.
    pub is_full: bool,
}

/// A probe.
#[derive(Debug, Clone, PartialEq)]
pub struct ShownProbe {
    /// The device; `None` where it gave no sample.
    pub device: Option<Pose>,
    /// The proxy at the object that it touches.
    pub proxy: Option<Pose>,
    /// The touch; `None` in free space.
    pub touch: Option<Touch>,
    /// Force on the hand, newtons.
    pub force: DVec3,
    /// Torque on the hand, newton metres.
    pub torque: DVec3,
}

impl ShownProbe {
    /// Where the probe is seen: its proxy, or the device where it touches nothing.
    #[must_use]
    pub fn position(&self) -> Option<DVec3> {
        Some(self.proxy.or(self.device)?.position)
    }
}

/// The body of a probe, about the device's position.
#[derive(Debug, Clone, PartialEq)]
pub enum Body {
    /// A ball of a radius, metres.
    Ball(f64),
    /// A tool, metres.
    Tool(ToolMesh),
}

impl Body {
    /// The body of a shape.
    #[must_use]
    pub fn new(shape: &ProbeShape) -> Self {
        match ToolMesh::of_shape(shape) {
            Some(mesh) => Self::Tool(mesh),
            None => Self::Ball(shape.extent_m()),
        }
    }
}

/// A tick as it is seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Moment {
    /// Time since the start of the run, seconds.
    pub seconds: f64,
    /// All objects of the scene whose model is known.
    pub objects: Vec<ShownObject>,
    /// All probes.
    pub probes: Vec<ShownProbe>,
}

impl Moment {
    /// The tick that the twin has just run.
    #[must_use]
    pub fn new(plan: &ScenePlan, record: &TickRecord, twin: &Twin) -> Self {
        let controller = twin.controller();
        let objects = 0..plan.objects.len();
        let objects = objects.filter_map(|k| {
            let frame = controller.frame_of(k)?;
            Some(shown_object(controller, k, &frame))
        });
        Self {
            seconds: record.tick as f64 / plan.loop_.rate_hz,
            objects: objects.collect(),
            probes: shown_probes(plan, record, twin),
        }
    }

    /// An object, when its model is known.
    #[must_use]
    pub fn object(&self, object: usize) -> Option<&ShownObject> {
        self.objects.iter().find(|of| of.object == object)
    }

    /// The probe with the greatest force among those that touch; without a touch the first.
    #[must_use]
    pub fn strongest(&self) -> usize {
        let touching = self.probes.iter().enumerate();
        let touching = touching.filter(|(_, probe)| probe.touch.is_some());
        let strongest = touching.max_by(|(_, a), (_, b)| {
            let [a, b] = [a, b].map(|probe| probe.force.length_squared());
            a.total_cmp(&b)
        });
        strongest.map_or(0, |(k, _)| k)
    }
}

/// An object in a frame: its own, or that without its pose.
#[must_use]
pub fn shown_object(controller: &Controller, object: usize, frame: &ModelFrame) -> ShownObject {
    let ready = controller.active_object(object).filter(|of| of.is_ready());
    ShownObject {
        object,
        is_active: ready.is_some(),
        faces: match ready {
            Some(active) => front_faces(active, frame),
            None => resting_faces(controller, object, frame),
        },
    }
}

/// The front of an active object.
fn front_faces(active: &ActiveObject, frame: &ModelFrame) -> Vec<ShownFace> {
    let mesh = active.cache().mesh();
    let mut faces = Vec::with_capacity(mesh.active_faces() as usize);
    mesh.for_each_active_face(|face| {
        let certified_m = f64::from(mesh.certified_error(face)) * frame.metres_per_unit;
        let mut corners = mesh.face(face).corners.iter();
        let is_base = corners.all(|&corner| mesh.creator_of_vertex(corner).is_none());
        faces.push(ShownFace {
            corners: mesh.corners(face).map(|corner| frame.to_world(corner)),
            fineness: match () {
                () if certified_m == 0.0 => Fineness::Original,
                () if is_base => Fineness::Base,
                () => Fineness::Refined,
            },
            certified_m,
        });
    });
    faces
}

/// The base mesh of an object that is not active, or its box.
fn resting_faces(controller: &Controller, object: usize, frame: &ModelFrame) -> Vec<ShownFace> {
    let kept = controller.kept_base_mesh(object);
    let Some((vertices, triangles)) = kept.or_else(|| box_of(controller, object)) else {
        return Vec::new();
    };
    let faces = triangles.iter().map(|corners| ShownFace {
        corners: corners.map(|corner| frame.to_world(vertices[corner as usize])),
        fineness: Fineness::Base,
        certified_m: f64::INFINITY,
    });
    faces.collect()
}

/// The box of an object's model, in stored coordinates.
fn box_of(controller: &Controller, object: usize) -> Option<(Vec<DVec3>, Vec<[u32; 3]>)> {
    const SIDES: [[u32; 4]; 6] = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let header = controller.header_of(object)?;
    let ends = [header.lower, header.upper].map(DVec3::from_array);
    let vertices = (0..8usize).map(|k| {
        let pick = |axis: usize| ends[k >> axis & 1][axis];
        DVec3::new(pick(0), pick(1), pick(2))
    });
    let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    let triangles = SIDES.into_iter().flat_map(halves);
    Some((vertices.collect(), triangles.collect()))
}

/// All probes after the tick that the twin has just run.
#[must_use]
pub fn shown_probes(plan: &ScenePlan, record: &TickRecord, twin: &Twin) -> Vec<ShownProbe> {
    let probes = 0..plan.probes.len();
    let shown = probes.map(|k| shown_probe(plan, twin.controller(), record, k));
    shown.collect()
}

fn shown_probe(
    plan: &ScenePlan,
    controller: &Controller,
    record: &TickRecord,
    probe: usize,
) -> ShownProbe {
    let is_ball = matches!(plan.probes[probe].shape, ProbeShape::Sphere { .. });
    let contact = record.contacts[probe];
    let core = &record.core.probes[probe];
    let touch = contact.and_then(|of| {
        let object = of.object as usize;
        let active = controller.active_object(object)?;
        let frame = active.frame()?;
        let mesh = active.cache().mesh();
        let main = of.contact.face;
        let others = of
            .contact
            .faces
            .iter()
            .filter(|&&face| is_ball && face != main);
        let held = [main].into_iter().chain(others.copied());
        let contacts = held.filter(|&face| face != NONE && mesh.is_active(face));
        let contacts = contacts.filter_map(|face| {
            let [a, b, c] = mesh.corners(face).map(|corner| frame.to_world(corner));
            let point = match controller.proxy_of(probe, object) {
                Some(center) if face != main => closest_point_on_triangle([a, b, c], center).point,
                _ => frame.to_world(of.contact.point),
            };
            let normal = (b - a).cross(c - a).try_normalize()?;
            Some(ShownContact { point, normal })
        });
        Some(Touch {
            object,
            contacts: contacts.collect(),
            depth_m: core.depth_m,
            certified_m: core.certified_error_m,
            is_full: core.contact_full,
        })
    });
    let object = contact.map(|of| of.object as usize);
    ShownProbe {
        device: record.samples[probe].map(|sample| sample.pose),
        proxy: object.and_then(|object| controller.proxy_pose_of(probe, object)),
        touch,
        force: record.wrenches[probe].force,
        torque: record.wrenches[probe].torque,
    }
}
