//! The process of a tunnel without the program that would start it.

use crate::processes::stop::is_set;
use crate::processes::watched::{PATIENCE, pause};
use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use transport::Domain;
use tunnel::SUBCOMMAND;

/// Time between two looks, seconds.
const LOOK_S: f64 = 0.01;

/// The process; it ends when this does.
pub struct Alone {
    child: Child,
    lines: Receiver<String>,
    said: Vec<String>,
}

impl Alone {
    /// Starts it in a domain.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn start(program: &Path, domain: &Domain, typed: &[OsString]) -> Result<Self, String> {
        let mut child = Command::new(program)
            .args([SUBCOMMAND, "--domain", domain.name()])
            .args(typed)
            // It ends when its input does.
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|error| format!("a tunnel cannot be started ({error})"))?;
        let (sender, lines) = channel();
        if let Some(out) = child.stdout.take() {
            // It reads until the process ends.
            std::thread::spawn(move || {
                for line in BufReader::new(out).lines().map_while(Result::ok) {
                    if sender.send(line).is_err() {
                        return;
                    }
                }
            });
        }
        let said = Vec::new();
        Ok(Self { child, lines, said })
    }

    /// Waits until it has said this.
    ///
    /// # Errors
    /// What it said instead.
    pub fn wait_for(&mut self, words: &str, stop: &AtomicBool) -> Result<(), String> {
        let start = Instant::now();
        loop {
            self.said.extend(self.lines.try_iter());
            if self.said.iter().any(|line| line.contains(words)) {
                return Ok(());
            }
            if is_set(stop) {
                return Err("ended early on request".to_string());
            }
            if start.elapsed() > PATIENCE {
                let said = self.said.join("; ");
                return Err(format!("the tunnel never said \"{words}\": {said}"));
            }
            pause(LOOK_S, stop);
        }
    }
}

impl Drop for Alone {
    fn drop(&mut self) {
        self.child.stdin = None;
        let asked = Instant::now();
        while matches!(self.child.try_wait(), Ok(None)) && asked.elapsed() < PATIENCE {
            std::thread::sleep(Duration::from_secs_f64(LOOK_S));
        }
        // One that is blocked is ended by force; it is nothing to one that has ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
