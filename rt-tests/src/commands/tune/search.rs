//! The dial: the tolerance at which a limit is just kept, by bisection, and the runs that correct
//! it.

use crate::failure::Failure;

/// Ratio of neighbouring tolerances at which the search ends.
pub const STEP: f64 = 1.1;

/// What a run says of its tolerance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It kept every limit.
    Kept,
    /// It kept every limit, and a finer tolerance may keep them too.
    Far,
    /// It did not keep a cost, of this name: a coarser tolerance may.
    TooFine(&'static str),
    /// It did not keep the error: a finer tolerance may.
    TooCoarse,
    /// It did not keep the error, and nothing tells a better tolerance: a cost was not kept either,
    /// or no error was measured.
    Neither,
}

impl Verdict {
    /// Whether every limit was kept.
    #[must_use]
    pub fn is_kept(self) -> bool {
        matches!(self, Self::Kept | Self::Far)
    }

    /// The limit that was not kept, by name.
    #[must_use]
    pub fn broken(self) -> Option<&'static str> {
        match self {
            Self::Kept | Self::Far => None,
            Self::TooFine(name) => Some(name),
            Self::TooCoarse | Self::Neither => Some(ERROR),
        }
    }
}

/// Name of the limit that a finer tolerance keeps.
pub const ERROR: &str = "the error";

/// A run at a tolerance.
#[derive(Debug, Clone, Copy)]
pub struct Tried<R> {
    /// The run.
    pub run: R,
    /// What it says.
    pub verdict: Verdict,
    /// The tolerance that may do by what it measured; none where that tells of none.
    pub guess: Option<f64>,
}

/// Runs at a tolerance, then at others while the newest run asks for one: so many at the most, and
/// `trial` is told how many may follow. The best run, and its tolerance.
///
/// A run that was too fine bounds all later ones from below; one that was too coarse, or far, from
/// above; every later one lies strictly between. So no tolerance is run twice, and what follows a
/// run that kept every limit is finer than it: the last that did is the finest, and is the result.
/// Where none did it is the last of all.
///
/// # Errors
/// When a trial fails.
pub fn corrected<R: Copy>(
    dial: (f64, f64),
    start: f64,
    corrections: usize,
    trial: &mut dyn FnMut(f64, usize) -> Result<Tried<R>, Failure>,
) -> Result<(f64, R), Failure> {
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    let (mut tolerance, mut left, mut kept) = (start, corrections, None);
    loop {
        let tried = trial(tolerance, left)?;
        if tried.verdict.is_kept() {
            kept = Some((tolerance, tried.run));
        }
        let step = match tried.verdict {
            Verdict::Kept | Verdict::Neither => None,
            Verdict::TooFine(_) => {
                low = tolerance;
                Some(coarser(dial, tolerance))
            }
            Verdict::TooCoarse | Verdict::Far => {
                high = tolerance;
                Some(finer(dial, tolerance, STEP))
            }
        };
        let is_between = |next: &f64| low < *next && *next < high;
        let guess = tried.guess.filter(is_between);
        let next = step.and_then(|step| guess.or(Some(step).filter(is_between)));
        let Some(next) = next.filter(|_| left > 0) else {
            return Ok(kept.unwrap_or((tolerance, tried.run)));
        };
        (tolerance, left) = (next, left - 1);
    }
}

/// A tolerance that is finer by a factor; below the dial every scan is at full resolution, which is
/// a tolerance of 0.
#[must_use]
pub fn finer(dial: (f64, f64), tolerance: f64, by: f64) -> f64 {
    let finer = rounded(tolerance / by);
    if finer < dial.0 { 0.0 } else { finer }
}

/// The next coarser tolerance, up to the end of the dial.
fn coarser(dial: (f64, f64), tolerance: f64) -> f64 {
    if tolerance < dial.0 {
        dial.0
    } else {
        rounded(tolerance * STEP).min(dial.1)
    }
}

/// The last tolerance below an edge and the first one beyond it, within [`STEP`] of each other:
/// `is_below` is true up to the edge, and of `low`, and false of `high`.
///
/// # Errors
/// When a trial fails.
pub fn edge(
    (mut low, mut high): (f64, f64),
    is_below: &mut dyn FnMut(f64) -> Result<bool, Failure>,
) -> Result<(f64, f64), Failure> {
    while high > STEP * low {
        let middle = rounded((low * high).sqrt());
        if is_below(middle)? {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok((low, high))
}

/// Three digits, as the settings print it.
#[must_use]
pub fn rounded(value: f64) -> f64 {
    if value <= 0.0 {
        return 0.0;
    }
    // The decimal digits, not a power of ten: what is printed is then what is used.
    format!("{value:.2e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_edge_is_found_wherever_it_lies() {
        for at in [1.3e-7, 5e-4, 0.09] {
            let mut trials = 0;
            let found = edge((1e-7, 0.1), &mut |tolerance| {
                trials += 1;
                Ok(tolerance <= at)
            });
            let (low, high) = found.unwrap_or_else(|error| panic!("{error}"));
            assert!(low <= at && at < high && high <= STEP * low * 1.01, "{at}");
            assert!(trials <= 10, "{trials}");
        }
        let failed = edge((1e-7, 0.1), &mut |_| {
            Err(Failure::Run("no trial".to_string()))
        });
        assert!(failed.is_err());
    }

    const DIAL: (f64, f64) = (1e-7, 0.1);
    const FINE: Verdict = Verdict::TooFine("the time");

    /// The tolerances that are run where the runs say this one after another, and the best.
    fn path(start: f64, said: &[(Verdict, Option<f64>)]) -> (Vec<f64>, f64) {
        let mut run = Vec::new();
        let corrections = said.len() - 1;
        let found = corrected(DIAL, start, corrections, &mut |tolerance, left| {
            assert_eq!(left, corrections - run.len());
            let (verdict, guess) = said[run.len()];
            run.push(tolerance);
            Ok(Tried {
                run: tolerance,
                verdict,
                guess,
            })
        });
        let (best, of_run) = found.unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(best, of_run);
        (run, best)
    }

    #[test]
    fn the_dial_is_never_turned_the_wrong_way() {
        for guess in [None, Some(1e-3), Some(2e-3), Some(f64::NAN)] {
            let (run, best) = path(1e-3, &[(Verdict::Far, guess), (Verdict::Kept, None)]);
            assert_eq!(
                (&run[..], best),
                (&[1e-3, 9.09e-4][..], 9.09e-4),
                "{guess:?}"
            );
        }
        for guess in [None, Some(1e-3), Some(5e-4), Some(0.0), Some(f64::NAN)] {
            let (run, best) = path(1e-3, &[(FINE, guess), (Verdict::Kept, None)]);
            assert_eq!((&run[..], best), (&[1e-3, 1.1e-3][..], 1.1e-3), "{guess:?}");
        }
    }

    #[test]
    fn a_run_that_kept_all_is_the_result_where_a_later_one_does_worse() {
        let far = (Verdict::Far, Some(5e-4));
        let (run, best) = path(1e-3, &[far, (FINE, None), (FINE, None)]);
        assert_eq!((&run[..], best), (&[1e-3, 5e-4, 5.5e-4][..], 1e-3));
        let (_, best) = path(1e-3, &[far, (FINE, None), (Verdict::Kept, None)]);
        assert_eq!(best, 5.5e-4);
    }

    #[test]
    fn the_ends_of_the_dial_are_left_and_not_tried_again() {
        let (run, _) = path(0.0, &[(FINE, None); 3]);
        assert_eq!(run, [0.0, 1e-7, 1.1e-7]);
        let (run, _) = path(1.05e-7, &[(Verdict::TooCoarse, None); 3]);
        assert_eq!(run, [1.05e-7, 0.0]);
        let (run, _) = path(0.1, &[(FINE, Some(0.1)); 3]);
        assert_eq!(run, [0.1]);
    }

    /// All that four runs may say, from every kind of start.
    #[test]
    fn no_tolerance_is_run_twice_and_the_finest_that_kept_all_is_the_result() {
        let verdicts = [
            Verdict::Kept,
            Verdict::Far,
            FINE,
            Verdict::TooCoarse,
            Verdict::Neither,
        ];
        let guesses = [None, Some(0.0), Some(2e-3)];
        let kinds = verdicts.len() * guesses.len();
        for start in [0.0, DIAL.0, 1e-3, DIAL.1] {
            for number in 0..kinds.pow(4) {
                let kind = |place: u32| {
                    let kind = number / kinds.pow(place) % kinds;
                    (
                        verdicts[kind / guesses.len()],
                        guesses[kind % guesses.len()],
                    )
                };
                let said = [0, 1, 2, 3].map(kind);
                let (run, best) = path(start, &said);
                for (k, at) in run.iter().enumerate() {
                    let mut later = run[k + 1..].iter();
                    let is_right = match said[k].0 {
                        Verdict::TooFine(_) => later.all(|next| next > at),
                        Verdict::TooCoarse | Verdict::Far => later.all(|next| next < at),
                        Verdict::Kept | Verdict::Neither => later.next().is_none(),
                    };
                    assert!(is_right, "{said:?}: {run:?}");
                }
                let kept = run.iter().zip(&said).filter(|(_, of)| of.0.is_kept());
                let finest = kept.map(|(at, _)| *at).reduce(f64::min);
                let expected = finest.or(run.last().copied());
                assert_eq!(Some(best), expected, "{said:?}: {run:?}");
            }
        }
    }

    #[test]
    fn what_is_printed_is_what_is_used() {
        for value in [1.2345e-4, 9.999e-6, 0.15, 0.0] {
            let rounded = rounded(value);
            assert_eq!(format!("{rounded}").parse::<f64>(), Ok(rounded));
            assert!((rounded - value).abs() <= 0.005 * value);
        }
    }
}
