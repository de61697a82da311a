//! What `zwidth` found, in words and as a picture.

use super::{Limit, MAX_WITH_ACCOUNT, Zwidth, is_beyond};
use crate::report::chart::{
    Axis, COLORS, Chart, Curve, GREY, Ground, Names, Stroke, Unit, grid, xs, ys,
};
use crate::report::table::Table;
use std::fmt::Write;

/// Height of the picture, pixels.
const PICTURE_HEIGHT: f64 = 320.0;

/// The report.
pub fn words(found: &Zwidth) -> String {
    let mut text = String::new();
    let of = &found.measured;
    let _ = writeln!(
        text,
        "measured    period {:.1} µs at median, {:.1} µs at most, over {} ticks\n            the force is written {:.1} µs (p99 {:.1} µs) after the sample, {} tick(s) later\n            it was made for: {:.3} ticks of delay beyond a hold of one period",
        of.period_s * 1e6,
        of.longest_period_s * 1e6,
        of.stamps,
        of.work_s * 1e6,
        of.work_p99_s * 1e6,
        of.whole_ticks,
        found.delay_ticks
    );
    let at_least = |k_max: f64, theory: f64| {
        if theory > 0.0 && k_max >= 0.99 * MAX_WITH_ACCOUNT * theory {
            "at least "
        } else {
            ""
        }
    };
    let _ = writeln!(
        text,
        "device      {} kg, {} N s/m; {:.2e} kg m², {:.2e} N m s/rad\nsimulated   {:.0} N/m put no energy out in long runs at that period and delay;\n            theory says {:.0} N/m (the runs may lie {:.0} above), {:.0} at the longest period\n            with the energy account {}{:.0} N/m\nturning     {:.4} N m/rad, simulated; theory says {:.4} N m/rad (the runs may lie {:.4} above)\n            with the energy account {}{:.4} N m/rad",
        found.mass_kg,
        found.damping,
        found.inertia_kgm2,
        found.damping_torsion,
        found.k_max_measured,
        found.k_max_theory,
        found.k_max_uncertainty,
        found.k_max_longest_period_theory,
        at_least(found.k_max_with_account, found.k_max_theory),
        found.k_max_with_account,
        found.k_max_torsion_measured,
        found.k_max_torsion_theory,
        found.k_max_torsion_uncertainty,
        at_least(found.k_max_torsion_with_account, found.k_max_torsion_theory),
        found.k_max_torsion_with_account,
    );
    let heads = "damping\nN s/m | simulated\nN/m | theory\nN/m";
    let mut table = Table::new(0, heads);
    for limit in &found.curve {
        table.row([
            limit.damping.to_string(),
            format!("{:.0}", limit.k_max_measured),
            format!("{:.0}", limit.k_max_theory),
        ]);
    }
    let _ = write!(text, "\n{table}");
    for limit in &found.curve {
        let [simulated, theory] = [limit.k_max_measured, limit.k_max_theory];
        if is_beyond([simulated, theory, limit.k_max_uncertainty]) {
            let _ = writeln!(
                text,
                "at {} N s/m the runs lie {:.1} N/m above theory, stated are {:.1}: with little damping the device bounces",
                limit.damping,
                simulated - theory,
                limit.k_max_uncertainty
            );
        }
    }
    text
}

/// The limit over the damping, as SVG.
pub fn draw(found: &Zwidth) -> String {
    let curve = |label: &str, color, stroke, of: fn(&Limit) -> f64| {
        let points = found.curve.iter().map(|limit| (limit.damping, of(limit)));
        Curve::new(label, color, stroke, points)
    };
    let here = [(found.damping, found.k_max_measured)];
    let curves = vec![
        curve("theory: b / (T/2 + n T)", GREY, Stroke::Line, |limit| {
            limit.k_max_theory
        }),
        curve("simulated long runs", COLORS[0], Stroke::Dots, |limit| {
            limit.k_max_measured
        }),
        Curve::new("this device", COLORS[1], Stroke::Dots, here),
    ];
    let x = Axis::over("damping of the device, N s/m", Unit::Number, xs(&curves));
    let y = Axis::over("N/m", Unit::Number, ys(&curves));
    let title =
        "Stiffest wall that puts no energy out (simulated at the measured period and delay)";
    let mut chart = Chart::new(title, x, y, curves);
    chart.names = Names::Legend;
    grid(&[chart], 1, PICTURE_HEIGHT, Ground::Paper)
}
