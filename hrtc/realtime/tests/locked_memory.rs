//! What locked memory gives to a loop, and what a limit of it may not cost: an allocation that the
//! system refuses aborts a program. A program of its own, without threads.

use realtime::rights::{keep_heap_small, lock_memory, thread_usage};
use std::hint::black_box;
use std::io::Write;

const MIB: usize = 1 << 20;
/// Addresses that are left of the limit.
const LEFT: usize = MIB;
/// Far more than that.
const LATE: usize = 16 * MIB;
/// Faults of pages that the kernel has moved meanwhile, at the most; of those that are not there,
/// there are 256 in a MiB.
const FEW: u64 = 16;

/// The capability that lifts the limit (`linux/capability.h`).
const CAP_IPC_LOCK: u32 = 14;
/// Version of the structs of capget(2).
const CAPABILITY_VERSION_3: u32 = 0x2008_0522;

#[repr(C)]
struct Header {
    version: u32,
    thread: i32,
}

#[repr(C)]
#[derive(Clone, Copy, Default)]
struct Capabilities {
    effective: u32,
    permitted: u32,
    inheritable: u32,
}

fn main() {
    keep_heap_small();
    what_is_there_is_resident_and_what_comes_later_is_not();
    beyond_a_limit_memory_is_given_all_the_same();
}

fn say(sentence: &str) {
    let _ = writeln!(std::io::stderr(), "{sentence}");
}

/// A value of `/proc/self/status`, bytes.
fn status(name: &str) -> usize {
    let text = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix(name));
    let kib = line.unwrap().split_whitespace().nth(1).unwrap();
    kib.parse::<usize>().unwrap() * 1024
}

/// Page faults of writing to every page of room that nothing has touched yet.
fn faults_of_touching(room: &mut Vec<u8>) -> u64 {
    let before = thread_usage().page_faults;
    room.resize(room.capacity(), 1);
    black_box(&room);
    thread_usage().page_faults - before
}

fn what_is_there_is_resident_and_what_comes_later_is_not() {
    let mut room = Vec::with_capacity(MIB);
    black_box(room.as_ptr());
    if let Err(missing) = lock_memory() {
        say(&format!("skipped: {missing}"));
        return;
    }
    let faults = faults_of_touching(&mut room);
    assert!(faults < FEW, "{faults} page faults");
    let before = status("VmRSS");
    let late: Vec<u8> = Vec::with_capacity(LATE);
    black_box(late.as_ptr());
    let grown = status("VmRSS").saturating_sub(before);
    assert!(grown < LATE / 4, "{grown} bytes of room are resident");
    unlock();
}

fn beyond_a_limit_memory_is_given_all_the_same() {
    drop_the_capability();
    let left = LEFT as u64;
    let mut limit = libc::rlimit {
        rlim_cur: 0,
        rlim_max: 0,
    };
    // SAFETY: the struct lives through the call.
    assert_eq!(
        unsafe { libc::getrlimit(libc::RLIMIT_MEMLOCK, &raw mut limit) },
        0
    );
    limit.rlim_cur = status("VmSize") as u64 + left;
    if limit.rlim_cur > limit.rlim_max {
        say("skipped: the limit of locked memory cannot be raised so far");
        return;
    }
    // SAFETY: the struct lives through the call.
    assert_eq!(
        unsafe { libc::setrlimit(libc::RLIMIT_MEMLOCK, &raw const limit) },
        0
    );
    lock_memory().unwrap();
    let mut late: Vec<u8> = Vec::new();
    assert!(late.try_reserve_exact(LATE).is_ok(), "memory is refused");
    // Small ones are of the heap.
    let mut small: Vec<Vec<u8>> = Vec::new();
    small.try_reserve_exact(1024).unwrap();
    for _ in 0..small.capacity() {
        let mut one = Vec::new();
        assert!(one.try_reserve_exact(16 << 10).is_ok(), "heap is refused");
        small.push(one);
    }
    let thread = std::thread::Builder::new().spawn(|| ());
    thread.expect("it has a stack").join().unwrap();
    unlock();
}

fn unlock() {
    // SAFETY: takes no pointers.
    assert_eq!(unsafe { libc::munlockall() }, 0);
}

/// What holds for a user holds for root then.
fn drop_the_capability() {
    let mut header = Header {
        version: CAPABILITY_VERSION_3,
        thread: 0,
    };
    let mut both = [Capabilities::default(); 2];
    // SAFETY: version 3 reads a header and writes two structs (capget(2)), which live through the
    // call; 0 is the calling thread.
    let got = unsafe { libc::syscall(libc::SYS_capget, &raw mut header, both.as_mut_ptr()) };
    assert_eq!(got, 0);
    both[0].effective &= !(1 << CAP_IPC_LOCK);
    // SAFETY: as above, but that it reads both.
    let set = unsafe { libc::syscall(libc::SYS_capset, &raw mut header, both.as_ptr()) };
    assert_eq!(set, 0);
}
