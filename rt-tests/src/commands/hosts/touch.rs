//! One touch: station and controller as two programs, on this machine or on two hosts with a link
//! between them; or several controllers on hosts of their own.

use super::recorded::Recorded;
use super::result::{Row, Touched, Wire};
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
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use tempfile::TempDir;

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
    /// Folder in which each touch has one for its recordings.
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

/// The rows of a touch, each at its controller's place, and what failed beside them.
type Rows = (Vec<Option<Row>>, Vec<String>);

impl Bench<'_> {
    /// A touch on this machine, without a link.
    ///
    /// # Errors
    /// What failed, in one sentence, where there is no row.
    pub fn local(&self) -> Result<Touched, Failure> {
        let domain = own_domain()?;
        let (station, controllers) = (Side::default(), vec![Side::default()]);
        let touched = self.touch(&domain, station, controllers, &[], None);
        let (rows, failed) = touched.map_err(Failure::Run)?;
        let rows = rows.into_iter().flatten().collect();
        Ok(Touched { rows, failed })
    }

    /// Touches at the same time, each over a link of its own to one station.
    ///
    /// # Errors
    /// What failed, in one sentence, where there is no row.
    pub fn linked(&self, guests: &[Guest]) -> Result<Touched, Failure> {
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
        let (rows, failed) = touched.map_err(of)?;
        let rows = rows.into_iter().zip(guests).zip(links);
        let rows = rows.filter_map(|((row, guest), [to_controller, to_station])| {
            let mut row = row?;
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
            Some(row.over(guest.point, wire))
        });
        let failed = failed.into_iter().map(|error| of(error).to_string());
        Ok(Touched {
            rows: rows.collect(),
            failed: failed.collect(),
        })
    }

    fn touch(
        &self,
        domain: &OwnDomain,
        station: Side,
        controllers: Vec<Side>,
        guests: &[Guest],
        relay: Option<&Relay>,
    ) -> Result<Rows, String> {
        let recordings = folder_in(&self.folder)?;
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
            typed.push(recording(recordings.path(), number).into());
            let program = &self.programs.controller;
            Watched::start_program("controller", program, &typed, side.around)
        };
        let started = controllers.into_iter().enumerate().map(start);
        let mut controllers = started.collect::<Result<Vec<_>, _>>()?;
        self.disturb(relay, &mut controllers, guests);
        let mut failed = Vec::new();
        let mut rows = Vec::new();
        for (number, controller) in controllers.iter_mut().enumerate() {
            let row = row_of(controller, self.stop).map(|mut row| {
                let read = self.read(&recording(recordings.path(), number), &mut row);
                failed.extend(read.err());
                row
            });
            rows.push(row.map_err(|error| failed.push(error)).ok());
        }
        failed.extend(station.end().err());
        if is_set(self.stop) {
            return Err("ended early on request".to_string());
        }
        rows_or_failure(rows, failed)
    }

    /// Adds to a row what its controller recorded.
    fn read(&self, first: &Path, row: &mut Row) -> Result<(), String> {
        let soft_start_ticks = (self.soft_start_s * self.rate_hz).ceil() as u64;
        if first.exists() {
            row.recorded = Recorded::read(first, soft_start_ticks)?;
        } else {
            row.faults.push(
                "its recording is longer than [record] keep of the scene: its forces are not compared".to_string(),
            );
        }
        Ok(())
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

/// An empty folder for the recordings of one touch, which goes with it: a touch records a number of
/// files that nobody knows before, so those of another one would be read with its own.
fn folder_in(folder: &Path) -> Result<TempDir, String> {
    tempfile::tempdir_in(folder).map_err(|error| format!("no folder for recordings ({error})"))
}

/// First file of what a controller records.
fn recording(folder: &Path, number: usize) -> PathBuf {
    folder.join(format!("controller-{number}.mcap"))
}

/// What a controller came to, at its end.
fn row_of(controller: &mut Watched, stop: &AtomicBool) -> Result<Row, String> {
    controller.wait_for_end(PATIENCE, stop)?;
    let finished = controller.finished.take();
    let finished = finished.ok_or("the controller ended without a result")?;
    let mut row = Row::of(*finished);
    row.links_made = links_made(controller);
    row.has_damaged_chunk = controller.has_said(DAMAGED);
    Ok(row)
}

/// The rows with what failed beside them; all that failed where no controller came to a result.
fn rows_or_failure(rows: Vec<Option<Row>>, failed: Vec<String>) -> Result<Rows, String> {
    if rows.iter().any(Option::is_some) {
        Ok((rows, failed))
    } else {
        Err(failed.join("; "))
    }
}

fn own_domain() -> Result<OwnDomain, Failure> {
    OwnDomain::new().map_err(|error| Failure::Run(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrtc::result::Finished;

    #[test]
    fn a_touch_has_a_folder_of_its_own_which_goes_with_it() {
        let session = tempfile::tempdir().unwrap();
        let longer = folder_in(session.path()).unwrap();
        let later = longer.path().join("controller-0-0001.mcap");
        std::fs::write(&later, "").unwrap();
        let next = folder_in(session.path()).unwrap();
        assert_eq!(std::fs::read_dir(next.path()).unwrap().count(), 0);
        assert_ne!(recording(next.path(), 0), recording(longer.path(), 0));
        drop(longer);
        assert!(!later.exists() && next.path().exists());
    }

    #[test]
    fn one_controller_that_fails_takes_no_other_with_it() {
        let row = || Some(Row::of(Finished::default()));
        let failed = || vec!["one".to_string(), "the station".to_string()];
        let (rows, beside) = rows_or_failure(vec![None, row()], failed()).unwrap();
        assert!(rows[0].is_none() && rows[1].is_some());
        assert_eq!(beside, failed());
        let none = rows_or_failure(vec![None, None], failed());
        assert_eq!(none.unwrap_err(), "one; the station");
    }
}
