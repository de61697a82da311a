//! The link to controllers on other machines, or why this build has none.

use std::error::Error;
use std::path::Path;

#[cfg(feature = "tunnel")]
mod built {
    use super::{Error, Path};
    use std::time::Duration;
    use tunnel::{Tunnel, TunnelArgs};

    /// Length of a day, seconds.
    const DAY_S: u64 = 24 * 3600;

    /// Where a side usually looks for its keys, from its user's home.
    const USUAL_FOLDER: &str = ".config/hrtc/keys";

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
            transport::logging::line(format_args!("link: {sentence}"));
        })?;
        Ok(Some(tunnel))
    }

    /// Makes keys, and says how to copy them.
    pub fn make_keys(folder: &Path, hosts: &[String], days: u32) -> Result<String, Box<dyn Error>> {
        let lasting = Duration::from_secs(u64::from(days) * DAY_S);
        let made = tunnel::make_keys(folder, hosts, lasting)?;
        let [station, controller] = [&made.station, &made.controller].map(|of| quoted(of));
        // Where a station of this user looks for them.
        let target = tunnel::keys_folder();
        let target = target.map_or_else(|| format!("~/{USUAL_FOLDER}"), |folder| quoted(&folder));
        let names = made.names.join(", ");
        let expires = &made.expires;
        Ok(format!(
            "keys in {}, valid until {expires}; controllers call the station by {names}\n\
             on the station:     mkdir -p {target} && cp {station}/* {target}/\n\
             on the controller:  mkdir -p ~/{USUAL_FOLDER}\n\
             from here to it:    scp {controller}/* USER@CONTROLLER:{USUAL_FOLDER}/\n\
             then remove {}: whoever has a copy is let in",
            folder.display(),
            folder.display()
        ))
    }

    /// A path as a word of a shell's command.
    fn quoted(path: &Path) -> String {
        let text = path.display().to_string();
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-".contains(c);
        if text.chars().all(is_plain) {
            return text;
        }
        format!("'{}'", text.replace('\'', r"'\''"))
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
