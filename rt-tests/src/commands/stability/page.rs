//! The page: every case with its measure, limit and verdict, another library's proxy beside ours,
//! and its parameters beside those of the facts.

use super::step_times::{HEADS, StepTimes};
use super::{MutantFound, PeerVerdict, Stability, Verdict};
use crate::cases::{Case, ProbeOfCase, all};
use crate::report::html::{self, escaped};
use crate::report::table::Table;
use crate::report::units::grouped;
use std::fmt::Write as _;

/// Columns of text that wraps, and a page wide enough for them.
const STYLE: &str = "<style>
body{max-width:1180px}
.cases td,.cases th{text-align:left;vertical-align:top;padding:.3em .6em}
.cases td.n{text-align:right;white-space:nowrap}
.cases small{opacity:.75;display:block;line-height:1.35}
.cases td:first-child{white-space:nowrap}
.steps td:nth-child(3),.steps th:nth-child(3){text-align:left}
.ok{color:#1a7f37}.open{color:#9a6700;font-weight:bold}
@media (prefers-color-scheme:dark){.ok{color:#4ac26b}.open{color:#d4a72c}}
</style>
";

/// A case and what is known of it.
struct Row<'a> {
    case: &'static Case,
    verdict: Option<&'a Verdict>,
    mutant: Option<&'a MutantFound>,
}

/// The page.
#[must_use]
pub(super) fn page(found: &Stability) -> String {
    let row = |case: &'static Case| Row {
        case,
        verdict: found.cases.iter().find(|of| of.name == case.name),
        mutant: found.mutants.iter().find(|of| of.case == case.name),
    };
    let rows = all().map(row);
    let rows: Vec<Row<'_>> = rows
        .filter(|row| row.verdict.is_some() || row.mutant.is_some())
        .collect();
    let peers = peers(found);
    let mut body = String::from(STYLE);
    let _ = writeln!(body, "<p>{}</p>", escaped(&summary(found)));
    for sentence in peers_summary(found, &peers) {
        let _ = writeln!(body, "<p>{}</p>", escaped(&sentence));
    }
    body += "<h2>Cases</h2>\n";
    body += "<p>∞ stands where what must happen did not, such as a force in a contact, or where \
             something was no number. The mutant of a case is the fault in the product's code under \
             which it must fail (<code>--mutants</code>): by its measure, or by such a premise \
             alone.</p>\n";
    cases(&mut body, &rows, &peers);
    open(&mut body, found);
    steps(&mut body, &found.step_times);
    body += "<h2>Parameters beside the facts</h2>\n";
    body += "<p>The facts are the hard cases of haptic rendering as the field's literature and \
             systems name them, by number; without one a case is this project's own. What stands \
             under \"here\" is of the full run (<code>--full</code>); the quick one has fewer \
             passes.</p>\n";
    parameters(&mut body, &rows);
    logged(&mut body, found);
    html::page("Hard cases", &body)
}

/// Names of the peers' variants.
fn peers(found: &Stability) -> Vec<String> {
    let asked = found.cases.iter().find(|case| !case.peers.is_empty());
    let peers = asked.into_iter().flat_map(|case| &case.peers);
    peers.map(|peer| peer.who.clone()).collect()
}

fn summary(found: &Stability) -> String {
    let set = if found.full { "full" } else { "quick" };
    let run = format!(
        "the {set} set at {} Hz{}",
        found.rate_hz,
        found.departures()
    );
    let seed = found.seed;
    if !found.mutants.is_empty() {
        let closed = found.mutants.iter().filter(|of| of.open.is_empty());
        let killed = closed.clone().filter(|of| of.killed);
        let premise = killed.clone().filter(|of| of.by_premise).count();
        let (all, killed) = (closed.count(), killed.count());
        let open = found.mutants.len() - all;
        return format!(
            "{killed} of {all} cases find the fault that was put into the product for them, {premise} of these by what must happen alone; {open} are open and not run: {run}, seed {seed}."
        );
    }
    let cases = &found.cases;
    let pass = cases.iter().filter(|case| case.pass).count();
    let open = cases.iter().filter(|case| !case.pass && !case.fails());
    let (all, open) = (cases.len(), open.count());
    let beyond = all - pass - open;
    let but = if found.small_lossy {
        "but for these and "
    } else {
        "but "
    };
    format!(
        "{pass} of {all} cases keep to their limit, {open} are known not to (open), {beyond} are beyond it: {run}, seed {seed}. The real controller runs in virtual time on the product's defaults, {but}where a case says otherwise; the loop is closed by a simulated device of 0.1 kg and 1 N s/m."
    )
}

/// How many cases each peer passes, beside ours.
fn peers_summary(found: &Stability, peers: &[String]) -> Vec<String> {
    let asked = || found.cases.iter().filter(|case| !case.peers.is_empty());
    let all = asked().count();
    let Some(first) = peers.first() else {
        return Vec::new();
    };
    let ours = asked().filter(|case| case.pass).count();
    let mut text = format!(
        "Another library's proxy ran {all} of these cases in the place of ours: the same ball on the same full mesh, as our builder cleaned it, the same device and hand, the same places and the same measure and limit. Ours passes {ours} of them"
    );
    for who in peers {
        let of = |case: &&Verdict| case.peers.iter().any(|peer| peer.who == *who && peer.pass);
        let _ = write!(text, ", {who} {}", asked().filter(of).count());
    }
    text += " (a case with the energy account and the same without it are two). Its force is as its proxy gives it: no limit of force or slew, no energy account, as its tool has none.";
    let mut sentences = vec![text];
    if first == "chai3d" {
        sentences.push(
            "chai3d is CHAI3D's finger proxy as its constructor makes it, in metres: one constraint a tick. chai3d_dynamic solves all constraints in each tick, in units in which the ball is as large as the tools of most of its examples (0.01), so that its tolerances of 1e-4 are small beside it."
                .to_string(),
        );
    }
    sentences
}

fn cases(body: &mut String, rows: &[Row<'_>], peers: &[String]) {
    *body += "<div class=\"wide\"><table class=\"cases\"><tr><th>case<th>what is measured, the worst\
              <th>limit<th>ours<th>verdict";
    for who in peers {
        let _ = write!(body, "<th>{}", escaped(who));
    }
    *body += "<th>its mutant</tr>\n";
    for row in rows {
        let case = row.case;
        let number = match case.number {
            "" => "ours".to_string(),
            number => format!("case {number}"),
        };
        let probe = match case.probe {
            ProbeOfCase::Ball => "ball",
            ProbeOfCase::Tool => "tool",
            ProbeOfCase::None => "part of the product",
        };
        let _ = write!(
            body,
            "<tr><td>{}<small>{number}, {probe}</small><td>{}<td class=\"n\">{}",
            escaped(case.name),
            escaped(case.measure),
            number_of(case.limit)
        );
        *body += &ours(row.verdict);
        *body += &theirs(row, peers.len());
        let name = format!("{:?}", case.mutant);
        let found = row.mutant.map_or_else(String::new, mutant_verdict);
        let _ = writeln!(body, "<td>{}{found}</tr>", escaped(&name));
    }
    *body += "</table></div>\n";
}

/// What is told of a mutant, and why where it is no kill.
fn mutant_verdict(of: &MutantFound) -> String {
    let class = match (of.killed, of.open.is_empty()) {
        (true, _) => "ok",
        (false, true) => "bad",
        (false, false) => "open",
    };
    let verdict = format!("<small class=\"{class}\">{}</small>", of.word());
    match of.note.as_str() {
        "" => verdict,
        note => format!("{verdict}<small>{}</small>", escaped(note)),
    }
}

/// The cells of what was seen, and of the verdict.
fn ours(verdict: Option<&Verdict>) -> String {
    let Some(of) = verdict else {
        return "<td class=\"n\">not run<td>".to_string();
    };
    let verdict = match (of.pass, of.fails()) {
        (true, _) => "<span class=\"ok\">pass</span>",
        (false, true) => "<span class=\"bad\">beyond</span>",
        (false, false) => "<span class=\"open\">open</span>",
    };
    let passes = grouped(of.passes_run);
    let value = number_of(of.value);
    format!("<td class=\"n\">{value}<small>of {passes}</small><td>{verdict}")
}

/// The cells of the peers.
fn theirs(row: &Row<'_>, columns: usize) -> String {
    if columns == 0 {
        return String::new();
    }
    let Some(verdict) = row.verdict else {
        return format!("<td colspan=\"{columns}\">");
    };
    if verdict.peers.is_empty() {
        let why = escaped(verdict.no_equal);
        return format!(
            "<td colspan=\"{columns}\"><small>not asked: it has no equal of {why}</small>"
        );
    }
    verdict.peers.iter().map(their_cell).collect()
}

fn their_cell(peer: &PeerVerdict) -> String {
    let value = number_of(peer.value);
    let verdict = match (peer.broken, peer.pass) {
        (true, _) => "<small class=\"bad\">broke off</small>",
        (false, true) => "<small class=\"ok\">pass</small>",
        (false, false) => "<small class=\"bad\">beyond</small>",
    };
    let note = match peer.note.as_str() {
        "" => String::new(),
        note => format!("<small>{}</small>", escaped(note)),
    };
    format!("<td>{value}{verdict}{note}")
}

/// Why cases are known to fail, which of them do not, and what could not be run.
fn open(body: &mut String, found: &Stability) {
    let is_open = |case: &&Verdict| !case.open.is_empty() && !case.pass;
    let better = found
        .cases
        .iter()
        .filter(|case| case.is_better_than_known());
    let better = better.map(|case| format!("{} keeps to its limit in this run", case.name));
    let errors = found.cases.iter().filter(|case| !case.error.is_empty());
    let lines: Vec<String> = found
        .cases
        .iter()
        .filter(is_open)
        .map(|case| format!("{}: {}", case.name, case.open))
        .chain(better)
        .chain(errors.map(|case| format!("{}: {}", case.name, case.error)))
        .collect();
    if lines.is_empty() {
        return;
    }
    *body += "<h2>Open: what is known not to hold, and why</h2>\n<ul>\n";
    for line in lines {
        let _ = writeln!(body, "<li>{}</li>", escaped(&line));
    }
    *body += "</ul>\n";
}

fn steps(body: &mut String, times: &[StepTimes]) {
    if times.is_empty() {
        return;
    }
    *body += "<h2>Time of a step</h2>\n<p>The same ball of 1 mm over the same path of ten seconds, \
              0.15 m objects, every tick once, one contender after the other; the ticks in which \
              the full mesh is touched count. Ours is search, proxy and force with account and \
              limits; a whole tick adds refinement and boxes, which a proxy on a fixed mesh does not \
              have. Where the force differs by more than a tenth from that on the full mesh, by which \
              the path was made, a proxy lags or stands off: it has not done the same \
              work.</p>\n";
    let mut table = Table::new(3, HEADS);
    for of in times {
        table.row(of.cells());
    }
    let _ = write!(body, "<div class=\"steps\">{}</div>", table.html());
}

fn parameters(body: &mut String, rows: &[Row<'_>]) {
    *body += "<div class=\"wide\"><table class=\"cases\"><tr><th>case<th>the facts<th>here\
              <th>departs from the product's defaults</tr>\n";
    for row in rows {
        let case = row.case;
        let number = match case.number {
            "" => "ours",
            number => number,
        };
        let or = |text: &'static str, none: &'static str| if text.is_empty() { none } else { text };
        let _ = write!(
            body,
            "<tr><td>{}<small>{number}</small><td>{}<td>{}<td>",
            escaped(case.name),
            escaped(or(case.facts, "not among them")),
            escaped(or(case.runs, "as the facts"))
        );
        for (of, why) in case.departs {
            let _ = write!(
                body,
                "{}<small>{}</small>",
                escaped(of.setting()),
                escaped(why)
            );
        }
        *body += "</tr>\n";
    }
    *body += "</table></div>\n";
}

/// Numbers beside the measures.
fn logged(body: &mut String, found: &Stability) {
    let logged = found.cases.iter().filter(|case| !case.logged.is_empty());
    let mut table = Table::new(2, "case | logged beside its measure | largest");
    let mut any = false;
    for case in logged {
        for of in &case.logged {
            any = true;
            table.row([
                case.name.to_string(),
                of.name.to_string(),
                number_of(of.value),
            ]);
        }
    }
    if any {
        *body += "<h2>Logged, without a limit</h2>\n";
        *body += &table.html();
    }
}

/// A number as a person reads it.
fn number_of(x: f64) -> String {
    match x {
        f64::MAX => "∞".to_string(),
        x if x == x.trunc() && x.abs() < 1e6 => format!("{x}"),
        x if (1e-2..1e4).contains(&x.abs()) => format!("{x:.3}"),
        x => format!("{x:.1e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_with_mutants_has_the_parameters_and_tells_who_lives() {
        let found = |case, killed| MutantFound {
            name: "Sign".to_string(),
            case,
            killed,
            by_premise: false,
            judged: true,
            open: "",
            note: String::new(),
        };
        let page = page(&Stability {
            seed: 1,
            rate_hz: 500.0,
            small_lossy: false,
            full: false,
            cases: Vec::new(),
            step_times: Vec::new(),
            mutants: vec![found("rest", true), found("creep", false)],
        });
        for part in [
            "1 of 2 cases find",
            "the quick set at 500 Hz, seed 1",
            "LIVES",
            "killed",
            "not run",
            "1e-9 to 1e-6 m a tick",
        ] {
            assert!(page.contains(part), "{part}");
        }
        assert!(!page.contains("Time of a step") && !page.contains("slow-onset"));
    }

    #[test]
    fn numbers_are_short() {
        let numbers = [f64::MAX, 0.0, -3.0, 0.0123, 12_345.6, 1e-9, 1.000_000_001];
        let shown = numbers.map(number_of);
        assert_eq!(shown, ["∞", "0", "-3", "0.012", "1.2e4", "1.0e-9", "1.000"]);
    }
}
