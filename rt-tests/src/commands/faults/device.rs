//! Cases of a device in a process of its own: whatever ends its controller, it is at zero soon
//! after its last wrench ceased to be valid.

use super::bench::Bench;
use super::touch::{Start, own_domain, start_controller, start_station};
use super::verdict::{Answer, Verdicts};
use crate::processes::device_page::DevicePage;
use crate::processes::own_domain::OwnDomain;
use crate::processes::watched::{PATIENCE, Watched, pause};
use realtime::rights::monotonic_ns;
use std::rc::Rc;
use std::time::Instant;

/// Limit of the time from the end of a wrench's validity to zero force, milliseconds: 20 periods.
const LATE_MS: f64 = 20.0;
/// Limit of the time from the fault to zero force, milliseconds: a wrench is valid for 30 periods,
/// and the 20 above.
const ZERO_MS: f64 = 50.0;
/// Force that must stand when the fault comes, newtons: half of what the path's depth asks for.
const FORCE_N: f64 = 1.2;
/// Time with the force before the fault, seconds: longer than its soft start.
const PRESSED_S: f64 = 0.3;

/// A fault of the controller.
struct Fault {
    put_in: fn(&mut Watched, &DevicePage),
    /// Whether it goes on after SIGCONT.
    survives: bool,
}

/// The station, the device, and the page between it and a controller.
struct Rig<'a> {
    bench: &'a Bench<'a>,
    page: DevicePage,
    device: Watched,
    station: Watched,
    domain: Rc<OwnDomain>,
}

impl<'a> Rig<'a> {
    fn start(bench: &'a Bench<'a>) -> Result<Self, String> {
        let path = bench.path("page");
        let page = DevicePage::open(&path).map_err(|error| error.to_string())?;
        page.reset();
        let typed = ["role-device".into(), path.into_os_string()];
        let mut device = Watched::start("device", &typed, bench.around())?;
        let before = monotonic_ns();
        device.wait_for("the first look", bench.stop, |_| page.looked_ns() > before)?;
        let domain = own_domain()?;
        Ok(Self {
            bench,
            station: start_station(bench, &domain)?,
            page,
            device,
            domain,
        })
    }

    /// A controller that presses.
    fn press(&mut self) -> Result<Watched, String> {
        let start = Start {
            scene: "device.toml",
            seconds: 600.0,
            ..Start::usual(self.bench)
        };
        let (mut controller, _) = start_controller(self.bench, &self.domain, start)?;
        self.wait_for_force(&mut controller)?;
        Ok(controller)
    }

    fn wait_for_force(&self, controller: &mut Watched) -> Result<(), String> {
        let page = &self.page;
        controller.wait_for("the force", self.bench.stop, |_| {
            page.rendered_n() > FORCE_N
        })?;
        pause(PRESSED_S, self.bench.stop);
        Ok(())
    }

    /// Puts the fault in; how late zero came after the validity's end, and after the fault,
    /// milliseconds.
    fn fault(&self, controller: &mut Watched, fault: &Fault) -> Result<(f64, f64), String> {
        if self.page.rendered_n() < FORCE_N {
            return Err("the force was gone before the fault".to_string());
        }
        let began = monotonic_ns();
        (fault.put_in)(controller, &self.page);
        let start = Instant::now();
        loop {
            if let Some((zero, valid_until)) = self.page.zero_since_ns() {
                let ms = |ns: u64| ns as f64 / 1e6;
                let late = ms(zero.saturating_sub(valid_until));
                return Ok((late, ms(zero.saturating_sub(began))));
            }
            if start.elapsed() > PATIENCE {
                return Err(format!(
                    "the device still renders {:.2} N",
                    self.page.rendered_n()
                ));
            }
            pause(1e-3, self.bench.stop);
        }
    }

    fn end(mut self) -> Result<(), String> {
        [self.station.end(), self.device.end()]
            .into_iter()
            .collect()
    }
}

/// Puts a fault in so often; a controller that ended is replaced.
fn repeat(bench: &Bench, times: u64, verdicts: &mut Verdicts, fault: &Fault) -> Answer {
    let mut rig = Rig::start(bench)?;
    let mut controller = rig.press()?;
    let (mut latest, mut slowest): (f64, f64) = (0.0, 0.0);
    for time in 1..=times {
        bench.bar.set_message(format!("{time} of {times}"));
        let (late, zero) = rig.fault(&mut controller, fault)?;
        (latest, slowest) = (latest.max(late), slowest.max(zero));
        verdicts.late_ms.push(late);
        verdicts.zero_ms.push(zero);
        controller.process.signal(libc::SIGCONT);
        if time == times {
            break;
        }
        if fault.survives {
            rig.wait_for_force(&mut controller)?;
        } else {
            controller.process.wait(PATIENCE);
            rig.page.reset();
            controller = rig.press()?;
        }
    }
    controller.kill();
    rig.end()?;
    let seen = format!(
        "{times} times; zero {latest:.1} ms after the last wrench at most, {slowest:.1} ms after the fault"
    );
    if latest <= LATE_MS && slowest <= ZERO_MS {
        Ok(seen)
    } else {
        Err(format!("{seen}; allowed are {LATE_MS} and {ZERO_MS} ms"))
    }
}

/// Its driver panics in a tick.
pub fn panics(bench: &Bench, kills: u64, verdicts: &mut Verdicts) -> Answer {
    let fault = Fault {
        put_in: |_, page| page.set_panic(true),
        survives: false,
    };
    repeat(bench, kills, verdicts, &fault)
}

/// SIGKILL.
pub fn killed(bench: &Bench, kills: u64, verdicts: &mut Verdicts) -> Answer {
    let fault = Fault {
        put_in: |controller, _| controller.process.signal(libc::SIGKILL),
        survives: false,
    };
    repeat(bench, kills, verdicts, &fault)
}

/// SIGSTOP; the force comes back after SIGCONT.
pub fn stopped(bench: &Bench, kills: u64, verdicts: &mut Verdicts) -> Answer {
    let fault = Fault {
        put_in: |controller, _| controller.process.signal(libc::SIGSTOP),
        survives: true,
    };
    repeat(bench, kills, verdicts, &fault)
}
