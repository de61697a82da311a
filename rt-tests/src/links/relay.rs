//! The relay between the cable of one host and those of others: a thread that takes packets from
//! each and gives them to the other end when their time has come.

use super::way::{Carried, Way};
use crate::report::quantile::Quantiles;
use hdrhistogram::Histogram;
use realtime::rights::{monotonic_ns, set_fifo};
use std::fs::File;
use std::io::{Read, Write};
use std::net::Ipv4Addr;
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

/// A host at the far end of a link.
pub struct FarEnd {
    /// Its address.
    pub address: Ipv4Addr,
    /// Its end of its cable, which does not block.
    pub cable: File,
    /// The link to it, and back.
    pub ways: [Way; 2],
}

/// What a relay carried.
#[derive(Debug)]
pub struct Relayed {
    /// To each of the other hosts, and back.
    pub links: Vec<[Carried; 2]>,
    /// How long after its time a packet was given on, milliseconds.
    pub late_ms: Quantiles,
}

/// A running relay; where it is dropped its thread ends, with the cables that it holds.
pub struct Relay {
    stop: Arc<AtomicBool>,
    is_cut: Arc<AtomicBool>,
    is_calm: Arc<AtomicBool>,
    /// `None` once it was waited for.
    thread: Option<JoinHandle<Result<Relayed, String>>>,
}

impl Relay {
    /// Joins the cable of a host, which does not block, with those of others.
    ///
    /// # Errors
    /// When the system has no thread for it.
    pub fn start(cable: File, others: Vec<FarEnd>) -> Result<Self, String> {
        let flags = [(); 3].map(|()| Arc::new(AtomicBool::new(false)));
        let [stop, is_cut, is_calm] = flags.clone();
        let work = move || carry(cable, others, &flags);
        let thread = std::thread::Builder::new().name("relay".to_owned());
        let thread = thread.spawn(work).map_err(|error| error.to_string())?;
        Ok(Self {
            stop,
            is_cut,
            is_calm,
            thread: Some(thread),
        })
    }

    /// Cuts all links in both directions, or mends them.
    pub fn cut(&self, is_cut: bool) {
        self.is_cut.store(is_cut, Ordering::Relaxed);
    }

    /// From now on nobody changes packets or sends them once more.
    pub fn calm(&self) {
        self.is_calm.store(true, Ordering::Relaxed);
    }

    /// Ends it.
    ///
    /// # Errors
    /// What failed in it, as a sentence.
    pub fn end(mut self) -> Result<Relayed, String> {
        self.end_thread()
    }

    /// Has the thread end, and waits for what it says.
    fn end_thread(&mut self) -> Result<Relayed, String> {
        self.stop.store(true, Ordering::Relaxed);
        let ended = self.thread.take().map(JoinHandle::join);
        let failed = || Err("the relay ended by a panic".to_string());
        ended.and_then(Result::ok).unwrap_or_else(failed)
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        let _ = self.end_thread();
    }
}

fn carry(
    mut cable: File,
    mut others: Vec<FarEnd>,
    [stop, is_cut, is_calm]: &[Arc<AtomicBool>; 3],
) -> Result<Relayed, String> {
    // Without the right it works all the same, later on a busy machine: that is measured.
    let _ = set_fifo(PRIORITY);
    let late = Histogram::<u64>::new_with_bounds(1, MAX_LATE_NS, DIGITS);
    let mut late = late.map_err(|error| error.to_string())?;
    let mut room = vec![0; MAX_PACKET];
    let (mut was_cut, mut was_calm) = (false, false);
    while !stop.load(Ordering::Relaxed) {
        let (cut, calm) = (
            is_cut.load(Ordering::Relaxed),
            is_calm.load(Ordering::Relaxed),
        );
        for way in others.iter_mut().flat_map(|other| &mut other.ways) {
            if cut != was_cut {
                way.cut(cut);
            }
            if calm != was_calm {
                way.calm();
            }
        }
        (was_cut, was_calm) = (cut, calm);
        take(&mut cable, &mut room, |packet| {
            let to = packet.get(16..20);
            let is_for = |other: &&mut FarEnd| to == Some(&other.address.octets()[..]);
            if let Some(other) = others.iter_mut().find(is_for) {
                other.ways[0].send(packet, monotonic_ns());
            }
        });
        for other in &mut others {
            let [there, back] = &mut other.ways;
            let sent = |packet: &[u8]| back.send(packet, monotonic_ns());
            take(&mut other.cable, &mut room, sent);
            give(there, &mut other.cable, &mut late);
            give(back, &mut cable, &mut late);
        }
        let ways = others.iter().flat_map(|other| &other.ways);
        let next_ns = ways.filter_map(Way::next_ns).min();
        let cables = others.iter().map(|other| &other.cable);
        wait(cables.chain([&cable]), next_ns);
    }
    let ms = |share: f64| late.value_at_quantile(share) as f64 * 1e-6;
    let of = |other: FarEnd| other.ways.map(|way| way.carried);
    Ok(Relayed {
        links: others.into_iter().map(of).collect(),
        late_ms: Quantiles {
            p50: ms(0.5),
            p99: ms(0.99),
            p999: ms(0.999),
            max: ms(1.0),
        },
    })
}

/// Takes what a host has sent.
fn take(cable: &mut File, room: &mut [u8], mut sent: impl FnMut(&[u8])) {
    for _ in 0..MAX_TAKEN {
        // Nothing there, or the host is going: it is looked at again.
        let Ok(length) = cable.read(room) else {
            return;
        };
        let packet = &room[..length];
        // What the kernel says by itself over IPv6 is no part of a link.
        if packet.first().is_some_and(|byte| byte >> 4 == 4) {
            sent(packet);
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
fn wait<'a>(cables: impl Iterator<Item = &'a File>, next_ns: Option<u64>) {
    let until_ns = next_ns.map_or(LOOK_NS, |next_ns| next_ns.saturating_sub(monotonic_ns()));
    let timeout = libc::timespec {
        tv_sec: 0,
        tv_nsec: until_ns.min(LOOK_NS) as libc::c_long,
    };
    let source = |cable: &File| libc::pollfd {
        fd: cable.as_raw_fd(),
        events: libc::POLLIN,
        revents: 0,
    };
    let mut sources: Vec<libc::pollfd> = cables.map(source).collect();
    // SAFETY: list and structure live through the call; without a mask of signals.
    unsafe {
        libc::ppoll(
            sources.as_mut_ptr(),
            sources.len() as libc::nfds_t,
            &raw const timeout,
            std::ptr::null(),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::fd::OwnedFd;
    use std::os::unix::net::UnixDatagram;

    #[test]
    fn a_relay_that_is_dropped_or_ended_leaves_no_thread() {
        let cable = || {
            let socket = UnixDatagram::unbound().expect("there is a socket");
            let set = socket.set_nonblocking(true);
            set.expect("it does not block");
            File::from(OwnedFd::from(socket))
        };
        let relay = Relay::start(cable(), Vec::new()).expect("there is a thread");
        // The thread has the other one.
        let stop = Arc::clone(&relay.stop);
        drop(relay);
        assert_eq!(Arc::strong_count(&stop), 1);
        let relay = Relay::start(cable(), Vec::new()).expect("there is a thread");
        let stop = Arc::clone(&relay.stop);
        assert!(relay.end().is_ok_and(|relayed| relayed.links.is_empty()));
        assert_eq!(Arc::strong_count(&stop), 1);
    }
}
