//! The flight recorder: every input and every output of every tick in files that robotics' tools
//! open, and their replay through the pure core.
//!
//! A recording is a run of [MCAP](https://mcap.dev) files. Each holds the scene with every file
//! that it read, the samples, the station's incarnation, the chunks in the order of arrival and the
//! number of those that had arrived at each tick: all inputs of a tick. So a replay by the same
//! build on the same architecture, from one such file alone, gives the same bits.
//!
//! ```text
//! tick ── log ring ──> main thread ── queue ──┐
//! tick ── requests, reports ── rings ─────────┤
//! link ── chunks ── queue ────────────────────┴─> hrtc-recorder ── queue ──> hrtc-disk ──> files
//!                                                  └ twin (a second controller)
//! ```
//!
//! All of them are bounded. What finds its ring or queue full is lost and marked as a [`Hole`]:
//! a slow or full disk costs records, never a tick. Messages are gathered in short frames, MCAP's
//! chunks, without which rerun reads nothing; a file that ends anywhere, by a kill for example,
//! opens up to its last whole message. Each later file begins with a keyframe, the state of the
//! twin, and replays without those before it. That state is as large as the controller: it is
//! written in parts, so that a run never holds it as a whole. A recorder that gets too little time
//! lets the twin fall behind before it loses a tick; the twin reads what it missed from the files.
//! Once an input of a tick is lost there is no twin any more, since nothing may copy the state of
//! the tick's own controller.

mod black_box;
mod disk;
mod encoder;
mod format;
mod head;
mod late_twin;
mod paths;
mod queue;
mod reader;
mod replay;
mod schema;
mod shown;
mod twin;
mod worker;

pub use black_box::{stands_alone, write_black_box};
pub use disk::RecordingPlace;
pub use format::Hole;
pub use head::RecordingHead;
pub use reader::{Entry, RecordingReader};
pub use replay::{Replay, replay};
pub use twin::{Gap, Twin};

use crate::link::ChunkRecorder;
use crate::tick_record::TickRecord;
use crate::tuning::{
    RECORDED_CHUNKS, RECORDED_OUTPUTS, RECORDED_TICKS, RECORDER_NICE, RECORDER_STACK_BYTES,
};
use hrtc_core::{Capacity, TickOutputs};
use protocol::{ContactReport, Request};
use queue::{Sender, bounded};
use realtime::rights::{MissingRight, set_nice};
use rtrb::{Producer, RingBuffer};
use scene::SceneError;
use scene_files::KeptFiles;
use shown::Level;
use std::io;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;
use thiserror::Error;
pub use worker::NOT_RECORDED;
use worker::{Ending, Sources, Worker};

/// Reasons of a recording that cannot be written or read.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// The file system gives no file to read.
    #[error(
        "the recording {0} cannot be read ({1}); name a file that hrtc run or rt-tests run wrote"
    )]
    File(String, io::Error),
    /// The file system takes no file.
    #[error(
        "the recording {0} cannot be written ({1}); name a file in a folder that takes one (--record FILE), or none (--record off)"
    )]
    NewFile(String, io::Error),
    /// The file is not a recording of this version.
    #[error("{0} is not a recording of this version of hrtc; make one with hrtc run --record FILE")]
    NotARecording(String),
    /// The scene in the recording is refused.
    #[error("the scene in the recording is refused: {0}")]
    Scene(#[from] SceneError),
    /// A message cannot be encoded or read.
    #[error("a message of the recording cannot be used: {0}")]
    Message(#[from] postcard::Error),
    /// The files of the scene, which each file of the recording begins with, leave no room for
    /// ticks; what to keep at the least, MiB.
    #[error(
        "the scene's own files leave no room for ticks in a file of the recording; write keep = \"{0}MiB\" or more into [record] of the scene, or give --record off"
    )]
    Room(u64),
    /// The container cannot be encoded.
    #[error("the recording cannot be encoded: {0}")]
    Container(#[from] mcap::McapError),
    /// A message for people is not as its description says: a defect.
    #[error("what the recording shows cannot be described: {0}")]
    Schema(String),
    /// The head cannot be encoded.
    #[error("the head of the recording cannot be encoded: {0}")]
    Head(String),
    /// The disk takes no more bytes for now; why.
    #[error("{0}")]
    Disk(String),
    /// The operating system gave no thread.
    #[error("cannot start a thread of the recorder: {0}")]
    Thread(io::Error),
}

/// The tick's end of the recorder, for what is not in its [`TickRecord`].
pub struct OutputTap {
    requests: Producer<(u64, Request)>,
    reports: Producer<(u64, ContactReport)>,
}

impl OutputTap {
    /// Hands over the requests and reports of a tick; those without room are lost, which the tick's
    /// record reveals.
    pub fn push(&mut self, tick: u64, outputs: &TickOutputs) {
        for request in outputs.outbox.requests() {
            let _ = self.requests.push((tick, *request));
        }
        for report in &outputs.reports {
            let _ = self.reports.push((tick, *report));
        }
    }
}

/// A recording under way.
pub struct Recorder {
    ticks: Sender<TickRecord>,
    ending: Arc<OnceLock<Ending>>,
    progress: Arc<Progress>,
    missing: Option<MissingRight>,
    /// `None` once it is joined.
    thread: Option<JoinHandle<Vec<PathBuf>>>,
}

/// The recorder's queues and rings, in the order of [`Sources::fill`], with their sizes.
const SOURCES: [(&str, usize); 4] = [
    ("tick records for the recorder", RECORDED_TICKS),
    ("chunks for the recorder", RECORDED_CHUNKS),
    ("requests for the recorder", RECORDED_OUTPUTS),
    ("reports for the recorder", RECORDED_OUTPUTS),
];

/// What the recorder's thread tells the main thread.
#[derive(Debug, Default)]
struct Progress {
    /// Whether the recording lacks what it should have.
    has_lost: AtomicBool,
    /// The most entries in each of [`SOURCES`].
    high_water: [AtomicUsize; SOURCES.len()],
}

/// The queues and rings: the main thread's end, those of tick and link, the recorder's. The tick,
/// which may not allocate, writes into rings.
fn sources() -> (Sender<TickRecord>, Taps, Sources) {
    let (ticks, ticks_out) = bounded(RECORDED_TICKS);
    let (mut chunks, chunks_out) = bounded(RECORDED_CHUNKS);
    let (requests, requests_out) = RingBuffer::new(RECORDED_OUTPUTS);
    let (reports, reports_out) = RingBuffer::new(RECORDED_OUTPUTS);
    let mut index = 0;
    let chunks: ChunkRecorder = Box::new(move |chunk| {
        // A full queue loses the chunk; the next one's number reveals it.
        let _ = chunks.push((index, *chunk));
        index += 1;
    });
    let outputs = OutputTap { requests, reports };
    let recorded = Sources {
        ticks: ticks_out,
        chunks: chunks_out,
        requests: requests_out,
        reports: reports_out,
    };
    (ticks, Taps { outputs, chunks }, recorded)
}

/// The ends of the recorder's queues and rings that other threads own.
pub struct Taps {
    /// The tick's.
    pub outputs: OutputTap,
    /// The link's.
    pub chunks: ChunkRecorder,
}

impl Recorder {
    /// Starts the recorder's threads, with the first file created.
    ///
    /// # Errors
    /// When the first file cannot be created or there is no thread.
    pub fn start(
        head: RecordingHead,
        files: KeptFiles,
        place: RecordingPlace,
    ) -> Result<(Self, Taps), RecordingError> {
        let (ticks, taps, sources) = sources();
        let ending = Arc::new(OnceLock::new());
        let until = Arc::clone(&ending);
        let progress = Arc::new(Progress::default());
        let told = Arc::clone(&progress);
        let (started, wait) = std::sync::mpsc::sync_channel(1);
        let thread = std::thread::Builder::new()
            .name("hrtc-recorder".to_owned())
            .stack_size(RECORDER_STACK_BYTES)
            .spawn(move || {
                // Before the thread of the disk starts, which takes it over.
                let missing = set_nice(RECORDER_NICE).err();
                match Worker::new(sources, head, files, place, told) {
                    Ok(worker) => {
                        let _ = started.send(Ok(missing));
                        worker.run(&until)
                    }
                    Err(error) => {
                        let _ = started.send(Err(error));
                        Vec::new()
                    }
                }
            })
            .map_err(RecordingError::Thread)?;
        let ended = || RecordingError::Thread(io::Error::other("it ended before it began"));
        let missing = wait.recv().map_err(|_| ended())??;
        let recorder = Self {
            ticks,
            ending,
            progress,
            missing,
            thread: Some(thread),
        };
        Ok((recorder, taps))
    }

    /// Hands over a tick; one without room is lost, which the next one reveals. Not from the tick's
    /// thread: the main thread passes on what it finds in the log.
    pub fn push(&mut self, record: &TickRecord) {
        let _ = self.ticks.push(*record);
    }

    /// The right that the recorder's threads were refused, once.
    #[must_use]
    pub fn take_missing(&mut self) -> Option<MissingRight> {
        self.missing.take()
    }

    /// Whether the recording lacks what it should have: the disk refused it, it was not handed over
    /// in time, or the recorder's thread has panicked.
    #[must_use]
    pub fn has_lost(&self) -> bool {
        // Nobody has asked it to end yet.
        let has_ended = self.thread.as_ref().is_some_and(JoinHandle::is_finished);
        has_ended || self.progress.has_lost.load(Ordering::Relaxed)
    }

    /// Size and high water of each queue and ring.
    #[must_use]
    pub fn capacities(&self) -> Vec<Capacity> {
        let all = SOURCES.iter().zip(&self.progress.high_water);
        let of = |(&(name, room), most): (&(_, _), &AtomicUsize)| {
            Capacity::new(name, room, most.load(Ordering::Relaxed))
        };
        all.map(of).collect()
    }

    /// Ends the recording; the files that are kept, the oldest first. `fault` is what ended the
    /// run, when that was not its time or a request.
    #[must_use]
    pub fn finish(self, fault: Option<&str>) -> Vec<PathBuf> {
        self.end(match fault {
            Some(fault) => Ending {
                level: Level::Fatal,
                sentence: format!("the run ended by a fault: {fault}"),
            },
            None => Ending {
                level: Level::Info,
                sentence: "the run ended".to_owned(),
            },
        })
    }

    /// Ends the recording of a run that ended early, for a reason that is no fault, such as a
    /// request to switch off; the files that are kept, the oldest first.
    #[must_use]
    pub fn finish_early(self, reason: &str) -> Vec<PathBuf> {
        self.end(Ending {
            level: Level::Warning,
            sentence: format!("the run ended early: {reason}"),
        })
    }

    fn end(mut self, ending: Ending) -> Vec<PathBuf> {
        let _ = self.ending.set(ending);
        let thread = self.thread.take().map(JoinHandle::join);
        thread.and_then(Result::ok).unwrap_or_default()
    }
}

impl Drop for Recorder {
    /// Ends the thread of a recording that was not finished, without waiting for it.
    fn drop(&mut self) {
        let _ = self.ending.set(Ending {
            level: Level::Warning,
            sentence: "the run did not begin".to_owned(),
        });
    }
}

impl std::fmt::Debug for Recorder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Recorder").finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_whose_thread_has_panicked_lacks_what_it_should_have() {
        let (ticks, _taps, _sources) = sources();
        let (release, released) = std::sync::mpsc::channel::<()>();
        let thread = std::thread::spawn(move || -> Vec<PathBuf> {
            let _ = released.recv();
            std::panic::resume_unwind(Box::new(()))
        });
        let recorder = Recorder {
            ticks,
            ending: Arc::default(),
            progress: Arc::default(),
            missing: None,
            thread: Some(thread),
        };
        assert!(!recorder.has_lost());
        drop(release);
        while !recorder.has_lost() {
            std::thread::yield_now();
        }
        assert!(recorder.finish(None).is_empty());
    }
}
