//! The surroundings of a process: its core, its environment, and what is taken from it on purpose.

use std::ffi::{CString, OsString};
use std::io;

/// Numbers of `linux/capability.h`: of a process that may lock memory, raise priorities, and raise
/// its own limits.
const CAP_IPC_LOCK: libc::c_ulong = 14;
const CAP_SYS_NICE: libc::c_ulong = 23;
const CAP_SYS_RESOURCE: libc::c_ulong = 24;

/// A file system in memory that only the process itself sees; it goes with the process.
#[derive(Debug, Clone)]
pub struct SmallDisk {
    /// An empty folder.
    pub folder: CString,
    /// Options of tmpfs, such as `size=1m`.
    pub options: CString,
}

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

    /// Mounts the small disk where the calling process alone sees it, if one is asked for.
    ///
    /// # Errors
    /// When the system refuses: the right CAP_SYS_ADMIN is missing.
    pub(super) fn mount_small_disk(&self) -> io::Result<()> {
        let Some(disk) = &self.small_disk else {
            return Ok(());
        };
        let kind = c"tmpfs".as_ptr();
        let private = libc::MS_REC | libc::MS_PRIVATE;
        let (root, none) = (c"/".as_ptr(), std::ptr::null());
        // SAFETY: every pointer is to a string that ends with 0 and outlives the call, or null
        // where mount takes none; the tests of the results keep the order.
        let is_mounted = unsafe {
            libc::unshare(libc::CLONE_NEWNS) == 0
                && libc::mount(none, root, none, private, std::ptr::null()) == 0
                && libc::mount(
                    kind,
                    disk.folder.as_ptr(),
                    kind,
                    0,
                    disk.options.as_ptr().cast(),
                ) == 0
        };
        if is_mounted {
            Ok(())
        } else {
            Err(io::Error::last_os_error())
        }
    }
}
