//! Answers as they lie in chunks.

use super::client::{Client, region_of};
use super::*;

#[test]
fn an_answer_says_which_records_follow_and_a_repeated_one_sends_all() {
    let (mut server, mut client) = (station(1), Client::new(1));
    let full = regions()[0];
    let empty = *regions().last().unwrap();
    let mut asked = |server: &mut Station<Bytes>, action, region| {
        let request = client.regions(action, &[region])[0];
        parts(&ask(server, &mut client, request))
    };
    let (heads, ids, records) = asked(&mut server, RegionAction::Subscribe, empty);
    assert_eq!((heads.len(), ids.len(), records.len()), (1, 0, 0));
    assert!(heads[0].is_first() && heads[0].is_last());
    let (heads, first, records) = asked(&mut server, RegionAction::Subscribe, full);
    assert!(heads[0].is_first() && heads.last().unwrap().is_last());
    assert!(first.len() > 16 && first.iter().all(|&(_, follows)| follows));
    assert!(first.iter().map(|&(id, _)| id).eq(records.iter().copied()));
    // Asked again while held: the same ids, and nothing that it lacks.
    let (heads, again, none) = asked(&mut server, RegionAction::Subscribe, full);
    assert!(heads.last().unwrap().is_last() && none.is_empty());
    assert!(again.iter().all(|&(_, follows)| !follows));
    assert!(again.iter().map(|&(id, _)| id).eq(records.iter().copied()));
    // Whoever lost something gets everything, and it is counted once all the same.
    for _ in 0..2 {
        let (_, ids, all) = asked(&mut server, RegionAction::Resend, full);
        assert_eq!((ids, all), (first.clone(), records.clone()));
    }
    tell(&mut server, client.regions(RegionAction::Release, &[full]));
    let request = client.regions(RegionAction::Subscribe, &[full])[0];
    assert_eq!(parts(&ask(&mut server, &mut client, request)).1, first);
}

#[test]
fn regions_asked_for_together_share_chunks() {
    let (mut server, mut client) = (station(1), Client::new(1));
    let asked = regions();
    tell(&mut server, client.regions(RegionAction::Subscribe, &asked));
    let mut chunks = Vec::new();
    while let Some(chunk) = server.poll(1) {
        client.consumed += 1;
        tell(&mut server, [client.request(RequestKind::Credit)]);
        chunks.push(chunk);
    }
    let (heads, ids, records) = parts(&chunks);
    let firsts: Vec<RegionAt> = heads
        .iter()
        .filter(|h| h.is_first())
        .map(region_of)
        .collect();
    assert_eq!(firsts, asked, "in the order asked");
    assert_eq!(heads.iter().filter(|h| h.is_last()).count(), asked.len());
    // Full to less than a record, a head and an id: all but the last.
    for (header, _) in &chunks[..chunks.len() - 1] {
        assert!(header.count > 4096 - 96, "{} of 4096 bytes", header.count);
    }
    let least = 64 * records.len() + 16 * heads.len() + ids.len();
    assert!(chunks.len() * 4096 < least + ids.len() + chunks.len() * 96 + 4096);
}

#[test]
fn a_large_answer_flows_under_the_credit() {
    let (mut server, mut client) = (station(1), Client::new(1));
    let vsps = open().model_header().vsps;
    let everything = RegionAt {
        region: RegionId::PREFIX,
        tolerance_bits: u32::MAX,
    };
    let request = client.regions(RegionAction::Subscribe, &[everything])[0];
    let (heads, ids, records) = parts(&ask(&mut server, &mut client, request));
    assert!(ids.iter().copied().eq((0..vsps).map(|i| (i, true))));
    assert!(records.iter().copied().eq(0..vsps));
    assert!(heads[0].is_first() && heads[1..].iter().all(|h| !h.is_first()));
    assert!(heads.iter().rev().skip(1).all(|h| !h.is_last()));
    // At tolerance 0 the whole model is the same set, and all of it is there.
    let whole = RegionAt::tolerance(RegionId::WHOLE, 0.0);
    let request = client.regions(RegionAction::Subscribe, &[whole])[0];
    let (_, ids, records) = parts(&ask(&mut server, &mut client, request));
    assert!(ids.iter().copied().eq((0..vsps).map(|i| (i, false))));
    assert!(records.is_empty());
}
