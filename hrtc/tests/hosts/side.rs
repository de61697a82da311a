//! The programs of a link, and what they say.

use protocol::{HELLO_PERIOD_MS, Hello};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use transport::Domain;

/// Time between two looks.
pub const POLL: Duration = Duration::from_millis(5);
/// A program that has not said something by then never will: no measure of anything.
const HANGING: Duration = Duration::from_secs(120);

/// A link between two domains of this machine.
pub struct Link {
    /// As both sides type it.
    pub address: String,
    keys: Option<PathBuf>,
    domains: [Domain; 2],
    scene: PathBuf,
    folder: tempfile::TempDir,
}

impl Link {
    pub fn new(name: &str, address: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let bundled = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../config/scenes/first-touch.toml"
        );
        let text = std::fs::read_to_string(bundled).unwrap();
        let scene = folder.path().join("scene.toml");
        std::fs::write(&scene, text.replace("faces = 100000", "faces = 20000")).unwrap();
        let id = std::process::id();
        let domain = |side: &str| Domain::new(&format!("{name}-{side}-{id}")).unwrap();
        Self {
            address: address.to_owned(),
            keys: None,
            domains: [domain("a"), domain("b")],
            scene,
            folder,
        }
    }

    /// Makes keys by the command; both sides take theirs from now on.
    pub fn make_keys(&mut self, name: &str) {
        let folder = self.folder.path().join(name);
        let mut command = program("ve-station");
        let made = command.arg("keys").arg(&folder).output().unwrap();
        let said = String::from_utf8_lossy(&made.stderr);
        assert!(made.status.success(), "{said}");
        self.keys = Some(folder);
    }

    /// Makes keys that are valid for so long only; both sides take theirs from now on.
    pub fn make_short_keys(&mut self, lasting: Duration) {
        let folder = self.folder.path().join("short");
        tunnel::make_keys(&folder, &[], lasting).unwrap();
        self.keys = Some(folder);
    }

    /// Takes the keys away from both sides, those that run already apart.
    pub fn lose_keys(&mut self) {
        self.keys = Some(self.folder.path().join("nowhere"));
    }

    /// Lets the controller trust the authority of other keys beside its own.
    pub fn trust_too(&self, other: &str) {
        let authority = "controller/authority.pem";
        let own = self.keys.as_ref().unwrap().join(authority);
        let mut trusted = std::fs::read(&own).unwrap();
        trusted.extend(std::fs::read(self.folder.path().join(other).join(authority)).unwrap());
        std::fs::write(&own, trusted).unwrap();
    }

    /// Puts both sides into one domain.
    pub fn share_domain(&mut self) {
        self.domains[1] = self.domains[0].clone();
    }

    /// A station that listens.
    pub fn station(&self) -> Side {
        let mut command = program("ve-station");
        command.arg("serve").arg(&self.scene).arg("--listen");
        let mut station = self.side(command, "station", &self.domains[0], &[]);
        station.wait_for("ready");
        station
    }

    /// A controller that calls it.
    pub fn controller(&self, more: &[&str]) -> Side {
        let mut command = program("hrtc");
        command.arg("run").arg(&self.scene);
        command.args(["--record", "off", "--station"]);
        self.side(command, "controller", &self.domains[1], more)
    }

    /// The process of a tunnel alone: on the station's side, or on the controller's.
    pub fn tunnel(&self, program_name: &str) -> TunnelAlone {
        let (option, domain) = match program_name {
            "ve-station" => ("--listen", &self.domains[0]),
            _ => ("--call", &self.domains[1]),
        };
        let mut command = program(program_name);
        command.args(["tunnel", "--domain", domain.name()]);
        command.arg(option).arg(&self.address);
        TunnelAlone::start(&mut command, domain)
    }

    fn side(&self, mut command: Command, role: &str, domain: &Domain, more: &[&str]) -> Side {
        command.arg(&self.address).args(["--domain", domain.name()]);
        if let Some(keys) = &self.keys
            && self.address.starts_with("tls")
        {
            command.arg("--keys").arg(keys.join(role));
        }
        Side::start(command.args(more))
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        for domain in &self.domains {
            domain.remove_files();
        }
    }
}

/// A program of the workspace, with built models kept in cargo's folder for tests.
fn program(name: &str) -> Command {
    let folder = Path::new(env!("CARGO_BIN_EXE_hrtc")).parent().unwrap();
    let path = folder.join(name);
    assert!(
        path.exists(),
        "build it first: cargo build --release -p ve-station --features tunnel"
    );
    let mut command = Command::new(path);
    command
        .env(
            "HRTC_CACHE",
            concat!(env!("CARGO_TARGET_TMPDIR"), "/models"),
        )
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// The process of a tunnel, and a voice in its domain.
pub struct TunnelAlone {
    child: Child,
    domain: Domain,
}

impl TunnelAlone {
    fn start(command: &mut Command, domain: &Domain) -> Self {
        // It ends when its input does.
        let mut child = command.stdin(Stdio::piped()).spawn().unwrap();
        let words = BufReader::new(child.stdout.as_mut().unwrap()).lines();
        let is_ready = words.map_while(Result::ok).any(|word| word == "ready");
        assert!(is_ready, "the tunnel said why it is not");
        let domain = domain.clone();
        Self { child, domain }
    }

    /// Says this until it is answered for.
    pub fn say_until(&self, hello: Hello, mut is_heard: impl FnMut() -> bool) {
        let node = self.domain.node().unwrap();
        let voice = self.domain.heartbeats(&node).unwrap().outgoing;
        let begin = Instant::now();
        while !is_heard() {
            assert!(begin.elapsed() < HANGING, "nobody heard {hello:?}");
            voice.send_copy(hello).unwrap();
            std::thread::sleep(Duration::from_millis(HELLO_PERIOD_MS));
        }
    }
}

impl Drop for TunnelAlone {
    fn drop(&mut self) {
        self.child.stdin = None;
        let _ = self.child.wait();
    }
}

/// A running program.
pub struct Side {
    child: Child,
    said: Arc<Mutex<Vec<String>>>,
    reader: Option<JoinHandle<()>>,
}

impl Side {
    fn start(command: &mut Command) -> Self {
        let mut child = command.spawn().unwrap();
        let said = Arc::<Mutex<Vec<String>>>::default();
        let lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let kept = Arc::clone(&said);
        let reader = std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                kept.lock().unwrap().push(line);
            }
        });
        Self {
            child,
            said,
            reader: Some(reader),
        }
    }

    /// Whether it has said this.
    pub fn said(&self, text: &str) -> bool {
        let said = self.said.lock().unwrap();
        said.iter().any(|line| line.contains(text))
    }

    /// Waits until it has said this.
    pub fn wait_for(&mut self, text: &str) {
        let begin = Instant::now();
        while !self.said(text) {
            let mut is_waiting = begin.elapsed() < HANGING;
            if self.child.try_wait().unwrap().is_some() {
                // Its last words may be under way still.
                let reader = self.reader.take();
                is_waiting &= reader.is_some();
                let _ = reader.map(JoinHandle::join);
            }
            let said = self.said.lock().unwrap().join("\n");
            assert!(is_waiting, "never said {text:?}:\n{said}");
            std::thread::sleep(POLL);
        }
    }

    /// Ctrl-C.
    pub fn interrupt(&self) {
        signal("-INT", self.child.id());
    }

    /// Ends it as a crash does.
    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// How it ended.
    pub fn status(&mut self) -> ExitStatus {
        self.child.wait().unwrap()
    }

    /// What it printed, at its end.
    pub fn result(&mut self) -> String {
        let mut text = String::new();
        let output = self.child.stdout.as_mut().unwrap();
        output.read_to_string(&mut text).unwrap();
        let status = self.child.wait().unwrap();
        let said = self.said.lock().unwrap().join("\n");
        assert!(status.success(), "{status}:\n{said}");
        text
    }

    /// Process id of its tunnel.
    pub fn tunnel(&self) -> u32 {
        self.tunnels().next().expect("it has a tunnel")
    }

    fn tunnels(&self) -> impl Iterator<Item = u32> + use<> {
        let threads = std::fs::read_dir(format!("/proc/{}/task", self.child.id()));
        let of_thread = |thread: std::fs::DirEntry| {
            let text = std::fs::read_to_string(thread.path().join("children"));
            text.unwrap_or_default()
        };
        let all = threads.into_iter().flatten().flatten().map(of_thread);
        let ids = all.flat_map(|text| {
            let ids = text.split_whitespace().map(|id| id.parse().unwrap());
            ids.collect::<Vec<u32>>()
        });
        ids.collect::<Vec<_>>().into_iter()
    }

    /// Kills its tunnel.
    pub fn kill_tunnel(&self) {
        signal("-KILL", self.tunnel());
    }
}

/// Its tunnel has ended too then, and makes no file any more.
impl Drop for Side {
    fn drop(&mut self) {
        let tunnel = self.tunnels().next();
        let _ = self.child.kill();
        let _ = self.child.wait();
        while tunnel.is_some_and(is_running) {
            std::thread::sleep(POLL);
        }
    }
}

fn signal(name: &str, process: u32) {
    let sent = Command::new("kill")
        .args([name, &process.to_string()])
        .status();
    assert!(sent.unwrap().success());
}

/// Whether a process runs, not only waits for its parent to look.
pub fn is_running(process: u32) -> bool {
    std::fs::read_to_string(format!("/proc/{process}/cmdline")).is_ok_and(|text| !text.is_empty())
}

/// A port that nobody has.
pub fn free_port() -> u16 {
    let socket = TcpListener::bind("127.0.0.1:0").unwrap();
    socket.local_addr().unwrap().port()
}

/// The object that a program printed.
pub fn json(text: String) -> Value {
    serde_json::from_str(&text).unwrap_or_else(|_| panic!("no object: {text}"))
}
