//! The heartbeat: its payload type never changes, so another version is recognised as such.

use crate::version::PROTOCOL_VERSION;
use iceoryx2_bb_derive_macros::ZeroCopySend;
use iceoryx2_bb_elementary_traits::zero_copy_send::ZeroCopySend;
use std::time::Duration;
use thiserror::Error;

/// Time between two heartbeats, milliseconds.
pub const HELLO_PERIOD_MS: u64 = 100;

/// Sender of a heartbeat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// `ve-station`.
    Station,
    /// `hrtc`.
    Controller,
}

/// A heartbeat: 128 opaque bytes. Bytes 0..8 magic, 8..12 version, 12..16 role, 16..24 incarnation,
/// 24..32 client, 32..64 build (UTF-8, zero padded); so far every version. From this one on: 64..68
/// `BYTE_ORDER_MARK` as it lies in the sender's memory, 68..72 its round-trip time, microseconds;
/// the rest is for later versions. All numbers but the mark are little-endian.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
#[type_name("hrtc.Hello")]
pub struct Hello {
    bytes: [u8; 128],
}

/// What a heartbeat says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Greeting {
    /// Whose it is.
    pub role: Role,
    /// Incarnation of the sender: another one after every start.
    pub incarnation: u64,
    /// The client, of a controller.
    pub client: u64,
    /// Round-trip time that a controller has measured; `None` before there is one.
    pub round_trip: Option<Duration>,
}

/// Reasons to refuse a heartbeat.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum HelloError {
    /// Not a heartbeat at all.
    #[error("a message on the heartbeat service is not a heartbeat of hrtc")]
    NotHello,
    /// A peer of another version.
    #[error(
        "the peer speaks protocol version {theirs} (build {build}), this program version {PROTOCOL_VERSION} (build {BUILD}): install the same release on both sides"
    )]
    OtherVersion {
        /// The peer's version.
        theirs: u32,
        /// The peer's build.
        build: String,
        /// The peer's role; `None` where this version has none such.
        role: Option<Role>,
    },
    /// A peer on a machine that stores numbers the other way round.
    #[error(
        "the peer (build {build}) runs on a {} machine, this program (build {BUILD}) on a {} one, and messages travel as they lie in memory: run both on machines of one byte order",
        byte_order(!cfg!(target_endian = "big")),
        byte_order(cfg!(target_endian = "big"))
    )]
    OtherByteOrder {
        /// The peer's build.
        build: String,
        /// The peer's role; `None` where this version has none such.
        role: Option<Role>,
    },
}

impl HelloError {
    /// Role of the peer; `None` where it is unknown.
    #[must_use]
    pub fn role(&self) -> Option<Role> {
        match self {
            Self::NotHello => None,
            Self::OtherVersion { role, .. } | Self::OtherByteOrder { role, .. } => *role,
        }
    }
}

const MAGIC: &[u8; 8] = b"hrtc-hlo";
/// Each byte another one, so that every order of them is told apart.
const BYTE_ORDER_MARK: u32 = 0x0A0B_0C0D;
/// Release of this program.
pub const BUILD: &str = env!("CARGO_PKG_VERSION");

fn byte_order(is_big: bool) -> &'static str {
    if is_big {
        "big-endian"
    } else {
        "little-endian"
    }
}

impl Hello {
    /// The heartbeat of this build.
    #[must_use]
    pub fn new(role: Role, incarnation: u64, client: u64) -> Self {
        let mut hello = Self { bytes: [0; 128] };
        hello.put(0, MAGIC);
        hello.put(8, &PROTOCOL_VERSION.to_le_bytes());
        hello.put(12, &(role as u32).to_le_bytes());
        hello.put(16, &incarnation.to_le_bytes());
        hello.put(24, &client.to_le_bytes());
        hello.put(64, &BYTE_ORDER_MARK.to_ne_bytes());
        hello.with_build(BUILD)
    }

    /// The same with a round-trip time, to the microsecond; of zero it says nothing.
    #[must_use]
    pub fn with_round_trip(mut self, round_trip: Duration) -> Self {
        let micros = u32::try_from(round_trip.as_micros()).unwrap_or(u32::MAX);
        self.put(68, &micros.to_le_bytes());
        self
    }

    /// The heartbeat that another version would send; for tests of the refusal.
    #[must_use]
    pub fn of_version(version: u32, role: Role, incarnation: u64, client: u64) -> Self {
        let mut hello = Self::new(role, incarnation, client);
        hello.put(8, &version.to_le_bytes());
        hello
    }

    /// The heartbeat that another build would send; for tests.
    #[must_use]
    pub fn with_build(mut self, build: &str) -> Self {
        let build = build.as_bytes();
        self.bytes[32..64].fill(0);
        self.put(32, &build[..build.len().min(32)]);
        self
    }

    /// The heartbeat that a machine of the other byte order would send; for tests of the refusal.
    #[must_use]
    pub fn with_other_byte_order(mut self) -> Self {
        self.put(64, &BYTE_ORDER_MARK.swap_bytes().to_ne_bytes());
        self
    }

    fn put(&mut self, at: usize, bytes: &[u8]) {
        self.bytes[at..at + bytes.len()].copy_from_slice(bytes);
    }

    fn array<const N: usize>(&self, at: usize) -> [u8; N] {
        std::array::from_fn(|k| self.bytes[at + k])
    }

    /// The sender's build.
    #[must_use]
    pub fn build(&self) -> String {
        let build = String::from_utf8_lossy(&self.bytes[32..64]);
        build.trim_end_matches('\0').to_string()
    }

    /// What it says.
    ///
    /// # Errors
    /// When it is no heartbeat, one of another protocol version, or one of another byte order.
    pub fn read(&self) -> Result<Greeting, HelloError> {
        if &self.bytes[..8] != MAGIC {
            return Err(HelloError::NotHello);
        }
        let build = self.build();
        // In its place in every version.
        let role = match u32::from_le_bytes(self.array(12)) {
            0 => Some(Role::Station),
            1 => Some(Role::Controller),
            _ => None,
        };
        let theirs = u32::from_le_bytes(self.array(8));
        if theirs != PROTOCOL_VERSION {
            return Err(HelloError::OtherVersion {
                theirs,
                build,
                role,
            });
        }
        let mark = u32::from_ne_bytes(self.array(64));
        if mark == BYTE_ORDER_MARK.swap_bytes() {
            return Err(HelloError::OtherByteOrder { build, role });
        }
        let role = role.filter(|_| mark == BYTE_ORDER_MARK);
        let role = role.ok_or(HelloError::NotHello)?;
        let micros = u32::from_le_bytes(self.array(68));
        Ok(Greeting {
            role,
            incarnation: u64::from_le_bytes(self.array(16)),
            client: u64::from_le_bytes(self.array(24)),
            round_trip: (micros > 0).then(|| Duration::from_micros(micros.into())),
        })
    }

    /// A warning where the sender is of another build. It is no reason to refuse it: what two
    /// programs of one protocol version say to each other is laid out alike, since whatever changes
    /// that changes the version; so two hosts need not be updated in the same moment.
    #[must_use]
    pub fn other_build(&self) -> Option<String> {
        let theirs = self.build();
        (theirs != BUILD).then(|| {
            format!(
                "the peer is of build {theirs}, this program of build {BUILD}: they speak the same protocol and go on; install the same release on both sides soon"
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ours() -> Hello {
        Hello::new(Role::Controller, 7 << 40, 3)
    }

    #[test]
    fn a_heartbeat_is_read_back() {
        let greeting = Greeting {
            role: Role::Controller,
            incarnation: 7 << 40,
            client: 3,
            round_trip: None,
        };
        assert_eq!(ours().read(), Ok(greeting));
        assert_eq!((ours().build(), ours().other_build()), (BUILD.into(), None));
        let round_trip = Some(Duration::from_micros(20_300));
        let far = ours().with_round_trip(Duration::from_nanos(20_300_900));
        let greeting = Greeting {
            round_trip,
            ..greeting
        };
        assert_eq!(far.read(), Ok(greeting));
        assert_eq!(Hello { bytes: [0; 128] }.read(), Err(HelloError::NotHello));
    }

    #[test]
    fn another_version_is_refused_by_its_name_whatever_it_says_beyond_64_bytes() {
        let version = PROTOCOL_VERSION + 1;
        for role in [Role::Station, Role::Controller] {
            let mut other = Hello::of_version(version, role, 1, 1).with_build("8.1.0");
            for rest in [0, 1, u8::MAX] {
                other.bytes[64..].fill(rest);
                let error = other.read().unwrap_err();
                assert_eq!(error.role(), Some(role));
                let error = error.to_string();
                let theirs = format!("version {version} (build 8.1.0)");
                assert!(error.contains(&theirs), "{error}");
                assert!(error.contains(BUILD), "{error}");
            }
            other.put(12, &7u32.to_le_bytes());
            assert_eq!(other.read().unwrap_err().role(), None);
        }
    }

    #[test]
    fn another_byte_order_is_refused_by_its_name() {
        let error = ours().with_other_byte_order().read().unwrap_err();
        let (build, role) = (BUILD.to_owned(), Some(Role::Controller));
        assert_eq!(error, HelloError::OtherByteOrder { build, role });
        let error = error.to_string();
        assert!(error.contains("big-endian") && error.contains("little-endian"));
        // Neither order is no heartbeat of this version.
        let mut unknown = ours();
        unknown.bytes[64..68].fill(0);
        assert_eq!(unknown.read(), Err(HelloError::NotHello));
    }

    #[test]
    fn another_build_is_believed_and_named() {
        let other = ours().with_build("0.0.0-other");
        assert_eq!(other.read(), ours().read());
        let warning = other.other_build().unwrap();
        assert!(warning.contains("0.0.0-other") && warning.contains(BUILD));
        let long = "x".repeat(50);
        assert_eq!(ours().with_build(&long).build(), long[..32]);
    }
}
