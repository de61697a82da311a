//! What the process of a tunnel is told, as typed by whoever starts it.

use crate::address::{Address, AddressError};
use crate::settings::End;
use clap::Args;
use std::ffi::OsString;
use std::path::PathBuf;

/// The subcommand of a program that is the process of a tunnel.
pub const SUBCOMMAND: &str = "tunnel";

/// What the process of a tunnel is told.
#[derive(Debug, Clone, PartialEq, Eq, Args)]
pub struct TunnelArgs {
    /// iceoryx2 domain of this machine
    #[arg(long, value_name = "NAME")]
    pub domain: String,
    /// Wait for controllers here
    #[arg(
        long,
        value_name = "ADDRESS",
        conflicts_with = "call",
        required_unless_present = "call"
    )]
    pub listen: Option<String>,
    /// Call the station there
    #[arg(long, value_name = "ADDRESS")]
    pub call: Option<String>,
    /// Folder of the keys
    #[arg(long, value_name = "DIR")]
    pub keys: Option<PathBuf>,
    /// Show keys that are not checked before, and no certificate where the folder has none, as a
    /// stranger would: the station must refuse it (`rt-tests hosts`)
    #[arg(long, hide = true, requires = "call")]
    pub as_stranger: bool,
}

impl TunnelArgs {
    /// Those of a station that waits for controllers.
    #[must_use]
    pub fn listening(domain: &str, address: &str, keys: Option<PathBuf>) -> Self {
        Self {
            domain: domain.to_owned(),
            listen: Some(address.to_owned()),
            call: None,
            keys,
            as_stranger: false,
        }
    }

    /// Those of a controller that calls its station.
    #[must_use]
    pub fn calling(domain: &str, address: &str, keys: Option<PathBuf>) -> Self {
        Self {
            domain: domain.to_owned(),
            listen: None,
            call: Some(address.to_owned()),
            keys,
            as_stranger: false,
        }
    }

    /// This side of the link.
    ///
    /// # Errors
    /// When its address is refused.
    pub fn end(&self) -> Result<End, AddressError> {
        if let Some(address) = &self.listen {
            return Address::to_listen(address).map(End::Listen);
        }
        let address = self.call.as_deref().unwrap_or_default();
        Address::to_call(address).map(End::Call)
    }

    /// The arguments that a process is started with, its subcommand first.
    #[must_use]
    pub fn typed(&self) -> Vec<OsString> {
        let mut typed: Vec<OsString> = vec![SUBCOMMAND.into()];
        let mut option = |name: &str, value: OsString| {
            let mut whole = OsString::from(format!("--{name}="));
            whole.push(value);
            typed.push(whole);
        };
        option("domain", self.domain.clone().into());
        if let Some(address) = &self.listen {
            option("listen", address.into());
        }
        if let Some(address) = &self.call {
            option("call", address.into());
        }
        if let Some(keys) = &self.keys {
            option("keys", keys.into());
        }
        if self.as_stranger {
            typed.push("--as-stranger".into());
        }
        typed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Debug, Parser)]
    struct Program {
        #[command(subcommand)]
        command: Command,
    }

    #[derive(Debug, clap::Subcommand)]
    enum Command {
        Tunnel(TunnelArgs),
    }

    #[test]
    fn what_is_typed_is_read_again() {
        for args in [
            TunnelArgs::listening("a-1", "tls/0.0.0.0", Some("-/ä".into())),
            TunnelArgs::calling("a-1", "tcp/127.0.0.1:5", None),
            TunnelArgs {
                as_stranger: true,
                ..TunnelArgs::calling("a-1", "tls/127.0.0.1:5", Some("keys".into()))
            },
        ] {
            let typed = [OsString::from("program")].into_iter().chain(args.typed());
            let Command::Tunnel(read) = Program::try_parse_from(typed).unwrap().command;
            assert_eq!(read, args);
        }
    }
}
