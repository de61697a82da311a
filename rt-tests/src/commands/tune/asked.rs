//! What was asked for: numbers with their units, and whether a run kept them.

use super::search::Verdict;
use super::trial::Cost;
use crate::failure::Failure;
use clap::Args;
use scene::parse_bytes;
use serde::Serialize;

/// Far from a time that was asked for: less than it by this factor, and a finer tolerance is tried.
const FAR: f64 = 1.35;

/// The limits, each optional.
#[derive(Debug, Clone, Default, Args)]
pub struct LimitArgs {
    /// Largest distance from a contact to the full mesh: 0.1mm, 50um, or metres
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub error: Option<String>,
    /// Processor time of a tick that 99 of 100 do not exceed: 100us, 0.1ms, or seconds
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    pub time: Option<String>,
    /// Bytes received in the run, such as 2MiB
    #[arg(long, value_name = "SIZE")]
    pub bytes: Option<String>,
    /// Memory of the controller: cache, rings and stack, such as 8MiB
    #[arg(long, value_name = "SIZE")]
    pub memory: Option<String>,
}

/// A value for each of the four; those that were not asked for are none.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Asked {
    /// Largest measured error at a contact, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error_m: Option<f64>,
    /// Processor time of a tick, p99, µs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_us: Option<f64>,
    /// Bytes received.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes: Option<f64>,
    /// Bytes of the cache and of fixed rings and stacks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub memory_bytes: Option<f64>,
}

impl LimitArgs {
    /// As numbers.
    ///
    /// # Errors
    /// One sentence for a number that is none, or when nothing is asked for.
    pub fn parsed(&self) -> Result<Asked, Failure> {
        let size = |option: &str, text: &Option<String>| {
            let parsed = text.as_deref().map(parse_bytes).transpose();
            parsed
                .map(|bytes| bytes.map(|bytes| bytes as f64))
                .map_err(|why| Failure::Input(format!("--{option} {why}")))
        };
        let asked = Asked {
            error_m: parse("error", self.error.as_deref(), &LENGTHS)?,
            time_us: parse("time", self.time.as_deref(), &TIMES)?.map(|seconds| seconds * 1e6),
            bytes: size("bytes", &self.bytes)?,
            memory_bytes: size("memory", &self.memory)?,
        };
        if asked == Asked::default() {
            return Err(Failure::Input(
                "nothing is asked for; give --error 0.1mm, --time 100us, --bytes 2MiB or --memory 8MiB".to_string(),
            ));
        }
        Ok(asked)
    }
}

impl Asked {
    /// What a run at a tolerance says of it. What is no number keeps no limit.
    #[must_use]
    pub fn verdict(&self, tolerance_m: f64, cost: &Cost) -> Verdict {
        let keeps = |limit: Option<f64>, value: f64| limit.is_none_or(|limit| value <= limit);
        let costs = [
            ("the time", self.time_us, cost.time_us),
            ("the bytes", self.bytes, cost.bytes),
            // Never broken while caches keep within what they are given: what limits the memory is
            // how coarse the front has to be in it, which the search judges.
            ("the memory", self.memory_bytes, cost.memory_bytes),
        ];
        let mut broken = costs.iter().filter(|of| !keeps(of.1, of.2));
        let too_fine = broken.next().map(|of| of.0);
        let is_unknown = self.error_m.is_some() && cost.measured_errors == 0;
        let is_too_coarse = !keeps(self.error_m, cost.error_m);
        match too_fine {
            _ if is_unknown => Verdict::Neither,
            Some(_) if is_too_coarse => Verdict::Neither,
            Some(name) => Verdict::TooFine(name),
            None if is_too_coarse => Verdict::TooCoarse,
            None if self.is_far(tolerance_m, cost) => Verdict::Far,
            None => Verdict::Kept,
        }
    }

    /// Whether a run is far below the only limit, a time, and there is a finer tolerance.
    fn is_far(&self, tolerance_m: f64, cost: &Cost) -> bool {
        let only_time = Self {
            time_us: self.time_us,
            ..Self::default()
        };
        let is_far = |limit: f64| cost.time_us * FAR < limit;
        tolerance_m > 0.0 && *self == only_time && self.time_us.is_some_and(is_far)
    }
}

/// Units, each with its size in the SI unit; the last is the SI unit itself.
type Units = [(&'static str, f64); 5];
const LENGTHS: Units = [
    ("nm", 1e-9),
    ("um", 1e-6),
    ("µm", 1e-6),
    ("mm", 1e-3),
    ("m", 1.0),
];
const TIMES: Units = [
    ("ns", 1e-9),
    ("us", 1e-6),
    ("µs", 1e-6),
    ("ms", 1e-3),
    ("s", 1.0),
];

fn parse(option: &str, text: Option<&str>, units: &Units) -> Result<Option<f64>, Failure> {
    let Some(text) = text else { return Ok(None) };
    let trimmed = text.trim();
    let mut with_unit = units
        .iter()
        .filter_map(|(unit, size)| Some((trimmed.strip_suffix(*unit)?, *size)));
    let (number, size) = with_unit.next().unwrap_or((trimmed, 1.0));
    let value = number.trim().parse::<f64>().ok().map(|value| value * size);
    let value = value.filter(|value| value.is_finite() && *value > 0.0);
    value.map(Some).ok_or_else(|| {
        let names = units.map(|(unit, _)| unit).join(", ");
        Failure::Input(format!(
            "--{option} {text} is no such number; write one above 0 with a unit of {names}"
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_with_their_units() {
        let args = LimitArgs {
            error: Some("0.1mm".to_string()),
            time: Some("100 us".to_string()),
            bytes: None,
            memory: Some("8MiB".to_string()),
        };
        let asked = args.parsed().unwrap_or_else(|error| panic!("{error}"));
        assert!((asked.error_m.unwrap_or(0.0) - 1e-4).abs() < 1e-18);
        assert!((asked.time_us.unwrap_or(0.0) - 100.0).abs() < 1e-9);
        assert_eq!(asked.memory_bytes, Some(8.0 * 1048576.0));
        for wrong in ["0mm", "-1mm", "mm", "1kg", "nan", "1e999", "1mmmm"] {
            let args = LimitArgs {
                error: Some(wrong.to_string()),
                ..LimitArgs::default()
            };
            assert_eq!(args.parsed().unwrap_err().status(), 2, "{wrong}");
        }
        assert_eq!(LimitArgs::default().parsed().unwrap_err().status(), 2);
        let metres = parse("error", Some("1e-4"), &LENGTHS);
        assert_eq!(metres, Ok(Some(1e-4)));
    }

    /// A run with an error in metres, a time in µs and a number of bytes.
    fn cost(error_m: f64, time_us: f64, bytes: f64) -> Cost {
        Cost {
            error_m,
            measured_errors: 1,
            time_us,
            bytes,
            ..Cost::default()
        }
    }

    #[test]
    fn a_limit_that_is_not_kept_says_which_way_to_turn() {
        let asked = Asked {
            error_m: Some(1e-4),
            time_us: Some(100.0),
            bytes: Some(1e6),
            memory_bytes: None,
        };
        let nan = f64::NAN;
        for (seen, expected) in [
            (cost(1e-4, 100.0, 1e6), Verdict::Kept),
            (cost(1e-4, 10.0, 1e3), Verdict::Kept),
            (cost(1e-4, 101.0, 1e6), Verdict::TooFine("the time")),
            (cost(1e-4, 100.0, 2e6), Verdict::TooFine("the bytes")),
            (cost(2e-4, 100.0, 1e6), Verdict::TooCoarse),
            (cost(2e-4, 101.0, 1e6), Verdict::Neither),
            (cost(nan, 100.0, 1e6), Verdict::TooCoarse),
            (cost(1e-4, nan, 1e6), Verdict::TooFine("the time")),
        ] {
            assert_eq!(asked.verdict(1e-3, &seen), expected, "{seen:?}");
        }
        // Nothing that was measured kept it.
        let mut unknown = cost(0.0, 50.0, 1e3);
        unknown.measured_errors = 0;
        assert_eq!(asked.verdict(1e-3, &unknown), Verdict::Neither);
    }

    #[test]
    fn only_a_time_alone_is_far_where_there_is_a_finer_tolerance() {
        let asked = Asked {
            time_us: Some(100.0),
            ..Asked::default()
        };
        let near = cost(0.0, 101.0 / FAR, 0.0);
        let far = cost(0.0, 99.0 / FAR, 0.0);
        assert_eq!(asked.verdict(1e-3, &near), Verdict::Kept);
        assert_eq!(asked.verdict(1e-3, &far), Verdict::Far);
        assert_eq!(asked.verdict(0.0, &far), Verdict::Kept);
        let bytes = Some(1.0);
        assert_eq!(Asked { bytes, ..asked }.verdict(1e-3, &far), Verdict::Kept);
    }
}
