//! `rt-tests compare` as a user types it, on a small shape.

use crate::typed::{json, number, refusal, rt_tests, said};
use serde_json::Value;
use std::path::Path;
use std::process::Output;

fn compare(arguments: &[&str], out: &Path) -> Output {
    let mut command = rt_tests("compare");
    command.args(arguments).arg("--out").arg(out);
    command.output().unwrap()
}

#[test]
fn every_contender_answers_alike_and_the_result_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("new/compare");
    let output = compare(&["relief:3000", "--growth", "4000", "--json"], &out);
    let (found, said) = (json(&output), said(&output));
    let broken = found["broken"].as_array().unwrap();
    // Times are the machine's affair; answers must be right.
    let status = i32::from(!broken.is_empty());
    assert_eq!(output.status.code(), Some(status), "{said}");
    let of = |list: &str| found[list].as_array().unwrap().clone();
    let rows: Vec<Value> = of("rows").into_iter().chain(of("growth")).collect();
    for task in "closest_path closest_path_memory closest_path_cold tool240_pairs tool960_pairs update64 build prepare".split(' ') {
        for list in ["rows", "growth"] {
            let is_there = of(list).iter().any(|row| row["task"] == task);
            assert!(is_there, "{list} {task}");
        }
    }
    for who in "ours_local ours_full parry_f32 parry_f64 parry_f64_moved".split(' ') {
        assert!(rows.iter().any(|row| row["who"] == who), "{who}");
    }
    for row in &rows {
        // Parry in single precision takes triangles for meeting that do not: it is there to be
        // compared with.
        let is_ours = row["who"].as_str().unwrap().starts_with("ours");
        assert!(!is_ours || row["answers_differ"] == 0, "{row}");
        let ns = |field: &str| number(row, field);
        assert!(ns("p50_ns") > 0.0 && ns("p99_ns") >= ns("p50_ns") && ns("max_ns") >= ns("p99_ns"));
    }
    // Figure 4.7: never above Theorem 2, from one leaf to all of them, and near it where the leaves
    // lie evenly.
    let marking = of("marking");
    for row in &marking {
        assert!(number(row, "marked_max") <= number(row, "bound"), "{row}");
    }
    let near = marking
        .iter()
        .filter(|row| row["spread"] == "even" && row["deformed"] == 64)
        .map(|row| number(row, "marked_max") / number(row, "bound"));
    assert!(near.fold(0.0, f64::max) > 0.8);
    assert!(marking.iter().any(|row| row["deformed"] == row["faces"]));
    for row in of("update_share") {
        assert!(number(&row, "update_p50_ns") > 0.0 && number(&row, "query_p50_ns") > 0.0);
    }
    // Figures 5.20 and 4.8: the boxes of the full mesh's tree cost a coarse one little, and what is
    // refined around the contact is searched as the full mesh is.
    for list in ["levels", "growth_levels"] {
        let levels = of(list);
        let pairs = |front: &str| {
            let row = levels.iter().find(|row| row["front"] == front).unwrap();
            number(row, "node_pairs")
        };
        assert!(
            (pairs("local") / pairs("full") - 1.0).abs() < 0.05,
            "{levels:?}"
        );
        for row in levels
            .iter()
            .filter(|row| row["front"] == "prefix" || row["front"] == "coarse")
        {
            let rebuilt = number(row, "node_pairs_rebuilt");
            assert!(number(row, "node_pairs") < 1.1 * rebuilt, "{row}");
        }
    }
    // Every limit beside parry, on the model and on the shape of growth.
    limits_are_judged(&of("limits"), 2 * 8);
    for picture in ["compare.svg", "marking.svg", "levels.svg"] {
        let text = std::fs::read_to_string(out.join(picture)).unwrap();
        assert!(text.contains("</svg>"), "{picture}");
    }
    assert!(out.join("compare.json").is_file());
}

/// Both quantiles of so many limits.
fn limits_are_judged(limits: &[Value], count: usize) {
    assert_eq!(limits.len(), count);
    for limit in limits {
        let share = number(limit, "share_p50").max(number(limit, "share_p99"));
        let is_kept = share <= number(limit, "most");
        assert_eq!(limit["is_kept"], is_kept, "{limit}");
    }
}

#[test]
fn without_growth_no_picture_of_it_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let output = compare(&["relief:1000", "--growth", "0"], folder.path());
    let said = said(&output);
    assert!(output.status.code().is_some_and(|code| code <= 1), "{said}");
    assert!(!folder.path().join("compare.svg").exists());
    for picture in ["marking.svg", "levels.svg", "compare.json"] {
        assert!(folder.path().join(picture).is_file(), "{picture}");
    }
}

#[test]
fn a_missing_file_is_one_sentence_with_status_2() {
    let folder = tempfile::tempdir().unwrap();
    let output = compare(&["nowhere.obj", "--growth", "0"], folder.path());
    let sentence = refusal(&output);
    assert!(sentence.contains("nowhere.obj"), "{sentence}");
}

#[test]
fn a_name_that_is_none_is_refused_before_another_model_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for (second, named) in [
        ("nowhere.obj", "nowhere.obj"),
        ("relief:many", "relief:20000"),
    ] {
        let output = compare(&["relief:3000", second], &out);
        let sentence = refusal(&output);
        assert!(sentence.contains(named), "{sentence}");
        let said = said(&output);
        assert!(
            !said.contains("building") && !said.contains("measuring"),
            "{said}"
        );
        assert!(!out.exists(), "not even an empty folder");
    }
}
