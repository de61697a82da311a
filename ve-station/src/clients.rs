//! The clients that are heard: since when, from how far away, and what was sent to them.

use crate::tuning::link::ROUND_TRIPS_OF_SILENCE;
use std::collections::BTreeMap;
use std::fmt;
use std::time::{Duration, Instant};

/// What is known of a client. Time is given in.
#[derive(Debug)]
struct Heard {
    /// Its last sign of life.
    last: Instant,
    /// As it measured it last; `None` before it did.
    round_trip: Option<Duration>,
    /// Sent to it in all.
    bytes: u64,
    /// When it was told of last, and what had been sent by then.
    told: (Instant, u64),
}

/// All clients that have a place.
#[derive(Debug, Default)]
pub struct Clients {
    heard: BTreeMap<u64, Heard>,
}

impl Clients {
    /// A request of a client that has a place.
    pub fn asks(&mut self, client: u64, now: Instant) {
        let new = Heard {
            last: now,
            round_trip: None,
            bytes: 0,
            told: (now, 0),
        };
        self.heard.entry(client).or_insert(new).last = now;
    }

    /// A heartbeat, with the round trip that the client has measured.
    pub fn greets(&mut self, client: u64, round_trip: Option<Duration>, now: Instant) {
        if let Some(heard) = self.heard.get_mut(&client) {
            heard.last = now;
            heard.round_trip = round_trip.or(heard.round_trip);
        }
    }

    /// So many bytes are sent to a client.
    pub fn sent(&mut self, client: u64, bytes: usize) {
        if let Some(heard) = self.heard.get_mut(&client) {
            heard.bytes += bytes as u64;
        }
    }

    /// A client has no place any more.
    pub fn remove(&mut self, client: u64) {
        self.heard.remove(&client);
    }

    /// Forgets the clients that were silent for longer than a time and what the link of each adds.
    pub fn forget_silent(&mut self, timeout: Duration, now: Instant, mut gone: impl FnMut(u64)) {
        self.heard.retain(|&client, heard| {
            let link = ROUND_TRIPS_OF_SILENCE * heard.round_trip.unwrap_or_default();
            let keep = now.duration_since(heard.last) < timeout + link;
            if !keep {
                gone(client);
            }
            keep
        });
    }

    /// The state of each, with its rate since the last call.
    pub fn tell(&mut self, now: Instant) -> Vec<ClientStatus> {
        let status = |(&client, heard): (&u64, &mut Heard)| {
            let (since, before) = std::mem::replace(&mut heard.told, (now, heard.bytes));
            let seconds = now.duration_since(since).as_secs_f64();
            let sent = (heard.bytes - before) as f64;
            ClientStatus {
                client,
                round_trip: heard.round_trip,
                bytes: heard.bytes,
                bytes_per_s: if seconds > 0.0 { sent / seconds } else { 0.0 },
            }
        };
        self.heard.iter_mut().map(status).collect()
    }
}

/// A client, for people.
#[derive(Debug, Clone, PartialEq)]
pub struct ClientStatus {
    /// Its id.
    pub client: u64,
    /// Round-trip time of its link, as it measures it; `None` before its first answer.
    pub round_trip: Option<Duration>,
    /// Sent to it since it came.
    pub bytes: u64,
    /// Sent to it a second, since the last status.
    pub bytes_per_s: f64,
}

impl fmt::Display for ClientStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // The lower half is the time of its start, and so differs.
        write!(f, "{:08x} ", self.client as u32)?;
        if let Some(round_trip) = self.round_trip {
            write!(f, "{:.1} ms, ", 1e3 * round_trip.as_secs_f64())?;
        }
        let (rate, all) = (Bytes(self.bytes_per_s), Bytes(self.bytes as f64));
        write!(f, "{rate}/s, {all}")
    }
}

/// A number of bytes in the largest unit that keeps it above one.
struct Bytes(f64);

impl fmt::Display for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            bytes if bytes < 1e6 => write!(f, "{:.1} kB", 1e-3 * bytes),
            bytes if bytes < 1e9 => write!(f, "{:.1} MB", 1e-6 * bytes),
            bytes => write!(f, "{:.1} GB", 1e-9 * bytes),
        }
    }
}

/// One line about all of them.
#[must_use]
pub fn line(clients: &[ClientStatus]) -> String {
    let each: Vec<String> = clients.iter().map(ToString::to_string).collect();
    match &each[..] {
        [] => "no controller".to_owned(),
        [only] => format!("1 controller: {only}"),
        all => format!("{} controllers: {}", all.len(), all.join("; ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn who_is_connected_is_told_with_distance_and_bytes() {
        let start = Instant::now();
        let mut clients = Clients::default();
        assert_eq!(line(&clients.tell(start)), "no controller");
        let [near, far] = [0x1_0000_00AA, 0x2_0000_00BB];
        clients.asks(near, start);
        clients.asks(far, start);
        clients.sent(near, 3_000_000);
        clients.sent(far, 4208);
        clients.sent(99, 1);
        let round_trip = Some(Duration::from_micros(20_340));
        clients.greets(far, round_trip, start);
        clients.greets(98, round_trip, start);
        let told = clients.tell(start + 2 * SECOND);
        assert_eq!(
            line(&told),
            "2 controllers: 000000aa 1.5 MB/s, 3.0 MB; 000000bb 20.3 ms, 2.1 kB/s, 4.2 kB"
        );
        // The rate is that since the last time; a client that measures nothing new stays as it was.
        clients.greets(far, None, start + 3 * SECOND);
        let told = clients.tell(start + 3 * SECOND);
        assert_eq!((told[0].bytes, told[0].bytes_per_s), (3_000_000, 0.0));
        assert_eq!(told[1].round_trip, round_trip);
        clients.remove(near);
        assert!(line(&clients.tell(start + 3 * SECOND)).starts_with("1 controller: 000000bb"));
    }

    #[test]
    fn who_is_silent_is_forgotten_and_a_far_one_later() {
        let start = Instant::now();
        let mut clients = Clients::default();
        for client in 1..=3 {
            clients.asks(client, start);
        }
        clients.greets(2, Some(SECOND / 5), start);
        clients.greets(3, None, start + SECOND / 2);
        let mut silent = |millis: u64| {
            let mut gone: Vec<u64> = Vec::new();
            let now = start + Duration::from_millis(millis);
            clients.forget_silent(SECOND, now, |client| gone.push(client));
            gone
        };
        assert!(silent(999).is_empty());
        assert_eq!(silent(1001), [1]);
        assert_eq!(silent(1501), [3]);
        assert_eq!(silent(1801), [2]);
        assert!(silent(9999).is_empty());
    }
}
