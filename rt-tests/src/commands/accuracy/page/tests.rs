//! The page of made-up numbers.

use super::super::result::{Check, StageQuantiles};
use super::*;
use crate::report::quantile::Quantiles;

/// Numbers of the kind that a run gives, on so many models.
fn found(models: usize) -> Accuracy {
    let mut found = Accuracy {
        pass: true,
        checks: vec![Check {
            model: "a<b".to_string(),
            name: "one & all".to_string(),
            pass: true,
            worst: 0.0,
            limit: 1e-9,
            compared: true,
        }],
        ..Accuracy::new(1, 5.0, 0.15, 0.1)
    };
    for model in 0..models {
        let name = format!("a<b{model}");
        let tolerances = [0.2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 0.0];
        for (knob, factor) in [(Knob::Local, 1.0), (Knob::Global, 2.0), (Knob::Prefix, 3.0)] {
            for (index, value) in tolerances.into_iter().enumerate() {
                let time = (2.0 + model as f64) * (1.0 + 0.05 * index as f64) * factor;
                let error = if value == 0.2 { 4e-3 } else { 0.4 * value };
                let mut point = Point::new(&name, knob, value);
                point.full_mesh = value == 0.0;
                point.model_place = model;
                point.tick_us = Quantiles {
                    p50: time,
                    p99: 3.0 * time,
                    p999: 5.0 * time,
                    max: 9.0 * time,
                };
                let stage = StageQuantiles {
                    mean: 0.2 * time,
                    ..StageQuantiles::default()
                };
                point.stage_us.query = stage;
                point.stage_us.refine = stage;
                (point.true_m, point.true_p50_m) = (error, 0.3 * error);
                point.certified_m = 9.0 * error;
                point.bytes = (2e4 * factor * 1.8_f64.powi(index as i32)) as u64;
                point.rss_bytes = 4_000_000 + point.bytes;
                point.ready_ms = 5.0;
                found.points.push(point);
            }
        }
        found.bytes.push(Bytes {
            model: name,
            vertices: 18_886,
            faces: 37_576,
            first_touch_bytes: 16_640,
            local_full_bytes: -1,
            trajectory_bytes: 3_700_000,
            records_bytes: 1_200_000,
            plain_bytes: 677_000,
        });
    }
    found
}

#[test]
fn any_number_of_models_gives_a_page_that_is_whole_and_stands_alone() {
    let machine = Machine::read();
    for models in [0, 1, 2, 5] {
        let page = page(&found(models), &machine);
        assert!(page.starts_with("<!DOCTYPE html>") && page.ends_with("</html>\n"));
        assert!(!page.contains("NaN") && !page.contains("inf"), "{models}");
        assert_eq!(page.matches("<svg").count(), page.matches("</svg>").count());
        assert!(!page.contains("a<b") && !page.contains("src="));
        let others = page.replace("http://www.w3.org/2000/svg", "");
        assert!(!others.contains("http"), "nothing from elsewhere");
    }
}

#[test]
fn what_was_never_reached_is_not_said_to_cost_nothing() {
    let machine = Machine::read();
    let mut found = found(2);
    let text = page(&found, &machine);
    assert!(text.contains("full resolution was never reached"));
    found.bytes[1].local_full_bytes = 1 << 20;
    let text = page(&found, &machine);
    assert!(text.contains("has needed 1.0 MiB where it was reached"));
    found.bytes[0].local_full_bytes = 2 << 20;
    let text = page(&found, &machine);
    assert!(text.contains("has needed 1.0 MiB to 2.0 MiB;"));
}

#[test]
fn what_failed_is_on_the_page_and_a_check_of_nothing_does_not_hold() {
    let machine = Machine::read();
    let mut found = found(1);
    assert!(page(&found, &machine).contains("1 of 1 hold."));
    found.checks[0].compared = false;
    found
        .failed
        .push("the tour of <b> touches nothing".to_string());
    let text = page(&found, &machine);
    assert!(
        text.contains("0 of 1 hold, 1 had nothing to compare."),
        "{text}"
    );
    assert!(text.contains("Failed: the tour of &lt;b&gt; touches nothing."));
    assert!(text.contains("<td>nothing to compare") && !text.contains("<td>holds"));
}

#[test]
fn models_of_one_name_stay_apart() {
    let mut found = found(2);
    for point in &mut found.points {
        point.model = "cow".to_string();
    }
    let groups = Group::all(&found);
    let counts: Vec<usize> = groups.iter().map(|group| group.points.len()).collect();
    assert_eq!(counts, [27, 27]);
    assert_eq!(groups[1].bytes, Some(&found.bytes[1]));
}
