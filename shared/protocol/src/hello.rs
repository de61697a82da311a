//! The heartbeat: its payload type never changes, so another version is recognised as such.

use iceoryx2_bb_derive_macros::ZeroCopySend;
use iceoryx2_bb_elementary_traits::zero_copy_send::ZeroCopySend;
use thiserror::Error;

/// Version of the protocol; part of every service name but the heartbeat's.
pub const PROTOCOL_VERSION: u32 = 4;
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
/// 24..32 client, 32..64 build (UTF-8, zero padded), the rest for later versions.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
#[type_name("hrtc.Hello")]
pub struct Hello {
    bytes: [u8; 128],
}

/// Reasons to refuse a heartbeat.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum HelloError {
    /// Not a heartbeat at all.
    #[error("a message on the heartbeat service is not a heartbeat of hrtc")]
    NotHello,
    /// A peer of another version.
    #[error(
        "the peer speaks protocol version {theirs} (build {build}), this program version {PROTOCOL_VERSION}: install the same release on both sides"
    )]
    OtherVersion {
        /// The peer's version.
        theirs: u32,
        /// The peer's build.
        build: String,
    },
}

const MAGIC: &[u8; 8] = b"hrtc-hlo";

impl Hello {
    /// The heartbeat of this build.
    #[must_use]
    pub fn new(role: Role, incarnation: u64, client: u64) -> Self {
        Self::of_version(PROTOCOL_VERSION, role, incarnation, client)
    }

    /// The heartbeat that another version would send; for tests of the refusal.
    #[must_use]
    pub fn of_version(version: u32, role: Role, incarnation: u64, client: u64) -> Self {
        let mut bytes = [0; 128];
        bytes[..8].copy_from_slice(MAGIC);
        bytes[8..12].copy_from_slice(&version.to_le_bytes());
        bytes[12..16].copy_from_slice(&(role as u32).to_le_bytes());
        bytes[16..24].copy_from_slice(&incarnation.to_le_bytes());
        bytes[24..32].copy_from_slice(&client.to_le_bytes());
        let build = env!("CARGO_PKG_VERSION").as_bytes();
        let length = build.len().min(32);
        bytes[32..32 + length].copy_from_slice(&build[..length]);
        Self { bytes }
    }

    /// Role, incarnation and client of the sender.
    ///
    /// # Errors
    /// When it is no heartbeat, or one of another protocol version.
    pub fn read(&self) -> Result<(Role, u64, u64), HelloError> {
        let u32_at = |at: usize| {
            u32::from_le_bytes([
                self.bytes[at],
                self.bytes[at + 1],
                self.bytes[at + 2],
                self.bytes[at + 3],
            ])
        };
        let u64_at = |at: usize| u64::from(u32_at(at)) | u64::from(u32_at(at + 4)) << 32;
        if &self.bytes[..8] != MAGIC {
            return Err(HelloError::NotHello);
        }
        let theirs = u32_at(8);
        if theirs != PROTOCOL_VERSION {
            let build = String::from_utf8_lossy(&self.bytes[32..64])
                .trim_end_matches('\0')
                .to_string();
            return Err(HelloError::OtherVersion { theirs, build });
        }
        let role = match u32_at(12) {
            0 => Role::Station,
            1 => Role::Controller,
            _ => return Err(HelloError::NotHello),
        };
        Ok((role, u64_at(16), u64_at(24)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_heartbeat_is_read_back_and_another_version_is_named() {
        let hello = Hello::new(Role::Controller, 7 << 40, 3);
        assert_eq!(hello.read(), Ok((Role::Controller, 7 << 40, 3)));
        let other = Hello::of_version(9, Role::Station, 1, 1);
        let error = other.read().unwrap_err();
        assert!(error.to_string().contains("version 9"), "{error}");
        assert_eq!(Hello { bytes: [0; 128] }.read(), Err(HelloError::NotHello));
    }
}
