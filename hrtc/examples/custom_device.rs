//! A device of one's own in the program `hrtc`: a mass on a moving spring that taps on a ball.
//!
//! ```text
//! cargo run --release -p hrtc --example custom_device                     # three seconds
//! cargo run --release -p hrtc --example custom_device -- run SCENE.toml   # all that hrtc can
//! ```
//!
//! Without a command line it makes a scene, and runs its station on a thread beside itself.

use glam::DVec3;
use haptic_device::{Capabilities, Device, Pose, Sample, TickTime, Wrench, WrenchCommand};
use hrtc::devices::DeviceRegistry;
use std::error::Error;
use std::ffi::OsStr;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use ve_station::serve::{ServeArgs, serve};

const SCENE: &str = r#"object = [{ generate = { shape = "sphere", faces = 2000 }, size_m = 0.1 }]
probe = [{ device = { custom = { name = "tapper", period_s = 0.5 } } }]"#;

struct Tapper {
    tap_period_s: f64,
    position: DVec3,
    velocity: DVec3,
    command: WrenchCommand,
    dt: f64,
}

impl Tapper {
    fn new(tap_period_s: f64, dt: f64) -> Self {
        Self {
            tap_period_s,
            position: DVec3::Z * 0.058,
            velocity: DVec3::ZERO,
            command: WrenchCommand::unlimited(Wrench::ZERO),
            dt,
        }
    }

    /// The force that acts at a time. Nothing may act for longer than it is valid: the controller
    /// may hang or be gone, and then nobody calls the driver. Hardware that keeps its last force
    /// ends it by itself: its firmware does, or a timer of the driver.
    fn force_at(&self, now_ns: u64) -> DVec3 {
        if now_ns < self.command.valid_until_ns {
            self.command.wrench.force
        } else {
            DVec3::ZERO
        }
    }
}

impl Device for Tapper {
    fn capabilities(&self) -> Capabilities {
        Capabilities::translational("tapper", 5.0)
    }
    fn read(&mut self, time: TickTime) -> Option<Sample> {
        let phase = std::f64::consts::TAU * (time.start_ns as f64 * 1e-9) / self.tap_period_s;
        let hand = DVec3::Z * (0.052 + 0.006 * phase.cos());
        // Several where ticks were late.
        for left in (0..time.periods).rev() {
            let past_ns = f64::from(left + 1) * self.dt * 1e9;
            let rendered = self.force_at(time.start_ns.saturating_sub(past_ns as u64));
            let force = rendered + (hand - self.position) * 200.0 - self.velocity * 3.0;
            self.velocity += force * (self.dt / 0.05);
            self.position += self.velocity * self.dt;
        }
        Some(Sample {
            time_ns: time.start_ns,
            ..Sample::at(Pose::at(self.position))
        })
    }
    fn write(&mut self, command: WrenchCommand) {
        self.command = command;
    }
    fn safe_off(&mut self) {
        self.command = WrenchCommand::unlimited(Wrench::ZERO);
    }
}

/// All that a program with a driver needs: command line, signals and their ramp, the link.
fn main() -> Result<ExitCode, Box<dyn Error>> {
    let devices = DeviceRegistry::new().with("tapper", |request| {
        let period_s = request.settings.get("period_s").and_then(|v| v.as_float());
        let period_s = period_s.ok_or("its settings need period_s = 0.5")?;
        Ok(Box::new(Tapper::new(period_s, request.period_s)))
    });
    if std::env::args_os().len() > 1 {
        return Ok(hrtc::cli::main(&devices));
    }
    tap_on_a_ball(&devices)
}

/// The program with a command line, a scene and a station of the example's own.
fn tap_on_a_ball(devices: &DeviceRegistry) -> Result<ExitCode, Box<dyn Error>> {
    let domain = format!("custom-device-{}", std::process::id());
    let scene = std::env::temp_dir().join(&domain).with_extension("toml");
    std::fs::write(&scene, SCENE)?;
    let served = ServeArgs {
        scene: scene.clone(),
        domain: domain.clone(),
        overrides: scene::Overrides::default(),
        view: None,
        json: false,
    };
    let words = ["custom_device", "run", "--seconds", "3", "--domain"].map(OsStr::new);
    let words = words
        .into_iter()
        .chain([OsStr::new(&domain), scene.as_os_str()]);
    let stop = AtomicBool::new(false);
    let status = std::thread::scope(|scope| {
        scope.spawn(|| serve(&served, &stop).map_err(|error| eprintln!("{error}")));
        let status = hrtc::cli::main_from(devices, words);
        stop.store(true, Ordering::Relaxed);
        status
    });
    std::fs::remove_file(&scene)?;
    transport::Domain::new(&domain)?.remove_files();
    Ok(status)
}

/// Run by `hrtc/tests/example.rs`.
#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_force_ends_with_its_validity_also_in_periods_that_were_skipped() {
        const MS: u64 = 1_000_000;
        // How far one force moves it, against none, in periods up to a time.
        let moved = |start_ns: u64, periods: u32| {
            let z = |newtons: f64| {
                let mut tapper = Tapper::new(0.5, 1e-3);
                tapper.write(WrenchCommand {
                    wrench: Wrench {
                        force: DVec3::Z * newtons,
                        ..Wrench::ZERO
                    },
                    valid_until_ns: 30 * MS,
                });
                let time = TickTime { start_ns, periods };
                let sample = tapper.read(time).expect("it always has one");
                sample.pose.position.z
            };
            z(1.0) - z(0.0)
        };
        assert!(moved(20 * MS, 1) > 0.0);
        assert_eq!(moved(1000 * MS, 1), 0.0);
        // The first of these periods ends before the force does.
        assert!(moved(40 * MS, 20) > 0.0);
        assert_eq!(moved(1000 * MS, 20), 0.0);
    }
}
