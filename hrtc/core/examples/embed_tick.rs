//! The core in a loop of one's own: controller and station in one process, a press onto a sphere.
//!
//! ```text
//! cargo run -p hrtc-core --example embed_tick
//! ```

use geometry::Pose;
use glam::DVec3;
use haptic_device::Sample;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::streaming::subscriber::Identity;
use hrtc_core::{Controller, NoObserver, TickInputs, TickOutputs};
use protocol::Request;
use scene::{NoFiles, Overrides, parse};
use spm::{SpmFile, write_spm};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, build_model};
use station_core::station::{Message, ServedModel, ServedObject, Station};
use std::error::Error;

const SCENE: &str = "[[object]]\nmodel = \"ball.spm\"\nsize_m = 0.1\n[[probe]]\n";
const STATION: u64 = 1;
const TICKS: u64 = 1500;

fn main() -> Result<(), Box<dyn Error>> {
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
    let mut station = Station::new(STATION, vec![ServedModel { name, file }], vec![object]);

    let plan = parse(SCENE, "ball", "".as_ref(), &Overrides::default(), &NoFiles)?;
    let identity = Identity {
        client: 7,
        incarnation: 1,
    };
    // The scene has a tour by default, of one second here; the poses are our own.
    let mut controller = Controller::new(&plan, identity, 10.0, 1.0);
    let mut outputs = TickOutputs::new(1);
    let mut inbox: Vec<InboxChunk> = Vec::new();
    let (mut contact_ticks, mut full_ticks) = (0, 0);
    for tick in 0..TICKS {
        // From 10 mm above the surface to 2 mm below it, within the first second.
        let height = 0.06 - 0.012 * (tick as f64 / 1000.0).min(1.0);
        let pose = Pose::at(DVec3::Z * height);
        let inputs = TickInputs {
            tick,
            samples: &[Some(Sample::at(pose))],
            station: STATION,
            chunks: [&inbox, &[]],
            stopping: false,
        };
        controller.tick(&inputs, &mut outputs, &mut NoObserver);
        inbox.drain(..outputs.chunks_consumed);
        for request in outputs.outbox.requests() {
            station.handle(Message::Request(request));
        }
        station.tell_time(1000 * tick as u32);
        while let Some((header, slots)) = station.poll(identity.client) {
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
