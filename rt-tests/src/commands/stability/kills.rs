//! Each case with its fault in the product, beside the same case without it: what fails by itself
//! finds nothing. A fault is to break the measure of each of its cases: where only what must happen
//! did not, the measure and its limit might see nothing at all.

use super::{MutantFound, Stability, StabilityArgs};
use crate::cases::Case;
use crate::failure::Failure;
use crate::report::table::Table;
use serde::Serializer;

/// Cases whose measure is known to be broken by no mutant, and why.
const BY_PREMISE: [(&str, &str); 1] = [(
    "ten-thousand-faces",
    "no mutant makes a query dearer: its limit of work is beside nothing, and that a tool pushes out must happen",
)];

/// Writes those of cases that are not open.
pub(super) fn closed<S: Serializer>(found: &[MutantFound], to: S) -> Result<S::Ok, S::Error> {
    to.collect_seq(found.iter().filter(|of| of.open.is_empty()))
}

impl MutantFound {
    /// What a case came to without the fault and with it. A run that broke off has measured
    /// nothing, so it is no kill.
    #[cfg(any(test, feature = "mutants"))]
    fn of(name: String, without: &super::Verdict, with: &super::Verdict) -> Self {
        let killed = without.pass && !with.pass && with.error.is_empty();
        let by_premise = killed && with.measure_keeps;
        let note = match (without.pass, with.error.as_str()) {
            (false, _) if without.error.is_empty() => {
                "without it the case is beyond its limit, too".to_string()
            }
            (false, _) => format!("without it the case breaks off: {}", without.error),
            (true, "") if by_premise => {
                "with it the measure keeps to its limit, and what must happen does not".to_string()
            }
            (true, "") => String::new(),
            (true, error) => format!("with it the case breaks off: {error}"),
        };
        Self {
            name,
            case: without.name,
            killed,
            by_premise,
            judged: without.pass,
            open: "",
            note,
        }
    }

    /// A case that is known to be beyond its limit says nothing of its fault.
    #[cfg(any(test, feature = "mutants"))]
    fn of_open(case: &Case) -> Self {
        Self {
            name: format!("{:?}", case.mutant),
            case: case.name,
            killed: false,
            by_premise: false,
            judged: false,
            open: case.open,
            note: format!("open: {}", case.open),
        }
    }

    /// The verdict in a word or two.
    pub(super) fn word(&self) -> &'static str {
        match (self.killed, self.by_premise, self.judged) {
            (true, true, _) => "killed (premise)",
            (true, false, _) => "killed",
            (false, _, true) => "LIVES",
            (false, _, false) if self.open.is_empty() => "NOT JUDGED",
            (false, _, false) => "not judged: open",
        }
    }
}

/// Every case with its fault in the product; one that is known to fail is not run.
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
    let (closed, open): (Vec<&Case>, Vec<&Case>) =
        cases.iter().copied().partition(|case| case.open.is_empty());
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
        let open = open.iter().filter(|case| case.mutant == mutant);
        found.extend(open.map(|case| MutantFound::of_open(case)));
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

/// Whether every mutant was found, and by a measure.
///
/// # Errors
/// One sentence that names those that live, those of which nothing can be said, open cases where
/// there are no others, and mutants that do not break the measure of a case of theirs.
pub(super) fn judge(mutants: &[MutantFound]) -> Result<(), Failure> {
    let named = |which: fn(&MutantFound) -> bool| {
        let of = mutants.iter().filter(|of| which(of));
        let names: Vec<String> = of.map(|of| format!("{} of {}", of.name, of.case)).collect();
        names.join(", ")
    };
    let nothing = if mutants.iter().any(|of| of.judged) {
        String::new()
    } else {
        named(|of| !of.open.is_empty())
    };
    let failed = [
        ("mutants live", named(|of| of.judged && !of.killed)),
        (
            "mutants are not judged",
            named(|of| !of.judged && of.open.is_empty()),
        ),
        ("nothing is judged, the cases are open", nothing),
        (
            "mutants are killed by no measure",
            named(|of| of.by_premise && known_by_premise(of.case).is_none()),
        ),
    ];
    let failed = failed.into_iter().filter(|(_, names)| !names.is_empty());
    let failed: Vec<String> = failed
        .map(|(what, names)| format!("{what}: {names}"))
        .collect();
    if failed.is_empty() {
        return Ok(());
    }
    Err(Failure::Run(failed.join("; ")))
}

/// Why the measure of a case is known to be broken by no mutant.
fn known_by_premise(case: &str) -> Option<&'static str> {
    let known = BY_PREMISE.iter().find(|&&(name, _)| name == case);
    known.map(|&(_, why)| why)
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
    for mutant in &found.mutants {
        if let Some(why) = known_by_premise(mutant.case) {
            text += &format!(
                "the measure of {} is known to be broken by no mutant: {why}\n",
                mutant.case
            );
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::tests::verdict;
    use super::super::{Verdict, page};
    use super::*;
    use crate::cases::all;
    use mutants::Mutant;

    fn found(without: (bool, &str), with: (bool, &str)) -> MutantFound {
        let [without, with] = [without, with].map(|(pass, error)| verdict("rest", pass, error));
        MutantFound::of("Sign".to_string(), &without, &with)
    }

    /// A mutant that breaks what must happen in a case, and no measure.
    fn by_premise(mutant: Mutant, case: &'static str) -> MutantFound {
        let with = Verdict {
            measure_keeps: true,
            ..verdict(case, false, "")
        };
        MutantFound::of(format!("{mutant:?}"), &verdict(case, true, ""), &with)
    }

    /// The same in each of its cases that are not open.
    fn all_by_premise(mutant: Mutant) -> Vec<MutantFound> {
        let cases = all().filter(|case| case.mutant == mutant && case.open.is_empty());
        cases.map(|case| by_premise(mutant, case.name)).collect()
    }

    fn stability(mutants: Vec<MutantFound>) -> Stability {
        Stability {
            seed: 1,
            full: false,
            rate_hz: 1e3,
            small_lossy: false,
            cases: Vec::new(),
            step_times: Vec::new(),
            mutants,
        }
    }

    #[test]
    fn a_kill_is_a_limit_that_is_broken_by_the_mutant_alone() {
        let killed = found((true, ""), (false, ""));
        assert!(killed.killed && killed.judged && killed.note.is_empty());
        assert_eq!(killed.word(), "killed");
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
        let text = table(&stability(vec![of, found((false, ""), (false, ""))]));
        assert!(text.contains("breaks off: it panicked"), "{text}");
        assert!(text.contains("beyond its limit, too"), "{text}");
    }

    #[test]
    fn a_mutant_that_does_not_break_the_measure_of_a_case_fails() {
        let mut rows = all_by_premise(Mutant::Folds);
        assert!(rows.len() > 1 && rows.iter().all(|of| of.killed));
        assert!(table(&stability(rows.clone())).contains("killed (premise)"));
        let said = judge(&rows).expect_err("no measure sees it").to_string();
        assert!(said.contains("killed by no measure: Folds"), "{said}");
        // Another case that sees it tells nothing of the limit of this one.
        rows[0].by_premise = false;
        let said = judge(&rows).expect_err("one measure does not").to_string();
        assert!(
            said.contains(rows[1].case) && said.matches("Folds").count() == rows.len() - 1,
            "{said}"
        );
        for row in &mut rows {
            row.by_premise = false;
        }
        assert_eq!(judge(&rows), Ok(()));
        // Where it is known, it is told.
        for (name, why) in BY_PREMISE {
            let case = all().find(|case| case.name == name);
            let case = case.unwrap_or_else(|| panic!("{name} is no case any more"));
            let rows = vec![by_premise(case.mutant, case.name)];
            assert_eq!(judge(&rows), Ok(()), "{name}");
            assert!(table(&stability(rows)).contains(why), "{name}");
        }
    }

    #[test]
    fn an_open_case_is_told_and_is_nothing_by_itself() {
        let case = all().find(|case| !case.open.is_empty());
        let open = MutantFound::of_open(case.expect("a case is open"));
        assert_eq!(open.word(), "not judged: open");
        let said = judge(std::slice::from_ref(&open)).expect_err("nothing is judged");
        assert!(said.to_string().contains(open.case), "{said}");
        let both = stability(vec![open.clone(), found((true, ""), (false, ""))]);
        assert_eq!(judge(&both.mutants), Ok(()));
        for text in [table(&both), page::page(&both)] {
            assert!(text.contains("not judged: open"), "{text}");
        }
        assert!(page::page(&both).contains("1 of 1 cases find"));
    }
}
