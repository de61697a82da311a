//! The real process: its signals, and outputs that nobody takes.

use std::io::{BufRead, BufReader, Read, Write};
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
        Self::start_into(Stdio::piped(), lines, name, arguments)
    }

    /// With a standard output.
    fn start_into(output: Stdio, lines: &str, name: &str, arguments: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("alone.toml");
        let text =
            format!("[[object]]\nmodel = \"none.spm\"\nsize_m = 0.1\n[loop]\n{lines}\n[[probe]]\n");
        std::fs::write(&scene, text).unwrap();
        let domain = format!("process-{name}-{}", std::process::id());
        let child = Command::new(env!("CARGO_BIN_EXE_hrtc"))
            .arg("run")
            .arg(&scene)
            .args(["--domain", &domain])
            .env("XDG_STATE_HOME", folder.path())
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(output)
            .stderr(Stdio::piped())
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

    /// Reads standard error up to a line that contains this.
    fn wait_for(&mut self, text: &str) {
        let mut said = Vec::new();
        let mut lines = BufReader::new(self.child.stderr.as_mut().unwrap()).lines();
        for line in lines.by_ref().map_while(Result::ok) {
            if line.contains(text) {
                return;
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

/// The main thread waits for whoever reads its lines.
#[test]
fn a_signal_ends_the_force_where_nobody_reads_the_output() {
    let (unread, mut output) = std::io::pipe().unwrap();
    // A pipe's room (pipe(7)).
    output.write_all(&[b' '; 1 << 16]).unwrap();
    let run = Run::start_into(output.into(), "core = -1", "unread", &["--supervised"]);
    let tasks = format!("/proc/{}/task", run.child.id());
    let ticks = || {
        let threads = std::fs::read_dir(&tasks).unwrap();
        let names =
            threads.filter_map(|of| std::fs::read_to_string(of.ok()?.path().join("comm")).ok());
        names.into_iter().any(|name| name.trim_end() == "hrtc-tick")
    };
    let until = |ended: bool| {
        let start = std::time::Instant::now();
        while ticks() == ended {
            assert!(start.elapsed().as_secs() < 60, "it ticks: {}", ticks());
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
    };
    until(false);
    run.signal("-TERM");
    until(true);
    drop(unread);
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
    assert_eq!(run.child.wait().unwrap().code(), Some(2));
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
}
