//! Errors, forces and bytes of each setting on the poses of the reference.

use super::knobs::{Beside, Variant};
use super::result::Point;
use crate::clocks::Clocks;
use crate::failure::Failure;
use crate::report::quantile::{Quantiles, median};
use crate::trajectory::reference::{Reference, come_to_rest};
use crate::trajectory::scene_model::SceneModel;
use crate::trajectory::virtual_scene::make_ready;
use glam::DVec3;
use hrtc::run::FIXED_BYTES;
use hrtc_core::Controller;
use hrtc_core::contact::query::{Surface, faces_within};
use hrtc_core::record::max_or_nan;
use scene::ScenePlan;
use simulator::InputRecording;
use spm::FileError;

/// Contacts of a setting whose exact distance is found a second time by looking at every face.
const BRUTE_CONTACTS: usize = 12;
/// Radius of the ball that stands for a tool, metres.
pub const TOOL_RADIUS_M: f64 = 0.005;
/// Contact ticks from one look at the tool's faces to the next.
const TOOL_EVERY: u64 = 16;
/// Rounding of exact distances, in shares of the model's diagonal: they are differences of
/// coordinates, in f64.
pub const ROUNDING: f64 = 1e-12;

/// A setting on its trajectory: what it gave, and its inputs for the timing.
#[derive(Debug)]
pub struct Measured {
    /// Everything but the times.
    pub point: Point,
    /// The inputs.
    pub recording: InputRecording,
    /// Ticks before the trajectory.
    pub start: usize,
    /// The plan.
    pub plan: ScenePlan,
    /// What no key of a scene sets.
    pub beside: Beside,
    /// Of each tick of the trajectory, whether the full mesh is touched.
    pub contact: Vec<bool>,
}

/// What is collected over the contacts of a setting.
#[derive(Debug, Default)]
struct Contacts {
    errors: Vec<f64>,
    certified: Vec<f64>,
    normals: Vec<f64>,
    forces: Vec<f64>,
    faces: Vec<f64>,
    tool_faces: Vec<f64>,
    tool_us: Vec<f64>,
    points: Vec<DVec3>,
}

/// Replays the trajectory at one setting.
///
/// # Errors
/// One sentence when the model cannot be served, or its file is damaged.
pub fn measure(
    model: &SceneModel,
    reference: &Reference,
    Variant {
        mut point,
        plan,
        beside,
    }: Variant,
) -> Result<Measured, Failure> {
    let damaged =
        |error: FileError| Failure::Input(format!("the model {}: {error}", model.mesh.name));
    let mut simulation = model.simulation(&plan)?;
    beside.set(simulation.controller_mut());
    simulation.client_mut().record();
    let scale = model.metres_per_unit;
    let period_ms = 1e3 / plan.loop_.rate_hz;
    let rounding = ROUNDING * model.diagonal_m();
    let ready = make_ready(&mut simulation)?;
    point.ready_ms = ready as f64 * period_ms;
    point.bytes_until_ready = simulation.client().mesh_bytes();
    let settled = come_to_rest(&mut simulation, reference.rest, ready)?;
    point.settled_ms = settled as f64 * period_ms;
    let start = simulation.tick() as usize;
    let clocks = Clocks::new();
    let mut all = Contacts::default();
    let mut before = reference.rest.pose.position;
    let mut energy = HeldEnergy::default();
    let mut stretches = Stretches::new(rounding);
    for (sample, exact) in reference.samples.iter().zip(&reference.ticks) {
        let outputs = simulation.step(Some(*sample));
        let (record, force) = (outputs.record, outputs.wrenches[0].force);
        let contact = outputs.contact();
        let moved = sample.pose.position - std::mem::replace(&mut before, sample.pose.position);
        point.energy_j += energy.add(force - exact.force, moved);
        let mesh_bytes = simulation.client().mesh_bytes();
        point.measured_m = max_or_nan(point.measured_m, record.measured_error_m);
        if contact.is_some() || exact.contact.is_some() {
            all.forces.push(force.distance(exact.force));
            all.faces.push(f64::from(record.active_faces));
        }
        if let Some(contact) = contact {
            let (_, closest) = model
                .mesh
                .file
                .closest_point(contact.point)
                .map_err(damaged)?;
            let error = closest.distance_squared.sqrt() * scale;
            point.contact_ticks += 1;
            point.contact_full_ticks += u64::from(record.contact_full);
            point.unbounded_ticks += u64::from(!record.contact_bounded);
            // What is no number is within nothing.
            let is_certified = error <= record.certified_error_m + rounding;
            point.over_certified_ticks += u64::from(!is_certified);
            stretches.add(contact.point * scale, error, record.certified_error_m);
            all.errors.push(error);
            all.certified.push(record.certified_error_m);
            all.points.push(contact.point);
            if record.contact_full && point.bytes_until_full == 0 {
                point.bytes_until_full = mesh_bytes;
            }
            if point.contact_ticks.is_multiple_of(TOOL_EVERY) {
                let (faces, us) = tool(simulation.controller(), contact.point, scale, clocks);
                all.tool_faces.push(faces);
                all.tool_us.push(us);
            }
        }
        if let (Some(ours), Some(theirs)) = (contact, exact.contact) {
            point.common_ticks += 1;
            let apart = ours.point.distance(theirs) * scale;
            point.contact_apart_m = max_or_nan(point.contact_apart_m, apart);
            let lengths = force.length() * exact.force.length();
            if lengths != 0.0 {
                // The angle of two nearly equal directions is lost in a cosine.
                let sine = force.cross(exact.force).length();
                all.normals
                    .push(sine.atan2(force.dot(exact.force)).to_degrees());
            }
        } else if contact.is_some() != exact.contact.is_some() {
            point.one_sided_ticks += 1;
        }
    }
    let last = simulation.outputs().record;
    point.bytes = simulation.client().mesh_bytes();
    point.vsps_received = last.vsps_received;
    let high_water = simulation.controller().bytes_high_water();
    point.cache_bytes = high_water as u64;
    point.rss_bytes = (high_water + FIXED_BYTES) as u64;
    point.replay_hash = simulation.controller().replay_hash() >> 11;
    fill(&mut point, &mut all);
    point.certified_over_true = stretches.ratios();
    point.certified_over_true_p50 = median(&point.certified_over_true);
    point.brute_apart_m = brute(model, &all.points).map_err(damaged)?;
    let recording = simulation
        .client_mut()
        .take_recording()
        .ok_or_else(|| Failure::Run("nothing was recorded".to_string()))?;
    Ok(Measured {
        point,
        recording,
        start,
        plan,
        beside,
        contact: reference
            .ticks
            .iter()
            .map(|tick| tick.contact.is_some())
            .collect(),
    })
}

/// Energy of forces that are held for a period: that of a tick acts over the motion to the next.
#[derive(Debug, Default)]
pub struct HeldEnergy {
    /// Of the tick before, newtons.
    held: DVec3,
}

impl HeldEnergy {
    /// What the force of the tick before did over the motion to this one, joules; this one's force,
    /// newtons, is held from now on. Over the first motion there is none.
    pub fn add(&mut self, force: DVec3, moved: DVec3) -> f64 {
        std::mem::replace(&mut self.held, force).dot(moved)
    }
}

/// Length of a stretch of the contact's path, metres.
const STRETCH_M: f64 = 0.01;

/// The largest errors of each stretch of the contact's path.
struct Stretches {
    rounding: f64,
    last: Option<DVec3>,
    length: f64,
    /// Largest true and certified error of this stretch.
    most: [f64; 2],
    ratios: Vec<f64>,
}

impl Stretches {
    fn new(rounding: f64) -> Self {
        Self {
            rounding,
            last: None,
            length: 0.0,
            most: [0.0; 2],
            ratios: Vec::new(),
        }
    }

    fn add(&mut self, at: DVec3, error: f64, certified: f64) {
        self.length += self.last.replace(at).map_or(0.0, |last| last.distance(at));
        self.most = [self.most[0].max(error), self.most[1].max(certified)];
        if self.length >= STRETCH_M {
            self.end();
        }
    }

    fn end(&mut self) {
        let [error, certified] = std::mem::take(&mut self.most);
        if error > self.rounding {
            self.ratios.push(certified / error);
        }
        self.length = 0.0;
    }

    fn ratios(mut self) -> Vec<f64> {
        self.end();
        self.ratios
    }
}

fn fill(point: &mut Point, all: &mut Contacts) {
    let errors = Quantiles::of(&mut all.errors);
    (point.true_m, point.true_p50_m) = (errors.max, errors.p50);
    let certified = Quantiles::of(&mut all.certified);
    (point.certified_m, point.certified_p50_m) = (certified.max, certified.p50);
    let normals = Quantiles::of(&mut all.normals);
    (point.normal_deg, point.normal_p50_deg) = (normals.max, normals.p50);
    let forces = Quantiles::of(&mut all.forces);
    (point.force_n, point.force_p50_n) = (forces.max, forces.p50);
    let faces = Quantiles::of(&mut all.faces);
    (point.faces_p50, point.faces_max) = (faces.p50, faces.max);
    point.tool_faces = Quantiles::of(&mut all.tool_faces).p50;
    point.tool_us = Quantiles::of(&mut all.tool_us).p50;
}

/// Faces of the front within a tool's radius of a contact, and the time to find them, µs: the least
/// of three, without what reading the clocks takes.
fn tool(controller: &Controller, at: DVec3, scale: f64, clocks: Clocks) -> (f64, f64) {
    let surface = Surface {
        mesh: controller.cache().mesh(),
        tree: controller.cache().tree(),
    };
    let reach = TOOL_RADIUS_M / scale;
    let mut best = f64::INFINITY;
    let mut faces = 0;
    for _ in 0..3 {
        let (ns, found) = clocks.time(|| {
            let mut found = 0_u32;
            faces_within(surface, at, reach, |_, _| {
                found += 1;
                reach
            });
            found
        });
        faces = found;
        best = best.min(ns * 1e-3);
    }
    (f64::from(faces), best)
}

/// The largest difference between exact distances from the file's boxes and from looking at every
/// face, m.
fn brute(model: &SceneModel, points: &[DVec3]) -> Result<f64, FileError> {
    let every = points.len().div_ceil(BRUTE_CONTACTS).max(1);
    let mut apart = 0.0_f64;
    for &point in points.iter().step_by(every) {
        let (_, closest) = model.mesh.file.closest_point(point)?;
        let brute = model.brute_distance(point);
        apart = max_or_nan(apart, (closest.distance_squared.sqrt() - brute).abs());
    }
    Ok(apart * model.metres_per_unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One newton along the first motion, two along the second, none along the third.
    #[test]
    fn a_force_does_its_work_over_the_motion_behind_its_tick() {
        let mut energy = HeldEnergy::default();
        let ticks = [(1.0, 0.5), (2.0, 0.1), (0.0, 0.2), (4.0, 0.3)];
        let parts = ticks.map(|(force, moved)| energy.add(DVec3::X * force, DVec3::X * moved));
        assert_eq!(parts, [0.0, 0.1, 0.4, 0.0]);
    }
}
