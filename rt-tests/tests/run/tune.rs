//! `rt-tests tune` and `check` as a user types them. How fast the machine is is its own affair.

use super::typed::{json, number, refusal, rt_tests, said};
use scene::{NoFiles, Overrides, parse};
use serde_json::Value;
use std::path::Path;

fn tune(limit: [&str; 2]) -> Value {
    let output = rt_tests("tune")
        .args(limit)
        .args(["--seconds", "3", "--json"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let found = json(&output);
    assert_eq!(found["met"], true, "{found}");
    found
}

/// The printed fragment before an object and a probe.
fn loaded(found: &Value) -> scene::ScenePlan {
    let fragment = found["settings"].as_str().unwrap();
    let text = format!("{fragment}[[object]]\nmodel = \"m.spm\"\nsize_m = 0.15\n[[probe]]\n");
    parse(&text, "s", Path::new(""), &Overrides::default(), &NoFiles).unwrap()
}

#[test]
fn settings_for_an_error_keep_it_in_a_run_and_are_no_finer_than_needed() {
    let found = tune(["--error", "0.3mm"]);
    let measured = number(&found, "measured.error_m");
    assert!(measured <= 3e-4, "{found}");
    // No finer than needed: the next finer setting is clearly finer.
    assert!(number(&found, "tolerance_m") > 1e-5, "{found}");
    let plan = loaded(&found);
    assert_eq!(plan.accuracy.tolerance_m, number(&found, "tolerance_m"));
    assert!(found["asked"].get("time_us").is_none() && found["next"].is_array());
    let slower = found["slower"].as_array().unwrap();
    let factors: Vec<f64> = slower.iter().map(|of| of[0].as_f64().unwrap()).collect();
    assert_eq!(factors, [2.0, 4.0, 8.0]);
    assert!(
        slower.iter().all(|of| number(&of[1], "error_m") > 0.0),
        "{found}"
    );
}

#[test]
fn settings_for_a_memory_and_for_bytes_keep_them() {
    let found = tune(["--memory", "3MiB"]);
    let limit = 3.0 * 1048576.0;
    assert!(number(&found, "measured.memory_bytes") <= limit, "{found}");
    let plan = loaded(&found);
    assert_eq!(plan.cache_bytes as f64, number(&found, "cache_bytes"));
    assert!(number(&found, "cache_bytes") < limit);
    let found = tune(["--bytes", "400KiB"]);
    assert!(
        number(&found, "measured.bytes") <= 400.0 * 1024.0,
        "{found}"
    );
    assert_eq!(found["binds"], "the bytes", "{found}");
}

#[test]
fn limits_that_are_none_or_cannot_be_kept_are_one_sentence() {
    for typed in [
        &["--error", "0.1kg"][..],
        &["--memory", "1B"],
        &["--time", "-1us"],
        &[],
    ] {
        let output = rt_tests("tune").args(typed).output().unwrap();
        refusal(&output);
    }
    let arguments = ["--bytes", "1KiB", "--seconds", "1"];
    let output = rt_tests("tune").args(arguments).output().unwrap();
    let said = said(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("not even the base mesh"), "{said}");
}

#[test]
fn a_check_gives_a_verdict_a_line_and_a_remedy_where_it_is_not_good() {
    let output = rt_tests("check").arg("--json").output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let found = json(&output);
    let lines = found["lines"].as_array().unwrap();
    assert_eq!(lines.len(), 8, "{found}");
    for line in lines {
        let is_good = line["verdict"] == "good";
        assert_eq!(
            line["remedy"].as_str().unwrap().is_empty(),
            is_good,
            "{line}"
        );
        assert!(!line["says"].as_str().unwrap().is_empty());
    }
    assert!(number(&found, "k_max_n_per_m") > 0.0, "{found}");
    assert!(number(&found, "greatest_speed_m_per_s") > 0.0, "{found}");
}
