//! The knobs beside the tolerance: a sentence, curves and a table each; and what is best of all.

use super::super::measure::ROUNDING;
use super::super::result::{FASTER, Knob, Point};
use super::{Group, shown, span};
use crate::report::chart::{
    Axis, COLORS, Chart, Curve, GREY, Ground, Names, Stroke, Unit, grid, key, xs, ys,
};
use crate::report::html::escaped;
use crate::report::table::Table;
use crate::report::units::{bytes, digits, length};
use std::fmt::Write as _;

/// A quantity of a point with its axis.
type Quantity = (&'static str, Unit, fn(&Point) -> f64);

/// What an error costs.
const COSTS: [Quantity; 3] = [
    ("tick, p50, µs", Unit::Time, |p| p.tick_us.p50),
    ("memory", Unit::Bytes, |p| p.rss_bytes as f64),
    ("bytes received", Unit::Bytes, |p| p.bytes as f64),
];
/// The errors, drawn as 0 below these numbers: the same faces in another order gave 2e-6 degrees
/// and 1e-8 N (`rt-tests accuracy`, cow).
const ERRORS: [(Quantity, f64); 4] = [
    (("position", Unit::Length, |p| p.true_m), ROUNDING),
    (("normal, °", Unit::Number, |p| p.normal_deg), 1e-5),
    (("force, N", Unit::Number, |p| p.force_n), 1e-7),
    (("energy, J", Unit::Number, |p| p.energy_j.abs()), 1e-9),
];

/// The costs of a knob.
fn costs(knob: Knob) -> Vec<Quantity> {
    match knob {
        // Nothing is received for a query.
        Knob::Precision => vec![("query, p50, µs", Unit::Time, |p| p.tick_us.p50), COSTS[1]],
        _ => COSTS.into(),
    }
}

/// What a knob is, in a sentence.
fn about(knob: Knob) -> &'static str {
    match knob {
        Knob::Grid => {
            "Cells of the region grid along the longest side: what is loaded and refined at once."
        }
        Knob::BaseMesh => "Faces of the base mesh: what is there before anything is refined.",
        Knob::Cache => "Bytes of the cache: what may be held.",
        Knob::Predictor => "What the cells ahead of the hand are predicted from.",
        Knob::Operations => "Splits and collapses a millisecond.",
        Knob::Processor => {
            "How many times slower than the reference machine a processor is: a tick does what there is time for. The time is that of this work on this machine."
        }
        Knob::Rate => "Ticks a second, each rate beside a reference of its own.",
        Knob::Geomorph => {
            "Whether what changes under the probe travels to its place or jumps there."
        }
        Knob::Effect => {
            "Each effect alone, beside the full mesh with the same effect. (The phase of a vibration counts ticks from the start, which the two do not share, so its force is no error of the mesh.)"
        }
        Knob::ToolFaces => {
            "Faces of a capsule in place of the ball, beside the same tool on the full mesh."
        }
        Knob::Iterations => {
            "Steps that a tool makes in a tick at most, each with an exact projection onto its contacts; fixed at the last one. It ends before when nothing moves or the tick's budget is spent. The next tick goes on from there. Beside the product's tool on the full mesh."
        }
        Knob::ContactOffset => {
            "How far from the surface a tool's contacts act, as a share of its radius of gyration. The product takes half a step of the encoder, between the second one and the third. Beside the product's tool on the full mesh."
        }
        Knob::Precision => {
            "Bits of the numbers of a query, fixed at 64 (with boxes of 32, rounded outwards). The closest point on the full mesh is asked from where the ball was in each contact, each once and without any memory; the times are those of one query alone, the memory is that of mesh and tree."
        }
        Knob::Local | Knob::Global | Knob::Prefix => "",
    }
}

/// All of it.
pub fn knobs(html: &mut String, groups: &[Group<'_>]) {
    let turned = |knob| groups.iter().any(|group| group.of(knob).next().is_some());
    if !Knob::OTHERS.into_iter().any(turned) {
        return;
    }
    let _ = writeln!(
        html,
        "<h2>Other knobs</h2>\n<p>Each is turned alone from the product's defaults: full mesh, geomorphs on, all else as of a scene that does not name it; those that need no other touch also under a hand {FASTER} times as fast. Errors are the largest of the contact, beside the full mesh at the same poses; a picture without any is left out.</p>"
    );
    let mut names: Vec<(String, &str, Stroke)> = colored(groups)
        .map(|(group, color)| (group.title(), color, Stroke::Solid))
        .collect();
    names.push(("faster hand".to_string(), "currentColor", Stroke::Dashed));
    html.push_str(&key("", &names));
    for knob in Knob::OTHERS.into_iter().filter(|&knob| turned(knob)) {
        one(html, groups, knob);
    }
    pareto(html, groups);
}

fn colored<'a, 'b>(
    groups: &'b [Group<'a>],
) -> impl Iterator<Item = (&'b Group<'a>, &'static str)> + 'b {
    groups.iter().zip(COLORS.into_iter().cycle())
}

fn one(html: &mut String, groups: &[Group<'_>], knob: Knob) {
    let _ = writeln!(
        html,
        "<h3>{}</h3>\n<p>{} {}</p>",
        knob.name(),
        about(knob),
        sentence(groups, knob)
    );
    let costs = costs(knob);
    let row = |error: usize| {
        let charts = costs
            .iter()
            .map(|&cost| chart(groups, knob, ERRORS[error], cost));
        charts.collect::<Vec<_>>()
    };
    let is_off = |&error: &usize| all(groups, knob).any(|p| drawn(ERRORS[error], p) > 0.0);
    if is_off(&0) {
        html.push_str(&grid(&row(0), 3, 230.0, Ground::Page));
    }
    let rest: Vec<Chart> = (1..ERRORS.len()).filter(is_off).flat_map(row).collect();
    if !rest.is_empty() {
        let _ = writeln!(
            html,
            "<details><summary>normal, force and energy</summary>{}</details>",
            grid(&rest, 3, 230.0, Ground::Page)
        );
    }
    let _ = writeln!(
        html,
        "<details><summary>numbers, and what a scene writes</summary>{}</details>",
        table(groups, knob).html()
    );
}

/// All settings of a knob, under both hands.
fn all<'a>(groups: &[Group<'a>], knob: Knob) -> impl Iterator<Item = &'a Point> {
    groups.iter().flat_map(move |group| {
        let slow = group.of(knob).map(|(_, point)| point);
        slow.chain(group.faster(knob))
    })
}

/// An error that is drawn.
fn drawn(((_, _, error), least): (Quantity, f64), point: &Point) -> f64 {
    let error = error(point);
    if error < least { 0.0 } else { error }
}

fn chart(groups: &[Group<'_>], knob: Knob, error: (Quantity, f64), cost: Quantity) -> Chart {
    let place = |p: &Point| ((cost.2)(p), drawn(error, p), p.label.clone());
    let curves: Vec<Curve> = colored(groups)
        .flat_map(|(group, color)| {
            let slow: Vec<_> = group.of(knob).map(|(_, point)| place(point)).collect();
            let fast: Vec<_> = group.faster(knob).map(place).collect();
            [(fast, Stroke::Dashed), (slow, Stroke::Solid)].map(|(points, stroke)| Curve {
                label: group.name.to_string(),
                color,
                stroke,
                points,
            })
        })
        .filter(|curve| !curve.points.is_empty())
        .collect();
    let x = Axis::over(cost.0, cost.1, xs(&curves));
    let (name, unit, _) = error.0;
    let y = Axis::over(name, unit, ys(&curves));
    Chart::new(name, x, y, curves)
}

/// What the settings of a knob cost and give, over the models.
fn sentence(groups: &[Group<'_>], knob: Knob) -> String {
    let slow = |group: &Group<'_>| -> Vec<Point> {
        group.of(knob).map(|(_, point)| point.clone()).collect()
    };
    let of_slow: Vec<Vec<Point>> = groups.iter().map(slow).collect();
    let faster = |group: &Group<'_>| group.faster(knob).cloned().collect();
    let of_fast: Vec<Vec<Point>> = groups.iter().map(faster).collect();
    let told = if knob == Knob::Effect {
        over_all(&of_slow)
    } else {
        first_and_last(&of_slow)
    };
    let fast = first_and_last(&of_fast);
    if fast.is_empty() {
        return told;
    }
    format!("{told} Under the faster hand: {fast}")
}

fn us(n: f64) -> String {
    format!("{} µs", digits(n))
}

fn newtons(n: f64) -> String {
    format!("{} N", digits(n))
}

/// What is timed.
fn timed(knob: Knob) -> &'static str {
    match knob {
        Knob::Precision => "query",
        _ => "tick",
    }
}

fn size(n: f64) -> String {
    bytes(n as u64)
}

/// From the least to the most over all settings.
fn over_all(points: &[Vec<Point>]) -> String {
    let all = || points.iter().flatten();
    format!(
        "The median tick takes {}, one in a hundred {}; the contact is off by {} at most.",
        span(all().map(|p| p.tick_us.p50), us),
        span(all().map(|p| p.tick_us.p99), us),
        span(all().map(|p| shown(p.true_m)), length)
    )
}

/// What a setting is called where it is the same on every model, else this.
fn called_alike<'a>(mut points: impl Iterator<Item = &'a Point>, otherwise: &str) -> String {
    let label = points.next().map_or("", |point| point.label.as_str());
    if points.all(|point| point.label == label) {
        escaped(label)
    } else {
        otherwise.to_string()
    }
}

/// The first setting against the last.
fn first_and_last(points: &[Vec<Point>]) -> String {
    let ends: Vec<(&Point, &Point)> = points
        .iter()
        .filter_map(|points| points.first().zip(points.last()))
        .collect();
    let Some((first, _)) = ends.first() else {
        return String::new();
    };
    let both = |of: fn(&Point) -> f64, word: fn(f64) -> String| {
        let first = span(ends.iter().map(|end| of(end.0)), word);
        let last = span(ends.iter().map(|end| of(end.1)), word);
        if first == last {
            format!("{first} with either")
        } else {
            format!("{first} against {last}")
        }
    };
    format!(
        "With {} against {}, the median {} takes {}, one in a hundred {}; the contact is off by at most {}, the force by {}; {}memory is {}.",
        called_alike(
            ends.iter().map(|end| end.0),
            "the first setting of each model"
        ),
        called_alike(ends.iter().map(|end| end.1), "the last one"),
        timed(first.knob),
        both(|p| p.tick_us.p50, us),
        both(|p| p.tick_us.p99, us),
        both(|p| shown(p.true_m), length),
        both(|p| drawn(ERRORS[2], p), newtons),
        if first.bytes == 0 {
            String::new()
        } else {
            format!("received are {}, ", both(|p| p.bytes as f64, size))
        },
        both(|p| p.rss_bytes as f64, size)
    )
}

fn table(groups: &[Group<'_>], knob: Knob) -> Table {
    let mut table = Table::new(
        2,
        "model | setting | hand, m/s | a scene writes | tick p50, µs | p99 | position | normal | force | energy, µJ | received | memory",
    );
    for group in groups {
        for p in all(std::slice::from_ref(group), knob) {
            table.row([
                group.name.to_string(),
                p.label.clone(),
                digits(p.speed_m_per_s),
                p.setting.clone(),
                format!("{:.2}", p.tick_us.p50),
                format!("{:.2}", p.tick_us.p99),
                length(p.true_m),
                format!("{}°", digits(p.normal_deg)),
                format!("{} N", digits(p.force_n)),
                digits(p.energy_j * 1e6),
                bytes(p.bytes),
                bytes(p.rss_bytes),
            ]);
        }
    }
    table
}

/// Settings of which no other is both cheaper and nearer, the cheapest first.
fn best<'a>(points: &[&'a Point], cost: fn(&Point) -> f64) -> Vec<&'a Point> {
    let mut ordered = points.to_vec();
    let error = |p: &Point| shown(p.true_m);
    ordered.sort_by(|a, b| {
        let first = cost(a).total_cmp(&cost(b));
        first.then(error(a).total_cmp(&error(b)))
    });
    let mut least = f64::INFINITY;
    ordered.retain(|point| {
        let is_nearer = error(point) < least;
        least = least.min(error(point));
        is_nearer
    });
    ordered
}

/// What a point of the front is called.
fn called(point: &Point) -> String {
    let value = if point.label.is_empty() {
        super::asked(point, false)
    } else {
        point.label.clone()
    };
    format!("{} {value}", point.knob.name())
}

fn pareto(html: &mut String, groups: &[Group<'_>]) {
    html.push_str("<h2>The best of all knobs</h2>\n<p>Every setting of the same touch as a grey dot, and the Pareto front: of its settings no other is both cheaper and nearer to the full mesh. Effects, tools and rates are other touches, and a query alone is no tick: they are not in it.</p>\n");
    html.push_str(&key(
        "",
        &[
            ("front".to_string(), COLORS[1], Stroke::Solid),
            ("all settings".to_string(), GREY, Stroke::Dots),
        ],
    ));
    for group in groups {
        let points: Vec<&Point> = group
            .points
            .iter()
            .copied()
            .filter(|point| point.knob.is_same_touch())
            .filter(|point| point.speed_m_per_s == group.points[0].speed_m_per_s)
            .collect();
        let charts = COSTS.map(|cost| {
            let front = best(&points, cost.2);
            let place = |p: &Point| ((cost.2)(p), shown(p.true_m));
            let curves = vec![
                Curve {
                    label: "front".to_string(),
                    color: COLORS[1],
                    stroke: Stroke::Solid,
                    points: front
                        .iter()
                        .map(|p| (place(p).0, place(p).1, called(p)))
                        .collect(),
                },
                Curve::new("all", GREY, Stroke::Dots, points.iter().map(|p| place(p))),
            ];
            let x = Axis::over(cost.0, cost.1, xs(&curves));
            let y = Axis::over("position", Unit::Length, ys(&curves));
            Chart {
                names: Names::Nowhere,
                ..Chart::new(cost.0, x, y, curves)
            }
        });
        let _ = writeln!(
            html,
            "<h3>{}</h3>\n<p>{}</p>",
            escaped(&group.title()),
            on_front(&points)
        );
        html.push_str(&grid(&charts, 2, 290.0, Ground::Page));
        let _ = writeln!(
            html,
            "<details><summary>the settings of the fronts</summary>{}</details>",
            fronts(&points).html()
        );
    }
}

/// The settings of the three fronts, and what a scene writes for them.
fn fronts(points: &[&Point]) -> Table {
    let mut table = Table::new(
        2,
        "front of | setting | a scene writes | costs | position | force",
    );
    for (name, unit, cost) in COSTS {
        for p in best(points, cost) {
            let costs = match unit {
                Unit::Bytes => size(cost(p)),
                _ => us(cost(p)),
            };
            let force = format!("{} N", digits(p.force_n));
            let cells = [
                called(p),
                p.setting.clone(),
                costs,
                length(shown(p.true_m)),
                force,
            ];
            table.row([name.to_string()].into_iter().chain(cells));
        }
    }
    table
}

/// Which settings reach the full mesh for the least, in words.
fn on_front(points: &[&Point]) -> String {
    let cheapest = COSTS.map(|(name, unit, cost)| {
        let exact = points.iter().filter(|point| shown(point.true_m) == 0.0);
        let least = exact.min_by(|a, b| cost(a).total_cmp(&cost(b)));
        least.map_or(String::new(), |point| {
            let value = match unit {
                Unit::Bytes => bytes(cost(point) as u64),
                _ => digits(cost(point)),
            };
            format!("{}: {} ({value})", escaped(name), escaped(&called(point)))
        })
    });
    let costs = COSTS.map(|(_, _, cost)| best(points, cost).len());
    format!(
        "Of {} settings {} are on the front of time, {} on that of memory and {} on that of bytes. No error at the least {}.",
        points.len(),
        costs[0],
        costs[1],
        costs[2],
        cheapest.join("; ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_holds_what_nothing_beats() {
        let point = |us: f64, metres: f64| {
            let mut point = Point::new("m", Knob::Local, 0.0);
            point.tick_us.p50 = us;
            point.true_m = metres;
            point
        };
        let points = [
            point(1.0, 1e-3),
            point(2.0, 2e-3),
            point(2.0, 1e-4),
            point(3.0, 1e-4),
            point(4.0, 0.0),
        ];
        let all: Vec<&Point> = points.iter().collect();
        let front = best(&all, |p| p.tick_us.p50);
        let times: Vec<f64> = front.iter().map(|p| p.tick_us.p50).collect();
        assert_eq!(times, [1.0, 2.0, 4.0]);
        assert!(on_front(&all).contains("3 are on the front of time"));
    }

    #[test]
    fn settings_are_named_where_they_are_those_of_every_model() {
        let point = |label: &str| {
            let mut point = Point::new("m", Knob::BaseMesh, 0.0);
            point.label = label.to_string();
            point
        };
        let one = vec![point("100 faces"), point("400 faces")];
        let other = vec![point("100 faces"), point("6400 faces")];
        let alike = first_and_last(&[one.clone(), one.clone()]);
        assert!(alike.starts_with("With 100 faces against 400 faces,"));
        let apart = first_and_last(&[one, other]);
        assert!(apart.starts_with("With 100 faces against the last one,"));
        assert!(!apart.contains("400 faces"), "{apart}");
    }

    #[test]
    fn a_rate_is_another_touch() {
        let is_same = |knob: &Knob| knob.is_same_touch();
        let same: Vec<Knob> = Knob::OTHERS.into_iter().filter(is_same).collect();
        assert!(same.contains(&Knob::Cache) && !same.contains(&Knob::Rate));
    }
}
