//! Where a tunnel listens, or whom it calls: `tls/HOST:PORT`, or `tcp/HOST:PORT` on one machine.

use std::fmt;
use std::net::{IpAddr, Ipv6Addr};
use std::str::FromStr;
use thiserror::Error;

/// The port of an address that names none: zenoh's own.
pub const DEFAULT_PORT: u16 = 7447;

/// How the bytes travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Carriage {
    /// Plain, for one machine only.
    Tcp,
    /// Encrypted, both sides with a certificate.
    Tls,
}

impl Carriage {
    /// Its name in an address.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Tcp => "tcp",
            Self::Tls => "tls",
        }
    }
}

/// An address of a link.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Address {
    carriage: Carriage,
    host: Host,
    port: u16,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Host {
    Ip(IpAddr),
    Name(String),
}

/// Why an address is refused: one sentence each.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum AddressError {
    /// Not of the form.
    #[error(
        "\"{0}\" is no address of a link: write tls/HOST or tls/HOST:PORT, as tls/192.168.1.10:7447, or tcp/127.0.0.1:7447 on one machine; to listen also tls/[IPV6]:PORT"
    )]
    Form(String),
    /// Plain bytes would leave the machine.
    #[error(
        "\"{address}\" is refused: off this machine a link needs keys; make them with `ve-station keys DIR`, copy them as it says, and write {}",
        .address.with_tls()
    )]
    Unprotected {
        /// The address.
        address: Address,
    },
    /// Encrypted, by an IPv6 address: zenoh asks for a certificate of `[IPV6]`, which names nobody.
    #[error(
        "\"{0}\" is refused: no encrypted link is called by an IPv6 address; call the station by the name for which `ve-station keys DIR --host NAME` was run, or by an IPv4 address"
    )]
    Ipv6(Address),
    /// No machine has this address.
    #[error("\"{0}\" names no machine to call: write the station's name or address")]
    NoMachine(Address),
}

impl Address {
    /// An address to listen on.
    ///
    /// # Errors
    /// When it is of another form, or plain and not of this machine alone.
    pub fn to_listen(typed: &str) -> Result<Self, AddressError> {
        let address: Self = typed.parse()?;
        address.protected()
    }

    /// An address to call.
    ///
    /// # Errors
    /// When it is of another form, plain and not of this machine alone, no machine's, or an IPv6
    /// address of an encrypted link.
    pub fn to_call(typed: &str) -> Result<Self, AddressError> {
        let address: Self = typed.parse()?;
        let is_none = |ip: &IpAddr| ip.is_unspecified() || ip.is_multicast();
        if matches!(&address.host, Host::Ip(ip) if is_none(ip)) || address.port == 0 {
            return Err(AddressError::NoMachine(address));
        }
        // Also where it would have to be encrypted.
        let is_plain = address.carriage == Carriage::Tcp && address.is_loopback();
        if matches!(address.host, Host::Ip(IpAddr::V6(_))) && !is_plain {
            return Err(AddressError::Ipv6(address));
        }
        address.protected()
    }

    /// How the bytes travel.
    #[must_use]
    pub fn carriage(&self) -> Carriage {
        self.carriage
    }

    /// Whether only this machine has it.
    #[must_use]
    pub fn is_loopback(&self) -> bool {
        match &self.host {
            Host::Ip(ip) => ip.to_canonical().is_loopback(),
            Host::Name(name) => name == "localhost",
        }
    }

    fn protected(self) -> Result<Self, AddressError> {
        if self.carriage == Carriage::Tcp && !self.is_loopback() {
            return Err(AddressError::Unprotected { address: self });
        }
        Ok(self)
    }

    fn with_tls(&self) -> Self {
        Self {
            carriage: Carriage::Tls,
            ..self.clone()
        }
    }
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(typed: &str) -> Result<Self, AddressError> {
        let parsed = || {
            let (carriage, rest) = match typed.split_once('/')? {
                ("tcp", rest) => (Carriage::Tcp, rest),
                ("tls", rest) => (Carriage::Tls, rest),
                _ => return None,
            };
            let (host, port) = host_and_port(rest)?;
            Some(Self {
                carriage,
                host,
                port,
            })
        };
        parsed().ok_or_else(|| AddressError::Form(typed.to_owned()))
    }
}

/// As zenoh writes it.
impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (carriage, port) = (self.carriage.name(), self.port);
        match &self.host {
            Host::Ip(IpAddr::V6(ip)) => write!(f, "{carriage}/[{ip}]:{port}"),
            Host::Ip(IpAddr::V4(ip)) => write!(f, "{carriage}/{ip}:{port}"),
            Host::Name(name) => write!(f, "{carriage}/{name}:{port}"),
        }
    }
}

/// Every host passes that a certificate may name, so also `_`; nothing passes that zenoh would read
/// as a setting of the link (`?`, `#`, `;`).
fn host_and_port(text: &str) -> Option<(Host, u16)> {
    if let Some(rest) = text.strip_prefix('[') {
        let (ip, rest) = rest.split_once(']')?;
        let ip = ip.parse::<Ipv6Addr>().ok()?;
        return Some((Host::Ip(ip.into()), port(rest)?));
    }
    let end = text.find(':').unwrap_or(text.len());
    let (name, rest) = text.split_at(end);
    let is_part = |c: char| c.is_ascii_alphanumeric() || ".-_".contains(c);
    if name.is_empty() || !name.chars().all(is_part) {
        return None;
    }
    let ip = name.parse::<IpAddr>().map(Host::Ip);
    let host = ip.unwrap_or_else(|_| Host::Name(name.to_ascii_lowercase()));
    Some((host, port(rest)?))
}

/// What follows a host: nothing, or a colon and the port.
fn port(rest: &str) -> Option<u16> {
    if rest.is_empty() {
        return Some(DEFAULT_PORT);
    }
    let digits = rest.strip_prefix(':')?;
    let is_number = digits.chars().all(|c| c.is_ascii_digit());
    is_number.then(|| digits.parse().ok()).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_written_as_it_was_typed_with_its_port() {
        for (typed, written) in [
            ("tls/192.168.1.10:7447", "tls/192.168.1.10:7447"),
            ("tls/0.0.0.0", "tls/0.0.0.0:7447"),
            ("tls/Station.lab:1", "tls/station.lab:1"),
            ("tls/ve_station", "tls/ve_station:7447"),
            ("tls/[::]:7447", "tls/[::]:7447"),
            ("tcp/[::1]", "tcp/[::1]:7447"),
            ("tcp/localhost:65535", "tcp/localhost:65535"),
        ] {
            let address = Address::to_listen(typed).unwrap();
            assert_eq!(address.to_string(), written);
            assert_eq!(written.parse(), Ok(address));
        }
    }

    #[test]
    fn what_is_no_address_is_refused_in_a_sentence_that_shows_one() {
        for typed in [
            "",
            "tls/",
            "tls",
            "192.168.1.10:7447",
            "udp/192.168.1.10:7447",
            "TLS/192.168.1.10",
            "tls/:7447",
            "tls/a:b",
            "tls/a:+1",
            "tls/a:65536",
            "tls/a:",
            "tls/::1:7447",
            "tls/[::1",
            "tls/[a]:1",
            "tls/a b",
            "tls/a/b",
            // Settings of zenoh's.
            "tls/a:1?rel=0",
            "tls/a:1#verify_name_on_connect=false",
            "tls/a;b",
        ] {
            let sentence = Address::to_call(typed).unwrap_err().to_string();
            assert!(sentence.contains("tls/192.168.1.10:7447"), "{sentence}");
            assert!(sentence.contains("tls/[IPV6]"), "{sentence}");
        }
    }

    #[test]
    fn plain_bytes_never_leave_the_machine() {
        for typed in ["tcp/0.0.0.0", "tcp/[::]", "tcp/192.168.1.10", "tcp/station"] {
            let sentence = Address::to_listen(typed).unwrap_err().to_string();
            assert!(sentence.contains("ve-station keys"), "{sentence}");
            assert!(sentence.contains("write tls/"), "{sentence}");
        }
        for typed in [
            "tcp/127.0.0.1",
            "tcp/127.3.2.1:5",
            "tcp/[::1]",
            "tcp/[::ffff:127.0.0.1]",
        ] {
            assert!(Address::to_listen(typed).unwrap().is_loopback(), "{typed}");
            assert!(Address::to_call(typed).is_ok(), "{typed}");
        }
    }

    #[test]
    fn an_encrypted_link_is_called_by_no_ipv6_address() {
        for typed in ["tls/[::1]:1", "tls/[2001:db8::7]", "tls/[::ffff:10.0.0.1]"] {
            let error = Address::to_call(typed).unwrap_err();
            assert!(matches!(error, AddressError::Ipv6(_)), "{typed}: {error}");
            let sentence = error.to_string();
            assert!(sentence.contains("--host NAME"), "{sentence}");
            assert!(Address::to_listen(typed).is_ok(), "{typed}");
        }
        // What is refused is not recommended.
        let sentence = Address::to_call("tcp/[2001:db8::7]").unwrap_err();
        let sentence = sentence.to_string();
        assert!(!sentence.contains("write tls/"), "{sentence}");
    }

    #[test]
    fn an_address_that_no_machine_has_cannot_be_called() {
        for typed in [
            "tls/0.0.0.0",
            "tls/[::]:1",
            "tls/224.0.0.224",
            "tls/station:0",
        ] {
            let refused = Address::to_call(typed);
            assert!(
                matches!(refused, Err(AddressError::NoMachine(_))),
                "{typed}"
            );
            assert!(Address::to_listen(typed).is_ok(), "{typed}");
        }
    }
}
