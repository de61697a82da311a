//! Regions whose answers are outstanding, and when they were asked for.

use crate::cache::{MAX_OUTSTANDING, RegionKey};
use crate::tuning::streaming::LOST_AT_ONCE;

/// A region asked for.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Question {
    /// The region.
    pub region: RegionKey,
    /// When it was asked for last, by the clock of the link's meter as all times here.
    asked: u64,
    /// Whether it was asked for twice, or its answer has begun: then that says nothing about the
    /// round trip.
    is_spent: bool,
    /// Whether its first answer was of no use.
    is_lost: bool,
}

/// The outstanding ones in the order in which they were asked for; storage made once.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Questions {
    #[serde(with = "spm::reserved")]
    questions: Vec<Question>,
    high_water: usize,
}

impl Questions {
    /// None.
    #[must_use]
    pub fn new() -> Self {
        Self {
            questions: Vec::with_capacity(MAX_OUTSTANDING as usize),
            high_water: 0,
        }
    }

    /// Those outstanding.
    #[must_use]
    pub fn all(&self) -> &[Question] {
        &self.questions
    }

    /// Their number at the most, so far.
    #[must_use]
    pub fn high_water(&self) -> usize {
        self.high_water
    }

    /// Whether several answers were of no use, and those in their place are outstanding.
    #[must_use]
    pub fn has_lost_many(&self) -> bool {
        self.questions.iter().filter(|of| of.is_lost).count() >= LOST_AT_ONCE
    }

    /// Whether the first answer to a region was of no use: then it was asked for with every record.
    #[must_use]
    pub fn is_lost(&self, region: RegionKey) -> bool {
        let mut all = self.questions.iter();
        all.any(|of| of.region == region && of.is_lost)
    }

    /// Forgets all of them.
    pub fn clear(&mut self) {
        self.questions.clear();
    }

    /// A region is asked for; fewer than [`MAX_OUTSTANDING`] are outstanding.
    pub fn ask(&mut self, region: RegionKey, tick: u64) {
        debug_assert!(self.questions.len() < self.questions.capacity());
        self.questions.push(Question {
            region,
            asked: tick,
            is_spent: false,
            is_lost: false,
        });
        self.high_water = self.high_water.max(self.questions.len());
    }

    /// What came of an answer is of no use: it is to be asked for again.
    pub fn lose(&mut self, region: RegionKey) {
        // The station owes nothing until then.
        self.ask_again(region, u64::MAX);
    }

    /// A region is asked for again.
    pub fn ask_again(&mut self, region: RegionKey, tick: u64) {
        if let Some(of) = self.questions.iter_mut().find(|of| of.region == region) {
            (of.asked, of.is_spent, of.is_lost) = (tick, true, true);
        }
    }

    /// An answer begins: the ticks that it took, if they are those of a round trip.
    pub fn begin_answer(&mut self, region: RegionKey, tick: u64) -> Option<u64> {
        let mut all = self.questions.iter_mut();
        let question = all.find(|of| of.region == region && !of.is_spent)?;
        question.is_spent = true;
        Some(tick.saturating_sub(question.asked))
    }

    /// A region is answered, refused or given up.
    pub fn end(&mut self, region: RegionKey) {
        if let Some(k) = self.questions.iter().position(|of| of.region == region) {
            self.questions.remove(k);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_asked_twice_or_answered_in_part_is_no_round_trip() {
        let [a, b] = [1, 2].map(RegionKey::prefix);
        let mut questions = Questions::new();
        questions.ask(a, 10);
        questions.ask(b, 11);
        assert_eq!(questions.begin_answer(a, 15), Some(5));
        assert_eq!(questions.begin_answer(a, 16), None);
        questions.lose(b);
        questions.ask_again(b, 20);
        assert_eq!(questions.begin_answer(b, 30), None);
        questions.end(a);
        assert_eq!(questions.all().len(), 1);
        assert_eq!(questions.high_water(), 2);
    }

    #[test]
    fn many_are_lost_until_their_second_answers_are_here() {
        let regions: Vec<_> = (0..=LOST_AT_ONCE as u32).map(RegionKey::prefix).collect();
        let mut questions = Questions::new();
        regions.iter().for_each(|&of| questions.ask(of, 10));
        for (lost, &region) in regions[1..].iter().enumerate() {
            assert!(!questions.has_lost_many(), "{lost}");
            questions.lose(region);
        }
        assert!(questions.has_lost_many());
        questions.ask_again(regions[1], 20);
        questions.end(regions[0]);
        assert!(questions.has_lost_many());
        questions.end(regions[1]);
        assert!(!questions.has_lost_many());
    }
}
