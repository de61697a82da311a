//! How fast the level of detail rises and falls (Figure 4.2): the policy of the thesis, as the
//! controller runs it, beside the formulas of 4.1.2.

use super::Study;
use super::result::{Figure, Quote, Series};
use crate::failure::Failure;
use crate::report::chart::{Axis, COLORS, Chart, Curve, GREY, Stroke, xs, ys};
use hrtc_core::policy::Seen;
use hrtc_core::policy::reactive::{Load, Reactive};

/// j of the figure: the frame after which the case changed.
const J: u32 = 5;
/// Its last frame with a rise.
const LAST: u32 = 10;
/// ALOD is all splits over this (4.1.2).
const STEPS: f64 = 50.0;
/// Objects of Q1, Q2 and Q3, where a class is a halving of importance.
const CLASSES: [(&str, f64); 3] = [("Q1, β = 1", 1.0), ("Q2, β = 2", 0.5), ("Q3, β = 3", 0.25)];

/// Time of a frame beside what it may take, in each of the three cases.
#[derive(Clone, Copy)]
enum Case {
    Finer,
    Coarser,
    Same,
}

/// g1(i, j, β).
fn rise(i: u32, class: u32) -> f64 {
    let since = i64::from(i) - i64::from(J);
    match since - i64::from(class) {
        less if less < 0 => 0.0,
        exponent => (exponent as f64).exp2(),
    }
}

/// g2(i, j).
fn fall(i: u32) -> f64 {
    if 2 * J < i + 1 {
        1.0
    } else {
        f64::from(2 * J - i).exp2()
    }
}

/// Steps, in ALOD, that the policy takes in frames J + 1 to `last` of a case after J of another
/// one, of an object of this importance at the probe.
fn course(before: Case, then: Case, last: u32, importance: f64) -> Vec<f64> {
    let seen = Seen {
        importance,
        distance: 0.0,
        speed: 0.0,
    };
    // A tick of a second is longer than a frame: each is one.
    let mut policy = Reactive::new(1.0);
    let mut frame = |case: Case, from: f64| {
        let spent = match case {
            Case::Finer => 0.5,
            Case::Same => 0.95,
            Case::Coarser => 1.5,
        };
        let load = Load {
            allowed: 1.0,
            spent,
            left: 0.0,
        };
        policy.end_tick(load, || true);
        STEPS * (policy.stepped(from, Some(seen)) - from)
    };
    (0..J).for_each(|_| {
        frame(before, 0.5);
    });
    // From where there is room for the step, so that it is seen whole.
    let from = match then {
        Case::Coarser => 1.0,
        Case::Finer | Case::Same => 0.0,
    };
    (J..last).map(|_| frame(then, from)).collect()
}

/// Whether two steps are the same but for the rounding of shares of all splits.
fn is_same(step: f64, other: f64) -> bool {
    (step - other).abs() <= 2.0 * STEPS * f64::EPSILON
}

/// Figure 4.2.
///
/// # Errors
/// None; as the other figures.
pub fn figure_4_2(_: &Study) -> Result<Figure, Failure> {
    let (mut series, mut rising) = (Vec::new(), Vec::new());
    let frames = |last: u32| (J + 1..=last).map(f64::from);
    let mut is_equal = true;
    for (class, (&(name, importance), color)) in (1..).zip(CLASSES.iter().zip(COLORS)) {
        let ours = course(Case::Same, Case::Finer, LAST, importance);
        for (i, &ours) in (J + 1..=LAST).zip(&ours) {
            let theirs = rise(i, class);
            is_equal &= is_same(ours, theirs);
            let name = format!("{name}: g1, frame {i}");
            series.push(Series::new(name, "ALOD", ours).beside(&[theirs]));
        }
        let points = frames(LAST).zip(ours);
        rising.push(Curve::new(name, color, Stroke::Solid, points));
    }
    // Two frames after 2j, where the formula changes.
    let last = 2 * J + 2;
    let ours = course(Case::Finer, Case::Coarser, last, 1.0);
    for (i, &ours) in (J + 1..=last).zip(&ours) {
        is_equal &= is_same(ours, -fall(i));
        let name = format!("all classes: g2, frame {i}");
        series.push(Series::new(name, "ALOD", -ours).beside(&[fall(i)]));
    }
    let points = frames(last).zip(ours.iter().map(|step| -step));
    let falling = vec![Curve::new("all", GREY, Stroke::Solid, points)];
    let chart = |title: &str, curves: Vec<Curve>| {
        let x = Axis::linear("frame i", xs(&curves));
        let y = Axis::linear("step, ALOD", ys(&curves)).with_room();
        Chart::new(title, x, y, curves)
    };
    let names = CLASSES.iter().zip(COLORS);
    let mut names: Vec<_> = names
        .map(|((name, _), color)| ((*name).to_string(), color, Stroke::Solid))
        .collect();
    names.push(("all classes".to_string(), GREY, Stroke::Solid));
    Ok(Figure {
        figure: "4.2",
        title: "Steps of the level of detail after the case changes, j = 5",
        series,
        says: says(is_equal),
        quotes: quotes(),
        charts: vec![
            chart("case 1, time left: finer by g1", rising),
            chart("case 2, too little time: coarser by g2", falling),
        ],
        names,
    })
}

fn says(is_equal: bool) -> String {
    let verdict = if is_equal {
        "The policy `reactive` takes the steps of g1 and g2 in every frame shown"
    } else {
        "The policy `reactive` does not take the steps of g1 and g2"
    };
    format!(
        "{verdict}, for an object at the probe (f = 1). Frames are counted from where the last rise began, since \
         2^(2j - i) counted from the start of a run would exceed any mesh; a class is a halving of importance. The \
         thesis draws the functions and publishes no numbers: those beside ours are its formulas."
    )
}

fn quotes() -> Vec<Quote> {
    let quote = |line, text| Quote {
        section: "4.1.2",
        line,
        text,
    };
    vec![
        quote(2387, "LOD2=LOD1+ALODx f(a,y)x g, j,B)."),
        quote(
            2391,
            "we simplify the calculation of LODs and accelerate the reduction of LODs in comparison with case 1.",
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_policy_takes_the_steps_of_the_formulas() {
        let takes = |course: &[f64], steps: &[f64]| {
            assert_eq!(course.len(), steps.len());
            let all = course.iter().zip(steps);
            assert!(all.into_iter().all(|(&a, &b)| is_same(a, b)), "{course:?}");
        };
        let rising = course(Case::Same, Case::Finer, LAST, CLASSES[1].1);
        takes(&rising, &[0.0, 1.0, 2.0, 4.0, 8.0]);
        let falling = course(Case::Finer, Case::Coarser, 2 * J + 2, 1.0);
        takes(&falling, &[-16.0, -8.0, -4.0, -2.0, -1.0, -1.0, -1.0]);
        takes(&course(Case::Finer, Case::Same, 7, 1.0), &[0.0, 0.0]);
    }
}
