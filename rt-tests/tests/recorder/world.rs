//! Recordings of runs in virtual time: both cores, a link with faults, a station that restarts.

use hrtc::recorder::{Recorder, RecordingHead, RecordingPlace, Taps};
use hrtc::setup::ControllerSetup;
use hrtc::tick_record::TickRecord;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::{Controller, NoObserver, TickInputs, TickOutputs};
use scene::{MAX_PROBES, Overrides, ScenePlan};
use scene_files::{KeptFiles, NotingFiles};
use simulator::{Client, ClientOptions, InputRecording, LinkModel, STATION, Simulation};
use spm::{SpmFile, write_spm};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, build_model};
use station_core::station::{ServedModel, Station};
use std::path::{Path, PathBuf};

/// Ticks from one cut of the force to the next: a run that was stopped for longer than its wrenches
/// are valid writes zero in place of the core's.
const CUT_TICKS: usize = 170;
/// Length of the tours, seconds.
const TOUR_S: f64 = 2.0;
const PERIOD_NS: u64 = 1_000_000;

/// Down onto the sphere and along it.
const PATH: &str = "0,0,0,0.083\n0.07,0,0,0.05\n1.2,0.03,0.01,0.06\n4,-0.03,0.0,0.06\n";

/// A scene with everything that may differ: a ball with effects, a tool, a body that moves.
pub const SCENES: [(&str, &str); 3] = [
    (
        "ball",
        "effects = [{ friction = { static = 0.4, dynamic = 0.3 } }, \
         { texture = { amplitude_m = 2e-5, noise = { wavelength_m = 0.003, seed = 1 } } }, \
         { magnet = { force_n = 0.2, reach_m = 0.003 } }]\n\
         [[probe]]\ntrajectory = { csv = \"path.csv\" }\n",
    ),
    (
        "tool",
        "[[probe]]\nshape = { capsule = { radius_m = 0.004, length_m = 0.03, faces = 200 } }\n\
         trajectory = { csv = \"path.csv\" }\n",
    ),
    (
        "movable",
        "movable = { rail = { axis = [0, 0, 1], mass_kg = 0.2, spring_n_per_m = 150.0, \
         limits_m = [-0.01, 0.0] } }\n[[probe]]\ntrajectory = { csv = \"path.csv\" }\n",
    ),
];

pub struct World {
    pub head: RecordingHead,
    pub files: KeptFiles,
    pub recording: InputRecording,
}

impl World {
    /// A run of a scene's text, so many ticks long.
    pub fn run(folder: &Path, name: &str, text: &str, ticks: usize) -> Self {
        let path: PathBuf = folder.join(format!("{name}.toml"));
        let head = "[cache]\nbytes = \"512KiB\"\n[[object]]\nmodel = \"m.spm\"\nsize_m = 0.15\n";
        std::fs::write(&path, format!("{head}{text}")).unwrap();
        std::fs::write(folder.join("path.csv"), PATH).unwrap();
        let files = NotingFiles::default();
        let overrides = Overrides::default();
        let plan = scene::load(&path, &overrides, &files).unwrap();
        let files = files.into_kept();
        let options = ClientOptions {
            tour_s: TOUR_S,
            ..ClientOptions::default()
        };
        let setup = ControllerSetup {
            client: options.identity.client,
            incarnation: options.identity.incarnation,
            max_force_n: options.device_max_n,
            max_torque_nm: f64::MAX,
            wrench_limits: vec![[options.device_max_n, f64::MAX]],
            position_resolutions_m: plan.probes.iter().map(|of| of.device.encoder_m).collect(),
            orientation_resolutions_rad: Vec::new(),
            renders_torque: Vec::new(),
            motion_limits: Vec::new(),
            tour_seconds: TOUR_S,
            station_is_far: false,
            costs: hrtc_core::governor::WorkCosts::REFERENCE,
        };
        let head = RecordingHead::new(&path, &overrides, &setup, &files, 1);
        let spm = model();
        let client = Client::new(&plan, options);
        let mut world = Simulation::new(station(&plan, &spm, STATION), client);
        world.client_mut().record();
        for tick in 0..ticks {
            if tick == ticks / 4 {
                let faults = LinkModel {
                    loss: 0.02,
                    duplicates: 0.05,
                    reordering: 0.05,
                    ..LinkModel::default()
                };
                world.client_mut().link().disturb(faults, 7);
            }
            if tick == ticks * 2 / 3 {
                world.start_station(station(&plan, &spm, STATION + 1));
            }
            world.step_led();
        }
        assert!(world.summary().contact > 0, "{name} touches");
        let recording = world.client_mut().take_recording().unwrap();
        Self {
            head,
            files,
            recording,
        }
    }

    pub fn controller(&self) -> Box<Controller> {
        self.head.controller(&self.files).unwrap()
    }

    /// Gives every tick to `take`: its record, its outputs, the chunks that arrived before it.
    pub fn play(&self, mut take: impl FnMut(&TickRecord, &TickOutputs, &[InboxChunk])) {
        let mut controller = self.controller();
        let mut outputs = controller.new_outputs();
        let (mut consumed, mut seen) = (0, 0);
        let mut was_cut = false;
        for index in 0..self.recording.len() {
            let (inputs, arrived) = self.recording.inputs(index).unwrap();
            let all = self.recording.chunks();
            let chunks = [&all[consumed..arrived], &[]];
            let inputs = TickInputs { chunks, ..inputs };
            if was_cut {
                controller.force_was_cut();
            }
            controller.tick(&inputs, &mut outputs, &mut NoObserver);
            consumed += outputs.chunks_consumed;
            let mut record = record(&inputs, arrived, &outputs);
            record.rises_again = was_cut;
            record.force_cut = index % CUT_TICKS == CUT_TICKS - 1;
            if record.force_cut {
                record.wrenches = Default::default();
            }
            was_cut = record.force_cut;
            take(&record, &outputs, &all[seen..arrived]);
            seen = arrived;
        }
    }

    /// Records the run into files at the pace of real time; those that are kept.
    pub fn record(&self, place: RecordingPlace, fault: Option<&str>) -> Vec<PathBuf> {
        self.record_at(10, place, fault, |_, _| {})
    }

    /// As [`World::record`], with so many ticks between two rests of 12 ms; gives every tick to
    /// `each`.
    pub fn record_at(
        &self,
        pace: usize,
        place: RecordingPlace,
        fault: Option<&str>,
        mut each: impl FnMut(&Recorder, u64),
    ) -> Vec<PathBuf> {
        let (head, files) = (self.head.clone(), self.files.clone());
        let (mut recorder, taps) = Recorder::start(head, files, place).unwrap();
        let Taps {
            mut outputs,
            mut chunks,
        } = taps;
        let mut ticks = 0;
        self.play(|record, made, arrived| {
            for chunk in arrived {
                chunks(chunk);
            }
            outputs.push(record.tick, made);
            recorder.push(record);
            each(&recorder, record.tick);
            ticks += 1;
            // The recorder gets the time that a run in real time gives it.
            if ticks % pace == 0 {
                std::thread::sleep(std::time::Duration::from_millis(12));
            }
        });
        recorder.finish(fault)
    }
}

fn record(inputs: &TickInputs<'_>, arrived: usize, outputs: &TickOutputs) -> TickRecord {
    let of = |k: usize| outputs.wrenches.get(k).copied().unwrap_or_default();
    TickRecord {
        tick: inputs.tick,
        start_ns: inputs.tick * PERIOD_NS,
        chunks_arrived: arrived as u64,
        station: inputs.station,
        samples: std::array::from_fn(|k| inputs.samples.get(k).copied().flatten()),
        wrenches: std::array::from_fn::<_, MAX_PROBES, _>(of),
        contacts: std::array::from_fn(|k| outputs.contacts.get(k).copied().flatten()),
        chunks_consumed: outputs.chunks_consumed as u32,
        requests: outputs.outbox.requests().len() as u32,
        reports: outputs.reports.len() as u32,
        core: outputs.record,
        ..TickRecord::default()
    }
}

fn model() -> Vec<u8> {
    let mesh = generate(Shape::Sphere, 8_000, 1);
    let parts = build_model(mesh, &BuildOptions::default(), &NoProgress).unwrap();
    let mut bytes = Vec::new();
    write_spm(&parts, &mut bytes).unwrap();
    bytes
}

fn station(plan: &ScenePlan, spm: &[u8], incarnation: u64) -> Station<Vec<u8>> {
    let served = ServedModel {
        name: plan.objects[0].model.name(),
        file: SpmFile::open(spm.to_vec()).unwrap(),
    };
    simulator::station(plan, vec![served], incarnation).unwrap()
}
