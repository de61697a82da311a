//! The link to controllers on other machines, or why this build has none.

use std::error::Error;
use std::path::Path;

#[cfg(feature = "tunnel")]
mod built {
    use super::{Error, Path};
    use std::io::Write;
    use std::time::Duration;
    use tunnel::{Tunnel, TunnelArgs};

    /// Length of a day, seconds.
    const DAY_S: u64 = 24 * 3600;

    /// Listens for controllers as long as what it returns lives.
    pub fn listen(
        domain: &str,
        address: Option<&str>,
        keys: Option<&Path>,
    ) -> Result<Option<Tunnel>, Box<dyn Error>> {
        let Some(address) = address else {
            return Ok(None);
        };
        let args = TunnelArgs::listening(domain, address, keys.map(Path::to_path_buf));
        let tunnel = Tunnel::start(&args, |sentence| {
            // Nobody may be left to read it.
            let _ = writeln!(std::io::stderr(), "link: {sentence}");
        })?;
        Ok(Some(tunnel))
    }

    /// Makes keys, and says how to copy them.
    pub fn make_keys(folder: &Path, hosts: &[String], days: u32) -> Result<String, Box<dyn Error>> {
        let lasting = Duration::from_secs(u64::from(days) * DAY_S);
        let made = tunnel::make_keys(folder, hosts, lasting)?;
        let [station, controller] = [&made.station, &made.controller].map(|of| of.display());
        let target = "~/.config/hrtc/keys";
        let names = made.names.join(", ");
        let expires = &made.expires;
        Ok(format!(
            "keys in {}, valid until {expires}; controllers call the station by {names}\n\
             on the station:     mkdir -p {target} && cp {station}/* {target}/\n\
             on the controller:  mkdir -p {target}\n\
             from here to it:    scp {controller}/* USER@CONTROLLER:.config/hrtc/keys/\n\
             then remove {}: whoever has a copy is let in",
            folder.display(),
            folder.display()
        ))
    }
}

#[cfg(feature = "tunnel")]
pub use built::{listen, make_keys};

/// How a build has it.
#[cfg(not(feature = "tunnel"))]
const NOT_BUILT: &str = "the link to other machines is not part of this build: build it with `cargo build --release -p ve-station --features tunnel`";

/// Refuses to listen.
#[cfg(not(feature = "tunnel"))]
pub fn listen(
    _domain: &str,
    address: Option<&str>,
    _keys: Option<&Path>,
) -> Result<Option<std::convert::Infallible>, Box<dyn Error>> {
    match address {
        Some(_) => Err(NOT_BUILT.into()),
        None => Ok(None),
    }
}

/// Makes none.
#[cfg(not(feature = "tunnel"))]
pub fn make_keys(_folder: &Path, _hosts: &[String], _days: u32) -> Result<String, Box<dyn Error>> {
    Err(NOT_BUILT.into())
}
