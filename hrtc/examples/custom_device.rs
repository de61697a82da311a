//! A device of one's own in a run: a mass on a moving spring that taps on a ball. The station runs
//! on a thread beside it. `cargo run --release -p hrtc --example custom_device`

use glam::DVec3;
use haptic_device::{Capabilities, Device, Pose, Sample, TickTime, WrenchCommand};
use hrtc::devices::DeviceRegistry;
use hrtc::run::{RunArgs, run_with};
use std::sync::atomic::{AtomicBool, Ordering};
use ve_station::serve::{ServeArgs, serve};

const SCENE: &str = r#"object = [{ generate = { shape = "sphere", faces = 2000 }, size_m = 0.1 }]
probe = [{ device = { custom = { name = "tapper", period_s = 0.5 } } }]"#;

#[derive(Default)]
struct Tapper {
    tap_period_s: f64,
    position: DVec3,
    velocity: DVec3,
    force: DVec3,
    dt: f64,
}

impl Device for Tapper {
    fn capabilities(&self) -> Capabilities {
        Capabilities::translational("tapper", 5.0)
    }
    fn read(&mut self, time: TickTime) -> Option<Sample> {
        let phase = std::f64::consts::TAU * (time.start_ns as f64 * 1e-9) / self.tap_period_s;
        let hand = DVec3::Z * (0.052 + 0.006 * phase.cos());
        for _ in 0..time.periods {
            let force = self.force + (hand - self.position) * 200.0 - self.velocity * 3.0;
            self.velocity += force * (self.dt / 0.05);
            self.position += self.velocity * self.dt;
        }
        Some(Sample {
            time_ns: time.start_ns,
            ..Sample::at(Pose::at(self.position))
        })
    }
    fn write(&mut self, command: WrenchCommand) {
        self.force = command.wrench.force;
    }
    fn safe_off(&mut self) {
        self.force = DVec3::ZERO;
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let registry = DeviceRegistry::new().with("tapper", |request| {
        let period_s = request.settings.get("period_s").and_then(|v| v.as_float());
        Ok(Box::new(Tapper {
            tap_period_s: period_s.ok_or("its settings need period_s = 0.5")?,
            position: DVec3::Z * 0.058,
            dt: request.period_s,
            ..Tapper::default()
        }))
    });
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
    let mut args = RunArgs::new(&scene, &domain);
    args.seconds = Some(3.0);
    let stop = AtomicBool::new(false);
    let result = std::thread::scope(|scope| {
        scope.spawn(|| serve(&served, &stop).map_err(|error| eprintln!("{error}")));
        let result = run_with(&registry, &args, &AtomicBool::new(false));
        stop.store(true, Ordering::Relaxed);
        result
    });
    std::fs::remove_file(&scene)?;
    transport::Domain::new(&domain)?.remove_files();
    Ok(result?)
}
