//! Tours on their way to a client: rolled step by step, chunk by chunk, and kept for when it asks
//! again.

use super::Chunk;
use super::answer::blank;
use crate::tour::{Step, Tour, TourError};
use crate::tuning::tour::MAX_KEPT_POINTS;
use protocol::{CHUNK_SLOTS, ChunkKind, TourAsk, TourPoint};
use spm::{FileError, SpmFile};

/// A tour in the making, and its points.
#[derive(Debug)]
pub struct PathGenerator {
    pub model: usize,
    ask: TourAsk,
    tour: Tour,
    /// Points that are made and not forgotten.
    points: Vec<TourPoint>,
    /// Points forgotten.
    forgotten: usize,
    /// Index of the next point to hand out.
    next: usize,
}

impl PathGenerator {
    /// Nothing is made yet; it is handed out from where the ask says.
    pub fn new<D: AsRef<[u8]>>(
        file: &SpmFile<D>,
        model: usize,
        ask: TourAsk,
    ) -> Result<Self, TourError> {
        Ok(Self {
            model,
            ask: TourAsk { from: 0, ..ask },
            tour: Tour::new(file, ask)?,
            points: Vec::new(),
            forgotten: 0,
            next: first(&ask),
        })
    }

    /// Whether it is the tour asked for, and can be handed out from where the ask says.
    pub fn serves(&self, ask: &TourAsk) -> bool {
        let of_start = TourAsk { from: 0, ..*ask };
        let same = bytemuck::bytes_of(&self.ask) == bytemuck::bytes_of(&of_start);
        same && self.forgotten <= first(ask)
    }

    /// Hands out from where the ask says.
    pub fn go_on(&mut self, ask: &TourAsk) {
        self.next = first(ask);
    }

    /// Works until the next chunk is full, the tour is over or no steps are left; whether the chunk
    /// is ready. Points that its client has already are no part of a chunk, and may be millions: as
    /// many of them as a chunk holds are a step.
    pub fn roll<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
        steps: &mut u64,
    ) -> Result<bool, FileError> {
        while self.made() < self.next + CHUNK_SLOTS && !self.tour.is_over() {
            if *steps == 0 {
                return Ok(false);
            }
            match self.tour.step(file)? {
                Step::Point(point) => {
                    self.points.push(point);
                    self.drop_passed();
                    let made = self.made();
                    if made <= self.next && made.is_multiple_of(CHUNK_SLOTS) {
                        *steps -= 1;
                    }
                }
                Step::Nearer => *steps -= 1,
                Step::Over => break,
            }
        }
        Ok(true)
    }

    /// The next chunk: of the points that are made, as many as there is room for, perhaps none.
    pub fn chunk(&mut self, object: u32) -> Chunk {
        let (mut header, mut slots) = blank(ChunkKind::Tour, object);
        header.code = self.next as u32;
        let ready = self.points.get(self.next - self.forgotten..);
        for (slot, point) in slots.iter_mut().zip(ready.unwrap_or_default()) {
            *slot = bytemuck::cast(*point);
            header.count += 1;
        }
        self.next += header.count as usize;
        header.last = u32::from(self.tour.is_over() && self.next >= self.made());
        self.drop_passed();
        (header, slots)
    }

    /// Points made so far.
    fn made(&self) -> usize {
        self.forgotten + self.points.len()
    }

    /// Drops points that need not be handed out any more, where they are many.
    fn drop_passed(&mut self) {
        if self.points.len() > MAX_KEPT_POINTS {
            let passed = self.points.len().min(self.next - self.forgotten);
            self.points.drain(..passed);
            self.forgotten += passed;
        }
    }
}

/// Index of the first point that is asked for; no tour has as many as the largest.
fn first(ask: &TourAsk) -> usize {
    ask.from.min(u64::from(u32::MAX)) as usize
}
