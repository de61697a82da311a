//! What comes out, as it lies in the JSON. Numbers only; lengths in metres, times as named.

use crate::failure::{Failure, beside_measured};
use crate::report::quantile::Quantiles;
use hrtc::tick_record::STAGES;
use serde::Serialize;

/// The kind of refinement of a setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Knob {
    /// Finer near the contact, coarser with distance.
    #[default]
    Local,
    /// The same everywhere: the whole model at one tolerance.
    Global,
    /// The first splits of the sequence (the CDPM of thesis chapter 3).
    Prefix,
    /// Cells of the region grid along the longest side.
    Grid,
    /// Faces of the base mesh.
    BaseMesh,
    /// Bytes of the cache.
    Cache,
    /// Sources of the prediction.
    Predictor,
    /// Splits and collapses a millisecond.
    Operations,
    /// How many times slower than the reference machine the processor is.
    Processor,
    /// Ticks a second.
    Rate,
    /// Whether perceptible changes travel.
    Geomorph,
    /// One effect of the surface or the scene.
    Effect,
    /// Faces of a tool in place of the ball.
    ToolFaces,
    /// Steps of a tool in a tick: the iterations of its solver.
    Iterations,
    /// Distance at which the contacts of a tool act, as a fraction of its radius of gyration.
    ContactOffset,
    /// Bits of the numbers of a query.
    Precision,
}

impl Knob {
    /// Those beside the tolerance, in the order of the page.
    pub const OTHERS: [Self; 13] = [
        Self::Grid,
        Self::BaseMesh,
        Self::Cache,
        Self::Predictor,
        Self::Operations,
        Self::Processor,
        Self::Rate,
        Self::Geomorph,
        Self::Effect,
        Self::ToolFaces,
        Self::Iterations,
        Self::ContactOffset,
        Self::Precision,
    ];

    /// Whether the same touch is measured as with the other knobs, so that all can be compared.
    #[must_use]
    pub fn is_same_touch(self) -> bool {
        !matches!(
            self,
            Self::Rate
                | Self::Effect
                | Self::ToolFaces
                | Self::Iterations
                | Self::ContactOffset
                | Self::Precision
        )
    }

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Local => "local",
            Self::Global => "global",
            Self::Prefix => "prefix",
            Self::Grid => "grid",
            Self::BaseMesh => "base mesh",
            Self::Cache => "cache",
            Self::Predictor => "predictor",
            Self::Operations => "operations",
            Self::Processor => "processor",
            Self::Rate => "rate",
            Self::Geomorph => "geomorph",
            Self::Effect => "effect",
            Self::ToolFaces => "tool faces",
            Self::Iterations => "solver iterations",
            Self::ContactOffset => "contact offset",
            Self::Precision => "precision of queries",
        }
    }
}

/// The times of a stage, µs.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct StageQuantiles {
    /// The mean: those of the stages sum up to that of the tick.
    pub mean: f64,
    /// Half of the ticks take at most this.
    pub p50: f64,
    /// 99 of 100.
    pub p99: f64,
    /// 999 of 1000.
    pub p999: f64,
}

impl StageQuantiles {
    /// Of the mean and the quantiles.
    #[must_use]
    pub fn of(mean: f64, quantiles: &Quantiles) -> Self {
        Self {
            mean,
            p50: quantiles.p50,
            p99: quantiles.p99,
            p999: quantiles.p999,
        }
    }
}

/// The stages of a tick with one object.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct StageTimes {
    /// Inbox and prediction.
    pub inbox: StageQuantiles,
    /// Splits and collapses.
    pub refine: StageQuantiles,
    /// Boxes of the AB-tree.
    pub refit: StageQuantiles,
    /// Proxy and closest point.
    pub query: StageQuantiles,
    /// Force and its limiter.
    pub force: StageQuantiles,
    /// The broad phase: little, with one object.
    pub broad_phase: StageQuantiles,
}

impl StageTimes {
    /// With their names, in the order of a tick.
    #[must_use]
    pub fn named(&self) -> [(&'static str, StageQuantiles); STAGES.len()] {
        let [inbox, refine, refit, query, force, broad_phase] = STAGES;
        [
            (inbox, self.inbox),
            (refine, self.refine),
            (refit, self.refit),
            (query, self.query),
            (force, self.force),
            (broad_phase, self.broad_phase),
        ]
    }
}

/// How much faster the hand goes where the knobs beside the tolerance are measured a second time:
/// at the speed of the bundled scene most of them leave no error.
pub const FASTER: f64 = 4.0;

/// One setting of the refinement on one model.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Point {
    /// The model.
    pub model: String,
    /// Its place among those measured: two may have one name.
    #[serde(skip)]
    pub model_place: usize,
    /// What was turned.
    pub knob: Knob,
    /// The tolerance asked for, m, where 0 is the full mesh; for a prefix the count of splits; of
    /// another knob its number, or its place among those measured.
    pub value: f64,
    /// The value in a word or two; empty for a tolerance or a prefix.
    pub label: String,
    /// What a scene would write for it, or that there is no such key.
    pub setting: String,
    /// Speed of the hand, m/s.
    pub speed_m_per_s: f64,
    /// Whether this asks for the full mesh.
    #[serde(skip)]
    pub full_mesh: bool,
    /// Time of a tick in which the full mesh is touched, µs of processor time, the least of several
    /// replays.
    pub tick_us: Quantiles,
    /// Time of any tick of the trajectory, in the same way.
    pub all_tick_us: Quantiles,
    /// The stages of the ticks of `tick_us`.
    pub stage_us: StageTimes,
    /// The largest certified error at a contact, m.
    pub certified_m: f64,
    /// The median one.
    pub certified_p50_m: f64,
    /// The largest exact distance from a contact to the full mesh, m.
    pub true_m: f64,
    /// The median one.
    pub true_p50_m: f64,
    /// The largest error that the station measured and sent back, m; -1 when it sent none.
    pub measured_m: f64,
    /// The largest angle between this force and the full mesh's, degrees.
    pub normal_deg: f64,
    /// The median one.
    pub normal_p50_deg: f64,
    /// The largest difference from the full mesh's force, N.
    pub force_n: f64,
    /// The median one.
    pub force_p50_n: f64,
    /// Work of the difference from the full mesh's force over the device's path, J: what the error
    /// gives to the hand, or takes.
    pub energy_j: f64,
    /// Largest certified error over the largest true one of each centimetre of contact path,
    /// median; 0 where nothing is off by more than rounding.
    pub certified_over_true_p50: f64,
    /// That ratio of each centimetre.
    #[serde(skip)]
    pub certified_over_true: Vec<f64>,
    /// Bytes received from the start to the end of the trajectory, without the measured errors sent
    /// back.
    pub bytes: u64,
    /// Of these, until a touch could be answered.
    pub bytes_until_ready: u64,
    /// Of these, until the first contact at full resolution; 0 when there was none.
    pub bytes_until_full: u64,
    /// The most bytes of the cache ever in use, and the fixed rings and stack of a controller's
    /// process.
    pub rss_bytes: u64,
    /// Of these, in the cache.
    pub cache_bytes: u64,
    /// Records received.
    pub vsps_received: u64,
    /// Active faces in the ticks of a contact, median.
    pub faces_p50: f64,
    /// The most.
    pub faces_max: f64,
    /// Simulated time from the start until a touch could be answered, ms.
    pub ready_ms: f64,
    /// Simulated time from the start until the front was as asked for, with the device at rest, ms.
    pub settled_ms: f64,
    /// Ticks with a contact.
    pub contact_ticks: u64,
    /// Of these, at full resolution.
    pub contact_full_ticks: u64,
    /// Of these, without a certified bound.
    pub unbounded_ticks: u64,
    /// Of these, with a true error beyond the certified one.
    pub over_certified_ticks: u64,
    /// Ticks in which this setting and the full mesh both touch.
    pub common_ticks: u64,
    /// Ticks in which only one of them does.
    pub one_sided_ticks: u64,
    /// The largest distance between their contact points, m.
    pub contact_apart_m: f64,
    /// The largest difference between two ways to the exact distance, m.
    pub brute_apart_m: f64,
    /// Faces of the front within a tool's radius of the contact, median.
    pub tool_faces: f64,
    /// Time to find them, µs, median; taken while other settings are measured on other cores.
    pub tool_us: f64,
    /// Hash over every tick's outputs.
    pub replay_hash: u64,
}

impl Point {
    /// Nothing measured yet.
    #[must_use]
    pub fn new(model: &str, knob: Knob, value: f64) -> Self {
        Self {
            model: model.to_string(),
            knob,
            value,
            measured_m: -1.0,
            ..Self::default()
        }
    }
}

/// What must come over the link, on one model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Bytes {
    /// The model.
    pub model: String,
    /// Vertices of the full mesh.
    pub vertices: u64,
    /// Faces of the full mesh.
    pub faces: u64,
    /// Header and base mesh as sent: enough for the first touch.
    pub first_touch_bytes: u64,
    /// As sent until the first contact at full resolution; -1 when there was none.
    pub local_full_bytes: i64,
    /// As sent over the whole trajectory at full resolution.
    pub trajectory_bytes: u64,
    /// Header, base mesh and every record, without the chunks around them.
    pub records_bytes: u64,
    /// Positions (12 bytes) and triangles (12 bytes): the plain mesh.
    pub plain_bytes: u64,
}

/// Something that must hold.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Check {
    /// The model.
    pub model: String,
    /// What, in words.
    pub name: String,
    /// Whether it does.
    pub pass: bool,
    /// The worst that was found.
    pub worst: f64,
    /// What it may be at the most.
    pub limit: f64,
    /// Whether there was something to compare: of nothing it passes, but says nothing.
    pub compared: bool,
}

impl Check {
    /// What came of it, in a word or three.
    #[must_use]
    pub fn verdict(&self) -> &'static str {
        match (self.pass, self.compared) {
            (false, _) => "FAILS",
            (true, false) => "nothing to compare",
            (true, true) => "holds",
        }
    }
}

/// Everything.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Accuracy {
    /// The seed of the tours.
    pub seed: u64,
    /// Length of the tours, s.
    pub seconds: f64,
    /// Longest side of every model, m.
    pub size_m: f64,
    /// Speed of the hand, m/s; the knobs beside the tolerance are measured at [`FASTER`] times it
    /// too.
    pub speed_m_per_s: f64,
    /// Whether every check holds.
    pub pass: bool,
    /// The settings.
    pub points: Vec<Point>,
    /// What must come over the link.
    pub bytes: Vec<Bytes>,
    /// What must hold.
    pub checks: Vec<Check>,
    /// What ended the command early; empty where every model was measured.
    pub failed: Vec<String>,
}

impl Accuracy {
    /// Nothing measured yet.
    #[must_use]
    pub fn new(seed: u64, seconds: f64, size_m: f64, speed_m_per_s: f64) -> Self {
        Self {
            seed,
            seconds,
            size_m,
            speed_m_per_s,
            pass: false,
            points: Vec::new(),
            bytes: Vec::new(),
            checks: Vec::new(),
            failed: Vec::new(),
        }
    }

    /// What was measured, and how the measurement ended.
    ///
    /// # Errors
    /// The failure where nothing was measured: it is all that there is to say.
    pub fn ended(mut self, ended: Result<(), Failure>) -> Result<Self, Failure> {
        self.failed = beside_measured(ended, self.points.is_empty())?;
        self.pass = self.failed.is_empty() && self.checks.iter().all(|check| check.pass);
        Ok(self)
    }

    /// How many of the checks hold, in words.
    #[must_use]
    pub fn held(&self) -> String {
        let with = |verdict: &str| {
            let checks = self.checks.iter();
            checks.filter(|check| check.verdict() == verdict).count()
        };
        let of = self.checks.len();
        let held = format!("{} of {of} hold", with("holds"));
        match with("nothing to compare") {
            0 => held,
            empty => format!("{held}, {empty} had nothing to compare"),
        }
    }

    /// Whether all was measured and every check holds.
    ///
    /// # Errors
    /// With what failed.
    pub fn judge(&self) -> Result<(), Failure> {
        let failed: Vec<&Check> = self.checks.iter().filter(|check| !check.pass).collect();
        let mut wrong = self.failed.clone();
        if let Some(check) = failed.first() {
            wrong.push(format!(
                "{} of {} checks failed; {}: {} ({:.3e}, at most {:.1e})",
                failed.len(),
                self.checks.len(),
                check.model,
                check.name,
                check.worst,
                check.limit
            ));
        }
        if wrong.is_empty() {
            return Ok(());
        }
        Err(Failure::Run(wrong.join("; ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(pass: bool, compared: bool) -> Check {
        Check {
            model: "cow".to_string(),
            name: "a rule".to_string(),
            pass,
            worst: 2.0,
            limit: 3.0,
            compared,
        }
    }

    fn found(checks: Vec<Check>) -> Accuracy {
        Accuracy {
            points: vec![Point::new("cow", Knob::Local, 0.0)],
            checks,
            ..Accuracy::new(1, 5.0, 0.15, 0.1)
        }
    }

    #[test]
    fn a_late_failure_is_said_beside_what_was_measured() {
        let failure = || Failure::Input("the tour of b.obj touches nothing".to_string());
        // All that there is to say, with its status.
        let none = Accuracy::new(1, 5.0, 0.15, 0.1).ended(Err(failure()));
        assert_eq!(none.err(), Some(failure()));
        let found = found(vec![check(true, true)]).ended(Err(failure()));
        let found = found.expect("a model was measured");
        assert_eq!((found.points.len(), found.pass), (1, false));
        assert_eq!(found.judge(), Err(Failure::Run(failure().to_string())));
    }

    #[test]
    fn a_check_of_nothing_is_not_said_to_hold() {
        let found = found(vec![check(true, true), check(true, false)]);
        let found = found.ended(Ok(())).expect("nothing failed");
        assert_eq!(found.held(), "1 of 2 hold, 1 had nothing to compare");
        assert_eq!((found.pass, found.judge()), (true, Ok(())));
        let verdicts = [(true, true), (true, false), (false, true)];
        let verdicts = verdicts.map(|(pass, compared)| check(pass, compared).verdict());
        assert_eq!(verdicts, ["holds", "nothing to compare", "FAILS"]);
    }
}
