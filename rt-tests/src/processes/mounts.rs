//! Folders in memory that only some processes see.

use std::ffi::CString;
use std::io;

/// A file system in memory over a folder; it goes with the last process that sees it.
#[derive(Debug, Clone)]
pub struct SmallDisk {
    /// The folder.
    pub folder: CString,
    /// Options of tmpfs, such as `size=1m`.
    pub options: CString,
}

/// Gives the calling thread mounts of its own, which nobody else sees from now on, and what `more`
/// names (flags of `unshare`). Allocates nothing.
///
/// # Errors
/// When the system refuses: the right CAP_SYS_ADMIN is missing.
pub(super) fn unshare_mounts(more: libc::c_int) -> io::Result<()> {
    let private = libc::MS_REC | libc::MS_PRIVATE;
    let (root, none) = (c"/".as_ptr(), std::ptr::null());
    // SAFETY: every pointer is to a string that ends with 0 and outlives the call, or null where
    // mount takes none.
    let is_done = unsafe {
        libc::unshare(libc::CLONE_NEWNS | more) == 0
            && libc::mount(none, root, none, private, std::ptr::null()) == 0
    };
    done(is_done)
}

/// Mounts a disk where the calling thread sees it. Allocates nothing.
///
/// # Errors
/// When the system refuses: the right CAP_SYS_ADMIN is missing.
pub(super) fn mount_in_memory(disk: &SmallDisk) -> io::Result<()> {
    let kind = c"tmpfs".as_ptr();
    let (folder, options) = (disk.folder.as_ptr(), disk.options.as_ptr());
    // SAFETY: every pointer is to a string that ends with 0 and outlives the call.
    done(unsafe { libc::mount(kind, folder, kind, 0, options.cast()) } == 0)
}

fn done(is_done: bool) -> io::Result<()> {
    if is_done {
        Ok(())
    } else {
        Err(io::Error::last_os_error())
    }
}
