//! Receiving from many senders, each in its turn.

use iceoryx2::port::ReceiveError;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{ZeroCopySend, ipc};
use std::fmt::Debug;

/// Takes at most `most` messages of a topic in; all of them when there are no more.
///
/// iceoryx2 gives those of one sender before it looks at the next, so that one who floods the topic
/// would be the only one heard. But it passes over senders of whose messages as many are borrowed
/// as may be: so all of a round are kept until its end, and each sender has its few in every round.
///
/// # Errors
/// When iceoryx2 cannot receive, as from a sender whose memory cannot be mapped.
pub fn receive_in_turn<P: Copy + Debug + ZeroCopySend>(
    port: &Subscriber<ipc::Service, P, ()>,
    most: usize,
    mut take: impl FnMut(P),
) -> Result<(), ReceiveError> {
    let mut kept = Vec::new();
    for _ in 0..most {
        let mut next = next_of_round(port)?;
        if next.is_none() && !kept.is_empty() {
            kept.clear();
            next = next_of_round(port)?;
        }
        let Some(sample) = next else {
            break;
        };
        // A copy: its sender could change it while it is looked at.
        take(*sample.payload());
        kept.push(sample);
    }
    Ok(())
}

/// A message of a sender that has its turn still.
fn next_of_round<P: Debug + ZeroCopySend>(
    port: &Subscriber<ipc::Service, P, ()>,
) -> Result<Option<iceoryx2::sample::Sample<ipc::Service, P, ()>>, ReceiveError> {
    match port.receive() {
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
                let received = receive_in_turn(&port, most, |taken| {
                    count += 1;
                    heard.extend(taken.read().map(|greeting| greeting.client));
                    // It goes on and on.
                    senders[flooding].send_copy(hello(99)).unwrap();
                });
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
            receive_in_turn(&port, usize::MAX, |_| rest += 1).unwrap();
            assert!(rest >= MAX_QUEUED - 6, "{rest}");
            assert!(!port.has_samples().unwrap());
        }
        drop((senders, port, topic, node));
        domain.remove_files();
    }
}
