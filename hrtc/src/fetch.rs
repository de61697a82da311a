//! The scene of a run from the station, for a machine that has none of its files: before the first
//! tick, on the thread that sets up.
//!
//! The manifest comes first, then the files that it names and that the cache does not hold. All of
//! it is checked as a local scene is, when it is loaded. All comes from the station that was heard
//! first, as long as it is heard.

use crate::message::note;
use crate::tuning::{
    FETCH_POLL, FETCH_SILENCE, FETCH_TOLD, OTHER_VERSION_HEARD, SOURCE_SILENCE, STATION_TIMEOUT,
};
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
    let mut source = fetch.wait_for_station()?;
    let (client, station, now) = (options.client, source.station, fetch.now());
    let mut download = Download::new(client, station, FileHash::SCENE, MAX_MANIFEST_BYTES, now);
    fetch.run(&mut download, &mut source)?;
    let manifest = Manifest::read(&download.take_content())?;
    let (mut contents, missing) = kept(&manifest, cache);
    let kept = contents.len();
    let (name, files) = (&manifest.name, manifest.files.len());
    note!("scene {name} of the station {place}: {files} files, {kept} of them kept here");
    fetch.all_bytes = missing.iter().map(|file| file.bytes).sum();
    for file in missing {
        download = download.next(file.hash, file.bytes, fetch.now());
        fetch.run(&mut download, &mut source)?;
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

/// What the heartbeats of a moment say of stations.
#[derive(Debug, Default)]
struct StationsHeard {
    /// Incarnations of stations, in the order of arrival.
    stations: Vec<u64>,
    /// Why a station cannot be spoken to.
    refused: Option<HelloError>,
}

impl StationsHeard {
    /// Takes one in. Controllers of whatever version are none of a fetch's business.
    fn take(&mut self, hello: &Hello) {
        match hello.read() {
            Ok(greeting) if greeting.role == Role::Station => {
                self.stations.push(greeting.incarnation);
            }
            Err(error) if error.role() == Some(Role::Station) => {
                self.refused.get_or_insert(error);
            }
            _ => {}
        }
    }
}

/// Stations that cannot be spoken to. Times are those of the fetch.
#[derive(Debug, Default)]
struct Refused {
    /// Since when one is heard without a longer pause, and when it was last.
    heard: Option<(Duration, Duration)>,
}

impl Refused {
    /// One is heard; whether for so long that none of this version is waited for any more. One that
    /// falls silent is gone, as where it is replaced.
    fn hear(&mut self, now: Duration) -> bool {
        let heard = &mut self.heard;
        heard.take_if(|(_, last)| now.saturating_sub(*last) > STATION_TIMEOUT);
        let (since, last) = heard.get_or_insert((now, now));
        *last = now;
        now.saturating_sub(*since) > OTHER_VERSION_HEARD
    }
}

/// The station whose scene is fetched: of several the one that was heard first. Times are those of
/// the fetch.
#[derive(Debug)]
struct Source {
    /// Its incarnation.
    station: u64,
    /// Its last sign of life.
    heard: Duration,
    /// Whether another one was heard since, and whether that was told.
    has_other: bool,
    has_told: bool,
}

/// What heartbeats change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Change {
    Nothing,
    /// Another station is there too.
    Second,
    /// Another one is the source.
    Instead,
}

impl Source {
    fn new(station: u64, now: Duration) -> Self {
        Self {
            station,
            heard: now,
            has_other: false,
            has_told: false,
        }
    }

    /// Heartbeats of stations of these incarnations. One that is restarted is another one, so that
    /// two are there only when the first is heard again.
    fn hear(&mut self, stations: &[u64], now: Duration) -> Change {
        let other = stations.iter().copied().find(|&of| of != self.station);
        if stations.contains(&self.station) {
            self.heard = now;
            let tells = self.has_other && !self.has_told;
            self.has_told |= tells;
            self.has_other |= other.is_some();
            return if tells {
                Change::Second
            } else {
                Change::Nothing
            };
        }
        let Some(other) = other else {
            return Change::Nothing;
        };
        if now.saturating_sub(self.heard) <= SOURCE_SILENCE {
            self.has_other = true;
            return Change::Nothing;
        }
        *self = Self {
            has_told: self.has_told,
            ..Self::new(other, now)
        };
        Change::Instead
    }
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

    /// The heartbeats that came.
    fn listen(&self) -> Result<StationsHeard, FetchError> {
        let mut heard = StationsHeard::default();
        let received = receive_in_turn(
            || self.hello.incoming.receive(),
            2 * MAX_QUEUED,
            // A copy: its sender could change it still.
            |&hello: &Hello| heard.take(&hello),
        );
        received.map_err(|reason| self.domain.error("receive heartbeats", reason))?;
        Ok(heard)
    }

    /// Waits for the heartbeat of a station.
    fn wait_for_station(&mut self) -> Result<Source, FetchError> {
        let mut refused = Refused::default();
        while self.now() < self.options.station_timeout {
            let heard = self.listen()?;
            let now = self.now();
            if let Some(&station) = heard.stations.first() {
                self.next_told = now + FETCH_TOLD;
                return Ok(Source::new(station, now));
            }
            if let Some(error) = heard.refused
                && refused.hear(now)
            {
                return Err(FetchError::OtherVersion(error));
            }
            if now > self.next_told {
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
    fn run(&mut self, download: &mut Download, source: &mut Source) -> Result<(), FetchError> {
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
            self.follow(download, source)?;
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

    /// Hears who serves the domain, and listens to another station where the first has ended.
    fn follow(&self, download: &mut Download, source: &mut Source) -> Result<(), FetchError> {
        let heard = self.listen()?;
        // Heartbeats may wait behind chunks.
        source.heard = source.heard.max(download.heard());
        match source.hear(&heard.stations, self.now()) {
            Change::Nothing => {}
            Change::Second => note!(
                "another station serves the domain \"{}\" too, and the scene is that of the one that was heard first: stop one of them, or choose another --domain",
                self.domain.name()
            ),
            Change::Instead => {
                download.listen_to(source.station);
                note!(
                    "the station {} was restarted, or another one took its place: the scene is fetched from that one",
                    self.options.place
                );
            }
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

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::{HELLO_PERIOD_MS, PROTOCOL_VERSION};

    fn ms(milliseconds: u64) -> Duration {
        Duration::from_millis(milliseconds)
    }

    #[test]
    fn a_scene_is_of_one_station_until_that_is_silent() {
        let mut source = Source::new(1, ms(0));
        // The other one is heard first, again and again.
        let mut told = Vec::new();
        for k in 0..100 {
            let now = k * HELLO_PERIOD_MS;
            told.push(source.hear(&[2], ms(now)));
            told.push(source.hear(&[], ms(now)));
            told.push(source.hear(&[2, 1], ms(now + 50)));
            assert_eq!(source.station, 1);
        }
        told.retain(|&change| change != Change::Nothing);
        assert_eq!(told, [Change::Second]);
        let heard = source.heard;
        assert_eq!(source.hear(&[2], heard + SOURCE_SILENCE), Change::Nothing);
        let late = heard + SOURCE_SILENCE + ms(1);
        assert_eq!(source.hear(&[], late), Change::Nothing);
        assert_eq!(source.hear(&[2, 1], late), Change::Nothing);
        let late = late + SOURCE_SILENCE + ms(1);
        assert_eq!(source.hear(&[2], late), Change::Instead);
        assert_eq!((source.station, source.heard), (2, late));
    }

    #[test]
    fn a_station_that_is_restarted_is_no_second_one() {
        let mut source = Source::new(1, ms(0));
        let mut told = Vec::new();
        // The last heartbeats of the first may come together with the first of the next.
        told.push(source.hear(&[1, 2], ms(100)));
        for k in 2..100 {
            told.push(source.hear(&[2], ms(k * HELLO_PERIOD_MS)));
        }
        told.retain(|&change| change != Change::Nothing);
        assert_eq!(told, [Change::Instead]);
        assert_eq!(source.station, 2);
    }

    #[test]
    fn only_stations_of_another_version_count_and_only_while_they_are_heard() {
        let mut heard = StationsHeard::default();
        let version = PROTOCOL_VERSION - 1;
        heard.take(&Hello::of_version(version, Role::Controller, 1, 1));
        let swapped = Hello::new(Role::Controller, 1, 1).with_other_byte_order();
        heard.take(&swapped);
        assert_eq!(heard.refused, None);
        heard.take(&Hello::of_version(version, Role::Station, 1, 0));
        let error = heard.refused.unwrap();
        assert!(matches!(error, HelloError::OtherVersion { .. }), "{error}");
        assert!(heard.stations.is_empty());

        let mut refused = Refused::default();
        let mut is_final = |milliseconds| refused.hear(ms(milliseconds));
        assert!((0..=10).all(|k| !is_final(100 * k)));
        // It was silent, and another one is heard.
        let again = 5000;
        assert!((0..=10).all(|k| !is_final(again + 100 * k)));
        assert!(is_final(again + 1100));
    }
}
