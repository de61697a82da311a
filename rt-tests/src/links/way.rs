//! One direction of a link: what becomes of a packet between two hosts. Time is a value, so it runs
//! on any clock.
//!
//! A packet waits until those before it are on the wire (a token bucket of one packet), unless the
//! queue before the wire is full; then it travels for the delay and a random part of the jitter.
//! Packets do not overtake each other.
//!
//! Somebody may sit at the wire: who changes packets so that no checksum shows it, and who sends
//! what was sent once more.

use rand::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::Serialize;
use std::collections::VecDeque;

/// Time that the queue before a wire holds at the least, seconds: that of a router at home; and at
/// the least so many bytes, 16 packets of 1500, without which TCP cannot fill a slow wire.
const QUEUE_S: f64 = 0.1;
const QUEUE_BYTES: f64 = 24_000.0;
/// Time after which a packet arrives that is sent once more, seconds: later than any that the two
/// ends would send again by themselves.
const REPLAY_S: f64 = 1.0;
/// Number of TCP in a packet of IP.
const TCP: u8 = 6;

/// A link between two hosts, the same in both directions.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Shape {
    /// Round-trip time of the wire, half of it each way, seconds.
    pub round_trip_s: f64,
    /// Largest random part of a packet's time beside, seconds.
    pub jitter_s: f64,
    /// Bandwidth of each direction, bits a second.
    pub bits_per_s: f64,
    /// Share of the packets that are lost, 0 to 1.
    pub loss: f64,
    /// Share of the packets of which two words change places, 0 to 1; of those of TCP that carry
    /// something.
    pub damaged: f64,
    /// Share of the packets that arrive twice, the second time a second later, 0 to 1.
    pub replayed: f64,
}

impl Shape {
    /// Longest time that a packet may wait for the wire and be on it, seconds: at the least a round
    /// trip, so that one connection can fill it.
    fn queue_s(&self) -> f64 {
        let of_bytes_s = 8.0 * QUEUE_BYTES / self.bits_per_s;
        self.round_trip_s.max(QUEUE_S).max(of_bytes_s)
    }
}

/// Packets, and their bytes with the headers of IP.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Carried {
    /// Packets sent.
    pub packets: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Packets that arrived.
    pub arrived_packets: u64,
    /// Their bytes.
    pub arrived_bytes: u64,
    /// Packets lost at random.
    pub lost: u64,
    /// Packets for which the queue before the wire had no room.
    pub dropped: u64,
    /// Packets lost with the cable cut.
    pub cut: u64,
    /// Packets that were changed.
    pub damaged: u64,
    /// Packets that arrived once more.
    pub replayed: u64,
}

/// One direction.
#[derive(Debug)]
pub struct Way {
    shape: Shape,
    random: Xoshiro256PlusPlus,
    is_cut: bool,
    /// When the wire is free.
    free_ns: u64,
    /// When the newest packet arrives.
    newest_ns: u64,
    /// Packets under way, with the time at which each arrives.
    under_way: VecDeque<(u64, Vec<u8>)>,
    /// Those that will arrive once more, likewise.
    again: VecDeque<(u64, Vec<u8>)>,
    /// What became of all packets.
    pub carried: Carried,
}

fn ns(seconds: f64) -> u64 {
    (seconds * 1e9).round() as u64
}

/// Lets two words of what a packet of TCP carries change places, which leaves its checksum right;
/// `luck`, from 0 to 1, chooses them. Whether it could.
fn damage(packet: &mut [u8], luck: f64) -> bool {
    let byte = |at: usize| packet.get(at).copied().unwrap_or(0);
    let of_ip = 4 * usize::from(byte(0) & 15);
    let of_tcp = 4 * usize::from(byte(of_ip + 12) >> 4);
    if byte(9) != TCP {
        return false;
    }
    let carried = packet.get_mut(of_ip + of_tcp..).unwrap_or_default();
    let words = carried.len() / 2;
    let first = (luck * words as f64) as usize;
    let word = |at: usize| [carried[2 * at], carried[2 * at + 1]];
    let Some(other) = (first + 1..words).find(|&at| word(at) != word(first)) else {
        return false;
    };
    for half in [0, 1] {
        carried.swap(2 * first + half, 2 * other + half);
    }
    true
}

impl Way {
    /// Both directions of a link; a seed gives the same losses and jitter to the same packets.
    #[must_use]
    pub fn both(shape: Shape, seed: u64) -> [Self; 2] {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        [(); 2].map(|()| {
            let own = random.clone();
            random.jump();
            Self {
                shape,
                random: own,
                is_cut: false,
                free_ns: 0,
                newest_ns: 0,
                under_way: VecDeque::new(),
                again: VecDeque::new(),
                carried: Carried::default(),
            }
        })
    }

    /// A packet is sent.
    pub fn send(&mut self, packet: &[u8], now_ns: u64) {
        // Of every packet, so that one that is dropped does not change the others.
        let [luck, jitter, harm, place, replay] = [(); 5].map(|()| self.random.random::<f64>());
        self.carried.packets += 1;
        self.carried.bytes += packet.len() as u64;
        if self.is_cut {
            self.carried.cut += 1;
            return;
        }
        let on_wire_ns = ns(8.0 * packet.len() as f64 / self.shape.bits_per_s);
        let free_ns = self.free_ns.max(now_ns) + on_wire_ns;
        if free_ns - now_ns > ns(self.shape.queue_s()) {
            self.carried.dropped += 1;
            return;
        }
        self.free_ns = free_ns;
        if luck < self.shape.loss {
            self.carried.lost += 1;
            return;
        }
        let travel_s = 0.5 * self.shape.round_trip_s + jitter * self.shape.jitter_s;
        self.newest_ns = self.newest_ns.max(self.free_ns + ns(travel_s));
        let mut packet = packet.to_vec();
        if replay < self.shape.replayed {
            let again_ns = self.newest_ns + ns(REPLAY_S);
            self.again.push_back((again_ns, packet.clone()));
        }
        if harm < self.shape.damaged && damage(&mut packet, place) {
            self.carried.damaged += 1;
        }
        self.under_way.push_back((self.newest_ns, packet));
    }

    /// When the next packet arrives.
    #[must_use]
    pub fn next_ns(&self) -> Option<u64> {
        let fronts = [&self.under_way, &self.again].map(VecDeque::front);
        fronts.into_iter().flatten().map(|(at_ns, _)| *at_ns).min()
    }

    /// The next packet that has arrived, and when it should have.
    pub fn arrived(&mut self, now_ns: u64) -> Option<(u64, Vec<u8>)> {
        let next_ns = self.next_ns().filter(|&next_ns| next_ns <= now_ns)?;
        if self
            .under_way
            .front()
            .is_none_or(|(at_ns, _)| *at_ns > next_ns)
        {
            self.carried.replayed += 1;
            return self.again.pop_front();
        }
        let next = self.under_way.pop_front();
        if let Some((_, packet)) = &next {
            self.carried.arrived_packets += 1;
            self.carried.arrived_bytes += packet.len() as u64;
        }
        next
    }

    /// From now on nobody changes packets or sends them once more.
    pub fn calm(&mut self) {
        (self.shape.damaged, self.shape.replayed) = (0.0, 0.0);
        self.again.clear();
    }

    /// Cuts the cable, with everything that is under way, or mends it.
    pub fn cut(&mut self, is_cut: bool) {
        self.is_cut = is_cut;
        if is_cut {
            self.carried.cut += self.under_way.len() as u64;
            self.under_way.clear();
            self.again.clear();
            // Nothing is before what is sent next.
            (self.free_ns, self.newest_ns) = (0, 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLEAN: Shape = Shape {
        round_trip_s: 0.02,
        jitter_s: 0.0,
        bits_per_s: 10e6,
        loss: 0.0,
        damaged: 0.0,
        replayed: 0.0,
    };
    /// On the wire of [`CLEAN`] for a millisecond.
    const PACKET: [u8; 1250] = [7; 1250];
    const MS: u64 = 1_000_000;

    fn way(shape: Shape) -> Way {
        let [way, _] = Way::both(shape, 1);
        way
    }

    /// When each packet arrives, ns; every one is taken at its time.
    fn arrivals(way: &mut Way) -> Vec<u64> {
        std::iter::from_fn(|| way.arrived(way.next_ns()?))
            .map(|(at_ns, _)| at_ns)
            .collect()
    }

    #[test]
    fn a_packet_takes_its_time_on_the_wire_and_half_a_round_trip() {
        let mut way = way(CLEAN);
        way.send(&PACKET, 5 * MS);
        assert_eq!(way.next_ns(), Some(16 * MS));
        assert_eq!(way.arrived(16 * MS - 1), None);
        assert_eq!(way.arrived(16 * MS), Some((16 * MS, PACKET.to_vec())));
        assert_eq!(way.arrived(u64::MAX), None);
        assert_eq!(way.carried.arrived_bytes, PACKET.len() as u64);
    }

    #[test]
    fn packets_sent_at_once_arrive_at_the_rate_of_the_wire() {
        let mut way = way(CLEAN);
        for _ in 0..5 {
            way.send(&PACKET, 0);
        }
        // Sent when the wire is free again: it waits for nobody.
        way.send(&PACKET, 100 * MS);
        let expected = [11, 12, 13, 14, 15, 111].map(|ms| ms * MS);
        assert_eq!(arrivals(&mut way), expected);
    }

    #[test]
    fn a_full_queue_drops_what_comes_last_and_has_room_again_as_it_empties() {
        let mut way = way(CLEAN);
        // 0.1 s of the wire.
        for number in 0..150_u8 {
            way.send(&[number; 1250], 0);
        }
        assert_eq!(way.carried.dropped, 50);
        way.send(&PACKET, 10 * MS);
        assert_eq!(way.carried.dropped, 50);
        let numbers: Vec<u8> = std::iter::from_fn(|| way.arrived(u64::MAX))
            .map(|(_, packet)| packet[0])
            .collect();
        let expected: Vec<u8> = (0..100).chain([7]).collect();
        assert_eq!(numbers, expected);
    }

    #[test]
    fn jitter_stays_within_its_limits_and_overtakes_nobody() {
        let mut way = way(Shape {
            jitter_s: 0.005,
            ..CLEAN
        });
        for number in 0..1000 {
            way.send(&PACKET, number * 3 * MS);
        }
        let arrivals = arrivals(&mut way);
        assert!(arrivals.is_sorted());
        let late = (0..)
            .zip(&arrivals)
            .map(|(number, at)| at - number * 3 * MS);
        let late: Vec<u64> = late.collect();
        assert!(late.iter().all(|late| (11 * MS..=16 * MS).contains(late)));
        assert!(late.iter().any(|&late| late > 15 * MS) && late.iter().any(|&late| late < 12 * MS));
    }

    #[test]
    fn losses_follow_the_share_and_the_seed_and_differ_between_directions() {
        let shape = Shape { loss: 0.1, ..CLEAN };
        let lost = |seed: u64| {
            Way::both(shape, seed).map(|mut way| {
                for number in 0..10_000_u64 {
                    way.send(&number.to_le_bytes(), number * MS);
                }
                let arrived = std::iter::from_fn(|| way.arrived(u64::MAX));
                let arrived: Vec<Vec<u8>> = arrived.map(|(_, packet)| packet).collect();
                assert_eq!(way.carried.lost + arrived.len() as u64, 10_000);
                arrived
            })
        };
        let [there, back] = lost(1);
        // 1000 expected, standard deviation 30.
        for arrived in [&there, &back] {
            assert!((8800..9200).contains(&arrived.len()), "{}", arrived.len());
        }
        assert_ne!(there, back);
        assert_eq!([there.clone(), back], lost(1));
        let [other, _] = lost(2);
        assert_ne!(there, other);
    }

    #[test]
    fn a_cut_loses_what_is_under_way_and_what_is_sent_until_it_is_mended() {
        let mut way = way(CLEAN);
        way.send(&PACKET, 0);
        way.cut(true);
        way.send(&PACKET, MS);
        assert_eq!((way.next_ns(), way.carried.cut), (None, 2));
        way.cut(false);
        way.send(&PACKET, 50 * MS);
        assert_eq!(arrivals(&mut way), [61 * MS]);
        assert_eq!(way.carried.packets, 3);
    }

    #[test]
    fn nothing_waits_after_a_cut_for_what_it_lost() {
        let mut way = way(CLEAN);
        for _ in 0..90 {
            way.send(&PACKET, 0);
        }
        way.cut(true);
        way.cut(false);
        way.send(&PACKET, 2 * MS);
        assert_eq!(way.next_ns(), Some(13 * MS));
    }

    /// A packet of TCP that carries these bytes.
    fn of_tcp(carried: &[u8]) -> Vec<u8> {
        let mut packet = vec![0; 44];
        (packet[0], packet[9], packet[32]) = (0x45, TCP, 0x60);
        packet.extend(carried);
        packet
    }

    /// The sum of all words of two bytes: what a checksum sees.
    fn sum(packet: &[u8]) -> u32 {
        let words = packet.chunks(2);
        words
            .map(|word| u32::from(word[0]) << 8 | u32::from(*word.get(1).unwrap_or(&0)))
            .sum()
    }

    #[test]
    fn a_changed_packet_has_the_checksum_of_the_one_that_was_sent() {
        let mut way = way(Shape {
            damaged: 1.0,
            ..CLEAN
        });
        let carried: Vec<u8> = (0..=100).collect();
        let sent = of_tcp(&carried);
        for _ in 0..50 {
            way.send(&sent, 0);
        }
        let arrived: Vec<Vec<u8>> = std::iter::from_fn(|| way.arrived(u64::MAX))
            .map(|(_, packet)| packet)
            .collect();
        let changed = arrived.iter().filter(|&packet| *packet != sent).count();
        assert_eq!(changed as u64, way.carried.damaged);
        // All but those whose last word was chosen, which has none after it.
        assert!(changed > 40, "{changed}");
        for packet in &arrived {
            assert_eq!(packet[..44], sent[..44]);
            assert_eq!(sum(packet), sum(&sent));
        }
        // Nothing is carried, or all words are the same, or it is no TCP.
        let mut other = of_tcp(&carried);
        other[9] = 17;
        let harmless = [
            of_tcp(&[]),
            of_tcp(&[7; 100]),
            other,
            vec![0x45],
            Vec::new(),
        ];
        for packet in harmless {
            way.send(&packet, 0);
            assert_eq!(way.arrived(u64::MAX), Some((way.newest_ns, packet)));
        }
    }

    #[test]
    fn a_packet_that_is_sent_once_more_arrives_a_second_later_as_it_was() {
        let mut way = way(Shape {
            damaged: 1.0,
            replayed: 1.0,
            ..CLEAN
        });
        let sent = of_tcp(&[1, 2, 3, 4]);
        way.send(&sent, 0);
        way.send(&PACKET, 20 * MS);
        let at = arrivals(&mut way);
        assert_eq!(at.len(), 4);
        assert!(at.is_sorted(), "{at:?}");
        assert_eq!([at[2] - at[0], at[3] - at[1]], [1000 * MS; 2]);
        assert_eq!(way.carried.replayed, 2);
        assert_eq!(way.carried.arrived_packets, 2);
        way.send(&sent, 0);
        let _ = way.arrived(u64::MAX);
        assert_eq!(way.arrived(u64::MAX).map(|(_, packet)| packet), Some(sent));
    }
}
