//! The recorder's thread: takes what the queues and rings hold, keeps the twin abreast, encodes.

use super::disk::{Disk, RecordingPlace};
use super::encoder::Encoder;
use super::late_twin::{CatchUp, LateTwin};
use super::queue::Receiver;
use super::shown::Level;
use super::twin::Twin;
use super::{Hole, Progress, RecordingError, RecordingHead};
use crate::message::note;
use crate::tick_record::TickRecord;
use crate::tuning::{
    DRAIN_PERIOD, FRAME_NS, KEYFRAME_QUEUE_BYTES, KEYFRAME_TIMEOUT, RECORDED_TICKS,
    RECORDING_RETRY_NS, RECORDING_TIMEOUT,
};
use hrtc_core::streaming::chunk::InboxChunk;
use protocol::{ContactReport, Request};
use realtime::rights::monotonic_ns;
use rtrb::Consumer;
use scene::ScenePlan;
use scene_files::KeptFiles;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// The recorder's ends of its queues and rings.
pub(super) struct Sources {
    pub ticks: Receiver<TickRecord>,
    /// By their numbers in the order of arrival.
    pub chunks: Receiver<(u64, InboxChunk)>,
    /// By their ticks.
    pub requests: Consumer<(u64, Request)>,
    /// By their ticks.
    pub reports: Consumer<(u64, ContactReport)>,
}

impl Sources {
    /// Entries that wait in each.
    fn fill(&self) -> [usize; 4] {
        [
            self.ticks.len(),
            self.chunks.len(),
            self.requests.slots(),
            self.reports.slots(),
        ]
    }
}

/// What a controller says where the disk takes no more of its recording.
pub const NOT_RECORDED: &str = "ticks are not recorded for now";

/// How a run ended.
#[derive(Debug)]
pub(super) struct Ending {
    pub level: Level,
    pub sentence: String,
}

/// Messages of a tick.
#[derive(Default)]
struct Outgoing {
    requests: Vec<Request>,
    reports: Vec<ContactReport>,
}

/// State of the thread.
pub(super) struct Worker {
    sources: Sources,
    head: RecordingHead,
    files: KeptFiles,
    probes: usize,
    place: RecordingPlace,
    disk: Disk,
    /// `None` while nothing can be written.
    encoder: Option<Encoder>,
    /// What the twin is made of when it is needed first. The process has locked its memory by then:
    /// what comes later takes memory only as far as it is touched.
    twin_plan: Option<ScenePlan>,
    /// `None` before the first tick, once an input was lost, and while it is late: no keyframes.
    twin: Option<Twin>,
    /// The twin while it is late.
    late: Option<LateTwin>,
    /// Bytes of the present file.
    written: u64,
    /// First tick whose bytes the disk does not have yet.
    pending_tick: u64,
    /// The tick that comes next when no period is skipped.
    next_tick: u64,
    /// Chunks seen so far.
    next_chunk: u64,
    /// Ticks that are lost and not yet marked so.
    hole: Option<Hole>,
    /// Those that the present file is to mark, until the disk has its beginning.
    told: Option<Hole>,
    retry_ns: u64,
    /// [`KEYFRAME_TIMEOUT`]; a test waits longer.
    keyframe_timeout: Duration,
    /// Time of the last frame's end, ns.
    flushed_ns: u64,
    has_warned: bool,
    has_told_late: bool,
    has_told_loss: bool,
    /// For the main thread.
    progress: Arc<Progress>,
}

impl Worker {
    /// A worker with the first file started.
    ///
    /// # Errors
    /// When the scene's files are not enough for a replay, or too large for a file, or that cannot
    /// be created.
    pub(super) fn new(
        sources: Sources,
        head: RecordingHead,
        files: KeptFiles,
        place: RecordingPlace,
        progress: Arc<Progress>,
    ) -> Result<Self, RecordingError> {
        // Each file begins with them.
        let kept: usize = files.contents.values().map(|content| content.len()).sum();
        if 2 * kept as u64 > place.file_bytes() {
            let needed = RecordingPlace::keep_for(2 * kept as u64) >> 20;
            return Err(RecordingError::Room(needed));
        }
        let plan = head.plan(&files)?;
        let probes = plan.probes.len();
        Ok(Self {
            sources,
            probes,
            encoder: Some(Encoder::new(&head, &files, probes, monotonic_ns())?),
            disk: Disk::start(place.clone())?,
            place,
            head,
            files,
            twin_plan: Some(plan),
            twin: None,
            late: None,
            written: 0,
            pending_tick: 0,
            next_tick: 0,
            next_chunk: 0,
            hole: None,
            told: None,
            retry_ns: 0,
            keyframe_timeout: KEYFRAME_TIMEOUT,
            flushed_ns: 0,
            has_warned: false,
            has_told_late: false,
            has_told_loss: false,
            progress,
        })
    }

    /// Records until the run has ended; the files that are kept, oldest first.
    pub(super) fn run(mut self, ending: &OnceLock<Ending>) -> Vec<PathBuf> {
        loop {
            // Read before the rest, so that nothing comes after the last look.
            let ending = ending.get();
            self.take();
            if let Some(ending) = ending {
                return self.finish(ending);
            }
            std::thread::sleep(DRAIN_PERIOD);
        }
    }

    /// Takes what the queues and rings hold.
    fn take(&mut self) {
        while let Some(record) = self.sources.ticks.pop() {
            self.note_fill();
            let recorded = self.tick(&record).and_then(|()| self.rotate());
            self.heed(recorded);
            // Here too: who is late does not come out of this loop.
            self.flush();
        }
        self.flush();
        self.resume();
        let done = self.catch_up();
        self.heed(done);
    }

    /// Notes how full they are.
    fn note_fill(&self) {
        for (most, fill) in self.progress.high_water.iter().zip(self.sources.fill()) {
            most.fetch_max(fill, Ordering::Relaxed);
        }
    }

    /// Makes the twin when it is needed first.
    fn make_twin(&mut self) {
        if let Some(mut plan) = self.twin_plan.take() {
            let controller = Box::new(self.head.setup.controller(&mut plan));
            self.twin = Some(Twin::new(controller));
        }
    }

    /// Takes a tick with all that belongs to it.
    fn tick(&mut self, record: &TickRecord) -> Result<(), RecordingError> {
        self.make_twin();
        let expected = self.next_tick + u64::from(record.skipped);
        if record.tick != expected {
            let last = record.tick.saturating_sub(1 + u64::from(record.skipped));
            self.lose(self.next_tick, last, "they were not handed over in time")?;
        }
        self.next_tick = record.tick + 1;
        self.chunks(record)?;
        let outgoing = self.outgoing(record)?;
        self.tick_twin(record)?;
        let Some(encoder) = &mut self.encoder else {
            self.extend_hole(record.tick);
            return Ok(());
        };
        for request in &outgoing.requests {
            encoder.request(record.tick, request)?;
        }
        for report in &outgoing.reports {
            encoder.report(record.tick, report)?;
        }
        encoder.tick(record, self.twin.as_ref().map(Twin::controller))
    }

    /// Runs a tick of the twin, unless the recorder is so late that ticks would be lost for it:
    /// then it falls behind, and files that begin meanwhile have no keyframe.
    fn tick_twin(&mut self, record: &TickRecord) -> Result<(), RecordingError> {
        let is_late = self.sources.ticks.len() > RECORDED_TICKS / 8 * 7;
        let Some(twin) = &mut self.twin else {
            return Ok(());
        };
        if is_late {
            return self.fall_behind();
        }
        if twin.tick(record).is_err() {
            return self.lose(record.tick, record.tick, "chunks before them were lost");
        }
        if twin.outputs().record.replay_hash != record.core.replay_hash {
            self.twin = None;
            return self.note("the recorder's controller differs from the run's from here on");
        }
        Ok(())
    }

    /// Sets the twin aside until there is time; without a file for its inputs, for good.
    fn fall_behind(&mut self) -> Result<(), RecordingError> {
        let twin = self.twin.take().filter(|_| self.encoder.is_some());
        let behind = |twin| LateTwin::new(twin, self.place.clone(), self.head.segment);
        self.late = twin.map(behind);
        if !self.has_told_late {
            self.has_told_late = true;
            note!(
                "the recorder is late: every tick is recorded, but a file that begins before it has caught up does not replay by itself"
            );
        }
        self.note("the recorder is late and makes no keyframes from here on")
    }

    /// Lets the twin read what it missed; once it is abreast, there are keyframes again.
    fn catch_up(&mut self) -> Result<(), RecordingError> {
        let Some(late) = &mut self.late else {
            return Ok(());
        };
        match late.read() {
            CatchUp::Some => return Ok(()),
            CatchUp::Lost => {
                self.late = None;
                return Ok(());
            }
            CatchUp::All => {}
        }
        // The rest goes to the disk now, and nothing is added before it was read.
        self.flushed_ns = 0;
        self.flush();
        self.disk.wait(Duration::from_nanos(FRAME_NS));
        let Some(mut late) = self.late.take() else {
            return Ok(());
        };
        let read = late.read();
        if late.next_tick() == self.next_tick {
            self.twin = Some(late.into_twin());
            return self.note("the recorder has caught up and makes keyframes again");
        }
        // Where all that is missing is on the disk and cannot be read, it stays missing.
        let is_written = self.pending_tick == self.next_tick && self.disk.is_idle();
        let may_go_on = read == CatchUp::Some || read == CatchUp::All && !is_written;
        self.late = Some(late).filter(|_| may_go_on);
        Ok(())
    }

    /// Takes the chunks that had arrived before a tick.
    fn chunks(&mut self, record: &TickRecord) -> Result<(), RecordingError> {
        let arrived = |of: &(u64, InboxChunk)| of.0 < record.chunks_arrived;
        while let Some((index, chunk)) = self.sources.chunks.pop_if(arrived) {
            if index != self.next_chunk {
                self.lose(record.tick, record.tick, "chunks before them were lost")?;
            }
            self.next_chunk = index + 1;
            if let Some(twin) = &mut self.twin {
                // A gap shows at the tick.
                let _ = twin.arrive(index, &chunk);
            }
            if let Some(encoder) = &mut self.encoder {
                encoder.chunk(index, &chunk)?;
            }
        }
        Ok(())
    }

    /// Takes the requests and reports of a tick; those of lost ticks are passed over.
    fn outgoing(&mut self, record: &TickRecord) -> Result<Outgoing, RecordingError> {
        let outgoing = Outgoing {
            requests: of_tick(&mut self.sources.requests, record.tick),
            reports: of_tick(&mut self.sources.reports, record.tick),
        };
        let found = (outgoing.requests.len(), outgoing.reports.len());
        if found != (record.requests as usize, record.reports as usize) {
            self.progress.has_lost.store(true, Ordering::Relaxed);
            if let Some(encoder) = &mut self.encoder {
                encoder.hole(&Hole {
                    first: record.tick,
                    last: record.tick,
                    reason: "its requests or reports were lost".to_owned(),
                })?;
            }
        }
        Ok(outgoing)
    }

    /// Marks ticks whose inputs are lost. The twin cannot go on without them.
    fn lose(&mut self, first: u64, last: u64, reason: &str) -> Result<(), RecordingError> {
        self.twin = None;
        self.late = None;
        if !self.has_told_loss {
            self.has_told_loss = true;
            self.progress.has_lost.store(true, Ordering::Relaxed);
            note!(
                "the recording lacks inputs of ticks {first} to {last} and does not replay from there on: {reason}"
            );
        }
        let hole = Hole {
            first,
            last,
            reason: reason.to_owned(),
        };
        match &mut self.encoder {
            Some(encoder) => encoder.hole(&hole),
            None => {
                self.extend_hole(last);
                Ok(())
            }
        }
    }

    fn extend_hole(&mut self, tick: u64) {
        if let Some(hole) = &mut self.hole {
            hole.last = tick;
        }
    }

    fn note(&mut self, sentence: &str) -> Result<(), RecordingError> {
        let encoder = self.encoder.as_mut();
        encoder.map_or(Ok(()), |encoder| encoder.event(Level::Warning, sentence))
    }

    /// Hands a frame to the disk, once it is long enough.
    fn flush(&mut self) {
        let Some(encoder) = &mut self.encoder else {
            return;
        };
        let now_ns = monotonic_ns();
        if now_ns < self.flushed_ns + FRAME_NS {
            return;
        }
        self.flushed_ns = now_ns;
        // Before the question for losses: what is not waiting any more is written or lost.
        let is_idle = self.disk.is_idle();
        if self.disk.has_lost() {
            // Also of a file before the present one.
            let reason = self.disk.reason();
            return self.stop(reason);
        }
        if self.written > 0 && is_idle {
            self.told = None;
        }
        let bytes = match encoder.flush() {
            Ok(bytes) => bytes,
            Err(error) => return self.stop(error.to_string()),
        };
        self.written += bytes.len() as u64;
        if !bytes.is_empty()
            && let Err(error) = self.hand_over(bytes)
        {
            return self.stop(error.to_string());
        }
        self.pending_tick = self.next_tick;
    }

    /// Hands bytes to the disk.
    fn hand_over(&self, bytes: Vec<u8>) -> Result<(), RecordingError> {
        if self.disk.write(bytes, self.pending_tick) {
            return Ok(());
        }
        let reason = self.disk.failure();
        let reason = reason.unwrap_or_else(|| "the disk is slow".to_owned());
        Err(RecordingError::Disk(reason))
    }

    /// Ends the present file where the disk has it; the run goes on.
    fn stop(&mut self, reason: String) {
        if !self.has_warned {
            self.has_warned = true;
            self.progress.has_lost.store(true, Ordering::Relaxed);
            note!(
                "{NOT_RECORDED}, the run goes on: {reason}; a further file begins once the disk has room and time again"
            );
        }
        // What waited behind a failure is lost with it.
        let lost = self.disk.take_lost().unwrap_or(self.pending_tick);
        let marked = [self.told.take(), self.hole.take()];
        let marked = marked.iter().flatten().map(|of| of.first);
        let first = marked.fold(lost.min(self.pending_tick), u64::min);
        self.hole = Some(Hole {
            first,
            last: self.next_tick.saturating_sub(1).max(first),
            reason,
        });
        self.encoder = None;
        // What it would read is not written; a twin that is abreast needs no file.
        self.late = None;
        self.retry_ns = monotonic_ns() + RECORDING_RETRY_NS;
    }

    /// Begins a new file after a hole, once the disk has room again.
    fn resume(&mut self) {
        if self.encoder.is_none() && self.disk.is_idle() && monotonic_ns() >= self.retry_ns {
            let started = self.begin();
            self.heed(started);
        }
    }

    /// Begins a new file when the present one is long enough.
    fn rotate(&mut self) -> Result<(), RecordingError> {
        let Some(encoder) = &self.encoder else {
            return Ok(());
        };
        if self.written + encoder.size() < self.place.file_bytes() {
            return Ok(());
        }
        if let Some(encoder) = self.encoder.take() {
            let bytes = encoder.finish()?;
            if !self.disk.write(bytes, self.pending_tick) {
                self.stop("the disk is slow".to_owned());
                return Ok(());
            }
            self.pending_tick = self.next_tick;
        }
        self.begin()
    }

    /// Begins the next file with a keyframe.
    fn begin(&mut self) -> Result<(), RecordingError> {
        // Where the disk refused the first file before the first tick.
        self.make_twin();
        self.head.segment += 1;
        if !self.disk.begin(self.head.segment, self.next_tick) {
            self.stop("the disk is slow".to_owned());
            return Ok(());
        }
        let now_ns = monotonic_ns();
        let mut encoder = Encoder::new(&self.head, &self.files, self.probes, now_ns)?;
        if let Some(hole) = self.hole.take() {
            encoder.hole(&hole)?;
            self.told = Some(hole);
        }
        self.pending_tick = self.next_tick;
        self.written = self.keyframe(&mut encoder)?;
        self.encoder = Some(encoder);
        Ok(())
    }

    /// Adds a keyframe, unless there is no twin or it leaves too little of a file for ticks; the
    /// bytes that the disk has got. It may be larger than all else that the recorder holds, so the
    /// disk gets it in parts, each when it has written most of those before; but not while many
    /// ticks wait for this thread, since one that finds no room costs the twin.
    fn keyframe(&self, encoder: &mut Encoder) -> Result<u64, RecordingError> {
        let Some(twin) = &self.twin else {
            return Ok(0);
        };
        let bytes = twin.state_bytes()? as u64;
        if 2 * bytes <= self.place.file_bytes() {
            let mut written = 0;
            let end = Instant::now() + self.keyframe_timeout;
            let do_ticks_wait = || self.sources.ticks.len() > RECORDED_TICKS / 4;
            let is_enough = |queued: usize| queued <= KEYFRAME_QUEUE_BYTES || do_ticks_wait();
            twin.to_parts(|part, number, is_last| {
                encoder.keyframe(part, number, is_last)?;
                let frame = encoder.flush()?;
                written += frame.len() as u64;
                self.disk.wait_until(is_enough, end);
                self.hand_over(frame)
            })?;
            return Ok(written);
        }
        let needed = RecordingPlace::keep_for(2 * bytes) >> 20;
        let sentence = format!(
            "only the first file of this recording replays: the state is too large for the others; write keep = \"{needed}MiB\" or more into [record] of the scene"
        );
        if self.head.segment == 1 {
            note!("{sentence}");
        }
        encoder.event(Level::Warning, &sentence)?;
        Ok(0)
    }

    /// An error of the encoder: a defect, but not one that ends a run.
    fn heed(&mut self, done: Result<(), RecordingError>) {
        if let Err(error) = done {
            self.stop(error.to_string());
        }
    }

    fn finish(mut self, ending: &Ending) -> Vec<PathBuf> {
        self.disk.wait(RECORDING_TIMEOUT);
        if self.disk.has_lost() && self.encoder.is_some() {
            self.stop(self.disk.reason());
            self.retry_ns = 0;
        }
        self.resume();
        if let Some(mut encoder) = self.encoder.take() {
            let last = encoder
                .event(ending.level, &ending.sentence)
                .and_then(|()| encoder.finish());
            let written = last.map(|bytes| self.disk.write(bytes, self.pending_tick));
            match written {
                Ok(true) => {}
                Ok(false) => self.stop("the disk is slow".to_owned()),
                Err(error) => self.stop(error.to_string()),
            }
        }
        self.disk.finish().unwrap_or_else(|| {
            note!("the disk did not take the end of the recording in time: it is cut short");
            Vec::new()
        })
    }
}

/// Takes the entries of a tick; those of earlier ticks are dropped.
fn of_tick<T>(ring: &mut Consumer<(u64, T)>, tick: u64) -> Vec<T> {
    let mut found = Vec::new();
    while ring.peek().is_ok_and(|of| of.0 <= tick) {
        if let Ok((of, entry)) = ring.pop()
            && of == tick
        {
            found.push(entry);
        }
    }
    found
}

#[cfg(test)]
mod tests;
