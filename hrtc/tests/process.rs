//! The real process: its signals, and outputs that nobody takes.

use hrtc::recorder::replay;
use protocol::{Hello, PROTOCOL_VERSION, Role};
use realtime::rights::pin_to_core;
use std::io::{BufRead, BufReader, PipeReader, PipeWriter, Read, Write};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};

/// A run without a station or an end, in a domain of its own.
struct Run {
    child: Child,
    domain: String,
    _folder: tempfile::TempDir,
}

impl Run {
    fn start(name: &str, arguments: &[&str]) -> Self {
        Self::start_with("core = -1", name, arguments)
    }

    /// With these lines in `[loop]`.
    fn start_with(lines: &str, name: &str, arguments: &[&str]) -> Self {
        let outputs = [Stdio::piped(), Stdio::piped()];
        Self::start_into(outputs, lines, name, arguments)
    }

    /// With a standard output and a standard error.
    fn start_into(outputs: [Stdio; 2], lines: &str, name: &str, arguments: &[&str]) -> Self {
        let program = Command::new(env!("CARGO_BIN_EXE_hrtc"));
        Self::start_by(program, outputs, lines, name, arguments)
    }

    /// By a program that becomes this one.
    fn start_by(
        mut program: Command,
        outputs: [Stdio; 2],
        lines: &str,
        name: &str,
        arguments: &[&str],
    ) -> Self {
        let [output, errors] = outputs;
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("alone.toml");
        let text =
            format!("[[object]]\nmodel = \"none.spm\"\nsize_m = 0.1\n[loop]\n{lines}\n[[probe]]\n");
        std::fs::write(&scene, text).unwrap();
        let domain = format!("process-{name}-{}", std::process::id());
        let child = program
            .arg("run")
            .arg(&scene)
            .args(["--domain", &domain])
            .env("XDG_STATE_HOME", folder.path())
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(output)
            .stderr(errors)
            .spawn()
            .unwrap();
        Self {
            child,
            domain,
            _folder: folder,
        }
    }

    fn signal(&self, name: &str) {
        let id = self.child.id().to_string();
        let sent = Command::new("kill").args([name, &id]).status().unwrap();
        assert!(sent.success());
    }

    /// Waits until its loop has begun, or has ended.
    fn wait_until_it_ticks(&self, is_ticking: bool) {
        let tasks = format!("/proc/{}/task", self.child.id());
        let ticks = || {
            let threads = std::fs::read_dir(&tasks).unwrap();
            let names =
                threads.filter_map(|of| std::fs::read_to_string(of.ok()?.path().join("comm")).ok());
            names.into_iter().any(|name| name.trim_end() == "hrtc-tick")
        };
        let start = std::time::Instant::now();
        while ticks() != is_ticking {
            assert!(start.elapsed().as_secs() < 60, "it ticks: {}", ticks());
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
    }

    /// Reads standard error up to a line that contains this; the lines before it.
    fn wait_for(&mut self, text: &str) -> Vec<String> {
        let mut said = Vec::new();
        let mut lines = BufReader::new(self.child.stderr.as_mut().unwrap()).lines();
        for line in lines.by_ref().map_while(Result::ok) {
            if line.contains(text) {
                return said;
            }
            said.push(line);
        }
        panic!("never said {text:?}: {said:?}");
    }

    /// Its status, and the object that it printed.
    fn result(mut self) -> (ExitStatus, serde_json::Value) {
        let mut text = String::new();
        let output = self.child.stdout.as_mut().unwrap();
        output.read_to_string(&mut text).unwrap();
        let status = self.child.wait().unwrap();
        (status, serde_json::from_str(&text).unwrap_or_default())
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        transport::Domain::new(&self.domain).unwrap().remove_files();
    }
}

#[test]
fn a_station_that_cannot_be_called_is_one_sentence() {
    let refused = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hrtc"));
        let output = command.args(["run", "scene.toml"]).args(more).output();
        let output = output.unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert_eq!(text.trim_end().lines().count(), 1, "{text}");
        text
    };
    let encrypted = ["--station", "tls/127.0.0.1", "--keys", "/nowhere"];
    let sentence = refused(&encrypted);
    if cfg!(feature = "tunnel") {
        assert!(sentence.contains("/nowhere/authority.pem"), "{sentence}");
        let sentence = refused(&["--station", "tcp/192.168.1.10"]);
        assert!(sentence.contains("ve-station keys DIR"), "{sentence}");
        let sentence = refused(&["--station", "tls/0.0.0.0"]);
        assert!(sentence.contains("names no machine"), "{sentence}");
    } else {
        assert!(sentence.contains("--features tunnel"), "{sentence}");
    }
}

/// Said once the tick runs: no station is there.
const TICKING: &str = "no station in domain";

#[test]
fn every_signal_ends_the_run_with_its_report() {
    for signal in ["-INT", "-TERM", "-HUP"] {
        let mut run = Run::start("signal", &["--json"]);
        run.wait_for(TICKING);
        run.signal(signal);
        let (status, result) = run.result();
        assert_eq!(status.code(), Some(0), "{signal}: {status}");
        assert!(result["ticks"].as_u64().unwrap() > 0, "{signal}");
    }
}

#[test]
fn a_run_under_nohup_outlives_its_terminal() {
    let mut nohup = Command::new("nohup");
    nohup.arg(env!("CARGO_BIN_EXE_hrtc"));
    let outputs = [Stdio::piped(), Stdio::piped()];
    let mut run = Run::start_by(nohup, outputs, "core = -1", "nohup", &["--json"]);
    run.wait_for(TICKING);
    run.signal("-HUP");
    std::thread::sleep(std::time::Duration::from_secs(1));
    assert!(run.child.try_wait().unwrap().is_none(), "it has ended");
    run.signal("-INT");
    let (status, _) = run.result();
    assert_eq!(status.code(), Some(0), "{status}");
}

/// A pipe without room, as one that nobody reads, or a terminal that is paused.
fn full_pipe() -> (PipeReader, PipeWriter) {
    let (unread, mut output) = std::io::pipe().unwrap();
    // A pipe's room (pipe(7)).
    output.write_all(&[b' '; 1 << 16]).unwrap();
    (unread, output)
}

#[test]
fn a_signal_ends_the_force_where_nobody_reads_the_output() {
    let (unread, output) = full_pipe();
    let outputs = [output.into(), Stdio::piped()];
    let run = Run::start_into(outputs, "core = -1", "unread", &["--supervised"]);
    run.wait_until_it_ticks(true);
    run.signal("-TERM");
    run.wait_until_it_ticks(false);
    drop(unread);
}

#[test]
fn sigterm_may_come_as_often_as_it_likes() {
    ends_with_its_result_by("-TERM", 4);
}

/// As `timeout -s INT` sends it to a process and to its group.
#[test]
fn one_press_of_ctrl_c_that_arrives_twice_keeps_ramp_and_result() {
    ends_with_its_result_by("-INT", 2);
}

/// So many signals in a row. The end waits for a reader, so that all of them arrive.
fn ends_with_its_result_by(signal: &str, times: usize) {
    let (mut unread, output) = full_pipe();
    let outputs = [output.into(), Stdio::piped()];
    let mut run = Run::start_into(
        outputs,
        "core = -1",
        &format!("again{signal}"),
        &["--supervised"],
    );
    run.wait_until_it_ticks(true);
    for _ in 0..times {
        run.signal(signal);
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    run.wait_until_it_ticks(false);
    let mut text = String::new();
    unread.read_to_string(&mut text).unwrap();
    assert_eq!(run.child.wait().unwrap().code(), Some(0));
    let last: serde_json::Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
    assert!(last["result"]["ticks"].as_u64().unwrap() > 0, "{last}");
}

/// Longer than the log of the tick waits for whoever drains it, by far.
const UNREAD: [&str; 2] = ["--seconds", "4"];

#[test]
fn statuses_that_nobody_reads_cost_no_tick_and_no_record() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    let (mut unread, output) = full_pipe();
    let outputs = [output.into(), Stdio::piped()];
    let recorded = ["--supervised", "--record", file.to_str().unwrap()];
    let arguments = [&recorded[..], &UNREAD].concat();
    let mut run = Run::start_into(outputs, "core = -1", "statuses", &arguments);
    run.wait_until_it_ticks(true);
    run.wait_until_it_ticks(false);
    let mut text = String::new();
    unread.read_to_string(&mut text).unwrap();
    assert!(run.child.wait().unwrap().success());
    let last: serde_json::Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
    let result = &last["result"];
    assert!(result["ticks"].as_u64().unwrap() > 0, "{result}");
    assert_eq!(result["unaccounted_periods"], 0, "a tick was lost");
    assert_eq!(result["safety"]["recording_errors"], 0);
    let found = replay(&file).unwrap();
    assert!(found.equal && found.whole, "{found:?}");
}

#[test]
fn sentences_that_nobody_reads_cost_no_tick_and_are_there_for_a_late_reader() {
    let (mut unread, errors) = full_pipe();
    let outputs = [Stdio::piped(), errors.into()];
    let arguments = [&["--json"][..], &UNREAD].concat();
    let run = Run::start_into(outputs, "core = -1", "sentences", &arguments);
    run.wait_until_it_ticks(true);
    run.wait_until_it_ticks(false);
    let reader = std::thread::spawn(move || {
        let mut text = String::new();
        unread.read_to_string(&mut text).unwrap();
        text
    });
    let (status, result) = run.result();
    assert_eq!(status.code(), Some(0), "{status}");
    assert!(result["ticks"].as_u64().unwrap() > 0, "{result}");
    assert_eq!(result["unaccounted_periods"], 0, "a tick was lost");
    let said = reader.join().unwrap();
    assert!(said.contains(TICKING), "{}", said.trim());
}

#[test]
fn an_error_that_nobody_reads_ends_the_program() {
    let (_unread, errors) = full_pipe();
    let outputs = [Stdio::piped(), errors.into()];
    let refused = ["--record", "/no/such/folder/run.mcap"];
    let mut run = Run::start_into(outputs, "core = -1", "refused", &refused);
    let start = std::time::Instant::now();
    let status = loop {
        if let Some(status) = run.child.try_wait().unwrap() {
            break status;
        }
        assert!(start.elapsed().as_secs() < 60, "it does not end");
        std::thread::sleep(std::time::Duration::from_millis(5));
    };
    assert_eq!(status.code(), Some(2), "{status}");
}

#[test]
fn another_version_of_the_station_is_named_and_one_of_a_controller_is_not() {
    let mut run = Run::start("versions", &[]);
    run.wait_for(TICKING);
    let domain = transport::Domain::new(&run.domain).unwrap();
    let node = domain.node().unwrap();
    let hellos = domain.heartbeats(&node).unwrap().outgoing;
    let [other, stations] = [PROTOCOL_VERSION + 1, PROTOCOL_VERSION + 2];
    for (version, role) in [(other, Role::Controller), (stations, Role::Station)] {
        let hello = Hello::of_version(version, role, 1, 0);
        hellos.send_copy(hello).unwrap();
    }
    let said = run.wait_for(&format!("speaks protocol version {stations}"));
    let named = format!("speaks protocol version {other}");
    assert!(!said.iter().any(|line| line.contains(&named)), "{said:?}");
}

#[test]
fn a_full_disk_costs_the_recording_and_not_the_run() {
    if !Path::new("/dev/full").exists() {
        let _ = writeln!(std::io::stderr(), "skipped: no /dev/full");
        return;
    }
    let mut run = Run::start("full", &["--json", "--record", "/dev/full"]);
    run.wait_for("ticks are not recorded for now");
    run.signal("-INT");
    let (status, result) = run.result();
    assert_eq!(status.code(), Some(0), "{status}");
    assert_eq!(result["safety"]["recording_errors"], 1);
    assert!(result["ticks"].as_u64().unwrap() > 0);
}

#[test]
fn a_slow_disk_costs_records_and_never_a_tick() {
    let folder = tempfile::tempdir().unwrap();
    // Whoever writes into a pipe waits for a reader.
    let pipe = folder.path().join("run.mcap");
    assert!(
        Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    let (release, released) = std::sync::mpsc::channel::<()>();
    let reader = std::thread::spawn({
        let pipe = pipe.clone();
        move || {
            let mut file = std::fs::File::open(pipe).unwrap();
            let _ = released.recv();
            std::io::copy(&mut file, &mut std::io::sink()).unwrap()
        }
    });
    // Fast, so that what waits for the disk is soon too much.
    let arguments = ["--json", "--record", pipe.to_str().unwrap()];
    let mut run = Run::start_with("core = -1\nrate_hz = 4000", "slow", &arguments);
    run.wait_for("ticks are not recorded for now, the run goes on: the disk is slow");
    drop(release);
    run.signal("-INT");
    let (status, result) = run.result();
    assert_eq!(status.code(), Some(0), "{status}");
    assert_eq!(result["safety"]["recording_errors"], 1);
    assert_eq!(result["unaccounted_periods"], 0, "a tick was lost");
    assert!(reader.join().unwrap() > 0);
}

#[test]
fn a_closed_standard_output_ends_the_run_gently() {
    let mut run = Run::start("closed", &["--supervised"]);
    drop(run.child.stdout.take());
    run.wait_for("cannot print the result");
    assert_eq!(run.child.wait().unwrap().code(), Some(1));
}

#[test]
fn a_terminal_that_is_gone_ends_the_run_without_a_panic() {
    let mut run = Run::start("gone", &["--json"]);
    run.wait_for(TICKING);
    drop(run.child.stdout.take());
    drop(run.child.stderr.take());
    run.signal("-HUP");
    assert_eq!(
        run.child.wait().unwrap().code(),
        Some(0),
        "a reader that is gone is no error"
    );
}

#[test]
fn a_process_that_was_stopped_comes_back_from_zero_force_and_reports_it() {
    let mut run = Run::start("stopped", &["--json"]);
    run.wait_for(TICKING);
    run.signal("-STOP");
    // Far longer than a wrench is valid.
    std::thread::sleep(std::time::Duration::from_millis(300));
    run.signal("-CONT");
    std::thread::sleep(std::time::Duration::from_millis(100));
    run.signal("-INT");
    let (status, result) = run.result();
    assert_eq!(status.code(), Some(0), "{status}");
    assert!(result["safety"]["force_cuts"].as_u64().unwrap() >= 1);
    assert!(result["missed"].as_u64().unwrap() >= 100);
}

#[test]
fn a_second_controller_on_a_core_is_reported() {
    let mut first = Run::start_with("core = 0", "first", &[]);
    first.wait_for(TICKING);
    let mut second = Run::start_with("core = 0", "second", &[]);
    second.wait_for("another controller ticks on core 0");
    // Put there by its user, as with taskset; where processes are kept off some cores it could not
    // be told from one that was put nowhere.
    let isolated = std::fs::read_to_string("/sys/devices/system/cpu/isolated");
    let keeps_off = isolated.is_ok_and(|list| !list.trim().is_empty());
    if !keeps_off && pin_to_core(0).is_ok() {
        let mut third = Run::start_with("", "third", &[]);
        third.wait_for("another controller ticks on core 0");
    }
}
