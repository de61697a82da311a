//! Ctrl-C, or SIGTERM as `timeout` sends it, while a command works: it ends, and what it kept for
//! itself is gone.

use crate::typed::rt_tests;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;
use transport::Domain;

/// Whether a command has come to where it is interrupted, by what is in its folder of temporary
/// files.
type IsThere = fn(&Path) -> bool;
/// The shortest form of each command that keeps files while it works; those with processes are
/// interrupted while they run: they record there, or have a folder for it beside the command's own.
const COMMANDS: [(&str, &str, IsThere); 8] = [
    ("accuracy", "sphere:4096 --seconds=1", |at| {
        has_file(at, ".spm")
    }),
    ("check", "", |at| has_file(at, ".toml")),
    ("costs", "", |at| has_file(at, ".toml")),
    ("deadline", SMALL, |at| entries(at) == 2),
    ("policies", SMALL, |at| has_file(at, ".csv")),
    ("tools", "relief:20000 comb --seconds=60 --seeds=1", |at| {
        has_file(at, "comb.spm")
    }),
    ("jitter", "--seconds=60", |at| {
        has_file(at, "recording.mcap")
    }),
    ("zwidth", "--seconds=60", |at| {
        has_file(at, "recording.mcap")
    }),
];
const SMALL: &str = "--only=terrain-20cm --terrain-faces=20000 --slow=1 --seeds=1";
/// Ctrl-C of a user, what `timeout` sends, to the process, then to its group, and a first Ctrl-C
/// after what another sent.
const SIGNALS: [&[&str]; 3] = [&["-INT"], &["-TERM", "-TERM"], &["-TERM", "-INT"]];
/// Time between two signals: so long that the second is one of its own.
const BETWEEN: Duration = Duration::from_millis(20);
/// Looks at the most until a command is there, and until it has ended.
const LOOKS: usize = 12_000;
const LOOK: Duration = Duration::from_millis(5);

#[test]
fn a_command_that_is_interrupted_ends_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    for (name, arguments, is_there) in COMMANDS {
        for signals in SIGNALS {
            let temporary = folder.path().join(format!("{name}{}", signals.concat()));
            std::fs::create_dir(&temporary).unwrap();
            let said = folder.path().join("said");
            let mut command = rt_tests(name);
            command
                .args(arguments.split_whitespace())
                .env("TMPDIR", &temporary)
                .current_dir(folder.path())
                .stdout(Stdio::null())
                .stderr(std::fs::File::create(&said).unwrap());
            let mut child = command.spawn().unwrap();
            let ended = interrupt_at(&mut child, &|| is_there(&temporary), signals);
            let said = std::fs::read_to_string(&said).unwrap();
            let status = ended.unwrap_or_else(|what| panic!("{name} {what}: {said}"));
            assert_eq!(status.code(), Some(1), "{name} {signals:?}: {said}");
            let left: Vec<_> = std::fs::read_dir(&temporary).unwrap().collect();
            assert!(left.is_empty(), "{name} {signals:?}: {left:?}");
            let own = format!("run-{}-", child.id());
            let mut domains = Domain::all_of_user();
            domains.retain(|of| of.name().starts_with(&own));
            assert!(domains.is_empty(), "{name} {signals:?}: {domains:?}");
        }
    }
}

/// Nothing is temporary yet where models are built, so that a request to end ends also what takes
/// long or waits for another build.
#[test]
fn a_command_that_builds_ends_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let scene = include_str!("../../../config/scenes/first-touch.toml");
    std::fs::write(folder.path().join("scene.toml"), scene).unwrap();
    let cache = folder.path().canonicalize().unwrap().join("cache");
    let temporary = folder.path().join("temporary");
    for path in [&cache, &temporary] {
        std::fs::create_dir(path).unwrap();
    }
    // Who builds holds the folder of models.
    let building = std::fs::File::open(&cache).unwrap();
    building.lock().unwrap();
    for (name, arguments) in [("check", "scene.toml"), ("tools", "relief:1000 comb")] {
        let mut command = rt_tests(name);
        command
            .args(arguments.split_whitespace())
            .env("HRTC_CACHE", &cache)
            .env("TMPDIR", &temporary)
            .current_dir(folder.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        let opened = format!("/proc/{}/fd", child.id());
        let waits = || {
            let opened = std::fs::read_dir(&opened).into_iter().flatten().flatten();
            let mut files = opened.filter_map(|of| std::fs::read_link(of.path()).ok());
            files.any(|file| file == cache)
        };
        let ended = interrupt_at(&mut child, &waits, &["-TERM"]);
        let status = ended.unwrap_or_else(|what| panic!("{name} {what}"));
        // Its own doing would be a status.
        assert_eq!((status.code(), status.signal()), (None, Some(15)), "{name}");
        assert_eq!(entries(&temporary), 0, "{name}");
    }
}

/// Sends a process signals once it is there; how it ended, or what it did not do.
fn interrupt_at(
    child: &mut Child,
    is_there: &dyn Fn() -> bool,
    signals: &[&str],
) -> Result<ExitStatus, String> {
    let mut looks = 0;
    while !is_there() {
        looks += 1;
        if looks > LOOKS {
            child.kill().unwrap();
            child.wait().unwrap();
            return Err("never was there".to_string());
        }
        if let Some(status) = child.try_wait().unwrap() {
            return Err(format!("ended with {status} before it was interrupted"));
        }
        std::thread::sleep(LOOK);
    }
    let id = child.id().to_string();
    for (number, signal) in signals.iter().enumerate() {
        let sent = Command::new("kill").args([signal, id.as_str()]).output();
        // The process may have ended by the first.
        assert!(sent.unwrap().status.success() || number > 0);
        std::thread::sleep(BETWEEN);
    }
    for _ in 0..LOOKS {
        if let Some(status) = child.try_wait().unwrap() {
            return Ok(status);
        }
        std::thread::sleep(LOOK);
    }
    child.kill().unwrap();
    child.wait().unwrap();
    Err("did not end".to_string())
}

/// Files and folders in a folder.
fn entries(folder: &Path) -> usize {
    std::fs::read_dir(folder).into_iter().flatten().count()
}

/// Whether there is a file with this in its name, in the folder or one below.
fn has_file(folder: &Path, part: &str) -> bool {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.into_iter().any(|entry| {
        let path = entry.path();
        let name = entry.file_name().to_string_lossy().into_owned();
        path.is_dir() && has_file(&path, part) || path.is_file() && name.contains(part)
    })
}
