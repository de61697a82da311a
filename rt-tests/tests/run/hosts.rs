//! Two hosts of this machine. Without the rights, or with programs built without the link, the
//! command says what is missing, and that is all that is asked of it.

use super::typed::{json, number, refusal, rt_tests, said};

#[test]
fn a_touch_over_a_link_is_seen_beside_the_one_on_one_machine() {
    let out = tempfile::tempdir().unwrap();
    let mut command = rt_tests("hosts");
    command.args(["--rtt-ms=5", "--mbit=50", "--loss=0.01", "--seconds=6"]);
    let output = command.arg("--json").arg("--out").arg(out.path()).output();
    let output = output.unwrap();
    if output.status.code() == Some(2) {
        let sentence = refusal(&output);
        assert!(sentence.contains("--features"), "{sentence}");
        eprintln!("skipped: {sentence}");
        return;
    }
    let found = json(&output);
    if let Some(why) = found["skipped"].as_str() {
        assert!(said(&output).contains(why), "{}", said(&output));
        eprintln!("skipped: {why}");
        return;
    }
    assert!(output.status.success(), "{}", said(&output));
    let rows = found["rows"].as_array().unwrap();
    let [local, far] = &rows[..] else {
        panic!("{found}");
    };
    for row in [local, far] {
        assert!(number(row, "vsps_received") > 0.0, "{row}");
        assert!(number(row, "contact_full_ticks") > 0.0, "{row}");
    }
    assert!(local["wire"].is_null(), "{local}");
    assert_eq!(number(far, "wire.rtt_ms"), 5.0);
    assert_eq!(number(far, "wire.mbit_per_s"), 50.0);
    // Nothing but the link joins the hosts: all that was received is on it.
    let carried = number(far, "wire.to_controller.arrived_bytes");
    assert!(carried > 0.0 && number(far, "wire.to_station.arrived_bytes") > 0.0);
    assert!(number(far, "wire.to_controller.lost") > 0.0, "{far}");
    let chart = std::fs::read_to_string(out.path().join("hosts.svg")).unwrap();
    assert!(chart.contains("50 Mbit/s"));
}

#[test]
fn numbers_that_no_link_has_are_refused() {
    for (typed, expected) in [
        ("--rtt-ms=1,-2", "--rtt-ms has -2"),
        ("--mbit=0", "--mbit has 0"),
        ("--loss=1.5", "--loss is 1.5"),
        ("--jitter-ms=NaN", "--jitter-ms is NaN"),
        ("--cut=9", "--cut is 9"),
    ] {
        let output = rt_tests("hosts").arg(typed).output().unwrap();
        let sentence = refusal(&output);
        assert!(sentence.contains(expected), "{sentence}");
    }
}
