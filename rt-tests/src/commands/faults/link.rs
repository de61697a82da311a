//! Cases of two hosts: the cable between them cut, the tunnels at its ends killed, the station at
//! its far end restarted, its packets changed and sent once more. The touch goes on, and ends as an
//! undisturbed one over the same link does.

use super::FaultsArgs;
use super::bench::{Bench, SLOT_S};
use super::touch::{Touch, Undisturbed, own_domain};
use super::verdict::{Answer, Verdicts};
use crate::links::hosts::{DAMAGED, Hosts, Links, STATION, Side, links_made};
use crate::links::points::{Guest, Point};
use crate::links::programs::{Programs, missing_right};
use crate::links::relay::Relay;
use crate::links::way::Shape;
use crate::processes::surroundings::Surroundings;
use crate::processes::watched::{Watched, pause};
use realtime::rights::monotonic_ns;
use std::ffi::OsString;
use transport::Domain;
use tunnel::named::{ENDED, LOST};

/// The link: to another city, and as fast as an office's.
const LINK: Guest = Guest::at(Point::new(20.0, 100.0));
/// Seed of the relay.
const SEED: u64 = 1;
/// Time in which a station must be synchronised from the return of its link on, milliseconds.
const RESYNC_MS: f64 = 2000.0;
/// Length of a cut, seconds: five times the silence after which a link counts as broken.
const CUT_S: f64 = 10.0;
/// Length of a short one, seconds: half as long again as that silence, so that the broken
/// connection has hardly ended when the next one can be made.
const SHORT_CUT_S: f64 = 3.0;
/// Time in contact before a disturbance, seconds.
const IN_CONTACT_S: f64 = 1.0;
/// Room for a cut in a run, in slots; the rest behind it has its own time.
const SLOTS: usize = 12;
/// Slots in which a link may be made again before the rest.
const HEALING_SLOTS: f64 = 2.0;
/// Shares of the packets that are changed, so that a link lasts some seconds, and sent once more.
const HARM: Shape = Shape {
    damaged: 8e-3,
    replayed: 0.05,
    round_trip_s: 0.0,
    jitter_s: 0.0,
    bits_per_s: 0.0,
    loss: 0.0,
};

/// What two hosts need.
pub fn needs(_: &FaultsArgs) -> Result<(), String> {
    missing_right(STATION).map_or(Ok(()), Err)?;
    Programs::find()
        .map(|_| ())
        .map_err(|error| error.to_string())
}

/// A touch whose station is on another host.
struct FarTouch<'a> {
    touch: Touch<'a>,
    station: Side,
    programs: Programs,
    relay: Relay,
}

fn start_station(
    bench: &Bench,
    programs: &Programs,
    domain: &Domain,
    side: &Side,
) -> Result<Watched, String> {
    let typed = typed("serve", bench, domain, side);
    let program = &programs.station;
    let mut station = Watched::start_program("station", program, &typed, side.around.clone())?;
    station.wait_for("the start", bench.stop, |of| of.ready_ns.is_some())?;
    Ok(station)
}

fn typed(verb: &str, bench: &Bench, domain: &Domain, side: &Side) -> Vec<OsString> {
    let mut typed = vec![verb.into(), bench.path("far.toml").into()];
    typed.extend(["--domain".into(), domain.name().into()]);
    typed.extend(side.typed.iter().cloned());
    typed
}

impl<'a> FarTouch<'a> {
    /// Starts both on hosts of their own and waits for the touch.
    fn begin(bench: &'a Bench<'a>, shape: Shape) -> Result<Self, String> {
        let programs = Programs::find().map_err(|error| error.to_string())?;
        let keys = bench.path("keys");
        if !keys.exists() {
            let made = programs.make_keys(&keys, &STATION.to_string());
            made.map_err(|error| error.to_string())?;
        }
        let seconds = bench.add_far(SLOTS)?;
        let domain = own_domain()?;
        let links = Links {
            keys,
            shape,
            seed: SEED,
        };
        let Hosts {
            station: mut at_station,
            controllers,
            relay,
        } = links.hosts(&[LINK], &domain.root())?;
        at_station.around = around(bench, at_station.around);
        let station = start_station(bench, &programs, &domain, &at_station)?;
        let side = controllers.into_iter().next();
        let side = side.ok_or("there is no host for the controller")?;
        let started_ns = monotonic_ns();
        let mut arguments = typed("run", bench, &domain, &side);
        arguments.push(format!("--seconds={seconds}").into());
        arguments.push(format!("--started-ns={started_ns}").into());
        arguments.extend(["--supervised", "--record=off"].map(OsString::from));
        let around = around(bench, side.around);
        let program = &programs.controller;
        let mut controller = Watched::start_program("controller", program, &arguments, around)?;
        controller.wait_for("the first touch", bench.stop, Watched::is_touching)?;
        Ok(Self {
            touch: Touch::of(bench, domain, station, (controller, started_ns), seconds),
            station: at_station,
            programs,
            relay,
        })
    }

    /// Waits until the link was made once more, after something came back at this time, ns, and is
    /// synchronised or is not.
    fn wait_for_link(&mut self, made_before: usize, back_ns: u64) -> Result<(), String> {
        let stop = self.touch.bench.stop;
        let touch = &mut self.touch;
        let again = |of: &Watched| links_made(of) > made_before;
        touch.controller.wait_for("the link", stop, again)?;
        // It may be synchronised before it is seen here.
        touch.returns_ns.push(back_ns);
        pause(1e-3 * RESYNC_MS, stop);
        Ok(())
    }

    fn links_made(&mut self) -> usize {
        self.touch.controller.listen();
        links_made(&self.touch.controller)
    }

    /// Whether another disturbance of the usual length can be mended before the rest.
    fn has_room(&self) -> bool {
        let needed_s = IN_CONTACT_S + 2.0 * 1e-3 * RESYNC_MS;
        self.touch.sliding_s() + needed_s < SLOTS as f64 * SLOT_S
    }
}

/// The surroundings of the bench, on a host.
fn around(bench: &Bench, on_host: Surroundings) -> Surroundings {
    Surroundings {
        host: on_host.host,
        ..bench.around()
    }
}

/// What an undisturbed touch over the link came to: the first time by one.
fn undisturbed(bench: &Bench, verdicts: &mut Verdicts) -> Result<Undisturbed, String> {
    if let Some(known) = &verdicts.undisturbed_over_link {
        return Ok(known.clone());
    }
    bench.bar.set_message("undisturbed over a link");
    let far = FarTouch::begin(bench, Shape::default())?;
    let touched = far.touch.finish()?;
    let result = &touched.finished.result;
    let found = Undisturbed {
        step_n: result.force_step_per_period_n_max,
        front: Some(result.front_hash),
        fronts_differ: false,
        missed_own_cpu: result.missed_own_cpu,
        resync_ms: RESYNC_MS,
    };
    Ok(verdicts.undisturbed_over_link.insert(found).clone())
}

/// Disturbs touches over the link until it was done so often; the worst run's answer.
fn repeat(
    bench: &Bench,
    times: u64,
    shape: Shape,
    verdicts: &mut Verdicts,
    disturb: &mut dyn FnMut(&mut FarTouch, u64) -> Result<(), String>,
) -> Answer {
    let undisturbed = undisturbed(bench, verdicts)?;
    let (mut done, mut seen) = (0, String::new());
    while done < times {
        let mut far = FarTouch::begin(bench, shape)?;
        let before = done;
        while done < times && (done == before || far.has_room()) {
            bench.bar.set_message(format!("{} of {times}", done + 1));
            pause(IN_CONTACT_S, bench.stop);
            disturb(&mut far, done)?;
            done += 1;
        }
        let made = far.links_made();
        let touched = far.touch.finish()?;
        let judged = verdicts.judge_by(&undisturbed, &touched);
        let harmed = &mut verdicts.faults.harmed;
        for way in far.relay.end()?.links.iter().flatten() {
            harmed.damaged += way.damaged;
            harmed.replayed += way.replayed;
        }
        let numbers = format!("{} to {done} of {times}", before + 1);
        seen = judged.map_err(|wrong| format!("{wrong} (disturbances {numbers})"))?;
        seen += &format!(", the link made {made} times");
    }
    Ok(format!("{times} times; in the last run {seen}"))
}

/// The cable cut for long, and mended.
pub fn cut(bench: &Bench, _kills: u64, verdicts: &mut Verdicts) -> Answer {
    cut_for(CUT_S, bench, verdicts)
}

/// The cable cut for a short time, and mended.
pub fn cut_shortly(bench: &Bench, _kills: u64, verdicts: &mut Verdicts) -> Answer {
    cut_for(SHORT_CUT_S, bench, verdicts)
}

fn cut_for(seconds: f64, bench: &Bench, verdicts: &mut Verdicts) -> Answer {
    repeat(bench, 1, Shape::default(), verdicts, &mut |far, _| {
        far.relay.cut(true);
        pause(seconds, bench.stop);
        far.relay.cut(false);
        far.touch.returns_ns.push(monotonic_ns());
        Ok(())
    })
}

/// SIGKILL of the process of a tunnel: the station's, the controller's, in turns.
pub fn tunnel_killed(bench: &Bench, kills: u64, verdicts: &mut Verdicts) -> Answer {
    repeat(
        bench,
        kills,
        Shape::default(),
        verdicts,
        &mut |far, number| {
            let made = far.links_made();
            let touch = &mut far.touch;
            touch.may_outlast = true;
            let side = if number % 2 == 0 {
                &mut touch.station
            } else {
                &mut touch.controller
            };
            side.process.signal_children(libc::SIGKILL);
            far.wait_for_link(made, monotonic_ns())
        },
    )
}

/// SIGTERM of the station, and another one.
pub fn station_restarted(bench: &Bench, kills: u64, verdicts: &mut Verdicts) -> Answer {
    repeat(bench, kills, Shape::default(), verdicts, &mut |far, _| {
        let made = far.links_made();
        far.touch.station.end()?;
        let domain = &far.touch.domain;
        far.touch.station = start_station(bench, &far.programs, domain, &far.station)?;
        far.wait_for_link(made, monotonic_ns())
    })
}

/// Packets that are changed so that no checksum of IP or TCP shows it, and packets that are sent
/// once more, until the last round: encryption refuses them, and the link is made again.
pub fn packets_changed(bench: &Bench, _kills: u64, verdicts: &mut Verdicts) -> Answer {
    let mut named = false;
    let answer = repeat(bench, 1, HARM, verdicts, &mut |far, _| {
        let until_s = (SLOTS as f64 - HEALING_SLOTS) * SLOT_S;
        pause(until_s - far.touch.sliding_s(), bench.stop);
        far.relay.calm();
        if far.links_made() < 2 {
            return Err("no changed packet broke the link".to_string());
        }
        if far.touch.controller.has_said(DAMAGED) {
            return Err("a changed packet passed the encryption".to_string());
        }
        far.touch.station.listen();
        named = far.touch.controller.has_said(LOST) && far.touch.station.has_said(ENDED);
        if named {
            Ok(())
        } else {
            Err("not both sides said that the link was lost".to_string())
        }
    });
    verdicts.faults.harmed.named = named;
    answer
}
