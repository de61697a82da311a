//! Which cases another library's proxy of a ball can be asked, and why not the others.

use crate::cases::{Case, ProbeOfCase};

/// Cases that are asked: one ball, one mesh at one resolution, friction and shading at most.
const ASKED: [&str; 32] = [
    "head-on-wall",
    "net-passivity",
    "passivity",
    "passivity-unlimited",
    "missed-ticks",
    "missed-ticks-from-miss",
    "slow-onset",
    "creep",
    "encoder",
    "encoder-account",
    "thin-sheet",
    "thin-sheet-refined",
    "edges-and-vertices",
    "damaged-mesh",
    "ridge",
    "ridge-account",
    "shaded-ridge",
    "shaded-ridge-account",
    "shaded-sharp-ridge",
    "valley-touched",
    "pit-touched",
    "corner-at-rest",
    "scale",
    "rest",
    "rest-account",
    "jumps",
    "samples-of-noise",
    "friction-loop",
    "friction-stick",
    "friction-stick-account",
    "moving-object",
    "moving-object-free",
];

/// Beginnings of names, and what a peer has no equal of.
const NO_EQUAL: [(&[&str], &str); 9] = [
    (
        &[
            "thin-sheet-coarse",
            "prediction-miss",
            "refine-",
            "fold-over",
            "refit",
        ],
        "a front that is refined",
    ),
    (&["silent-station", "station-"], "a station"),
    (&["units"], "units of a file: it is given metres"),
    (&["spikes"], "a filter of samples"),
    (&["repeat"], "recording and replay"),
    (&["pushed-"], "bodies that give way"),
    (&["friction-apart"], "several balls in one loop"),
    (
        &["texture-", "magnet-", "fields", "boundary"],
        "these effects, or defined otherwise",
    ),
    (&["effects-"], "effects that fade in and out"),
];

/// What a peer has no equal of; "" for a case that is asked.
#[must_use]
pub fn no_equal(case: &Case) -> &'static str {
    if ASKED.contains(&case.name) {
        return "";
    }
    if case.probe == ProbeOfCase::Tool {
        return "a tool";
    }
    if case.probe == ProbeOfCase::None {
        return "this part of the product";
    }
    let begins = |names: &&[&str]| names.iter().any(|name| case.name.starts_with(name));
    let found = NO_EQUAL.iter().find(|(names, _)| begins(names));
    found.map_or("what this asks, as far as anybody looked", |&(_, what)| {
        what
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cases::all;

    #[test]
    fn every_name_that_is_asked_is_a_case_with_a_ball() {
        for name in ASKED {
            let case = all().find(|case| case.name == name);
            let case = case.unwrap_or_else(|| panic!("{name} is no case any more"));
            assert_eq!(case.probe, ProbeOfCase::Ball, "{name}");
            assert_eq!(no_equal(case), "");
        }
    }

    #[test]
    fn what_no_peer_has_is_named() {
        let of = |name: &str| all().find(|case| case.name == name).map(no_equal);
        assert_eq!(of("refine-under-contact"), Some("a front that is refined"));
        assert_eq!(of("thin-sheet-tool"), Some("a tool"));
        assert_eq!(of("tip"), Some("this part of the product"));
    }
}
