//! What is looked at every hundredth tick, against the models by brute force: fronts, boxes,
//! certified errors, proxies.

use super::library::{Library, Version};
use super::trace::{Checked, ensure};
use glam::DVec3;
use hrtc_core::ActiveObject;
use scene::{ProbeShape, ScenePlan};
use simulator::{Client, Random, refined_front};
use spm::OperationFaces;

/// Faces whose certified error is compared with sampled distances.
const FACES: usize = 24;
/// Points on each.
const POINTS: usize = 3;
/// Rounding error of a distance, in diagonals of the model; see `rt-tests fronts`.
const ROUNDING: f64 = 1e-13;
/// Share of its radius by which a ball's proxy may lie in the surface: its step ends within it.
const PROXY_DEPTH: f64 = 1e-3;

/// What may be believed of a controller.
#[derive(Debug, Clone, Copy)]
pub struct Belief {
    /// No chunk was damaged: what it holds is what the station has.
    pub is_true: bool,
}

/// All of it.
///
/// # Errors
/// The first check that does not hold.
///
/// # Panics
/// When an invariant of a cache does not hold.
pub fn check(
    client: &Client,
    plan: &ScenePlan,
    library: &Library,
    belief: Belief,
    random: &mut Random,
) -> Checked {
    let controller = client.controller();
    for capacity in controller.capacities() {
        ensure(
            capacity.high_water <= capacity.capacity,
            "capacities",
            || format!("{capacity:?}"),
        )?;
    }
    for object in controller.active_objects() {
        if !object.is_ready() {
            continue;
        }
        // Mesh, tree and its boxes, reference counts, queues.
        object.cache().check();
        let header = object
            .object()
            .and_then(|of| controller.header_of(of as usize));
        let version = header.and_then(|header| library.by_hash(header.model));
        let Some(version) = version.filter(|_| belief.is_true) else {
            continue;
        };
        front_is_legal(object, version)?;
        errors_are_certified(object, version, random)?;
    }
    if belief.is_true {
        proxies_are_outside(client, plan, library)?;
    }
    Ok(())
}

/// The splits of a front are legal one after another from the base mesh on, and give its faces.
fn front_is_legal(object: &ActiveObject, version: &Version) -> Checked {
    let mesh = object.cache().mesh();
    let base_faces = version.model.file.model_header().base_faces;
    let mut fresh = version.model.active_mesh();
    let mut out = OperationFaces::new();
    for id in refined_front(object.cache()) {
        ensure(fresh.split_is_legal(id), "front legal", || {
            format!("split {id} is not legal in ascending order")
        })?;
        let done = fresh.split(id, &mut out);
        ensure(done.is_ok(), "front legal", || {
            format!("split {id}: {done:?}")
        })?;
    }
    let mut expected = Vec::new();
    fresh.for_each_active_face(|face| expected.push(face));
    let mut found = Vec::new();
    mesh.for_each_active_face(|face| {
        found.push(mesh.creator_of_face(face).map_or(face, |slot| {
            base_faces + 2 * mesh.id(slot) + (face - mesh.fl(slot))
        }));
    });
    expected.sort_unstable();
    found.sort_unstable();
    ensure(expected == found, "front legal", || {
        format!(
            "{} faces, and {} by its splits",
            found.len(),
            expected.len()
        )
    })
}

/// Points of random faces are as near to the full mesh as their certified error says.
fn errors_are_certified(object: &ActiveObject, version: &Version, random: &mut Random) -> Checked {
    let mesh = object.cache().mesh();
    let diagonal = version.model.file.model_header().diagonal;
    let mut faces = Vec::new();
    mesh.for_each_active_face(|face| faces.push(face));
    for _ in 0..FACES.min(faces.len()) {
        let face = faces[random.below(faces.len() as u64) as usize];
        let bound = f64::from(mesh.certified_error(face));
        let [a, b, c] = mesh.corners(face);
        for _ in 0..POINTS {
            let (u, v) = (random.unit(), random.unit());
            let (u, v) = if u + v > 1.0 {
                (1.0 - u, 1.0 - v)
            } else {
                (u, v)
            };
            let point = a + (b - a) * u + (c - a) * v;
            let near = version.full.nearest(point, 0);
            ensure(
                near.distance <= bound * (1.0 + 1e-12) + ROUNDING * diagonal,
                "certified error",
                || format!("face {face}: {} away, {bound} certified", near.distance),
            )?;
        }
    }
    Ok(())
}

/// A ball that rests at full resolution has its proxy outside of the full mesh.
fn proxies_are_outside(client: &Client, plan: &ScenePlan, library: &Library) -> Checked {
    let (controller, outputs) = (client.controller(), client.outputs());
    if outputs.record.geomorphing > 0 || outputs.record.unfinished > 0 {
        return Ok(());
    }
    for (k, probe) in plan.probes.iter().enumerate() {
        let ProbeShape::Sphere { radius_m } = probe.shape else {
            continue;
        };
        let Some(contact) = outputs.contacts[k].filter(|_| outputs.record.probes[k].contact_full)
        else {
            continue;
        };
        let object = contact.object as usize;
        let (Some(proxy), Some(frame), Some(header)) = (
            controller.proxy_of(k, object),
            controller.frame_of(object),
            controller.header_of(object),
        ) else {
            continue;
        };
        let Some(version) = library.by_hash(header.model).filter(|of| of.is_closed) else {
            continue;
        };
        let centre = frame.to_model(proxy);
        ensure(
            winding(version.full.triangles(), centre).abs() < 0.5,
            "proxy on its side",
            || {
                let near = version.full.nearest(centre, 0).distance * frame.metres_per_unit;
                format!(
                    "probe {k}: the centre of its ball of {radius_m} m is {near:.6} m behind the full mesh"
                )
            },
        )?;
        let radius = radius_m / frame.metres_per_unit;
        let clearance = front_distance(controller.active_object(object), centre);
        ensure(
            clearance >= radius * (1.0 - PROXY_DEPTH),
            "proxy out of the front",
            || format!("probe {k}: {clearance} from the front, radius {radius} model units"),
        )?;
    }
    Ok(())
}

/// Distance of a point from the nearest face of a front, by a look at all.
fn front_distance(object: Option<&ActiveObject>, point: DVec3) -> f64 {
    let mut least = f64::INFINITY;
    if let Some(object) = object {
        let mesh = object.cache().mesh();
        mesh.for_each_active_face(|face| {
            let near = geometry::closest_point_on_triangle(mesh.corners(face), point);
            least = least.min(near.distance_squared);
        });
    }
    least.sqrt()
}

/// Winding number of triangles around a point: 1 inside of a closed mesh, 0 outside (van Oosterom
/// and Strackee 1983).
fn winding(triangles: &[[DVec3; 3]], point: DVec3) -> f64 {
    let half_angle = |corners: &[DVec3; 3]| {
        let [a, b, c] = corners.map(|corner| corner - point);
        let [la, lb, lc] = [a.length(), b.length(), c.length()];
        let volume = a.dot(b.cross(c));
        volume.atan2(la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb)
    };
    triangles.iter().map(half_angle).sum::<f64>() / (2.0 * std::f64::consts::PI)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_winding_number_says_what_is_inside() {
        let o = DVec3::ZERO;
        let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
        let tetrahedron = [[o, y, x], [o, x, z], [o, z, y], [x, y, z]];
        let inside = winding(&tetrahedron, DVec3::splat(0.1));
        assert!((inside - 1.0).abs() < 1e-12, "{inside}");
        let outside = winding(&tetrahedron, DVec3::splat(0.5));
        assert!(outside.abs() < 1e-12, "{outside}");
    }
}
