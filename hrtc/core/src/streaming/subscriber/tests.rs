//! What looks at predicted regions cost, and what an answer says of the round trip.

use super::*;
use crate::streaming::link_meter::Sent;
use bytemuck::Zeroable;

/// Of a thin line on which chunks wait: each takes 40 periods.
fn busy() -> LinkMeter {
    let mut meter = LinkMeter::new(&Horizons::new(1000.0));
    for k in 0..200u64 {
        meter.answered(30, k);
        let mut header = ChunkHeader::zeroed();
        header.station = 1;
        header.sent_us = 1000 * (1000 + k.saturating_sub(3) * 40) as u32;
        meter.arrive(1, Some([Sent::of(&header); 2]), 1100 + k * 40);
        meter.leave(0);
    }
    meter
}

const IDENTITY: Identity = Identity {
    client: 7,
    incarnation: 8,
};

#[test]
fn what_is_looked_at_in_vain_is_counted_too() {
    const REGIONS: u32 = 100;
    let mut subscriber = Subscriber::new(IDENTITY, &Horizons::new(1000.0));
    let (mut cache, meter) = (Cache::new(1 << 20), busy());
    let first = 10_000;
    subscriber.observe(1, first, &meter, &mut cache);
    subscriber.model_is(5);
    let mut entries = u32::MAX;
    cache.go_on_unloading(&mut entries);
    let mut outbox = Outbox::new(2);
    for tick in first..first + 3 {
        outbox.clear();
        outbox.begin_session(0);
        // The hand has left all of them in 50 ticks; an answer takes 70.
        let wanted = (0..REGIONS).map(|k| Unknown {
            key: RegionKey::prefix(k),
            due: tick as f64,
            leaves: tick as f64 + 50.0,
            is_needed: true,
            predicted: tick,
        });
        subscriber.requests(tick, &mut cache, wanted, &meter, &mut outbox);
        assert!(outbox.requests().is_empty(), "all would come late");
        assert_eq!(outbox.looked_at(), REGIONS);
    }
}

/// Periods until a model that does not come is asked for again, where so many are skipped before
/// every tick.
fn periods_awaited(skipped: u64) -> u64 {
    let horizons = Horizons::new(1000.0);
    let mut subscriber = Subscriber::new(IDENTITY, &horizons);
    let (mut cache, meter) = (Cache::new(1 << 20), LinkMeter::new(&horizons));
    let mut outbox = Outbox::new(2);
    // Soon after the start of a run.
    let first = 20;
    for tick in first..first + 10_000 {
        let ticks = tick - first;
        if ticks > 0 {
            subscriber.skip_periods(horizons.waited(skipped));
        }
        subscriber.observe(1, tick, &meter, &mut cache);
        outbox.clear();
        outbox.begin_session(0);
        let wanted = std::iter::empty();
        subscriber.requests(tick, &mut cache, wanted, &meter, &mut outbox);
        let asks = !outbox.requests().is_empty();
        assert!(asks || ticks > 0, "it asks at once");
        if asks && ticks > 0 {
            return ticks * (1 + skipped);
        }
    }
    panic!("it never asks again");
}

#[test]
fn an_answer_is_awaited_as_long_on_a_machine_that_skips_periods() {
    let alone = periods_awaited(0);
    for skipped in [1, 3, 7] {
        let awaited = periods_awaited(skipped);
        let is_same = (alone..=alone + skipped).contains(&awaited);
        assert!(is_same, "{skipped}: {awaited} and {alone}");
    }
}

/// In a stall nothing could be taken in.
#[test]
fn a_stall_counts_as_a_short_wait_only() {
    let counted = [1, 18, 300].map(|skipped| Horizons::new(1000.0).waited(skipped));
    assert_eq!(counted, [1, 18, 20]);
    assert_eq!(Horizons::new(4000.0).waited(300), 80);
}

/// Its first chunk waits for the time of a tick, behind those of other objects.
#[test]
fn a_model_tells_the_round_trip_once() {
    let horizons = Horizons::new(1000.0);
    let mut subscriber = Subscriber::new(IDENTITY, &horizons);
    let (mut cache, meter) = (Cache::new(1 << 20), LinkMeter::new(&horizons));
    subscriber.observe(1, 10, &meter, &mut cache);
    let mut outbox = Outbox::new(1);
    outbox.begin_session(0);
    subscriber.requests(10, &mut cache, std::iter::empty(), &meter, &mut outbox);
    assert_eq!(outbox.requests().len(), 1);
    let told = [(64, 13), (0, 14), (0, 15), (0, 16)];
    let told = told.map(|(slot, now)| subscriber.model_begins(slot, now));
    assert_eq!(told, [None, Some(4), None, None]);
}

/// On a slow machine the chunks of one object may take longer than an answer may.
#[test]
fn what_waits_here_behind_other_objects_is_not_asked_for_again() {
    let horizons = Horizons::new(1000.0);
    let meter = LinkMeter::new(&horizons);
    let asks_again = |waiting: &[u32], is_behind: bool| {
        let mut subscriber = Subscriber::new(IDENTITY, &horizons);
        let (mut cache, mut outbox) = (Cache::new(1 << 20), Outbox::new(1));
        let subject = Subject { object: 3, name: 5 };
        subscriber.begin_session(subject, 0, 10);
        subscriber.observe(1, 10, &meter, &mut cache);
        outbox.begin_session(0);
        subscriber.requests(10, &mut cache, std::iter::empty(), &meter, &mut outbox);
        let epoch = subscriber.epoch;
        let headers = waiting.iter().map(|&object| ChunkHeader {
            station: 1,
            client: IDENTITY.client,
            epoch,
            object,
            ..ChunkHeader::zeroed()
        });
        let headers: Vec<_> = headers.collect();
        for tick in 11..11 + 3 * horizons.answer_timeout {
            subscriber.hear_waiting(headers.iter(), is_behind, (tick, &meter));
            subscriber.observe(1, tick, &meter, &mut cache);
        }
        subscriber.epoch != epoch
    };
    assert!(!asks_again(&[4, 4, 3], false));
    assert!(!asks_again(&[3], true), "a base mesh is loaded first");
    assert!(asks_again(&[4, 4], false), "nothing of it has come");
    assert!(
        asks_again(&[3, 4], false),
        "it is the first, and does not go on"
    );
}
