//! The commands as a user types them: what works, and every bad input as one sentence with status
//! 2.

use serde_json::Value;
use std::io::Write;
use std::ops::Range;
use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

fn station(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ve-station"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap()
}

fn json(output: &Output) -> Value {
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Runs a command that must fail, and gives its sentence.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let before = std::fs::read_dir(folder).unwrap().count();
    let output = station(folder, arguments);
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {text}");
    assert!(output.stdout.is_empty());
    assert_eq!(text.trim_end().lines().count(), 1, "{text}");
    assert!(!text.contains("panicked"), "{text}");
    let after = std::fs::read_dir(folder).unwrap().count();
    assert_eq!(before, after, "something half-written is left");
    text
}

/// The numbers of an object, all finite, null nowhere.
fn all_numbers(value: &Value) -> bool {
    match value {
        Value::Object(map) => map.values().all(all_numbers),
        Value::Array(list) => list.iter().all(all_numbers),
        Value::Null => false,
        _ => true,
    }
}

#[test]
fn generate_build_and_inspect_agree() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for file in ["mesh.obj", "mesh.ply"] {
        let made = station(at, &["generate", "sphere", "--faces", "4096", "-o", file]);
        assert!(made.status.success());
        let built = json(&station(at, &["build", file, "-o", "mesh.spm", "--json"]));
        assert_eq!(built["vertices"], 2050);
        assert_eq!(built["faces"], 4096);
        assert_eq!(built["read"]["vertices"], 2050);
        assert_eq!(built["cut_vertices"], 0);
        assert_eq!(built["cracks_max"], 0.0);
        assert!(built["seconds"].as_f64().unwrap() > 0.0);
        assert!(built["peak_rss_bytes"].as_u64().unwrap() > 100_000);
        assert!(all_numbers(&built));
        let length = std::fs::metadata(at.join("mesh.spm")).unwrap().len();
        assert_eq!(built["file_bytes"], length);

        let found = json(&station(
            at,
            &["inspect", "mesh.spm", "--size", "0.1", "--json"],
        ));
        assert!(all_numbers(&found));
        for field in [
            "vertices",
            "faces",
            "read",
            "dropped",
            "cut_vertices",
            "base_faces",
            "vsps",
            "chain",
            "regions",
            "closure_mean",
            "closure_max",
            "cracks_max",
        ] {
            assert_eq!(found[field], built[field], "{field}");
        }
        // A sphere of 5 cm radius has 0.0314 square metres.
        let cell = 0.1 / built["divisions"].as_f64().unwrap();
        let said = found["greatest_speed_m_per_s"].as_f64().unwrap();
        // Three radii of 1 mm, a cell, and the way of 2 ms on either side.
        let width = 0.003 + cell + 2.0 * 0.002 * said;
        let speed = 96.0 / (4096.0 / 0.031_416 * width * 1e-3);
        assert!((said / speed - 1.0).abs() < 0.02, "{said} {speed}");
        let picture = ["inspect", "mesh.spm", "--picture", "mesh.png"];
        assert!(station(at, &picture).status.success());
        let png = std::fs::read(at.join("mesh.png")).unwrap();
        assert!(png.starts_with(b"\x89PNG"), "{} bytes", png.len());
        let text = station(at, &["inspect", "mesh.spm"]);
        assert!(
            String::from_utf8(text.stdout)
                .unwrap()
                .contains("certified error")
        );
    }
}

#[test]
fn a_link_that_cannot_be_is_one_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let serve = |more: &[&str]| {
        let typed = [&["serve", "scene.toml", "--domain", "no-link"], more].concat();
        refused(at, &typed)
    };
    if cfg!(feature = "tunnel") {
        let sentence = serve(&["--listen", "tcp/0.0.0.0:7447"]);
        assert!(sentence.contains("ve-station keys DIR"), "{sentence}");
        let sentence = serve(&["--listen", "7447"]);
        assert!(sentence.contains("tls/192.168.1.10:7447"), "{sentence}");
        let nowhere = ["--listen", "tls/127.0.0.1:7447", "--keys", "nowhere"];
        let sentence = serve(&nowhere);
        assert!(sentence.contains("nowhere/authority.pem"), "{sentence}");
        let other = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let taken = format!("tcp/{}", other.local_addr().unwrap());
        let sentence = serve(&["--listen", &taken]);
        assert!(sentence.contains(&taken), "{sentence}");
    } else {
        let sentence = serve(&["--listen", "tls/0.0.0.0:7447"]);
        assert!(sentence.contains("--features tunnel"), "{sentence}");
        let sentence = refused(at, &["keys", "keys"]);
        assert!(sentence.contains("--features tunnel"), "{sentence}");
    }
    transport::Domain::new("no-link").unwrap().remove_files();
}

/// Also where a path has a blank and a quote in it, and settings are kept elsewhere.
#[cfg(feature = "tunnel")]
#[test]
fn the_printed_command_copies_the_stations_keys_to_where_it_looks_for_them() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let settings = at.join("my settings");
    let made = Command::new(env!("CARGO_BIN_EXE_ve-station"))
        .current_dir(at)
        .args(["keys", "the lab's keys"])
        .env("HOME", at)
        .env("XDG_CONFIG_HOME", &settings)
        .output()
        .unwrap();
    let said = String::from_utf8(made.stdout).unwrap();
    let mut lines = said.lines();
    let command = lines.find_map(|line| line.strip_prefix("on the station:"));
    let copied = Command::new("sh")
        .args(["-c", command.unwrap()])
        .current_dir(at)
        .env("HOME", at)
        .status();
    assert!(copied.unwrap().success(), "{said}");
    let keys = std::fs::read_dir(settings.join("hrtc/keys")).unwrap();
    assert_eq!(keys.count(), 3, "{said}");
}

#[test]
fn bad_meshes_are_one_sentence_each() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let write = |name: &str, content: &[u8]| std::fs::write(at.join(name), content).unwrap();
    write("nan.obj", b"v nan 0 0\nv nan 1 0\nv 0 nan 1\nf 1 2 3\n");
    write("text.obj", b"Dear reader,\nthis is a letter.\n");
    write("letter.txt", b"Dear reader");
    write("broken.obj", b"v 0 0 0\nv 1 0\n");
    write("points.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n");
    write("line.off", b"OFF\n3 1 0\n0 0 0\n1 1 1\n2 2 2\n3 0 1 2\n");
    write("short.ply", b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n");
    write("no.stl", b"not an stl at all");
    write("empty.ply", b"");
    write("empty.cdpm", b"");
    std::fs::create_dir(at.join("folder.obj")).unwrap();
    write(
        "short.stl",
        &[&[b' '; 80][..], &9u32.to_le_bytes()].concat(),
    );
    write("binary.ply", b"ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n0123");
    write("list.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty int vertex_indices\nend_header\n0 0 0\n1\n");
    write(
        "broken.cdpm",
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nv* 1 0 0 0 0 0 0 2 & 1 2\n",
    );
    write("broken.spmtxt", b"b 1 3\n$ 2 4 1\nv 1 0 0 0\nv* 2 1 3 4\n");
    let cases = [
        ("missing.obj", "No such file"),
        ("nan.obj", "not a finite number"),
        ("text.obj", "no line that starts with v"),
        ("letter.txt", ".obj, .ply, .stl, .off, .cdpm or .spmtxt"),
        ("broken.obj", "line 2"),
        ("points.obj", "no face"),
        ("line.off", "no area"),
        ("short.ply", "PLY"),
        ("no.stl", "STL"),
        ("empty.ply", "PLY"),
        ("empty.cdpm", "starts with v"),
        ("folder.obj", "no file"),
        ("short.stl", "announces 9 triangles and holds 0"),
        ("binary.ply", "within vertex 1 of 3"),
        ("list.ply", "line 7: its faces have no list"),
        ("broken.cdpm", "line 5: \"v* 1 0 0 0 0 0 0 2 & 1 2\""),
        ("broken.spmtxt", "line 4: \"v* 2 1 3 4\""),
    ];
    for (mesh, expected) in cases {
        let text = refused(at, &["build", mesh, "-o", "out.spm"]);
        assert!(text.contains(mesh) && text.contains(expected), "{text}");
    }
    write("good.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
    let text = refused(at, &["build", "good.off", "-o", "nowhere/out.spm"]);
    assert!(text.contains("nowhere"), "{text}");
    let text = refused(
        at,
        &["build", "good.off", "-o", "out.spm", "--regions", "12"],
    );
    assert!(text.contains("power of two"), "{text}");
    let text = refused(
        at,
        &["generate", "plate", "--faces", "100", "-o", "plate.stl"],
    );
    assert!(text.contains(".obj or .ply"), "{text}");
}

/// Runs a command in a folder on a file system of so many KiB that only it sees; `None` where that
/// cannot be mounted.
fn station_on_small_disk(kib: u32, prepare: &str, arguments: &[&str]) -> Option<Output> {
    let folder = tempfile::tempdir().unwrap();
    let script = format!(
        "mount -t tmpfs -o size={kib}k tmpfs \"$1\" || exit 77; cd \"$1\"; {prepare}; shift; exec \"$@\""
    );
    let output = Command::new("unshare")
        .args(["--mount", "sh", "-c", &script, "sh"])
        .arg(folder.path())
        .arg(env!("CARGO_BIN_EXE_ve-station"))
        .args(arguments)
        .env("HRTC_CACHE", folder.path().join("cache"))
        .output()
        .ok()?;
    let is_mounted = !matches!(output.status.code(), Some(1 | 77));
    is_mounted.then_some(output)
}

#[test]
fn a_disk_without_room_is_named_before_anything_is_built() {
    let scene = "printf '[[object]]\\ngenerate = { shape = \"sphere\", faces = 20000 }\\nsize_m = 0.1\\n[[probe]]\\n' > scene.toml";
    let mesh = format!(
        "{} generate sphere --faces 2000 -o m.ply",
        env!("CARGO_BIN_EXE_ve-station")
    );
    let runs: [(u32, &str, &[&str]); 2] = [
        (256, scene, &["serve", "scene.toml", "--domain", "no-room"]),
        (200, &mesh, &["build", "m.ply", "-o", "m.spm"]),
    ];
    for (kib, prepare, arguments) in runs {
        let Some(output) = station_on_small_disk(kib, prepare, arguments) else {
            println!("skipped: no small disk can be mounted here");
            return;
        };
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{text}");
        let sentence = text.lines().last().unwrap();
        assert!(sentence.contains("free: make room"), "{text}");
        // The folder, what is needed and what is free.
        let is_bytes = |word: &str| word.parse::<u64>().is_ok_and(|bytes| bytes > 10_000);
        let numbers = sentence.split_whitespace().filter(|word| is_bytes(word));
        assert!(numbers.count() >= 2, "{sentence}");
    }
    // With room it is built.
    let arguments = ["build", "m.ply", "-o", "m.spm"];
    let output = station_on_small_disk(2048, &mesh, &arguments).unwrap();
    assert!(output.status.success(), "{output:?}");
}

#[test]
fn export_writes_what_build_reads() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    station(
        at,
        &["generate", "relief", "--faces", "3000", "-o", "a.ply"],
    );
    let built = json(&station(at, &["build", "a.ply", "-o", "a.spm", "--json"]));
    for output in ["b.obj", "b.ply", "b.stl", "b.off", "b.cdpm", "b.spmtxt"] {
        let done = json(&station(at, &["export", "a.spm", "-o", output, "--json"]));
        assert_eq!(done["faces"], built["faces"], "{output}");
        let again = json(&station(at, &["build", output, "-o", "b.spm", "--json"]));
        for field in ["vertices", "faces"] {
            assert_eq!(again[field], built[field], "{output}");
        }
    }
    let arguments = ["export", "a.spm", "-o", "c.txt", "--format", "cdpm"];
    let few = station(at, &[&arguments[..], &["--faces", "1000"]].concat());
    assert!(few.status.success());
    let text = String::from_utf8(few.stdout).unwrap();
    assert!(text.contains("faces") && text.contains("c.txt"), "{text}");
    let text = std::fs::read_to_string(at.join("c.txt")).unwrap();
    assert!(
        text.starts_with("# 3D model: 1000 faces") || text.starts_with("# 3D model: 999 faces")
    );
    let cases: [(&[&str], &str); 4] = [
        (
            &["export", "a.ply", "-o", "c.obj"],
            "a.ply: this is not an SPM file",
        ),
        (&["export", "a.spm", "-o", "c.xyz"], "--format"),
        (
            &["export", "a.spm", "-o", "c.obj", "--tolerance", "-1"],
            "--tolerance",
        ),
        (&["export", "none.spm", "-o", "c.obj"], "none.spm"),
    ];
    for (arguments, expected) in cases {
        let text = refused(at, arguments);
        assert!(text.contains(expected), "{text}");
    }
}

#[test]
fn a_mesh_on_standard_output_is_all_that_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let made = [
        &["generate", "torus", "--faces", "500", "-o", "a.ply"][..],
        &["build", "a.ply", "-o", "a.spm"],
        &["export", "a.spm", "-o", "a.off"],
    ];
    for arguments in made {
        assert!(station(at, arguments).status.success(), "{arguments:?}");
    }
    let expected = std::fs::read(at.join("a.off")).unwrap();
    let export = ["export", "a.spm", "-o", "/dev/stdout", "--format", "off"];
    for more in [&[][..], &["--json"]] {
        let piped = station(at, &[&export[..], more].concat());
        assert!(piped.stdout == expected, "{more:?}");
        let said = String::from_utf8(piped.stderr).unwrap();
        assert!(said.contains(&expected.len().to_string()), "{said}");
    }
    // Redirected into a file, behind what is there. Nothing takes the place of the link: here it is
    // one of our own.
    std::os::unix::fs::symlink("/dev/stdout", at.join("link")).unwrap();
    let behind = [&b"before\n"[..], &expected].concat();
    for (append, expected) in [(false, &expected), (true, &behind)] {
        std::fs::write(at.join("b.off"), b"before\n").unwrap();
        let mut options = std::fs::File::options();
        let options = options.append(append).write(true).truncate(!append);
        let redirected = Command::new(env!("CARGO_BIN_EXE_ve-station"))
            .current_dir(at)
            .args(["export", "a.spm", "-o", "link", "--format", "off"])
            .stdout(options.open(at.join("b.off")).unwrap())
            .status();
        assert!(redirected.unwrap().success());
        let found = std::fs::read(at.join("b.off")).unwrap();
        assert!(found == *expected, "append: {append}");
    }
    assert!(std::fs::read_link(at.join("link")).is_ok());
}

/// The parts of an SPM file that hold something, by its table: the header and the sections.
fn parts_of_spm(bytes: &[u8]) -> Vec<Range<usize>> {
    // As spm::Section has them.
    const ITEM_BYTES: [usize; 12] = [16, 32, 4, 4, 8, 4, 12, 4, 64, 16, 24, 20];
    let header = size_of::<spm::SpmHeader>();
    // Offset, count and checksum of each section; then only the header's checksum.
    let table = &bytes[header - 8 - 24 * ITEM_BYTES.len()..header - 8];
    let number = |at: usize| u64::from_le_bytes(table[at..at + 8].try_into().unwrap()) as usize;
    let head = 0..header;
    let mut parts = vec![head];
    for (k, item_bytes) in ITEM_BYTES.into_iter().enumerate() {
        let (offset, count) = (number(24 * k), number(24 * k + 8));
        let before = parts[k].end;
        assert_eq!(offset, before.next_multiple_of(64), "section {k}");
        parts.push(offset..offset + count * item_bytes);
    }
    assert_eq!(parts[ITEM_BYTES.len()].end, bytes.len());
    parts
}

#[test]
fn damaged_spm_files_are_one_sentence_each() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    station(
        at,
        &["generate", "torus", "--faces", "3000", "-o", "torus.ply"],
    );
    assert!(
        station(at, &["build", "torus.ply", "-o", "torus.spm"])
            .status
            .success()
    );
    let sound = std::fs::read(at.join("torus.spm")).unwrap();
    let bad = at.join("bad.spm");
    std::fs::write(&bad, b"").unwrap();
    let inspect = || refused(at, &["inspect", "bad.spm"]);
    assert!(inspect().contains("not an SPM file"));
    for length in [5, 100, 1000, sound.len() / 2, sound.len() - 1] {
        std::fs::write(&bad, &sound[..length]).unwrap();
        let text = inspect();
        assert!(
            text.contains("bad.spm: ") && text.contains("SPM file"),
            "{text}"
        );
    }
    let parts = parts_of_spm(&sound);
    for place in (0..sound.len()).step_by(sound.len() / 40) {
        // Between sections there is padding, which says nothing.
        if !parts.iter().any(|part| part.contains(&place)) {
            continue;
        }
        let mut flipped = sound.clone();
        flipped[place] ^= 16;
        std::fs::write(&bad, &flipped).unwrap();
        let text = inspect();
        assert!(text.contains("bad.spm: "), "byte {place}: {text}");
    }
    let mut flipped = sound.clone();
    let middle = sound.len() / 2;
    flipped[middle] ^= 16;
    std::fs::write(&bad, &flipped).unwrap();
    let text = inspect();
    assert!(text.contains("of the section \"records\""), "{text}");
    assert!(refused(at, &["inspect", "missing.spm"]).contains("missing.spm"));
    for size in ["0", "-1"] {
        let text = refused(at, &["inspect", "torus.spm", "--size", size]);
        assert!(text.contains(&format!("--size {size}")), "{text}");
    }
}

#[test]
fn an_output_that_is_the_input_or_of_another_ending_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let made = station(at, &["generate", "torus", "--faces", "3000", "-o", "a.obj"]);
    assert!(made.status.success());
    assert!(
        station(at, &["build", "a.obj", "-o", "a.spm"])
            .status
            .success()
    );
    let read = || ["a.obj", "a.spm"].map(|name| std::fs::read(at.join(name)).unwrap());
    let before = read();
    let cases: [(&[&str], &str); 6] = [
        (&["build", "a.obj", "-o", "a.obj"], "the input"),
        (&["build", "a.obj", "-o", "./a.obj"], "the input"),
        (&["build", "a.obj", "-o", "b.obj"], ".spm"),
        (&["inspect", "a.spm", "--picture", "a.spm"], "the input"),
        (&["inspect", "a.spm", "--picture", "a.obj"], ".png"),
        (
            &["export", "a.spm", "-o", "a.spm", "--format", "obj"],
            "the input",
        ),
    ];
    for (arguments, expected) in cases {
        let text = refused(at, arguments);
        assert!(text.contains(expected), "{arguments:?}: {text}");
    }
    assert!(read() == before, "an input was overwritten");
}

#[test]
fn an_output_that_cannot_be_written_is_told_before_the_model_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let cases: [&[&str]; 2] = [
        &["inspect", "none.spm", "--picture", "nowhere/a.png"],
        &["export", "none.spm", "-o", "nowhere/a.obj"],
    ];
    for arguments in cases {
        let text = refused(folder.path(), arguments);
        assert!(text.contains("the folder nowhere takes no file"), "{text}");
    }
}

#[test]
fn a_signal_ends_serve_also_while_it_builds_a_model() {
    for signal in ["-INT", "-TERM", "-HUP"] {
        let folder = tempfile::tempdir().unwrap();
        // Minutes of work for a test build.
        let scene = "[[object]]\ngenerate = { shape = \"terrain\", faces = 4000000 }\nsize_m = 0.1\n[[probe]]\n";
        std::fs::write(folder.path().join("large.toml"), scene).unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_ve-station"))
            .current_dir(folder.path())
            .args(["serve", "large.toml", "--domain", "stopped-while-building"])
            .env("HRTC_CACHE", folder.path().join("cache"))
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        // The folder is made just before the build; the handlers stand long before.
        while !folder.path().join("cache").exists() {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        let id = child.id().to_string();
        assert!(
            Command::new("kill")
                .args([signal, &id])
                .status()
                .unwrap()
                .success()
        );
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{signal}: {said}");
        assert!(said.contains("stopped before the models"), "{said}");
        let left = std::fs::read_dir(folder.path().join("cache")).unwrap();
        assert_eq!(left.count(), 0, "nothing half-written");
    }
}

/// As with a terminal that is paused. `timeout` sends SIGTERM twice, the second time while the end
/// still waits for a reader: it ends with its own status all the same.
#[test]
fn a_service_whose_lines_nobody_reads_serves_and_ends() {
    let folder = tempfile::tempdir().unwrap();
    let scene =
        "[[object]]\ngenerate = { shape = \"sphere\", faces = 2000 }\nsize_m = 0.1\n[[probe]]\n";
    std::fs::write(folder.path().join("unread.toml"), scene).unwrap();
    let (unread, mut errors) = std::io::pipe().unwrap();
    // A pipe's room (pipe(7)).
    errors.write_all(&[b' '; 1 << 16]).unwrap();
    let name = format!("unread-{}", std::process::id());
    let mut child = Command::new(env!("CARGO_BIN_EXE_ve-station"))
        .current_dir(folder.path())
        .args(["serve", "unread.toml", "--domain", &name])
        .env("HRTC_CACHE", folder.path().join("cache"))
        .stderr(errors)
        .spawn()
        .unwrap();
    let domain = transport::Domain::new(&name).unwrap();
    let node = domain.node().unwrap();
    let heartbeats = domain.heartbeats(&node).unwrap().incoming;
    let start = Instant::now();
    let mut is_heard = false;
    while !is_heard && start.elapsed().as_secs() < 60 {
        std::thread::sleep(Duration::from_millis(5));
        is_heard = heartbeats.receive().unwrap().is_some();
    }
    let signal = if is_heard { "-TERM" } else { "-KILL" };
    for _ in 0..2 {
        let id = child.id().to_string();
        let sent = Command::new("kill").args([signal, &id]).status();
        assert!(sent.unwrap().success());
    }
    let status = child.wait().unwrap();
    drop(heartbeats);
    drop(node);
    domain.remove_files();
    assert!(is_heard, "nothing is served");
    assert_eq!(status.code(), Some(0), "{status}");
    drop(unread);
}
