//! Who is refused at a link, by name on both sides: callers whose certificates a station does not
//! take, and peers of another version or byte order.
//!
//! The programs are real, and so is the link, on the loopback; each side has a domain of its own. A
//! stranger is a controller behind a tunnel that shows keys which nobody checked before. A forger
//! has good keys, and says in its domain what no program of this build and machine would say. Each
//! of them is given nothing; a good controller touches after all of them.

use super::alone::Alone;
use crate::commands::faults::{Case, Faults};
use crate::failure::{Chosen, Failure};
use crate::links::programs::Programs;
use crate::processes::own_domain::OwnDomain;
use crate::processes::stop::is_set;
use crate::processes::surroundings::Surroundings;
use crate::processes::voice::say_until;
use crate::processes::watched::{PATIENCE, Watched, pause};
use crate::report::table::Table;
use protocol::{Hello, PROTOCOL_VERSION, Role};
use realtime::rights::monotonic_ns;
use serde::Serialize;
use std::ffi::OsString;
use std::fs;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use tunnel::KeyFiles;
use tunnel::named::{EXPIRED, FOREIGN, LINKED_FROM, NO_CERTIFICATE, Refusal};

/// Where all of them meet.
const LOOPBACK: &str = "127.0.0.1";
/// Time after a refusal in which a stranger calls again and its controller waits, seconds.
const WAITS_S: f64 = 1.0;
/// Length of the good touch, seconds.
const TOUCH_S: f64 = 6.0;
/// Time after which keys of no day have expired: X.509 counts seconds.
const EXPIRES_S: f64 = 1.5;

/// The case of `rt-tests faults` with harmed packets.
const PACKETS: &str = "link-packets-changed";
/// Makes the heartbeat of a forger in a role.
type Forge = fn(Role) -> Hello;
/// Heartbeats that no program of this build and machine says.
const FORGED: [(Who, Forge); 2] = [
    (Who::Version, |role| {
        Hello::of_version(PROTOCOL_VERSION + 1, role, monotonic_ns(), 1)
    }),
    (Who::Endianness, |role| {
        Hello::new(role, monotonic_ns(), 1).with_other_byte_order()
    }),
];

/// Who is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Who {
    /// A caller with keys of another authority.
    ForeignCertificate,
    /// A caller that shows no certificate.
    NoCertificate,
    /// A caller whose certificate has expired.
    Expired,
    /// A peer of another version of the protocol.
    Version,
    /// A peer on a machine of the other byte order.
    Endianness,
    /// Packets that somebody at the cable sends once more.
    Replayed,
    /// Packets that somebody at the cable changes, so that no checksum of IP or TCP shows it.
    Damaged,
}

impl Who {
    /// In words.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::ForeignCertificate => "foreign certificate",
            Self::NoCertificate => "no certificate",
            Self::Expired => "expired certificate",
            Self::Version => "other version",
            Self::Endianness => "other byte order",
            Self::Replayed => "packets sent once more",
            Self::Damaged => "changed packets",
        }
    }
}

/// One of them, and what became of it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Refused {
    /// Who.
    pub who: Who,
    /// Whether both sides named it, it was given nothing, and others were served all the same.
    pub named: bool,
    /// How it was named, or what was wrong.
    pub what: String,
}

impl Refused {
    fn of(who: Who, answer: Result<String, String>) -> Self {
        let named = answer.is_ok();
        let (Ok(what) | Err(what)) = answer;
        Self { who, named, what }
    }

    /// What became of packets that were changed and sent once more on a link between two hosts, by
    /// the case of `rt-tests faults`: both sides said that the link was lost, it was made again,
    /// nothing came through, and the touch ended as an undisturbed one.
    #[must_use]
    pub fn packets(faults: &Faults) -> [Self; 2] {
        let harmed = faults.harmed;
        [
            (Who::Replayed, harmed.replayed),
            (Who::Damaged, harmed.damaged),
        ]
        .map(|(who, packets)| {
            let failed = |of: &&Case| of.name == PACKETS && !of.pass;
            let answer = match faults.cases.iter().find(failed) {
                Some(case) => Err(case.what.clone()),
                None if packets == 0 || !harmed.named => Err("there were none".to_string()),
                None => Ok(format!("{packets} packets, the link lost and made again")),
            };
            Self::of(who, answer)
        })
    }
}

/// All of them as a table.
#[must_use]
pub fn table(all: &[Refused]) -> Table {
    let mut table = Table::new(3, "refused | by name on both sides | seen");
    for one in all {
        let named = if one.named { "yes" } else { "NO" };
        let name = one.who.name().to_string();
        table.row([name, named.to_string(), one.what.clone()]);
    }
    table
}

/// What all of them need.
pub struct Trial<'a> {
    /// Both programs.
    pub programs: &'a Programs,
    /// Scene file, from the root of the disk; its models are built.
    pub scene: &'a Path,
    /// A folder for their keys, empty.
    pub folder: &'a Path,
    /// Asks for an early end.
    pub stop: &'a AtomicBool,
}

impl Trial<'_> {
    /// Lets all of them come to one station, one after another, then a good controller.
    ///
    /// # Errors
    /// One sentence when they cannot come, or on an early end.
    pub fn refuse(&self) -> Result<Vec<Refused>, Failure> {
        let strangers = self.make_keys()?;
        let (domain, address) = self.meeting().map_err(Failure::Run)?;
        let mut station = self.station(&domain, &address).map_err(Failure::Run)?;
        let mut all = Vec::new();
        for (who, folder, refusal) in &strangers {
            let answer = self.stranger(&mut station, &address, folder, *refusal);
            all.push(Refused::of(*who, answer));
        }
        for (who, forge) in FORGED {
            let answer = self
                .forged_controller(&mut station, &address, forge(Role::Controller))
                .and_then(|_| self.forged_station(forge(Role::Station)));
            all.push(Refused::of(who, answer));
        }
        let after = self.good(&address).and_then(|()| station.end());
        if is_set(self.stop) {
            return Err(Failure::Run("ended early on request".to_string()));
        }
        if let Err(why) = after {
            for one in &mut all {
                one.named = false;
                one.what = format!("{}; but after all of them: {why}", one.what);
            }
        }
        Ok(all)
    }

    /// Makes good keys, and those of each stranger: a folder with the authority that the station
    /// is of, so that the stranger takes the station.
    fn make_keys(&self) -> Result<[(Who, PathBuf, Refusal); 3], Failure> {
        let at = |name: &str| self.folder.join(name);
        self.programs.make_keys(&at("good"), LOOPBACK)?;
        self.programs.make_keys(&at("foreign"), LOOPBACK)?;
        self.programs.make_keys_for(&at("expired"), LOOPBACK, 0)?;
        pause(EXPIRES_S, self.stop);
        let wrong = |path: &Path| {
            let path = path.to_path_buf();
            move |error: std::io::Error| Failure::write_at(Chosen::Temporary, &path, &error)
        };
        let files = |side: &Path| {
            KeyFiles::in_folder(side).map_err(|error| Failure::Input(error.to_string()))
        };
        let authority = files(&at("good/controller"))?.authority;
        for name in ["foreign", "expired", "none"] {
            let side = at(name).join("controller");
            fs::create_dir_all(&side).map_err(wrong(&side))?;
            fs::copy(&authority, files(&side)?.authority).map_err(wrong(&side))?;
        }
        // The station trusts who made the old keys too: their age alone is wrong.
        let own = PathBuf::from(files(&at("good/station"))?.authority);
        let old = files(&at("expired/station"))?.authority;
        let both = [own.clone(), old.into()].map(|path| fs::read(&path).map_err(wrong(&path)));
        let [own_pem, old_pem] = both;
        let both: Vec<u8> = own_pem?.into_iter().chain(old_pem?).collect();
        fs::write(&own, both).map_err(wrong(&own))?;
        let of = |name: &str| at(name).join("controller");
        Ok([
            (Who::ForeignCertificate, of("foreign"), FOREIGN),
            (Who::NoCertificate, of("none"), NO_CERTIFICATE),
            (Who::Expired, of("expired"), EXPIRED),
        ])
    }

    /// A domain, and an address that nobody has.
    fn meeting(&self) -> Result<(OwnDomain, String), String> {
        let domain = OwnDomain::new().map_err(|error| error.to_string())?;
        let port = TcpListener::bind((LOOPBACK, 0)).and_then(|socket| socket.local_addr());
        let port = port.map_err(|error| error.to_string())?.port();
        Ok((domain, format!("tls/{LOOPBACK}:{port}")))
    }

    fn good_keys(&self, side: &str) -> [OsString; 2] {
        let folder = self.folder.join("good").join(side);
        ["--keys".into(), folder.into()]
    }

    fn station(&self, domain: &OwnDomain, address: &str) -> Result<Watched, String> {
        let mut typed: Vec<OsString> = vec!["serve".into(), self.scene.into()];
        typed.extend(["--domain", domain.name(), "--listen", address].map(OsString::from));
        typed.extend(self.good_keys("station"));
        let program = &self.programs.station;
        let around = Surroundings::default();
        let mut station = Watched::start_program("station", program, &typed, around)?;
        station.wait_for("the start", self.stop, |of| of.ready_ns.is_some())?;
        Ok(station)
    }

    fn controller(&self, domain: &OwnDomain, more: &[OsString]) -> Result<Watched, String> {
        let mut typed: Vec<OsString> = vec!["run".into(), self.scene.into()];
        typed.extend(
            ["--domain", domain.name(), "--supervised", "--record=off"].map(OsString::from),
        );
        typed.extend(more.iter().cloned());
        let program = &self.programs.controller;
        Watched::start_program("controller", program, &typed, Surroundings::default())
    }

    /// A controller behind a tunnel with these keys.
    fn stranger(
        &self,
        station: &mut Watched,
        address: &str,
        keys: &Path,
        refusal: Refusal,
    ) -> Result<String, String> {
        let domain = OwnDomain::new().map_err(|error| error.to_string())?;
        let mut typed: Vec<OsString> = ["--as-stranger", "--call", address, "--keys"]
            .map(OsString::from)
            .to_vec();
        typed.push(keys.into());
        let mut caller = Alone::start(&self.programs.controller, &domain, &typed)?;
        let controller = self.controller(&domain, &[])?;
        station.wait_for("the refusal", self.stop, |of| of.has_said(refusal.by))?;
        caller.wait_for(refusal.of, self.stop)?;
        pause(WAITS_S, self.stop);
        station.listen();
        if station.has_said(LINKED_FROM) {
            return Err("it was let in".to_string());
        }
        given_nothing(controller)?;
        Ok(format!("{}; {}", refusal.by, refusal.of))
    }

    /// A caller with good keys that says this to the station.
    fn forged_controller(
        &self,
        station: &mut Watched,
        address: &str,
        hello: Hello,
    ) -> Result<String, String> {
        let domain = OwnDomain::new().map_err(|error| error.to_string())?;
        let mut typed: Vec<OsString> = ["--call", address].map(OsString::from).to_vec();
        typed.extend(self.good_keys("controller"));
        let _caller = Alone::start(&self.programs.controller, &domain, &typed)?;
        let named = refusal_of(hello)?;
        say_until(&domain, hello, self.stop, || {
            station.listen();
            station.has_said(&named)
        })?;
        Ok(named)
    }

    /// One that listens with good keys and says this to a controller that calls.
    fn forged_station(&self, hello: Hello) -> Result<String, String> {
        let (domain, address) = self.meeting()?;
        let mut typed: Vec<OsString> = ["--listen", &address].map(OsString::from).to_vec();
        typed.extend(self.good_keys("station"));
        let mut listener = Alone::start(&self.programs.station, &domain, &typed)?;
        listener.wait_for("ready", self.stop)?;
        let there = OwnDomain::new().map_err(|error| error.to_string())?;
        let mut controller = self.controller(&there, &self.calling(&address))?;
        let named = refusal_of(hello)?;
        say_until(&domain, hello, self.stop, || {
            controller.listen();
            controller.has_said(&named)
        })?;
        given_nothing(controller)?;
        Ok(named)
    }

    fn calling(&self, address: &str) -> Vec<OsString> {
        let call = ["--station", address].map(OsString::from);
        call.into_iter()
            .chain(self.good_keys("controller"))
            .collect()
    }

    /// A good controller touches.
    fn good(&self, address: &str) -> Result<(), String> {
        let domain = OwnDomain::new().map_err(|error| error.to_string())?;
        let mut typed = self.calling(address);
        typed.push(format!("--seconds={TOUCH_S}").into());
        let mut controller = self.controller(&domain, &typed)?;
        controller.wait_for_end(PATIENCE, self.stop)?;
        let finished = controller.finished.take();
        let result = finished
            .ok_or("a good controller ended without a result")?
            .result;
        if result.contact_full_ticks > 0 && result.contact_unbounded_ticks == 0 {
            Ok(())
        } else {
            Err("a good controller did not touch at full resolution".to_string())
        }
    }
}

/// The sentence by which both programs refuse it.
fn refusal_of(hello: Hello) -> Result<String, String> {
    match hello.read() {
        Ok(_) => Err("it is a heartbeat as any other".to_string()),
        Err(refusal) => Ok(refusal.to_string()),
    }
}

/// Ends a controller that must not have been given anything.
fn given_nothing(mut controller: Watched) -> Result<(), String> {
    controller.end()?;
    let finished = controller.finished.take();
    let result = finished
        .ok_or("its controller ended without a result")?
        .result;
    if result.vsps_received == 0 && result.contact_ticks == 0 {
        Ok(())
    } else {
        Err("it was served".to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::faults::Harmed;

    #[test]
    fn both_programs_have_a_sentence_for_every_forged_heartbeat() {
        let sentences = FORGED.map(|(_, forge)| {
            [Role::Station, Role::Controller].map(|role| refusal_of(forge(role)).unwrap())
        });
        for [of_station, of_controller] in &sentences {
            assert_eq!(of_station, of_controller);
        }
        assert_ne!(sentences[0], sentences[1]);
        assert!(refusal_of(Hello::new(Role::Station, 1, 1)).is_err());
    }

    #[test]
    fn packets_are_refused_where_there_were_some_and_both_sides_said_so() {
        let named = |damaged, replayed, named| {
            let harmed = Harmed {
                damaged,
                replayed,
                named,
            };
            let faults = Faults {
                harmed,
                ..Faults::default()
            };
            Refused::packets(&faults).map(|of| (of.who, of.named))
        };
        let both = [Who::Replayed, Who::Damaged];
        for (seen, expected) in [
            (named(3, 4, true), [true, true]),
            (named(3, 0, true), [false, true]),
            (named(0, 4, true), [true, false]),
            (named(3, 4, false), [false, false]),
        ] {
            assert_eq!(seen, [(both[0], expected[0]), (both[1], expected[1])]);
        }
    }
}
