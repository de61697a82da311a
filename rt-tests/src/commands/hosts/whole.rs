//! The result of the command, as JSON and in words.

use super::asked::Quantity;
use super::refused::{self, Refused};
use super::result::{Conditions, Found, Row, Scene};
use crate::commands::faults::{Case, Faults};
use crate::failure::Failure;
use crate::machine::Machine;
use crate::report::table::Table;
use crate::report::units::{digits, grouped};
use serde::Serialize;
use std::fmt::Write as _;
use std::path::Path;

/// The result.
#[derive(Debug, Default)]
pub struct Whole {
    /// Why nothing was run, and what helps.
    pub skipped: Option<String>,
    /// What is not in it, and why.
    pub left_out: Vec<String>,
    /// What failed beside the touches, and ended the command.
    pub failed: Vec<String>,
    /// What was found of each scene.
    pub parts: Vec<Found>,
    /// What was done to a link in contact; none where nothing was.
    pub cut: Option<Cut>,
    /// Who was refused; empty where nobody came.
    pub refused: Vec<Refused>,
}

/// Links that were cut for 10 s in contact, whose processes were killed, whose station was
/// restarted, whose packets were changed.
#[derive(Debug, Serialize)]
pub struct Cut {
    /// Largest time from the return of a link or a station until it was synchronised, milliseconds;
    /// none where none ever was.
    pub resync_ms: Option<f64>,
    /// Whether every touch ended, at rest, with the front of an undisturbed one.
    pub fronts_equal: bool,
    /// The cases of `rt-tests faults`.
    pub cases: Vec<Case>,
}

impl Cut {
    /// Of what the cases came to.
    #[must_use]
    pub fn of(faults: Faults) -> Self {
        let ran = faults.cases.iter().all(|case| case.runs > 0);
        Self {
            resync_ms: Some(faults.resync_ms.max).filter(|&ms| ms > 0.0),
            fronts_equal: faults.fronts_equal && ran && !faults.cases.is_empty(),
            cases: faults.cases,
        }
    }

    fn words(&self) -> String {
        let mut table = Table::new(3, "link in contact | | seen");
        for case in &self.cases {
            let verdict = if case.pass { "met" } else { "NOT MET" };
            let name = case.name.trim_start_matches("link-").replace('-', " ");
            table.row([name, verdict.to_string(), case.what.clone()]);
        }
        let ms = self.resync_ms.map_or("never".to_string(), |ms| {
            format!("after at most {} ms", digits(ms))
        });
        let equal = if self.fronts_equal { "" } else { "NOT " };
        format!("{table}synchronised {ms}; fronts at rest {equal}equal to a fresh start's\n")
    }
}

/// What is printed as JSON.
#[derive(Debug, Serialize)]
pub struct Json<'a> {
    skipped: Option<&'a str>,
    /// The hosts share its cores.
    machine: Machine,
    #[serde(flatten)]
    conditions: Conditions,
    left_out: &'a [String],
    /// Touches that came to no result, each with its links and the reason, and what ended the
    /// command.
    failed: Vec<&'a str>,
    scenes: Vec<&'a Scene>,
    rows: Vec<&'a Row>,
    cut: Option<&'a Cut>,
    refused: &'a [Refused],
}

impl Whole {
    /// Nothing was run.
    #[must_use]
    pub fn skipped(why: &str) -> Self {
        Self {
            skipped: Some(why.to_string()),
            ..Self::default()
        }
    }

    /// The same, ended by a failure, which is said beside what was measured.
    ///
    /// # Errors
    /// The failure where nothing was measured: it is all that there is to say.
    pub fn ended_by(mut self, failure: Failure) -> Result<Self, Failure> {
        if self.parts.is_empty() {
            return Err(failure);
        }
        self.failed.push(failure.to_string());
        Ok(self)
    }

    /// As JSON: the touches of all scenes in one list.
    #[must_use]
    pub fn json(&self) -> Json<'_> {
        let parts = &self.parts;
        let failed = parts.iter().flat_map(|part| &part.failed);
        Json {
            skipped: self.skipped.as_deref(),
            machine: Machine::read(),
            conditions: parts
                .first()
                .map_or_else(Conditions::default, |part| part.conditions),
            left_out: &self.left_out,
            failed: failed.chain(&self.failed).map(String::as_str).collect(),
            scenes: parts.iter().map(|part| &part.scene).collect(),
            rows: parts.iter().flat_map(|part| &part.rows).collect(),
            cut: self.cut.as_ref(),
            refused: &self.refused,
        }
    }

    /// What must not be, in words.
    #[must_use]
    pub fn wrong(&self) -> Vec<String> {
        let of = |part: &Found| {
            let named = |wrong: String| match &self.parts[..] {
                [_] => wrong,
                _ => format!("{}: {wrong}", part.scene.model),
            };
            part.wrong().into_iter().map(named).collect::<Vec<_>>()
        };
        let mut wrong: Vec<String> = self.parts.iter().flat_map(of).collect();
        let cases = self.cut.iter().flat_map(|cut| &cut.cases);
        let failed = cases.filter(|case| !case.pass);
        wrong.extend(failed.map(|case| format!("{}: {}", case.name, case.what)));
        if self.cut.as_ref().is_some_and(|cut| !cut.fronts_equal) {
            wrong.push("not all fronts at rest were a fresh start's".to_string());
        }
        let let_in = self.refused.iter().filter(|one| !one.named);
        wrong.extend(let_in.map(|one| {
            let (who, what) = (one.who.name(), &one.what);
            format!("{who}: not refused by name on both sides ({what})")
        }));
        wrong.extend(self.failed.iter().cloned());
        wrong
    }

    /// The result in words.
    #[must_use]
    pub fn words(&self, charts: &Path) -> String {
        let mut text = String::new();
        for sentence in &self.left_out {
            let _ = writeln!(text, "{sentence}");
        }
        for part in &self.parts {
            let _ = writeln!(text, "{}", part.words());
            text.push_str(&whole_sequence(part));
        }
        if let Some(cut) = &self.cut {
            let _ = writeln!(text, "{}", cut.words());
        }
        if !self.refused.is_empty() {
            let _ = writeln!(text, "{}", refused::table(&self.refused));
        }
        let _ = writeln!(text, "charts: {}", charts.display());
        text
    }
}

/// How long the whole sequence would take where the touch is asked for soon.
fn whole_sequence(part: &Found) -> String {
    let is_soon = |row: &&Row| {
        let mut asked = row.asked.iter();
        asked.any(|of| of.quantity == Quantity::ReadyMs)
    };
    let Some(row) = part.rows.iter().find(is_soon) else {
        return String::new();
    };
    let (Some(bytes), Some(least)) = (row.answer_bytes_per_vsp, row.sequence_s) else {
        return String::new();
    };
    let measured = row.sequence_measured_s.map_or(String::new(), |seconds| {
        format!(
            ", {} s at the rate that the controller measured",
            digits(seconds)
        )
    });
    format!(
        "{}: the whole sequence of {} records would take {} s at {} bytes for each{measured}\n",
        row.name(),
        grouped(part.scene.faces / 2),
        digits(least),
        digits(bytes),
    )
}

#[cfg(test)]
mod tests {
    use super::super::refused::Who;
    use super::super::result::Wire;
    use super::super::session::Ask;
    use super::*;
    use crate::links::points::Point;
    use hrtc::result::{Finished, RunResult};
    use serde_json::Value;

    /// A touch on one machine and one over a link, of a model.
    fn part(model: &str) -> Found {
        let row = || {
            let result = RunResult {
                model: model.to_string(),
                contact_ticks: 10,
                contact_full_ticks: 9,
                first_force_ready_ms: 50.0,
                first_full_ms: 7.0,
                vsps_received: 2,
                bytes_received: 64,
                ..RunResult::default()
            };
            Row::of(Finished {
                result,
                ..Finished::default()
            })
        };
        let mut found = Found::default();
        found.add(row(), Ask::Nothing);
        let point = Point::new(20.0, 10.0).losing(0.01);
        found.add(row().over(point, Wire::default()), Ask::Nothing);
        found
    }

    fn cut(fronts_equal: bool) -> Cut {
        let case = Case {
            name: "link-cut",
            pass: fronts_equal,
            skipped: false,
            missed_own_cpu: 0,
            missed_own_cpu_undisturbed: 0,
            runs: 1,
            what: "seen".to_string(),
        };
        let mut faults = Faults {
            fronts_equal,
            cases: vec![case],
            ..Faults::default()
        };
        faults.resync_ms.max = 800.0;
        Cut::of(faults)
    }

    fn one(who: Who, named: bool) -> Refused {
        let what = "said".to_string();
        Refused { who, named, what }
    }

    const ALL: [Who; 7] = [
        Who::ForeignCertificate,
        Who::NoCertificate,
        Who::Expired,
        Who::Version,
        Who::Endianness,
        Who::Replayed,
        Who::Damaged,
    ];

    fn json(whole: &Whole) -> Value {
        serde_json::to_value(whole.json()).unwrap()
    }

    #[test]
    fn every_touch_of_every_model_is_a_row_with_the_fields_of_the_contract() {
        let whole = Whole {
            parts: vec![part("a.spm"), part("b.spm")],
            ..Whole::default()
        };
        let json = json(&whole);
        let rows = json["rows"].as_array().unwrap();
        let models: Vec<&str> = rows
            .iter()
            .map(|row| row["model"].as_str().unwrap())
            .collect();
        assert_eq!(models, ["a.spm", "a.spm", "b.spm", "b.spm"]);
        for row in rows {
            for count in [
                "contact_ticks",
                "contact_full_ticks",
                "bytes_received",
                "missed_own_cpu",
            ] {
                assert!(row[count].is_u64(), "{count}: {row}");
            }
            for number in [
                "rtt_ms",
                "loss",
                "mbit",
                "first_force_ready_ms",
                "local_full_ms",
                "bytes_per_vsp",
                "force_step_n_max",
            ] {
                assert!(row[number].is_f64(), "{number}: {row}");
            }
        }
        let link = |row: &Value| ["rtt_ms", "loss", "mbit"].map(|name| row[name].as_f64().unwrap());
        assert_eq!(link(&rows[0]), [0.0; 3]);
        assert_eq!(link(&rows[1]), [20.0, 0.01, 10.0]);
        assert_eq!(
            (&rows[1]["first_force_ready_ms"], &rows[1]["local_full_ms"]),
            (&50.0.into(), &7.0.into())
        );
        assert!(json["cut"].is_null() && json["refused"] == Value::Array(Vec::new()));
        assert!(json["parts"].is_null() && json["scenes"].as_array().unwrap().len() == 2);
    }

    #[test]
    fn a_late_failure_is_said_beside_what_was_measured() {
        let failure = || Failure::Input("b.obj is no mesh".to_string());
        // All that there is to say, with its status.
        let none = Whole::default().ended_by(failure());
        assert_eq!(none.err(), Some(failure()));
        let whole = Whole {
            parts: vec![part("a.spm")],
            ..Whole::default()
        };
        let whole = whole.ended_by(failure()).unwrap();
        let json = json(&whole);
        assert_eq!(json["rows"].as_array().unwrap().len(), 2);
        assert_eq!(json["failed"], serde_json::json!(["b.obj is no mesh"]));
        assert_eq!(whole.wrong(), ["b.obj is no mesh"]);
    }

    #[test]
    fn cuts_and_refusals_are_named_as_in_the_contract() {
        let whole = Whole {
            cut: Some(cut(true)),
            refused: ALL.map(|who| one(who, true)).to_vec(),
            ..Whole::default()
        };
        let json = json(&whole);
        assert_eq!(json["cut"]["resync_ms"], 800.0);
        assert_eq!(json["cut"]["fronts_equal"], true);
        let refused = json["refused"].as_array().unwrap();
        let who: Vec<&str> = refused
            .iter()
            .map(|one| one["who"].as_str().unwrap())
            .collect();
        let expected = [
            "foreign_certificate",
            "no_certificate",
            "expired",
            "version",
            "endianness",
            "replayed",
            "damaged",
        ];
        assert_eq!(who, expected);
        assert!(refused.iter().all(|one| one["named"] == true));
        assert_eq!(whole.wrong(), Vec::<String>::new());
        let words = whole.words(Path::new("charts"));
        assert!(words.contains("after at most 800 ms") && words.contains("changed packets"));
    }

    #[test]
    fn a_failed_case_and_one_that_was_let_in_are_limits_that_were_not_met() {
        let whole = Whole {
            cut: Some(cut(false)),
            refused: vec![one(Who::Expired, false), one(Who::Version, true)],
            ..Whole::default()
        };
        let wrong = whole.wrong();
        assert_eq!(wrong.len(), 3, "{wrong:?}");
        assert!(wrong[2].contains("expired certificate"), "{wrong:?}");
        assert!(whole.words(Path::new("charts")).contains("NOT equal"));
        // Without a run there is no front to compare.
        let none = Cut::of(Faults {
            fronts_equal: true,
            ..Faults::default()
        });
        assert!(!none.fronts_equal && none.resync_ms.is_none());
    }
}
