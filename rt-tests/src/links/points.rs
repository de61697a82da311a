//! The links that are tried.

use crate::failure::Failure;
use crate::report::units::percent_of;
use protocol::MAX_CLIENTS;
use std::fmt;
use std::str::FromStr;

/// Round trip and bandwidth of the short form: near, a city, a continent, and a slow line.
const SHORT: [Point; 4] = [
    Point::new(1.0, 100.0),
    Point::new(20.0, 100.0),
    Point::new(100.0, 100.0),
    Point::new(20.0, 2.0),
];
/// The curves: from a cable in a laboratory to the other side of the earth, and from a radio
/// link to a fast line.
const CURVE_RTT_MS: [f64; 8] = [0.2, 1.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0];
const CURVE_MBIT: [f64; 6] = [0.25, 1.0, 2.0, 5.0, 10.0, 100.0];
/// Where only the other is chosen.
const USUAL_RTT_MS: f64 = 20.0;
const USUAL_MBIT: f64 = 100.0;
/// Longest round trip, milliseconds, and bandwidths, Mbit/s: what a line on the earth may have.
const MAX_RTT_MS: f64 = 2000.0;
const MIN_MBIT: f64 = 0.01;
const MAX_MBIT: f64 = 10_000.0;

/// A link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Round-trip time, milliseconds.
    pub rtt_ms: f64,
    /// Bandwidth of each direction, Mbit/s.
    pub mbit: f64,
    /// Share of the packets that are lost, 0 to 1.
    pub loss: f64,
}

impl Point {
    /// A link that loses nothing.
    pub const fn new(rtt_ms: f64, mbit: f64) -> Self {
        let loss = 0.0;
        Self { rtt_ms, mbit, loss }
    }

    /// The same, with a share of lost packets.
    pub const fn losing(self, loss: f64) -> Self {
        Self { loss, ..self }
    }
}

impl fmt::Display for Point {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ms, {} Mbit/s", self.rtt_ms, self.mbit)?;
        if self.loss > 0.0 {
            write!(f, ", {} lost", percent_of(self.loss))?;
        }
        Ok(())
    }
}

/// Ends the text of a controller that is stopped.
const STOPPED: &str = ":stopped";

/// One of several controllers: `RTT_MS:MBIT`, and `:stopped` for one that is stopped for a while.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guest {
    /// Its link.
    pub point: Point,
    /// Whether it is stopped in the middle third of the touch.
    pub is_stopped: bool,
    /// Whether its hand rests for the second half of the touch.
    pub rests: bool,
}

impl Guest {
    /// A controller that is not disturbed.
    #[must_use]
    pub const fn at(point: Point) -> Self {
        Self {
            point,
            is_stopped: false,
            rests: false,
        }
    }
}

impl FromStr for Guest {
    type Err = String;

    fn from_str(typed: &str) -> Result<Self, String> {
        let link = typed.strip_suffix(STOPPED);
        let parsed = || {
            let (rtt_ms, mbit) = link.unwrap_or(typed).split_once(':')?;
            Some(Point::new(rtt_ms.parse().ok()?, mbit.parse().ok()?))
        };
        let point = parsed();
        let point = point.ok_or_else(|| {
            format!("--controllers has {typed}; write RTT_MS:MBIT, as 20:100, or 20:100:stopped")
        })?;
        Ok(Self {
            is_stopped: link.is_some(),
            ..Self::at(point)
        })
    }
}

/// Several controllers, as typed.
///
/// # Errors
/// One sentence that names what is no controller, a number out of range, or too many of them.
pub fn guests(typed: &[String]) -> Result<Vec<Guest>, Failure> {
    if typed.len() > MAX_CLIENTS {
        return Err(Failure::Input(format!(
            "--controllers lists {}; a station serves {MAX_CLIENTS}",
            typed.len()
        )));
    }
    let guests: Result<Vec<Guest>, _> = typed.iter().map(|typed| typed.parse()).collect();
    let guests = guests.map_err(Failure::Input)?;
    let numbers = |of: fn(&Point) -> f64| -> Vec<f64> {
        let points = guests.iter().map(|guest| of(&guest.point));
        points.collect()
    };
    let option = "--controllers";
    within(option, &numbers(|of| of.rtt_ms), 0.0, MAX_RTT_MS)?;
    within(option, &numbers(|of| of.mbit), MIN_MBIT, MAX_MBIT)?;
    Ok(guests)
}

fn within(option: &str, numbers: &[f64], low: f64, high: f64) -> Result<(), Failure> {
    let wrong = |number: &&f64| !(low..=high).contains(*number);
    numbers.iter().find(wrong).map_or(Ok(()), |number| {
        Err(Failure::Input(format!(
            "{option} has {number}; write numbers from {low} to {high}"
        )))
    })
}

/// The links of a command: every round trip with every bandwidth.
///
/// # Errors
/// One sentence that names a number out of range.
pub fn chosen(rtt_ms: &[f64], mbit: &[f64]) -> Result<Vec<Point>, Failure> {
    within("--rtt-ms", rtt_ms, 0.0, MAX_RTT_MS)?;
    within("--mbit", mbit, MIN_MBIT, MAX_MBIT)?;
    if rtt_ms.is_empty() && mbit.is_empty() {
        return Ok(SHORT.to_vec());
    }
    let or = |numbers: &[f64], usual: f64| match numbers {
        [] => vec![usual],
        numbers => numbers.to_vec(),
    };
    let rtts = or(rtt_ms, USUAL_RTT_MS);
    let of = |&mbit: &f64| rtts.iter().map(move |&rtt_ms| Point::new(rtt_ms, mbit));
    Ok(or(mbit, USUAL_MBIT).iter().rev().flat_map(of).collect())
}

/// The links of the curves: all round trips at the usual bandwidth, all bandwidths at the usual
/// round trip.
pub fn curves() -> impl Iterator<Item = Point> {
    let far = CURVE_RTT_MS.into_iter();
    let far = far.map(|rtt_ms| Point::new(rtt_ms, USUAL_MBIT));
    let thin = CURVE_MBIT.into_iter().rev();
    let thin = thin.filter(|&mbit| mbit != USUAL_MBIT);
    far.chain(thin.map(|mbit| Point::new(USUAL_RTT_MS, mbit)))
}

/// Whether a link is one of the curve over round trips, and whether of that over bandwidths.
pub fn is_of_curves(point: Point) -> [bool; 2] {
    let is_lossless = point.loss == 0.0;
    [
        is_lossless && point.mbit == USUAL_MBIT,
        is_lossless && point.rtt_ms == USUAL_RTT_MS,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_tried_with_each_other_and_what_is_not_listed_is_usual() {
        let point = Point::new;
        let both = chosen(&[1.0, 20.0], &[2.0, 10.0]).unwrap();
        let expected = [
            point(1.0, 10.0),
            point(20.0, 10.0),
            point(1.0, 2.0),
            point(20.0, 2.0),
        ];
        assert_eq!(both, expected);
        let near = chosen(&[0.2], &[]).unwrap();
        assert_eq!(near, [point(0.2, USUAL_MBIT)]);
        let slow = chosen(&[], &[0.25]).unwrap();
        assert_eq!(slow, [point(USUAL_RTT_MS, 0.25)]);
    }

    #[test]
    fn the_curves_have_all_links_of_the_short_form_each_once() {
        assert_eq!(chosen(&[], &[]).unwrap(), SHORT);
        let all: Vec<Point> = curves().collect();
        assert!(SHORT.iter().all(|point| all.contains(point)));
        assert_eq!(all.len(), CURVE_RTT_MS.len() + CURVE_MBIT.len() - 1);
        for (number, point) in all.iter().enumerate() {
            assert!(!all[..number].contains(point), "{point}");
            assert!(is_of_curves(*point).contains(&true), "{point}");
            assert_eq!(is_of_curves(point.losing(0.01)), [false; 2]);
        }
        let both = |point: &&Point| is_of_curves(**point) == [true; 2];
        assert_eq!(all.iter().filter(both).count(), 1);
    }

    #[test]
    fn numbers_that_no_link_has_are_refused_by_name() {
        for (rtt, mbit, named) in [
            (&[1.0, -1.0][..], &[][..], "--rtt-ms has -1"),
            (&[f64::NAN], &[], "--rtt-ms has NaN"),
            (&[], &[0.0], "--mbit has 0;"),
        ] {
            let refused = chosen(rtt, mbit).unwrap_err();
            assert!(refused.to_string().contains(named), "{refused}");
        }
    }

    #[test]
    fn a_controller_is_read_with_its_link() {
        let far = Guest::at(Point::new(100.0, 0.25));
        assert_eq!("100:0.25".parse(), Ok(far));
        let stopped = Guest {
            is_stopped: true,
            ..far
        };
        assert_eq!("100:0.25:stopped".parse(), Ok(stopped));
        for typed in ["", "100", "100:", "a:b", "100:0.25:", "100:0.25:halted"] {
            let refused = typed.parse::<Guest>().unwrap_err();
            assert!(refused.contains("20:100:stopped"), "{refused}");
        }
        let typed = |text: &str, count| vec![text.to_string(); count];
        assert_eq!(
            guests(&typed("100:0.25", MAX_CLIENTS)).unwrap(),
            [far; MAX_CLIENTS]
        );
        for (typed, named) in [
            (typed("100:0.25", MAX_CLIENTS + 1), "a station serves"),
            (typed("100:0", 2), "--controllers has 0;"),
            (typed("far", 1), "--controllers has far;"),
        ] {
            let refused = guests(&typed).unwrap_err().to_string();
            assert!(refused.contains(named), "{refused}");
        }
    }
}
