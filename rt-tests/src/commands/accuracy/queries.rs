//! Closest points on the full mesh from where the ball was in each contact, in 32 and 64 bits.
//!
//! The controller asks in 64 bits, with boxes in 32 that are rounded outwards. What 32 bits would
//! give is told by parry, which has both.

use super::result::{Knob, Point, StageQuantiles};
use crate::commands::compare::full_front::FullFront;
use crate::commands::compare::timing::{self, Timed};
use crate::failure::Failure;
use crate::peers::parry::{Mesh, ParryF32, ParryF64};
use crate::report::quantile::Quantiles;
use crate::trajectory::reference::Reference;
use crate::trajectory::scene_model::SceneModel;
use glam::DVec3;
use hrtc_core::contact::query::closest_point;
use hrtc_core::record::max_or_nan;
use spm::FileError;

/// Answers a point with the closest one of the mesh; `None` when there is none.
type Closest<'a> = dyn Fn(DVec3) -> Option<DVec3> + 'a;

/// A contact of the reference.
struct Contact {
    /// Centre of the ball where it touches, model units.
    centre: DVec3,
    /// Motion of the device to the next sample, metres, over which the force of this one is held.
    moved: DVec3,
}

/// The contacts of a touch in which the force says where the centre is.
fn contacts(model: &SceneModel, reference: &Reference) -> Vec<Contact> {
    let radius = model.plan.probes[0].shape.tip_m() / model.metres_per_unit;
    let places: Vec<DVec3> = reference
        .samples
        .iter()
        .map(|sample| sample.pose.position)
        .collect();
    let ticks = motions(&places).into_iter().zip(&reference.ticks);
    let found = ticks.filter_map(|(moved, tick)| {
        let normal = tick.force.try_normalize()?;
        let centre = tick.contact? + normal * radius;
        Some(Contact { centre, moved })
    });
    found.collect()
}

/// The motion from each place to the next; none from the last.
fn motions(places: &[DVec3]) -> Vec<DVec3> {
    let next = places.iter().skip(1).chain(places.last());
    let pairs = places.iter().zip(next);
    pairs.map(|(&from, &to)| to - from).collect()
}

/// A setting for each precision: errors beside the file's own search in 64 bits, and the time of
/// one query, each contact once.
///
/// # Errors
/// When a library refuses the mesh, or the file is damaged.
pub fn precision(model: &SceneModel, reference: &Reference) -> Result<Vec<Point>, Failure> {
    let refused = |error: String| Failure::Run(format!("{}: parry: {error}", model.mesh.name));
    let (positions, faces) = model.mesh.full_mesh();
    let single = ParryF32::new(&positions, &faces).map_err(refused)?;
    let double = ParryF64::new(&positions, &faces).map_err(refused)?;
    let front = FullFront::new(&model.mesh)?;
    let contacts = contacts(model, reference);
    let exact = exact(model, &contacts)?;
    let ours = |at: DVec3| {
        let (nearest, _) = closest_point(front.surface(), at, None);
        nearest.map(|nearest| nearest.closest.point)
    };
    let of_single = |at: DVec3| Some(single.closest_point(at));
    let of_double = |at: DVec3| Some(double.closest_point(at));
    let asked: [(&str, &Closest<'_>, usize); 3] = [
        ("parry, 32 bits", &of_single, single.bytes()),
        ("parry, 64 bits", &of_double, double.bytes()),
        ("this project, 64 bits", &ours, front.bytes()),
    ];
    let times = times(&contacts, asked.map(|(_, closest, _)| closest));
    let all = asked.into_iter().zip(times).enumerate();
    let points = all.map(|(place, ((label, closest, bytes), mut us))| {
        let mut point = Point::new(&model.mesh.name, Knob::Precision, place as f64);
        point.label = label.to_string();
        point.setting = "no key of a scene: fixed in the code".to_string();
        let mean = us.iter().sum::<f64>() / us.len().max(1) as f64;
        point.tick_us = Quantiles::of(&mut us);
        point.all_tick_us = point.tick_us;
        point.stage_us.query = StageQuantiles::of(mean, &point.tick_us);
        point.rss_bytes = bytes as u64;
        point.contact_ticks = contacts.len() as u64;
        point.common_ticks = point.contact_ticks;
        errors(model, (&contacts, &exact), closest, &mut point);
        point
    });
    Ok(points.collect())
}

/// The closest points by the file's own search, in 64 bits.
fn exact(model: &SceneModel, contacts: &[Contact]) -> Result<Vec<DVec3>, Failure> {
    let file = &model.mesh.file;
    let closest = contacts
        .iter()
        .map(|contact| file.closest_point(contact.centre));
    let points: Result<_, FileError> = closest.map(|found| Ok(found?.1.point)).collect();
    points.map_err(|error| Failure::Input(format!("the model {}: {error}", model.mesh.name)))
}

/// Times of single queries of each, µs.
fn times(contacts: &[Contact], asked: [&Closest<'_>; 3]) -> Vec<Vec<f64>> {
    let ask = |closest: &Closest<'_>, k: usize| {
        closest(contacts[k].centre).map_or(f64::NAN, |found| found.x)
    };
    let [a, b, c] = asked;
    let timed = timing::time(
        contacts.len(),
        &mut [&mut |k| ask(a, k), &mut |k| ask(b, k), &mut |k| ask(c, k)],
    );
    let us = |timed: Timed| timed.ns.iter().map(|ns| ns * 1e-3).collect();
    timed.into_iter().map(us).collect()
}

/// How far the closest point, the normal and the force are off.
fn errors(
    model: &SceneModel,
    (contacts, exact): (&[Contact], &[DVec3]),
    closest: &Closest<'_>,
    point: &mut Point,
) {
    let scale = model.metres_per_unit;
    let radius = model.plan.probes[0].shape.tip_m() / scale;
    let stiffness = model.plan.objects[0].surface.stiffness_n_per_m;
    for (contact, &exact) in contacts.iter().zip(exact) {
        let found = closest(contact.centre).unwrap_or(DVec3::NAN);
        let [ours, theirs] = [exact, found].map(|at| contact.centre - at);
        let sine = ours.cross(theirs).length();
        let degrees = sine.atan2(ours.dot(theirs)).to_degrees();
        // A ball whose centre is kept a radius from this point.
        let placed = |at: DVec3, away: DVec3| at + away.normalize() * radius;
        let force = (placed(found, theirs) - placed(exact, ours)) * (scale * stiffness);
        point.true_m = max_or_nan(point.true_m, found.distance(exact) * scale);
        point.normal_deg = max_or_nan(point.normal_deg, degrees);
        point.force_n = max_or_nan(point.force_n, force.length());
        point.energy_j += force.dot(contact.moved);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_force_is_held_over_the_motion_to_the_next_sample() {
        let places = [1.0, 3.0, 2.0].map(DVec3::splat);
        assert_eq!(motions(&places), [2.0, -1.0, 0.0].map(DVec3::splat));
        assert_eq!(motions(&places[..1]), [DVec3::ZERO]);
        assert_eq!(motions(&[]), [DVec3::ZERO; 0]);
    }
}
