//! What the real process takes of its machine: cores, and memory.

use realtime::rights::{pin_to_core, usable_cores};
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};
use std::str::FromStr;
use std::time::Duration;

/// A run without a station, in a domain of its own.
struct Run {
    domain: String,
    folder: tempfile::TempDir,
}

impl Run {
    fn new(name: &str) -> Self {
        Self {
            domain: format!("machine-{name}-{}", std::process::id()),
            folder: tempfile::tempdir().unwrap(),
        }
    }

    /// With these lines in `[loop]`.
    fn command(&self, lines: &str) -> Command {
        let scene = self.folder.path().join("alone.toml");
        let text =
            format!("[[object]]\nmodel = \"none.spm\"\nsize_m = 0.1\n[loop]\n{lines}\n[[probe]]\n");
        std::fs::write(&scene, text).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_hrtc"));
        command
            .arg("run")
            .arg(&scene)
            .args(["--domain", &self.domain])
            .env("XDG_STATE_HOME", self.folder.path())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        transport::Domain::new(&self.domain).unwrap().remove_files();
    }
}

/// A process that ends with its owner.
struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn skipped(why: &str) {
    let _ = writeln!(std::io::stderr(), "skipped: {why}");
}

#[test]
fn a_run_that_was_put_on_one_core_names_no_other() {
    let cores = usable_cores();
    if cores.len() < 2 {
        skipped("one core");
        return;
    }
    let isolated = std::fs::read_to_string("/sys/devices/system/cpu/isolated");
    if isolated.is_ok_and(|list| !list.trim().is_empty()) {
        skipped("where all processes are kept off some cores, the others name no choice");
        return;
    }
    let run = Run::new("cores");
    let said = |more: &[&str]| {
        let mut command = run.command("");
        let output = command.args(["--seconds=0.2", "--record=off"]).args(more);
        let output = output.output().unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{text}");
        text
    };
    for &core in &cores[..2] {
        // A process is on the cores of the thread that starts it.
        pin_to_core(core).unwrap();
        let text = said(&[]);
        let names = "[loop] core names another";
        assert!(!text.contains(names), "core {core}: {text}");
        // Whoever starts both processes says by that where everything else goes.
        let text = said(&["--started-ns=1"]);
        assert!(text.contains(names), "core {core}: {text}");
    }
}

/// A field of `stat` of a thread of this name, by its number (proc(5)): from the third on, which
/// follows the name.
fn stat<T: FromStr>(process: u32, thread: &str, number: usize) -> Option<T> {
    let tasks = std::fs::read_dir(format!("/proc/{process}/task")).ok()?;
    let task = tasks.flatten().find(|of| {
        let name = std::fs::read_to_string(of.path().join("comm"));
        name.is_ok_and(|name| name.trim_end() == thread)
    })?;
    let stat = std::fs::read_to_string(task.path().join("stat")).ok()?;
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace();
    fields.nth(number - 3)?.parse().ok()
}

/// Page faults of the tick's thread so far, minor and major ones.
fn faults_of_the_tick(process: u32) -> Option<u64> {
    let of = |number| stat::<u64>(process, "hrtc-tick", number);
    Some(of(10)? + of(12)?)
}

/// What it does not hand over in time the recording lacks.
#[test]
fn the_thread_that_feeds_the_recorder_has_the_recorder_s_precedence() {
    let run = Run::new("precedence");
    let file = run.folder.path().join("run.mcap");
    let mut command = run.command("core = -1");
    let command = command.args(["--seconds=30", "--record"]).arg(&file);
    let mut run = Killed(command.spawn().unwrap());
    wait_until_it_ticks(&mut run);
    let nice = |thread| stat::<i32>(run.0.id(), thread, 19).unwrap();
    let [recorder, feeds, tick] = ["hrtc-recorder", "hrtc", "hrtc-tick"].map(nice);
    if recorder == tick {
        skipped("the recorder was refused its nice value");
    }
    assert_eq!(feeds, recorder);
}

/// Reads up to a sentence that is said once the loop runs.
fn wait_until_it_ticks(run: &mut Killed) {
    let mut lines = BufReader::new(run.0.stderr.take().unwrap()).lines();
    let is_said = |line: &String| line.contains("no station in domain");
    assert!(lines.by_ref().map_while(Result::ok).any(|of| is_said(&of)));
}

/// Every record that the tick hands over is half a page of a ring, and its first round of that ring
/// takes ten seconds.
#[test]
fn a_tick_finds_its_memory_resident() {
    let run = Run::new("faults");
    let mut command = run.command("core = -1\nrate_hz = 100");
    let mut run = Killed(command.args(["--seconds=30"]).spawn().unwrap());
    wait_until_it_ticks(&mut run);
    let process = run.0.id();
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap();
    let locked = status.lines().find_map(|of| of.strip_prefix("VmLck:"));
    if locked.is_none_or(|of| of.trim().starts_with("0 ")) {
        skipped("memory is not locked");
        return;
    }
    let before = faults_of_the_tick(process).unwrap();
    std::thread::sleep(Duration::from_secs(2));
    let faults = faults_of_the_tick(process).unwrap() - before;
    // Those of pages that the kernel has moved meanwhile; of the ring there would be a hundred.
    assert!(faults < 16, "{faults} page faults");
}
