//! What an update of the tree costs beside Theorem 2 (Figure 4.7), and the costs of 3.3.3.

use super::pairs::{ask, copy_of, touching};
use super::result::{Figure, Quote, Series};
use super::{Study, StudyModel};
use crate::commands::compare::full_front::FullFront;
use crate::commands::compare::marking::{Marking, Spread, markings, shares};
use crate::failure::Failure;
use crate::models::surface::Surface;
use crate::report::chart::{Axis, Chart, Curve, GREY, Stroke, Unit, xs, ys};
use crate::report::quantile::{median, range};
use crate::report::units::digits;

/// The thesis: an update of at most this share of the faces ...
const SHARE: f64 = 0.1;
/// ... takes less than this share of a query (4.3.2).
const OF_A_QUERY: f64 = 0.15;
/// Updates of so many leaves and more say what a leaf costs; fewer are mostly the clock.
const MIN_DEFORMED: u32 = 16;
/// The thesis: time follows the theorem unless k is very close to n; so those up to n over this.
const FAR_FROM_ALL: u32 = 8;

/// Figure 4.7.
///
/// # Errors
/// When a model cannot be refined.
pub fn figure_4_7(study: &Study) -> Result<Figure, Failure> {
    let (mut series, mut charts) = (Vec::new(), Vec::new());
    let (mut spread, mut local, mut whole) = (Vec::new(), Vec::new(), Vec::new());
    let mut all = Vec::new();
    for of in &study.models {
        study.says(of, "updates of the tree");
        let random = &mut study.random();
        let front = FullFront::prefix(&of.model, of.model.records.len())?;
        let rows: Vec<Marking> = markings(&of.model, &front, random);
        let even: Vec<&Marking> = rows
            .iter()
            .filter(|row| row.spread == Spread::Even)
            .collect();
        let apart = proportion(&even);
        spread.push(apart);
        let [_, marked] = range(rows.iter().map(marked_over_bound));
        series.push(
            Series::new(
                format!("{}: nodes marked over Theorem 2, most", of.name),
                "",
                marked,
            )
            .beside(&[0.0, 1.0]),
        );
        series.push(Series::new(
            format!(
                "{}: time over Theorem 2, largest over smallest of all k",
                of.name
            ),
            "",
            apart,
        ));
        let full = Surface::new(of.model.full_triangles());
        let shares = shares(&of.model, &full, random)?;
        let tenth = shares.iter().filter(|row| row.deformed_share >= SHARE);
        let [_, of_a_touch] = range(tenth.map(|row| row.share_p50));
        local.push(of_a_touch);
        let of_two = of_a_query_of_two(study, of, &front, &rows)?;
        whole.push(of_two);
        for (what, share) in [
            (
                "update of 10 % of a local front over the query of a tool on it",
                of_a_touch,
            ),
            (
                "update of 10 % of all faces over the query of two objects",
                of_two,
            ),
        ] {
            let name = format!("{}: {what}", of.name);
            series.push(Series::new(name, "", share).beside(&[0.0, OF_A_QUERY]));
        }
        charts.push(chart(of, &even));
        all.extend(rows);
    }
    let most = |of: &[f64]| digits(range(of.iter().copied())[1]);
    let says = format!(
        "{} Where the deformed leaves lie evenly, which marks \
         most, and are at most an eighth of all, time over the theorem's count varies by a factor of at most {} \
         over all k: the time follows the theorem, with a little more a node where few share their ancestors. An \
         update of a tenth of a local front takes at most {} of the query of a tool that touches there, where the \
         thesis has less than 0.15; beside the query of two whole objects a tenth of all faces takes up to {} of \
         it: our query is short, since two touching objects meet in few faces, and the thesis does not say how \
         deep its objects lay in each other.",
        says_marked(&all),
        most(&spread),
        most(&local),
        most(&whole)
    );
    let names = study.models.iter().take(1).flat_map(|of| {
        [
            ("measured".to_string(), of.color, Stroke::Solid),
            ("Theorem 2, scaled".to_string(), GREY, Stroke::Dotted),
        ]
    });
    Ok(Figure {
        figure: "4.7",
        title: "Time of an update of the tree beside Theorem 2",
        series,
        says,
        quotes: vec![
            Quote {
                section: "4.3.2",
                line: 2565,
                text: "The measured CPU time increases in proportional to the analytical results when k, the number \
                    of leaves to be marked in the BVH increases. The only exceptions are the cases when k is very \
                    close to n.",
            },
            Quote {
                section: "4.3.2",
                line: 2570,
                text: "when k is smaller than 10% of the total number of faces in the original mesh, the updating \
                    operation requires less than 15% of the query time.",
            },
        ],
        charts,
        names: names.collect(),
    })
}

/// Whether the nodes marked keep the theorem, in a sentence.
fn says_marked(rows: &[Marking]) -> String {
    let over = |row: &&Marking| u64::from(row.marked_max) > row.bound;
    let beyond: Vec<f64> = rows.iter().filter(over).map(marked_over_bound).collect();
    if beyond.is_empty() {
        return "No update marked more nodes than Theorem 2 allows.".to_string();
    }
    format!(
        "Of {} ways to deform leaves {} marked more nodes than Theorem 2 allows, up to {} times as many.",
        rows.len(),
        beyond.len(),
        digits(range(beyond.iter().copied())[1])
    )
}

fn marked_over_bound(row: &Marking) -> f64 {
    f64::from(row.marked_max) / row.bound as f64
}

/// Rows whose time says what a leaf costs.
fn fitting<'a>(even: &'a [&'a Marking]) -> impl Iterator<Item = &'a Marking> {
    let rows = even.iter().copied();
    rows.filter(|row| row.deformed >= MIN_DEFORMED && row.deformed <= row.faces / FAR_FROM_ALL)
}

fn ns_a_node(row: &Marking) -> f64 {
    row.update_p50_ns / row.bound as f64
}

/// Time over the theorem's count, the largest over the smallest.
fn proportion(even: &[&Marking]) -> f64 {
    let [low, high] = range(fitting(even).map(ns_a_node));
    high / low
}

/// An update of a tenth of all faces, in a patch, over the query of a model and its copy.
fn of_a_query_of_two(
    study: &Study,
    of: &StudyModel,
    front: &FullFront,
    rows: &[Marking],
) -> Result<f64, Failure> {
    let tenth = SHARE * f64::from(of.faces());
    let patches = || rows.iter().filter(|row| row.spread == Spread::Patch);
    // Between two measured k the time is taken to be proportional.
    let below = patches().rfind(|row| f64::from(row.deformed) <= tenth);
    let update = below.map_or(f64::NAN, |row| {
        row.update_p50_ns * tenth / f64::from(row.deformed)
    });
    let poses = touching(&of.model, front, &mut study.random())?;
    let mut copy = copy_of(&of.model, front.surface())?;
    Ok(update / ask(&[front.surface()], &mut copy, &poses)[0].p50_ns)
}

fn chart(of: &StudyModel, even: &[&Marking]) -> Chart {
    let ns: Vec<f64> = fitting(even).map(ns_a_node).collect();
    let scale = median(&ns) * 1e-3;
    let at = |row: &&Marking| f64::from(row.deformed);
    let time = even.iter().map(|row| (at(row), row.update_p50_ns * 1e-3));
    let theory = even.iter().map(|row| (at(row), row.bound as f64 * scale));
    let curves = vec![
        Curve::new("measured", of.color, Stroke::Solid, time),
        Curve::new("Theorem 2, scaled", GREY, Stroke::Dotted, theory),
    ];
    let x = Axis::over("leaves deformed: k", Unit::Number, xs(&curves));
    let y = Axis::over("time of an update, µs", Unit::Time, ys(&curves));
    Chart::new(&of.name, x, y, curves)
}

/// The costs of 3.3.3: building the tree, and a query as boxes and faces.
///
/// # Errors
/// When a model cannot be refined.
pub fn costs(study: &Study) -> Result<Figure, Failure> {
    let mut series = Vec::new();
    let (mut build, mut points) = (Vec::new(), Vec::new());
    for of in &study.models {
        study.says(of, "building the tree, and queries of two objects");
        let full = FullFront::new(&of.model)?;
        let leaf = full.build_ns / f64::from(of.faces());
        build.push((f64::from(of.faces()), full.build_ns * 1e-3));
        series.push(Series::new(
            format!("{}: building the tree, a leaf", of.name),
            "ns",
            leaf,
        ));
        let poses = touching(&of.model, &full, &mut study.random())?;
        let mut copy = copy_of(&of.model, full.surface())?;
        for share in [0.1, 0.3] {
            let splits = (share * of.model.records.len() as f64) as usize;
            let front = FullFront::prefix(&of.model, splits)?;
            points.extend(ask(&[front.surface()], &mut copy, &poses));
        }
        points.extend(ask(&[full.surface()], &mut copy, &poses));
    }
    let counts = points
        .iter()
        .map(|q| [f64::from(q.work.boxes), f64::from(q.work.faces), q.sum_ns]);
    let counts: Vec<[f64; 3]> = counts.collect();
    let [boxes, faces] = fit(&counts);
    let apart = counts.iter().map(|[b, f, ns]| (boxes * b + faces * f) / ns);
    let [low, high] = range(apart);
    series.push(Series::new("pair of boxes: C_bv", "ns", boxes));
    series.push(Series::new("pair of faces: C_p", "ns", faces));
    let leaves = build.iter().map(|(n, us)| us * 1e3 / n);
    let [fast, slow] = range(leaves);
    let curve = Curve::new("models", study.models[0].color, Stroke::Dots, build);
    let curves = vec![curve];
    let x = Axis::over("faces of the full mesh: n", Unit::Number, xs(&curves));
    let y = Axis::over("building the tree, µs", Unit::Time, ys(&curves));
    Ok(Figure {
        figure: "3.3.3",
        title: "Costs of the tree and of a query",
        series,
        says: format!(
            "Building the tree takes {} to {} ns a leaf on the models, so it is O(n) up to what the caches of the \
             processor hold. The time of the queries of two objects is N_bv C_bv + N_p C_p with the two costs above, \
             fitted over all models and levels of detail; the sum is {} to {} times the measured time. The thesis \
             gives the forms and no number.",
            digits(fast),
            digits(slow),
            digits(low),
            digits(high)
        ),
        quotes: vec![
            Quote {
                section: "3.3.3",
                line: 2142,
                text: "The time cost of procedure ACTIVE-PRECONSTRUCT is O(n)",
            },
            Quote {
                section: "3.3.3",
                line: 2240,
                text: "The procedure ACTIVE_INTERSECT performs collision queries on AB-trees. Its complexity is given \
                    in [GLM96] as: T_q = N_bv x C_bv + N_p x C_p",
            },
        ],
        charts: vec![Chart::new("Building the tree", x, y, curves)],
        names: Vec::new(),
    })
}

/// Least squares of the relative errors: the costs of a pair of boxes and of a pair of faces, ns.
fn fit(counts: &[[f64; 3]]) -> [f64; 2] {
    let (mut bb, mut bf, mut ff, mut b1, mut f1) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for [boxes, faces, ns] in counts {
        let (b, f) = (boxes / ns, faces / ns);
        bb += b * b;
        bf += b * f;
        ff += f * f;
        b1 += b;
        f1 += f;
    }
    let determinant = bb * ff - bf * bf;
    let pair = [
        (b1 * ff - f1 * bf) / determinant,
        (f1 * bb - b1 * bf) / determinant,
    ];
    if pair.iter().all(|cost| cost.is_finite() && *cost >= 0.0) {
        return pair;
    }
    // One count follows the other: boxes carry all of it.
    [b1 / bb, 0.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sentence_on_the_theorem_is_that_of_the_measurement() {
        let row = |marked_max| Marking {
            model: "m".to_string(),
            faces: 1024,
            deformed: 1,
            spread: Spread::Even,
            marked_max,
            bound: 12,
            update_p50_ns: 1.0,
        };
        assert!(says_marked(&[row(11), row(12)]).starts_with("No update"));
        let beyond = says_marked(&[row(12), row(18), row(24)]);
        assert!(beyond.contains("Of 3 ways") && beyond.contains("2 marked more"));
        assert!(beyond.contains("up to 2 times"), "{beyond}");
    }

    #[test]
    fn without_a_row_that_fits_there_is_no_proportion() {
        assert!(proportion(&[]).is_nan());
    }

    #[test]
    fn the_fit_finds_the_costs_that_made_the_times() {
        let made = |b: f64, f: f64| [b, f, 5.0 * b + 80.0 * f];
        let [boxes, faces] = fit(&[made(1000.0, 3.0), made(500.0, 40.0), made(90.0, 90.0)]);
        assert!((boxes - 5.0).abs() < 1e-9 && (faces - 80.0).abs() < 1e-9);
        // Counts in proportion cannot be told apart.
        let [boxes, faces] = fit(&[[100.0, 0.0, 500.0], [200.0, 0.0, 1000.0]]);
        assert!((boxes - 5.0).abs() < 1e-9 && faces == 0.0);
    }
}
