//! The link to a station on another machine, or why this build has none.

use std::error::Error;
use std::path::Path;

/// Calls the station as long as what it returns lives.
#[cfg(feature = "tunnel")]
pub fn call(
    domain: &str,
    address: Option<&str>,
    keys: Option<&Path>,
) -> Result<Option<tunnel::Tunnel>, Box<dyn Error>> {
    let Some(address) = address else {
        return Ok(None);
    };
    let args = tunnel::TunnelArgs::calling(domain, address, keys.map(Path::to_path_buf));
    let tunnel = tunnel::Tunnel::start(&args, |sentence| {
        transport::logging::line(format_args!("link: {sentence}"));
    })?;
    Ok(Some(tunnel))
}

/// Refuses to call.
#[cfg(not(feature = "tunnel"))]
pub fn call(
    _domain: &str,
    address: Option<&str>,
    _keys: Option<&Path>,
) -> Result<Option<std::convert::Infallible>, Box<dyn Error>> {
    match address {
        Some(_) => Err("the link to other machines is not part of this build: build it with `cargo build --release -p hrtc --features tunnel`".into()),
        None => Ok(None),
    }
}
