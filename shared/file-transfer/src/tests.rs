//! Both ends over links that lose, delay, repeat, reorder and damage.

use crate::tuning::{MAX_DAMAGED, MAX_OUTSTANDING, MAX_QUESTIONS, MAX_TIMEOUT};
use crate::{Chunk, Download, DownloadError, FileServer};
use bytemuck::Zeroable;
use proptest::prelude::*;
use protocol::{
    CHUNK_SLOTS, ChunkHeader, ChunkSlot, FILE_CHUNK_BYTES, FileAsk, FileChunk, FileHash,
    MAX_CLIENTS, Request, file_chunks,
};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{RngCore, SeedableRng};
use std::collections::BTreeMap;
use std::time::Duration;

const CLIENT: u64 = 7;
const STATION: u64 = 1;
const MAX_BYTES: u64 = 1 << 20;

/// What a link does, in percent of its messages, and for how long it keeps one, milliseconds.
#[derive(Debug, Clone, Copy)]
struct Link {
    lost: u64,
    repeated: u64,
    damaged: u64,
    least_ms: u64,
    more_ms: u64,
}

/// Messages on their way, by arrival.
struct OnTheWay<T> {
    link: Link,
    random: Xoshiro256PlusPlus,
    all: Vec<(u64, T)>,
}

impl<T: Clone> OnTheWay<T> {
    fn new(link: Link, seed: u64) -> Self {
        let random = Xoshiro256PlusPlus::seed_from_u64(seed);
        Self {
            link,
            random,
            all: Vec::new(),
        }
    }

    fn percent(&mut self, share: u64) -> bool {
        self.random.next_u64() % 100 < share
    }

    fn send(&mut self, now_ms: u64, message: &T) {
        let copies = 1 + u64::from(self.percent(self.link.repeated));
        for _ in 0..copies {
            if !self.percent(self.link.lost) {
                let delay = self.random.next_u64() % (self.link.more_ms + 1);
                let due = now_ms + self.link.least_ms + delay;
                self.all.push((due, message.clone()));
            }
        }
    }

    fn arrived(&mut self, now_ms: u64) -> Vec<T> {
        let (due, later) = std::mem::take(&mut self.all)
            .into_iter()
            .partition(|(due, _)| *due <= now_ms);
        self.all = later;
        due.into_iter().map(|(_, message)| message).collect()
    }
}

fn content(bytes: usize, seed: u64) -> Vec<u8> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut content = vec![0; bytes];
    random.fill_bytes(&mut content);
    content
}

/// A server of this scene.
fn server(station: u64, content: &[u8]) -> FileServer {
    let hash = FileHash::of(content);
    FileServer::new(station, hash, BTreeMap::from([(hash, content.to_vec())]))
}

/// Milliseconds until the scene is whole, or an error; from time to time the station starts anew,
/// as its client hears at once.
fn fetch(
    contents: &[Vec<u8>],
    link: Link,
    seed: u64,
    restart_ms: u64,
) -> Result<(Vec<u8>, u64), DownloadError> {
    let mut starts = 0;
    let mut station = server(0, &contents[0]);
    let mut up = OnTheWay::new(link, seed);
    let mut down: OnTheWay<Chunk> = OnTheWay::new(link, seed ^ 1);
    let mut download = Download::new(CLIENT, 0, FileHash::SCENE, MAX_BYTES, Duration::ZERO);
    for now_ms in 0.. {
        assert!(now_ms < 3_600_000, "an hour, and not whole");
        let now = Duration::from_millis(now_ms);
        if now_ms % restart_ms == restart_ms - 1 {
            starts += 1;
            let last = contents.len() - 1;
            station = server(starts, &contents[last.min(starts as usize)]);
            download.listen_to(starts);
        }
        let mut asked = 0;
        while let Some(request) = download.ask(now) {
            up.send(now_ms, &request);
            asked += FileAsk::of(&request).unwrap().count;
        }
        assert!(u64::from(asked) <= MAX_OUTSTANDING);
        for request in up.arrived(now_ms) {
            station.handle(&request);
        }
        // A few chunks a turn.
        for _ in 0..4 {
            let Some(chunk) = station.poll(CLIENT) else {
                break;
            };
            down.send(now_ms, &chunk);
        }
        for (mut header, mut slots) in down.arrived(now_ms) {
            if down.percent(link.damaged) {
                let place = down.random.next_u64() as usize % 16;
                slots[place].words[place] ^= 1;
                header.code ^= (place as u32) & 1;
            }
            download.take(&header, &slots, now)?;
        }
        if download.is_whole() {
            return Ok((download.take_content(), now_ms));
        }
    }
    unreachable!()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn a_file_comes_whole_over_any_link(
        seed in any::<u64>(),
        bytes in 0..300_000usize,
        [lost, repeated, damaged] in prop::array::uniform3(0..40u64),
        least_ms in 0..200u64,
        more_ms in 0..100u64,
        // Longer than a way there and back, else nobody lives to see an answer.
        restart_ms in 1000..4000u64,
    ) {
        let link = Link { lost, repeated, damaged, least_ms, more_ms };
        let content = content(bytes, seed);
        let fetched = fetch(std::slice::from_ref(&content), link, seed, restart_ms);
        prop_assert_eq!(fetched.map(|(content, _)| content), Ok(content));
    }

    #[test]
    fn a_station_that_restarts_with_another_scene_gives_one_of_them_whole(
        seed in any::<u64>(),
        bytes in prop::collection::vec(0..100_000usize, 2..4),
        lost in 0..20u64,
        restart_ms in 50..500u64,
    ) {
        let link = Link { lost, repeated: 5, damaged: 0, least_ms: 5, more_ms: 10 };
        let contents: Vec<Vec<u8>> =
            bytes.iter().map(|&bytes| content(bytes, seed ^ bytes as u64)).collect();
        let (fetched, _) = fetch(&contents, link, seed, restart_ms).unwrap();
        prop_assert!(contents.contains(&fetched));
    }

    #[test]
    fn whatever_arrives_nothing_panics_and_nothing_wrong_is_whole(
        heads in prop::collection::vec(prop::array::uniform32(any::<u8>()), 1..40),
        [bytes, small] in prop::array::uniform2(0..20_000usize),
        seed in any::<u64>(),
    ) {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let content = content(bytes, seed);
        let mut station = server(STATION, &content);
        let mut download =
            Download::new(CLIENT, STATION, FileHash::SCENE, MAX_BYTES, Duration::ZERO);
        for (k, head) in heads.iter().enumerate() {
            let now = Duration::from_millis(k as u64 * 500);
            while download.ask(now).is_some() {}
            let mut header = ChunkHeader::zeroed();
            bytemuck::bytes_of_mut(&mut header)[32..64].copy_from_slice(head);
            // Often enough right in part.
            (header.client, header.station) = (CLIENT, STATION);
            header.kind = [6, 7][k % 2];
            header.code = [7, 1, 3, small as u32, header.code][k % 5];
            header.sequence = [0, 1, random.next_u64()][k % 3];
            header.epoch %= 8;
            header.count = [header.count, 4096, small as u32][k % 3];
            let slots = [ChunkSlot { words: [random.next_u32(); 16] }; CHUNK_SLOTS];
            header.seal(&slots);
            let _ = download.take(&header, &slots, now);

            let mut request = Request::zeroed();
            random.fill_bytes(bytemuck::bytes_of_mut(&mut request));
            station.handle(&request);
            request.kind = 6;
            (request.model, request.name) = (0, 0);
            station.handle(&request);
            request.sequence %= 6;
            station.handle(&request);
            let mut told = 0;
            while let Some((header, slots)) = station.poll(request.client) {
                prop_assert!(header.is_sound(&slots));
                told += 1;
            }
            prop_assert!(told <= MAX_QUESTIONS as u64 * MAX_OUTSTANDING);
        }
        if download.is_whole() {
            let hash = download.file();
            prop_assert_eq!(Some(FileHash::of(&download.take_content())), hash);
        }
    }
}

#[test]
fn a_perfect_link_carries_each_chunk_once() {
    let link = Link {
        lost: 0,
        repeated: 0,
        damaged: 0,
        least_ms: 10,
        more_ms: 0,
    };
    let content = content(200_000, 1);
    let mut station = server(STATION, &content);
    let mut download = Download::new(CLIENT, STATION, FileHash::SCENE, MAX_BYTES, Duration::ZERO);
    let (mut up, mut down) = (OnTheWay::new(link, 1), OnTheWay::new(link, 2));
    for now_ms in 0..10_000 {
        let now = Duration::from_millis(now_ms);
        while let Some(request) = download.ask(now) {
            up.send(now_ms, &request);
        }
        up.arrived(now_ms).iter().for_each(|r| station.handle(r));
        if let Some(chunk) = station.poll(CLIENT) {
            down.send(now_ms, &chunk);
        }
        for (header, slots) in down.arrived(now_ms) {
            download.take(&header, &slots, now).unwrap();
        }
    }
    assert!(download.is_whole());
    assert_eq!(station.counters().chunks, file_chunks(200_000));
    assert_eq!(download.chunks(), file_chunks(200_000));
    assert_eq!(download.take_content(), content);
}

#[test]
fn what_is_not_there_is_refused_by_name() {
    let now = Duration::ZERO;
    let ask = |station: &mut FileServer, wanted, max_bytes| -> Result<_, DownloadError> {
        let mut download = Download::new(CLIENT, STATION, wanted, max_bytes, now);
        while !download.is_whole() {
            while let Some(request) = download.ask(now) {
                station.handle(&request);
            }
            let (header, slots) = station.poll(CLIENT).unwrap();
            download.take(&header, &slots, now)?;
        }
        Ok(download.take_content())
    };
    let content = content(50_000, 3);
    let mut station = server(STATION, &content);
    let other = FileHash::of(b"other");
    let hash = FileHash::of(&content);
    assert_eq!(ask(&mut station, hash, MAX_BYTES), Ok(content));
    let unknown = ask(&mut station, other, MAX_BYTES).unwrap_err();
    assert_eq!(unknown, DownloadError::Unknown(other));
    assert!(unknown.to_string().contains(&other.to_string()));
    assert_eq!(station.counters().refused, 1);
    let large = ask(&mut station, hash, 20_000).unwrap_err();
    assert!(matches!(
        large,
        DownloadError::TooLarge { most: 20_000, .. }
    ));
    let mut empty = FileServer::empty(STATION);
    let none = ask(&mut empty, FileHash::SCENE, MAX_BYTES).unwrap_err();
    assert_eq!(none, DownloadError::NoScene);
}

#[test]
fn a_content_that_is_not_its_hash_is_thrown_away_and_at_last_an_error() {
    let wrong = vec![1; 3 * FILE_CHUNK_BYTES];
    let hash = FileHash::of(b"what it should be");
    let mut station = FileServer::new(STATION, hash, BTreeMap::from([(hash, wrong)]));
    let mut download = Download::new(CLIENT, STATION, hash, MAX_BYTES, Duration::ZERO);
    let mut taken = Ok(());
    while taken.is_ok() {
        while let Some(request) = download.ask(Duration::ZERO) {
            station.handle(&request);
        }
        let (header, slots) = station.poll(CLIENT).unwrap();
        taken = download.take(&header, &slots, Duration::ZERO);
        assert!(!download.is_whole());
    }
    assert_eq!(taken, Err(DownloadError::Damaged));
    assert!(station.counters().chunks >= u64::from(MAX_DAMAGED) * 3);
}

#[test]
fn clients_and_questions_are_bounded_and_the_others_are_served() {
    let content = content(1 << 20, 4);
    let mut station = server(STATION, &content);
    let ask = |client, question| FileAsk {
        client,
        file: FileHash::SCENE,
        first: 0,
        count: u32::MAX,
        question,
    };
    for question in 0..1000 {
        station.handle(&ask(1, question).request());
    }
    for client in 2..1000 {
        station.handle(&ask(client, 0).request());
    }
    assert_eq!(station.clients().count(), MAX_CLIENTS);
    let chunks = std::iter::from_fn(|| station.poll(1)).count() as u64;
    assert_eq!(chunks, MAX_QUESTIONS as u64 * MAX_OUTSTANDING);
    assert!(station.poll(2).is_some());
    assert_eq!(station.clients().count(), MAX_CLIENTS - 1);
}

#[test]
fn the_silence_before_a_question_is_repeated_follows_the_round_trip() {
    let silence = |round_trip_ms: u64| {
        let content = content(1000 * FILE_CHUNK_BYTES, 5);
        let mut station = server(STATION, &content);
        let mut download = Download::new(CLIENT, STATION, FileHash::SCENE, 1 << 22, Duration::ZERO);
        let mut now_ms = 0;
        for _ in 0..20 {
            let now = Duration::from_millis(now_ms);
            while let Some(request) = download.ask(now) {
                station.handle(&request);
            }
            now_ms += round_trip_ms;
            while let Some((header, slots)) = station.poll(CLIENT) {
                let now = Duration::from_millis(now_ms);
                download.take(&header, &slots, now).unwrap();
            }
        }
        while download.ask(Duration::from_millis(now_ms)).is_some() {}
        assert!(!download.is_whole());
        // From here on nothing comes.
        let asks = |at: u64| download.clone().ask(Duration::from_millis(at)).is_some();
        (now_ms..).find(|&at| asks(at)).unwrap() - now_ms
    };
    let (near, far) = (silence(1), silence(600));
    assert!((200..210).contains(&near), "{near}");
    assert!((600..1000).contains(&far), "{far}");
    assert!(u128::from(silence(20_000)) <= MAX_TIMEOUT.as_millis() + 1);
}

#[test]
fn a_chunk_of_another_client_station_or_file_is_left_alone() {
    let wanted = FileHash::of(b"x");
    let mut download = Download::new(CLIENT, STATION, wanted, MAX_BYTES, Duration::ZERO);
    let request = download.ask(Duration::ZERO).unwrap();
    let question = FileAsk::of(&request).unwrap().question;
    let slots = [ChunkSlot::zeroed(); CHUNK_SLOTS];
    let chunk = |file| FileChunk {
        file,
        index: 0,
        chunks: 1,
        bytes: 1,
        question,
    };
    let foreign = chunk(wanted).header(STATION, CLIENT + 1, &slots);
    let elsewhere = chunk(wanted).header(STATION + 1, CLIENT, &slots);
    let other = chunk(FileHash::of(b"y")).header(STATION, CLIENT, &slots);
    for header in [foreign, elsewhere, other] {
        download.take(&header, &slots, Duration::ZERO).unwrap();
        assert_eq!(download.chunks(), 0);
    }
}

/// Asks two stations until the file is whole; what the second one says comes first.
fn fetch_of_two(
    stations: &mut [FileServer; 2],
    wanted: FileHash,
) -> Result<Vec<u8>, DownloadError> {
    let now = Duration::ZERO;
    let mut download = Download::new(CLIENT, STATION, wanted, MAX_BYTES, now);
    while !download.is_whole() {
        while let Some(request) = download.ask(now) {
            stations.iter_mut().for_each(|of| of.handle(&request));
        }
        for station in stations.iter_mut().rev() {
            while let Some((header, slots)) = station.poll(CLIENT) {
                download.take(&header, &slots, now)?;
            }
        }
    }
    Ok(download.take_content())
}

#[test]
fn of_two_stations_one_is_listened_to() {
    // More than a question asks for.
    let [own, other] = [6, 7].map(|seed| content(40 * FILE_CHUNK_BYTES, seed));
    let mut both = [server(STATION, &own), server(STATION + 1, &other)];
    assert_eq!(fetch_of_two(&mut both, FileHash::SCENE).as_ref(), Ok(&own));
    // The other one has no such file, and says so.
    let hash = FileHash::of(&own);
    assert_eq!(fetch_of_two(&mut both, hash), Ok(own));
    assert!(both[1].counters().refused > 0);
}

#[test]
fn a_station_that_is_restarted_goes_on_where_the_one_before_ended() {
    let now = Duration::ZERO;
    let content = content(40 * FILE_CHUNK_BYTES, 8);
    let mut station = server(STATION, &content);
    let mut download = Download::new(CLIENT, STATION, FileHash::SCENE, MAX_BYTES, now);
    let request = download.ask(now).unwrap();
    station.handle(&request);
    for _ in 0..5 {
        let (header, slots) = station.poll(CLIENT).unwrap();
        download.take(&header, &slots, now).unwrap();
    }
    station = server(STATION + 1, &content);
    download.listen_to(STATION + 1);
    while !download.is_whole() {
        while let Some(request) = download.ask(now) {
            station.handle(&request);
        }
        while let Some((header, slots)) = station.poll(CLIENT) {
            download.take(&header, &slots, now).unwrap();
        }
    }
    assert_eq!(station.counters().chunks, 35);
    assert_eq!(download.take_content(), content);
}
