//! Recording every input of every tick, and replaying it through the pure core.
//!
//! A recording holds the text of the scene, the samples, the station's incarnation, the chunks in
//! the order of arrival, and the number of arrived chunks at each tick. These are all inputs of a
//! tick, so a replay by the same build on the same architecture gives the same bits.

use crate::setup::ControllerSetup;
use crate::tick_record::TickRecord;
use crate::tuning::MAX_RECORDING_HEAD_BYTES;
use bytemuck::{Pod, Zeroable};
use geometry::Pose;
use haptic_device::Sample;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::{Controller, NoObserver, TickInputs, TickOutputs};
use protocol::{CHUNK_SLOTS, ChunkHeader, ChunkSlot};
use scene::{self, MAX_PROBES, Overrides, SceneError};
use scene_files::DiskFiles;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

const MAGIC: &[u8; 8] = b"HRTCREC6";
const TICK: u8 = 1;
const CHUNK: u8 = 2;
const END: u8 = 3;

/// Reasons of a recording that cannot be written or read.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// The file system refused.
    #[error("cannot use the recording {0}: {1}")]
    File(String, io::Error),
    /// The file is not a recording of this version.
    #[error("{0} is not a recording of this version of hrtc; make one with hrtc run --record FILE")]
    NotARecording(String),
    /// The scene in the recording is refused.
    #[error("the scene in the recording is refused: {0}")]
    Scene(#[from] SceneError),
}

/// The head of a recording: the scene as typed, and the controller's setup.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct RecordingHead {
    scene_name: String,
    scene_folder: PathBuf,
    scene_text: String,
    model: Option<PathBuf>,
    size_m: Option<f64>,
    speed_m_per_s: Option<f64>,
    seed: Option<u64>,
    cache: Option<String>,
    tolerance_m: Option<f64>,
    setup: ControllerSetup,
}

impl RecordingHead {
    /// A head with the text of the scene file.
    ///
    /// # Errors
    /// When the scene cannot be read.
    pub fn new(
        scene: &Path,
        overrides: &Overrides,
        setup: &ControllerSetup,
    ) -> Result<Self, RecordingError> {
        let scene_text = std::fs::read_to_string(scene)
            .map_err(|e| RecordingError::File(scene.display().to_string(), e))?;
        let stem = scene.file_stem().unwrap_or_default();
        Ok(Self {
            scene_name: stem.to_string_lossy().into_owned(),
            scene_folder: scene.parent().unwrap_or(Path::new("")).to_path_buf(),
            scene_text,
            model: overrides.model.clone(),
            size_m: overrides.size_m,
            speed_m_per_s: overrides.speed_m_per_s,
            seed: overrides.seed,
            cache: overrides.cache.clone(),
            tolerance_m: overrides.tolerance_m,
            setup: setup.clone(),
        })
    }

    /// The controller of the recording, and its number of probes.
    fn controller(&self) -> Result<(Controller, usize), RecordingError> {
        let overrides = Overrides {
            model: self.model.clone(),
            size_m: self.size_m,
            speed_m_per_s: self.speed_m_per_s,
            seed: self.seed,
            cache: self.cache.clone(),
            tolerance_m: self.tolerance_m,
        };
        let mut plan = scene::parse(
            &self.scene_text,
            &self.scene_name,
            &self.scene_folder,
            &overrides,
            &DiskFiles,
        )?;
        let controller = self.setup.controller(&mut plan);
        Ok((controller, plan.probes.len()))
    }
}

/// A tick's inputs, and the hash of all outputs up to it.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct RecordedTick {
    tick: u64,
    station: u64,
    chunks_arrived: u64,
    /// Bit k: probe k gave a sample.
    has_sample: u32,
    /// 1 while the run is stopping.
    stopping: u32,
    /// Bit k: probe k's sample said that a hand holds the device.
    is_held: u32,
    /// Bit k: probe k's sample said that no hand holds it.
    is_released: u32,
    /// 1 in a tick whose force rose from zero again.
    force_cut: u64,
    /// Metres.
    positions: [[f64; 3]; MAX_PROBES],
    orientations_xyzw: [[f64; 4]; MAX_PROBES],
    replay_hash: u64,
}

/// Totals at the end of a recording; they reveal a truncated file.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
struct RecordedEnd {
    ticks: u64,
    replay_hash: u64,
}

/// A recording being written; not from the tick's thread.
#[derive(Debug)]
pub struct Recording {
    file: BufWriter<File>,
    path: String,
    end: RecordedEnd,
}

impl Recording {
    /// Creates the file and writes its head.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn create(path: &Path, head: &RecordingHead) -> Result<Self, RecordingError> {
        let name = path.display().to_string();
        let file = File::create(path).map_err(|e| RecordingError::File(name.clone(), e))?;
        let mut recording = Self {
            file: BufWriter::new(file),
            path: name,
            end: RecordedEnd::zeroed(),
        };
        let head = serde_json::to_vec(head).unwrap_or_default();
        recording.write(MAGIC)?;
        recording.write(&(head.len() as u64).to_le_bytes())?;
        recording.write(&head)?;
        Ok(recording)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), RecordingError> {
        self.file
            .write_all(bytes)
            .map_err(|e| RecordingError::File(self.path.clone(), e))
    }

    /// Adds a tick.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn tick(&mut self, record: &TickRecord) -> Result<(), RecordingError> {
        let samples = record.samples;
        let bits = (0..).zip(samples).map(|(k, s)| u32::from(s.is_some()) << k);
        let in_hand = |told: bool| {
            let bits = (0..).zip(record.in_hand);
            let bits = bits.map(|(k, held)| u32::from(held == Some(told)) << k);
            bits.fold(0, |all, bit: u32| all | bit)
        };
        let poses = samples.map(|sample| sample.unwrap_or(Pose::IDENTITY));
        let tick = RecordedTick {
            tick: record.tick,
            station: record.station,
            chunks_arrived: record.chunks_arrived,
            has_sample: bits.fold(0, |all, bit| all | bit),
            stopping: u32::from(record.core.stopping),
            is_held: in_hand(true),
            is_released: in_hand(false),
            force_cut: u64::from(record.force_cut),
            positions: poses.map(|pose| pose.position.to_array()),
            orientations_xyzw: poses.map(|pose| pose.orientation.to_array()),
            replay_hash: record.core.replay_hash,
        };
        self.end.ticks += 1;
        self.end.replay_hash = tick.replay_hash;
        self.write(&[TICK])?;
        self.write(bytemuck::bytes_of(&tick))
    }

    /// Adds a chunk, in the order of arrival.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn chunk(&mut self, chunk: &InboxChunk) -> Result<(), RecordingError> {
        self.write(&[CHUNK])?;
        self.write(bytemuck::bytes_of(&chunk.header))?;
        self.write(bytemuck::cast_slice(&chunk.slots))
    }

    /// Ends the file with its end mark.
    ///
    /// # Errors
    /// When the rest cannot be written.
    pub fn finish(mut self) -> Result<(), RecordingError> {
        self.write(&[END])?;
        let end = self.end;
        self.write(bytemuck::bytes_of(&end))?;
        self.file
            .flush()
            .map_err(|e| RecordingError::File(self.path, e))
    }
}

/// Outcome of a replay.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Replay {
    /// Ticks replayed.
    pub ticks: u64,
    /// Whether every tick gave the recorded outputs.
    pub equal: bool,
    /// Whether the recording has its end. A truncated one, after a crash for example, is replayed
    /// to its last tick.
    pub whole: bool,
    /// Index of the first tick with other outputs; -1 for none.
    pub first_difference: i64,
}

/// Runs a recording through the core and compares every tick's hash.
///
/// # Errors
/// When the file cannot be read or is not a recording.
pub fn replay(path: &Path) -> Result<Replay, RecordingError> {
    let name = path.display().to_string();
    let foreign = || RecordingError::NotARecording(name.clone());
    let file = File::open(path).map_err(|e| RecordingError::File(name.clone(), e))?;
    let mut file = BufReader::new(file);
    let mut start = [0u8; 16];
    file.read_exact(&mut start).map_err(|_| foreign())?;
    let (magic, length) = start.split_at(8);
    let length = u64::from_le_bytes(length.try_into().map_err(|_| foreign())?);
    if magic != MAGIC || length > MAX_RECORDING_HEAD_BYTES {
        return Err(foreign());
    }
    let mut head = vec![0u8; length as usize];
    file.read_exact(&mut head).map_err(|_| foreign())?;
    let head: RecordingHead = serde_json::from_slice(&head).map_err(|_| foreign())?;
    let mut ticks: Vec<RecordedTick> = Vec::new();
    let mut chunks: Vec<InboxChunk> = Vec::new();
    let mut end = None;
    while end.is_none() {
        let mut tag = [0u8];
        match file.read_exact(&mut tag) {
            Ok(()) => {}
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => break,
            Err(e) => return Err(RecordingError::File(name.clone(), e)),
        }
        match tag[0] {
            TICK => {
                let mut tick = RecordedTick::zeroed();
                file.read_exact(bytemuck::bytes_of_mut(&mut tick))
                    .map_err(|_| foreign())?;
                ticks.push(tick);
            }
            CHUNK => {
                let mut chunk = InboxChunk {
                    header: ChunkHeader::zeroed(),
                    slots: [ChunkSlot::zeroed(); CHUNK_SLOTS],
                };
                file.read_exact(bytemuck::bytes_of_mut(&mut chunk.header))
                    .and_then(|()| file.read_exact(bytemuck::cast_slice_mut(&mut chunk.slots)))
                    .map_err(|_| foreign())?;
                chunks.push(chunk);
            }
            END => {
                let mut mark = RecordedEnd::zeroed();
                file.read_exact(bytemuck::bytes_of_mut(&mut mark))
                    .map_err(|_| foreign())?;
                let last = RecordedEnd {
                    ticks: ticks.len() as u64,
                    replay_hash: ticks.last().map_or(0, |tick| tick.replay_hash),
                };
                if mark != last {
                    return Err(foreign());
                }
                end = Some(mark);
            }
            _ => return Err(foreign()),
        }
    }
    let (controller, probes) = head.controller()?;
    let first_difference = run(controller, probes, &ticks, &chunks);
    Ok(Replay {
        ticks: ticks.len() as u64,
        equal: first_difference < 0,
        whole: end.is_some(),
        first_difference,
    })
}

/// The first tick with other outputs than recorded; -1 for none.
fn run(
    mut controller: Controller,
    probes: usize,
    ticks: &[RecordedTick],
    chunks: &[InboxChunk],
) -> i64 {
    let mut outputs = TickOutputs::new(probes);
    let mut done = 0;
    for recorded in ticks {
        let arrived = usize::try_from(recorded.chunks_arrived)
            .unwrap_or(usize::MAX)
            .min(chunks.len());
        let samples: [Option<Sample>; MAX_PROBES] = std::array::from_fn(|k| {
            let pose = Pose {
                position: recorded.positions[k].into(),
                orientation: glam::DQuat::from_array(recorded.orientations_xyzw[k]),
            };
            let is_set = |bits: u32| bits >> k & 1 == 1;
            let told = is_set(recorded.is_held) || is_set(recorded.is_released);
            is_set(recorded.has_sample).then_some(Sample {
                in_hand: told.then_some(is_set(recorded.is_held)),
                ..Sample::at(pose)
            })
        });
        if recorded.force_cut != 0 {
            controller.force_was_cut();
        }
        let inputs = TickInputs {
            tick: recorded.tick,
            samples: &samples[..probes],
            station: recorded.station,
            chunks: [chunks.get(done..arrived).unwrap_or_default(), &[]],
            stopping: recorded.stopping != 0,
        };
        controller.tick(&inputs, &mut outputs, &mut NoObserver);
        done += outputs.chunks_consumed;
        if controller.replay_hash() != recorded.replay_hash {
            return i64::try_from(recorded.tick).unwrap_or(i64::MAX);
        }
    }
    -1
}
