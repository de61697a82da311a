//! Cases of the station: whatever becomes of it, the touch goes on.

use super::bench::Bench;
use super::touch::{RESYNC_MS, Start, Touch, own_domain, start_station};
use super::verdict::{Answer, Verdicts};
use crate::processes::voice::say_until;
use crate::processes::watched::{Watched, pause};
use protocol::{Hello, PROTOCOL_VERSION, Role};
use realtime::rights::monotonic_ns;
use std::rc::Rc;
use std::time::Instant;

/// Time for which a station is away: twice the silence after which it counts as absent, seconds.
const AWAY_S: f64 = 1.0;

/// Disturbs in runs of a few times until it was done so often; the worst run's answer.
fn repeat(
    bench: &Bench,
    times: u64,
    verdicts: &mut Verdicts,
    disturb: &mut dyn FnMut(&mut Touch) -> Result<(), String>,
) -> Answer {
    let mut done = 0;
    let mut seen = String::new();
    while done < times {
        let mut touch = Touch::usual(bench)?;
        let before = done;
        while done < times && touch.has_room() {
            bench.bar.set_message(format!("{} of {times}", done + 1));
            let began = Instant::now();
            disturb(&mut touch)?;
            touch.end_slot(began);
            done += 1;
        }
        if done == before {
            return Err("no disturbance fits into a run; this machine is too busy".to_string());
        }
        seen = verdicts.judge(&touch.finish()?).map_err(|wrong| {
            format!("{wrong} (disturbances {} to {done} of {times})", before + 1)
        })?;
    }
    Ok(format!("{done} times; in the last run {seen}"))
}

/// Once in one run.
fn once(
    bench: &Bench,
    verdicts: &mut Verdicts,
    disturb: &mut dyn FnMut(&mut Touch) -> Result<(), String>,
) -> Answer {
    repeat(bench, 1, verdicts, disturb)
}

/// SIGKILL, and another one at once.
pub fn killed(bench: &Bench, kills: u64, verdicts: &mut Verdicts) -> Answer {
    let mut count = 0;
    let answer = repeat(bench, kills, verdicts, &mut |touch| {
        touch.station.kill();
        count += 1;
        touch.restart_station()
    });
    verdicts.faults.kills.station += count;
    answer
}

/// SIGSTOP, and SIGCONT when it counts as absent.
pub fn stopped(bench: &Bench, kills: u64, verdicts: &mut Verdicts) -> Answer {
    repeat(
        bench,
        kills.min(bench.slots as u64),
        verdicts,
        &mut |touch| {
            touch.station.process.signal(libc::SIGSTOP);
            pause(AWAY_S, bench.stop);
            touch.station.process.signal(libc::SIGCONT);
            touch.returns_ns.push(monotonic_ns());
            Ok(())
        },
    )
}

/// SIGTERM, and another one.
pub fn restarted(bench: &Bench, kills: u64, verdicts: &mut Verdicts) -> Answer {
    repeat(
        bench,
        kills.min(bench.slots as u64),
        verdicts,
        &mut |touch| {
            touch.station.end()?;
            touch.restart_station()
        },
    )
}

/// A station of another version in its place, for a while: it is named, and not believed.
pub fn other_version(bench: &Bench, _kills: u64, verdicts: &mut Verdicts) -> Answer {
    once(bench, verdicts, &mut |touch| {
        touch.station.kill();
        speak_other_version(touch, bench)?;
        touch.controller.listen();
        let named = format!("protocol version {}", PROTOCOL_VERSION + 1);
        if !touch.controller.has_said(&named) {
            return Err("the controller did not name the other version".to_string());
        }
        touch.restart_station()
    })
}

/// Sends heartbeats of the next version for a while.
fn speak_other_version(touch: &Touch, bench: &Bench) -> Result<(), String> {
    let start = Instant::now();
    let hello = Hello::of_version(PROTOCOL_VERSION + 1, Role::Station, monotonic_ns(), 0);
    say_until(&touch.domain, hello, bench.stop, || {
        start.elapsed().as_secs_f64() >= AWAY_S
    })
}

/// Its model's file is overwritten with noise and cut short while it is read, then made whole.
pub fn file_overwritten(bench: &Bench, _kills: u64, verdicts: &mut Verdicts) -> Answer {
    let answer = once(bench, verdicts, &mut |touch| {
        let half = bench.model_bytes.len() / 2;
        let mut noise = bench.model_bytes.clone();
        let bytes = (0_u32..).map(|k| (k.wrapping_mul(0x9E37_79B9) >> 24) as u8);
        for (byte, noise) in noise[half..].iter_mut().zip(bytes) {
            *byte = noise;
        }
        for bytes in [&noise[..], &noise[..half]] {
            let written = bench.overwrite_model(bytes);
            written.map_err(|error| format!("the model's file cannot be written ({error})"))?;
            pause(0.5 * AWAY_S, bench.stop);
        }
        let whole = bench.overwrite_model(&bench.model_bytes);
        whole.map_err(|error| format!("the model's file cannot be written ({error})"))?;
        touch.station.kill();
        touch.restart_station()
    });
    let mended = bench.overwrite_model(&bench.model_bytes);
    mended.map_err(|error| format!("the model's file cannot be written ({error})"))?;
    answer
}

/// The domain's folder is removed: the touch goes on, and the next start of both is not blocked.
pub fn folder_removed(bench: &Bench, _kills: u64, verdicts: &mut Verdicts) -> Answer {
    let domain = own_domain()?;
    let mut touch = Touch::begin(bench, Rc::clone(&domain), Start::usual(bench))?;
    let folder = domain.root();
    let removed = std::fs::remove_dir_all(&folder);
    removed.map_err(|error| format!("{}: {error}", folder.display()))?;
    pause(AWAY_S, bench.stop);
    touch.controller.listen();
    if !touch.controller.is_touching() {
        return Err("the touch ended".to_string());
    }
    let seen = verdicts.judge(&touch.finish()?)?;
    let next = Touch::begin(bench, domain, Start::usual(bench))?;
    verdicts.judge(&next.finish()?)?;
    Ok(format!("{seen}; the next start touched"))
}

/// A second station: it says so, the first one is kept, and when that dies the second takes over.
pub fn two_stations(bench: &Bench, _kills: u64, verdicts: &mut Verdicts) -> Answer {
    once(bench, verdicts, &mut |touch| {
        let mut second = start_station(bench, &touch.domain)?;
        let words = "another station serves";
        second.wait_for("a word on the first", bench.stop, |of: &Watched| {
            of.has_said(words)
        })?;
        pause(0.3, bench.stop);
        let mut first = std::mem::replace(&mut touch.station, second);
        first.kill();
        touch.returns_ns.push(monotonic_ns());
        pause(RESYNC_MS * 1e-3, bench.stop);
        Ok(())
    })
}
