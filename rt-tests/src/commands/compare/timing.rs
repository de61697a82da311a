//! Times of single queries: nanoseconds each, of which interruptions are taken out by repetition.

use std::time::Instant;

/// Times that every query is repeated, of which the median counts: an interruption hits one of
/// them.
const ROUNDS: usize = 5;

/// A contender: answers query `k` with a number that is the same for all who are right.
pub type Query<'a> = dyn FnMut(usize) -> f64 + 'a;

/// What one contender took and answered.
#[derive(Debug, Clone, Default)]
pub struct Timed {
    /// Nanoseconds of each query: the median of its rounds, less what reading the clock takes.
    pub ns: Vec<f64>,
    /// Its answers.
    pub answers: Vec<f64>,
}

impl Timed {
    /// Adds the queries of another stretch.
    pub fn extend(&mut self, other: Self) {
        self.ns.extend(other.ns);
        self.answers.extend(other.answers);
    }

    /// Answers that are farther from those expected than `tolerance`.
    #[must_use]
    pub fn differ(&self, expected: &[f64], tolerance: f64) -> u64 {
        let near = |(answer, expected): &(&f64, &f64)| (*answer - *expected).abs() <= tolerance;
        let pairs = self.answers.iter().zip(expected);
        // What is not a number is near to nothing.
        pairs.filter(|pair| !near(pair)).count() as u64
    }
}

/// Puts `count` queries to each contender in turn, all of them [`ROUNDS`] times. A round goes
/// through all queries, so that none finds in the caches what the same query left there.
pub fn time(count: usize, contenders: &mut [&mut Query<'_>]) -> Vec<Timed> {
    let mut rounds = vec![vec![Vec::with_capacity(ROUNDS); count]; contenders.len()];
    let mut answers = vec![vec![0.0; count]; contenders.len()];
    for _ in 0..ROUNDS {
        for (who, query) in contenders.iter_mut().enumerate() {
            for k in 0..count {
                let start = Instant::now();
                let answer = query(k);
                rounds[who][k].push(start.elapsed().as_nanos() as f64);
                answers[who][k] = answer;
            }
        }
    }
    let clock = clock_ns();
    let median = |mut of: Vec<f64>| {
        of.sort_unstable_by(f64::total_cmp);
        (of[ROUNDS / 2] - clock).max(0.0)
    };
    rounds
        .into_iter()
        .zip(answers)
        .map(|(rounds, answers)| Timed {
            ns: rounds.into_iter().map(median).collect(),
            answers,
        })
        .collect()
}

/// What reading the clock twice takes.
fn clock_ns() -> f64 {
    let mut taken: Vec<f64> = (0..1001)
        .map(|_| Instant::now().elapsed().as_nanos() as f64)
        .collect();
    taken.sort_unstable_by(f64::total_cmp);
    taken[500]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_query_is_put_to_everyone_and_wrong_answers_are_counted() {
        let mut calls = [0; 2];
        let [first, second] = &mut calls;
        let mut right = |k: usize| {
            *first += 1;
            k as f64
        };
        let mut wrong = |k: usize| {
            *second += 1;
            if k == 3 { f64::NAN } else { k as f64 + 0.1 }
        };
        let timed = time(10, &mut [&mut right, &mut wrong]);
        assert_eq!(calls, [10 * ROUNDS; 2]);
        let expected: Vec<f64> = (0..10).map(f64::from).collect();
        assert_eq!(timed[0].differ(&expected, 0.0), 0);
        assert_eq!(timed[1].differ(&expected, 0.2), 1);
        assert_eq!(timed[1].differ(&expected, 0.0), 10);
        assert!(
            timed
                .iter()
                .all(|t| t.ns.len() == 10 && t.ns.iter().all(|ns| *ns >= 0.0))
        );
    }
}
