//! The surroundings of a process: its core, its environment, and what is taken from it on purpose.

use super::host::Host;
use super::mounts::{SmallDisk, mount_in_memory, unshare_mounts};
use std::ffi::OsString;
use std::io;
use std::sync::Arc;

/// Numbers of `linux/capability.h`: of a process that may lock memory, raise priorities, and raise
/// its own limits.
const CAP_IPC_LOCK: libc::c_ulong = 14;
const CAP_SYS_NICE: libc::c_ulong = 23;
const CAP_SYS_RESOURCE: libc::c_ulong = 24;

/// Surroundings of a process; by default those of its parent.
#[derive(Debug, Clone, Default)]
pub struct Surroundings {
    /// The one core that it may use.
    pub core: Option<usize>,
    /// Variables of its environment beside the parent's.
    pub variables: Vec<(&'static str, OsString)>,
    /// Whether it may neither lock memory nor use real-time priorities, whoever the user is.
    pub without_rights: bool,
    /// A small file system of its own; needs CAP_SYS_ADMIN.
    pub small_disk: Option<SmallDisk>,
    /// The host on which it runs, if not on this one; needs CAP_SYS_ADMIN.
    pub host: Option<Arc<Host>>,
}

impl Surroundings {
    /// Takes the real-time rights of the calling process for good, if that is asked for.
    ///
    /// # Errors
    /// When the system refuses.
    pub(super) fn take_rights(&self) -> io::Result<()> {
        if !self.without_rights {
            return Ok(());
        }
        let none = libc::rlimit {
            rlim_cur: 0,
            rlim_max: 0,
        };
        for limit in [libc::RLIMIT_RTPRIO, libc::RLIMIT_MEMLOCK] {
            // SAFETY: setrlimit reads the structure, which lives on this stack.
            if unsafe { libc::setrlimit(limit, &raw const none) } != 0 {
                return Err(io::Error::last_os_error());
            }
        }
        for capability in [CAP_IPC_LOCK, CAP_SYS_NICE, CAP_SYS_RESOURCE] {
            // SAFETY: prctl takes plain numbers here. A user other than root has no capability to
            // drop, so its refusal changes nothing.
            unsafe { libc::prctl(libc::PR_CAPBSET_DROP, capability, 0, 0, 0) };
        }
        Ok(())
    }

    /// Moves the calling process to its host, if one is asked for.
    ///
    /// # Errors
    /// When the system refuses: the right CAP_SYS_ADMIN is missing.
    pub(super) fn enter_host(&self) -> io::Result<()> {
        self.host.as_ref().map_or(Ok(()), |host| host.enter())
    }

    /// Mounts the small disk where the calling process alone sees it, if one is asked for.
    ///
    /// # Errors
    /// When the system refuses: the right CAP_SYS_ADMIN is missing.
    pub(super) fn mount_small_disk(&self) -> io::Result<()> {
        let Some(disk) = &self.small_disk else {
            return Ok(());
        };
        unshare_mounts(0)?;
        mount_in_memory(disk)
    }
}
