//! One touch: station and controller as two programs, on this machine or on two hosts with a link
//! between them.

use super::points::Point;
use super::programs::Programs;
use super::relay::{Relay, Relayed};
use super::result::{Row, Wire};
use super::way::{Shape, Way};
use crate::failure::Failure;
use crate::processes::host::Host;
use crate::processes::own_domain::OwnDomain;
use crate::processes::stop::is_set;
use crate::processes::surroundings::Surroundings;
use crate::processes::watched::{PATIENCE, Watched, pause};
use std::ffi::OsString;
use std::net::Ipv4Addr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Addresses of the hosts: of a net that no one else is in.
pub const STATION: Ipv4Addr = Ipv4Addr::new(10, 77, 0, 1);
const CONTROLLER: Ipv4Addr = Ipv4Addr::new(10, 77, 0, 2);
/// Port of the link: the one that its page names.
const PORT: u16 = 7447;
/// Share of a run after which the cable is cut, and which the cut lasts at the most: as long for
/// the touch before it, for itself, and for the way back.
pub const CUT_SHARE: f64 = 1.0 / 3.0;

/// What all touches of a command share.
pub struct Bench<'a> {
    /// Both programs.
    pub programs: Programs,
    /// Scene file, from the root of the disk.
    pub scene: PathBuf,
    /// Arguments over the scene.
    pub overrides: Vec<OsString>,
    /// Folder of the keys.
    pub keys: PathBuf,
    /// Length of a touch, seconds.
    pub seconds: f64,
    /// Length of a cut, seconds.
    pub cut_s: f64,
    /// Largest random part of a packet's time, seconds.
    pub jitter_s: f64,
    /// Share of the packets that are lost.
    pub loss: f64,
    /// Seed of losses and jitter.
    pub seed: u64,
    /// Asks for an early end.
    pub stop: &'a AtomicBool,
}

/// The side of a link: its host, and what the program is told of it.
#[derive(Default)]
struct Side {
    around: Surroundings,
    typed: Vec<OsString>,
}

/// A link: its hosts, and the relay between them.
struct Link {
    station: Side,
    controller: Side,
    relay: Relay,
}

impl Bench<'_> {
    /// A touch on this machine, without a link.
    ///
    /// # Errors
    /// What failed, in one sentence.
    pub fn local(&self) -> Result<Row, Failure> {
        let domain = own_domain()?;
        let here = [Side::default(), Side::default()];
        self.touch(&domain, here, None).map_err(Failure::Run)
    }

    /// A touch over a link.
    ///
    /// # Errors
    /// What failed, in one sentence.
    pub fn linked(&self, point: Point) -> Result<Row, Failure> {
        let Point { rtt_ms, mbit } = point;
        let domain = own_domain()?;
        let of = |error: String| Failure::Run(format!("at {rtt_ms} ms and {mbit} Mbit/s: {error}"));
        let link = self.link(point, &domain.root()).map_err(of)?;
        let sides = [link.station, link.controller];
        let touched = self.touch(&domain, sides, Some(&link.relay));
        let relayed = link.relay.end().map_err(of)?;
        let Relayed { ways, late_ms } = relayed;
        let [to_controller, to_station] = ways;
        Ok(touched.map_err(of)?.over(Wire {
            rtt_ms,
            mbit_per_s: mbit,
            to_controller,
            to_station,
            late_ms,
        }))
    }

    /// Makes two hosts and what joins them; each has a domain's folder of its own.
    fn link(&self, point: Point, folder: &Path) -> Result<Link, String> {
        let shape = Shape {
            round_trip_s: point.rtt_ms * 1e-3,
            jitter_s: self.jitter_s,
            bits_per_s: point.mbit * 1e6,
            loss: self.loss,
        };
        let (station, first) = Host::new(STATION, folder)?;
        let (controller, second) = Host::new(CONTROLLER, folder)?;
        let side = |host: Host, option: &str, role: &str| Side {
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
        };
        Ok(Link {
            station: side(station, "--listen", "station"),
            controller: side(controller, "--station", "controller"),
            relay: Relay::start([first, second], Way::both(shape, self.seed))?,
        })
    }

    fn touch(
        &self,
        domain: &OwnDomain,
        [station, controller]: [Side; 2],
        relay: Option<&Relay>,
    ) -> Result<Row, String> {
        let common = |verb: &str, side: &Side| -> Vec<OsString> {
            let mut typed = vec![verb.into(), self.scene.clone().into()];
            typed.extend(["--domain".into(), domain.name().into()]);
            typed.extend(side.typed.iter().chain(&self.overrides).cloned());
            typed
        };
        let typed = common("serve", &station);
        let program = &self.programs.station;
        let mut station = Watched::start_program("station", program, &typed, station.around)?;
        station.wait_for("the start", self.stop, |of| of.ready_ns.is_some())?;
        let mut typed = common("run", &controller);
        typed.push(format!("--seconds={}", self.seconds).into());
        typed.extend(["--supervised", "--record=off"].map(OsString::from));
        let program = &self.programs.controller;
        let around = controller.around;
        let mut controller = Watched::start_program("controller", program, &typed, around)?;
        self.disturb(relay);
        let ended = controller.wait_for_end(PATIENCE);
        let at_station = station.end();
        if is_set(self.stop) {
            return Err("ended early on request".to_string());
        }
        ended.and(at_station)?;
        let finished = controller.finished.take();
        let finished = finished.ok_or("the controller ended without a result")?;
        Ok(Row::of(*finished))
    }

    /// Lets a run pass, with the cut in it.
    fn disturb(&self, relay: Option<&Relay>) {
        let Some(relay) = relay.filter(|_| self.cut_s > 0.0) else {
            pause(self.seconds, self.stop);
            return;
        };
        let before_s = CUT_SHARE * self.seconds;
        pause(before_s, self.stop);
        relay.cut(true);
        pause(self.cut_s, self.stop);
        relay.cut(false);
        pause(self.seconds - before_s - self.cut_s, self.stop);
    }
}

fn own_domain() -> Result<OwnDomain, Failure> {
    OwnDomain::new().map_err(|error| Failure::Run(error.to_string()))
}
