//! The scene of a run from the station, for a machine that has none of its files: before the first
//! tick, on the thread that sets up.
//!
//! The manifest comes first, then the files that it names and that the cache does not hold. All of
//! it is checked as a local scene is, when it is loaded.

use crate::message::note;
use crate::tuning::{FETCH_POLL, FETCH_SILENCE, FETCH_TOLD, OTHER_VERSION_HEARD};
use file_transfer::{Download, DownloadError};
use iceoryx2::node::Node;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::ipc;
use protocol::{CHUNK_SLOTS, ChunkHeader, ChunkSlot, FileHash, Hello, HelloError, Role};
use scene_files::{FileCache, MAX_MANIFEST_BYTES, Manifest, ManifestFile, PackageError};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use thiserror::Error;
use transport::{Domain, Heartbeats, MAX_QUEUED, RequestSender, TransportError, receive_in_turn};

/// Why there is no scene: one sentence.
#[derive(Debug, Error)]
pub enum FetchError {
    /// iceoryx2 refused.
    #[error("{0}")]
    Transport(#[from] TransportError),
    /// No heartbeat of a station.
    #[error(
        "no station {place} gave its scene within {seconds} s: start one there (ve-station serve SCENE), or give the scene file here"
    )]
    NoStation {
        /// Where it was looked for.
        place: String,
        /// For how long.
        seconds: u64,
    },
    /// Only stations of another version.
    #[error("the station's scene cannot be fetched: {0}")]
    OtherVersion(HelloError),
    /// The station does not answer.
    #[error(
        "the station {place} was not heard for {} s while its scene was fetched: look at it and at the link, and start again",
        FETCH_SILENCE.as_secs()
    )]
    Silent {
        /// Where it is.
        place: String,
    },
    /// A file cannot be had.
    #[error("{0}")]
    Download(#[from] DownloadError),
    /// The manifest is refused.
    #[error("{0}")]
    Package(#[from] PackageError),
    /// Asked to end.
    #[error("stopped before the station's scene was here")]
    Stopped,
}

/// What the station gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Fetched {
    /// The scene.
    pub manifest: Manifest,
    /// Contents by the names in the scene's text.
    pub contents: BTreeMap<String, Vec<u8>>,
    /// Chunks that came.
    pub chunks: u64,
    /// Files that the cache held.
    pub kept: usize,
}

/// Who fetches, and how.
#[derive(Debug, Clone)]
pub struct FetchOptions {
    /// Id of the client; that of no session.
    pub client: u64,
    /// Where the station is, for messages: "in domain hrtc".
    pub place: String,
    /// How long a station is waited for.
    pub station_timeout: Duration,
    /// Files that were fetched before; `None` keeps none.
    pub cache: Option<FileCache>,
}

/// Fetches the scene of the station in a domain.
///
/// # Errors
/// One sentence: no station, one of another version, one that falls silent or gives no scene.
pub fn fetch(
    domain: &Domain,
    options: &FetchOptions,
    stop: &AtomicBool,
) -> Result<Fetched, FetchError> {
    let place = &options.place;
    let mut cache = options.cache.as_ref();
    let mut fetch = Fetch::open(domain, options, stop)?;
    fetch.wait_for_station()?;
    let client = options.client;
    let mut download = Download::new(client, FileHash::SCENE, MAX_MANIFEST_BYTES, fetch.now());
    fetch.run(&mut download)?;
    let manifest = Manifest::read(&download.take_content())?;
    let (mut contents, missing) = kept(&manifest, cache);
    let kept = contents.len();
    let (name, files) = (&manifest.name, manifest.files.len());
    note!("scene {name} of the station {place}: {files} files, {kept} of them kept here");
    fetch.all_bytes = missing.iter().map(|file| file.bytes).sum();
    for file in missing {
        download = download.next(file.hash, file.bytes, fetch.now());
        fetch.run(&mut download)?;
        fetch.done_bytes += file.bytes;
        let content = download.take_content();
        if let Some(folder) = cache
            && let Err(error) = folder.put(file.kind, file.hash, &content)
        {
            cache = None;
            note!(
                "the scene's files are not kept for the next run, {} cannot be written ({error}): set HRTC_CACHE to a folder that can",
                folder.folder().display()
            );
        }
        contents.insert(file.name(), content);
    }
    let chunks = download.chunks();
    Ok(Fetched {
        manifest,
        contents,
        chunks,
        kept,
    })
}

/// The contents that the cache holds, by name, and the files that it does not.
fn kept<'a>(
    manifest: &'a Manifest,
    cache: Option<&FileCache>,
) -> (BTreeMap<String, Vec<u8>>, Vec<&'a ManifestFile>) {
    let mut contents = BTreeMap::new();
    let mut missing = Vec::new();
    for file in &manifest.files {
        match cache.and_then(|cache| cache.get(file.kind, file.hash)) {
            Some(content) => {
                contents.insert(file.name(), content);
            }
            None => missing.push(file),
        }
    }
    (contents, missing)
}

/// The ports of a fetch and what it has told.
struct Fetch<'a> {
    domain: &'a Domain,
    options: &'a FetchOptions,
    stop: &'a AtomicBool,
    began: Instant,
    /// Bytes of the files that are fetched, and of those that are here.
    all_bytes: u64,
    done_bytes: u64,
    next_told: Duration,
    requests: RequestSender,
    records: Subscriber<ipc::Service, [ChunkSlot], ChunkHeader>,
    hello: Heartbeats,
    // Last, so that it is dropped after its ports.
    _node: Node<ipc::Service>,
}

impl<'a> Fetch<'a> {
    fn open(
        domain: &'a Domain,
        options: &'a FetchOptions,
        stop: &'a AtomicBool,
    ) -> Result<Self, FetchError> {
        let node = domain.node()?;
        // The inbox before the first request, so that no answer is lost.
        let records = domain.records_service(&node, options.client)?;
        let records = domain.subscriber(&records, "receive records")?;
        let requests = domain.request_sender(&domain.subscribe_service(&node)?)?;
        Ok(Self {
            domain,
            options,
            stop,
            began: Instant::now(),
            all_bytes: 0,
            done_bytes: 0,
            next_told: FETCH_TOLD,
            requests,
            records,
            hello: domain.heartbeats(&node)?,
            _node: node,
        })
    }

    fn now(&self) -> Duration {
        self.began.elapsed()
    }

    /// Waits for a little, unless it is asked to end.
    fn pause(&self) -> Result<(), FetchError> {
        if self.stop.load(Ordering::Relaxed) {
            return Err(FetchError::Stopped);
        }
        std::thread::sleep(FETCH_POLL);
        Ok(())
    }

    /// Waits for the heartbeat of a station.
    fn wait_for_station(&mut self) -> Result<(), FetchError> {
        let mut other: Option<(HelloError, Duration)> = None;
        while self.now() < self.options.station_timeout {
            let mut is_here = false;
            let received = receive_in_turn(
                || self.hello.incoming.receive(),
                2 * MAX_QUEUED,
                |hello: &Hello| match hello.read() {
                    Ok(greeting) => is_here |= greeting.role == Role::Station,
                    Err(error) if other.is_none() && error != HelloError::NotHello => {
                        other = Some((error, self.began.elapsed()));
                    }
                    _ => {}
                },
            );
            received.map_err(|reason| self.domain.error("receive heartbeats", reason))?;
            if is_here {
                self.next_told = self.now() + FETCH_TOLD;
                return Ok(());
            }
            if let Some((error, since)) = &other
                && self.now() - *since > OTHER_VERSION_HEARD
            {
                return Err(FetchError::OtherVersion(error.clone()));
            }
            if self.now() > self.next_told {
                self.next_told = self.options.station_timeout;
                note!(
                    "waiting for the station {} and its scene",
                    self.options.place
                );
            }
            self.pause()?;
        }
        Err(FetchError::NoStation {
            place: self.options.place.clone(),
            seconds: self.options.station_timeout.as_secs(),
        })
    }

    /// Asks for a file until it is whole.
    fn run(&mut self, download: &mut Download) -> Result<(), FetchError> {
        while !download.is_whole() {
            let now = self.now();
            while let Some(request) = download.ask(now) {
                let sent = self.requests.send(&request);
                sent.map_err(|reason| self.domain.error("send requests", reason))?;
            }
            self.receive(download)?;
            if download.is_whole() {
                break;
            }
            if now.saturating_sub(download.heard()) > FETCH_SILENCE {
                let place = self.options.place.clone();
                return Err(FetchError::Silent { place });
            }
            if now > self.next_told {
                self.next_told = now + FETCH_TOLD;
                let megabytes = |bytes: u64| bytes as f64 / 1e6;
                let done = megabytes(self.done_bytes + download.bytes());
                match self.all_bytes {
                    0 => note!("fetching the scene: {done:.1} MB"),
                    all => note!("fetching the scene: {done:.1} of {:.1} MB", megabytes(all)),
                }
            }
            self.pause()?;
        }
        Ok(())
    }

    /// Hands over what came.
    fn receive(&self, download: &mut Download) -> Result<(), FetchError> {
        for _ in 0..MAX_QUEUED {
            let sample = self.records.receive();
            let sample = sample.map_err(|reason| self.domain.error("receive records", reason))?;
            let Some(sample) = sample else {
                break;
            };
            let Ok(slots) = <[ChunkSlot; CHUNK_SLOTS]>::try_from(sample.payload()) else {
                continue;
            };
            // Copies: their sender could change the sample still.
            let header = *sample.user_header();
            drop(sample);
            download.take(&header, &slots, self.now())?;
        }
        Ok(())
    }
}
