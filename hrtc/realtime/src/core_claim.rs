//! A core of a machine, claimed by one loop at a time.

use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener};

/// A name of the kernel's that stands for a core. It leaves no file, and goes with its process
/// however that ends.
#[derive(Debug)]
pub struct CoreClaim {
    _name: Option<UnixListener>,
}

impl CoreClaim {
    /// Claims a core; `None` when another loop of this machine (of this network namespace) has
    /// claimed it. Where the kernel gives no such names, every claim succeeds.
    #[must_use]
    pub fn take(core: usize) -> Option<Self> {
        let name = SocketAddr::from_abstract_name(format!("hrtc-core-{core}"));
        match name.and_then(|name| UnixListener::bind_addr(&name)) {
            Ok(listener) => Some(Self {
                _name: Some(listener),
            }),
            Err(error) if error.kind() == std::io::ErrorKind::AddrInUse => None,
            Err(_) => Some(Self { _name: None }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_core_is_claimed_once_until_its_claim_goes() {
        // Beyond any core, and another for every process.
        let core = 1_000_000 + std::process::id() as usize;
        let claim = CoreClaim::take(core);
        assert!(claim.is_some());
        assert!(CoreClaim::take(core).is_none());
        assert!(CoreClaim::take(core + 1).is_some());
        drop(claim);
        assert!(CoreClaim::take(core).is_some());
    }
}
