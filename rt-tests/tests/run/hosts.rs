//! Two hosts of this machine. Without the rights, or with programs built without the link, the
//! command says what is missing, and that is all that is asked of it.

use super::typed::{json, number, refusal, rt_tests, said};
use serde_json::Value;
use std::process::Output;

/// What was found, or nothing where the command could not run.
fn found(output: &Output) -> Option<Value> {
    if output.status.code() == Some(2) {
        let sentence = refusal(output);
        assert!(sentence.contains("--features"), "{sentence}");
        eprintln!("skipped: {sentence}");
        return None;
    }
    let found = json(output);
    if let Some(why) = found["skipped"].as_str() {
        assert!(said(output).contains(why), "{}", said(output));
        eprintln!("skipped: {why}");
        return None;
    }
    assert!(output.status.success(), "{}", said(output));
    Some(found)
}

#[test]
fn a_touch_over_a_link_is_seen_beside_the_one_on_one_machine() {
    let out = tempfile::tempdir().unwrap();
    let mut command = rt_tests("hosts");
    command.args(["--rtt-ms=5", "--mbit=50", "--loss=0.01", "--seconds=6"]);
    let output = command.arg("--json").arg("--out").arg(out.path()).output();
    let output = output.unwrap();
    let Some(found) = found(&output) else { return };
    let rows = found["rows"].as_array().unwrap();
    let [local, far] = &rows[..] else {
        panic!("{found}");
    };
    for row in [local, far] {
        assert!(number(row, "vsps_received") > 0.0, "{row}");
        assert!(number(row, "contact_full_ticks") > 0.0, "{row}");
        let times =
            ["heard_ms", "first_force_ready_ms", "first_touch_ms"].map(|name| number(row, name));
        assert!(times.is_sorted(), "{row}");
        assert!(number(row, "local_full_ms") >= 0.0, "{row}");
    }
    assert!(
        local["wire"].is_null() && local["forces"].is_null(),
        "{local}"
    );
    // Both hands follow the same path.
    assert!(number(far, "forces.ticks") > 0.0, "{far}");
    let same = number(far, "forces.same_ticks");
    assert!(same > 0.5 * number(far, "forces.ticks"), "{far}");
    let link = |row: &Value| ["rtt_ms", "loss", "mbit"].map(|name| number(row, name));
    assert_eq!(link(local), [0.0; 3]);
    assert_eq!(link(far), [5.0, 0.01, 50.0]);
    // Nothing but the link joins the hosts: all that was received is on it.
    let carried = number(far, "wire.to_controller.arrived_bytes");
    assert!(carried > 0.0 && number(far, "wire.to_station.arrived_bytes") > 0.0);
    assert!(number(far, "wire.to_controller.lost") > 0.0, "{far}");
    let answers = number(far, "link_bytes.answers");
    assert!(answers > 0.0 && answers < carried, "{far}");
    assert!(number(far, "answer_bytes_per_vsp") < number(local, "answer_bytes_per_vsp"));
    let chart = std::fs::read_to_string(out.path().join("hosts.svg")).unwrap();
    assert!(chart.contains("50 Mbit/s"));
}

#[test]
fn changed_and_repeated_packets_are_refused_and_the_touch_goes_on() {
    let out = tempfile::tempdir().unwrap();
    let mut command = rt_tests("hosts");
    command.args([
        "--rtt-ms=5",
        "--damaged=0.005",
        "--replayed=0.05",
        "--seconds=8",
    ]);
    let output = command.arg("--json").arg("--out").arg(out.path()).output();
    let output = output.unwrap();
    let Some(found) = found(&output) else { return };
    let far = &found["rows"][1];
    for way in ["to_controller", "to_station"] {
        assert!(number(far, &format!("wire.{way}.replayed")) > 0.0, "{far}");
    }
    let damaged = |way: &str| number(far, &format!("wire.{way}.damaged"));
    assert!(
        damaged("to_controller") + damaged("to_station") > 0.0,
        "{far}"
    );
    // Encryption ends the link, and it is made again.
    assert!(number(far, "links_made") > 1.0, "{far}");
    assert!(number(far, "contact_full_ticks") > 0.0, "{far}");
    assert_eq!(number(far, "contact_unbounded_ticks"), 0.0, "{far}");
    assert_eq!(far["has_damaged_chunk"], false);
}

#[test]
fn several_controllers_each_have_a_row_alone_and_one_among_the_others() {
    let out = tempfile::tempdir().unwrap();
    let mut command = rt_tests("hosts");
    command.args(["--controllers=5:50,100:0.25:stopped", "--seconds=6"]);
    let output = command.arg("--json").arg("--out").arg(out.path()).output();
    let output = output.unwrap();
    let Some(found) = found(&output) else { return };
    let rows = found["rows"].as_array().unwrap();
    let of = |row: &Value| {
        (
            row["controllers"].as_u64().unwrap(),
            row["is_stopped"] == true,
        )
    };
    let seen: Vec<_> = rows.iter().map(of).collect();
    let expected = [(1, false), (1, false), (1, false), (2, false), (2, true)];
    assert_eq!(seen, expected, "{found}");
    for row in rows {
        assert_eq!(number(row, "contact_unbounded_ticks"), 0.0, "{row}");
    }
    // The near one touches, whatever becomes of the other.
    assert!(number(&rows[3], "contact_full_ticks") > 0.0, "{found}");
}

#[test]
fn every_link_that_is_asked_for_is_judged() {
    let out = tempfile::tempdir().unwrap();
    let mut command = rt_tests("hosts");
    command.args(["--asked", "--seconds=4", "--json", "--out"]);
    let output = command.arg(out.path()).output().unwrap();
    // What is not met is status 1 with the whole result.
    let is_met = output.status.code() != Some(1);
    let text = String::from_utf8_lossy(&output.stdout);
    let found = match serde_json::from_str::<Value>(&text) {
        Ok(found) if !is_met => found,
        _ => match found(&output) {
            Some(found) => found,
            None => return,
        },
    };
    let rows = found["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 10, "{found}");
    let mut all_met = true;
    for row in &rows[1..] {
        let asked = row["asked"].as_array().unwrap();
        assert!(asked.len() >= 4, "{row}");
        all_met &= asked.iter().all(|limit| limit["met"] == true);
    }
    assert_eq!(all_met, is_met, "{}", said(&output));
    assert!(rows[9]["rest"]["periods"].is_number(), "{}", rows[9]);
}

#[test]
fn the_short_form_has_four_links_and_who_is_refused_by_name() {
    let out = tempfile::tempdir().unwrap();
    let mut command = rt_tests("hosts");
    command.args(["--short", "--seconds=3", "--json", "--out"]);
    let output = command.arg(out.path()).output().unwrap();
    let Some(found) = found(&output) else { return };
    assert_eq!(found["rows"].as_array().unwrap().len(), 5, "{found}");
    assert!(found["cut"].is_null(), "{found}");
    let refused = found["refused"].as_array().unwrap();
    let who: Vec<_> = refused.iter().map(|one| &one["who"]).collect();
    let expected = [
        "foreign_certificate",
        "no_certificate",
        "expired",
        "version",
        "endianness",
    ];
    assert_eq!(who, expected, "{found}");
    assert!(refused.iter().all(|one| one["named"] == true), "{found}");
}

#[test]
fn numbers_that_no_link_has_are_refused() {
    for (typed, expected) in [
        ("--rtt-ms=1,-2", "--rtt-ms has -2"),
        ("--mbit=0", "--mbit has 0"),
        ("--loss=1.5", "--loss is 1.5"),
        ("--jitter-ms=NaN", "--jitter-ms is NaN"),
        ("--cut=9", "--cut is 9"),
        ("--damaged=2", "--damaged is 2"),
        ("--controllers=20:0", "--controllers has 0"),
        (
            "--controllers=20",
            "--controllers has 20; write RTT_MS:MBIT",
        ),
    ] {
        let output = rt_tests("hosts").arg(typed).output().unwrap();
        let sentence = refusal(&output);
        assert!(sentence.contains(expected), "{sentence}");
    }
}
