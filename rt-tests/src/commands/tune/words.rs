//! The settings as a fragment of a scene, and the result in words.

use super::trial::{Cost, Settings};
use super::{Asked, Tuned};
use crate::report::units::{bytes, digits, length};
use scene::{PolicyPlan, RefinementPlan, ScenePlan};
use std::fmt::Write as _;

/// The tables `accuracy` and `cache` of a scene with the settings; they replace those of the scene.
#[must_use]
pub fn fragment(plan: &ScenePlan, settings: Settings) -> String {
    let refinement = match plan.accuracy.refinement {
        RefinementPlan::Local => "local",
        RefinementPlan::Global { .. } => "global",
    };
    let policy = match (plan.accuracy.refinement, plan.accuracy.policy) {
        (RefinementPlan::Local, PolicyPlan::Reactive) => "policy = \"reactive\"\n",
        _ => "",
    };
    // A float in TOML has a point or an exponent.
    let mut text = format!(
        "[accuracy]\ntolerance_m = {:?}\nrefinement = \"{refinement}\"\ngeomorph = {}\n{policy}\n[cache]\nbytes = {}\n",
        settings.tolerance_m, plan.accuracy.geomorph, settings.cache_bytes
    );
    let changes = plan.cache_changes.iter();
    for change in changes.filter(|change| change.bytes <= settings.cache_bytes) {
        let _ = write!(
            text,
            "\n[[cache.change]]\nat_s = {:?}\nbytes = {}\n",
            change.at_s, change.bytes
        );
    }
    text
}

/// What was asked for or found, in words.
fn limits(of: &Asked) -> String {
    let parts = [
        of.error_m.map(|metres| format!("error {}", length(metres))),
        of.time_us.map(|us| format!("tick {} µs", digits(us))),
        of.bytes
            .map(|count| format!("{} received", bytes(count as u64))),
        of.memory_bytes
            .map(|count| format!("memory {}", bytes(count as u64))),
    ];
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// The error of a run, or of a touch in virtual time.
fn error(of: &Cost) -> String {
    match of.measured_errors {
        0 => "error not measured".to_string(),
        _ => format!("error {} at most", length(of.error_m)),
    }
}

fn cost(of: &Cost) -> String {
    format!(
        "{} (certified {}), 99 of 100 ticks within {} µs, {} received, memory in use {}, {:.1} % of the contact coarser \
         than the tolerance",
        error(of),
        length(of.certified_m),
        digits(of.time_us),
        bytes(of.bytes as u64),
        bytes(of.memory_bytes as u64),
        100.0 * of.coarser
    )
}

/// The text of the terminal; the fragment can be taken out of it as it is.
#[must_use]
pub fn words(tuned: &Tuned) -> String {
    let mut text = format!("{}\n", tuned.settings);
    let mut line = |name: &str, what: &str| {
        let _ = writeln!(text, "# {name:<10} {what}");
    };
    line("asked", &limits(&tuned.asked));
    line("predicted", &limits(&tuned.predicted));
    let verdict = if tuned.met { "kept" } else { "NOT kept" };
    line(
        "measured",
        &format!("{}: {verdict}", limits(&tuned.measured)),
    );
    line("costs", &cost(&tuned.cost));
    line("binds", &tuned.binds);
    if tuned.asked.memory_bytes.is_some() && tuned.cost.evicted > 0 {
        let evicted = tuned.cost.evicted;
        line("cache", &format!("full: {evicted} record(s) had to go"));
    }
    match &tuned.next {
        None => line("next step", "none: this is the full mesh"),
        Some((tolerance, finer)) => {
            let at = if *tolerance == 0.0 {
                "the full mesh".to_string()
            } else {
                format!("a tolerance of {}", length(*tolerance))
            };
            line("next step", &format!("{at}: {}", cost(finer)));
        }
    }
    for (factor, there) in &tuned.slower {
        let what = format!("{} (predicted)", error(there));
        line(&format!("1/{factor} speed"), &what);
    }
    let [simulated, run] = tuned.trials;
    line(
        "tried",
        &format!("{simulated} touches in virtual time, {run} by both processes"),
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene::{NoFiles, Overrides, parse};
    use std::path::Path;

    const REST: &str = "[[object]]\nmodel = \"m.spm\"\nsize_m = 0.15\n[[probe]]\n";

    fn plan(text: &str) -> ScenePlan {
        let parsed = parse(text, "s", Path::new(""), &Overrides::default(), &NoFiles);
        parsed.unwrap_or_else(|error| panic!("{error}\n{text}"))
    }

    #[test]
    fn the_fragment_loads_as_printed_and_says_the_settings() {
        let global = "[accuracy]\nrefinement = \"global\"\ngeomorph = false\n";
        let reactive =
            "[accuracy]\npolicy = \"reactive\"\n[[cache.change]]\nat_s = 2.0\nbytes = \"4MiB\"\n";
        for before in ["", global, reactive].map(|with| plan(&format!("{with}{REST}"))) {
            for tolerance_m in [0.0, 1.23e-7, 2e-3] {
                let settings = Settings {
                    tolerance_m,
                    cache_bytes: 5 << 20,
                };
                let after = plan(&format!("{}{REST}", fragment(&before, settings)));
                assert_eq!(after.accuracy.tolerance_m, tolerance_m);
                assert_eq!(after.cache_bytes, 5 << 20);
                assert_eq!(after.accuracy.refinement, before.accuracy.refinement);
                assert_eq!(after.accuracy.geomorph, before.accuracy.geomorph);
                assert_eq!(after.accuracy.policy, before.accuracy.policy);
                assert_eq!(after.cache_changes, before.cache_changes);
            }
        }
    }

    #[test]
    fn the_whole_output_is_a_fragment_too() {
        let asked = Asked {
            error_m: Some(1e-4),
            ..Asked::default()
        };
        let settings = Settings {
            tolerance_m: 1e-4,
            cache_bytes: 1 << 20,
        };
        let cost = Cost {
            measured_errors: 1,
            ..Cost::default()
        };
        let tuned = Tuned {
            scene: "s".to_string(),
            asked,
            settings: fragment(&plan(REST), settings),
            tolerance_m: 1e-4,
            cache_bytes: 1 << 20,
            predicted: asked,
            measured: asked,
            met: true,
            binds: "the error".to_string(),
            cost,
            next: Some((5e-5, cost)),
            slower: vec![(2.0, cost), (4.0, Cost::default())],
            trials: [3, 2],
        };
        let text = words(&tuned);
        assert_eq!(plan(&format!("{text}{REST}")).cache_bytes, 1 << 20);
        assert!(text.contains("# binds      the error"), "{text}");
        assert!(text.contains("# 1/2 speed  error 0"), "{text}");
        assert!(text.contains("# 1/4 speed  error not measured"), "{text}");
    }
}
