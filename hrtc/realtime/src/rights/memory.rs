//! The memory of a process with a real-time thread: resident before it is used.

use super::{MissingRight, Right};
use std::io;

/// Makes all memory resident that the process has now, and keeps it so: whole stacks, tables that
/// nothing has touched yet, the program. What a real-time thread uses is to be there before. Memory
/// that comes later is kept as it is touched, but only where the system sets no limit: where it
/// does, memory beyond the limit would be refused, and a program that is refused memory aborts.
///
/// # Errors
/// When the limit of locked memory is too low for what is there now. From Linux 5.14 on it is made
/// resident then all the same, but the system may take it away.
pub fn lock_memory() -> Result<(), MissingRight> {
    // SAFETY: takes no pointers.
    if unsafe { libc::mlockall(libc::MCL_CURRENT) } != 0 {
        let error = io::Error::last_os_error();
        populate_memory();
        return Err(MissingRight {
            right: Right::LockedMemory,
            error: refused_memory(error, memory_limit(), address_bytes()),
        });
    }
    if locks_without_limit() {
        // Without MCL_CURRENT what is there stays as it is. A kernel before 4.4 refuses, and keeps
        // what is there now all the same.
        // SAFETY: takes no pointers.
        unsafe { libc::mlockall(libc::MCL_FUTURE | libc::MCL_ONFAULT) };
    }
    Ok(())
}

/// Makes the memory resident that this process has now, as [`lock_memory`] would: a table that
/// nothing has touched yet, or a part of the program, would fault in the tick. A kernel before 5.14
/// refuses.
fn populate_memory() {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap_or_default();
    for (begin, length, advice) in maps.lines().filter_map(range_to_populate) {
        let begin = std::ptr::with_exposed_provenance_mut(begin);
        // SAFETY: no byte changes. What another thread has unmapped meanwhile is refused.
        unsafe { libc::madvise(begin, length, advice) };
    }
}

/// Begin and length of a range that may be read, and the advice that populates it, by its line in
/// `/proc/self/maps` (proc(5)): private memory that may be written is to have pages of its own.
fn range_to_populate(line: &str) -> Option<(usize, usize, i32)> {
    let mut fields = line.split_ascii_whitespace();
    let (begin, end) = fields.next()?.split_once('-')?;
    let (begin, end) = (
        usize::from_str_radix(begin, 16).ok()?,
        usize::from_str_radix(end, 16).ok()?,
    );
    let advice = match fields.next()? {
        rights if rights.starts_with("rw-p") => libc::MADV_POPULATE_WRITE,
        rights if rights.starts_with('r') => libc::MADV_POPULATE_READ,
        _ => return None,
    };
    Some((begin, end.checked_sub(begin)?, advice))
}

/// The limit of locked memory, bytes; `None` where there is none, or it is not known.
fn memory_limit() -> Option<u64> {
    let mut limit = libc::rlimit {
        rlim_cur: 0,
        rlim_max: 0,
    };
    // SAFETY: the struct lives through the call.
    let code = unsafe { libc::getrlimit(libc::RLIMIT_MEMLOCK, &raw mut limit) };
    (code == 0 && limit.rlim_cur != libc::RLIM_INFINITY).then_some(limit.rlim_cur)
}

/// Bytes of addresses that this process has, all of which count where all is locked; 0 where the
/// kernel does not say.
fn address_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmSize:"));
    let kib = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}

/// The error of the kernel in words, where the limit is what is too low: it says that memory cannot
/// be allocated.
fn refused_memory(error: io::Error, limit: Option<u64>, needed: u64) -> io::Error {
    match limit {
        Some(limit) if limit < needed => io::Error::other(format!(
            "the limit RLIMIT_MEMLOCK (ulimit -l) is {} KiB, and {} KiB are needed",
            limit / 1024,
            needed.div_ceil(1024)
        )),
        _ => error,
    }
}

/// Whether no limit of locked memory holds for this process. The kernel is asked, with addresses
/// beyond the limit: in a container a process may have a capability in name only.
fn locks_without_limit() -> bool {
    let mut limit = libc::rlimit {
        rlim_cur: 0,
        rlim_max: 0,
    };
    // SAFETY: the struct lives through the call.
    if unsafe { libc::getrlimit(libc::RLIMIT_MEMLOCK, &raw mut limit) } != 0 {
        return false;
    }
    if limit.rlim_cur == libc::RLIM_INFINITY {
        return true;
    }
    let beyond = usize::try_from(limit.rlim_cur).ok();
    let Some(beyond) = beyond.and_then(|limit| limit.checked_add(1 << 16)) else {
        return false;
    };
    let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_NORESERVE;
    // SAFETY: a mapping of its own, which nothing else knows; it is gone before the end, and none
    // of its pages is ever there.
    unsafe {
        let nowhere = std::ptr::null_mut();
        let addresses = libc::mmap(nowhere, beyond, libc::PROT_READ, flags, -1, 0);
        if addresses == libc::MAP_FAILED {
            return false;
        }
        let code = libc::mlock2(addresses, beyond, libc::MLOCK_ONFAULT);
        libc::munmap(addresses, beyond);
        code == 0
    }
}

/// Keeps the allocator's memory small, for the whole process, since [`lock_memory`] makes all of it
/// resident: large memory goes back to the system as soon as it is freed, and threads share one
/// heap. Each would otherwise reserve 64 MiB of addresses, which count as locked where the system
/// limits that. Before the first thread starts: one that has a heap of its own keeps it.
pub fn keep_heap_small() {
    // Other libraries of C do so by themselves.
    #[cfg(target_env = "gnu")]
    // SAFETY: takes no pointers.
    unsafe {
        // Its own first value: setting it keeps it from growing.
        libc::mallopt(libc::M_MMAP_THRESHOLD, 128 * 1024);
        libc::mallopt(libc::M_ARENA_MAX, 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rights::thread_usage;
    use std::io::Write;

    #[test]
    fn memory_that_is_not_locked_says_which_limit_and_how_much_is_needed() {
        let refused = || io::Error::from_raw_os_error(libc::ENOMEM);
        let missing = MissingRight {
            right: Right::LockedMemory,
            error: refused_memory(refused(), Some(8 << 20), (40 << 20) + 1),
        };
        let sentence = missing.to_string();
        assert!(
            sentence.contains("RLIMIT_MEMLOCK (ulimit -l) is 8192 KiB, and 40961 KiB are needed"),
            "{sentence}"
        );
        // For another reason, the kernel's word.
        for limit in [None, Some(64 << 20)] {
            let error = refused_memory(refused(), limit, 40 << 20);
            assert_eq!(error.raw_os_error(), Some(libc::ENOMEM));
        }
        assert!(address_bytes() > 1 << 20);
    }

    #[test]
    fn memory_to_populate_is_read_from_its_line() {
        let of = |rights: &str| range_to_populate(&format!("7f00-9f00 {rights} 00000000 00:00 0 "));
        let found = |advice| Some((0x7f00, 0x2000, advice));
        assert_eq!(of("rw-p"), found(libc::MADV_POPULATE_WRITE));
        for rights in ["r--p", "rw-s", "r-xp"] {
            assert_eq!(of(rights), found(libc::MADV_POPULATE_READ), "{rights}");
        }
        assert_eq!(of("---p"), None);
        for line in ["", "7f00", "7f00-", "9f00-7f00 rw-p", "x-y rw-p"] {
            assert_eq!(range_to_populate(line), None, "{line}");
        }
    }

    /// A table that nothing has touched is to be there before the ticks also without locked memory.
    #[test]
    fn memory_that_is_populated_does_not_fault() {
        // SAFETY: no byte is advised on; only the advice itself is checked.
        let is_known = unsafe { libc::madvise(std::ptr::null_mut(), 0, libc::MADV_POPULATE_WRITE) };
        if is_known != 0 {
            let _ = writeln!(std::io::stderr(), "skipped: a kernel before 5.14");
            return;
        }
        let mut table: Vec<u8> = Vec::with_capacity(8 << 20);
        populate_memory();
        let before = thread_usage().page_faults;
        table.resize(8 << 20, 1);
        std::hint::black_box(&table);
        let faults = thread_usage().page_faults - before;
        assert!(faults < 64, "{faults}");
    }
}
