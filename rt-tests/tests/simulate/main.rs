//! The simulator's seeds: those that once failed pass, the generator reaches what it claims to, and
//! a run is a function of its seed.

use rt_tests::commands::simulate::coverage::Coverage;
use rt_tests::commands::simulate::kind::Kind;
use rt_tests::commands::simulate::library::Library;
use rt_tests::commands::simulate::scenario::{Reduction, Scenario};
use rt_tests::commands::simulate::scenes::SIZE_M;
use rt_tests::commands::simulate::shrink::{run_seed, shrink};
use rt_tests::commands::simulate::standing_tool::StandingTool;
use rt_tests::commands::simulate::trace::Violation;
use rt_tests::commands::simulate::{SimulateArgs, Simulated, is_covered};
use scene::ProbeShape;
use std::collections::BTreeSet;
use std::sync::OnceLock;

fn library() -> &'static Library {
    static LIBRARY: OnceLock<Library> = OnceLock::new();
    LIBRARY.get_or_init(|| Library::build().expect("the models are built"))
}

/// What these seeds do not reach: messages of which a run has one or two, which the link seldom
/// hits.
const SELDOM: [&str; 4] = [
    "close sent twice",
    "ask for a tour overtaking",
    "close overtaking",
    "quarters overtaking",
];

#[test]
fn seeds_that_once_failed_pass() {
    let text = include_str!("seeds.txt");
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let mut failed = Vec::new();
    let mut coverage = Coverage::default();
    let mut runs = 0;
    for line in lines {
        let seed = line
            .split_whitespace()
            .next()
            .and_then(|of| of.parse().ok());
        let seed = seed.unwrap_or_else(|| panic!("\"{line}\" begins with no seed"));
        runs += 1;
        match run_seed(seed, &Reduction::default(), library()) {
            Ok(outcome) => coverage.add(&outcome.coverage),
            Err(found) => failed.push(found.text()),
        }
    }
    assert!(runs > 0);
    assert!(failed.is_empty(), "{}", failed.join("\n"));
    let mut missing = coverage.missing();
    missing.retain(|kind| !SELDOM.contains(&kind.as_str()));
    assert!(missing.is_empty(), "never reached: {}", missing.join(", "));
}

/// Faults that change no message happen to none, though their kind is drawn.
#[test]
fn a_kind_without_weight_does_not_happen() {
    let only = BTreeSet::from([Kind::Loss]);
    let scenario = Scenario::draw(41, &Reduction::default(), library());
    assert!(scenario.expect("the scene is good").has(Kind::Loss));
    let run = run_seed(
        41,
        &Reduction {
            only: Some(only),
            weight: 0.0,
            ticks: Some(1500),
        },
        library(),
    );
    let coverage = run
        .unwrap_or_else(|failed| panic!("{}", failed.text()))
        .coverage;
    assert!(coverage.states.contains_key("contact at full resolution"));
    assert!(!coverage.in_contact.contains_key(&Kind::Loss));
}

#[test]
fn a_run_is_a_function_of_its_seed() {
    let run = |seed| run_seed(seed, &Reduction::default(), library()).map(|of| of.hash);
    let (one, again, other) = (run(19), run(19), run(41));
    let [one, again, other] = [one, again, other].map(|run| run.expect("the seed passes"));
    assert_eq!(one, again);
    assert_ne!(one, other);
}

#[test]
fn dropping_a_kind_leaves_the_others_as_they_were() {
    let draw = |reduction: &Reduction| {
        Scenario::draw(41, reduction, library()).expect("the scene is good")
    };
    let whole = draw(&Reduction::default());
    assert!(whole.has(Kind::Loss) && whole.has(Kind::Cut));
    let mut only: BTreeSet<Kind> = whole.kinds.clone();
    only.remove(&Kind::Loss);
    let less = draw(&Reduction {
        only: Some(only.clone()),
        ..Reduction::default()
    });
    assert_eq!(less.kinds, only);
    assert_eq!(
        (less.link.loss, less.link.duplicates),
        (0.0, whole.link.duplicates)
    );
    assert_eq!(less.events, whole.events);
}

/// Every kind is on in one seed of a few. What runs reach with it is judged over the seeds that
/// once failed, and by `rt-tests simulate` over its own.
#[test]
fn every_kind_is_drawn_alone_and_beside_others() {
    let mut seen = BTreeSet::new();
    let (mut least, mut most) = (usize::MAX, 0);
    for seed in 0..60 {
        let scenario = Scenario::draw(seed, &Reduction::default(), library());
        let kinds = scenario.expect("the scene is good").kinds;
        least = least.min(kinds.len());
        most = most.max(kinds.len());
        seen.extend(kinds);
    }
    let missing: Vec<_> = Kind::all()
        .iter()
        .filter(|kind| !seen.contains(kind))
        .collect();
    assert!(missing.is_empty(), "never drawn: {missing:?}");
    assert!(
        least <= 2 && most >= 12,
        "from {least} to {most} kinds at once"
    );
}

#[test]
fn nothing_reached_is_said_to_be_missing() {
    let mut coverage = Coverage::default();
    let all = coverage.missing().len();
    coverage.met(Kind::Loss, 1);
    coverage.link.lost[0] = 1;
    assert_eq!(coverage.missing().len(), all - 2);
}

/// What many whole seeds never reach is a failure that names it.
#[test]
fn many_whole_seeds_are_to_reach_everything() {
    let args = |ticks| SimulateArgs {
        seeds: 0..200,
        only: None,
        weight: 1.0,
        ticks,
        mutants: false,
        json: true,
    };
    let found = |seeds, not_reached: &[&str]| Simulated {
        seeds,
        not_reached: not_reached.iter().map(|of| (*of).to_string()).collect(),
        ..Simulated::default()
    };
    let missing = ["cut in contact", "close lost"];
    let failed = is_covered(&args(None), &found(200, &missing));
    let failed = failed.expect_err("two things were not reached");
    let text = failed.to_string();
    assert!(missing.iter().all(|of| text.contains(of)), "{text}");
    assert!(is_covered(&args(None), &found(200, &[])).is_ok());
    // Few seeds, or runs that are cut, need not.
    assert!(is_covered(&args(None), &found(199, &missing)).is_ok());
    assert!(is_covered(&args(Some(100)), &found(200, &missing)).is_ok());
}

/// A run that ends before it has touched fails the check of contact; shrunk, it fails the same one.
#[test]
fn a_failure_is_made_smaller_and_says_how_to_run_it_again() {
    let reduction = Reduction::default();
    let failed = rt_tests::commands::simulate::shrink::Failed {
        seed: 41,
        kinds: Scenario::draw(41, &reduction, library())
            .expect("the scene is good")
            .kinds,
        reduction,
        violation: Violation {
            check: "a check that always holds".to_string(),
            tick: 50,
            client: 0,
            found: String::new(),
        },
        trace: String::new(),
    };
    let kinds = failed.kinds.clone();
    let least = shrink(Box::new(failed), library());
    assert_eq!(
        least.kinds, kinds,
        "nothing fails without what it was on with"
    );
    let text = least.text();
    assert!(
        text.contains("--seeds 41..42") && text.contains("a check that always holds"),
        "{text}"
    );
}

#[test]
fn a_tool_meets_the_surface_that_its_tip_is_in_and_not_from_afar() {
    let cylinder = ProbeShape::Cylinder {
        radius_m: 0.004,
        length_m: 0.03,
        faces: 120,
    };
    let tool = StandingTool::of_shape(&cylinder).expect("a cylinder is a tool");
    for model in 0..library().len() {
        let version = library().version(model, false);
        let [a, b, c] = version.full.triangles()[0];
        let normal = (b - a).cross(c - a).normalize();
        let place = [(a + b + c) / 3.0, normal];
        // The axis of the tool goes through the face.
        assert!(tool.meets(version, place, -1e-3), "model {model}");
        assert!(!tool.meets(version, place, 2.0 * SIZE_M), "model {model}");
    }
}
