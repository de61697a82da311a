//! The domain of one run: nobody else has it, and its files go with it.
//!
//! A command that is killed leaves them. So every process of a run holds a lock on the domain's
//! root folder, which ends with the process however that ends, and the next run removes what nobody
//! holds any more.

use realtime::rights::monotonic_ns;
use std::fs::{File, symlink_metadata};
use std::io;
use std::ops::Deref;
use std::os::unix::fs::MetadataExt;
use transport::{Domain, TransportError};

/// How the names of these domains begin.
const NAME_BEGINS: &str = "run-";
/// Tries for a root folder that another process takes for left and removes.
const TRIES: usize = 8;

/// A domain of one run.
#[derive(Debug)]
pub struct OwnDomain {
    domain: Domain,
    _hold: Hold,
}

/// Keeps the files of a domain as long as it lives.
#[derive(Debug)]
pub struct Hold(#[expect(dead_code, reason = "the lock lasts as long as the file is open")] File);

impl OwnDomain {
    /// A new domain; removes the files of those whose processes have all ended.
    ///
    /// # Errors
    /// When its root folder cannot be made.
    pub fn new() -> Result<Self, TransportError> {
        remove_left();
        let domain = Domain::new(&unique_name())?;
        let hold = Hold::on(&domain)?;
        Ok(Self {
            domain,
            _hold: hold,
        })
    }
}

impl Deref for OwnDomain {
    type Target = Domain;

    fn deref(&self) -> &Domain {
        &self.domain
    }
}

impl Drop for OwnDomain {
    fn drop(&mut self) {
        self.domain.remove_files();
    }
}

impl Hold {
    /// Holds a domain, whose root folder is made if it is not there.
    ///
    /// # Errors
    /// When it cannot be made, or locked.
    pub fn on(domain: &Domain) -> Result<Self, TransportError> {
        let root = domain.root();
        let lock = || -> io::Result<Option<File>> {
            let folder = File::open(&root)?;
            folder.lock_shared()?;
            // It may have been removed before it was locked.
            let there = symlink_metadata(&root)?;
            Ok((there.ino() == folder.metadata()?.ino()).then_some(folder))
        };
        let mut reason = String::from("it is removed again and again");
        for _ in 0..TRIES {
            domain.take_root()?;
            match lock() {
                Ok(Some(folder)) => return Ok(Self(folder)),
                Ok(None) => {}
                Err(error) => reason = error.to_string(),
            }
        }
        Err(domain.error("hold the root folder", reason))
    }
}

/// Removes the files of all runs of this user that no process holds.
fn remove_left() {
    let all = Domain::all_of_user().into_iter();
    for domain in all.filter(|domain| domain.name().starts_with(NAME_BEGINS)) {
        // Held while its files go, so that nobody begins to use them.
        let Ok(folder) = File::open(domain.root()) else {
            continue;
        };
        if folder.try_lock().is_ok() {
            domain.remove_files();
        }
    }
}

/// A name for a domain that no other run of this machine has.
fn unique_name() -> String {
    // 20 bits of the clock tell runs apart whose process ids were given again.
    let time = (monotonic_ns() >> 20) & 0xF_FFFF;
    format!("{NAME_BEGINS}{}-{time:x}", std::process::id())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;
    use std::process::Command;

    /// A domain as iceoryx2 leaves it: a root folder with something in it, and shared memory.
    fn files_of(domain: &Domain) -> [PathBuf; 2] {
        domain.take_root().unwrap();
        let files = [
            domain.root().join("left"),
            PathBuf::from(format!("/dev/shm/{}left", domain.prefix())),
        ];
        for file in &files {
            std::fs::write(file, "left").unwrap();
        }
        files
    }

    fn named(name: &str) -> Domain {
        Domain::new(&format!("{name}-{}", std::process::id())).unwrap()
    }

    #[test]
    fn the_next_run_removes_what_a_killed_one_left_and_nothing_that_is_held() {
        let living = OwnDomain::new().unwrap();
        let held = files_of(&living);
        let other = named("lab");
        let others = files_of(&other);
        let dead = named("run-1");
        let left = files_of(&dead);
        drop(Hold::on(&dead).unwrap());
        let next = OwnDomain::new().unwrap();
        assert!(next.root().exists());
        assert!(held.iter().chain(&others).all(|file| file.exists()));
        assert!(!left.iter().any(|file| file.exists()) && !dead.root().exists());
        drop(living);
        assert!(!held.iter().any(|file| file.exists()));
        other.remove_files();
    }

    #[test]
    fn a_process_that_is_killed_lets_go_of_its_domain() {
        let domain = named("run-2");
        let left = files_of(&domain);
        let mut child = Command::new("flock")
            .args(["--no-fork", "--shared"])
            .arg(domain.root())
            .args(["sleep", "600"])
            .spawn()
            .unwrap();
        // It holds the lock when nobody else can have all of it.
        let folder = File::open(domain.root()).unwrap();
        while folder.try_lock().is_ok() {
            folder.unlock().unwrap();
            std::thread::yield_now();
        }
        drop(OwnDomain::new().unwrap());
        assert!(left.iter().all(|file| file.exists()));
        child.kill().unwrap();
        child.wait().unwrap();
        drop(OwnDomain::new().unwrap());
        assert!(!left.iter().any(|file| file.exists()));
    }
}
