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
    /// Of the points kept, those handed out.
    given: usize,
}

impl PathGenerator {
    /// Nothing is made yet.
    pub fn new<D: AsRef<[u8]>>(
        file: &SpmFile<D>,
        model: usize,
        ask: TourAsk,
    ) -> Result<Self, TourError> {
        Ok(Self {
            model,
            ask,
            tour: Tour::new(file, ask)?,
            points: Vec::new(),
            forgotten: 0,
            given: 0,
        })
    }

    /// Whether it is the tour asked for, and can be handed out from its start.
    pub fn serves(&self, ask: &TourAsk) -> bool {
        let same = bytemuck::bytes_of(&self.ask) == bytemuck::bytes_of(ask);
        same && self.forgotten == 0
    }

    /// Hands out from the start again.
    pub fn again(&mut self) {
        self.given = 0;
    }

    /// Works until the next chunk is full, the tour is over or no steps are left; whether the chunk
    /// is ready.
    pub fn roll<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
        steps: &mut u64,
    ) -> Result<bool, FileError> {
        while self.points.len() - self.given < CHUNK_SLOTS && !self.tour.is_over() {
            if *steps == 0 {
                return Ok(false);
            }
            match self.tour.step(file)? {
                Step::Point(point) => self.points.push(point),
                Step::Nearer => *steps -= 1,
                Step::Over => break,
            }
        }
        Ok(true)
    }

    /// The next chunk: of the points that are made, as many as there is room for, perhaps none.
    pub fn chunk(&mut self, object: u32) -> Chunk {
        let (mut header, mut slots) = blank(ChunkKind::Tour, object);
        header.code = (self.forgotten + self.given) as u32;
        for (slot, point) in slots.iter_mut().zip(&self.points[self.given..]) {
            *slot = bytemuck::cast(*point);
            header.count += 1;
        }
        self.given += header.count as usize;
        header.last = u32::from(self.tour.is_over() && self.given == self.points.len());
        if self.points.len() > MAX_KEPT_POINTS {
            self.points.drain(..self.given);
            self.forgotten += self.given;
            self.given = 0;
        }
        (header, slots)
    }
}
