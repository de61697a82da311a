//! The rights, clocks and counters of a real-time thread on Linux.
//!
//! Each right is asked for separately. A refused one is returned as a [`MissingRight`], whose
//! message names the remedy. The caller reports it, or ends where real time is required.

mod memory;

pub use memory::{keep_heap_small, lock_memory};

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::marker::PhantomData;
use std::os::fd::AsRawFd;
use thiserror::Error;

/// A right of a real-time thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Right {
    /// SCHED_FIFO with this priority.
    Fifo(i32),
    /// The memory of the process kept resident: see [`lock_memory`].
    LockedMemory,
    /// The thread on this core only.
    Core(usize),
    /// The processor kept out of deep sleep.
    Latency,
    /// Precedence of a helping thread among those without real-time priority: its nice value.
    Nice(i32),
}

/// A right that was refused.
#[derive(Debug, Error)]
#[error("{}: {error}; {}", .right.what(), .right.how())]
pub struct MissingRight {
    /// The right.
    pub right: Right,
    /// Error of the kernel.
    pub error: io::Error,
}

impl Right {
    /// Name for a list of rights.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Fifo(priority) => format!("SCHED_FIFO {priority}"),
            Self::LockedMemory => "locked memory".to_owned(),
            Self::Core(core) => format!("pinned to core {core}"),
            Self::Latency => "no deep sleep (cpu_dma_latency)".to_owned(),
            Self::Nice(value) => format!("recorder at nice {value}"),
        }
    }

    /// Consequence of its absence.
    #[must_use]
    pub fn what(self) -> String {
        match self {
            Self::Fifo(priority) => format!("no real-time priority (SCHED_FIFO {priority})"),
            Self::LockedMemory => "memory is not locked".to_owned(),
            Self::Core(core) => format!("the thread is not pinned to core {core}"),
            Self::Latency => "the processor may sleep deeply (/dev/cpu_dma_latency)".to_owned(),
            Self::Nice(value) => format!(
                "the recorder has no precedence (nice {value}), so it falls behind on a busy machine"
            ),
        }
    }

    /// Remedy.
    #[must_use]
    pub fn how(self) -> String {
        match self {
            Self::Fifo(_) => "put \"@realtime - rtprio 99\" into /etc/security/limits.d/realtime.conf, join the group realtime and log in again".to_owned(),
            Self::LockedMemory => "put \"@realtime - memlock unlimited\" into /etc/security/limits.d/realtime.conf, join the group realtime and log in again".to_owned(),
            Self::Core(_) => "name a core that this machine has and this process may use (see taskset -p $$)".to_owned(),
            Self::Latency => "let a udev rule give the group realtime write access: KERNEL==\"cpu_dma_latency\", GROUP=\"realtime\", MODE=\"0660\"".to_owned(),
            Self::Nice(value) => format!("put \"@realtime - nice {value}\" into /etc/security/limits.d/realtime.conf, join the group realtime and log in again"),
        }
    }

    /// Whether the loop itself needs it; the others are of threads that help.
    #[must_use]
    pub fn is_of_loop(self) -> bool {
        !matches!(self, Self::Nice(_))
    }

    fn refused(self) -> MissingRight {
        MissingRight {
            right: self,
            error: io::Error::last_os_error(),
        }
    }
}

/// Gives the calling thread SCHED_FIFO with a priority of 1 to 99.
///
/// # Errors
/// When the kernel refuses.
pub fn set_fifo(priority: i32) -> Result<(), MissingRight> {
    let parameters = libc::sched_param {
        sched_priority: priority,
    };
    // SAFETY: the struct lives through the call; 0 is the calling thread.
    let code = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameters) };
    if code == 0 {
        Ok(())
    } else {
        Err(Right::Fifo(priority).refused())
    }
}

/// Gives the calling thread, and those that it starts later, a nice value of -20 to 19.
///
/// # Errors
/// When the kernel refuses.
pub fn set_nice(value: i32) -> Result<(), MissingRight> {
    // SAFETY: takes no pointers; on Linux 0 is the calling thread, not its process.
    let code = unsafe { libc::setpriority(libc::PRIO_PROCESS, 0, value) };
    if code == 0 {
        Ok(())
    } else {
        Err(Right::Nice(value).refused())
    }
}

/// A nice value of the calling thread as long as it lives; then that of before returns.
#[derive(Debug)]
pub struct NiceHold {
    before: i32,
    /// Not for another thread, whose value it would set.
    _of_thread: PhantomData<*const ()>,
}

/// Gives the calling thread, and those that it starts meanwhile, a nice value of -20 to 19.
///
/// # Errors
/// When the kernel refuses.
pub fn hold_nice(value: i32) -> Result<NiceHold, MissingRight> {
    // SAFETY: takes no pointers; on Linux 0 is the calling thread, not its process.
    let before = unsafe { libc::getpriority(libc::PRIO_PROCESS, 0) };
    set_nice(value).map(|()| NiceHold {
        before,
        _of_thread: PhantomData,
    })
}

impl Drop for NiceHold {
    fn drop(&mut self) {
        let _ = set_nice(self.before);
    }
}

/// Puts the calling thread on one core.
///
/// # Errors
/// When there is no such core, or the process may not use it.
pub fn pin_to_core(core: usize) -> Result<(), MissingRight> {
    if core >= libc::CPU_SETSIZE as usize {
        return Err(MissingRight {
            right: Right::Core(core),
            error: io::Error::from_raw_os_error(libc::EINVAL),
        });
    }
    // SAFETY: all zeros is the empty set; the index is below CPU_SETSIZE.
    let set = unsafe {
        let mut set: libc::cpu_set_t = std::mem::zeroed();
        libc::CPU_SET(core, &mut set);
        set
    };
    // SAFETY: the set lives through the call and its size is given; 0 is the calling thread.
    let code = unsafe { libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &raw const set) };
    if code == 0 {
        Ok(())
    } else {
        Err(Right::Core(core).refused())
    }
}

/// Cores on which a thread of this process may be put, ascending, whatever cores the calling thread
/// is on now; those that its user means are
/// [`own_cores`](crate::loop_cores::own_cores).
#[must_use]
pub fn usable_cores() -> Vec<usize> {
    // SAFETY: takes no pointers.
    let configured = unsafe { libc::sysconf(libc::_SC_NPROCESSORS_CONF) };
    let configured = usize::try_from(configured).unwrap_or(0);
    // A thread of its own, since it moves; its stack stays with the process and may be locked.
    let thread = std::thread::Builder::new().stack_size(64 << 10);
    let tried = thread.spawn(move || {
        let can_be_put = |core: &usize| pin_to_core(*core).is_ok();
        (0..configured).filter(can_be_put).collect()
    });
    let tried = tried.ok().and_then(|thread| thread.join().ok());
    tried.unwrap_or_default()
}

/// Keeps the processors out of deep sleep for as long as it lives.
#[derive(Debug)]
pub struct LatencyHold(#[expect(dead_code, reason = "the kernel watches the open file")] File);

/// Asks for wake-ups without sleep states.
///
/// # Errors
/// When the device may not be written, or is not there.
pub fn hold_latency() -> Result<LatencyHold, MissingRight> {
    let open = || {
        let mut file = OpenOptions::new()
            .write(true)
            .open("/dev/cpu_dma_latency")?;
        file.write_all(&0i32.to_ne_bytes())?;
        Ok(LatencyHold(file))
    };
    open().map_err(|error| MissingRight {
        right: Right::Latency,
        error,
    })
}

/// Rights of a thread after [`obtain`].
#[derive(Debug, Default)]
pub struct Obtained {
    /// Refused rights; empty when all were given.
    pub missing: Vec<MissingRight>,
    /// Keeps deep sleep away as long as it lives; `None` when refused.
    pub latency: Option<LatencyHold>,
}

/// Asks for every right for the calling thread; for a core only when one is given. The priority is
/// 1 to 99.
#[must_use]
pub fn obtain(core: Option<usize>, priority: i32) -> Obtained {
    let locked = lock_memory();
    let mut obtained = obtain_processor(core, priority);
    obtained.missing.extend(locked.err());
    obtained
}

/// As [`obtain`], but for the memory: for a thread that ends before the ticks begin, since freed
/// memory that was locked stays resident.
#[must_use]
pub fn obtain_processor(core: Option<usize>, priority: i32) -> Obtained {
    let mut obtained = Obtained::default();
    if let Some(core) = core {
        obtained.missing.extend(pin_to_core(core).err());
    }
    match hold_latency() {
        Ok(hold) => obtained.latency = Some(hold),
        Err(missing) => obtained.missing.push(missing),
    }
    touch_stack();
    // Last: the calls above may be slow.
    obtained.missing.extend(set_fifo(priority).err());
    obtained
}

/// Writes 128 KiB of the stack, so that these pages do not fault later.
#[inline(never)]
pub fn touch_stack() {
    let mut pages = [0u8; 128 * 1024];
    for page in pages.chunks_mut(4096) {
        page[0] = 1;
    }
    std::hint::black_box(&pages);
}

fn clock_ns(clock: libc::clockid_t) -> u64 {
    let mut now = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: the struct lives through the call. Both clocks exist on every Linux, so it cannot
    // fail.
    unsafe { libc::clock_gettime(clock, &raw mut now) };
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

/// CLOCK_MONOTONIC, ns.
#[must_use]
pub fn monotonic_ns() -> u64 {
    clock_ns(libc::CLOCK_MONOTONIC)
}

/// Processor time of the calling thread, ns.
#[must_use]
pub fn thread_cpu_ns() -> u64 {
    clock_ns(libc::CLOCK_THREAD_CPUTIME_ID)
}

/// Sleeps until CLOCK_MONOTONIC reaches `deadline` (ns); through signals.
pub fn sleep_until_ns(deadline: u64) {
    let until = libc::timespec {
        tv_sec: (deadline / 1_000_000_000) as libc::time_t,
        tv_nsec: (deadline % 1_000_000_000) as libc::c_long,
    };
    // SAFETY: the struct lives through the call; no remaining time is asked for.
    while unsafe {
        libc::clock_nanosleep(
            libc::CLOCK_MONOTONIC,
            libc::TIMER_ABSTIME,
            &raw const until,
            std::ptr::null_mut(),
        )
    } == libc::EINTR
    {}
}

/// Counters of the kernel for the calling thread since its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ThreadUsage {
    /// Page faults, minor and major.
    pub page_faults: u64,
    /// Switches by the thread itself: sleeps, locks, blocking calls.
    pub voluntary_switches: u64,
    /// Switches by the kernel.
    pub involuntary_switches: u64,
}

/// Reads the kernel's counters of the calling thread.
#[must_use]
pub fn thread_usage() -> ThreadUsage {
    // SAFETY: all zeros is a valid rusage.
    let mut usage: libc::rusage = unsafe { std::mem::zeroed() };
    // SAFETY: the struct lives through the call. RUSAGE_THREAD cannot fail.
    unsafe { libc::getrusage(libc::RUSAGE_THREAD, &raw mut usage) };
    ThreadUsage {
        page_faults: (usage.ru_minflt + usage.ru_majflt) as u64,
        voluntary_switches: usage.ru_nvcsw as u64,
        involuntary_switches: usage.ru_nivcsw as u64,
    }
}

/// Time in which a thread was runnable without running. It distinguishes a busy core from a late
/// timer. The file stays open; reading it allocates nothing.
#[derive(Debug)]
pub struct RunDelay(File);

impl RunDelay {
    /// Run delay of the calling thread. Read it on the same thread.
    ///
    /// # Errors
    /// When the kernel keeps no schedstat.
    pub fn open() -> io::Result<Self> {
        let file = Self(File::open("/proc/thread-self/schedstat")?);
        file.ns()
            .map(|_| file)
            .ok_or_else(|| io::Error::other("/proc/thread-self/schedstat has no second field"))
    }

    /// Run delay so far, ns; `None` when the file cannot be read.
    #[must_use]
    pub fn ns(&self) -> Option<u64> {
        let mut text = [0u8; 96];
        // SAFETY: the buffer lives through the call and its length is given; the file is open.
        let length =
            unsafe { libc::pread(self.0.as_raw_fd(), text.as_mut_ptr().cast(), text.len(), 0) };
        let text = text.get(..usize::try_from(length).ok()?)?;
        let mut fields = text.split(|&b| b == b' ');
        fields.nth(1)?.iter().try_fold(0u64, |value, &digit| {
            let digit = (digit as char).to_digit(10)?;
            value.checked_mul(10)?.checked_add(u64::from(digit))
        })
    }
}

/// Time that the hypervisor took from all cores together, in units of 10 ms; 0 where `/proc/stat`
/// does not state it. Reads a file: not for the tick.
#[must_use]
pub fn steal_ticks() -> u64 {
    let stat = std::fs::read_to_string("/proc/stat").unwrap_or_default();
    let total = stat.lines().next().unwrap_or_default();
    total
        .split_whitespace()
        .nth(8)
        .and_then(|field| field.parse().ok())
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refused_right_says_which_and_how_to_get_it() {
        let missing = pin_to_core(100_000).unwrap_err();
        assert_eq!(missing.right, Right::Core(100_000));
        let sentence = missing.to_string();
        assert!(
            sentence.contains("core 100000") && sentence.contains("taskset"),
            "{sentence}"
        );
        let missing = set_fifo(1000).unwrap_err().to_string();
        assert!(missing.contains("rtprio"), "{missing}");
    }

    /// That of the calling thread.
    fn nice() -> i32 {
        // SAFETY: takes no pointers; 0 is the calling thread.
        unsafe { libc::getpriority(libc::PRIO_PROCESS, 0) }
    }

    #[test]
    fn a_nice_value_that_is_held_gives_way_to_that_of_before() {
        let before = nice();
        let Ok(held) = hold_nice(before - 1) else {
            let _ = writeln!(std::io::stderr(), "skipped: no right to a lower nice value");
            return;
        };
        assert_eq!(nice(), before - 1);
        drop(held);
        assert_eq!(nice(), before);
    }

    #[test]
    fn a_nice_value_is_of_one_thread_and_those_it_starts() {
        let before = nice();
        let inner = std::thread::spawn(move || {
            // Upwards needs no right.
            set_nice(before + 1).unwrap();
            (nice(), std::thread::spawn(nice).join().unwrap())
        });
        assert_eq!(inner.join().unwrap(), (before + 1, before + 1));
        assert_eq!(nice(), before);
        let missing = MissingRight {
            right: Right::Nice(-10),
            error: io::Error::from_raw_os_error(libc::EACCES),
        };
        let sentence = missing.to_string();
        assert!(sentence.contains("@realtime - nice -10"), "{sentence}");
        assert!(!missing.right.is_of_loop());
    }

    #[test]
    fn sleeping_never_ends_early_and_costs_a_voluntary_switch() {
        let before = thread_usage();
        for _ in 0..5 {
            let deadline = monotonic_ns() + 2_000_000;
            sleep_until_ns(deadline);
            assert!(monotonic_ns() >= deadline);
        }
        assert!(thread_usage().voluntary_switches >= before.voluntary_switches + 5);
    }

    #[test]
    fn thread_time_counts_work_and_not_sleep() {
        const SLEPT_NS: u64 = 20_000_000;
        let before = thread_cpu_ns();
        sleep_until_ns(monotonic_ns() + SLEPT_NS);
        let of_sleep = thread_cpu_ns() - before;
        assert!(of_sleep < SLEPT_NS / 2, "{of_sleep} ns");
        // A million system calls take their time on any machine.
        let start = thread_cpu_ns();
        assert!((0..1_000_000).any(|_| thread_cpu_ns() > start));
    }

    #[test]
    fn fresh_memory_shows_as_page_faults() {
        let before = thread_usage().page_faults;
        let fresh = vec![1u8; 8 << 20];
        std::hint::black_box(&fresh);
        assert!(thread_usage().page_faults > before);
    }

    #[test]
    fn the_run_delay_never_falls() {
        // A kernel may be built without it.
        let Ok(delay) = RunDelay::open() else {
            let _ = writeln!(
                std::io::stderr(),
                "skipped: this kernel keeps no /proc/thread-self/schedstat"
            );
            return;
        };
        let before = delay.ns().unwrap();
        std::thread::yield_now();
        assert!(delay.ns().unwrap() >= before);
    }
}
