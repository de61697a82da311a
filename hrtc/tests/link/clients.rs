//! Clients that come, end, die, or do not listen.

use super::*;
use iceoryx2::prelude::ServiceName;
use protocol::records_topic;
use std::sync::mpsc::channel;

/// Its topic is opened once, not instead of the others'.
#[test]
fn who_asks_for_a_file_and_does_not_listen_keeps_no_one_waiting() {
    let (domain, bytes) = (domain("unheard"), torus());
    let served = Served::start(&domain, 79, bytes);
    let mut asks = Tick::start(&domain);
    asks.wait_for_station(79);
    for nobody in 1000..1003 {
        asks.request(RequestKind::File, |request| request.client = nobody);
    }
    until("the questions", || asks.requests.slots() == 64);
    let mut newcomer = Tick::start_as(CLIENT + 1, &domain);
    newcomer.wait_for_station(79);
    newcomer.request(RequestKind::Model, |_| {});
    assert!(!newcomer.answer().is_empty());
    assert!(newcomer.link.stop().is_some());
    assert!(asks.link.stop().is_some());
    served.stop();
}

/// As the reader of a terminal that is paused.
#[test]
fn who_never_reads_what_the_station_tells_keeps_no_controller_waiting() {
    let domain = domain("unread");
    let (begun, begins) = channel();
    let (release, held) = channel::<()>();
    let served = Served::start_telling(&domain, 24, torus(), move |_| {
        let _ = begun.send(());
        let _ = held.recv();
    });
    begins.recv().unwrap();
    let mut tick = Tick::start(&domain);
    tick.wait_for_station(24);
    tick.request(RequestKind::Model, |_| {});
    assert!(!tick.answer().is_empty());
    assert!(tick.link.stop().is_some());
    drop(release);
    served.stop();
}

/// Another program took the name of its topic.
#[test]
fn who_has_no_topic_keeps_no_one_waiting() {
    let domain = domain("no-topic");
    let served = Served::start(&domain, 23, torus());
    let node = domain.node().unwrap();
    let name = ServiceName::new(&records_topic(CLIENT)).unwrap();
    let foreign = node.service_builder(&name).publish_subscribe::<u64>();
    let foreign = foreign.open_or_create().unwrap();
    let mut newcomer = Tick::start_as(CLIENT + 1, &domain);
    newcomer.wait_for_station(23);
    let topic = domain.subscribe_service(&node).unwrap();
    let requests = domain.request_sender(&topic).unwrap();
    let ask = || {
        let mut request = Request::zeroed();
        request.client = CLIENT;
        request.credit = 1;
        request.name = Request::name_hash("torus");
        request.kind = RequestKind::Model as u32;
        requests.send(&request).unwrap();
    };
    until("its place", || {
        ask();
        let status = served.status.lock().unwrap();
        status.iter().any(|of| of.client == CLIENT)
    });
    newcomer.request(RequestKind::Model, |_| {});
    until("an answer to the newcomer", || {
        // It keeps its place by that.
        ask();
        !newcomer.inbox.is_empty()
    });
    assert!(newcomer.link.stop().is_some());
    drop((requests, topic, foreign, node));
    served.stop();
}

#[test]
fn places_of_controllers_that_ended_are_free_at_once() {
    let domain = domain("ended");
    let served = Served::start(&domain, 21, torus());
    let mut next = Tick::start_as(CLIENT, &domain);
    let others = (1..=MAX_CLIENTS as u64).map(|k| Tick::start_as(CLIENT + k, &domain));
    let mut others: Vec<Tick> = others.collect();
    for other in &mut others {
        other.wait_for_station(21);
        other.request(RequestKind::Model, |_| {});
        other.answer();
    }
    // A lost request: the station hears no more of this epoch.
    others[3].next += 1;
    others[3].request(RequestKind::Credit, |_| {});
    for other in others {
        // Its end may take longer on a slow machine than a stop waits: what counts is its place.
        let _ = other.link.stop();
    }
    next.request(RequestKind::Model, |_| {});
    let chunks = next.answer();
    assert_eq!(chunks[0].header.kind, ChunkKind::Model as u32);
    drop(next);
    assert_eq!(served.stop().turned_away, 0);
}

#[test]
fn the_place_of_a_controller_that_died_is_free_when_it_was_silent() {
    let domain = domain("silent");
    let served = Served::start(&domain, 22, torus());
    let mut next = Tick::start_as(CLIENT, &domain);
    next.wait_for_station(22);
    let node = domain.node().unwrap();
    let topic = domain.subscribe_service(&node).unwrap();
    let requests = domain.request_sender(&topic).unwrap();
    let last = CLIENT + MAX_CLIENTS as u64;
    let records = domain.records_service(&node, last).unwrap();
    let records = domain.subscriber(&records, "receive records").unwrap();
    until("an answer to the last", || {
        // Again and again: a slow machine opens so many topics later than it forgets the silent.
        for client in CLIENT + 1..=last {
            let mut request = Request::zeroed();
            request.client = client;
            request.credit = 1;
            request.name = Request::name_hash("torus");
            request.kind = RequestKind::Model as u32;
            requests.send(&request).unwrap();
        }
        thread::sleep(Duration::from_millis(HELLO_PERIOD_MS));
        records.receive().unwrap().is_some()
    });
    let (mut epoch, mut turned_away) = (0, 0);
    until("the model", || {
        (next.next, next.consumed) = (0, 0);
        epoch += 1;
        next.request(RequestKind::Model, |request| request.epoch = epoch);
        let chunks = next.answer();
        let header = chunks[0].header;
        if header.kind == ChunkKind::Model as u32 {
            return true;
        }
        assert_eq!(Refusal::from_code(header.code), Some(Refusal::NoPlace));
        turned_away += 1;
        thread::sleep(Duration::from_millis(HELLO_PERIOD_MS));
        false
    });
    drop(next);
    assert!(turned_away > 0);
    assert_eq!(served.stop().turned_away, turned_away);
}
