//! Receiving from many senders, each in its turn.

use iceoryx2::port::ReceiveError;
use std::ops::Deref;

/// Takes at most `most` messages of a topic in, as `receive` of its port gives them; all of them
/// when there are no more. What a message holds is to be copied before it is looked at: its sender
/// could change it meanwhile.
///
/// iceoryx2 gives those of one sender before it looks at the next, so that one who floods the topic
/// would be the only one heard. But it passes over senders of whose messages as many are borrowed
/// as may be: so all of a round are kept until its end, and each sender has its few in every round.
///
/// # Errors
/// When iceoryx2 cannot receive, as from a sender whose memory cannot be mapped.
pub fn receive_in_turn<S: Deref>(
    mut receive: impl FnMut() -> Result<Option<S>, ReceiveError>,
    most: usize,
    mut take: impl FnMut(&S::Target),
) -> Result<(), ReceiveError> {
    let mut kept = Vec::new();
    for _ in 0..most {
        let mut next = of_round(receive())?;
        if next.is_none() && !kept.is_empty() {
            kept.clear();
            next = of_round(receive())?;
        }
        let Some(sample) = next else {
            break;
        };
        take(&sample);
        kept.push(sample);
    }
    Ok(())
}

/// What was received, if its sender has its turn still.
fn of_round<S>(received: Result<Option<S>, ReceiveError>) -> Result<Option<S>, ReceiveError> {
    match received {
        Err(ReceiveError::ExceedsMaxBorrows) => Ok(None),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::receive_in_turn;
    use crate::{Domain, MAX_QUEUED};
    use protocol::{Hello, Role};

    fn hello(client: u64) -> Hello {
        Hello::new(Role::Controller, 1, client)
    }

    #[test]
    fn one_who_floods_a_topic_silences_nobody() {
        let domain = Domain::new(&format!("turns-{}", std::process::id())).unwrap();
        let node = domain.node().unwrap();
        let topic = domain.hello_service(&node).unwrap();
        let port = domain.subscriber(&topic, "receive heartbeats").unwrap();
        let senders: Vec<_> = (0..4)
            .map(|_| domain.publisher(&topic, "send heartbeats").unwrap())
            .collect();
        // Whoever comes first in iceoryx2's order floods once.
        for flooding in 0..senders.len() {
            for _ in 0..MAX_QUEUED {
                senders[flooding].send_copy(hello(99)).unwrap();
            }
            for (client, sender) in (0..).zip(&senders) {
                if client != flooding as u64 {
                    sender.send_copy(hello(client)).unwrap();
                }
            }
            let mut heard = Vec::new();
            let mut receive = |most: usize| {
                let mut count = 0;
                let received = receive_in_turn(
                    || port.receive(),
                    most,
                    |taken: &Hello| {
                        count += 1;
                        heard.extend(taken.read().map(|greeting| greeting.client));
                        // It goes on and on.
                        senders[flooding].send_copy(hello(99)).unwrap();
                    },
                );
                received.unwrap();
                count
            };
            assert_eq!(receive(6), 6);
            let mut others: Vec<u64> = heard.iter().copied().filter(|&of| of != 99).collect();
            others.sort_unstable();
            let expected = (0..4).filter(|&client| client != flooding as u64);
            assert!(others.iter().copied().eq(expected), "{heard:?}");
            // The rest comes as well.
            let mut rest = 0;
            receive_in_turn(|| port.receive(), usize::MAX, |_| rest += 1).unwrap();
            assert!(rest >= MAX_QUEUED - 6, "{rest}");
            assert!(!port.has_samples().unwrap());
        }
        drop((senders, port, topic, node));
        domain.remove_files();
    }
}
