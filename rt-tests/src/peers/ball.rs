//! The proxy of a ball in another library, in a program of its own: it is given a scene and, tick
//! by tick, the device's position, and answers with a force and where its proxy is.
//!
//! A peer speaks on standard input and output, little-endian:
//!
//! | message | holds |
//! |---|---|
//! | hello, by the peer | a line: `ball 1` and the names of its variants |
//! | scene | u64 1, u64 variant, `f64[6]` radius, stiffness, damping, friction (static, dynamic), largest shaded turn (0 for none), u64 vertices, u64 faces, `f64[3]` a vertex, `u32[3]` a face |
//! | steps | u64 2, u64 count, `f64[10]` a tick: pose of the object x y z, quaternion x y z w, device x y z |
//! | answers, by the peer | `f64[7]` a tick: force x y z, proxy x y z, nanoseconds |
//!
//! Metres, newtons, radians; vertices in the axes of the object. A message holds at most 250 steps.

use crate::failure::Failure;
use geometry::Pose;
use glam::DVec3;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// First words of a peer.
const HELLO: &str = "ball 1 ";
/// The longest first line, bytes.
const MAX_HELLO: u64 = 1024;
/// Seconds after which a peer that says nothing is given up; a tree over a million faces and ten
/// thousand steps on it take some.
const TIMEOUT: Duration = Duration::from_secs(120);
/// The signal by which a process is killed from here.
const KILLED: i32 = 9;
/// Kinds of messages.
const SCENE: u64 = 1;
const STEPS: u64 = 2;
/// Steps of a message, at most: with their answers they find room in a socket, also where the peer
/// answers each of them before it reads the next.
const MAX_STEPS: usize = 250;
/// Bytes of an answer.
const ANSWER_BYTES: usize = 7 * size_of::<f64>();

/// A ball over an object.
#[derive(Debug, Clone, PartialEq)]
pub struct BallScene {
    /// Vertices in the axes of the object, metres.
    pub positions: Vec<DVec3>,
    /// Corners of its faces.
    pub faces: Vec<[u32; 3]>,
    /// Radius of the ball, metres.
    pub radius_m: f64,
    /// Stiffness of the surface, N/m.
    pub stiffness_n_per_m: f64,
    /// Damping of the surface, N s/m.
    pub damping_ns_per_m: f64,
    /// Coefficients of static and dynamic friction; 0 for none.
    pub friction: [f64; 2],
    /// Largest turn between faces over which the force is shaded, radians; 0 for no shading.
    pub shaded_turn: f64,
}

impl BallScene {
    /// As a message to a variant of a peer.
    #[must_use]
    pub fn message(&self, variant: usize) -> Vec<u8> {
        let mut out = Vec::new();
        out.extend(
            [SCENE, variant as u64]
                .into_iter()
                .flat_map(u64::to_le_bytes),
        );
        let [static_, dynamic] = self.friction;
        let surface = [self.radius_m, self.stiffness_n_per_m, self.damping_ns_per_m];
        let effects = [static_, dynamic, self.shaded_turn];
        out.extend(
            surface
                .into_iter()
                .chain(effects)
                .flat_map(f64::to_le_bytes),
        );
        let counts = [self.positions.len(), self.faces.len()];
        out.extend(
            counts
                .iter()
                .flat_map(|&count| (count as u64).to_le_bytes()),
        );
        let positions = self.positions.iter().flat_map(|p| p.to_array());
        out.extend(positions.flat_map(f64::to_le_bytes));
        out.extend(
            self.faces
                .as_flattened()
                .iter()
                .flat_map(|v| v.to_le_bytes()),
        );
        out
    }
}

/// A tick: where object and device are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Pose of the object.
    pub object: Pose,
    /// Position of the device, world, metres.
    pub device: DVec3,
}

impl Step {
    /// Steps as a message.
    #[must_use]
    pub fn message(steps: &[Self]) -> Vec<u8> {
        let count = steps.len() as u64;
        let mut out: Vec<u8> = [STEPS, count]
            .into_iter()
            .flat_map(u64::to_le_bytes)
            .collect();
        for step in steps {
            let at = step.object.position.to_array();
            let turn = step.object.orientation.to_array();
            let device = step.device.to_array();
            let numbers = at.into_iter().chain(turn).chain(device);
            out.extend(numbers.flat_map(f64::to_le_bytes));
        }
        out
    }
}

/// What a peer answers to a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// Force on the device, newtons.
    pub force: DVec3,
    /// Where its proxy is, world, metres.
    pub proxy: DVec3,
    /// What the step took it, nanoseconds.
    pub ns: f64,
}

impl Answer {
    fn read(bytes: &[u8; ANSWER_BYTES]) -> Self {
        let (numbers, _) = bytes.as_chunks::<8>();
        let n = |k: usize| f64::from_le_bytes(numbers[k]);
        Self {
            force: DVec3::new(n(0), n(1), n(2)),
            proxy: DVec3::new(n(3), n(4), n(5)),
            ns: n(6),
        }
    }

    /// Whether force and proxy are numbers.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.force.is_finite() && self.proxy.is_finite()
    }
}

/// A peer's program.
#[derive(Debug, Clone)]
pub struct PeerProgram {
    path: PathBuf,
    /// Names of its variants.
    pub variants: Vec<String>,
}

impl PeerProgram {
    /// Starts it once, to hear what it has.
    ///
    /// # Errors
    /// One sentence when it cannot be run, or is no such program.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        let mut peer = BallPeer::start(path)?;
        let hello = peer.hello()?;
        let names = hello.strip_prefix(HELLO).unwrap_or("").split_whitespace();
        let variants: Vec<String> = names.map(String::from).collect();
        if variants.is_empty() {
            let what = format!(
                "it begins with \"{}\", not with \"{HELLO}NAME\"",
                hello.trim_end()
            );
            return Err(peer.failed(&what));
        }
        Ok(Self {
            path: path.to_path_buf(),
            variants,
        })
    }

    /// A process of it, with a scene for one of its variants.
    ///
    /// # Errors
    /// One sentence when it cannot be run.
    pub fn start(&self, variant: usize, scene: &BallScene) -> Result<BallPeer, Failure> {
        let mut peer = BallPeer::start(&self.path)?;
        peer.hello()?;
        peer.write(&scene.message(variant))?;
        Ok(peer)
    }
}

/// A running peer.
#[derive(Debug)]
pub struct BallPeer {
    path: PathBuf,
    child: Child,
    socket: BufReader<UnixStream>,
    /// Answers so far.
    answers: u64,
}

impl BallPeer {
    fn start(path: &Path) -> Result<Self, Failure> {
        let start = || -> std::io::Result<(Child, UnixStream)> {
            // A socket, not pipes: it has a timeout.
            let (ours, theirs) = UnixStream::pair()?;
            ours.set_read_timeout(Some(TIMEOUT))?;
            ours.set_write_timeout(Some(TIMEOUT))?;
            let output = OwnedFd::from(theirs.try_clone()?);
            let mut command = Command::new(path);
            command.stdin(Stdio::from(OwnedFd::from(theirs)));
            let child = command.stdout(Stdio::from(output)).spawn()?;
            Ok((child, ours))
        };
        let (child, socket) =
            start().map_err(|error| failed(path, &format!("cannot be run ({error})")))?;
        Ok(Self {
            path: path.to_path_buf(),
            child,
            socket: BufReader::new(socket),
            answers: 0,
        })
    }

    fn hello(&mut self) -> Result<String, Failure> {
        let mut line = Vec::new();
        let mut first = (&mut self.socket).take(MAX_HELLO);
        match first.read_until(b'\n', &mut line) {
            Ok(1..) => Ok(String::from_utf8_lossy(&line).into_owned()),
            Err(error) if is_timeout(&error) => Err(self.timeout("said")),
            _ => Err(self.ended()),
        }
    }

    /// Writes a message. Where the peer has ended, its answers tell: what it wrote before is there
    /// to be read.
    fn write(&mut self, message: &[u8]) -> Result<(), Failure> {
        match self.socket.get_mut().write_all(message) {
            Err(error) if is_timeout(&error) => Err(self.timeout("read")),
            _ => Ok(()),
        }
    }

    /// The peer's answers to the next ticks.
    ///
    /// # Errors
    /// One sentence when it ends, says nothing for two minutes, or a time is none; [`Failure::Run`]
    /// where it crashes after an answer.
    pub fn step(&mut self, steps: &[Step]) -> Result<Vec<Answer>, Failure> {
        let mut answers = Vec::with_capacity(steps.len());
        for steps in steps.chunks(MAX_STEPS) {
            self.step_some(steps, &mut answers)?;
        }
        Ok(answers)
    }

    fn step_some(&mut self, steps: &[Step], answers: &mut Vec<Answer>) -> Result<(), Failure> {
        self.write(&Step::message(steps))?;
        for _ in steps {
            let mut bytes = [0; ANSWER_BYTES];
            match self.socket.read_exact(&mut bytes) {
                Ok(()) => {}
                Err(error) if is_timeout(&error) => return Err(self.timeout("answered")),
                Err(_) => return Err(self.ended()),
            }
            self.answers += 1;
            let answer = Answer::read(&bytes);
            if !(answer.ns.is_finite() && answer.ns >= 0.0) {
                return Err(self.failed(&format!("step {} took {} ns", self.answers, answer.ns)));
            }
            answers.push(answer);
        }
        Ok(())
    }

    /// How it ended, though it was still asked. A crash after its first answer is its own affair;
    /// whatever else ends it is no peer.
    fn ended(&mut self) -> Failure {
        // Where it has closed its output alone.
        let _ = self.child.kill();
        let (answers, path) = (self.answers, self.path.display());
        let how = match self.child.wait() {
            Ok(status) if answers > 0 && status.signal().is_some_and(|of| of != KILLED) => {
                return Failure::Run(format!(
                    "{path}: crashed ({status}) after {answers} answers"
                ));
            }
            Ok(status) => status.to_string(),
            Err(error) => error.to_string(),
        };
        self.failed(&format!(
            "ended ({how}) after {answers} answers, though it was asked for more"
        ))
    }

    fn timeout(&self, what: &str) -> Failure {
        let answers = self.answers;
        self.failed(&format!(
            "has {what} nothing in {TIMEOUT:?}, after {answers} answers"
        ))
    }

    fn failed(&self, what: &str) -> Failure {
        failed(&self.path, what)
    }
}

impl Drop for BallPeer {
    fn drop(&mut self) {
        // All that it was asked it has answered, or it is given up.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn is_timeout(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{TimedOut, WouldBlock};
    matches!(error.kind(), TimedOut | WouldBlock)
}

fn failed(path: &Path, what: &str) -> Failure {
    Failure::Input(format!(
        "{}: {what}; build it as rt-tests/peers/README.md says",
        path.display()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the peer of a test may take to read or answer at all.
    const PATIENCE: Duration = Duration::from_secs(20);

    /// A peer that answers each step before it reads the next: more steps in a message than their
    /// answers find room in the socket, and both would wait for ever.
    #[test]
    fn a_peer_that_answers_step_by_step_is_asked_any_number_of_steps() {
        const COUNT: usize = 10_000;
        let (ours, mut theirs) = UnixStream::pair().unwrap();
        ours.set_read_timeout(Some(PATIENCE)).unwrap();
        ours.set_write_timeout(Some(PATIENCE)).unwrap();
        let numbers = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let answer: Vec<u8> = numbers.into_iter().flat_map(f64::to_le_bytes).collect();
        let answers = std::thread::spawn(move || -> std::io::Result<()> {
            let (mut head, mut step) = ([0; 16], [0; 10 * size_of::<f64>()]);
            loop {
                theirs.read_exact(&mut head)?;
                for _ in 0..u64::from_le_bytes(*head.last_chunk().unwrap()) {
                    theirs.read_exact(&mut step)?;
                    theirs.write_all(&answer)?;
                }
            }
        });
        let mut peer = BallPeer {
            path: PathBuf::from("step by step"),
            child: Command::new("true").spawn().unwrap(),
            socket: BufReader::new(ours),
            answers: 0,
        };
        let step = Step {
            object: Pose::at(DVec3::ZERO),
            device: DVec3::ZERO,
        };
        let steps = vec![step; COUNT];
        let found = peer.step(&steps).unwrap();
        assert_eq!(found.len(), COUNT);
        assert!(found.iter().all(|of| of.is_finite() && of.ns == 1.0));
        drop(peer);
        // It ended as there was nothing more to read.
        let ended = answers.join().unwrap().unwrap_err();
        assert_eq!(ended.kind(), std::io::ErrorKind::UnexpectedEof);
    }
}
