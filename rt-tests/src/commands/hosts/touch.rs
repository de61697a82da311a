//! One touch: station and controller as two programs, on this machine or on two hosts with a link
//! between them; or several controllers on hosts of their own.

use super::recorded::Recorded;
use super::result::{Row, Wire};
use crate::failure::Failure;
use crate::links::hosts::{DAMAGED, Hosts, Links, Side, links_made};
use crate::links::points::Guest;
use crate::links::programs::Programs;
use crate::links::relay::{Relay, Relayed};
use crate::processes::own_domain::OwnDomain;
use crate::processes::stop::is_set;
use crate::processes::watched::{PATIENCE, Watched, pause};
use realtime::rights::monotonic_ns;
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

/// Share of a run after which the cable is cut, and which the cut lasts at the most: as long for
/// the touch before it, for itself, and for the way back.
pub const CUT_SHARE: f64 = 1.0 / 3.0;
/// Share of a touch in which the hand of one that rests does so.
pub const REST_SHARE: f64 = 0.5;

/// What all touches of a command share.
pub struct Bench<'a> {
    /// Both programs.
    pub programs: Programs,
    /// Scene file, from the root of the disk.
    pub scene: PathBuf,
    /// Arguments over the scene.
    pub overrides: Vec<OsString>,
    /// The links.
    pub links: Links,
    /// Folder of the recordings.
    pub folder: PathBuf,
    /// Length of a touch, seconds.
    pub seconds: f64,
    /// Ticks of the controller in a second.
    pub rate_hz: f64,
    /// Length of the controller's soft start, seconds.
    pub soft_start_s: f64,
    /// Length of a cut, seconds.
    pub cut_s: f64,
    /// Asks for an early end.
    pub stop: &'a AtomicBool,
}

impl Bench<'_> {
    /// A touch on this machine, without a link.
    ///
    /// # Errors
    /// What failed, in one sentence.
    pub fn local(&self) -> Result<Row, Failure> {
        let domain = own_domain()?;
        let (station, controllers) = (Side::default(), vec![Side::default()]);
        let rows = self.touch(&domain, station, controllers, &[], None);
        let row = rows.map_err(Failure::Run)?.pop();
        row.ok_or(Failure::Run("nothing was touched".to_string()))
    }

    /// Touches at the same time, each over a link of its own to one station.
    ///
    /// # Errors
    /// What failed, in one sentence.
    pub fn linked(&self, guests: &[Guest]) -> Result<Vec<Row>, Failure> {
        let domain = own_domain()?;
        let of = |error: String| {
            let links = guests.iter().map(|guest| guest.point.to_string());
            let links: Vec<String> = links.collect();
            Failure::Run(format!("at {}: {error}", links.join(" and ")))
        };
        let hosts = self.links.hosts(guests, &domain.root()).map_err(of)?;
        let Hosts {
            station,
            controllers,
            relay,
        } = hosts;
        let touched = self.touch(&domain, station, controllers, guests, Some(&relay));
        let Relayed { links, late_ms } = relay.end().map_err(of)?;
        let rows = touched.map_err(of)?.into_iter().zip(guests).zip(links);
        let rows = rows.map(|((mut row, guest), [to_controller, to_station])| {
            row.controllers = guests.len();
            row.is_stopped = guest.is_stopped;
            row.rests = guest.rests;
            let path_s = (1.0 - REST_SHARE) * self.seconds;
            let rest = row.recorded.rest((path_s * self.rate_hz).ceil() as u64);
            row.rest = rest.filter(|_| guest.rests);
            let wire = Wire {
                to_controller,
                to_station,
                late_ms,
            };
            row.over(guest.point, wire)
        });
        Ok(rows.collect())
    }

    fn touch(
        &self,
        domain: &OwnDomain,
        station: Side,
        controllers: Vec<Side>,
        guests: &[Guest],
        relay: Option<&Relay>,
    ) -> Result<Vec<Row>, String> {
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
        let start = |(number, side): (usize, Side)| {
            let mut typed = common("run", &side);
            typed.push(format!("--seconds={}", self.seconds).into());
            if guests.get(number).is_some_and(|guest| guest.rests) {
                let tour_s = (1.0 - REST_SHARE) * self.seconds;
                typed.push(format!("--tour-seconds={tour_s}").into());
            }
            typed.push(format!("--started-ns={}", monotonic_ns()).into());
            typed.extend(["--supervised", "--record"].map(OsString::from));
            typed.push(self.recording(number).into());
            let program = &self.programs.controller;
            Watched::start_program("controller", program, &typed, side.around)
        };
        let started = controllers.into_iter().enumerate().map(start);
        let mut controllers = started.collect::<Result<Vec<_>, _>>()?;
        self.disturb(relay, &mut controllers, guests);
        if is_set(self.stop) {
            controllers.iter_mut().for_each(|of| of.process.terminate());
        }
        let rows = controllers.iter_mut().enumerate();
        let rows = rows.map(|(number, controller)| self.row_of(number, controller));
        let rows: Result<Vec<Row>, String> = rows.collect();
        let at_station = station.end();
        if is_set(self.stop) {
            return Err("ended early on request".to_string());
        }
        let rows = rows?;
        at_station.map(|()| rows)
    }

    /// File of what a controller records; those of the touch before are written over.
    fn recording(&self, number: usize) -> PathBuf {
        self.folder.join(format!("controller-{number}.mcap"))
    }

    /// What a controller came to, at its end.
    fn row_of(&self, number: usize, controller: &mut Watched) -> Result<Row, String> {
        controller.wait_for_end(PATIENCE)?;
        let finished = controller.finished.take();
        let finished = finished.ok_or("the controller ended without a result")?;
        let mut row = Row::of(*finished);
        row.links_made = links_made(controller);
        row.has_damaged_chunk = controller.has_said(DAMAGED);
        let soft_start_ticks = (self.soft_start_s * self.rate_hz).ceil() as u64;
        let first = self.recording(number);
        if first.exists() {
            row.recorded = Recorded::read(&first, soft_start_ticks)?;
        } else {
            row.faults.push(
                "its recording is longer than [record] keep of the scene: its forces are not compared".to_string(),
            );
        }
        Ok(row)
    }

    /// Lets a run pass, with the cut and the stops in it.
    fn disturb(&self, relay: Option<&Relay>, controllers: &mut [Watched], guests: &[Guest]) {
        let third_s = CUT_SHARE * self.seconds;
        let cut = |is_cut: bool| {
            if let Some(relay) = relay.filter(|_| self.cut_s > 0.0) {
                relay.cut(is_cut);
            }
        };
        let mut signal = |number: libc::c_int| {
            let stopped = controllers.iter_mut().zip(guests);
            for (controller, _) in stopped.filter(|(_, guest)| guest.is_stopped) {
                controller.process.signal(number);
            }
        };
        pause(third_s, self.stop);
        cut(true);
        signal(libc::SIGSTOP);
        pause(self.cut_s, self.stop);
        cut(false);
        pause(third_s - self.cut_s, self.stop);
        signal(libc::SIGCONT);
        pause(third_s, self.stop);
    }
}

fn own_domain() -> Result<OwnDomain, Failure> {
    OwnDomain::new().map_err(|error| Failure::Run(error.to_string()))
}
