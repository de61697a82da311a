//! `rt-tests effects` as a user types it.

use crate::typed::{json, number, refusal, rt_tests, said};

#[test]
fn listed_effects_are_called_and_felt_and_one_that_is_not_is_neither_called_nor_kept() {
    let arguments = ["--seconds", "2", "--seed", "2", "--json"];
    let output = rt_tests("effects").args(arguments).output().unwrap();
    let found = json(&output);
    // The cost is the machine's affair.
    let status = i32::from(found["pass"] != true);
    assert_eq!(output.status.code(), Some(status), "{}", said(&output));
    assert_eq!(number(&found, "unlisted_calls"), 0.0);
    assert_eq!(number(&found, "unlisted_bytes"), 0.0);
    assert_eq!(found["unlisted_bit_equal"], true);
    let effects = found["effects"].as_array().unwrap();
    for effect in effects {
        assert!(number(effect, "ticks") > 0.0, "seed 2: {effect}");
    }
    for probe in ["ball", "tool"] {
        let of_probe = |effect: &&serde_json::Value| effect["probe"] == probe;
        let mut of_probe = effects.iter().filter(of_probe);
        let all = of_probe.find(|effect| effect["name"] == "all");
        assert!(number(all.unwrap(), "felt_ticks") > 0.0, "seed 2: {all:?}");
    }
}

#[test]
fn a_scene_that_is_not_there_is_refused() {
    let output = rt_tests("effects").arg("nowhere.toml").output().unwrap();
    assert!(refusal(&output).contains("nowhere.toml"));
}
