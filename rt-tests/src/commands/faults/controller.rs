//! Cases of the controller: killed, too many, without rights, on a full disk, on a stepped clock.

use super::FaultsArgs;
use super::bench::Bench;
use super::touch::{Start, Touch, own_domain, start_controller};
use super::verdict::{Answer, Verdicts};
use crate::processes::mounts::SmallDisk;
use crate::processes::rights::{SYS_ADMIN, SYS_TIME};
use crate::processes::surroundings::Surroundings;
use crate::processes::watched::{Watched, pause};
use hrtc::recorder::NOT_RECORDED;
use hrtc_core::Fault;
use protocol::MAX_CLIENTS;
use std::ffi::CString;
use std::os::unix::ffi::OsStrExt;
use std::time::Instant;

/// The step of the clock, seconds.
const STEP_S: i64 = 3600;
/// Time in contact before a kill, seconds.
const IN_CONTACT_S: f64 = 0.3;
/// Time in which the newest of too many controllers has its say, seconds.
const SAY_S: f64 = 3.0;

/// Whether a small disk can be mounted.
pub fn can_mount(_: &FaultsArgs) -> Result<(), String> {
    if SYS_ADMIN.is_held() {
        return Ok(());
    }
    Err("mounting a small disk needs the right CAP_SYS_ADMIN".to_string())
}

/// Whether the clock may be stepped.
pub fn can_step_clock(args: &FaultsArgs) -> Result<(), String> {
    if !args.step_clock {
        return Err("it moves the clock of the whole machine: ask for it with --step-clock".into());
    }
    if SYS_TIME.is_held() {
        return Ok(());
    }
    Err("setting the clock needs the right CAP_SYS_TIME".to_string())
}

/// SIGKILL in contact and another one at once, beside one station; the last one ends as a fresh
/// start does.
pub fn killed(bench: &Bench, kills: u64, verdicts: &mut Verdicts) -> Answer {
    let mut touch = Touch::usual(bench)?;
    let mut slowest: f64 = 0.0;
    for kill in 1..=kills {
        bench.bar.set_message(format!("kill {kill} of {kills}"));
        pause(IN_CONTACT_S, bench.stop);
        touch.controller.kill();
        verdicts.faults.kills.controller += 1;
        let start = Instant::now();
        touch.replace_controller()?;
        slowest = slowest.max(start.elapsed().as_secs_f64());
    }
    let seen = verdicts.judge(&touch.finish()?)?;
    Ok(format!(
        "{kills} times, in touch again within {slowest:.1} s; {seen}"
    ))
}

/// One more than a station serves: the others touch on, and a place that becomes free is taken.
pub fn seventeen(bench: &Bench, _kills: u64, verdicts: &mut Verdicts) -> Answer {
    let slow = || Start {
        scene: "slow.toml",
        seconds: 600.0,
        // All cores: seventeen times the threads of one.
        around: Surroundings {
            core: None,
            ..bench.around()
        },
        ..Start::usual(bench)
    };
    let mut touch = Touch::usual(bench)?;
    touch.controller.end()?;
    let mut others: Vec<Watched> = Vec::new();
    for count in 1..=MAX_CLIENTS {
        bench.bar.set_message(format!("controller {count}"));
        let (mut other, _) = start_controller(bench, &touch.domain, slow())?;
        let touching = other.wait_for("the first touch", bench.stop, Watched::is_touching);
        touching.map_err(|error| format!("controller {count} of {MAX_CLIENTS}: {error}"))?;
        others.push(other);
    }
    let (mut last, _) = start_controller(bench, &touch.domain, slow())?;
    pause(SAY_S, bench.stop);
    last.listen();
    let outcome = if last.is_touching() {
        "the last was served as well"
    } else if last.has_said(&Fault::NoPlace.to_string()) {
        "the last was refused in words"
    } else {
        let words = last.said.join(" | ");
        return Err(format!(
            "the last one was neither served nor told why, it said: {words}"
        ));
    };
    for (index, other) in others.iter_mut().enumerate() {
        other.listen();
        if !other.is_touching() {
            return Err(format!("controller {} lost its touch", index + 1));
        }
    }
    for other in others.iter_mut() {
        other.end()?;
        let finished = other
            .finished
            .take()
            .ok_or("a controller without a result")?;
        verdicts.faults.missed_own_cpu += finished.result.missed_own_cpu;
    }
    let served = last.wait_for(
        "a touch after the others ended",
        bench.stop,
        Watched::is_touching,
    );
    if last.process.ended().is_none() {
        served?;
        last.end()?;
    }
    touch.replace_controller()?;
    let seen = verdicts.judge(&touch.finish()?)?;
    Ok(format!("{outcome}; after them {seen}"))
}

/// Neither locked memory nor a real-time priority: it says so and touches all the same.
pub fn no_rights(bench: &Bench, _kills: u64, verdicts: &mut Verdicts) -> Answer {
    let start = Start {
        around: Surroundings {
            without_rights: true,
            ..bench.around()
        },
        ..Start::usual(bench)
    };
    let touched = Touch::begin(bench, own_domain()?, start)?.finish()?;
    let missing = touched
        .finished
        .rights
        .iter()
        .filter(|right| !right.obtained);
    let names: Vec<&str> = missing.map(|right| right.name.as_str()).collect();
    if names.len() < 2 {
        return Err("the rights were taken, but the result does not say so".to_string());
    }
    let result = &touched.finished.result;
    verdicts.faults.missed_own_cpu += result.missed_own_cpu;
    if result.contact_ticks == 0 || result.missed_own_cpu > 0 || !touched.left.is_empty() {
        return Err(format!(
            "{} ticks in contact, {} own misses, {} files left",
            result.contact_ticks,
            result.missed_own_cpu,
            touched.left.len()
        ));
    }
    Ok(format!("touched; named as missing: {}", names.join(", ")))
}

/// A recording on a disk that fills up in the run.
pub fn disk_full(bench: &Bench, _kills: u64, verdicts: &mut Verdicts) -> Answer {
    let folder = bench.path("disk");
    let c_folder = CString::new(folder.as_os_str().as_bytes());
    let small_disk = SmallDisk {
        folder: c_folder.map_err(|error| error.to_string())?,
        options: c"size=1m".into(),
    };
    let file = folder.join("run.recording");
    let start = Start {
        more: vec![format!("--record={}", file.display())],
        around: Surroundings {
            small_disk: Some(small_disk),
            ..bench.around()
        },
        ..Start::usual(bench)
    };
    let mut touch = Touch::begin(bench, own_domain()?, start)?;
    pause(bench.seconds(), bench.stop);
    touch.controller.listen();
    let told = touch.controller.has_said(NOT_RECORDED);
    let touched = touch.finish()?;
    let seen = verdicts.judge(&touched)?;
    if touched.finished.result.safety.recording_errors == 0 {
        return Err("the disk took the whole recording: it did not fill up".to_string());
    }
    if !told {
        return Err("the recording is incomplete, but nobody said so".to_string());
    }
    Ok(format!("{seen}; the full disk was told"))
}

/// The wall clock goes an hour ahead and back in contact.
pub fn clock_stepped(bench: &Bench, _kills: u64, verdicts: &mut Verdicts) -> Answer {
    let touch = Touch::usual(bench)?;
    step_clock(STEP_S)?;
    pause(1.0, bench.stop);
    step_clock(-STEP_S)?;
    verdicts.judge(&touch.finish()?)
}

fn step_clock(seconds: i64) -> Result<(), String> {
    let mut now = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: both calls take a structure that lives on this stack.
    let is_set = unsafe {
        libc::clock_gettime(libc::CLOCK_REALTIME, &raw mut now);
        now.tv_sec += seconds;
        libc::clock_settime(libc::CLOCK_REALTIME, &raw const now) == 0
    };
    if is_set {
        return Ok(());
    }
    let error = std::io::Error::last_os_error();
    Err(format!("the clock cannot be set ({error})"))
}
