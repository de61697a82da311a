//! Whether the time of a tick is over: asked by the core, answered by the clock, and recorded, so
//! that a replay is told the same.

use hrtc_core::{Stage, StageObserver, Timed};
use serde::{Deserialize, Serialize};

/// The answers that a tick was given, for each of [`Timed::ALL`]: how many times it could go on
/// before its time was over, and [`TimeAnswers::ALWAYS`] where it never was.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct TimeAnswers(pub [u32; Timed::ALL.len()]);

impl TimeAnswers {
    /// The time was not over.
    pub const ALWAYS: u32 = u32::MAX;

    /// Whether the time was over for a kind of work.
    #[must_use]
    pub fn was_over(&self, work: Timed) -> bool {
        self.0[work as usize] != Self::ALWAYS
    }
}

impl Default for TimeAnswers {
    fn default() -> Self {
        Self([Self::ALWAYS; Timed::ALL.len()])
    }
}

/// Notes the answers of a tick.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct NotedAnswers {
    went_on: [u32; Timed::ALL.len()],
    is_over: [bool; Timed::ALL.len()],
}

impl NotedAnswers {
    /// An answer by the clock, unless the time was over before.
    pub fn answer(&mut self, work: Timed, is_over: impl FnOnce() -> bool) -> bool {
        let k = work as usize;
        self.is_over[k] = self.is_over[k] || is_over();
        self.went_on[k] += u32::from(!self.is_over[k]);
        self.is_over[k]
    }

    /// All of them.
    pub fn all(&self) -> TimeAnswers {
        let of = |k: usize| {
            if self.is_over[k] {
                self.went_on[k]
            } else {
                TimeAnswers::ALWAYS
            }
        };
        TimeAnswers(std::array::from_fn(of))
    }
}

/// Gives recorded answers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RecordedAnswers(pub TimeAnswers);

impl StageObserver for RecordedAnswers {
    fn ended(&mut self, _: Stage) {}

    fn is_over(&mut self, work: Timed) -> bool {
        let left = &mut self.0.0[work as usize];
        if matches!(*left, 0 | TimeAnswers::ALWAYS) {
            return *left == 0;
        }
        *left -= 1;
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recorded_answers_are_those_of_the_clock() {
        // Over from the given question on; a clock is not asked again.
        for over_from in [0, 1, 5, 100] {
            let mut noted = NotedAnswers::default();
            let mut asked = 0;
            let given: Vec<bool> = (0..20)
                .map(|_| {
                    noted.answer(Timed::Contact, || {
                        asked += 1;
                        asked > over_from
                    })
                })
                .collect();
            assert_eq!(
                given.iter().filter(|&&is_over| !is_over).count(),
                over_from.min(20)
            );
            let answers = noted.all();
            assert_eq!(answers.was_over(Timed::Contact), over_from < 20);
            assert!(!answers.was_over(Timed::Refinement));
            let mut replayed = RecordedAnswers(answers);
            for &is_over in &given {
                assert_eq!(replayed.is_over(Timed::Contact), is_over);
                assert!(!replayed.is_over(Timed::Refinement));
            }
        }
    }
}
