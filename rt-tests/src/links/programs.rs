//! The two programs as a user starts them, and what two hosts on one machine need.

use crate::failure::Failure;
use crate::processes::host::{Host, TUN};
use crate::processes::rights::{NET_ADMIN, SYS_ADMIN};
use std::fs::File;
use std::io::ErrorKind;
use std::net::Ipv4Addr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// How to get both programs with the link.
const BUILD: &str = "cargo build --release -p rt-tests -p ve-station -p hrtc --features ve-station/tunnel,hrtc/tunnel";

/// Days for which keys are valid.
const KEYS_DAYS: u32 = 2;

/// `ve-station` and `hrtc`, beside this program.
#[derive(Debug, Clone)]
pub struct Programs {
    /// The station's.
    pub station: PathBuf,
    /// The controller's.
    pub controller: PathBuf,
}

impl Programs {
    /// Finds them.
    ///
    /// # Errors
    /// One sentence that says how to build one that is missing, or is built without the link.
    pub fn find() -> Result<Self, Failure> {
        let own = std::env::current_exe();
        let own = own.map_err(|error| Failure::Run(format!("where is this program? ({error})")))?;
        let folder = own.parent().unwrap_or(Path::new("."));
        let find = |name: &str| {
            let program = folder.join(name);
            let said = |what: &str| {
                Failure::Input(format!("{} {what}; build it: {BUILD}", program.display()))
            };
            // The process of a link is a subcommand.
            let answer = output(Command::new(&program).args(["tunnel", "--help"]));
            let answer = answer.map_err(|error| said(&format!("cannot be run ({error})")))?;
            if answer.status.success() {
                Ok(program)
            } else {
                Err(said("is built without the link to other machines"))
            }
        };
        Ok(Self {
            station: find("ve-station")?,
            controller: find("hrtc")?,
        })
    }

    /// Makes keys for a link to a station of this address; they outlast every command.
    ///
    /// # Errors
    /// What it said.
    pub fn make_keys(&self, folder: &Path, address: &str) -> Result<(), Failure> {
        self.make_keys_for(folder, address, KEYS_DAYS)
    }

    /// The same, valid for so many days.
    ///
    /// # Errors
    /// What it said.
    pub fn make_keys_for(&self, folder: &Path, address: &str, days: u32) -> Result<(), Failure> {
        let mut command = Command::new(&self.station);
        command.arg("keys").arg(folder).args(["--host", address]);
        command.arg(format!("--days={days}"));
        let wrong = |why: &str| Failure::Run(format!("no keys could be made ({})", why.trim()));
        let answer = output(&mut command).map_err(|error| wrong(&error.to_string()))?;
        if answer.status.success() {
            Ok(())
        } else {
            Err(wrong(&String::from_utf8_lossy(&answer.stderr)))
        }
    }
}

fn output(command: &mut Command) -> std::io::Result<Output> {
    command.stdin(Stdio::null()).output()
}

/// Why this process cannot make a host of an address, and what helps.
#[must_use]
pub fn missing_right(address: Ipv4Addr) -> Option<String> {
    const HOW: &str = "run it as root (sudo), or as root of namespaces of its own: unshare --user --map-root-user --net --mount";
    for (right, what) in [(SYS_ADMIN, "shared memory"), (NET_ADMIN, "networks")] {
        if !right.is_held() {
            let name = right.name;
            return Some(format!(
                "two hosts need {what} of their own, which takes the right {name}: {HOW}"
            ));
        }
    }
    let opened = File::options().read(true).write(true).open(TUN);
    if let Err(error) = opened {
        let how = match error.kind() {
            ErrorKind::PermissionDenied => {
                format!("sudo chmod a+rw {TUN}, as most systems have it")
            }
            _ => format!("sudo modprobe tun; start a container with --device {TUN}"),
        };
        return Some(format!("two hosts need a cable, {TUN} ({error}): {how}"));
    }
    // A container may refuse them whatever its rights.
    let folder = tempfile::tempdir().ok()?;
    let refused = Host::new(address, folder.path()).err()?;
    Some(format!(
        "two hosts cannot be made, {refused}: run it outside of this container"
    ))
}
