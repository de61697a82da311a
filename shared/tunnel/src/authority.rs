//! Keys made: an authority of its own for each link, and a certificate of it for each side.

use crate::key_files::{KeyFiles, NotText, Role};
use rcgen::{
    BasicConstraints, CertificateParams, CertifiedIssuer, DnType, ExtendedKeyUsagePurpose, IsCa,
    KeyPair, KeyUsagePurpose,
};
use rustls_pki_types::ServerName;
use std::fs::{DirBuilder, OpenOptions};
use std::io::{ErrorKind, Write};
use std::net::{Ipv6Addr, UdpSocket};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use thiserror::Error;
use time::{Duration, OffsetDateTime};

/// How far the clocks of the two machines may be apart.
const CLOCK_TOLERANCE: Duration = Duration::DAY;
const SECONDS_A_DAY: u64 = 24 * 3600;
/// Names by which every machine calls itself.
const LOOPBACK: [&str; 2] = ["localhost", "127.0.0.1"];

/// Keys that were made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MadeKeys {
    /// Folder of the station's.
    pub station: PathBuf,
    /// Folder of the controllers'.
    pub controller: PathBuf,
    /// What the station may be called by: hosts' names and addresses.
    pub names: Vec<String>,
    /// Their last day.
    pub expires: String,
}

/// Why no keys were made: one sentence each.
#[derive(Debug, Error)]
pub enum MakeKeysError {
    /// The folder is there.
    #[error("{} is there already: name a new folder, so that no key is lost", .0.display())]
    Exists(PathBuf),
    /// A folder or file.
    #[error("cannot write {} ({reason})", path.display())]
    Write {
        /// The path.
        path: PathBuf,
        /// Why.
        reason: std::io::Error,
    },
    /// The folder's name.
    #[error("{0}")]
    Folder(#[from] NotText),
    /// A name that a certificate cannot hold.
    #[error("\"{0}\" is no host: write a host's name or address, without tls/ and port")]
    Name(String),
    /// An address by which nobody calls.
    #[error(
        "\"{0}\" is refused: no encrypted link is called by an IPv6 address; give the station's name, or an IPv4 address"
    )]
    Ipv6(Ipv6Addr),
    /// A date beyond the calendar.
    #[error("certificates cannot be valid for {} days: choose fewer", .0.as_secs() / SECONDS_A_DAY)]
    Lasting(std::time::Duration),
    /// The cryptography.
    #[error("cannot make a certificate ({0})")]
    Certificate(#[from] rcgen::Error),
}

/// Makes an authority and the keys of both sides in a new folder, valid for so long from now on.
/// Controllers call the station by one of `hosts`, names and addresses; without any by this
/// machine's.
///
/// The private key of the authority is not kept: nobody can make another certificate of it.
///
/// # Errors
/// When the folder is there already or cannot be written, or a host is none or an IPv6 address.
pub fn make_keys(
    folder: &Path,
    hosts: &[String],
    lasting: std::time::Duration,
) -> Result<MadeKeys, MakeKeysError> {
    let now = OffsetDateTime::UNIX_EPOCH + since_1970();
    let too_long = || MakeKeysError::Lasting(lasting);
    let span = Duration::try_from(lasting).map_err(|_| too_long())?;
    let last = now.checked_add(span).filter(|last| last.year() < 9999);
    let validity = (now - CLOCK_TOLERANCE, last.ok_or_else(too_long)?);
    make_keys_for(folder, hosts, &|_| validity)
}

/// Makes them, each side's valid from one time to another; the authority as the station's.
pub(crate) fn make_keys_for(
    folder: &Path,
    hosts: &[String],
    validity: &dyn Fn(Role) -> Validity,
) -> Result<MadeKeys, MakeKeysError> {
    let mut names = hosts.to_vec();
    if names.is_empty() {
        names = names_of_this_machine();
    }
    names.extend(LOOPBACK.map(str::to_owned));
    let names = certified(names)?;
    let of_station = validity(Role::Station);
    let authority = authority(of_station)?;
    if folder.exists() {
        return Err(MakeKeysError::Exists(folder.to_path_buf()));
    }
    make_folder(folder)?;
    let side = |role: Role, names: &[String]| {
        let own = folder.join(role.name());
        let files = KeyFiles::in_folder(&own)?;
        let key = KeyPair::generate()?;
        let certificate = of_side(role, names, validity(role))?.signed_by(&key, &authority)?;
        make_folder(&own)?;
        write(&files.authority, &authority.pem())?;
        write(&files.certificate, &certificate.pem())?;
        write(&files.private_key, &key.serialize_pem())?;
        Ok::<_, MakeKeysError>(own)
    };
    let sides =
        side(Role::Station, &names).and_then(|station| Ok([station, side(Role::Controller, &[])?]));
    if sides.is_err() {
        // All in it is of this call, and half of the keys would only be in the way of the next one.
        let _ = std::fs::remove_dir_all(folder);
    }
    let [station, controller] = sides?;
    Ok(MadeKeys {
        station,
        controller,
        names,
        expires: of_station.1.date().to_string(),
    })
}

fn since_1970() -> std::time::Duration {
    let now = std::time::SystemTime::now();
    now.duration_since(std::time::UNIX_EPOCH)
        .unwrap_or_default()
}

/// The host's name, and the address that it has towards others.
fn names_of_this_machine() -> Vec<String> {
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let host = host.trim().to_ascii_lowercase();
    // No packet is sent: the system only chooses the address that it would send from.
    let address = UdpSocket::bind("0.0.0.0:0").and_then(|socket| {
        socket.connect("192.0.2.1:9")?;
        socket.local_addr()
    });
    let names = [
        Some(host).filter(|host| is_host(host)),
        address.ok().map(|own| own.ip().to_string()),
    ];
    names.into_iter().flatten().collect()
}

/// The names as they stand in a certificate.
///
/// # Errors
/// When one is no host, or an IPv6 address.
fn certified(mut names: Vec<String>) -> Result<Vec<String>, MakeKeysError> {
    for name in &mut names {
        if !is_host(name) {
            return Err(MakeKeysError::Name(name.clone()));
        }
        if let Ok(address) = name.parse() {
            return Err(MakeKeysError::Ipv6(address));
        }
        // Who checks a certificate takes no name in it that ends so; callers leave it out too.
        if name.ends_with('.') {
            name.pop();
        }
    }
    Ok(names)
}

fn is_host(name: &str) -> bool {
    ServerName::try_from(name).is_ok()
}

/// The first and the last moment.
pub(crate) type Validity = (OffsetDateTime, OffsetDateTime);

fn authority(validity: Validity) -> Result<CertifiedIssuer<'static, KeyPair>, rcgen::Error> {
    let key = KeyPair::generate()?;
    // A name of its own, so that a certificate of another one is named as such.
    let own: String = key
        .public_key_raw()
        .iter()
        .rev()
        .take(8)
        .map(|byte| format!("{byte:02x}"))
        .collect();
    let mut params = named(&format!("hrtc-authority-{own}"), validity);
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![
        KeyUsagePurpose::KeyCertSign,
        KeyUsagePurpose::DigitalSignature,
    ];
    CertifiedIssuer::self_signed(params, key)
}

fn of_side(
    role: Role,
    names: &[String],
    validity: Validity,
) -> Result<CertificateParams, rcgen::Error> {
    let mut params = named(role.common_name(), validity);
    params.subject_alt_names = CertificateParams::new(names)?.subject_alt_names;
    params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    params.extended_key_usages = vec![
        ExtendedKeyUsagePurpose::ServerAuth,
        ExtendedKeyUsagePurpose::ClientAuth,
    ];
    params.use_authority_key_identifier_extension = true;
    Ok(params)
}

fn named(common_name: &str, (first, last): Validity) -> CertificateParams {
    let mut params = CertificateParams::default();
    params.distinguished_name = rcgen::DistinguishedName::new();
    params
        .distinguished_name
        .push(DnType::CommonName, common_name);
    (params.not_before, params.not_after) = (first, last);
    params
}

fn make_folder(path: &Path) -> Result<(), MakeKeysError> {
    let made = DirBuilder::new().mode(0o700).create(path);
    made.map_err(|reason| match reason.kind() {
        ErrorKind::AlreadyExists => MakeKeysError::Exists(path.to_path_buf()),
        _ => MakeKeysError::Write {
            path: path.to_path_buf(),
            reason,
        },
    })
}

/// Writes a new file that only its owner reads.
fn write(path: &str, text: &str) -> Result<(), MakeKeysError> {
    let file = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(path);
    file.and_then(|mut file| file.write_all(text.as_bytes()))
        .map_err(|reason| MakeKeysError::Write {
            path: path.into(),
            reason,
        })
}

#[cfg(test)]
mod tests {
    use super::{MakeKeysError, is_host, make_keys};
    use crate::address::Address;
    use std::net::IpAddr;
    use std::time::Duration;

    const DAY: Duration = Duration::from_secs(24 * 3600);

    /// Addresses with colons stand in brackets, so only names are looked at.
    #[test]
    fn whatever_name_a_certificate_may_hold_can_be_called() {
        let characters = || (0..=127).map(char::from);
        let names = characters().flat_map(|c| characters().map(move |d| format!("a{c}{d}")));
        let names = names.chain(characters().map(|c| format!("{c}-b.lab")));
        let names = names.filter(|name| is_host(name) && name.parse::<IpAddr>().is_err());
        let names: Vec<String> = names.collect();
        assert!(names.contains(&"a_b".to_owned()), "{names:?}");
        for name in names {
            let address = Address::to_call(&format!("tls/{name}"));
            assert!(address.is_ok(), "{name}: {address:?}");
        }
    }

    #[test]
    fn the_station_can_be_called_by_every_name_in_its_certificate() {
        let folder = tempfile::tempdir().unwrap();
        let hosts = ["Station.lab.", "192.168.1.10", "station"].map(str::to_owned);
        for (name, hosts) in [("of-hosts", hosts.to_vec()), ("of-machine", Vec::new())] {
            let made = make_keys(&folder.path().join(name), &hosts, DAY).unwrap();
            for name in &made.names {
                let address = Address::to_call(&format!("tls/{name}"));
                assert!(address.is_ok(), "{name}: {address:?}");
                assert!(!name.ends_with('.'), "{name} fits no caller");
            }
            let is_named = |name: &str| made.names.iter().any(|of| of == name);
            assert_eq!(is_named("Station.lab"), !hosts.is_empty());
            assert!(is_named("localhost"), "{:?}", made.names);
        }
    }

    #[test]
    fn keys_are_made_for_no_ipv6_address() {
        let folder = tempfile::tempdir().unwrap();
        for typed in ["::1", "2001:db8::7", "::ffff:10.0.0.1"] {
            let error = make_keys(&folder.path().join("keys"), &[typed.to_owned()], DAY);
            let error = error.unwrap_err();
            assert!(matches!(error, MakeKeysError::Ipv6(_)), "{typed}: {error}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
