//! Both processes in real time, as a user starts them.

mod faults;
mod hosts;
mod jitter;
mod tune;
#[path = "../commands/typed.rs"]
mod typed;
mod view;

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use typed::{json, number, refusal, rt_tests, said};

fn scene() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/scenes/first-touch.toml")
}

/// Runs a scene file, with the results in a folder.
fn run(scene: &Path, out: &Path, more: &[&str]) -> Output {
    let mut command = rt_tests("run");
    command.arg(scene).arg("--out").arg(out).args(more);
    command.output().unwrap()
}

/// The bundled scene with one piece of its text exchanged, in a folder of its own.
fn changed(folder: &Path, old: &str, new: &str) -> PathBuf {
    let text = std::fs::read_to_string(scene()).unwrap();
    assert!(text.contains(old), "the bundled scene has no {old}");
    let path = folder.join("changed.toml");
    std::fs::write(&path, text.replacen(old, new, 1)).unwrap();
    path
}

#[test]
fn bad_input_is_one_sentence_with_status_2_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let not_a_mesh = folder.path().join("noise.ply");
    std::fs::write(&not_a_mesh, "this is no mesh\n").unwrap();
    let nan = folder.path().join("nan.obj");
    std::fs::write(&nan, "v nan nan nan\nv nan 0 0\nv 0 nan 0\nf 1 2 3\n").unwrap();
    let broken = folder.path().join("broken.spm");
    std::fs::write(&broken, [0x5a; 300]).unwrap();
    let sentence = refusal(&run("nowhere.toml".as_ref(), &out, &["--json"]));
    assert!(sentence.contains("nowhere.toml"), "{sentence}");
    let cases = [
        ("--model", "nowhere.spm", "nowhere.spm"),
        ("--model", not_a_mesh.to_str().unwrap(), "noise.ply"),
        ("--model", nan.to_str().unwrap(), "nan.obj"),
        ("--model", broken.to_str().unwrap(), "broken.spm"),
        ("--size", "-1", "--size"),
        ("--speed", "nan", "--speed"),
        ("--cache", "lots", "--cache"),
        ("--tolerance", "-0.001", "--tolerance"),
        ("--seconds", "0", "--seconds"),
    ];
    for (option, value, expected) in cases {
        let sentence = refusal(&run(&scene(), &out, &["--json", option, value]));
        assert!(sentence.contains(expected), "{expected}: {sentence}");
    }
    assert!(!out.exists(), "not even an empty folder");
    let unknown = changed(folder.path(), "rate_hz", "rate_khz");
    let sentence = refusal(&run(&unknown, &out, &[]));
    assert!(
        sentence.contains("rate_khz") && sentence.contains("line 5"),
        "{sentence}"
    );
    let mut jitter = rt_tests("jitter");
    jitter.args(["--seconds", "-3", "--out"]).arg(&out);
    let sentence = refusal(&jitter.output().unwrap());
    assert!(sentence.contains("--seconds"), "{sentence}");
    for arguments in [["--only", "zzz"], ["--seconds", "nan"]] {
        let sentence = refusal(&rt_tests("deadline").args(arguments).output().unwrap());
        assert!(sentence.contains(arguments[0]), "{sentence}");
    }
}

#[test]
fn a_cache_too_small_for_the_base_mesh_is_refused_by_name_with_the_size_it_needs() {
    let out = tempfile::tempdir().unwrap();
    let small = ["--json", "--cache=4KiB", "--seconds=5"];
    let output = run(&scene(), out.path(), &small);
    let sentence = refusal(&output);
    assert!(
        sentence.contains("cache") && sentence.contains("base mesh"),
        "{sentence}"
    );
    // It began to run, so it leaves its recording and black box, but no report.
    let left = std::fs::read_dir(out.path()).unwrap();
    for name in left.map(|entry| entry.unwrap().file_name()) {
        let name = name.to_string_lossy();
        assert!(name.ends_with(".mcap"), "{name}");
    }
    let black_box = out.path().join("recording-fault.mcap");
    let (output, found) = replay(&black_box);
    assert!(output.status.success(), "{}", said(&output));
    assert_eq!(
        (&found["equal"], &found["whole"]),
        (&true.into(), &true.into())
    );
    let ticks = found["ticks"].as_u64().unwrap();
    let tables = out.path().join("tables");
    let mut export = rt_tests("export");
    let exported = export.arg(&black_box).arg("--csv").arg(&tables).output();
    assert!(exported.unwrap().status.success());
    let text = std::fs::read_to_string(tables.join("ticks.csv")).unwrap();
    assert_eq!(text.lines().count() as u64, 1 + ticks);
}

/// Numbers that every run reports.
const FIELDS: &str = "
    faces seconds seed ticks missed missed_own_cpu contact_ticks contact_full_ticks
    contact_unbounded_ticks refined_faces.p50 refined_faces.max force_step_n_max
    clamped_ticks rejected_samples unfinished_ticks early_ticks slow late_contacts stuck_ticks energy_j
    contact_offset_m
    vsps_received vsplits geomorph_ticks deferred ecols regions_subscribed resubscribed
    bytes_received bytes_to_first_touch bytes_full_mesh cache.bytes cache.high_water_bytes cache.vsps
    cache.evicted hrtc_rss_bytes first_heard_ms first_force_ready_ms first_touch_ms first_full_ms
    replay_hash
";
/// Times, each with its quantiles.
const TIMES: &str = "
    period_us wake_us work_us work_wall_us stage_us.inbox stage_us.refine stage_us.refit
    stage_us.query stage_us.force record_us
";

#[test]
fn a_short_run_touches_a_real_mesh_and_reports_every_field() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    let output = run(&scene(), &out, &["--json", "--seconds=4"]);
    let said = said(&output);
    assert!(output.status.success(), "{said}");
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(text.lines().count(), 1, "one object: {text}");
    let result = json(&output);
    let number = |path: &str| number(&result, path);
    for path in FIELDS.split_whitespace() {
        number(path);
    }
    for timing in TIMES.split_whitespace() {
        let spread = ["p50", "p99", "p999", "max"].map(|q| number(&format!("{timing}.{q}")));
        assert!(spread.is_sorted(), "{timing}: {spread:?}");
    }
    for quantity in ["certified_error_m", "measured_error_m", "force_n"] {
        let spread = ["p50", "p99", "max"].map(|q| number(&format!("{quantity}.{q}")));
        assert!(spread.is_sorted(), "{quantity}: {spread:?}");
    }
    assert!(result["scene"] == "first-touch" && result["model"].is_string());
    assert!(!text.contains("null"));

    assert!(number("contact_ticks") > 0.0, "{said}");
    assert!(number("contact_full_ticks") > 0.0, "{said}");
    assert_eq!(number("contact_unbounded_ticks"), 0.0, "{said}");
    assert!(
        number("force_n.max") > 0.0 && number("force_n.max") < 8.0,
        "{said}"
    );
    // The slew limit of the scene, over the periods that a tick may have skipped.
    assert!(
        number("force_step_n_max") <= 2.0 * (1.0 + number("missed")),
        "{said}"
    );
    assert!(number("regions_subscribed") > 0.0, "{said}");
    assert!(number("vsplits") > 0.0 && number("ecols") > 0.0, "{said}");
    assert!(
        number("cache.high_water_bytes") <= number("cache.bytes"),
        "{said}"
    );
    assert!(
        number("refined_faces.max") < 0.5 * number("faces"),
        "{said}"
    );
    let times = ["first_heard_ms", "first_force_ready_ms", "first_touch_ms"].map(number);
    assert!(times[0] > 0.0 && times.is_sorted(), "{said}");
    assert!(number("first_full_ms") >= 0.0, "{said}");
    assert_eq!(number("allocations"), 0.0, "{said}");

    for file in "report.html touch.png force.svg timing.svg resolution.svg result.json".split(' ') {
        assert!(out.join(file).is_file(), "{file}");
    }
    assert!(
        said.contains("in contact") && said.contains("report.html"),
        "{said}"
    );
}

#[test]
fn ctrl_c_ends_a_run_cleanly_with_its_report() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = rt_tests("run");
    command
        .arg(scene())
        .args(["--json", "--seconds=600", "--out"]);
    command.arg(folder.path());
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    // Long enough for a few ticks, after a mesh that may have to be built first.
    let said = first_sign_of_ticking(&mut child);
    interrupt(child.id());
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{said}");
    let result = json(&output);
    assert!(result["ticks"].as_u64().unwrap() > 0);
    assert!(result["seconds"].as_f64().unwrap() < 500.0);
    assert!(folder.path().join("report.html").is_file());
}

/// Reads standard error until the controller met the station, then one second more.
fn first_sign_of_ticking(child: &mut std::process::Child) -> String {
    use std::io::{BufRead, BufReader};
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let mut said = String::new();
    for line in lines.by_ref().map_while(Result::ok) {
        said += &line;
        if line.contains("station found") {
            break;
        }
    }
    // The rest is read and thrown away, so that the pipe never fills.
    std::thread::spawn(move || lines.for_each(drop));
    std::thread::sleep(std::time::Duration::from_secs(1));
    said
}

fn interrupt(process: u32) {
    let status = Command::new("kill")
        .args(["-INT", &process.to_string()])
        .status()
        .unwrap();
    assert!(status.success());
}

#[test]
fn the_scenes_shapes_are_the_generators() {
    for shape in scene::SHAPES {
        assert!(
            shape.parse::<spm_builder::generate::Shape>().is_ok(),
            "{shape} can be written in a scene, but not generated"
        );
    }
}

/// A recording of a short run of the bundled scene.
fn recording(folder: &Path) -> PathBuf {
    let file = folder.join("run.mcap");
    let record = ["--seconds=3", "--record", file.to_str().unwrap()];
    let output = run(&scene(), &folder.join("out"), &record);
    assert!(output.status.success(), "{}", said(&output));
    file
}

fn replay(file: &Path) -> (Output, serde_json::Value) {
    let output = rt_tests("replay").arg(file).arg("--json").output().unwrap();
    let found = serde_json::from_slice(&output.stdout).unwrap_or_default();
    (output, found)
}

#[test]
fn a_hundred_objects_under_three_probes_are_reported_and_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene().with_file_name("hundred-objects.toml");
    let file = folder.path().join("run.mcap");
    let more = ["--seconds=4", "--json", "--record", file.to_str().unwrap()];
    let output = run(&scene, &folder.path().join("out"), &more);
    let said = said(&output);
    assert!(output.status.success(), "{said}");
    for sentence in ["probe 2: ", "100 objects, of which 7 can be awake"] {
        assert!(said.contains(sentence), "{said}");
    }
    let result = json(&output);
    let number = |name: &str| result[name].as_u64().unwrap();
    assert_eq!((number("objects"), number("active_objects_max")), (100, 7));
    let probes = result["probes"].as_array().unwrap();
    assert_eq!(probes.len(), 3);
    for probe in probes {
        assert!(probe["contact_ticks"].as_u64().unwrap() > 100, "{probe}");
        assert!(probe["force_n"]["max"].as_f64().unwrap() > 0.1, "{probe}");
    }
    assert_eq!(number("allocations"), 0);
    // How soon it is depends on what else the machine does: `many_objects` of the golden runs asks
    // it in virtual time, of three probes over sixteen objects.
    assert!(number("contact_full_ticks") > 0);
    assert_eq!(replay(&file).1["equal"], true);
}

/// A mesh tool on a height map, both from files beside the scene.
const FROM_FILES: &str = r#"
[[object]]
generate = { shape = "relief", faces = 20000 }
size_m = 0.15
effects = [{ texture = { amplitude_m = 2e-5, height_map = { file = "bumps.png", width_m = 0.01 } } }]
[[probe]]
shape = { mesh = { file = "torus.spm", size_m = 0.03, faces = 480 } }
trajectory = { tour = { seed = 1, speed_m_per_s = 0.1, depth_m = 0.002 } }
"#;

#[test]
fn a_run_with_a_mesh_tool_and_a_height_map_replays_without_their_files() {
    let folder = tempfile::tempdir().unwrap();
    let beside = tempfile::tempdir().unwrap();
    let scene = beside.path().join("files.toml");
    std::fs::write(&scene, FROM_FILES).unwrap();
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
    for (from, name) in [("run", "bumps.png"), ("golden", "torus.spm")] {
        std::fs::copy(here.join(from).join(name), beside.path().join(name)).unwrap();
    }
    let file = folder.path().join("run.mcap");
    let more = ["--seconds=3", "--json", "--record", file.to_str().unwrap()];
    let output = run(&scene, &folder.path().join("out"), &more);
    assert!(output.status.success(), "{}", said(&output));
    let result = json(&output);
    assert!(number(&result, "contact_ticks") > 100.0, "{result}");
    // A tool's device renders six degrees of freedom.
    assert!(number(&result, "torque_nm_max") > 0.0, "{result}");
    // Half a step of 10 um.
    let offset = number(&result, "contact_offset_m");
    assert!((offset / 5e-6 - 1.0).abs() < 1e-9, "{offset}");
    drop(beside);
    let (output, found) = replay(&file);
    assert!(output.status.success(), "{}", said(&output));
    assert_eq!(
        (&found["equal"], &found["whole"]),
        (&true.into(), &true.into())
    );
}

#[test]
fn the_memory_of_the_controller_does_not_grow_with_the_model() {
    let folder = tempfile::tempdir().unwrap();
    let run_on = |faces: &str| {
        let old = "faces = 100000";
        let scene = changed(folder.path(), old, &format!("faces = {faces}"));
        let more = ["--seconds=2", "--json", "--record", "off"];
        let output = run(&scene, &folder.path().join("out"), &more);
        assert!(output.status.success(), "{}", said(&output));
        json(&output)
    };
    let (small, large) = (run_on("5000"), run_on("300000"));
    let of = |result: &serde_json::Value, field: &str| number(result, field);
    assert!(of(&large, "faces") > 50.0 * of(&small, "faces"));
    let grown = of(&large, "hrtc_rss_bytes") - of(&small, "hrtc_rss_bytes");
    // Pages of the same program that this run has touched and the other not.
    assert!(grown < 1e6, "{grown} bytes more");
    let cache = of(&large, "cache.bytes");
    assert!(
        of(&large, "hrtc_rss_bytes") > cache,
        "the cache is resident"
    );
    for result in [small, large] {
        assert!(of(&result, "contact_ticks") > 0.0);
        assert!(of(&result, "query_work_max") <= of(&result, "query_work_budget"));
        assert!(of(&result, "operations_max") <= of(&result, "operations_budget"));
    }
}

#[test]
fn a_recorded_run_replays_bit_by_bit_and_is_exported() {
    let folder = tempfile::tempdir().unwrap();
    let file = recording(folder.path());
    let (output, found) = replay(&file);
    assert!(output.status.success(), "{}", said(&output));
    assert_eq!(found["equal"], true);
    assert_eq!(found["whole"], true);
    assert_eq!(found["first_difference"], -1);
    let ticks = found["ticks"].as_u64().unwrap();
    assert!(ticks > 1000, "{found}");

    let tables = folder.path().join("tables");
    let mut export = rt_tests("export");
    let output = export
        .arg(&file)
        .arg("--csv")
        .arg(&tables)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", said(&output));
    for name in ["ticks.csv", "probe-0.csv"] {
        let text = std::fs::read_to_string(tables.join(name)).unwrap();
        let columns = |line: &str| line.split(',').count();
        let head = text.lines().next().unwrap();
        assert!(
            text.lines().all(|line| columns(line) == columns(head)),
            "{name}: {head}"
        );
        assert_eq!(text.lines().count() as u64, 1 + ticks, "{name}");
    }
    python_lists_the_channels(&file);

    let (output, _) = replay(&folder.path().join("nowhere.rec"));
    assert!(refusal(&output).contains("nowhere.rec"));
    let other = folder.path().join("other.rec");
    std::fs::write(&other, "not a recording").unwrap();
    assert!(refusal(&replay(&other).0).contains("other.rec"));
}

/// The `mcap` package of Python reads the file; skipped where it is not installed.
fn python_lists_the_channels(file: &Path) {
    let script = "import sys\nfrom mcap.reader import make_reader\n\
        summary = make_reader(open(sys.argv[1], 'rb')).get_summary()\n\
        print(*sorted(c.topic for c in summary.channels.values()))";
    let has_mcap = Command::new("python3").args(["-c", "import mcap"]).output();
    if !has_mcap.is_ok_and(|output| output.status.success()) {
        let _ = writeln!(
            std::io::stderr(),
            "skipped: python3 with the package mcap is not there (pip install mcap)"
        );
        return;
    }
    let listed = Command::new("python3")
        .args(["-c", script])
        .arg(file)
        .output();
    let listed = listed.unwrap();
    let topics = String::from_utf8_lossy(&listed.stdout);
    for topic in [
        "/probe/0/device",
        "/probe/0/wrench",
        "/stage_times",
        "/replay/tick",
    ] {
        assert!(topics.contains(topic), "{topics}{}", said(&listed));
    }
}

#[test]
fn a_run_that_is_killed_leaves_a_recording_that_replays() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    let mut command = rt_tests("run");
    command
        .arg(scene())
        .arg("--seconds=60")
        .arg("--out")
        .arg(folder.path().join("out"));
    let mut running = command.arg("--record").arg(&file).spawn().unwrap();
    let is_long = || std::fs::metadata(&file).is_ok_and(|of| of.len() > 2 << 20);
    for _ in 0..1200 {
        if is_long() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    assert!(is_long(), "the run records nothing");
    let controller = child(running.id(), "role-hrtc");
    let status = Command::new("kill")
        .args(["-KILL", &controller.to_string()])
        .status();
    assert!(status.unwrap().success());
    assert!(
        !running.wait().unwrap().success(),
        "a killed run has no result"
    );
    let (output, found) = replay(&file);
    assert!(output.status.success(), "{}", said(&output));
    assert_eq!(found["equal"], true, "{found}");
    assert_eq!(found["whole"], false, "{found}");
    assert!(found["ticks"].as_u64().unwrap() > 500, "{found}");
}

/// The child of a process that runs in a role.
fn child(parent: u32, role: &str) -> u32 {
    let children = format!("/proc/{parent}/task/{parent}/children");
    let children = std::fs::read_to_string(children).unwrap();
    let mut ids = children
        .split_whitespace()
        .map(|id| id.parse::<u32>().unwrap());
    let is_role = |id: &u32| {
        let typed = std::fs::read(format!("/proc/{id}/cmdline")).unwrap_or_default();
        String::from_utf8_lossy(&typed).contains(role)
    };
    ids.find(is_role).unwrap()
}

#[test]
fn a_recording_that_finds_no_room_does_not_end_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let more = ["--seconds=3", "--json", "--record", "/dev/full"];
    let output = run(&scene(), &folder.path().join("out"), &more);
    assert!(output.status.success(), "{}", said(&output));
    let told = said(&output).matches("ticks are not recorded").count();
    assert_eq!(told, 1, "{}", said(&output));
    let more = ["--seconds=3", "--record", "/nowhere/run.mcap"];
    let output = run(&scene(), &folder.path().join("out"), &more);
    assert!(!output.status.success());
    assert!(
        said(&output).contains("/nowhere/run.mcap"),
        "{}",
        said(&output)
    );
}
