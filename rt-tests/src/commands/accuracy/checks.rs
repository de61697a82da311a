//! What must hold on every model and at every setting.

use super::measure::ROUNDING;
use super::result::{Check, Knob, Point};
use crate::failure::Failure;
use crate::report::quantile::median;
use crate::trajectory::reference::Reference;
use crate::trajectory::scene_model::SceneModel;
use hrtc_core::contact::sphere_proxy::SAME_WITHIN;
use hrtc_core::record::max_or_nan;

/// What may be certified beside what is true.
const TIGHT: f64 = 3.0;

/// At tolerance 0 contacts equal the full mesh's to this share of the diagonal.
const EQUAL: f64 = 1e-9;

/// The share of the greatest force to which forces equal the full mesh's: where the same faces come
/// in another order, a ball reaches its place in another way.
fn equal_forces(model: &SceneModel, reference: &Reference) -> f64 {
    let stiffness_n_per_m = model.plan.objects[0].surface.stiffness_n_per_m;
    let apart_m = SAME_WITHIN * model.plan.probes[0].shape.tip_m();
    stiffness_n_per_m * apart_m / reference.force_max()
}

/// The checks of one model.
#[must_use]
pub fn checks(model: &SceneModel, reference: &Reference, points: &[Point]) -> Vec<Check> {
    let mut checks = Vec::new();
    let mut check = |name: String, worst: f64, limit: f64| {
        checks.push(Check {
            model: model.mesh.name.clone(),
            name,
            pass: worst <= limit,
            worst,
            limit,
        });
    };
    let most = |of: &dyn Fn(&Point) -> f64| points.iter().map(of).fold(0.0, max_or_nan);
    check(
        "settings without a contact that the full mesh has too".to_string(),
        points.iter().filter(|p| p.common_ticks == 0).count() as f64,
        0.0,
    );
    check(
        "settings with an error, an angle or a force that is no number".to_string(),
        points.iter().filter(|p| has_no_number(p)).count() as f64,
        0.0,
    );
    check(
        "contacts with a true error beyond the certified one".to_string(),
        most(&|p| p.over_certified_ticks as f64),
        0.0,
    );
    check(
        "contacts without a certified error".to_string(),
        most(&|p| p.unbounded_ticks as f64),
        0.0,
    );
    check(
        "exact distance by boxes against every face looked at, shares of the diagonal".to_string(),
        most(&|p| p.brute_apart_m / model.diagonal_m()),
        ROUNDING,
    );
    let dial = points.iter().filter(|point| point.knob == Knob::Local);
    let ratios: Vec<f64> = dial.flat_map(|p| p.certified_over_true.clone()).collect();
    check(
        "certified over true error, median of the centimetres of the dial".to_string(),
        median(&ratios),
        TIGHT,
    );
    for point in points.iter().filter(|point| point.full_mesh) {
        let knob = point.knob.name();
        check(
            format!(
                "{knob}, full mesh asked for: contact points against the full mesh, shares of the diagonal"
            ),
            point.contact_apart_m / model.diagonal_m(),
            EQUAL,
        );
        check(
            format!("{knob}, full mesh asked for: ticks in which only one of the two touches"),
            point.one_sided_ticks as f64,
            0.0,
        );
        check(
            format!(
                "{knob}, full mesh asked for: forces against the full mesh, shares of the greatest"
            ),
            point.force_n / reference.force_max(),
            equal_forces(model, reference),
        );
        check(
            format!(
                "{knob}, full mesh asked for: distance of the contacts to the full mesh, shares of the diagonal"
            ),
            point.true_m / model.diagonal_m(),
            EQUAL,
        );
    }
    checks
}

/// Whether one of the figures of a setting is no number: a maximum is none then.
fn has_no_number(point: &Point) -> bool {
    let figures = [
        point.certified_m,
        point.true_m,
        point.measured_m,
        point.normal_deg,
        point.force_n,
        point.contact_apart_m,
    ];
    !figures.iter().all(|figure| figure.is_finite())
}

/// The first check that failed, in words.
///
/// # Errors
/// When one failed.
pub fn judge(checks: &[Check]) -> Result<(), Failure> {
    let failed: Vec<&Check> = checks.iter().filter(|check| !check.pass).collect();
    match failed.first() {
        None => Ok(()),
        Some(check) => Err(Failure::Run(format!(
            "{} of {} checks failed; {}: {} ({:.3e}, at most {:.1e})",
            failed.len(),
            checks.len(),
            check.model,
            check.name,
            check.worst,
            check.limit
        ))),
    }
}
