//! What was seen of each touch, as JSON.

use super::asked::{Criterion, judge_as_alone};
use super::recorded::{Forces, Recorded, Rest};
use super::session::Ask;
use crate::links::points::Point;
use crate::links::way::Carried;
use crate::report::quantile::Quantiles;
use crate::report::units::percent_of;
use hrtc::result::{Finished, ShortSpread};
use hrtc::traffic::LinkBytes;
use serde::Serialize;
use std::fmt::Write as _;

/// What all touches of a command were made under.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Conditions {
    /// Length of a touch, seconds.
    pub seconds: f64,
    /// Seed of losses and jitter.
    pub seed: u64,
    /// Largest random part of a packet's time, milliseconds.
    pub jitter_ms: f64,
    /// Length of the cut in each touch over a link, seconds.
    pub cut_s: f64,
    /// Share of the packets that are changed.
    pub damaged: f64,
    /// Share of the packets that arrive twice.
    pub replayed: f64,
}

/// What was found of a scene.
#[derive(Debug, Default)]
pub struct Found {
    /// The scene.
    pub scene: Scene,
    /// Of all its touches.
    pub conditions: Conditions,
    /// What failed in touches, each with its links and the reason.
    pub failed: Vec<String>,
    /// The touches: the first on one machine, without a link.
    pub rows: Vec<Row>,
}

/// What came of a touch.
#[derive(Debug, Default)]
pub struct Touched {
    /// Its controllers that came to a result.
    pub rows: Vec<Row>,
    /// What failed beside them, a sentence each.
    pub failed: Vec<String>,
}

/// A touch.
#[derive(Debug, Serialize)]
pub struct Row {
    /// Model of the scene's first object.
    pub model: String,
    /// Round-trip time of the link, milliseconds, as asked for; 0 on one machine.
    pub rtt_ms: f64,
    /// Share of its packets that are lost, 0 to 1, likewise.
    pub loss: f64,
    /// Bandwidth of each direction, Mbit/s, likewise.
    pub mbit: f64,
    /// What was on it; none on one machine.
    pub wire: Option<Wire>,
    /// Controllers that touched at the same time.
    pub controllers: usize,
    /// Whether this one was stopped for the middle third of the touch.
    pub is_stopped: bool,
    /// Whether its hand rested for the second half of the touch.
    pub rests: bool,
    /// Times that its link was made; 0 on one machine.
    pub links_made: usize,
    /// Whether a chunk came through the link that had been changed on its way.
    pub has_damaged_chunk: bool,
    /// Ticks in contact.
    pub contact_ticks: u64,
    /// Of these, at full resolution.
    pub contact_full_ticks: u64,
    /// Their share, 0 to 1; none without a contact.
    pub full_share: Option<f64>,
    /// Ticks in contact without a certified bound.
    pub contact_unbounded_ticks: u64,
    /// Certified error at the contact, metres; none without a contact that has one.
    pub certified_error_m: Option<ShortSpread>,
    /// Measured error at the contact, metres; none without a measurement.
    pub measured_error_m: Option<ShortSpread>,
    /// Time from the start of the controller to the first tick that knew of the station,
    /// milliseconds; none without one. The station is ready before.
    pub heard_ms: Option<f64>,
    /// The same to the first tick that could render a contact.
    pub first_force_ready_ms: Option<f64>,
    /// The same to the first tick in contact: with the wait for the path of the simulated hand,
    /// which the station makes.
    pub first_touch_ms: Option<f64>,
    /// Time to local full resolution: from the first tick in contact to the first in contact at
    /// full resolution, milliseconds; none without one.
    pub local_full_ms: Option<f64>,
    /// Largest change of the force from a tick to the next, newtons.
    pub force_step_n_max: f64,
    /// The same over the periods between the two, newtons a period.
    pub force_step_per_period_n_max: f64,
    /// Forces beside those of the touch on one machine; none for that one.
    pub forces: Option<Forces>,
    /// The rest of the hand at the end, if that was asked for and is in contact.
    pub rest: Option<Rest>,
    /// What was asked of this link, and whether it was met; empty where nothing was.
    pub asked: Vec<Criterion>,
    /// Records received.
    pub vsps_received: u64,
    /// Bytes of the messages that brought them, as the controller counts them.
    pub bytes_received: u64,
    /// Bytes on the wire to the controller for each record received; on one machine, bytes of the
    /// messages.
    pub bytes_per_vsp: Option<f64>,
    /// Of these, bytes of closures and records for each record, as they travel; none without one.
    pub answer_bytes_per_vsp: Option<f64>,
    /// Bytes of messages by kind, as they travel.
    pub link_bytes: LinkBytes,
    /// Rate of the link where it was the limit, as the controller measured it, Mbit/s; none where
    /// it never was.
    pub link_mbit_per_s: Option<f64>,
    /// Least time that the whole sequence would take over the link, seconds: its records, each of
    /// as many bytes as those that came, with their closures, at the bandwidth. None on one
    /// machine.
    pub sequence_s: Option<f64>,
    /// The same at the measured rate; none without one.
    pub sequence_measured_s: Option<f64>,
    /// Regions asked for again.
    pub resent: u64,
    /// Times that the exchange with the station began anew.
    pub resubscribed: u64,
    /// Periods missed by own work or own waiting.
    pub missed_own_cpu: u64,
    /// Periods of which no record came: they are in no other figure.
    pub unaccounted_periods: i64,
    /// Faults at the end, and figures that are left out since a value was not finite.
    pub faults: Vec<String>,
    /// Of the whole command.
    #[serde(skip)]
    pub scene: Scene,
    /// What the controller recorded; only of the touch on one machine it is kept.
    #[serde(skip)]
    pub recorded: Recorded,
}

/// What every touch says of the scene.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Scene {
    /// Its name.
    pub scene: String,
    /// Model of its first object.
    pub model: String,
    /// Faces of all models.
    pub faces: u64,
    /// Bytes of all records.
    pub bytes_full_mesh: u64,
    /// Bytes of the controller's cache.
    pub cache_bytes: u64,
}

impl Scene {
    /// Records of its sequence: each split makes two faces.
    fn records(&self) -> u64 {
        self.faces / 2
    }
}

/// What was on a link from the start of the station to its end.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Wire {
    /// From the station to the controller.
    pub to_controller: Carried,
    /// Back.
    pub to_station: Carried,
    /// How long after its time the relay gave a packet on, ms: an error of the round trip. Of all
    /// links at once.
    pub late_ms: Quantiles,
}

impl Row {
    /// Of what a controller counted, without a link.
    #[must_use]
    pub fn of(finished: Finished) -> Self {
        let r = finished.result;
        let in_contact = r.contact_ticks > 0;
        let share = r.contact_full_ticks as f64 / r.contact_ticks as f64;
        let not_finite = r.non_finite.iter();
        let not_finite = not_finite.map(|name| format!("{name} was not finite"));
        Self {
            model: r.model.clone(),
            rtt_ms: 0.0,
            loss: 0.0,
            mbit: 0.0,
            wire: None,
            controllers: 1,
            is_stopped: false,
            rests: false,
            links_made: 0,
            has_damaged_chunk: false,
            contact_ticks: r.contact_ticks,
            contact_full_ticks: r.contact_full_ticks,
            full_share: in_contact.then_some(share),
            contact_unbounded_ticks: r.contact_unbounded_ticks,
            certified_error_m: (r.contact_ticks > r.contact_unbounded_ticks)
                .then_some(r.certified_error_m),
            measured_error_m: (r.measured_errors > 0).then_some(r.measured_error_m),
            heard_ms: above_zero(r.first_heard_ms),
            first_force_ready_ms: above_zero(r.first_force_ready_ms),
            first_touch_ms: above_zero(r.first_touch_ms),
            local_full_ms: Some(r.first_full_ms).filter(|&ms| ms >= 0.0),
            force_step_n_max: r.force_step_n_max,
            force_step_per_period_n_max: r.force_step_per_period_n_max,
            forces: None,
            rest: None,
            asked: Vec::new(),
            vsps_received: r.vsps_received,
            bytes_received: r.bytes_received,
            bytes_per_vsp: per(r.bytes_received, r.vsps_received),
            answer_bytes_per_vsp: per(r.link_bytes.answers, r.vsps_received),
            link_bytes: r.link_bytes,
            link_mbit_per_s: above_zero(r.link_mbit_per_s),
            sequence_s: None,
            sequence_measured_s: None,
            resent: r.resent,
            resubscribed: r.resubscribed,
            missed_own_cpu: r.missed_own_cpu,
            unaccounted_periods: r.unaccounted_periods,
            faults: r.faults.iter().cloned().chain(not_finite).collect(),
            recorded: Recorded::default(),
            scene: Scene {
                scene: r.scene,
                model: r.model,
                faces: r.faces,
                bytes_full_mesh: r.bytes_full_mesh,
                cache_bytes: r.cache.bytes,
            },
        }
    }

    /// The same, over a link.
    #[must_use]
    pub fn over(mut self, point: Point, wire: Wire) -> Self {
        (self.rtt_ms, self.loss, self.mbit) = (point.rtt_ms, point.loss, point.mbit);
        self.bytes_per_vsp = per(wire.to_controller.bytes, self.vsps_received);
        let records = self.scene.records() as f64;
        let sequence_mbit = self
            .answer_bytes_per_vsp
            .map(|bytes| 8e-6 * bytes * records);
        self.sequence_s = sequence_mbit.map(|mbit| mbit / point.mbit);
        let measured = sequence_mbit.zip(self.link_mbit_per_s);
        self.sequence_measured_s = measured.map(|(mbit, rate)| mbit / rate);
        self.wire = Some(wire);
        self
    }

    /// The link; none on one machine.
    #[must_use]
    pub fn point(&self) -> Option<Point> {
        let point = Point::new(self.rtt_ms, self.mbit).losing(self.loss);
        self.wire.map(|_| point)
    }

    /// Whether it was alone, and its hand did not rest.
    #[must_use]
    pub fn is_undisturbed(&self) -> bool {
        self.controllers == 1 && !self.rests
    }

    /// Its link and what else it was made under, in words.
    #[must_use]
    pub fn name(&self) -> String {
        let link = self.point().map_or_else(
            || "one machine".to_string(),
            |point| point.losing(0.0).to_string(),
        );
        link + &self.conditions()
    }

    /// What it was made under beside distance and bandwidth: words that follow others.
    #[must_use]
    pub fn conditions(&self) -> String {
        let mut words = String::new();
        if self.loss > 0.0 {
            let _ = write!(words, ", {} lost", percent_of(self.loss));
        }
        if self.rests {
            words.push_str(", resting");
        }
        if self.controllers > 1 {
            let _ = write!(words, ", one of {}", self.controllers);
        }
        if self.is_stopped {
            words.push_str(", stopped");
        }
        words
    }
}

fn per(bytes: u64, of: u64) -> Option<f64> {
    (of > 0).then(|| bytes as f64 / of as f64)
}

fn above_zero(number: f64) -> Option<f64> {
    Some(number).filter(|&number| number > 0.0)
}

impl Found {
    /// Adds all that came of a touch, with what is asked of it.
    pub fn take(&mut self, touched: Touched, ask: Ask) {
        self.failed.extend(touched.failed);
        for row in touched.rows {
            self.add(row, ask);
        }
    }

    /// Adds a touch, with what is asked of it; the first is the one on one machine.
    pub fn add(&mut self, mut row: Row, ask: Ask) {
        if let Some(local) = self.rows.first() {
            row.forces = Some(Forces::beside(&local.recorded, &row.recorded));
            row.recorded = Recorded::default();
            row.asked = match ask {
                Ask::Link(asked) => asked.judge(local, &row),
                Ask::AsAlone if !row.is_stopped => judge_as_alone(self.alone(&row), &row),
                _ => Vec::new(),
            };
        }
        self.scene = row.scene.clone();
        self.rows.push(row);
    }

    /// The touch alone over the link of another.
    fn alone(&self, row: &Row) -> Option<&Row> {
        let is_alone = |of: &&Row| of.is_undisturbed() && of.point() == row.point();
        self.rows.iter().find(is_alone)
    }

    /// What must not be, however long, slow or broken a link is; in words.
    #[must_use]
    pub fn wrong(&self) -> Vec<String> {
        let mut wrong = self.failed.clone();
        // Nothing is between the two of the first.
        if let Some(local) = self.rows.first().filter(|row| row.contact_ticks == 0) {
            let name = local.name();
            wrong.push(format!(
                "{name}: nothing was touched; give more with --seconds, or a scene whose probe has a trajectory"
            ));
        }
        for row in &self.rows {
            if row.unaccounted_periods != 0 {
                let (name, periods) = (row.name(), row.unaccounted_periods);
                wrong.push(format!(
                    "{name}: {periods} periods without a record: they are in no figure"
                ));
            }
            let unbounded = row.contact_unbounded_ticks;
            if unbounded > 0 {
                let name = row.name();
                wrong.push(format!(
                    "{name}: {unbounded} ticks in contact without a certified error"
                ));
            }
            if row.has_damaged_chunk {
                let name = row.name();
                wrong.push(format!("{name}: a changed packet passed the encryption"));
            }
        }
        let limits = || self.rows.iter().flat_map(|row| &row.asked);
        let not_met = limits().filter(|limit| !limit.met).count();
        if not_met > 0 {
            let of = limits().count();
            wrong.push(format!("{not_met} of {of} limits were not met"));
        }
        wrong
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrtc::result::RunResult;

    fn wire() -> Wire {
        let way = |bytes: u64, lost: u64| Carried {
            bytes,
            lost,
            ..Carried::default()
        };
        Wire {
            to_controller: way(400_000, 3),
            to_station: way(20_000, 1),
            late_ms: Quantiles::default(),
        }
    }

    const THIN: Point = Point::new(20.0, 0.25);

    fn result() -> RunResult {
        RunResult {
            contact_ticks: 1000,
            contact_full_ticks: 999,
            vsps_received: 4000,
            bytes_received: 320_000,
            first_heard_ms: 100.0,
            first_force_ready_ms: 150.0,
            first_touch_ms: 700.0,
            faces: 40_000,
            link_mbit_per_s: 0.5,
            link_bytes: LinkBytes {
                answers: 160_000,
                ..LinkBytes::default()
            },
            resubscribed: 7,
            ..RunResult::default()
        }
    }

    fn row(result: RunResult) -> Row {
        Row::of(Finished {
            result,
            ..Finished::default()
        })
    }

    #[test]
    fn a_touch_over_a_link_counts_the_bytes_on_its_wire() {
        let local = row(result());
        assert_eq!(local.bytes_per_vsp, Some(80.0));
        let (mut unbounded, is_bounded) = (result(), local.certified_error_m.is_some());
        unbounded.contact_unbounded_ticks = 1000;
        assert!(is_bounded && row(unbounded).certified_error_m.is_none());
        let far = row(result()).over(THIN, wire());
        assert_eq!(far.bytes_per_vsp, Some(100.0));
        assert_eq!(far.full_share, Some(0.999));
        assert_eq!(far.answer_bytes_per_vsp, Some(40.0));
        // 20 000 records of 40 bytes at 0.25 Mbit/s, and at the measured 0.5.
        let is_near =
            |seen: Option<f64>, expected: f64| (seen.unwrap() / expected - 1.0).abs() < 1e-12;
        assert!(is_near(far.sequence_s, 25.6) && is_near(far.sequence_measured_s, 12.8));
        assert_eq!(local.sequence_s, None);
        let mut found = Found::default();
        found.conditions.seconds = 10.0;
        found.add(local, Ask::Nothing);
        found.add(far, Ask::Nothing);
        let table = found.table().to_string();
        let far = table.lines().last().unwrap();
        let cells: Vec<&str> = far.split("  ").filter(|cell| !cell.is_empty()).collect();
        let cells: Vec<&str> = cells.iter().map(|cell| cell.trim()).collect();
        assert_eq!(cells[..2], ["20 ms, 0.25 Mbit/s", "99.90 %"], "{table}");
        assert_eq!(
            cells[4..],
            [
                "100",
                "150",
                "700",
                "0",
                "0.00",
                "40",
                "2",
                "4\u{202f}000",
                "100",
                "7",
                "0",
                "4",
                "0",
                "0"
            ]
        );
    }

    #[test]
    fn what_never_came_is_no_number() {
        let none = row(RunResult {
            first_full_ms: -1.0,
            ..RunResult::default()
        });
        let none = none.over(THIN, wire());
        let json = serde_json::to_value(&none).unwrap();
        for field in [
            "full_share",
            "certified_error_m",
            "heard_ms",
            "first_force_ready_ms",
            "first_touch_ms",
            "local_full_ms",
            "bytes_per_vsp",
        ] {
            assert!(json[field].is_null(), "{field}: {json}");
        }
        assert_eq!(json["wire"]["to_controller"]["bytes"], 400_000);
        let mut found = Found::default();
        found.add(none, Ask::Nothing);
        assert!(found.words().contains("none"), "{}", found.words());
    }

    #[test]
    fn figures_that_are_left_out_are_named() {
        let mut found = Found::default();
        found.add(
            row(RunResult {
                non_finite: vec!["force_n".to_string()],
                ..RunResult::default()
            }),
            Ask::Nothing,
        );
        assert!(
            found
                .words()
                .contains("one machine: force_n was not finite")
        );
    }

    #[test]
    fn one_of_several_controllers_is_named_as_such() {
        let mut row = row(result()).over(THIN, wire());
        assert_eq!(row.name(), "20 ms, 0.25 Mbit/s");
        (row.controllers, row.is_stopped) = (3, true);
        assert_eq!(row.name(), "20 ms, 0.25 Mbit/s, one of 3, stopped");
    }

    #[test]
    fn every_controller_among_others_is_judged_by_its_touch_alone() {
        let far = Point::new(100.0, 0.25);
        let mut found = Found::default();
        found.add(row(result()), Ask::Nothing);
        found.add(row(result()).over(THIN, wire()), Ask::Nothing);
        // The hand of this one rests, so its touch is another.
        let mut rests = row(result()).over(far, wire());
        rests.rests = true;
        found.add(rests, Ask::Nothing);
        for (point, is_stopped) in [(THIN, false), (far, false), (far, true)] {
            let mut among = row(result()).over(point, wire());
            (among.controllers, among.is_stopped) = (3, is_stopped);
            found.add(among, Ask::AsAlone);
        }
        let met = |row: &Row| row.asked.iter().map(|of| of.met).collect::<Vec<_>>();
        assert_eq!(met(&found.rows[3]), [true; 4]);
        // Without a touch alone nothing says that it is as it was there.
        assert_eq!(met(&found.rows[4]), [false, false, true, true]);
        assert_eq!(met(&found.rows[5]), [false; 0]);
        assert_eq!(found.wrong(), ["2 of 8 limits were not met"]);
    }

    #[test]
    fn what_failed_in_a_touch_is_named_beside_the_rows_that_came() {
        let mut found = Found::default();
        let touched = Touched {
            rows: vec![row(result())],
            failed: vec!["the station ended".to_string()],
        };
        found.take(touched, Ask::Nothing);
        assert_eq!(found.rows.len(), 1);
        assert_eq!(found.wrong(), ["the station ended"]);
    }

    #[test]
    fn a_touch_that_never_was_and_periods_without_a_record_are_wrong() {
        let never = || {
            row(RunResult {
                contact_ticks: 0,
                ..result()
            })
        };
        let mut found = Found::default();
        found.add(never(), Ask::Nothing);
        let wrong = found.wrong();
        assert!(wrong[0].starts_with("one machine: nothing"), "{wrong:?}");
        assert!(wrong[0].contains("--seconds"), "{wrong:?}");
        // A link may be too long or too thin for one.
        let mut found = Found::default();
        found.add(row(result()), Ask::Nothing);
        found.add(never().over(THIN, wire()), Ask::Nothing);
        assert_eq!(found.wrong(), Vec::<String>::new());
        found.rows[1].unaccounted_periods = -2;
        let wrong = found.wrong();
        assert_eq!(wrong.len(), 1);
        assert!(
            wrong[0].starts_with("20 ms, 0.25 Mbit/s: -2 periods"),
            "{wrong:?}"
        );
    }

    #[test]
    fn what_no_link_excuses_is_named() {
        let mut found = Found::default();
        found.add(row(result()).over(THIN, wire()), Ask::Nothing);
        assert_eq!(found.wrong(), Vec::<String>::new());
        found.rows[0].contact_unbounded_ticks = 3;
        found.rows[0].has_damaged_chunk = true;
        let wrong = found.wrong();
        assert_eq!(wrong.len(), 2);
        assert!(
            wrong[0].starts_with("20 ms, 0.25 Mbit/s: 3 ticks"),
            "{wrong:?}"
        );
        found.failed.push("at 1 ms: no result".to_string());
        assert_eq!(found.wrong()[0], "at 1 ms: no result");
    }
}
