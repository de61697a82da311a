//! `rt-tests jitter` and `zwidth` as a user types them. Verdicts on times are the machine's affair;
//! everything else must hold.

use super::typed::{json, number, refusal, rt_tests, said};

const JITTER: &str = "--seconds=10 --load=io --rate=500 --spin --json";

#[test]
fn a_jitter_run_counts_every_tick_of_three_loops_and_its_verdict_is_its_status() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = rt_tests("jitter");
    command
        .args(JITTER.split(' '))
        .arg("--out")
        .arg(folder.path());
    let output = command.output().unwrap();
    let found = json(&output);
    let said = said(&output);
    let is_pass = found["verdict"] == "pass";
    assert_eq!(output.status.code(), Some(i32::from(!is_pass)), "{said}");
    assert!(!found["reasons"].as_array().unwrap().is_empty());
    let of = |path: &str| number(&found, path);
    assert_eq!(
        (of("rate_hz"), of("spin_us"), of("pairs")),
        (500.0, 100.0, 5.0)
    );
    for side in ["ours", "reference", "bare"] {
        for none in ["drift_ns_max", "unaccounted_periods", "extra_switches"] {
            assert_eq!(of(&format!("{side}.{none}")), 0.0, "{side} {none}: {found}");
        }
        assert_eq!(of(&format!("{side}.allocations")), 0.0);
        assert!(of(&format!("{side}.ticks")) > 100.0);
        for times in ["wake_us", "work_cpu_us", "work_wall_us", "period_us"] {
            let quantile = |q: &str| of(&format!("{side}.{times}.{q}"));
            let spread = ["p50", "p99", "p999", "p9999", "max"].map(quantile);
            assert!(spread.is_sorted(), "{side} {times}: {spread:?}");
        }
    }
    // 0.4, 0.4 and 0.2 of the time; a stall at the end of a block is not counted.
    let periods = |side: &str| of(&format!("{side}.ticks")) + of(&format!("{side}.missed"));
    assert!(periods("reference") <= 2000.0 && periods("bare") <= 1000.0);
    assert!(of("ours.spun_us_mean") > 0.0);
    assert!(of("operations_max") <= of("operations_budget"));
    let queries = of("query_work_max");
    assert!(
        queries > 0.0 && queries <= of("query_work_budget"),
        "{found}"
    );
    assert!(
        of("contact_ticks") > 0.0 && of("contact_share") <= 1.0,
        "{found}"
    );
    assert_eq!(found["non_finite"], serde_json::json!([]));
    for file in ["histogram.svg", "result.json"] {
        assert!(folder.path().join(file).is_file(), "{file}");
    }
}

#[test]
fn a_rate_that_no_loop_has_is_refused() {
    let output = rt_tests("jitter").arg("--rate=50").output().unwrap();
    assert!(refusal(&output).contains("--rate"));
}

#[test]
fn the_stiffest_wall_comes_from_a_measured_period_and_beside_theory() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = rt_tests("zwidth");
    command
        .args(["--seconds=1", "--json", "--out"])
        .arg(folder.path());
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let found = json(&output);
    for field in "k_max_measured k_max_theory period_s damping".split(' ') {
        assert!(number(&found, field) > 0.0, "{field}");
    }
    assert!(number(&found, "delay_ticks") >= 0.0);
    assert!(folder.path().join("zwidth.svg").is_file());
}
