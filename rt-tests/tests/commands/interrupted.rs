//! Ctrl-C while a command works: it ends, and what it kept for itself is gone.

use crate::typed::rt_tests;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

/// The shortest form of each command that keeps files while it works, and the file of whose name
/// this is a part, once which is there it is interrupted.
const COMMANDS: [(&str, &str, &str); 6] = [
    ("accuracy", "sphere:4096 --seconds=1", ".spm"),
    ("costs", "", ".toml"),
    ("deadline", SMALL, ".csv"),
    ("policies", SMALL, ".csv"),
    ("jitter", "--seconds=60", ".toml"),
    ("zwidth", "--seconds=60", "device.toml"),
];
const SMALL: &str = "--only=terrain-20cm --terrain-faces=20000 --slow=1 --seeds=1";
/// Looks at the most until a file is there, and until a command has ended.
const LOOKS: usize = 12_000;
const LOOK: Duration = Duration::from_millis(5);

#[test]
fn a_command_that_is_interrupted_ends_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    for (name, arguments, file) in COMMANDS {
        let temporary = folder.path().join(name);
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
        let ended = interrupt_at(&mut child, &|| has_file(&temporary, file));
        let said = std::fs::read_to_string(&said).unwrap();
        let status = ended.unwrap_or_else(|what| panic!("{name} {what}: {said}"));
        assert_eq!(status.code(), Some(1), "{name}: {said}");
        let left: Vec<_> = std::fs::read_dir(&temporary).unwrap().collect();
        assert!(left.is_empty(), "{name}: {left:?}");
    }
}

/// Interrupts a process once a file is there; how it ended, or what it did not do.
fn interrupt_at(child: &mut Child, is_there: &dyn Fn() -> bool) -> Result<ExitStatus, String> {
    let mut looks = 0;
    while !is_there() {
        looks += 1;
        if looks > LOOKS {
            child.kill().unwrap();
            child.wait().unwrap();
            return Err("never had the file".to_string());
        }
        if let Some(status) = child.try_wait().unwrap() {
            return Err(format!("ended with {status} before it was interrupted"));
        }
        std::thread::sleep(LOOK);
    }
    let id = child.id().to_string();
    let sent = Command::new("kill").args(["-INT", &id]).status();
    assert!(sent.unwrap().success());
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

/// Whether there is a file with this in its name, in the folder or one below.
fn has_file(folder: &Path, part: &str) -> bool {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.into_iter().any(|entry| {
        let path = entry.path();
        let name = entry.file_name().to_string_lossy().into_owned();
        path.is_dir() && has_file(&path, part) || path.is_file() && name.contains(part)
    })
}
