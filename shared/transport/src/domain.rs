//! The part of iceoryx2 that both processes must agree on: domain, service names and the quality of
//! service of every topic.
//!
//! With N for the version of the protocol:
//!
//! | topic | publishers | subscribers | payload |
//! |---|---|---|---|
//! | `hrtc/vN/subscribe` | controllers | station | a [`Request`] in as many [`RequestWord`]s as it needs |
//! | `hrtc/vN/pose` | controllers | station | [`ContactReport`] |
//! | `hrtc/vN/records/CLIENT` | station | one controller | up to 64 [`ChunkSlot`]s, [`ChunkHeader`] |
//! | `hrtc/hello` | all | all | [`Hello`] |
//!
//! All topics have the same quality of service, because a tunnel between machines creates its
//! mirrors from one set of defaults (`config/iceoryx2.toml` has the same numbers): queues of
//! [`MAX_QUEUED`] messages, no history, no overflow, full queues discard the newest. Nothing
//! blocks, and discarded messages show as a gap.
//!
//! A domain is a root folder and a file prefix: two domains do not see each other. Both hold the
//! user's number, so that users of one machine do not meet in a domain that none of them can use:
//! both processes run as the same user. No name contains `_`, so no prefix begins another one.

use iceoryx2::config::Config;
use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::port::SendError;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{
    AllocationStrategy, BackpressureStrategy, FileName, IceoryxSend, LogLevel, Path,
    SemanticString, ServiceName, SignalHandlingMode, ZeroCopySend, ipc, set_log_level_from_env_or,
};
use iceoryx2::service::builder::publish_subscribe::Builder;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use iceoryx2::service::port_factory::publisher::PortFactoryPublisher;
use protocol::{
    CHUNK_SLOTS, ChunkHeader, ChunkSlot, ContactReport, HELLO_TOPIC, Hello, MAX_CLIENTS,
    MAX_CREDIT_CHUNKS, POSE_TOPIC, RECORDS_TOPICS, Request, RequestWord, SUBSCRIBE_TOPIC,
    records_topic,
};
use std::collections::BTreeMap;
use std::fmt::Debug;
use std::fs::{DirBuilder, File, TryLockError};
use std::io::ErrorKind;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use thiserror::Error;

/// Largest number of messages in a subscriber's queue: the largest credit window.
pub const MAX_QUEUED: usize = MAX_CREDIT_CHUNKS as usize;
/// Largest number of publishers, and of subscribers, of a topic: the clients, the station, a tunnel
/// and a spare.
pub const MAX_PORTS: usize = MAX_CLIENTS + 3;
/// Largest number of subscribers of a records topic: its client, its restart before the dead one is
/// removed, a tunnel, a recorder.
const MAX_RECORD_PORTS: usize = 4;
/// The topics that a tunnel carries to another machine, `*` for any client: all of the protocol,
/// and no other name. A wake-up event among them would be carried too, and stall a tunnel.
pub const CARRIED_TOPICS: [&str; 4] = [HELLO_TOPIC, SUBSCRIBE_TOPIC, POSE_TOPIC, RECORDS_TOPICS];
/// Largest number of samples that a subscriber borrows at the same time.
const MAX_BORROWED: usize = 2;
/// Publishers that are gone whose samples a subscriber may still read. Each takes some 4 KB of it,
/// locked in memory; iceoryx2's default is 128.
const MAX_PORTS_GONE: usize = 16;
/// What fails where a topic of chunks cannot be opened.
const OPEN_RECORDS: &str = "open a topic of records";
/// Longest name of a domain, bytes.
const MAX_NAME_BYTES: usize = 32;
/// Tries to share the lock on a root folder, and the time between two: whoever cleans up in `/tmp`
/// has it alone for less than this second, unless it is stopped.
const LOCK_TRIES: (u32, Duration) = (100, Duration::from_millis(10));

/// The root folders that this process has locked, until it ends.
static HELD: Mutex<BTreeMap<PathBuf, File>> = Mutex::new(BTreeMap::new());

/// An iceoryx2 node of this machine.
pub type IpcNode = Node<ipc::Service>;
/// An open topic: its payload, and the header beside it.
pub type Topic<P, H = ()> = PortFactory<ipc::Service, P, H>;

/// A named iceoryx2 domain.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Domain {
    name: String,
}

/// Both ends of the topic of heartbeats.
#[derive(Debug)]
pub struct Heartbeats {
    /// Receives what the peers send.
    pub incoming: Subscriber<ipc::Service, Hello, ()>,
    /// Sends this process's.
    pub outgoing: Publisher<ipc::Service, Hello, ()>,
}

/// Sends requests, each in as many words as it needs: between machines every byte takes its time.
#[derive(Debug)]
pub struct RequestSender {
    port: Publisher<ipc::Service, [RequestWord], ()>,
}

impl RequestSender {
    /// Sends one. Returns how many have got it.
    ///
    /// # Errors
    /// When iceoryx2 refuses.
    pub fn send(&self, request: &Request) -> Result<usize, SendError> {
        let words = request.words();
        let sample = self.port.loan_slice_uninit(words.len())?;
        sample.write_from_slice(words).send()
    }
}

/// Errors of the transport, one sentence each.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum TransportError {
    /// Not a name for a domain.
    #[error(
        "the domain name \"{0}\" is refused: use 1 to 32 of the characters a-z, A-Z, 0-9 and '-'"
    )]
    DomainName(String),
    /// iceoryx2 refused.
    #[error(
        "cannot {what} in the iceoryx2 domain \"{domain}\" ({reason}): when another release uses this domain, choose another with --domain, or stop it and remove {files}"
    )]
    Iceoryx {
        /// The attempted action.
        what: &'static str,
        /// The domain.
        domain: String,
        /// iceoryx2's reason.
        reason: String,
        /// All of its files.
        files: String,
    },
    /// The place of the root folder is taken.
    #[error(
        "the iceoryx2 domain \"{domain}\" cannot be used: its folder {} {reason}; choose another with --domain, or have that removed",
        root.display()
    )]
    Root {
        /// The domain.
        domain: String,
        /// The root folder.
        root: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}

impl Domain {
    /// The domain of a name.
    ///
    /// # Errors
    /// When the name has other characters than letters, digits and `-`, or is empty or longer than
    /// 32.
    pub fn new(name: &str) -> Result<Self, TransportError> {
        let allowed = |c: char| c.is_ascii_alphanumeric() || c == '-';
        if name.is_empty() || name.len() > MAX_NAME_BYTES || !name.chars().all(allowed) {
            return Err(TransportError::DomainName(name.to_owned()));
        }
        Ok(Self {
            name: name.to_owned(),
        })
    }

    /// All domains of which this user has a root folder.
    #[must_use]
    pub fn all_of_user() -> Vec<Self> {
        let begins = format!("hrtc-{}-", user());
        let entries = std::fs::read_dir("/tmp").into_iter().flatten().flatten();
        entries
            .filter_map(|entry| {
                let name = entry.file_name();
                Self::new(name.to_str()?.strip_prefix(&begins)?).ok()
            })
            .collect()
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The root folder.
    #[must_use]
    pub fn root(&self) -> PathBuf {
        self.root_of(user())
    }

    /// How the names of its files in `/dev/shm` begin.
    #[must_use]
    pub fn prefix(&self) -> String {
        self.prefix_of(user())
    }

    fn root_of(&self, user: u32) -> PathBuf {
        format!("/tmp/hrtc-{user}-{}", self.name).into()
    }

    fn prefix_of(&self, user: u32) -> String {
        format!("hrtc_{user}-{}_", self.name)
    }

    /// The configuration of every node of the domain. No file is read: the defaults are embedded.
    ///
    /// # Errors
    /// When iceoryx2 refuses the paths.
    pub fn config(&self) -> Result<Config, TransportError> {
        self.config_of(user())
    }

    fn config_of(&self, user: u32) -> Result<Config, TransportError> {
        let root = Path::new(format!("{}/", self.root_of(user).display()).as_bytes())
            .map_err(|e| self.error("name the root folder", e))?;
        let prefix = FileName::new(self.prefix_of(user).as_bytes())
            .map_err(|e| self.error("name the prefix", e))?;
        let mut config = Config::default();
        config.global.set_root_path(&root);
        config.global.prefix = prefix;
        config.global.creation_timeout = Duration::from_secs(1);
        config.global.node.cleanup_dead_nodes_on_creation = true;
        config.global.node.cleanup_dead_nodes_on_destruction = true;
        config.global.service.cleanup_dead_nodes_on_open = true;
        let topic = &mut config.defaults.publish_subscribe;
        topic.max_publishers = MAX_PORTS;
        topic.max_subscribers = MAX_PORTS;
        topic.max_nodes = MAX_PORTS;
        topic.subscriber_max_buffer_size = MAX_QUEUED;
        topic.subscriber_max_borrowed_samples = MAX_BORROWED;
        topic.subscriber_expired_connection_buffer = MAX_PORTS_GONE;
        topic.publisher_history_size = 0;
        topic.enable_safe_overflow = false;
        topic.backpressure_strategy = BackpressureStrategy::DiscardData;
        topic.publisher_allocation_strategy = AllocationStrategy::Static;
        Ok(config)
    }

    /// A node of this domain. Create it, and every port of it, on the thread that uses them.
    ///
    /// From now on this process shares a lock on the root folder until it ends, or the domain's
    /// files are removed: systemd-tmpfiles goes into no folder that is locked. Elsewhere in `/tmp`
    /// it removes what nobody has touched for ten days, as the files of topics that are open. Where
    /// another has it alone for a second, or there are no locks, nothing is held.
    ///
    /// # Errors
    /// When the root folder is not this user's, or iceoryx2 refuses, after three tries.
    pub fn node(&self) -> Result<IpcNode, TransportError> {
        self.take_root()?;
        self.hold_root();
        // iceoryx2's messages are for developers: errors only, unless IOX2_LOG_LEVEL is set.
        set_log_level_from_env_or(LogLevel::Error);
        let config = self.config()?;
        self.retry("create a node", || {
            NodeBuilder::new()
                .config(&config)
                .signal_handling_mode(SignalHandlingMode::Disabled)
                .create::<ipc::Service>()
        })
    }

    /// Makes the root folder, for this user only. Everybody may write to `/tmp`, so what is there
    /// already may be another's, or lead elsewhere.
    ///
    /// # Errors
    /// When it cannot be made, or what is there is no folder of this user.
    pub fn take_root(&self) -> Result<(), TransportError> {
        let root = self.root();
        let wrong = |reason: String| TransportError::Root {
            domain: self.name.clone(),
            root: root.clone(),
            reason,
        };
        match DirBuilder::new().mode(0o700).create(&root) {
            Err(error) if error.kind() != ErrorKind::AlreadyExists => {
                return Err(wrong(format!("cannot be made ({error})")));
            }
            _ => {}
        }
        let found = std::fs::symlink_metadata(&root);
        let found = found.map_err(|error| wrong(format!("cannot be looked at ({error})")))?;
        if !found.is_dir() {
            return Err(wrong("is no folder".to_owned()));
        }
        let (owner, own) = (found.uid(), user());
        if owner != own {
            let reason = format!("belongs to the user {owner}, while you are {own}");
            return Err(wrong(reason));
        }
        Ok(())
    }

    /// Shares a lock on the root folder, unless this process does already: what was removed and
    /// made again is another folder. Where it cannot be had, the next node tries again.
    fn hold_root(&self) {
        let root = self.root();
        let place = |of: std::fs::Metadata| (of.dev(), of.ino());
        let found = std::fs::symlink_metadata(&root).map(place).ok();
        let is_it = |folder: &File| folder.metadata().map(place).ok() == found;
        if held().get(&root).is_some_and(is_it) {
            return;
        }
        let Ok(folder) = File::open(&root) else {
            return;
        };
        let (tries, pause) = LOCK_TRIES;
        for _ in 0..tries {
            match folder.try_lock_shared() {
                Ok(()) => {
                    held().insert(root, folder);
                    return;
                }
                Err(TryLockError::WouldBlock) => std::thread::sleep(pause),
                Err(TryLockError::Error(_)) => return,
            }
        }
    }

    /// Removes the files of a domain made for a single run, after all of its processes have ended.
    ///
    /// Both folders are cleared, because iceoryx2 takes one without the other for a damaged domain.
    /// Files that cannot be removed stay.
    pub fn remove_files(&self) {
        let prefix = self.prefix();
        let shared_memory = std::fs::read_dir("/dev/shm")
            .into_iter()
            .flatten()
            .flatten();
        for entry in shared_memory {
            if entry.file_name().to_string_lossy().starts_with(&prefix) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
        let _ = std::fs::remove_dir_all(self.root());
        held().remove(&self.root());
    }

    /// The topic of requests.
    ///
    /// # Errors
    /// When iceoryx2 refuses, after three tries.
    pub fn subscribe_service(
        &self,
        node: &IpcNode,
    ) -> Result<Topic<[RequestWord]>, TransportError> {
        let name = self.service_name(SUBSCRIBE_TOPIC)?;
        self.retry("open the topic of requests", || {
            topic::<[RequestWord], ()>(node, &name, MAX_PORTS, MAX_RECORD_PORTS).open_or_create()
        })
    }

    /// The topic of poses and contacts.
    ///
    /// # Errors
    /// When iceoryx2 refuses, after three tries.
    pub fn pose_service(&self, node: &IpcNode) -> Result<Topic<ContactReport>, TransportError> {
        let name = self.service_name(POSE_TOPIC)?;
        self.retry("open the topic of contacts", || {
            topic::<ContactReport, ()>(node, &name, MAX_PORTS, MAX_RECORD_PORTS).open_or_create()
        })
    }

    /// The topic of chunks for one client. On a shared topic, chunks of other clients would fill
    /// its queue.
    ///
    /// # Errors
    /// When iceoryx2 refuses, after three tries.
    pub fn records_service(
        &self,
        node: &IpcNode,
        client: u64,
    ) -> Result<Topic<[ChunkSlot], ChunkHeader>, TransportError> {
        let name = self.service_name(&records_topic(client))?;
        self.retry(OPEN_RECORDS, || records(node, &name).open_or_create())
    }

    /// The same in one try, for whoever must not wait and tries again later.
    ///
    /// # Errors
    /// When iceoryx2 refuses.
    pub fn try_records_service(
        &self,
        node: &IpcNode,
        client: u64,
    ) -> Result<Topic<[ChunkSlot], ChunkHeader>, TransportError> {
        let name = self.service_name(&records_topic(client))?;
        let opened = records(node, &name).open_or_create();
        opened.map_err(|e| self.error(OPEN_RECORDS, e))
    }

    /// The topic of heartbeats, the only one without a version in its name.
    ///
    /// # Errors
    /// When iceoryx2 refuses, after three tries.
    pub fn hello_service(&self, node: &IpcNode) -> Result<Topic<Hello>, TransportError> {
        let name = self.service_name(HELLO_TOPIC)?;
        self.retry("open the topic of heartbeats", || {
            topic::<Hello, ()>(node, &name, MAX_PORTS, MAX_PORTS).open_or_create()
        })
    }

    /// A receiver of a topic, with a queue of [`MAX_QUEUED`] messages; `what` it does is part of
    /// the error.
    ///
    /// # Errors
    /// When iceoryx2 refuses.
    pub fn subscriber<P: Debug + IceoryxSend + ?Sized, H: Debug + ZeroCopySend>(
        &self,
        topic: &Topic<P, H>,
        what: &'static str,
    ) -> Result<Subscriber<ipc::Service, P, H>, TransportError> {
        let port = topic.subscriber_builder().buffer_size(MAX_QUEUED).create();
        port.map_err(|e| self.error(what, e))
    }

    /// A sender of a topic that lends one message at a time and discards when a queue is full;
    /// `what` it does is part of the error.
    ///
    /// # Errors
    /// When iceoryx2 refuses.
    pub fn publisher<P: Debug + IceoryxSend, H: Debug + ZeroCopySend>(
        &self,
        topic: &Topic<P, H>,
        what: &'static str,
    ) -> Result<Publisher<ipc::Service, P, H>, TransportError> {
        let port = sender(topic).create();
        port.map_err(|e| self.error(what, e))
    }

    /// A sender of requests.
    ///
    /// # Errors
    /// When iceoryx2 refuses.
    pub fn request_sender(
        &self,
        topic: &Topic<[RequestWord]>,
    ) -> Result<RequestSender, TransportError> {
        let port = sender(topic)
            .initial_max_slice_len(Request::MAX_WORDS)
            .allocation_strategy(AllocationStrategy::Static)
            .create();
        let port = port.map_err(|e| self.error("send requests", e))?;
        Ok(RequestSender { port })
    }

    /// A sender of chunks: its memory is that of one chunk of [`CHUNK_SLOTS`] and does not grow.
    ///
    /// # Errors
    /// When iceoryx2 refuses.
    pub fn records_publisher(
        &self,
        topic: &Topic<[ChunkSlot], ChunkHeader>,
    ) -> Result<Publisher<ipc::Service, [ChunkSlot], ChunkHeader>, TransportError> {
        sender(topic)
            .initial_max_slice_len(CHUNK_SLOTS)
            .allocation_strategy(AllocationStrategy::Static)
            .create()
            .map_err(|e| self.error("send records", e))
    }

    /// Both ends of the heartbeats.
    ///
    /// # Errors
    /// When iceoryx2 refuses.
    pub fn heartbeats(&self, node: &IpcNode) -> Result<Heartbeats, TransportError> {
        let topic = self.hello_service(node)?;
        Ok(Heartbeats {
            incoming: self.subscriber(&topic, "receive heartbeats")?,
            outgoing: self.publisher(&topic, "send heartbeats")?,
        })
    }

    /// The error of a port or a service of this domain.
    #[must_use]
    pub fn error(&self, what: &'static str, reason: impl Debug) -> TransportError {
        TransportError::Iceoryx {
            what,
            domain: self.name.clone(),
            reason: format!("{reason:?}"),
            files: format!(
                "{} together with /dev/shm/{}*",
                self.root().display(),
                self.prefix()
            ),
        }
    }

    fn service_name(&self, name: &str) -> Result<ServiceName, TransportError> {
        ServiceName::new(name).map_err(|e| self.error("name a service", e))
    }

    /// Tries three times, 50 ms apart: a service that another process is removing is refused for a
    /// moment.
    fn retry<T, E: Debug>(
        &self,
        what: &'static str,
        mut open: impl FnMut() -> Result<T, E>,
    ) -> Result<T, TransportError> {
        for _ in 0..2 {
            if let Ok(opened) = open() {
                return Ok(opened);
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        open().map_err(|e| self.error(what, e))
    }
}

fn held() -> MutexGuard<'static, BTreeMap<PathBuf, File>> {
    HELD.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The number of the user.
fn user() -> u32 {
    rustix::process::geteuid().as_raw()
}

/// A topic of a name with the common quality of service.
fn topic<P: Debug + IceoryxSend + ?Sized, H: Debug + ZeroCopySend>(
    node: &IpcNode,
    name: &ServiceName,
    max_publishers: usize,
    max_subscribers: usize,
) -> Builder<P, H, ipc::Service> {
    node.service_builder(name)
        .publish_subscribe::<P>()
        .user_header::<H>()
        .max_publishers(max_publishers)
        .max_subscribers(max_subscribers)
        .max_nodes(MAX_PORTS)
        .subscriber_max_buffer_size(MAX_QUEUED)
        .subscriber_max_borrowed_samples(MAX_BORROWED)
        .history_size(0)
        .enable_safe_overflow(false)
}

/// A topic of chunks.
fn records(node: &IpcNode, name: &ServiceName) -> Builder<[ChunkSlot], ChunkHeader, ipc::Service> {
    topic(node, name, MAX_RECORD_PORTS, MAX_RECORD_PORTS)
}

fn sender<P: Debug + IceoryxSend + ?Sized, H: Debug + ZeroCopySend>(
    topic: &Topic<P, H>,
) -> PortFactoryPublisher<'_, ipc::Service, P, H> {
    topic
        .publisher_builder()
        .max_loaned_samples(1)
        .backpressure_strategy(BackpressureStrategy::DiscardData)
}

#[cfg(test)]
mod tests;
