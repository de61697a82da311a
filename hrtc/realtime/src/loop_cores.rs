//! The cores that a process may use for its loop.

use crate::interrupts;
use crate::rights::usable_cores;

/// Cores for a loop of this process, ascending: those that its user put the calling thread on
/// (`taskset`). Who was put nowhere is on all but those that the kernel keeps free for such a loop
/// (`isolcpus=`), and gets them too: all of [`usable_cores`].
#[must_use]
pub fn own_cores() -> Vec<usize> {
    let isolated = std::fs::read_to_string("/sys/devices/system/cpu/isolated");
    let isolated = isolated.unwrap_or_default();
    let is_isolated = |core| interrupts::has(&isolated, core);
    cores_of_loop(usable_cores(), affinity(), is_isolated)
}

/// Of the cores that a process may use, and those that a thread of it is on: see [`own_cores`].
fn cores_of_loop(
    usable: Vec<usize>,
    own: Vec<usize>,
    is_isolated: impl Fn(usize) -> bool,
) -> Vec<usize> {
    let others = usable.iter().copied().filter(|&core| !is_isolated(core));
    let is_put_nowhere = others.eq(own.iter().copied());
    // Empty: a kernel for more cores than the set has room for.
    if is_put_nowhere || own.is_empty() {
        usable
    } else {
        own
    }
}

/// Cores on which the calling thread may run, ascending; none where the kernel does not tell.
fn affinity() -> Vec<usize> {
    // SAFETY: all zeros is the empty set.
    let mut set: libc::cpu_set_t = unsafe { std::mem::zeroed() };
    // SAFETY: the set lives through the call and its size is given; 0 is the calling thread.
    let code = unsafe { libc::sched_getaffinity(0, size_of::<libc::cpu_set_t>(), &raw mut set) };
    if code != 0 {
        return Vec::new();
    }
    // SAFETY: the indices are below CPU_SETSIZE.
    let has = |core: &usize| unsafe { libc::CPU_ISSET(*core, &set) };
    (0..libc::CPU_SETSIZE as usize).filter(has).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rights::pin_to_core;

    #[test]
    fn cores_that_the_kernel_keeps_free_are_for_the_loop_unless_its_user_named_others() {
        let isolated = |core: usize| core == 1;
        let of = |own: &[usize]| cores_of_loop(vec![0, 1, 2], own.to_vec(), isolated);
        // Where it starts every process.
        assert_eq!(of(&[0, 2]), [0, 1, 2]);
        for put in [&[0][..], &[1], &[2], &[0, 1], &[0, 1, 2]] {
            assert_eq!(of(put), put);
        }
        // It did not tell.
        assert_eq!(of(&[]), [0, 1, 2]);
        let of = |own: &[usize]| cores_of_loop(vec![0, 1], own.to_vec(), |_| false);
        for put in [&[0][..], &[1], &[0, 1]] {
            assert_eq!(of(put), put);
        }
    }

    #[test]
    fn the_cores_of_a_thread_are_those_that_it_was_put_on() {
        let usable = usable_cores();
        let own = std::thread::spawn(move || {
            let before = affinity();
            let put = usable.iter().map(|&core| {
                pin_to_core(core).unwrap();
                (affinity(), vec![core])
            });
            let put: Vec<_> = put.collect();
            (before, usable, put)
        });
        let (before, usable, put) = own.join().unwrap();
        assert!(!before.is_empty() && before.iter().all(|core| usable.contains(core)));
        assert!(put.iter().all(|(own, core)| own == core), "{put:?}");
    }
}
