//! Times of single queries, nanoseconds each. Every query is timed once, so that none finds in the
//! caches what the same query left there.

use crate::clocks::Clocks;
use crate::failure::Failure;
use std::hint::black_box;
use std::ops::Range;

/// A contender: answers query `k` with a number that is the same for all who are right.
pub type Query<'a> = dyn FnMut(usize) -> f64 + 'a;

/// What one contender took and answered.
#[derive(Debug, Clone, Default)]
pub struct Timed {
    /// Nanoseconds of each single query, less what reading the clocks takes.
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

/// What the caches hold when a query is put.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Caches {
    /// What the query before left.
    AsLeft,
    /// Nothing of it, but in a cache that the cores share.
    Swept,
}

/// Bytes that are read to sweep a core's own caches: those of current cores have at most 2 MiB.
pub const SWEPT_BYTES: usize = 4 << 20;

/// What is read to sweep a core's caches. Not zeros: untouched pages would all be one.
fn sweep() -> Vec<u8> {
    vec![1u8; SWEPT_BYTES]
}

fn read(sweep: &[u8]) {
    let lines = sweep.iter().step_by(64);
    black_box(lines.fold(0u8, |sum, &byte| sum.wrapping_add(byte)));
}

/// Queries that are put to one contender before it is the turn of the next: what the machine does
/// meanwhile meets all of them.
const TURN: usize = 500;
/// Queries before its turn that are put to a contender again, untimed: the others have filled the
/// caches with what is theirs.
const BEFORE_TURN: usize = 50;

/// Puts `count` queries to each contender, in turns; each is timed once.
pub fn time(count: usize, contenders: &mut [&mut Query<'_>]) -> Vec<Timed> {
    let mut all = vec![Timed::default(); contenders.len()];
    let before = match contenders.len() {
        1 => 0,
        _ => BEFORE_TURN,
    };
    for first in (0..count).step_by(TURN) {
        let turn = first..(first + TURN).min(count);
        for (query, timed) in contenders.iter_mut().zip(&mut all) {
            for k in first.saturating_sub(before)..first {
                query(k);
            }
            timed.extend(time_one(Caches::AsLeft, turn.clone(), *query));
        }
    }
    all
}

/// How queries are put to contenders of which one forms its front anew for some of them, and others
/// are asked in a program of their own: all in the same short turns, by [`time_stretch`].
#[derive(Debug, Clone, Copy)]
pub struct Turns {
    /// What the caches hold.
    pub caches: Caches,
    /// Queries.
    pub count: usize,
    /// Queries of a turn, and at most before it.
    pub length: usize,
}

/// A turn of a contender that has something to do before it, which is not timed.
pub type Turn<'a> = dyn FnMut(Range<usize>) -> Result<Timed, Failure> + 'a;
/// A turn of those who are asked in a program of their own, which times them.
pub type TurnApart<'a> = dyn FnMut(Range<usize>) -> Result<(), Failure> + 'a;

impl Turns {
    /// Puts all queries to everyone: what the machine does meanwhile meets all of them. What the
    /// one that forms fronts took is the first, then the others in their order.
    ///
    /// # Errors
    /// When a front cannot be formed, or the program fails.
    pub fn take(
        self,
        forms_front: &mut Turn<'_>,
        others: &mut [&mut Query<'_>],
        apart: &mut TurnApart<'_>,
    ) -> Result<Vec<Timed>, Failure> {
        let mut all = vec![Timed::default(); 1 + others.len()];
        for first in (0..self.count).step_by(self.length) {
            let turn = first..(first + self.length).min(self.count);
            all[0].extend(forms_front(turn.clone())?);
            for (query, timed) in others.iter_mut().zip(&mut all[1..]) {
                timed.extend(self.one(turn.clone(), *query));
            }
            apart(turn)?;
        }
        Ok(all)
    }

    /// A turn of one contender.
    pub fn one(self, turn: Range<usize>, query: &mut Query<'_>) -> Timed {
        time_stretch(self.caches, turn, self.length, query)
    }
}

/// Puts some queries in a row, each once. The clocks are measured anew: what reading them takes
/// changes with the machine's load.
fn time_one(caches: Caches, queries: Range<usize>, query: &mut Query<'_>) -> Timed {
    let clocks = Clocks::new();
    let sweep = match caches {
        Caches::AsLeft => Vec::new(),
        Caches::Swept => sweep(),
    };
    let mut timed = Timed {
        ns: Vec::with_capacity(queries.len()),
        answers: Vec::with_capacity(queries.len()),
    };
    for k in queries {
        read(&sweep);
        let (ns, answer) = clocks.time(|| query(k));
        timed.ns.push(ns);
        timed.answers.push(answer);
    }
    timed
}

/// Puts the queries of a stretch, each once, by their places among all. As where all are put in a
/// row, those right before them were the queries before, up to `before` of them: what was done
/// until now, as forming a front or searching for what is expected, leaves nothing in the caches.
pub fn time_stretch(
    caches: Caches,
    stretch: Range<usize>,
    before: usize,
    query: &mut Query<'_>,
) -> Timed {
    let first = stretch.start;
    read(&sweep());
    // The first of all is put before itself.
    for k in first.saturating_sub(before)..=first.saturating_sub(1) {
        query(k);
    }
    time_one(caches, stretch, query)
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
        assert_eq!(calls, [10; 2]);
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

    /// Each gets all in order; after the first turn some before its turn once more.
    #[test]
    fn contenders_take_turns_and_every_query_is_timed_once() {
        let count = 2 * TURN + 7;
        let put = std::cell::RefCell::new(Vec::new());
        let ask = |who: usize, k: usize| {
            put.borrow_mut().push((who, k));
            k as f64
        };
        let timed = time(count, &mut [&mut |k| ask(0, k), &mut |k| ask(1, k)]);
        let expected: Vec<f64> = (0..count).map(|k| k as f64).collect();
        assert!(timed.iter().all(|timed| timed.answers == expected));
        let turns = [0..TURN, TURN..2 * TURN, 2 * TURN..count];
        let due = turns.into_iter().flat_map(|turn| {
            let from = turn.start.saturating_sub(BEFORE_TURN);
            let of = move |who| (from..turn.end).map(move |k| (who, k));
            of(0).chain(of(1))
        });
        assert_eq!(*put.borrow(), due.collect::<Vec<_>>());
    }

    /// A front is formed before its turn; a turn of everyone ends before the next begins.
    #[test]
    fn everyone_takes_the_same_short_turns() {
        let put = std::cell::RefCell::new(Vec::new());
        let ask = |who: &'static str, k: usize| {
            put.borrow_mut().push((who, k));
            k as f64
        };
        let turns = Turns {
            caches: Caches::Swept,
            count: 5,
            length: 2,
        };
        let timed = turns.take(
            &mut |turn: Range<usize>| {
                ask("forms", turn.start);
                Ok(turns.one(turn, &mut |k| ask("local", k)))
            },
            &mut [&mut |k| ask("full", k)],
            &mut |turn: Range<usize>| {
                ask("apart", turn.end);
                Ok(())
            },
        );
        let timed = timed.expect("nothing fails");
        assert_eq!(timed.len(), 2);
        for of in &timed {
            assert_eq!(of.answers, [0.0, 1.0, 2.0, 3.0, 4.0]);
        }
        let mut due = Vec::new();
        // The first of all is put before itself.
        for (turn, before) in [(0..2, 0..1), (2..4, 0..2), (4..5, 2..4)] {
            due.push(("forms", turn.start));
            for who in ["local", "full"] {
                due.extend(before.clone().chain(turn.clone()).map(|k| (who, k)));
            }
            due.push(("apart", turn.end));
        }
        assert_eq!(*put.borrow(), due);
        let fails = || Err(Failure::Run("it ended".to_string()));
        let ended = turns.take(&mut |_| Ok(Timed::default()), &mut [], &mut |_| fails());
        assert!(ended.is_err());
    }

    #[test]
    fn a_stretch_is_put_right_behind_the_queries_before_it() {
        for (stretch, before) in [(0..4, 0..1), (2..5, 0..2), (7..9, 4..7)] {
            let mut put = Vec::new();
            let mut query = |k: usize| {
                put.push(k);
                k as f64
            };
            let timed = time_stretch(Caches::Swept, stretch.clone(), 3, &mut query);
            let expected: Vec<f64> = stretch.clone().map(|k| k as f64).collect();
            assert_eq!(timed.answers, expected);
            assert_eq!(put, before.chain(stretch).collect::<Vec<_>>());
        }
    }

    #[test]
    fn single_slow_queries_are_not_averaged_away() {
        let work = |steps: u64| (0..steps).fold(0, |x, k| black_box(x ^ k)) as f64;
        let mut query = |k: usize| work(if k % 50 == 7 { 2_000_000 } else { 10 });
        let mut ns = time(200, &mut [&mut query]).swap_remove(0).ns;
        crate::report::quantile::sort(&mut ns);
        // Four of them, of thousands of times the work.
        assert!(ns[197] > 10.0 * ns[100], "{:?}", &ns[190..]);
    }
}
