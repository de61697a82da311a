//! The settings of zenoh for one link: generated whole, so that none can be wrong.

use crate::address::Address;
use crate::key_files::{KeyFiles, Role};
use protocol::MAX_CLIENTS;
use serde_json::{Value, json};

/// Silence after which the other side counts as gone, ms: zenoh sends a sign of life four times in
/// it. Two seconds outlast a lost packet's repetition (TCP's first is after 0.2 to 1 s), and the
/// programs have missed twenty heartbeats by then.
const LEASE_MS: u64 = 2000;
/// Signs of life within a lease.
const SIGNS_OF_LIFE: u64 = 4;
/// Longest time to open a connection, ms: TCP, TLS and zenoh take four round trips, 0.8 s at
/// 200 ms; as much again for a lost packet. A cable that was cut costs no more when it is back.
const OPEN_TIMEOUT_MS: u64 = 2000;
/// Time between two calls of a station that is not there, ms: short beside a call into a cable that
/// is cut, which notices its return after a second, or by its own end.
const RETRY_MS: u64 = 200;
/// Bytes that travel, and are delivered, at once: two chunks, a quarter of a second at 0.25 Mbit/s.
/// Zenoh's own 64 KiB take two seconds there, in which nothing is heard: longer than any timeout.
const BATCH_BYTES: usize = 8192;
/// Such batches that may wait for the wire, zenoh's most: as much as two of its own. What more
/// comes meanwhile is dropped.
const BATCHES: usize = 16;
/// Connections at once: every controller, and its old one until its lease ends.
const MAX_CONNECTIONS: usize = 2 * MAX_CLIENTS;
/// Where iceoryx2's carrier keeps offers and topics.
const CARRIER_KEYS: &str = "iox2/**";

/// What a side of the link does.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum End {
    /// The station's: it waits for controllers.
    Listen(Address),
    /// A controller's: it calls the station.
    Call(Address),
}

impl End {
    /// Its address.
    #[must_use]
    pub fn address(&self) -> &Address {
        let (Self::Listen(address) | Self::Call(address)) = self;
        address
    }

    /// Whose end it is.
    #[must_use]
    pub fn role(&self) -> Role {
        match self {
            Self::Listen(_) => Role::Station,
            Self::Call(_) => Role::Controller,
        }
    }
}

/// The settings of zenoh, as JSON; `keys` of a link that is encrypted.
#[must_use]
pub fn zenoh_settings(end: &End, keys: Option<&KeyFiles>) -> Value {
    let address = end.address().to_string();
    let (listen, call) = match end {
        End::Listen(_) => (vec![address], Vec::new()),
        End::Call(_) => (Vec::new(), vec![address]),
    };
    let mut settings = json!({
        "mode": "peer",
        "listen": { "endpoints": listen, "timeout_ms": 0, "exit_on_failure": true },
        "connect": {
            "endpoints": call,
            "timeout_ms": -1,
            "exit_on_failure": false,
            "retry": {
                "period_init_ms": RETRY_MS,
                "period_max_ms": RETRY_MS,
                "period_increase_factor": 1,
            },
        },
        // Nobody is looked for, and nobody is told of the others.
        "scouting": {
            "multicast": { "enabled": false },
            "gossip": { "autoconnect": { "peer": [], "router": [], "client": [] } },
        },
        "adminspace": { "enabled": false },
        "transport": {
            "unicast": {
                "open_timeout": OPEN_TIMEOUT_MS,
                "accept_timeout": OPEN_TIMEOUT_MS,
                "max_sessions": MAX_CONNECTIONS,
            },
            "link": {
                "protocols": [end.address().carriage().name()],
                "tx": {
                    "lease": LEASE_MS,
                    "keep_alive": SIGNS_OF_LIFE,
                    "batch_size": BATCH_BYTES,
                    "queue": { "size": { "data": BATCHES } },
                },
            },
        },
    });
    if let Some(keys) = keys {
        settings["transport"]["link"]["tls"] = json!({
            "root_ca_certificate": keys.authority,
            "listen_certificate": keys.certificate,
            "listen_private_key": keys.private_key,
            "connect_certificate": keys.certificate,
            "connect_private_key": keys.private_key,
            "enable_mtls": true,
            "verify_name_on_connect": true,
            "close_link_on_expiration": true,
        });
        settings["access_control"] = access_control(end.role().other());
    }
    settings
}

/// Takes the caller's certificate out of its settings: a listener that asks for one refuses it.
#[cfg(feature = "engine")]
pub(crate) fn show_no_certificate(settings: &mut Value) {
    let tls = &mut settings["transport"]["link"]["tls"];
    tls["enable_mtls"] = json!(false);
    tls["connect_certificate"] = Value::Null;
    tls["connect_private_key"] = Value::Null;
}

/// Topics cross to the other role only. A calling zenoh trusts the public authorities too: none of
/// them gives out this name, which is no host's.
fn access_control(other: Role) -> Value {
    json!({
        "enabled": true,
        "default_permission": "deny",
        "rules": [{
            "id": "topics",
            "permission": "allow",
            "flows": ["ingress", "egress"],
            "messages": [
                "put", "delete", "declare_subscriber", "query", "reply", "declare_queryable",
                "liveliness_token", "liveliness_query", "declare_liveliness_subscriber",
            ],
            "key_exprs": [CARRIER_KEYS],
        }],
        "subjects": [{
            "id": "other",
            "link_protocols": ["tls"],
            "cert_common_names": [other.common_name()],
        }],
        "policies": [{ "rules": ["topics"], "subjects": ["other"] }],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn listen(address: &str) -> End {
        End::Listen(Address::to_listen(address).unwrap())
    }

    fn call(address: &str) -> End {
        End::Call(Address::to_call(address).unwrap())
    }

    #[test]
    fn nobody_is_found_by_scouting_and_only_one_protocol_is_spoken() {
        for end in [listen("tcp/127.0.0.1"), call("tcp/127.0.0.1")] {
            let settings = zenoh_settings(&end, None);
            assert_eq!(settings["scouting"]["multicast"]["enabled"], false);
            assert_eq!(
                settings["scouting"]["gossip"]["autoconnect"]["peer"],
                json!([])
            );
            assert_eq!(settings["transport"]["link"]["protocols"], json!(["tcp"]));
            assert_eq!(settings["adminspace"]["enabled"], false);
        }
    }

    #[test]
    fn one_side_listens_and_the_other_calls() {
        let settings = zenoh_settings(&listen("tcp/127.0.0.1:7"), None);
        assert_eq!(settings["listen"]["endpoints"], json!(["tcp/127.0.0.1:7"]));
        assert_eq!(settings["connect"]["endpoints"], json!([]));
        // A port that is taken is an error and not a link without a listener.
        assert_eq!(settings["listen"]["exit_on_failure"], true);
        let settings = zenoh_settings(&call("tcp/127.0.0.1:7"), None);
        assert_eq!(settings["listen"]["endpoints"], json!([]));
        assert_eq!(settings["connect"]["endpoints"], json!(["tcp/127.0.0.1:7"]));
        // A station that is not there is called again without end.
        assert_eq!(settings["connect"]["timeout_ms"], -1);
        assert_eq!(settings["connect"]["exit_on_failure"], false);
    }

    #[test]
    fn both_sides_show_certificates_and_let_only_the_other_role_in() {
        let keys = KeyFiles::in_folder(Path::new("/keys")).unwrap();
        for (end, other) in [
            (listen("tls/0.0.0.0"), "hrtc-controller"),
            (call("tls/station"), "hrtc-station"),
        ] {
            let settings = zenoh_settings(&end, Some(&keys));
            let tls = &settings["transport"]["link"]["tls"];
            assert_eq!(tls["enable_mtls"], true);
            assert_eq!(tls["verify_name_on_connect"], true);
            assert_eq!(tls["close_link_on_expiration"], true);
            assert_eq!(tls["root_ca_certificate"], "/keys/authority.pem");
            assert_eq!(settings["transport"]["link"]["protocols"], json!(["tls"]));
            let access = &settings["access_control"];
            assert_eq!(access["default_permission"], "deny");
            let subjects = access["subjects"].as_array().unwrap();
            assert_eq!(subjects.len(), 1);
            assert_eq!(subjects[0]["cert_common_names"], json!([other]));
        }
    }
}
