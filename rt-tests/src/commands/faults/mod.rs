//! `rt-tests faults`: real processes that are killed, stopped, replaced and starved while a surface
//! is touched, a device in a process of its own that outlives its controller, and two hosts whose
//! link breaks.
//!
//! | module | holds |
//! |---|---|
//! | `bench` | the folder with model and scenes |
//! | `touch` | a station and a controller in contact, and what is asked of every run |
//! | `station`, `controller`, `hostile`, `device`, `link` | the cases |
//! | `verdict` | what all cases came to |

mod bench;
mod controller;
mod device;
mod hostile;
mod link;
mod station;
mod touch;
mod verdict;

use self::bench::{Bench, MAX_SLOTS};
use self::touch::{RESYNC_MS, Touch, Undisturbed};
use self::verdict::{Answer, Times, Verdicts};
pub use self::verdict::{Case, Faults, Harmed};
use crate::failure::{Failure, beside_measured};
use crate::processes::stop::{is_set, stop_flag};
use crate::report::output::{print, print_json, status_line};
use crate::report::quantile::median;
use crate::report::table::Table;
use clap::Args;
use std::fmt::Write as _;
use std::sync::atomic::AtomicBool;

/// Undisturbed runs that the others are compared with.
const UNDISTURBED: usize = 3;
/// Faces of the hostile client's model: regions to slide over, and what 24 GB of memory can build.
const MIN_HOSTILE_FACES: u32 = 10_000;
const MAX_HOSTILE_FACES: u32 = 100_000_000;
/// Kills at the most: hours of them; more is a typing error.
const MAX_KILLS: u64 = 1000;
/// Why no front could be compared.
const FRONTS_DIFFER: &str = "the undisturbed runs ended with different fronts";

/// Arguments of `rt-tests faults`.
#[derive(Debug, Args)]
pub struct FaultsArgs {
    /// Kills in contact: of the station, of the controller, of the controller of a device in a
    /// process of its own, and of the processes of a link
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub kills: u64,
    /// Run these cases only, by name
    #[arg(value_name = "CASE")]
    pub cases: Vec<String>,
    /// Faces of the model of the case hostile-controller; 10000000 takes minutes and 3 GB to build
    #[arg(long, value_name = "N", default_value_t = 200_000)]
    pub hostile_faces: u32,
    /// Step the clock of the whole machine by an hour and back, for the case clock-stepped
    #[arg(long)]
    pub step_clock: bool,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
}

/// A case: its name, and how it is run with so many kills; what cannot be run says why in `Skip`.
struct Row {
    name: &'static str,
    run: fn(&Bench, u64, &mut Verdicts) -> Answer,
    needs: fn(&FaultsArgs) -> Result<(), String>,
}

fn nothing(_: &FaultsArgs) -> Result<(), String> {
    Ok(())
}

const fn over_link(name: &'static str, run: fn(&Bench, u64, &mut Verdicts) -> Answer) -> Row {
    Row {
        name,
        run,
        needs: link::needs,
    }
}

const fn row(name: &'static str, run: fn(&Bench, u64, &mut Verdicts) -> Answer) -> Row {
    Row {
        name,
        run,
        needs: nothing,
    }
}

/// All cases, in their order.
const ROWS: [Row; 21] = [
    row("station-killed", station::killed),
    row("station-stopped", station::stopped),
    row("station-restarted", station::restarted),
    row("station-other-version", station::other_version),
    row("file-overwritten", station::file_overwritten),
    row("folder-removed", station::folder_removed),
    row("two-stations", station::two_stations),
    row("controller-killed", controller::killed),
    row("seventeen-controllers", controller::seventeen),
    row("hostile-controller", hostile::hostile),
    row("no-rights", controller::no_rights),
    Row {
        name: "disk-full",
        run: controller::disk_full,
        needs: controller::can_mount,
    },
    Row {
        name: "clock-stepped",
        run: controller::clock_stepped,
        needs: controller::can_step_clock,
    },
    row("device-panic", device::panics),
    row("device-sigkill", device::killed),
    row("device-sigstop", device::stopped),
    over_link("link-cut", link::cut),
    over_link("link-cut-shortly", link::cut_shortly),
    over_link("link-killed", link::tunnel_killed),
    over_link("link-station-restarted", link::station_restarted),
    over_link("link-packets-changed", link::packets_changed),
];

/// The cases of a broken link that a user meets: the cable cut for 10 s, the processes at its ends
/// killed, the station restarted, packets changed and sent once more.
const OF_LINK: [&str; 4] = [
    "link-cut",
    "link-killed",
    "link-station-restarted",
    "link-packets-changed",
];

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 for a name that is no case, 1 when a case fails.
pub fn faults(args: &FaultsArgs) -> Result<(), Failure> {
    check(args)?;
    let stop = stop_flag()?;
    let found = run(args, &stop, &undisturbed)?;
    if args.json {
        print_json(&found)?;
    } else {
        print(&words(&found))?;
    }
    judge(&found)
}

/// Runs the cases of a broken link alone, with so many kills.
///
/// # Errors
/// One sentence when they cannot be begun, or are ended early.
pub fn of_link(kills: u64, stop: &AtomicBool) -> Result<Faults, Failure> {
    let args = FaultsArgs {
        kills,
        cases: OF_LINK.map(String::from).to_vec(),
        hostile_faces: MIN_HOSTILE_FACES,
        step_clock: false,
        json: false,
    };
    // These have an undisturbed run of their own.
    let found = run(&args, stop, &|_| Ok(Undisturbed::default()))?;
    if found.failed.is_empty() {
        return Ok(found);
    }
    Err(Failure::Run(found.failed.join("; ")))
}

/// Runs the chosen cases; an early end is said beside those that had come to a verdict.
fn run(
    args: &FaultsArgs,
    stop: &AtomicBool,
    undisturbed: &dyn Fn(&Bench) -> Result<Undisturbed, String>,
) -> Result<Faults, Failure> {
    let bar = status_line();
    let slots = usize::try_from(args.kills).map_or(MAX_SLOTS, |kills| kills.min(MAX_SLOTS));
    let bench = Bench::new(slots, args.hostile_faces, stop, bar)?;
    let mut verdicts = Verdicts::default();
    verdicts.undisturbed = undisturbed(&bench).map_err(Failure::Run)?;
    verdicts.faults.force_step_undisturbed_n = verdicts.undisturbed.step_n;
    verdicts.faults.undisturbed_fronts_differ = verdicts.undisturbed.fronts_differ;
    let ended = each(
        ROWS.iter().filter(|row| is_chosen(args, row.name)),
        stop,
        &mut verdicts,
        &mut |row, verdicts| {
            bench.bar.set_message(row.name);
            (row.needs)(args).map(|()| (row.run)(&bench, args.kills, verdicts))
        },
    );
    bench.bar.finish_and_clear();
    let mut found = verdicts.finish();
    found.failed = beside_measured(ended, found.cases.is_empty())?;
    Ok(found)
}

/// A case's answer, or why it cannot be run here.
type Answered<'a> = dyn FnMut(&Row, &mut Verdicts) -> Result<Answer, String> + 'a;

/// Runs cases, one behind the other.
///
/// # Errors
/// On an early end. The case that it cut short has no verdict; those before it have theirs.
fn each<'a>(
    rows: impl Iterator<Item = &'a Row>,
    stop: &AtomicBool,
    verdicts: &mut Verdicts,
    answered: &mut Answered<'_>,
) -> Result<(), Failure> {
    for row in rows {
        let answer = answered(row, verdicts);
        if is_set(stop) {
            return Err(Failure::Run("ended early on request".to_string()));
        }
        match answer {
            Ok(answer) => verdicts.add(row.name, answer),
            Err(why) => verdicts.skip(row.name, &why),
        }
    }
    Ok(())
}

fn check(args: &FaultsArgs) -> Result<(), Failure> {
    if !(1..=MAX_KILLS).contains(&args.kills) {
        let kills = args.kills;
        return Err(Failure::Input(format!(
            "--kills is {kills}; write a number from 1 to {MAX_KILLS}"
        )));
    }
    if !(MIN_HOSTILE_FACES..=MAX_HOSTILE_FACES).contains(&args.hostile_faces) {
        return Err(Failure::Input(format!(
            "--hostile-faces is {}; write a number from {MIN_HOSTILE_FACES} to {MAX_HOSTILE_FACES}",
            args.hostile_faces
        )));
    }
    let known = |name: &&String| ROWS.iter().any(|row| row.name == name.as_str());
    if let Some(unknown) = args.cases.iter().find(|name| !known(name)) {
        let names: Vec<&str> = ROWS.iter().map(|row| row.name).collect();
        return Err(Failure::Input(format!(
            "\"{unknown}\" is no case; choose of {}",
            names.join(", ")
        )));
    }
    Ok(())
}

fn is_chosen(args: &FaultsArgs, name: &str) -> bool {
    args.cases.is_empty() || args.cases.iter().any(|chosen| chosen == name)
}

/// Runs without a disturbance.
fn undisturbed(bench: &Bench) -> Result<Undisturbed, String> {
    let mut steps = Vec::new();
    let mut fronts = Vec::new();
    let mut missed_own_cpu = 0;
    for run in 1..=UNDISTURBED {
        bench
            .bar
            .set_message(format!("undisturbed, {run} of {UNDISTURBED}"));
        let touched = Touch::usual(bench)?.finish()?;
        let result = &touched.finished.result;
        steps.push(result.force_step_per_period_n_max);
        fronts.push(result.front_hash);
        missed_own_cpu = result.missed_own_cpu.max(missed_own_cpu);
    }
    let front = the_one(&fronts);
    Ok(Undisturbed {
        step_n: median(&steps),
        front,
        fronts_differ: front.is_none(),
        missed_own_cpu,
        resync_ms: RESYNC_MS,
    })
}

/// The front that all runs ended with.
fn the_one(fronts: &[u64]) -> Option<u64> {
    let (&first, others) = fronts.split_first()?;
    others.iter().all(|&front| front == first).then_some(first)
}

fn words(found: &Faults) -> String {
    let mut table = Table::new(5, "case | verdict | own misses | undisturbed | seen");
    for case in &found.cases {
        let verdict = match (case.skipped, case.pass) {
            (true, _) => "skipped",
            (_, true) => "pass",
            (_, false) => "FAIL",
        };
        let [own, undisturbed] = [case.missed_own_cpu, case.missed_own_cpu_undisturbed];
        table.row([
            case.name.to_string(),
            verdict.to_string(),
            own.to_string(),
            undisturbed.to_string(),
            case.what.clone(),
        ]);
    }
    let mut text = format!("{table}\n");
    let _ = writeln!(
        text,
        "killed      station {} times, controller {} times",
        found.kills.station, found.kills.controller
    );
    let steps = match found.cases.iter().map(|case| case.runs).sum::<u64>() {
        0 => "none in a disturbed run".to_string(),
        _ => format!(
            "{:.2} N a period at most, undisturbed {:.2}; {:.2} N between two ticks, late ones too",
            found.force_step_per_period_n_max,
            found.force_step_undisturbed_n,
            found.force_step_n_max
        ),
    };
    let _ = writeln!(text, "force step  {steps}");
    let spread = |of: &Times| format!("p50 {:.1}, p99 {:.1}, max {:.1} ms", of.p50, of.p99, of.max);
    let resync = match found.resync_ms.count {
        0 => "none".to_string(),
        _ => spread(&found.resync_ms),
    };
    let _ = writeln!(text, "resync      {resync}");
    let device = match found.device_late_ms.count {
        0 => "none".to_string(),
        _ => format!(
            "zero {} after its wrench ceased to be valid; {} after the fault",
            spread(&found.device_late_ms),
            spread(&found.device_zero_ms)
        ),
    };
    let _ = writeln!(text, "device      {device}");
    let fronts = match (found.fronts_compared, found.fronts_equal) {
        (0, _) => "nothing was compared with a fresh start's front",
        (_, true) => "fronts equal to a fresh start's",
        (_, false) => "fronts NOT equal to a fresh start's",
    };
    for sentence in &found.failed {
        let _ = writeln!(text, "at the end  {sentence}");
    }
    if found.undisturbed_fronts_differ {
        let _ = writeln!(text, "undisturbed {FRONTS_DIFFER}");
    }
    let _ = writeln!(
        text,
        "at the end  {fronts}; {} own misses; {} files left",
        found.missed_own_cpu, found.leaked
    );
    text
}

/// Passes where some cases ran and none failed; what was not compared fails nothing.
fn judge(found: &Faults) -> Result<(), Failure> {
    let named = |case: &Case| format!("{} ({})", case.name, case.what);
    let skipped = found.cases.iter().filter(|case| case.skipped);
    let skipped: Vec<String> = skipped.map(named).collect();
    if found.failed.is_empty() && skipped.len() == found.cases.len() {
        let skipped = skipped.join(", ");
        return Err(Failure::Run(format!(
            "no case could be run here: {skipped}"
        )));
    }
    let failed = found
        .cases
        .iter()
        .filter(|case| !case.pass && !case.skipped);
    let failed: Vec<String> = failed.map(named).collect();
    let mut wrong = found.failed.clone();
    if !failed.is_empty() {
        let differ = found.undisturbed_fronts_differ;
        wrong.extend(differ.then(|| FRONTS_DIFFER.to_string()));
        wrong.push(format!("failed: {}", failed.join(", ")));
    }
    if wrong.is_empty() {
        return Ok(());
    }
    Err(Failure::Run(wrong.join("; ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::Ordering;

    fn found(cases: &[(bool, bool)]) -> Faults {
        let case = |&(pass, skipped): &(bool, bool)| Case {
            name: "no-rights",
            pass,
            skipped,
            missed_own_cpu: 0,
            missed_own_cpu_undisturbed: 0,
            runs: 0,
            what: "seen".to_string(),
        };
        Faults {
            cases: cases.iter().map(case).collect(),
            ..Faults::default()
        }
    }

    #[test]
    fn what_was_not_run_is_no_success_and_what_was_not_compared_is_no_failure() {
        let (pass, fail, skipped) = ((true, false), (false, false), (false, true));
        assert_eq!(judge(&found(&[pass, skipped])), Ok(()));
        for (cases, words) in [
            ([skipped, skipped], "no case could be run here"),
            ([fail, skipped], "failed: no-rights (seen)"),
        ] {
            let error = judge(&found(&cases)).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn an_early_end_is_said_beside_the_cases_before_it() {
        let stop = AtomicBool::new(false);
        let ends_in = |number: usize| {
            stop.store(false, Ordering::Relaxed);
            let mut verdicts = Verdicts::default();
            let mut done = 0;
            let ended = each(ROWS.iter(), &stop, &mut verdicts, &mut |_, _| {
                done += 1;
                stop.store(done == number, Ordering::Relaxed);
                // What a run that was cut short looks like says nothing.
                Ok(Ok("good".to_string()))
            });
            (verdicts.finish(), ended)
        };
        let (mut of, ended) = ends_in(3);
        let names: Vec<&str> = of.cases.iter().map(|case| case.name).collect();
        assert_eq!(names, [ROWS[0].name, ROWS[1].name]);
        of.failed = beside_measured(ended, of.cases.is_empty()).expect("two cases are there");
        assert!(
            words(&of).contains("ended early on request"),
            "{}",
            words(&of)
        );
        let said = judge(&of).expect_err("it is no whole").to_string();
        assert_eq!(said, "ended early on request");
        let (of, ended) = ends_in(1);
        assert!(of.cases.is_empty() && ended.is_err());
        let (of, ended) = ends_in(ROWS.len() + 1);
        assert_eq!((of.cases.len(), ended), (ROWS.len(), Ok(())));
    }

    #[test]
    fn different_fronts_of_undisturbed_runs_are_said_once_and_by_that_name() {
        assert_eq!(the_one(&[7, 7, 7]), Some(7));
        assert_eq!((the_one(&[7, 7, 8]), the_one(&[])), (None, None));
        let (fail, pass) = ((false, false), (true, false));
        let mut of = found(&[fail, fail]);
        assert!(!words(&of).contains(FRONTS_DIFFER));
        of.undisturbed_fronts_differ = true;
        assert_eq!(words(&of).matches(FRONTS_DIFFER).count(), 1);
        let said = judge(&of).expect_err("cases failed").to_string();
        assert!(said.starts_with(FRONTS_DIFFER), "{said}");
        assert_eq!(said.matches("different fronts").count(), 1);
        // Over a link each case has a run of its own to be compared with.
        of.cases = found(&[pass]).cases;
        assert_eq!(judge(&of), Ok(()));
    }

    #[test]
    fn words_claim_nothing_of_what_was_not_measured() {
        let mut of = found(&[(true, false)]);
        let text = words(&of);
        for line in [
            "resync      none",
            "device      none",
            "nothing was compared",
        ] {
            assert!(text.contains(line), "{text}");
        }
        (of.fronts_compared, of.fronts_equal) = (1, true);
        of.resync_ms = Times::of(&[800.0]);
        let text = words(&of);
        assert!(text.contains("fronts equal"), "{text}");
        assert!(text.contains("max 800.0 ms"), "{text}");
        of.fronts_equal = false;
        assert!(words(&of).contains("fronts NOT equal"));
    }
}
