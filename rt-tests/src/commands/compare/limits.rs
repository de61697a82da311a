//! What ours may take of what others take, on every model and size alike.

use super::closest::{COLD, MEMORY, PATH};
use super::row::{Row, Who};
use super::tools;

/// The most that ours may take of the quickest of some ways of a library, at the median and at the
/// 99th of 100.
struct Limit {
    task: &'static str,
    ours: Who,
    /// Ways of one library: a task and who.
    theirs: &'static [(&'static str, Who)],
    most: f64,
}

/// Every limit. Like with like: those without memory of the last answer beside each other, those
/// with it beside each other; whose memory helps nothing is taken without.
const LIMITS: [Limit; 12] = [
    limit(PATH, Who::OursFull, &[(PATH, Who::ParryF32)], 0.65),
    limit(PATH, Who::OursFull, &[(PATH, Who::Embree)], 0.8),
    limit(MEMORY, Who::OursFull, &[(MEMORY, Who::Embree)], 0.9),
    limit(
        MEMORY,
        Who::OursLocal,
        &[(PATH, Who::ParryF32), (MEMORY, Who::ParryF32)],
        0.55,
    ),
    limit(
        MEMORY,
        Who::OursLocal,
        &[(PATH, Who::Embree), (MEMORY, Who::Embree)],
        0.7,
    ),
    limit(COLD, Who::OursLocal, &[(COLD, Who::ParryF32)], 0.55),
    limit(COLD, Who::OursLocal, &[(COLD, Who::Embree)], 0.7),
    limit(
        tools::TOOLS[0].0,
        Who::OursLocal,
        &[
            (tools::TOOLS[0].0, Who::ParryF64),
            (tools::TOOLS[0].0, Who::ParryF64Moved),
        ],
        0.22,
    ),
    limit(
        tools::TOOLS[1].0,
        Who::OursLocal,
        &[
            (tools::TOOLS[1].0, Who::ParryF64),
            (tools::TOOLS[1].0, Who::ParryF64Moved),
        ],
        0.22,
    ),
    limit(
        tools::TOOLS[0].0,
        Who::OursLocal,
        &[
            (tools::TOOLS[0].0, Who::Fcl),
            (tools::TOOLS[0].0, Who::FclMoved),
        ],
        0.25,
    ),
    limit(
        tools::TOOLS[1].0,
        Who::OursLocal,
        &[
            (tools::TOOLS[1].0, Who::Fcl),
            (tools::TOOLS[1].0, Who::FclMoved),
        ],
        0.25,
    ),
    limit(
        "update64",
        Who::OursFull,
        &[("update64", Who::ParryF32)],
        0.4,
    ),
];

const fn limit(
    task: &'static str,
    ours: Who,
    theirs: &'static [(&'static str, Who)],
    most: f64,
) -> Limit {
    Limit {
        task,
        ours,
        theirs,
        most,
    }
}

/// Wrong answers of ours, in words; those of others are in the table.
pub fn wrong(rows: &[Row]) -> Vec<String> {
    let ours = [Who::OursLocal, Who::OursFull];
    let wrong = rows
        .iter()
        .filter(|row| row.answers_differ > 0 && ours.contains(&row.who));
    wrong
        .map(|row| {
            format!(
                "{}, {}: {} of {} answers differ",
                row.model,
                row.task,
                row.who.words(),
                row.answers_differ
            )
        })
        .collect()
}

/// Wrong answers, and what is beyond its limit, in words; the rows are those of one model. A
/// library that was not asked sets no limit.
pub fn broken(rows: &[Row]) -> Vec<String> {
    let mut broken = wrong(rows);
    for limit in &LIMITS {
        for (what, of) in [
            ("median", (|row| row.p50_ns) as fn(&Row) -> f64),
            ("99th of 100", |row| row.p99_ns),
        ] {
            broken.extend(limit.broken(rows, what, of));
        }
    }
    broken
}

/// Libraries beside which ours has a limit, and which were not asked: those limits are not checked.
pub fn not_asked<'a>(rows: impl Iterator<Item = &'a Row> + Clone) -> Vec<&'static str> {
    let is_there =
        |task: &str, who: Who| rows.clone().any(|row| row.task == task && row.who == who);
    let mut libraries = Vec::new();
    for limit in &LIMITS {
        let library = limit.theirs[0].1.words();
        let is_asked = limit.theirs.iter().any(|&(task, who)| is_there(task, who));
        let is_unchecked = is_there(limit.task, limit.ours) && !is_asked;
        if is_unchecked && !libraries.contains(&library) {
            libraries.push(library);
        }
    }
    libraries
}

impl Limit {
    fn broken(&self, rows: &[Row], what: &str, of: fn(&Row) -> f64) -> Option<String> {
        let row = |task: &str, who: Who| rows.iter().find(|row| row.task == task && row.who == who);
        let ours = row(self.task, self.ours)?;
        let ways = self.theirs.iter().filter_map(|&(task, who)| row(task, who));
        let best = ways.min_by(|a, b| of(a).total_cmp(&of(b)))?;
        // What is no number keeps no limit.
        let is_kept = of(ours) <= self.most * of(best);
        (!is_kept).then(|| {
            format!(
                "{}, {}: the {what} of {} is {:.2} of that of {} ({}), at most {} is allowed",
                ours.model,
                self.task,
                self.ours.words(),
                of(ours) / of(best),
                best.who.words(),
                best.task,
                self.most
            )
        })
    }
}
