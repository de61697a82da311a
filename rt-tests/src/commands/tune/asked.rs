//! What was asked for: numbers with their units.

use crate::failure::Failure;
use clap::Args;
use scene::parse_bytes;
use serde::Serialize;

/// The limits, each optional.
#[derive(Debug, Clone, Default, Args)]
pub struct LimitArgs {
    /// Largest distance from a contact to the full mesh: 0.1mm, 50um, or metres
    #[arg(long, value_name = "LENGTH")]
    pub error: Option<String>,
    /// Processor time of a tick that 99 of 100 do not exceed: 100us, 0.1ms, or seconds
    #[arg(long, value_name = "TIME")]
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
    let unit = units.iter().find(|(unit, _)| trimmed.ends_with(unit));
    let (number, size) = unit.map_or((trimmed, 1.0), |(unit, size)| {
        (trimmed.trim_end_matches(unit), *size)
    });
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
        for wrong in ["0mm", "-1mm", "mm", "1kg", "nan", "1e999"] {
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
}
