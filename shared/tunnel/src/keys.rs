//! The keys of a link: made by `ve-station keys`, and checked before zenoh sees them, so that a
//! side whose keys cannot work says so itself.

use crate::address::Carriage;
use crate::key_files::{KeyFiles, NotText, Role};
use crate::settings::End;
use rcgen::KeyPair;
use rustls_pki_types::pem::PemObject;
use rustls_pki_types::{CertificateDer, UnixTime};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use thiserror::Error;
use webpki::{EndEntityCert, KeyUsage};
use x509_parser::prelude::{FromDer, X509Certificate};

/// Why keys are refused: one sentence each.
#[derive(Debug, Error)]
pub enum KeysError {
    /// The folder's name.
    #[error("{0}")]
    Folder(#[from] NotText),
    /// There are none.
    #[error(
        "the link needs keys, and {file} cannot be read ({reason}): make them with `ve-station keys DIR` and copy them as it says, or name their folder with --keys"
    )]
    Missing {
        /// The file.
        file: String,
        /// Why.
        reason: String,
    },
    /// No folder to look in.
    #[error(
        "the link needs keys, and this user has no folder of settings: name theirs with --keys"
    )]
    NoFolder,
    /// Damaged.
    #[error("{file} is damaged ({reason}): make keys again with `ve-station keys DIR`")]
    Damaged {
        /// The file.
        file: String,
        /// Why.
        reason: String,
    },
    /// Of another authority.
    #[error(
        "the certificate {certificate} is not of the authority {authority} beside it: copy both from one `ve-station keys DIR`"
    )]
    Foreign {
        /// The certificate.
        certificate: String,
        /// The authority.
        authority: String,
    },
    /// Too old.
    #[error(
        "the certificate {certificate} has expired on {date}: make keys again with `ve-station keys DIR`, for both sides"
    )]
    Expired {
        /// The certificate.
        certificate: String,
        /// Its last day.
        date: String,
    },
    /// Too young.
    #[error(
        "the certificate {certificate} is valid from {date} on only: set this machine's clock right"
    )]
    TooYoung {
        /// The certificate.
        certificate: String,
        /// Its first day.
        date: String,
    },
    /// Somebody else's.
    #[error(
        "the keys in {folder} are those of a {theirs}, and this is the {own}: copy the other ones"
    )]
    OtherRole {
        /// The folder.
        folder: PathBuf,
        /// Whose they are.
        theirs: String,
        /// Whose they should be.
        own: &'static str,
    },
    /// Not secret.
    #[error("the private key {private_key} may be read by others: chmod 600 {private_key}")]
    Readable {
        /// The private key.
        private_key: String,
    },
    /// Of two pairs.
    #[error(
        "the private key {private_key} does not belong to the certificate beside it: copy both from one `ve-station keys DIR`"
    )]
    OtherKey {
        /// The private key.
        private_key: String,
    },
}

/// The folder in which a side looks for its keys when none is named; `None` for a user without a
/// folder of settings.
#[must_use]
pub fn keys_folder() -> Option<PathBuf> {
    dirs::config_dir().map(|settings| settings.join("hrtc/keys"))
}

/// The checked keys of one end of a link; none for a plain one.
///
/// # Errors
/// When it needs keys, and there are none or they cannot work.
pub fn needed_for(end: &End, folder: Option<&Path>) -> Result<Option<KeyFiles>, KeysError> {
    match end.address().carriage() {
        Carriage::Tcp => Ok(None),
        Carriage::Tls => {
            let folder = folder.map(Path::to_path_buf).or_else(keys_folder);
            let folder = folder.ok_or(KeysError::NoFolder)?;
            check(&folder, end.role(), UnixTime::now()).map(Some)
        }
    }
}

/// The keys in a folder, if one side can use them at this time.
fn check(folder: &Path, role: Role, now: UnixTime) -> Result<KeyFiles, KeysError> {
    let files = KeyFiles::in_folder(folder)?;
    let authority = certificate(&files.authority)?;
    let own = certificate(&files.certificate)?;
    let key = private_key(&files.private_key)?;
    let of_authority = webpki::anchor_from_trusted_cert(&authority);
    let anchor = of_authority.map_err(|error| damaged(&files.authority, error))?;
    let end = EndEntityCert::try_from(&own).map_err(|error| damaged(&files.certificate, error))?;
    let (_, read) =
        X509Certificate::from_der(&own).map_err(|error| damaged(&files.certificate, error))?;
    let date = |time: x509_parser::time::ASN1Time| time.to_datetime().date().to_string();
    for usage in [KeyUsage::client_auth(), KeyUsage::server_auth()] {
        let verified = end.verify_for_usage(
            webpki::ALL_VERIFICATION_ALGS,
            std::slice::from_ref(&anchor),
            &[],
            now,
            usage,
            None,
            None,
        );
        let certificate = files.certificate.clone();
        match verified {
            Ok(_) => {}
            Err(webpki::Error::CertExpired { .. }) => {
                let date = date(read.validity().not_after);
                return Err(KeysError::Expired { certificate, date });
            }
            Err(webpki::Error::CertNotValidYet { .. }) => {
                let date = date(read.validity().not_before);
                return Err(KeysError::TooYoung { certificate, date });
            }
            Err(webpki::Error::UnknownIssuer | webpki::Error::InvalidSignatureForPublicKey) => {
                let authority = files.authority.clone();
                return Err(KeysError::Foreign {
                    certificate,
                    authority,
                });
            }
            Err(error) => return Err(damaged(&certificate, error)),
        }
    }
    let name = read.subject().iter_common_name().next();
    let name = name.and_then(|name| name.as_str().ok()).unwrap_or_default();
    if name != role.common_name() {
        return Err(KeysError::OtherRole {
            folder: folder.to_path_buf(),
            theirs: name.trim_start_matches("hrtc-").to_owned(),
            own: role.name(),
        });
    }
    if key.public_key_raw() != read.public_key().subject_public_key.data.as_ref() {
        let private_key = files.private_key.clone();
        return Err(KeysError::OtherKey { private_key });
    }
    Ok(files)
}

fn private_key(file: &str) -> Result<KeyPair, KeysError> {
    let found = std::fs::metadata(file).map_err(|error| missing(file, error))?;
    if found.mode() & 0o077 != 0 {
        let private_key = file.to_owned();
        return Err(KeysError::Readable { private_key });
    }
    let text = std::fs::read_to_string(file).map_err(|error| missing(file, error))?;
    KeyPair::from_pem(&text).map_err(|error| damaged(file, error))
}

fn certificate(file: &str) -> Result<CertificateDer<'static>, KeysError> {
    let text = std::fs::read(file).map_err(|error| missing(file, error))?;
    CertificateDer::from_pem_slice(&text).map_err(|error| damaged(file, error))
}

fn missing(file: &str, reason: std::io::Error) -> KeysError {
    KeysError::Missing {
        file: file.to_owned(),
        reason: reason.to_string(),
    }
}

fn damaged(file: &str, reason: impl std::fmt::Display) -> KeysError {
    KeysError::Damaged {
        file: file.to_owned(),
        reason: reason.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::address::Address;
    use crate::authority::{MadeKeys, MakeKeysError, make_keys};
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    use std::os::unix::fs::PermissionsExt;
    use std::time::Duration;

    const DAY: Duration = Duration::from_secs(24 * 3600);

    fn made(folder: &Path, name: &str) -> MadeKeys {
        let hosts = ["192.168.1.10".to_owned()];
        make_keys(&folder.join(name), &hosts, 30 * DAY).unwrap()
    }

    fn refused(folder: &Path, role: Role, days_later: u32) -> KeysError {
        let now = Duration::from_secs(UnixTime::now().as_secs()) + days_later * DAY;
        let now = UnixTime::since_unix_epoch(now);
        check(folder, role, now).unwrap_err()
    }

    #[test]
    fn made_keys_are_good_for_their_side_and_only_their_owner_reads_them() {
        let folder = tempfile::tempdir().unwrap();
        let made = made(folder.path(), "keys");
        for (own, role) in [
            (&made.station, Role::Station),
            (&made.controller, Role::Controller),
        ] {
            let files = check(own, role, UnixTime::now()).unwrap();
            for file in [files.authority, files.certificate, files.private_key] {
                let mode = std::fs::metadata(file).unwrap().permissions().mode();
                assert_eq!(mode & 0o777, 0o600);
            }
            let error = refused(own, role.other(), 0);
            assert!(matches!(error, KeysError::OtherRole { .. }), "{error}");
        }
        assert!(made.names.contains(&"192.168.1.10".to_owned()));
        // No file of a private key of the authority.
        assert_eq!(
            std::fs::read_dir(folder.path().join("keys"))
                .unwrap()
                .count(),
            2
        );
        let again = make_keys(&folder.path().join("keys"), &[], DAY).unwrap_err();
        assert!(again.to_string().contains("is there already"), "{again}");
    }

    #[test]
    fn an_expired_certificate_is_named_with_its_last_day() {
        let folder = tempfile::tempdir().unwrap();
        let made = made(folder.path(), "keys");
        check(&made.station, Role::Station, UnixTime::now()).unwrap();
        let error = refused(&made.station, Role::Station, 31);
        assert!(matches!(error, KeysError::Expired { .. }), "{error}");
        assert!(error.to_string().contains(&made.expires), "{error}");
    }

    #[test]
    fn a_private_key_that_others_may_read_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let made = made(folder.path(), "keys");
        let open = std::fs::Permissions::from_mode(0o640);
        std::fs::set_permissions(made.controller.join("key.pem"), open).unwrap();
        let error = refused(&made.controller, Role::Controller, 0);
        assert!(error.to_string().contains("chmod 600"), "{error}");
    }

    #[test]
    fn a_certificate_of_another_authority_or_key_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let [one, other] = ["one", "other"].map(|name| made(folder.path(), name).station);
        let copy = |file: &str| std::fs::copy(other.join(file), one.join(file)).unwrap();
        copy("key.pem");
        let error = refused(&one, Role::Station, 0);
        assert!(matches!(error, KeysError::OtherKey { .. }), "{error}");
        copy("certificate.pem");
        let error = refused(&one, Role::Station, 0);
        assert!(matches!(error, KeysError::Foreign { .. }), "{error}");
        std::fs::write(one.join("certificate.pem"), "no certificate").unwrap();
        let error = refused(&one, Role::Station, 0);
        assert!(matches!(error, KeysError::Damaged { .. }), "{error}");
        std::fs::remove_file(one.join("certificate.pem")).unwrap();
        let error = refused(&one, Role::Station, 0).to_string();
        assert!(error.contains("ve-station keys"), "{error}");
    }

    #[test]
    fn only_an_encrypted_link_needs_keys() {
        let nowhere = Path::new("/nonexistent");
        let plain = End::Listen(Address::to_listen("tcp/127.0.0.1").unwrap());
        assert!(needed_for(&plain, Some(nowhere)).unwrap().is_none());
        let encrypted = End::Listen(Address::to_listen("tls/127.0.0.1").unwrap());
        assert!(needed_for(&encrypted, Some(nowhere)).is_err());
    }

    #[test]
    fn keys_that_cannot_be_made_leave_no_folder_behind() {
        let folder = tempfile::tempdir().unwrap();
        // Refused when the folder itself is there already.
        let keys = folder.path().join(OsStr::from_bytes(b"keys-\xff"));
        for _ in 0..2 {
            let error = make_keys(&keys, &[], DAY).unwrap_err();
            assert!(!matches!(error, MakeKeysError::Exists(_)), "{error}");
            assert!(!keys.exists());
        }
    }

    #[test]
    fn what_is_no_host_stands_in_no_certificate() {
        let folder = tempfile::tempdir().unwrap();
        for bad in ["tls/station:7447", "station lab", ""] {
            let error = make_keys(&folder.path().join("keys"), &[bad.to_owned()], DAY);
            let error = error.unwrap_err().to_string();
            assert!(error.contains("is no host"), "{error}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        let error = make_keys(&folder.path().join("keys"), &[], u32::MAX * DAY);
        let error = error.unwrap_err().to_string();
        assert!(error.contains("for 4294967295 days"), "{error}");
    }
}
