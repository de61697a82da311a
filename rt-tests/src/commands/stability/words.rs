//! The tables of the terminal about other libraries' proxies.

use super::step_times::HEADS;
use super::{PeerVerdict, Stability, number};
use crate::report::table::Table;
use std::fmt::Write as _;

/// Cases with a peer beside ours, and times of a step; empty without peers.
pub(super) fn peers(found: &Stability) -> String {
    let asked = || found.cases.iter().filter(|case| !case.peers.is_empty());
    let mut text = String::new();
    if let Some(first) = asked().next() {
        let names = first.peers.iter().map(|peer| peer.who.as_str());
        let names: Vec<&str> = names.collect();
        let mut table = Table::new(1, &format!("case | limit | ours | {}", names.join(" | ")));
        for case in asked() {
            let ours = shown(case.value, case.word());
            let theirs = case.peers.iter();
            let theirs =
                theirs.map(|peer| shown(peer.value, if peer.pass { "pass" } else { "FAIL" }));
            let cells = [case.name.to_string(), number(case.limit), ours];
            table.row(cells.into_iter().chain(theirs));
        }
        let all = asked().count();
        let _ = write!(text, "\nthe same measure with another proxy\n\n{table}\n");
        let ours = asked().filter(|case| case.pass).count();
        let _ = write!(text, "of {all} asked pass: ours {ours}");
        for (k, name) in names.iter().enumerate() {
            let passes = |peers: &[PeerVerdict]| peers.get(k).is_some_and(|peer| peer.pass);
            let pass = asked().filter(|case| passes(&case.peers)).count();
            let _ = write!(text, ", {name} {pass}");
        }
        text += "\n";
    }
    for case in asked() {
        for peer in case.peers.iter().filter(|peer| !peer.note.is_empty()) {
            let _ = writeln!(text, "{}, {}: {}", case.name, peer.who, peer.note);
        }
    }
    if !found.step_times.is_empty() {
        let mut table = Table::new(3, HEADS);
        for of in &found.step_times {
            table.row(of.cells());
        }
        let _ = write!(text, "\ntime of a step in contact\n\n{table}");
    }
    text
}

fn shown(value: f64, verdict: &str) -> String {
    format!("{} {verdict}", number(value))
}
