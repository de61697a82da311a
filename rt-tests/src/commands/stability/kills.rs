//! Each case with its fault in the product, beside the same case without it: what fails by itself
//! finds nothing.

use super::{MutantFound, Stability, StabilityArgs};
use crate::cases::Case;
use crate::failure::Failure;
use crate::report::table::Table;

impl MutantFound {
    /// What a case came to without the fault and with it. A run that broke off has measured
    /// nothing, so it is no kill.
    #[cfg(any(test, feature = "mutants"))]
    fn of(name: String, without: &super::Verdict, with: &super::Verdict) -> Self {
        let note = match (without.pass, with.error.as_str()) {
            (false, _) if without.error.is_empty() => {
                "without it the case is beyond its limit, too".to_string()
            }
            (false, _) => format!("without it the case breaks off: {}", without.error),
            (true, "") => String::new(),
            (true, error) => format!("with it the case breaks off: {error}"),
        };
        Self {
            name,
            case: without.name,
            killed: without.pass && !with.pass && with.error.is_empty(),
            judged: without.pass,
            note,
        }
    }

    /// The verdict in a word.
    pub(super) fn word(&self) -> &'static str {
        match (self.killed, self.judged) {
            (true, _) => "killed",
            (false, true) => "LIVES",
            (false, false) => "NOT JUDGED",
        }
    }
}

/// Every case with its fault in the product; a case that is known to fail says nothing of it.
#[cfg(feature = "mutants")]
pub(super) fn run(
    cases: &[&Case],
    args: &StabilityArgs,
    is_run: impl Fn(&str) + Sync,
) -> Result<Vec<MutantFound>, Failure> {
    use super::{Verdict, run_case};
    use mutants::{Mutant, choose};
    use rayon::prelude::*;

    let hook = std::panic::take_hook();
    // Its text would stand between the rows; that it happened is in the note.
    std::panic::set_hook(Box::new(|_| {}));
    let closed = cases.iter().copied().filter(|case| case.open.is_empty());
    let closed: Vec<&Case> = closed.collect();
    let run = |case: &Case| {
        let verdict = run_case(case, args, None);
        is_run(case.name);
        verdict
    };
    choose(None);
    // A case has one mutant, so that all of them can run at once first.
    let without = closed.par_iter().with_max_len(1).map(|&case| run(case));
    let without: Vec<Verdict> = without.collect();
    let pairs: Vec<(&Case, &Verdict)> = closed.iter().copied().zip(&without).collect();
    let mut found = Vec::new();
    for mutant in Mutant::ALL {
        choose(Some(mutant));
        let of_mutant = pairs.par_iter().filter(|pair| pair.0.mutant == mutant);
        let results: Vec<MutantFound> = of_mutant
            .map(|pair| MutantFound::of(format!("{mutant:?}"), pair.1, &run(pair.0)))
            .collect();
        choose(None);
        found.extend(results);
    }
    std::panic::set_hook(hook);
    Ok(found)
}

/// Nothing: this build has no faults.
///
/// # Errors
/// Always.
#[cfg(not(feature = "mutants"))]
pub(super) fn run(
    _: &[&Case],
    _: &StabilityArgs,
    _: impl Fn(&str),
) -> Result<Vec<MutantFound>, Failure> {
    Err(Failure::Input(
        "this build has no mutants: build it with cargo run --release -p rt-tests --features mutants"
            .to_string(),
    ))
}

/// Whether every mutant was found.
///
/// # Errors
/// One sentence that names those that live, and those of which nothing can be said.
pub(super) fn judge(mutants: &[MutantFound]) -> Result<(), Failure> {
    let named = |judged: bool| -> Vec<String> {
        let left = mutants.iter().filter(|of| !of.killed);
        left.filter(|of| of.judged == judged)
            .map(|of| format!("{} of {}", of.name, of.case))
            .collect()
    };
    let (living, unknown) = (named(true), named(false));
    let mut failed = Vec::new();
    if !living.is_empty() {
        failed.push(format!("mutants live: {}", living.join(", ")));
    }
    if !unknown.is_empty() {
        let names = unknown.join(", ");
        failed.push(format!("mutants are not judged: {names}"));
    }
    if failed.is_empty() {
        return Ok(());
    }
    Err(Failure::Run(failed.join("; ")))
}

/// The table of the terminal.
pub(super) fn table(found: &Stability) -> String {
    let mut table = Table::new(3, "mutant | case | verdict");
    for mutant in &found.mutants {
        table.row([
            mutant.name.clone(),
            mutant.case.to_string(),
            mutant.word().to_string(),
        ]);
    }
    let mut text = format!("faults in the product, seed {}\n\n{table}", found.seed);
    for mutant in found.mutants.iter().filter(|of| !of.note.is_empty()) {
        text += &format!("{} of {}: {}\n", mutant.name, mutant.case, mutant.note);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::tests::verdict;
    use super::*;

    fn found(without: (bool, &str), with: (bool, &str)) -> MutantFound {
        let [without, with] = [without, with].map(|(pass, error)| verdict("rest", pass, error));
        MutantFound::of("Sign".to_string(), &without, &with)
    }

    #[test]
    fn a_kill_is_a_limit_that_is_broken_by_the_mutant_alone() {
        let killed = found((true, ""), (false, ""));
        assert!(killed.killed && killed.judged && killed.note.is_empty());
        assert_eq!(judge(&[killed]), Ok(()));
        // It lives; it breaks off; the case fails by itself; the case breaks off by itself.
        for (without, with, word) in [
            ((true, ""), (true, ""), "LIVES"),
            ((true, ""), (false, "it panicked"), "LIVES"),
            ((false, ""), (false, ""), "NOT JUDGED"),
            ((false, "no mesh"), (false, "no mesh"), "NOT JUDGED"),
        ] {
            let of = found(without, with);
            assert_eq!((of.killed, of.word()), (false, word), "{of:?}");
            let said = judge(&[of]).expect_err("it is no kill").to_string();
            assert!(said.contains("Sign of rest"), "{said}");
        }
    }

    #[test]
    fn what_is_no_kill_says_why() {
        let of = found((true, ""), (false, "it panicked"));
        assert!(of.note.contains("it panicked"), "{of:?}");
        let all = Stability {
            seed: 1,
            full: false,
            rate_hz: 1e3,
            cases: Vec::new(),
            step_times: Vec::new(),
            mutants: vec![of, found((false, ""), (false, ""))],
        };
        let text = table(&all);
        assert!(text.contains("breaks off: it panicked"), "{text}");
        assert!(text.contains("beyond its limit, too"), "{text}");
    }
}
