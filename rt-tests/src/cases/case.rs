//! A hard case, what it is given, and what it came to.

use super::setup::{Departure, Setup};
use crate::failure::Failure;
use mutants::Mutant;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::Serialize;

/// Runs a case.
pub type Run = fn(Trial<'_>) -> Result<Found, Failure>;

/// What a case touches with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ProbeOfCase {
    /// A ball.
    Ball,
    /// A mesh.
    Tool,
    /// Nothing: a part of the product is asked by itself.
    None,
}

/// A hard case. The defaults of its run are the product's, but for `departs`.
#[derive(Debug, Clone, Copy)]
pub struct Case {
    /// Name.
    pub name: &'static str,
    /// Its number in the list of facts; "" where it is ours.
    pub number: &'static str,
    /// Its measure, in words.
    pub measure: &'static str,
    /// The largest value that passes.
    pub limit: f64,
    /// Parameters that the facts name.
    pub facts: &'static str,
    /// Parameters of its run.
    pub runs: &'static str,
    /// What it touches with.
    pub probe: ProbeOfCase,
    /// Where it departs from the product, and why.
    pub departs: &'static [(Departure, &'static str)],
    /// Why it is known not to keep to its limit; "" where it does.
    pub open: &'static str,
    /// Where it is open, what it is known to come to at the most: beyond it fails. Else 0.
    pub known: f64,
    /// The fault in the product under which it must fail.
    pub mutant: Mutant,
    /// Runs it.
    pub run: Run,
}

impl Case {
    /// Of a ball, without departures.
    #[must_use]
    pub const fn of(
        [name, number, measure]: [&'static str; 3],
        limit: f64,
        mutant: Mutant,
        run: Run,
    ) -> Self {
        Self {
            name,
            number,
            measure,
            limit,
            facts: "",
            runs: "",
            probe: ProbeOfCase::Ball,
            departs: &[],
            open: "",
            known: 0.0,
            mutant,
            run,
        }
    }

    /// What it is known to come to at the most, where it is known not to keep to its limit.
    #[must_use]
    pub fn known(&self) -> Option<f64> {
        (!self.open.is_empty()).then_some(self.known)
    }

    /// A trial of it from a source of all that is random.
    #[must_use]
    pub fn trial<'a>(&self, size: &'a Size, random: &'a mut Xoshiro256PlusPlus) -> Trial<'a> {
        let setup = Setup {
            departs: self.departs,
            ..Setup::at_rate(size.rate_hz)
        };
        let defaults = match self.probe {
            ProbeOfCase::Tool => setup.with_tool(),
            ProbeOfCase::Ball | ProbeOfCase::None => setup,
        };
        Trial {
            size,
            random,
            defaults,
        }
    }
}

/// How much is run.
#[derive(Debug, Clone, Copy)]
pub struct Size {
    /// Whether the full set is run.
    pub full: bool,
    /// Rate of the loop, 1/s; at another than 1 kHz the stiffness of every surface and effect goes
    /// with it, see [`Setup::at_rate`].
    pub rate_hz: f64,
}

impl Size {
    /// A number for the quick set, and one for the full set.
    #[must_use]
    pub fn of(&self, quick: u64, full: u64) -> u64 {
        if self.full { full } else { quick }
    }
}

/// Everything that a run of a case is given.
#[derive(Debug)]
pub struct Trial<'a> {
    /// How much is run.
    pub size: &'a Size,
    /// The source of all that is random.
    pub random: &'a mut Xoshiro256PlusPlus,
    /// The product's defaults, where the case does not depart from them.
    pub defaults: Setup,
}

/// A number that is logged beside the measure; it has no limit.
#[derive(Debug, Clone, Serialize)]
pub struct Logged {
    /// What it is.
    pub name: &'static str,
    /// The largest that was seen.
    pub value: f64,
}

/// What a case came to.
#[derive(Debug, Clone)]
pub struct Found {
    /// The worst value seen; infinite where something was no number, or what must happen did not.
    pub value: f64,
    /// The worst that was measured, whatever must happen beside it.
    measured: f64,
    /// Measurements made.
    pub passes: u64,
    /// Other numbers.
    pub logged: Vec<Logged>,
}

impl Found {
    /// Nothing seen; the value starts here.
    #[must_use]
    pub fn new(value: f64) -> Self {
        Self {
            value,
            measured: value,
            passes: 0,
            logged: Vec::new(),
        }
    }

    /// Of what was seen the largest counts; what is no number counts as infinite.
    pub fn most(&mut self, value: f64) {
        let value = if value.is_nan() { f64::INFINITY } else { value };
        self.value = self.value.max(value);
        self.measured = self.measured.max(value);
        self.passes += 1;
    }

    /// Without a touch, or whatever else must happen, nothing was shown. That is no measure:
    /// [`Found::measured`] does not know of it.
    pub fn must(&mut self, happened: bool) {
        if !happened {
            self.value = f64::INFINITY;
            self.passes += 1;
        }
    }

    /// The worst that was measured; infinite where it was no number.
    #[must_use]
    pub fn measured(&self) -> f64 {
        self.measured
    }

    /// What is not right is counted. Ask for what is right: a comparison with what is no number is
    /// false.
    pub fn right(&mut self, is_right: bool) {
        let wrong = f64::from(u8::from(!is_right));
        self.value += wrong;
        self.measured += wrong;
        self.passes += 1;
    }

    /// Logs a number; of several by one name the largest stays, and what is no number.
    pub fn log(&mut self, name: &'static str, value: f64) {
        match self.logged.iter_mut().find(|of| of.name == name) {
            Some(of) if value > of.value || value.is_nan() => of.value = value,
            Some(_) => {}
            None => self.logged.push(Logged { name, value }),
        }
    }
}

/// The larger of a number and 0; not a number stays so.
#[must_use]
pub fn positive(x: f64) -> f64 {
    if x < 0.0 { 0.0 } else { x }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_must_happen_and_does_not_fails_a_case_and_is_no_measure() {
        let mut found = Found::new(0.0);
        found.most(0.5);
        found.must(false);
        assert_eq!([found.value, found.measured()], [f64::INFINITY, 0.5]);
        found.right(false);
        assert_eq!([found.value, found.measured()], [f64::INFINITY, 1.5]);
        found.most(f64::NAN);
        assert_eq!([found.value, found.measured()], [f64::INFINITY; 2]);
        assert_eq!(found.passes, 4);
    }
}
