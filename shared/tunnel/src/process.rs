//! The process of a tunnel: iceoryx2's link between a domain of this machine and zenoh.
//!
//! It looks at both sides every millisecond and whenever something arrives. Its mirrors of the
//! other machine's topics are made from the domain's own settings, so that the programs can open
//! them whoever comes first.

use crate::address::AddressError;
use crate::arguments::TunnelArgs;
use crate::key_files::{KeyFiles, NotText};
use crate::keys::{self, KeysError};
use crate::notes::Notes;
use crate::refusals::without_places;
use crate::settings::{End, show_no_certificate, zenoh_settings};
use iceoryx2::prelude::{
    CallbackProgression, LogLevel, ServiceName, WaitSet, WaitSetBuilder, ipc, set_log_level,
};
use iceoryx2::waitset::WaitSetRunResult;
use iceoryx2_integrations_zenoh_link_carrier::ZenohCarrier;
use iceoryx2_link::Link;
use iceoryx2_link_backend::AllowList;
use serde_json::Value;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;
use std::fs::{File, TryLockError};
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use thiserror::Error;
use transport::{CARRIED_TOPICS, Domain, TransportError};
use zenoh::{Session, Wait};

/// Time between two looks at both sides; what arrives from zenoh wakes it earlier.
const POLL: Duration = Duration::from_millis(1);
/// Time between two looks for new topics: a part of a heartbeat's period.
const DISCOVERY: Duration = Duration::from_millis(10);
/// Time for which the last words of the programs are carried still.
const LAST_WORDS: Duration = Duration::from_millis(50);
/// Time after which an end that hangs is cut short.
const END_TIMEOUT: Duration = Duration::from_secs(2);
/// Time for which another tunnel of the domain is waited for: one whose owner was killed has ended
/// by then.
const LOCK_TIMEOUT: Duration = Duration::from_millis(2500);
/// Time between two looks whether it has.
const LOCK_POLL: Duration = Duration::from_millis(20);
/// Status of a process that could not carry anything.
const FAILED: u8 = 2;

type ZenohTunnel = Link<ipc::Service, iceoryx2_link_tunnel::Tunnel<ZenohCarrier>>;

/// Why nothing is carried: one sentence each.
#[derive(Debug, Error)]
enum CarryError {
    #[error("{0}")]
    Address(#[from] AddressError),
    #[error("{0}")]
    Folder(#[from] NotText),
    #[error("{0}")]
    Keys(#[from] KeysError),
    #[error("{0}")]
    Transport(#[from] TransportError),
    #[error(
        "the domain \"{0}\" has a tunnel already, and two would carry the topics round and round: stop the other program, or give this one another --domain"
    )]
    Taken(String),
    #[error("cannot listen on {address} ({reason}): stop who uses it, or choose another port")]
    Listen { address: String, reason: String },
    #[error("the tunnel cannot {what}: {reason}")]
    Engine { what: &'static str, reason: String },
}

fn engine<E: std::fmt::Display>(what: &'static str) -> impl FnOnce(E) -> CarryError {
    move |error| CarryError::Engine {
        what,
        reason: error.to_string(),
    }
}

/// Carries the topics of a domain until standard input ends: what the hidden subcommand of a
/// program does.
#[must_use]
pub fn run(args: &TunnelArgs) -> ExitCode {
    let notes = Notes::default();
    match args.end().map_err(CarryError::from).and_then(|end| {
        notes.listen_to_logs(&end);
        carry(args, &end, &notes)
    }) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            notes.failed(&error.to_string());
            ExitCode::from(FAILED)
        }
    }
}

fn carry(args: &TunnelArgs, end: &End, notes: &Notes) -> Result<(), CarryError> {
    outlive_signals()?;
    let domain = Domain::new(&args.domain)?;
    let settings = settings_for(args, end)?.to_string();
    notes.listen_to_iceoryx();
    let node = domain.node()?;
    // Later, because a new node sets it.
    set_log_level(LogLevel::Warn);
    // Before the domain is waited for, since its owner may end meanwhile.
    let stop = stop_at_end_of_input();
    let _only = only_tunnel_of(&domain, &stop)?;
    let session = open_session(end, &settings)?;
    notes.listen_to_links(&session, end);
    let carrier = ZenohCarrier::open(session.clone()).map_err(engine("find the other side"))?;
    let tunnel = iceoryx2_link_tunnel::Tunnel::new(carrier, &domain.config()?);
    let allowed = AllowList::new(&CARRIED_TOPICS);
    let mut tunnel = Link::new(node, tunnel)
        .with_filter(move |name: &ServiceName| allowed.admits(name.as_str()));
    notes.ready();
    let carried = spin(&mut tunnel, &stop, notes);
    drop(tunnel);
    let closed = session.close().wait();
    carried?;
    closed.map_err(engine("close its session"))
}

/// The settings of zenoh, with keys that are checked, unless it is a stranger's.
fn settings_for(args: &TunnelArgs, end: &End) -> Result<Value, CarryError> {
    let keys = args.keys.as_deref();
    let Some(folder) = keys.filter(|_| args.as_stranger) else {
        let keys = keys::needed_for(end, keys)?;
        return Ok(zenoh_settings(end, keys.as_ref()));
    };
    let files = KeyFiles::in_folder(folder)?;
    let mut settings = zenoh_settings(end, Some(&files));
    if !Path::new(&files.certificate).exists() {
        show_no_certificate(&mut settings);
    }
    Ok(settings)
}

/// Keeps other tunnels out of a domain as long as it is open.
fn only_tunnel_of(domain: &Domain, stop: &AtomicBool) -> Result<File, CarryError> {
    let file = File::create(domain.root().join("tunnel.lock"));
    let file = file.map_err(engine("keep others out of its domain"))?;
    let locked = lock_within(&file, LOCK_TIMEOUT, stop);
    if locked.map_err(engine("keep others out of its domain"))? {
        Ok(file)
    } else {
        Err(CarryError::Taken(domain.name().to_owned()))
    }
}

/// Locks a file as soon as nobody else has it locked; false when somebody still has after this
/// time, or when it is to stop meanwhile.
fn lock_within(file: &File, time: Duration, stop: &AtomicBool) -> std::io::Result<bool> {
    let begin = Instant::now();
    loop {
        match file.try_lock() {
            Ok(()) => return Ok(true),
            Err(TryLockError::Error(error)) => return Err(error),
            Err(TryLockError::WouldBlock) => {}
        }
        if begin.elapsed() >= time || stop.load(Ordering::Relaxed) {
            return Ok(false);
        }
        std::thread::sleep(LOCK_POLL);
    }
}

fn open_session(end: &End, settings: &str) -> Result<Session, CarryError> {
    let config = zenoh::Config::from_json5(settings).map_err(engine("read its settings"))?;
    zenoh::open(config).wait().map_err(|error| match end {
        End::Listen(address) => CarryError::Listen {
            address: address.to_string(),
            reason: without_places(&error.to_string()),
        },
        End::Call(_) => engine("open its session")(error),
    })
}

/// Moves what there is, until it is asked to stop.
fn spin(tunnel: &mut ZenohTunnel, stop: &AtomicBool, notes: &Notes) -> Result<(), CarryError> {
    let arrivals = tunnel.listener().map_err(engine("be woken"))?;
    let wait = WaitSetBuilder::new().create::<ipc::Service>();
    let wait = wait.map_err(engine("wait"))?;
    let _poll = wait.attach_interval(POLL).map_err(engine("poll"))?;
    let _woken = wait
        .attach_notification(&arrivals)
        .map_err(engine("wait for arrivals"))?;
    let (mut next_discovery, mut last) = (Instant::now(), None);
    until_stopped(&wait, || {
        // A wake-up that is not taken would wake again.
        let _ = arrivals.try_wait(|_| {});
        let now = Instant::now();
        if now >= next_discovery {
            next_discovery = now + DISCOVERY;
            if let Err(error) = tunnel.discover() {
                notes.counted(&format!("looking for topics failed ({error})"));
            }
        }
        if let Err(error) = tunnel.propagate() {
            notes.counted(&format!("carrying topics failed ({error})"));
        }
        if stop.load(Ordering::Relaxed) && now >= *last.get_or_insert(now + LAST_WORDS) {
            return CallbackProgression::Stop;
        }
        CallbackProgression::Continue
    })
}

/// Signals end nothing from now on: who ends a program may send them to all of its processes, and
/// its last words are to be carried.
fn outlive_signals() -> Result<(), CarryError> {
    for signal in [SIGHUP, SIGINT, SIGTERM] {
        flag::register(signal, Arc::default()).map_err(engine("receive signals"))?;
    }
    Ok(())
}

/// Takes a step whenever something happens, until one says that it was the last. A signal only
/// interrupts the wait; the owner ends it by the end of its input.
fn until_stopped(
    wait: &WaitSet<ipc::Service>,
    mut step: impl FnMut() -> CallbackProgression,
) -> Result<(), CarryError> {
    loop {
        let ended = wait.wait_and_process(|_| step()).map_err(engine("wait"))?;
        if ended == WaitSetRunResult::StopRequest {
            return Ok(());
        }
    }
}

/// Set when standard input ends, which its owner holds open. An end that hangs is cut short.
fn stop_at_end_of_input() -> Arc<AtomicBool> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    std::thread::spawn(move || {
        // Unlike a single read it goes on after a signal.
        let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        flag.store(true, Ordering::Relaxed);
        std::thread::sleep(END_TIMEOUT);
        std::process::exit(i32::from(FAILED));
    });
    stop
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    #[test]
    fn a_signal_ends_no_tunnel() {
        const STEPS: u32 = 200;
        let wait = WaitSetBuilder::new().create::<ipc::Service>().unwrap();
        let _poll = wait.attach_interval(POLL).unwrap();
        let kill = "kill -HUP $PPID; kill -INT $PPID; kill -TERM $PPID";
        let (mut after, mut sender) = (0, None);
        outlive_signals().unwrap();
        let ended = until_stopped(&wait, || {
            // From the first step on, the wait receives them, too.
            let sender = sender.get_or_insert_with(|| {
                let mut command = Command::new("sh");
                command.args(["-c", kill]).spawn().unwrap()
            });
            // It has sent them once it has ended.
            after += u32::from(sender.try_wait().unwrap().is_some());
            if after < STEPS {
                CallbackProgression::Continue
            } else {
                CallbackProgression::Stop
            }
        });
        ended.unwrap();
        assert_eq!(after, STEPS);
    }

    #[test]
    fn a_domain_is_waited_for_until_the_tunnel_before_has_ended() {
        let folder = tempfile::tempdir().unwrap();
        let open = || File::create(folder.path().join("tunnel.lock")).unwrap();
        let (goes_on, ends) = (AtomicBool::new(false), AtomicBool::new(true));
        let long = Duration::from_secs(20);
        let before = open();
        before.lock().unwrap();
        assert!(!lock_within(&open(), LOCK_POLL, &goes_on).unwrap());
        assert!(!lock_within(&open(), long, &ends).unwrap());
        std::thread::scope(|scope| {
            scope.spawn(|| {
                std::thread::sleep(3 * LOCK_POLL);
                drop(before);
            });
            assert!(lock_within(&open(), long, &goes_on).unwrap());
        });
    }
}
