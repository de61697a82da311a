//! `rt-tests thesis` as a user types it, on the sphere that it makes itself.

use crate::typed::{json, number, refusal, rt_tests, said};
use serde_json::Value;
use spm_builder::generate::{Shape, generate};
use spm_builder::write_mesh;
use std::path::Path;

fn thesis(out: &Path, more: &[&str]) -> Value {
    let mut command = rt_tests("thesis");
    let output = command.arg("--out").arg(out).arg("--json").args(more);
    let output = output.output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    json(&output)
}

fn series<'a>(figure: &'a Value, ending: &str) -> &'a Value {
    let all = figure["series"].as_array().unwrap();
    let found = all
        .iter()
        .find(|of| of["name"].as_str().unwrap().ends_with(ending));
    found.unwrap_or_else(|| panic!("no {ending} in {figure}"))
}

#[test]
fn every_figure_is_measured_beside_what_is_published() {
    let folder = tempfile::tempdir().unwrap();
    let found = thesis(folder.path(), &[]);
    let figures = found["figures"].as_array().unwrap();
    let numbers: Vec<&str> = figures
        .iter()
        .map(|of| of["figure"].as_str().unwrap())
        .collect();
    let expected = [
        "3.3.3", "4.2", "table4.1", "4.7", "4.3.2", "4.8", "5.16", "5.8", "5.19", "5.20",
    ];
    assert_eq!(numbers, expected);
    let figure = |number| &figures[numbers.iter().position(|&of| of == number).unwrap()];
    let law = figure("4.2")["series"].as_array().unwrap();
    // Shares of all splits are rounded, and there are fifty steps in them.
    let rounding = 100.0 * f64::EPSILON;
    let is_same = |of: &Value| {
        let published = of["published"][0].as_f64().unwrap();
        (number(of, "ours") - published).abs() <= rounding
    };
    assert!(law.len() == 22 && law.iter().all(is_same));
    for figure in figures {
        assert!(figure["says"].as_str().unwrap().ends_with('.'), "{figure}");
        assert!(!figure["quotes"].as_array().unwrap().is_empty());
        for of in figure["series"].as_array().unwrap() {
            assert!(number(of, "ours").is_finite());
            let published = of["published"].as_array().unwrap();
            assert!(published.iter().all(Value::is_number), "{of}");
        }
    }
    // Theorem 2 is a bound, boxes do not depend on the link, and the same faces are found.
    let marked = series(figure("4.7"), "nodes marked over Theorem 2, most");
    assert!(number(marked, "ours") <= 1.0, "{marked}");
    let local = series(figure("5.20"), "pairs of nodes, full over local");
    assert!((0.5..2.0).contains(&number(local, "ours")), "{local}");
    let evicted = figure("5.16")["series"].as_array().unwrap();
    let evicted: Vec<f64> = evicted
        .iter()
        .filter(|of| of["name"].as_str().unwrap().contains("evicted"))
        .map(|of| number(of, "ours"))
        .collect();
    assert_eq!(evicted[1..], [0.0, 0.0], "with room nothing is evicted");
    let page = std::fs::read_to_string(folder.path().join("thesis.html")).unwrap();
    assert!(page.contains("Figure 5.20") && page.contains("<svg"));
}

#[test]
fn a_file_is_taken_for_what_its_name_says_and_none_is_dropped() {
    let folder = tempfile::tempdir().unwrap();
    let names = ["hemisphere.obj", "cow-left.obj", "cow-right.obj"];
    let paths = names.map(|name| folder.path().join(name));
    for (path, faces) in paths.iter().zip([600, 600, 5000]) {
        write_mesh(&generate(Shape::Relief, faces, 1), path).unwrap();
    }
    let mut command = rt_tests("thesis");
    command
        .args(&paths)
        .args(["--figure", "table4.1", "--json"]);
    let output = command.arg("--out").arg(folder.path()).output().unwrap();
    let said = said(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    let expected = ["sphere", "cow", "hemisphere.obj", "cow-left.obj"];
    assert_eq!(json(&output)["models"], serde_json::json!(expected));
    for line in [
        format!("cow of Table 4.1: {}", paths[2].display()),
        format!("not of Table 4.1: {}", paths[0].display()),
        format!("not of Table 4.1: {}", paths[1].display()),
    ] {
        assert!(said.contains(&line), "{line}: {said}");
    }
}

#[test]
fn one_figure_alone_and_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let found = thesis(folder.path(), &["--figure", "table4.1"]);
    let figures = found["figures"].as_array().unwrap();
    assert_eq!(figures.len(), 1);
    let vsps = series(&figures[0], "vertex split records");
    assert_eq!(vsps["published"], serde_json::json!([2023.0]));
    for (more, expected) in [
        (["--figure", "4.3"], "4.3"),
        (["nowhere/dragon.obj", "--json"], "dragon.obj"),
    ] {
        let mut command = rt_tests("thesis");
        let output = command.arg("--out").arg(folder.path()).args(more).output();
        assert!(refusal(&output.unwrap()).contains(expected));
    }
}
