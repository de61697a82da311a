//! What must hold on every model and at every setting.

use super::measure::ROUNDING;
use super::result::{Check, Knob, Point};
use crate::report::quantile::median;
use crate::trajectory::reference::Reference;
use crate::trajectory::scene_model::SceneModel;
use hrtc_core::contact::sphere_proxy::SAME_WITHIN;
use hrtc_core::record::max_or_nan;

/// Ticks of contact of which the station measures some in any case, a tenth of a second at 4 kHz:
/// it keeps measured errors back for up to 50 ms.
const MEASURED_TICKS: u64 = 400;
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

/// What the checks of a model are measured by.
struct Scales<'a> {
    /// The model.
    model: &'a str,
    /// Its diagonal, metres.
    diagonal_m: f64,
    /// The greatest force on the full mesh, N.
    force_max_n: f64,
    /// See [`equal_forces`].
    equal_forces: f64,
}

impl Scales<'_> {
    /// A check of what was compared.
    fn check(&self, name: String, worst: f64, limit: f64) -> Check {
        Check {
            model: self.model.to_string(),
            name,
            pass: worst <= limit,
            worst,
            limit,
            compared: true,
        }
    }
}

/// The checks of one model.
#[must_use]
pub fn checks(model: &SceneModel, reference: &Reference, points: &[Point]) -> Vec<Check> {
    let scales = Scales {
        model: &model.mesh.name,
        diagonal_m: model.diagonal_m(),
        force_max_n: reference.force_max(),
        equal_forces: equal_forces(model, reference),
    };
    let mut checks = of_all(&scales, points);
    let full = points.iter().filter(|point| point.full_mesh);
    checks.extend(full.flat_map(|point| of_full_mesh(&scales, point)));
    checks
}

/// What must hold of all settings together.
fn of_all(scales: &Scales<'_>, points: &[Point]) -> Vec<Check> {
    let most = |of: &dyn Fn(&Point) -> f64| points.iter().map(of).fold(0.0, max_or_nan);
    let count = |of: &dyn Fn(&Point) -> bool| points.iter().filter(|p| of(p)).count() as f64;
    let rounding_m = ROUNDING * scales.diagonal_m;
    let settings = [
        (
            "settings without a contact that the full mesh has too",
            count(&|p| p.common_ticks == 0),
        ),
        (
            "settings with an error, an angle or a force that is no number",
            count(&has_no_number),
        ),
        (
            "settings with contacts of which the station measured no error, or one beyond the largest true one",
            count(&|p| !is_measured(p, rounding_m)),
        ),
        (
            "contacts with a true error beyond the certified one",
            most(&|p| p.over_certified_ticks as f64),
        ),
        (
            "contacts without a certified error",
            most(&|p| p.unbounded_ticks as f64),
        ),
    ];
    let settings = settings.map(|(name, worst)| scales.check(name.to_string(), worst, 0.0));
    let mut checks = settings.to_vec();
    checks.push(scales.check(
        "exact distance by boxes against every face looked at, shares of the diagonal".to_string(),
        most(&|p| p.brute_apart_m / scales.diagonal_m),
        ROUNDING,
    ));
    let dial = points.iter().filter(|point| point.knob == Knob::Local);
    let ratios: Vec<f64> = dial.flat_map(|p| p.certified_over_true.clone()).collect();
    let name = "certified over true error, median of the centimetres of the dial".to_string();
    checks.push(Check {
        compared: !ratios.is_empty(),
        ..scales.check(name, median(&ratios), TIGHT)
    });
    checks
}

/// What must hold of a setting that asks for the full mesh.
fn of_full_mesh(scales: &Scales<'_>, point: &Point) -> [Check; 4] {
    let check = |what: &str, worst: f64, limit: f64| {
        let name = format!("{}, full mesh asked for: {what}", point.knob.name());
        scales.check(name, worst, limit)
    };
    [
        check(
            "contact points against the full mesh, shares of the diagonal",
            point.contact_apart_m / scales.diagonal_m,
            EQUAL,
        ),
        check(
            "ticks in which only one of the two touches",
            point.one_sided_ticks as f64,
            0.0,
        ),
        check(
            "forces against the full mesh, shares of the greatest",
            point.force_n / scales.force_max_n,
            scales.equal_forces,
        ),
        check(
            "distance of the contacts to the full mesh, shares of the diagonal",
            point.true_m / scales.diagonal_m,
            EQUAL,
        ),
    ]
}

/// Whether the station measured what is true. It measures some of the very contacts of which the
/// exact distance is found here, on the same mesh: its largest error is there, and not above the
/// largest true one by more than rounding. A query alone has no station.
fn is_measured(point: &Point, rounding_m: f64) -> bool {
    let asks = point.contact_ticks > MEASURED_TICKS && point.knob != Knob::Precision;
    // What is no number is in no range.
    !asks || (0.0..=point.true_m + rounding_m).contains(&point.measured_m)
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

#[cfg(test)]
mod tests {
    use super::*;

    const SCALES: Scales<'static> = Scales {
        model: "cow",
        diagonal_m: 0.2,
        force_max_n: 4.0,
        equal_forces: 1e-9,
    };

    /// A setting of the dial in which all is well.
    fn good() -> Point {
        Point {
            contact_ticks: 1000,
            common_ticks: 100,
            certified_m: 2e-4,
            true_m: 1e-4,
            measured_m: 9e-5,
            certified_over_true: vec![2.0],
            ..Point::new("cow", Knob::Local, 1e-3)
        }
    }

    fn failed(point: Point) -> Vec<String> {
        let checks = of_all(&SCALES, &[good(), point]).into_iter();
        let failed = checks.filter(|check| !check.pass);
        failed.map(|check| check.name).collect()
    }

    #[test]
    fn a_station_measures_what_is_true() {
        assert_eq!(failed(good()), [""; 0]);
        // Rounding; and on the full mesh both are rounding.
        for (measured_m, true_m) in [(1e-4 + 1e-13, 1e-4), (4e-17, 3e-17), (0.0, 0.0)] {
            let point = Point {
                measured_m,
                true_m,
                ..good()
            };
            assert_eq!(failed(point), [""; 0], "{measured_m}");
        }
        for measured_m in [-1.0, 0.1, 1e-4 + 1e-9] {
            let point = Point {
                measured_m,
                ..good()
            };
            let failed = failed(point);
            assert_eq!(failed.len(), 1, "{measured_m}: {failed:?}");
            assert!(failed[0].contains("the station measured"), "{failed:?}");
        }
        let no_number = Point {
            measured_m: f64::NAN,
            ..good()
        };
        assert_eq!(failed(no_number).len(), 2, "it is counted as both");
        // A query has no station.
        let query = Point {
            knob: Knob::Precision,
            measured_m: -1.0,
            ..good()
        };
        assert_eq!(failed(query), [""; 0]);
    }

    #[test]
    fn where_nothing_is_off_there_is_nothing_to_compare() {
        let verdict = |ratios: Vec<f64>| {
            let point = Point {
                certified_over_true: ratios,
                ..good()
            };
            let checks = of_all(&SCALES, &[point]);
            let ratio = checks.iter().find(|check| check.limit == TIGHT);
            ratio.expect("it is checked").verdict()
        };
        assert_eq!(verdict(vec![2.0]), "holds");
        assert_eq!(verdict(vec![4.0]), "FAILS");
        assert_eq!(verdict(Vec::new()), "nothing to compare");
    }
}
