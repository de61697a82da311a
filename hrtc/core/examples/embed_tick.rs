//! The core in a loop of one's own: controller and station in one process, a press onto a sphere.
//! A loop that drives hardware keeps the period (this one waits for nobody), and does with the
//! devices what stands at each step.
//!
//! ```text
//! cargo run -p hrtc-core --example embed_tick
//! ```

use geometry::Pose;
use glam::DVec3;
use haptic_device::{DegreesOfFreedom, MotionLimits, Sample};
use hrtc_core::governor::{MeasuredTick, WorkCosts};
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::streaming::subscriber::Identity;
use hrtc_core::{
    Controller, ControllerOptions, Stage, StageObserver, TickInputs, Timed, WrenchLimits,
};
use protocol::Request;
use scene::{NoFiles, Overrides, ScenePlan, parse};
use spm::{SpmFile, write_spm};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, build_model};
use station_core::station::{Message, ServedModel, ServedObject, Station};
use std::error::Error;
use std::time::{Duration, Instant};

const SCENE: &str = "[[object]]\nmodel = \"ball.spm\"\nsize_m = 0.1\n[[probe]]\n";
const STATION: u64 = 1;
const TICKS: u64 = 1500;
const IDENTITY: Identity = Identity {
    client: 7,
    incarnation: 1,
};

/// A controller that knows its device. What it is not told it takes to be without limits.
fn controller(plan: &ScenePlan) -> Controller {
    let options = ControllerOptions {
        // What the motors render: the scene may allow more.
        limits: &[WrenchLimits {
            force_n: 10.0,
            torque_nm: 0.3,
        }],
        // The scene has a tour by default; the poses are our own.
        tour_seconds: 1.0,
    };
    let mut controller = Controller::new(plan, IDENTITY, options);
    // A sample that no hand can have moved to is a fault of the encoders: it gets no force.
    controller.set_motion_limits(0, MotionLimits::HAND);
    // What is not rendered does no work in the energy account. Steps of the encoders are the
    // plan's: `plan.probes[0].device.encoder_m`, and `rotation`.
    controller.set_rendered(0, DegreesOfFreedom::Three);
    // Measured by `hrtc::calibration` on the machine that ticks.
    controller.set_costs(WorkCosts::REFERENCE);
    controller
}

/// Tells the core when the time of a tick is over; without one (`NoObserver`) it never is. A replay
/// needs the same answers.
struct Deadline {
    start: Instant,
    period: Duration,
}

impl StageObserver for Deadline {
    fn ended(&mut self, _: Stage) {}

    fn is_over(&mut self, work: Timed) -> bool {
        self.start.elapsed() > self.period.mul_f64(work.last_begin())
    }
}

fn station() -> Result<Station<Vec<u8>>, Box<dyn Error>> {
    let mesh = generate(Shape::Sphere, 1000, 1);
    let parts = build_model(mesh, &BuildOptions::default(), &NoProgress)?;
    let mut bytes = Vec::new();
    write_spm(&parts, &mut bytes)?;
    let name = "ball.spm".to_string();
    let object = ServedObject {
        model: 0,
        name: Request::name_hash(&name),
    };
    let file = SpmFile::open(bytes)?;
    let models = vec![ServedModel { name, file }];
    Ok(Station::new(STATION, models, vec![object]))
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut station = station()?;
    let plan = parse(SCENE, "ball", "".as_ref(), &Overrides::default(), &NoFiles)?;
    let mut controller = controller(&plan);
    let mut outputs = controller.new_outputs();
    let mut inbox: Vec<InboxChunk> = Vec::new();
    let (mut contact_ticks, mut full_ticks) = (0, 0);
    let period = Duration::from_secs_f64(1.0 / plan.loop_.rate_hz);
    let mut took: Option<Duration> = None;
    for tick in 0..TICKS {
        let start = Instant::now();
        if let Some(took) = took {
            // Of the processor, where the system tells it; drivers apart.
            controller.note_work(MeasuredTick {
                work_ns: took.as_nanos() as u32,
                device_ns: 0,
            });
        }
        // And `controller.force_was_cut()` where the last wrench expired before this tick: a device
        // obeys one for `haptic_device::COMMAND_VALIDITY_S`, then goes to zero by itself, and the
        // force comes back along its ramp.
        //
        // From 10 mm above the surface to 2 mm below it, within the first second.
        let height = 0.06 - 0.012 * (tick as f64 / 1000.0).min(1.0);
        let pose = Pose::at(DVec3::Z * height);
        let inputs = TickInputs {
            tick,
            samples: &[Some(Sample::at(pose))],
            station: STATION,
            chunks: [&inbox, &[]],
            // True before the end, until all wrenches are zero.
            stopping: false,
        };
        controller.tick(&inputs, &mut outputs, &mut Deadline { start, period });
        took = Some(start.elapsed());
        inbox.drain(..outputs.chunks_consumed);
        for request in outputs.outbox.requests() {
            station.handle(Message::Request(request));
        }
        station.tell_time((1000 * tick) as u32);
        while let Some((header, slots)) = station.poll(IDENTITY.client) {
            inbox.push(InboxChunk { header, slots });
        }
        contact_ticks += u32::from(outputs.record.contact);
        full_ticks += u32::from(outputs.record.contact_full);
    }
    println!("depth {:.2} mm", 1e3 * outputs.record.depth_m);
    println!("force {:.2} N", outputs.wrenches[0].force.length());
    let share = 100.0 * f64::from(full_ticks) / f64::from(contact_ticks.max(1));
    println!("full resolution in {share:.1} % of {contact_ticks} contact ticks");
    Ok(())
}
