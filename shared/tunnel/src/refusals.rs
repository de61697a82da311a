//! Zenoh's log lines of refused connections as sentences for the user: zenoh itself is silent.

use crate::named::{EXPIRED, FOREIGN, NO_CERTIFICATE};
use crate::settings::End;
use tracing::Level;

/// The sentence of a line of iceoryx2's log; `None` of one that tells nothing to a user, as of a
/// topic that both a program and the tunnel open at this moment.
#[must_use]
pub fn of_iceoryx(message: &str) -> Option<&'static str> {
    message
        .contains("the inbox is full")
        .then_some("more arrives than this machine takes; what was dropped is asked for again")
}

/// The parts of zenoh that tell of them, and up to which level.
pub const TARGETS: [(&str, Level); 3] = [
    // A listener's, on what a connection shows.
    (LISTENER, Level::WARN),
    // A listener's, on what a connection says then.
    (ACCEPT, Level::DEBUG),
    // A caller's.
    (CALLER, Level::DEBUG),
];
const LISTENER: &str = "zenoh_link_tls";
const ACCEPT: &str = "zenoh_transport::unicast::establishment::accept";
const CALLER: &str = "zenoh::net::runtime::orchestrator";

/// What to do about keys that do not fit.
const ONE_FOLDER: &str = "copy the keys of both sides from one `ve-station keys DIR`";
/// What to do about keys that are too old.
const AGAIN: &str = "make the keys of both sides again with `ve-station keys DIR`";
/// What to do about keys that are too young.
const CLOCKS: &str = "set the clocks of both machines right";

/// The sentence of a line; `None` of one that tells nothing to a user.
#[must_use]
pub fn sentence(end: &End, target: &str, message: &str) -> Option<String> {
    match end {
        End::Listen(_) if target.starts_with(LISTENER) => {
            let hint = message.find(". Hint:").unwrap_or(message.len());
            Some(shown_to_listener(&message[..hint]))
        }
        End::Listen(_) if target == ACCEPT && !message.starts_with("New transport") => {
            Some("a connection was refused, it does not speak as a link does".to_owned())
        }
        End::Call(_) if target == CALLER => {
            let (_, rest) = message.split_once("Unable to connect to configured peer ")?;
            let (_, rest) = rest.split_once("! ")?;
            let reason = rest.rfind("Retry in").map_or(rest, |at| &rest[..at]);
            Some(shown_to_caller(end, reason))
        }
        _ => None,
    }
}

/// What is wrong with a certificate, in rustls's words.
struct Wrong {
    /// What says so: the other's own words, when it refused ours.
    words: &'static [&'static str],
    what: &'static str,
    remedy: &'static str,
}

/// Certificates of the other side that this one refuses.
const THEIRS: [Wrong; 4] = [
    Wrong {
        words: &["UnknownIssuer", "BadSignature"],
        what: FOREIGN.by,
        remedy: ONE_FOLDER,
    },
    Wrong {
        words: &["certificate expired", ": Expired"],
        what: EXPIRED.by,
        remedy: AGAIN,
    },
    Wrong {
        words: &["not valid yet", "NotValidYet"],
        what: "its certificate is not valid yet",
        remedy: CLOCKS,
    },
    Wrong {
        words: &["not valid for name", "NotValidForName"],
        what: "its certificate does not hold that name",
        remedy: "make keys with that name: `ve-station keys DIR --host NAME`",
    },
];

/// Certificates of this side that the other one refuses.
const OURS: [Wrong; 4] = [
    Wrong {
        words: &["alert: UnknownCA", "alert: DecryptError"],
        what: FOREIGN.of,
        remedy: ONE_FOLDER,
    },
    Wrong {
        words: &["alert: CertificateExpired"],
        what: EXPIRED.of,
        remedy: AGAIN,
    },
    Wrong {
        words: &["alert: BadCertificate"],
        what: "this certificate does not hold the name by which it calls, or another fault",
        remedy: "make keys with that name: `ve-station keys DIR --host NAME`",
    },
    Wrong {
        words: &["alert: CertificateRequired"],
        what: NO_CERTIFICATE.of,
        remedy: ONE_FOLDER,
    },
];

fn find<'a>(table: &'a [Wrong], reason: &str) -> Option<&'a Wrong> {
    let says = |wrong: &&Wrong| wrong.words.iter().any(|words| reason.contains(words));
    table.iter().find(says)
}

fn shown_to_listener(reason: &str) -> String {
    if let Some(Wrong { what, remedy, .. }) = find(&THEIRS, reason) {
        return format!("a controller was refused, {what}: {remedy}");
    }
    if let Some(Wrong { what, remedy, .. }) = find(&OURS, reason) {
        return format!("a controller refused this station, {what}: {remedy}");
    }
    if reason.contains("peer sent no certificates") {
        return format!(
            "a connection was refused, {}: {ONE_FOLDER}",
            NO_CERTIFICATE.by
        );
    }
    if reason.contains("InvalidContentType") {
        return "a connection was refused, it is not encrypted: controllers call tls/ here"
            .to_owned();
    }
    format!("a connection was refused ({})", without_places(reason))
}

fn shown_to_caller(end: &End, reason: &str) -> String {
    let there = end.address();
    if let Some(Wrong { what, remedy, .. }) = find(&THEIRS, reason) {
        return format!("the station at {there} was refused, {what}: {remedy}");
    }
    if let Some(Wrong { what, remedy, .. }) = find(&OURS, reason) {
        return format!("the station at {there} refused this controller, {what}: {remedy}");
    }
    let has = |words: &str| reason.contains(words);
    if has("Connection refused") {
        return format!("no station listens at {there} yet; it is called until one does");
    }
    if has("early eof") || has("corrupt message") || has("deadline has elapsed") {
        return format!(
            "nobody answers at {there} as a station does: is the address right, and is it {}/ there too? It is called again",
            there.carriage().name()
        );
    }
    let reason = without_places(reason);
    format!("the station at {there} cannot be called ({reason}); it is called again")
}

/// Without the places in zenoh's sources.
pub fn without_places(text: &str) -> String {
    let is_place = |word: &str| word.contains(".rs:");
    let mut words: Vec<&str> = Vec::new();
    for word in text.split_whitespace() {
        if is_place(word) && words.last() == Some(&"at") {
            words.pop();
        } else {
            words.push(word);
        }
    }
    words.join(" ").trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::address::Address;

    fn heard(message: &str) -> String {
        let end = End::Listen(Address::to_listen("tls/0.0.0.0").unwrap());
        sentence(&end, "zenoh_link_tls::unicast", message).unwrap()
    }

    fn called(reason: &str) -> String {
        let end = End::Call(Address::to_call("tls/10.0.0.1").unwrap());
        let message = format!(
            "Unable to connect to configured peer tls/10.0.0.1:7447! {reason} at /x/zenoh-link-tls-1.10.2/src/unicast.rs:378.. Retry in 200ms."
        );
        sentence(&end, CALLER, &message).unwrap()
    }

    // The lines are those of zenoh 1.10.2 with rustls 0.23.46.
    #[test]
    fn every_refusal_of_a_listener_has_its_sentence() {
        for (reason, named) in [
            (
                "invalid peer certificate: UnknownIssuer",
                "its certificate is of another authority",
            ),
            (
                "invalid peer certificate: certificate expired: verification time 1 (UNIX), but",
                "has expired",
            ),
            (
                "invalid peer certificate: certificate not valid yet: verification time",
                "not valid yet",
            ),
            (
                "received fatal alert: UnknownCA",
                "does not know the authority",
            ),
            (
                "received fatal alert: DecryptError",
                "does not know the authority",
            ),
            ("received fatal alert: CertificateExpired", "not valid now"),
            ("peer sent no certificates", "shows no certificate"),
            (
                "received corrupt message of type InvalidContentType",
                "is not encrypted",
            ),
            (
                "Timeout during TLS handshake",
                "(Timeout during TLS handshake)",
            ),
        ] {
            let sentence = heard(&format!(
                "{reason}. Hint: increase the system open file limit."
            ));
            assert!(sentence.contains(named), "{sentence}");
            assert!(!sentence.contains("Hint"), "{sentence}");
        }
    }

    #[test]
    fn every_refusal_of_a_caller_has_its_sentence() {
        let bound =
            "Can not create a new TLS link bound to IpAddress(V4(Ipv4Addr([10, 0, 0, 1]))): ";
        for (reason, named) in [
            (
                "invalid peer certificate: UnknownIssuer",
                "was refused, its certificate is of another authority",
            ),
            (
                "invalid peer certificate: certificate expired: verification time 1 (UNIX)",
                "has expired",
            ),
            (
                "invalid peer certificate: certificate not valid for name \"10.0.0.1\"; certificate is",
                "--host",
            ),
            ("received fatal alert: UnknownCA", "refused this controller"),
            (
                "received fatal alert: CertificateRequired",
                "refused this controller",
            ),
            (
                "[tcp/10.0.0.1:7447: Connection refused (os error 111)]",
                "no station listens",
            ),
            ("deadline has elapsed", "nobody answers"),
            (
                "No route to host (os error 113)",
                "(No route to host (os error 113)",
            ),
        ] {
            for reason in [reason.to_owned(), format!("{bound}{reason}")] {
                let sentence = called(&reason);
                assert!(
                    sentence.contains(named.trim_start_matches('(')),
                    "{sentence}"
                );
                assert!(sentence.contains("tls/10.0.0.1:7447"), "{sentence}");
                assert!(!sentence.contains(".rs"), "{sentence}");
            }
        }
    }

    #[test]
    fn other_lines_are_no_sentences() {
        let end = End::Call(Address::to_call("tls/10.0.0.1").unwrap());
        let other = "Try to connect: tls/10.0.0.1:7447: global timeout: 1 s";
        assert_eq!(sentence(&end, CALLER, other), None);
        assert_eq!(
            sentence(&end, LISTENER, "received fatal alert: UnknownCA"),
            None
        );
        let end = End::Listen(Address::to_listen("tcp/127.0.0.1").unwrap());
        let accepted = "New transport link accepted from 1 to 2: ..";
        assert_eq!(sentence(&end, ACCEPT, accepted), None);
        let refused = sentence(&end, ACCEPT, "early eof at /x/unicast.rs:163.");
        assert!(refused.unwrap().contains("does not speak as a link does"));
    }
}
