//! Hosts, each with a link of its own to that of the station.

use super::points::{Guest, Point};
use super::relay::{FarEnd, Relay};
use super::way::{Shape, Way};
use crate::processes::host::Host;
use crate::processes::surroundings::Surroundings;
use crate::processes::watched::Watched;
use std::ffi::OsString;
use std::net::Ipv4Addr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Addresses of the hosts: of a net that no one else is in.
pub const STATION: Ipv4Addr = Ipv4Addr::new(10, 77, 0, 1);
const FIRST_CONTROLLER: Ipv4Addr = Ipv4Addr::new(10, 77, 0, 2);
/// Port of the link: the one that its page names.
const PORT: u16 = 7447;
/// What a controller says of a chunk that was changed on its way to it.
pub const DAMAGED: &str = "arrived damaged";
/// What a controller says when its link is made.
const LINKED: &str = "link: linked to the station at";

/// What all links of a command share.
pub struct Links {
    /// Folder of the keys.
    pub keys: PathBuf,
    /// What they are alike in: all but round trip, bandwidth and loss.
    pub shape: Shape,
    /// Seed of losses and jitter.
    pub seed: u64,
}

/// A side of a link: its host, and what the program is told of it.
#[derive(Default)]
pub struct Side {
    /// The host.
    pub around: Surroundings,
    /// Arguments for the link.
    pub typed: Vec<OsString>,
}

/// The hosts of a touch, and the relay between them.
pub struct Hosts {
    /// The station's.
    pub station: Side,
    /// The controllers'.
    pub controllers: Vec<Side>,
    /// The relay.
    pub relay: Relay,
}

impl Links {
    /// Makes the hosts and what joins them; each has a folder of its own in place of this one.
    ///
    /// # Errors
    /// What the system refused, as a part of a sentence.
    pub fn hosts(&self, guests: &[Guest], folder: &Path) -> Result<Hosts, String> {
        let (host, cable) = Host::new(STATION, folder)?;
        let station = self.side(host, "--listen", "station");
        let (mut controllers, mut others) = (Vec::new(), Vec::new());
        for (number, guest) in (0..).zip(guests) {
            let [a, b, c, d] = FIRST_CONTROLLER.octets();
            let address = Ipv4Addr::new(a, b, c, d + number);
            let (host, cable) = Host::new(address, folder)?;
            controllers.push(self.side(host, "--station", "controller"));
            others.push(FarEnd {
                address,
                cable,
                ways: Way::both(self.shape(guest.point), self.seed + u64::from(number)),
            });
        }
        Ok(Hosts {
            station,
            controllers,
            relay: Relay::start(cable, others)?,
        })
    }

    fn side(&self, host: Host, option: &str, role: &str) -> Side {
        Side {
            around: Surroundings {
                host: Some(Arc::new(host)),
                ..Surroundings::default()
            },
            typed: vec![
                option.into(),
                format!("tls/{STATION}:{PORT}").into(),
                "--keys".into(),
                self.keys.join(role).into(),
            ],
        }
    }

    fn shape(&self, point: Point) -> Shape {
        Shape {
            round_trip_s: point.rtt_ms * 1e-3,
            bits_per_s: point.mbit * 1e6,
            loss: point.loss,
            ..self.shape
        }
    }
}

/// How often the link of a controller was made.
#[must_use]
pub fn links_made(controller: &Watched) -> usize {
    let made = |line: &&String| line.contains(LINKED);
    controller.said.iter().filter(made).count()
}
