//! `rt-tests stability` with another library's proxy in the place of ours.

use crate::typed::{json, refusal, rt_tests, said};
use serde_json::Value;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// A line of `sh` that gives an answer without a force in a nanosecond.
const NOTHING: &str = r"printf '\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\360\077'";
/// One whose force is no number.
const NO_NUMBER: &str = r"printf '\0\0\0\0\0\0\370\177\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\360\077'";
/// One whose time is none.
const NO_TIME: &str = r"printf '\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\370\177'";

/// A program of `sh` that reads all that it is told, and does this; [`STOP`] comes before its end.
fn peer(folder: &Path, does: &str) -> PathBuf {
    let path = folder.join("peer.sh");
    let script = format!("#!/bin/sh\nexec 3<&0\ncat <&3 >/dev/null 2>&1 &\n{does}\n");
    std::fs::write(&path, script).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    path
}

/// Ends the process that reads, which holds the socket, too.
const STOP: &str = "kill $!";

fn endless(answer: &str) -> String {
    format!("while :; do {answer} || exit 0; done")
}

/// The quick form of these cases with a peer, on a small model.
fn ask(folder: &Path, cases: &[&str], peer: &Path) -> Output {
    let mut command = rt_tests("stability");
    command.args(cases).arg("--json").arg("--peers").arg(peer);
    command
        .args(["--model", "relief:1000", "--out"])
        .arg(folder.join("out"));
    command.output().unwrap()
}

/// What a peer came to in a case.
fn of_peer<'a>(found: &'a Value, case: &str, who: &str) -> &'a Value {
    let cases = found["cases"].as_array().unwrap();
    let case = cases.iter().find(|of| of["name"] == case).unwrap();
    let peers = case["peers"].as_array().unwrap();
    peers.iter().find(|peer| peer["who"] == who).unwrap()
}

#[test]
fn a_peer_is_judged_by_the_same_measure_and_ours_beside_it_is_not_changed() {
    let folder = tempfile::tempdir().unwrap();
    let path = peer(
        folder.path(),
        &format!("echo ball 1 nobody\n{}", endless(NOTHING)),
    );
    let cases = ["slow-onset", "rest", "tip", "jumps"];
    let output = ask(folder.path(), &cases, &path);
    let found = json(&output);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    // Without a force it strays from what is due by all of it.
    let rest = of_peer(&found, "rest", "nobody");
    assert_eq!(
        (&rest["value"], &rest["pass"]),
        (&Value::from(1.0), &Value::from(false))
    );
    // What must happen does not.
    let onset = of_peer(&found, "slow-onset", "nobody");
    assert_eq!(onset["value"].as_f64(), Some(f64::MAX));
    // What is never there never jumps, and is no answer.
    let jumps = of_peer(&found, "jumps", "nobody");
    assert_eq!(
        (jumps["value"].as_f64(), &jumps["pass"]),
        (Some(f64::MAX), &Value::from(false))
    );
    let of = |name: &str| {
        let cases = found["cases"].as_array().unwrap();
        cases.iter().find(|of| of["name"] == name).unwrap().clone()
    };
    assert!(of("tip")["peers"].is_null() && of("tip")["no_equal"] != "");
    assert!(cases.iter().all(|case| of(case)["pass"] == true), "{found}");
    let who = |row: &Value| row["who"].as_str().unwrap().to_string();
    let times: Vec<String> = found["step_times"]
        .as_array()
        .unwrap()
        .iter()
        .map(who)
        .collect();
    assert_eq!(
        times,
        ["ours_local", "ours_local_tick", "ours_full", "nobody"]
    );
    let last = &found["step_times"][3];
    let differs = last["force_differs"].as_f64().unwrap() / last["steps"].as_f64().unwrap();
    assert!(last["p50_ns"] == 1.0 && differs > 0.9, "{last}");
    let page = std::fs::read_to_string(folder.path().join("out/stability.html")).unwrap();
    for part in [
        "nobody",
        "slow-onset",
        "1-10 mm/s; faces of 16",
        "not asked",
        "DeadZone",
    ] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("NaN"));
    assert!(folder.path().join("out/stability.json").is_file());
}

#[test]
fn a_peer_without_numbers_fails_the_case_and_is_told_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = peer(
        folder.path(),
        &format!("echo ball 1 noise\n{}", endless(NO_NUMBER)),
    );
    let output = ask(folder.path(), &["rest"], &path);
    let found = json(&output);
    let rest = of_peer(&found, "rest", "noise");
    assert_eq!(rest["pass"], false);
    assert_eq!(rest["note"], "at step 1 its answer is no number");
}

#[test]
fn a_peer_that_crashes_on_a_case_has_failed_it() {
    let folder = tempfile::tempdir().unwrap();
    // Once for its hello, once to be timed, then for the case.
    let starts = folder.path().join("starts");
    let starts = starts.display();
    let does = format!(
        "echo >> {starts}\necho ball 1 weak\n[ $(wc -l < {starts}) -gt 2 ] || {}\n\
         {NOTHING}\n{STOP}; kill -SEGV $$",
        endless(NOTHING)
    );
    let path = peer(folder.path(), &does);
    let output = ask(folder.path(), &["rest"], &path);
    let found = json(&output);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let rest = of_peer(&found, "rest", "weak");
    assert_eq!(
        (&rest["pass"], &rest["steps"]),
        (&Value::from(false), &Value::from(1))
    );
    let note = rest["note"].as_str().unwrap();
    assert!(note.contains("peer.sh: crashed (signal: 11"), "{note}");
}

#[test]
fn a_peer_that_breaks_off_is_one_sentence() {
    let none = format!("{STOP}; exit 3");
    let five = format!("{}\n{STOP}", [NOTHING; 5].join("\n"));
    let no_time = endless(NO_TIME);
    for (then, named) in [
        (&none, "ended (exit status: 3) after 0 answers"),
        (&five, "ended (exit status: 0) after 5 answers"),
        (&no_time, "step 1 took NaN ns"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let path = peer(folder.path(), &format!("echo ball 1 short\n{then}"));
        let mut command = rt_tests("stability");
        command.args(["rest", "--peers"]).arg(&path);
        command
            .args(["--model", "relief:1000", "--out"])
            .arg(folder.path());
        let output = command.output().unwrap();
        let said = said(&output);
        assert_ne!(output.status.code(), Some(0), "{said}");
        let errors: Vec<&str> = said
            .lines()
            .filter(|line| line.starts_with("error: "))
            .collect();
        assert_eq!(errors.len(), 1, "{said}");
        assert!(errors[0].contains(named), "{said}");
        assert!(
            errors[0].contains("peer.sh") && errors[0].contains("README.md"),
            "{said}"
        );
    }
}

#[test]
fn what_is_no_peer_is_refused_with_status_2() {
    let folder = tempfile::tempdir().unwrap();
    let talks = peer(folder.path(), "echo good morning");
    let missing = folder.path().join("nowhere");
    for (path, named) in [(talks, "good morning"), (missing, "cannot be run")] {
        let output = ask(folder.path(), &["rest"], &path);
        let sentence = refusal(&output);
        assert!(sentence.contains(named), "{sentence}");
    }
}

/// Numbers of eight bytes at the beginning of a file.
fn taken<const N: usize>(bytes: &mut &[u8]) -> [[u8; 8]; N] {
    let (numbers, rest) = bytes.split_at(8 * N);
    *bytes = rest;
    let (numbers, _) = numbers.as_chunks::<8>();
    std::array::from_fn(|k| numbers[k])
}

fn exported(folder: &Path, case: &str) {
    let mut command = rt_tests("stability");
    command.arg(case).arg("--export").arg(folder);
    command.arg("--out").arg(folder.join("out"));
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
}

#[test]
fn what_is_exported_holds_the_scene_and_every_tick() {
    let folder = tempfile::tempdir().unwrap();
    exported(folder.path(), "rest");
    let bytes = std::fs::read(folder.path().join("rest.0.ball")).unwrap();
    let mut rest = bytes.as_slice();
    let [kind, variant] = taken(&mut rest).map(u64::from_le_bytes);
    assert_eq!([kind, variant], [1, 0]);
    let numbers: [f64; 6] = taken(&mut rest).map(f64::from_le_bytes);
    assert_eq!(numbers, [1e-3, 1000.0, 0.0, 0.0, 0.0, 0.0]);
    let [vertices, faces] = taken(&mut rest).map(u64::from_le_bytes);
    // A plate of 12 by 12 cells, 0.2 m wide.
    assert_eq!([vertices, faces], [13 * 13, 2 * 12 * 12]);
    let mut largest = 0.0f64;
    for _ in 0..3 * vertices {
        let [number] = taken(&mut rest).map(f64::from_le_bytes);
        largest = largest.max(number.abs());
    }
    assert!((largest - 0.1).abs() < 1e-9, "{largest}");
    let (corners, mut rest) = rest.split_at(12 * faces as usize);
    let (corners, _) = corners.as_chunks::<4>();
    assert!(
        corners
            .iter()
            .all(|&of| u64::from(u32::from_le_bytes(of)) < vertices)
    );
    let (mut ticks, mut place) = (0, [0.0; 3]);
    while !rest.is_empty() {
        let [kind, count] = taken(&mut rest).map(u64::from_le_bytes);
        assert_eq!([kind, count], [2, 1]);
        let pose: [f64; 7] = taken(&mut rest).map(f64::from_le_bytes);
        assert_eq!(pose, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        place = taken(&mut rest).map(f64::from_le_bytes);
        ticks += 1;
    }
    // Where it rests for 5000 ticks: 0.5 to 1.5 mm deep.
    assert!(
        ticks > 5000 && place[..2] == [0.01, 0.02],
        "{ticks} {place:?}"
    );
    assert!((-5e-4..=5e-4).contains(&place[2]), "{place:?}");
}

/// The program of `rt-tests/peers`, where it was built as its page says.
fn chai3d() -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/peers/chai3d");
    if !path.is_file() {
        println!("skipped: target/peers/chai3d is not built, see rt-tests/peers/README.md");
        return None;
    }
    Some(path)
}

#[test]
fn chai3d_answers_an_exported_file_and_the_cases_alike() {
    let Some(path) = chai3d() else { return };
    let folder = tempfile::tempdir().unwrap();
    exported(folder.path(), "rest");
    let questions = folder.path().join("rest.0.ball");
    let ticks = std::fs::metadata(&questions).unwrap().len();
    let ticks = (ticks - (16 + 48 + 16 + 24 * 169 + 12 * 288)) / 96;
    let input = std::fs::File::open(&questions).unwrap();
    let answered = Command::new(&path)
        .stdin(Stdio::from(input))
        .output()
        .unwrap();
    assert!(answered.status.success());
    let hello = answered
        .stdout
        .iter()
        .position(|&byte| byte == b'\n')
        .unwrap();
    assert!(
        answered
            .stdout
            .starts_with(b"ball 1 chai3d chai3d_dynamic\n")
    );
    let mut answers = &answered.stdout[hello + 1..];
    assert_eq!(answers.len() as u64, 56 * ticks);
    let mut last = [0.0; 7];
    while !answers.is_empty() {
        last = taken(&mut answers).map(f64::from_le_bytes);
    }
    // It rests on a plate: a normal force alone.
    assert!(
        last[2] > 0.4 && last[0] == 0.0 && last[1] == 0.0,
        "{last:?}"
    );

    let output = ask(folder.path(), &["rest"], &path);
    let found = json(&output);
    let rest = of_peer(&found, "rest", "chai3d");
    // The same by a socket: its stand-off is in the force, and nothing else.
    let stray = rest["value"].as_f64().unwrap();
    assert!(stray > 0.0 && stray < 0.2, "{rest}");
    assert_eq!(rest["steps"].as_u64(), Some(ticks));
}
