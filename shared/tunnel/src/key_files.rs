//! The files of one side's keys, and whose they are.

use std::path::{Path, PathBuf};
use thiserror::Error;

/// A side of the link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// The one that listens.
    Station,
    /// One that calls it.
    Controller,
}

impl Role {
    /// Its folder and its name in sentences.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Station => "station",
            Self::Controller => "controller",
        }
    }

    /// The common name in its certificate.
    #[must_use]
    pub fn common_name(self) -> &'static str {
        match self {
            Self::Station => "hrtc-station",
            Self::Controller => "hrtc-controller",
        }
    }

    /// The one at the other end.
    #[must_use]
    pub fn other(self) -> Self {
        match self {
            Self::Station => Self::Controller,
            Self::Controller => Self::Station,
        }
    }
}

/// The certificate of the authority that both sides trust.
const AUTHORITY: &str = "authority.pem";
/// The side's own certificate.
const CERTIFICATE: &str = "certificate.pem";
/// The side's private key.
const PRIVATE_KEY: &str = "key.pem";

/// The three files of a side.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeyFiles {
    /// The certificate of the authority.
    pub authority: String,
    /// The side's certificate.
    pub certificate: String,
    /// The side's private key.
    pub private_key: String,
}

/// A folder that zenoh cannot be told of.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("the name of the folder of keys {} is not UTF-8: choose another", .0.display())]
pub struct NotText(PathBuf);

impl KeyFiles {
    /// The files of a folder, whether they are there or not.
    ///
    /// # Errors
    /// When its name is not UTF-8.
    pub fn in_folder(folder: &Path) -> Result<Self, NotText> {
        let file = |name: &str| {
            let path = folder.join(name);
            path.into_os_string()
                .into_string()
                .map_err(|_| NotText(folder.to_path_buf()))
        };
        Ok(Self {
            authority: file(AUTHORITY)?,
            certificate: file(CERTIFICATE)?,
            private_key: file(PRIVATE_KEY)?,
        })
    }
}
