//! What ours may take of what others take, on every model and size alike.

use super::closest::{COLD, MEMORY, PATH};
use super::row::{Row, Who};
use super::tools;
use crate::report::table::Table;
use serde::Serialize;

/// The most that ours may take of the quickest of some ways of a library, at the median and at the
/// 99th of 100.
struct Limit {
    task: &'static str,
    ours: Who,
    /// Ways of one library: a task and who.
    theirs: &'static [(&'static str, Who)],
    most: f64,
}

/// Ways of parry and of FCL to the pairs of a tool of so many faces.
const PARRY_240: &[(&str, Who)] = &[
    (tools::TOOLS[0].0, Who::ParryF64),
    (tools::TOOLS[0].0, Who::ParryF64Moved),
];
const PARRY_960: &[(&str, Who)] = &[
    (tools::TOOLS[1].0, Who::ParryF64),
    (tools::TOOLS[1].0, Who::ParryF64Moved),
];
const FCL_240: &[(&str, Who)] = &[
    (tools::TOOLS[0].0, Who::Fcl),
    (tools::TOOLS[0].0, Who::FclMoved),
];
const FCL_960: &[(&str, Who)] = &[
    (tools::TOOLS[1].0, Who::Fcl),
    (tools::TOOLS[1].0, Who::FclMoved),
];

/// Every limit. Like with like: those without memory of the last answer beside each other, those
/// with it beside each other; whose memory helps nothing is taken without. Pairs are limited on
/// both of our fronts: the full mesh is what the libraries have, the local front what a tick has.
const LIMITS: [Limit; 16] = [
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
    limit(tools::TOOLS[0].0, Who::OursLocal, PARRY_240, 0.22),
    limit(tools::TOOLS[1].0, Who::OursLocal, PARRY_960, 0.22),
    limit(tools::TOOLS[0].0, Who::OursFull, PARRY_240, 0.22),
    limit(tools::TOOLS[1].0, Who::OursFull, PARRY_960, 0.22),
    limit(tools::TOOLS[0].0, Who::OursLocal, FCL_240, 0.25),
    limit(tools::TOOLS[1].0, Who::OursLocal, FCL_960, 0.25),
    limit(tools::TOOLS[0].0, Who::OursFull, FCL_240, 0.25),
    limit(tools::TOOLS[1].0, Who::OursFull, FCL_960, 0.25),
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

/// A limit, and where ours is.
#[derive(Debug, Clone, Serialize)]
pub struct Judged {
    /// The model.
    pub model: String,
    /// Faces of the full mesh.
    pub faces: u32,
    /// The task of ours.
    pub task: &'static str,
    /// On which front ours answers.
    pub ours: Who,
    /// The library.
    pub beside: &'static str,
    /// The median of ours over that of the library's quickest way, by the median.
    pub share_p50: f64,
    /// The same of the 99th of 100.
    pub share_p99: f64,
    /// The most that either may be.
    pub most: f64,
    /// Whether both are.
    pub is_kept: bool,
}

/// Where ours is beside every limit; the rows are those of one model. A library that was not asked
/// sets no limit.
pub fn judged(rows: &[Row]) -> Vec<Judged> {
    let judged = LIMITS.iter().filter_map(|limit| limit.judged(rows));
    judged.collect()
}

/// The table of the terminal.
pub fn words(judged: &[Judged]) -> String {
    let heads = "limit on | model | who | beside | faces | p50 | p99 | at most | kept";
    let mut table = Table::new(4, heads);
    for of in judged {
        table.row([
            of.task.to_string(),
            of.model.clone(),
            of.ours.words().to_string(),
            of.beside.to_string(),
            of.faces.to_string(),
            format!("{:.2}", of.share_p50),
            format!("{:.2}", of.share_p99),
            of.most.to_string(),
            if of.is_kept { "yes" } else { "no" }.to_string(),
        ]);
    }
    format!("\n{table}")
}

/// Wrong answers, and what is beyond its limit, in words; the rows are those of one model.
pub fn broken(rows: &[Row]) -> Vec<String> {
    let mut broken = wrong(rows);
    for limit in &LIMITS {
        for (what, of) in QUANTILES {
            broken.extend(limit.broken(rows, what, of));
        }
    }
    broken
}

/// What is limited, and its name.
const QUANTILES: [(&str, Quantile); 2] = [
    ("median", |row| row.p50_ns),
    ("99th of 100", |row| row.p99_ns),
];

type Quantile = fn(&Row) -> f64;

/// Libraries beside which ours has a limit, and which were not asked: those limits are not checked.
pub fn not_asked<'a>(rows: impl Iterator<Item = &'a Row> + Clone) -> Vec<&'static str> {
    let is_there =
        |task: &str, who: Who| rows.clone().any(|row| row.task == task && row.who == who);
    let mut libraries = Vec::new();
    for limit in &LIMITS {
        let library = limit.theirs[0].1.library();
        let is_asked = limit.theirs.iter().any(|&(task, who)| is_there(task, who));
        let is_unchecked = is_there(limit.task, limit.ours) && !is_asked;
        if is_unchecked && !libraries.contains(&library) {
            libraries.push(library);
        }
    }
    libraries
}

impl Limit {
    /// Ours, and the library's quickest way by a quantile, if both were asked.
    fn pair<'a>(&self, rows: &'a [Row], of: Quantile) -> Option<[&'a Row; 2]> {
        let row = |task: &str, who: Who| rows.iter().find(|row| row.task == task && row.who == who);
        let ours = row(self.task, self.ours)?;
        let theirs = self.theirs.iter().filter_map(|&(task, who)| row(task, who));
        let best = theirs.min_by(|a, b| of(a).total_cmp(&of(b)))?;
        Some([ours, best])
    }

    /// What is no number keeps no limit.
    fn is_kept(&self, [ours, best]: [&Row; 2], of: Quantile) -> bool {
        of(ours) <= self.most * of(best)
    }

    fn judged(&self, rows: &[Row]) -> Option<Judged> {
        let [(_, p50), (_, p99)] = QUANTILES;
        let pairs = [(self.pair(rows, p50)?, p50), (self.pair(rows, p99)?, p99)];
        let [share_p50, share_p99] = pairs.map(|([ours, best], of)| of(ours) / of(best));
        let [([ours, best], _), _] = pairs;
        Some(Judged {
            model: ours.model.clone(),
            faces: ours.faces,
            task: self.task,
            ours: self.ours,
            beside: best.who.library(),
            share_p50,
            share_p99,
            most: self.most,
            is_kept: pairs.into_iter().all(|(pair, of)| self.is_kept(pair, of)),
        })
    }

    fn broken(&self, rows: &[Row], what: &str, of: Quantile) -> Option<String> {
        let pair = self.pair(rows, of)?;
        let [ours, best] = pair;
        (!self.is_kept(pair, of)).then(|| {
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
