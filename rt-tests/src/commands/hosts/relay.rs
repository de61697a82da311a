//! The relay between the cables of two hosts: a thread that takes packets from each and gives them
//! to the other when their time has come.

use super::way::{Carried, Way};
use crate::report::quantile::Quantiles;
use hdrhistogram::Histogram;
use realtime::rights::{monotonic_ns, set_fifo};
use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::AsRawFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// Priority of the relay's thread, where it may have one: below every tick, above everything else,
/// so that a busy machine makes no link longer.
const PRIORITY: i32 = 10;
/// Time after which it looks whether it is asked to cut or to end, ns.
const LOOK_NS: u64 = 10_000_000;
/// Packets that are taken from a cable before those that have arrived are given on.
const MAX_TAKEN: usize = 64;
/// Largest packet of IP, bytes.
const MAX_PACKET: usize = 65_535;
/// Longest lateness that is told from a longer one, ns: 18 minutes; and its digits.
const MAX_LATE_NS: u64 = 1 << 40;
const DIGITS: u8 = 3;

/// What a relay carried.
#[derive(Debug)]
pub struct Relayed {
    /// From the first host to the second, and back.
    pub ways: [Carried; 2],
    /// How long after its time a packet was given on, milliseconds.
    pub late_ms: Quantiles,
}

/// A running relay.
pub struct Relay {
    stop: Arc<AtomicBool>,
    is_cut: Arc<AtomicBool>,
    thread: JoinHandle<Result<Relayed, String>>,
}

impl Relay {
    /// Joins two cables, that do not block, by both directions of a link.
    ///
    /// # Errors
    /// When the system has no thread for it.
    pub fn start(cables: [File; 2], ways: [Way; 2]) -> Result<Self, String> {
        let [stop, is_cut] = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
        let flags = [Arc::clone(&stop), Arc::clone(&is_cut)];
        let work = move || carry(cables, ways, &flags);
        let thread = std::thread::Builder::new().name("relay".to_owned());
        let thread = thread.spawn(work).map_err(|error| error.to_string())?;
        Ok(Self {
            stop,
            is_cut,
            thread,
        })
    }

    /// Cuts both directions, or mends them.
    pub fn cut(&self, is_cut: bool) {
        self.is_cut.store(is_cut, Ordering::Relaxed);
    }

    /// Ends it.
    ///
    /// # Errors
    /// What failed in it, as a sentence.
    pub fn end(self) -> Result<Relayed, String> {
        self.stop.store(true, Ordering::Relaxed);
        let ended = self.thread.join();
        ended.unwrap_or_else(|_| Err("the relay ended by a panic".to_string()))
    }
}

fn carry(
    mut cables: [File; 2],
    mut ways: [Way; 2],
    [stop, is_cut]: &[Arc<AtomicBool>; 2],
) -> Result<Relayed, String> {
    // Without the right it works all the same, later on a busy machine: that is measured.
    let _ = set_fifo(PRIORITY);
    let late = Histogram::<u64>::new_with_bounds(1, MAX_LATE_NS, DIGITS);
    let mut late = late.map_err(|error| error.to_string())?;
    let mut room = vec![0; MAX_PACKET];
    let mut was_cut = false;
    while !stop.load(Ordering::Relaxed) {
        let cut = is_cut.load(Ordering::Relaxed);
        if cut != was_cut {
            was_cut = cut;
            ways.iter_mut().for_each(|way| way.cut(cut));
        }
        for (cable, way) in cables.iter_mut().zip(&mut ways) {
            take(cable, way, &mut room);
        }
        let [there, back] = &mut ways;
        let [first, second] = &mut cables;
        for (way, cable) in [(there, second), (back, first)] {
            give(way, cable, &mut late);
        }
        wait(&cables, ways.iter().filter_map(Way::next_ns).min());
    }
    let ms = |share: f64| late.value_at_quantile(share) as f64 * 1e-6;
    Ok(Relayed {
        ways: ways.map(|way| way.carried),
        late_ms: Quantiles {
            p50: ms(0.5),
            p99: ms(0.99),
            p999: ms(0.999),
            max: ms(1.0),
        },
    })
}

/// Takes what a host has sent.
fn take(cable: &mut File, way: &mut Way, room: &mut [u8]) {
    for _ in 0..MAX_TAKEN {
        // Nothing there, or the host is going: it is looked at again.
        let Ok(length) = cable.read(room) else {
            return;
        };
        let packet = &room[..length];
        // What the kernel says by itself over IPv6 is no part of a link.
        if packet.first().is_some_and(|byte| byte >> 4 == 4) {
            way.send(packet, monotonic_ns());
        }
    }
}

/// Gives a host what has arrived.
fn give(way: &mut Way, cable: &mut File, late: &mut Histogram<u64>) {
    let now_ns = monotonic_ns();
    while let Some((due_ns, packet)) = way.arrived(now_ns) {
        late.saturating_record(now_ns - due_ns);
        // A host that takes nothing loses it, as on a wire.
        let _ = cable.write(&packet);
    }
}

/// Sleeps until a host sends, or it is time to give or to look.
fn wait(cables: &[File; 2], next_ns: Option<u64>) {
    let until_ns = next_ns.map_or(LOOK_NS, |next_ns| next_ns.saturating_sub(monotonic_ns()));
    let timeout = libc::timespec {
        tv_sec: 0,
        tv_nsec: until_ns.min(LOOK_NS) as libc::c_long,
    };
    let mut sources = [0, 1].map(|side: usize| libc::pollfd {
        fd: cables[side].as_raw_fd(),
        events: libc::POLLIN,
        revents: 0,
    });
    // SAFETY: the array and the structure live on this stack; without a mask of signals.
    unsafe {
        libc::ppoll(
            sources.as_mut_ptr(),
            sources.len() as libc::nfds_t,
            &raw const timeout,
            std::ptr::null(),
        );
    }
}
