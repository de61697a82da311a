//! `rt-tests fronts` as a user types it.

use crate::typed::{json, number, refusal, rt_tests, said};
use serde_json::Value;
use spm_builder::generate::{Shape, generate};
use spm_builder::{
    BuildOptions, NoProgress, SoupMesh, build_model, read_mesh, write_mesh, write_spm_file,
};
use std::io::Write as _;
use std::path::Path;
use std::process::Output;

fn fronts(arguments: &[&Path]) -> Output {
    rt_tests("fronts").args(arguments).output().unwrap()
}

#[test]
fn json_and_table_have_the_fields_of_the_design() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = folder.path().join("torus.obj");
    write_mesh(&generate(Shape::Torus, 4000, 1), &mesh).unwrap();
    let out = folder.path().join("out");
    let output = fronts(&["--json".as_ref(), "--out".as_ref(), &out, &mesh]);
    let (found, said) = (json(&output), said(&output));
    let broken = found["broken"].as_array().unwrap();
    // The cost is the machine's affair; everything else must hold.
    assert!(
        broken.iter().all(|b| b.as_str().unwrap().contains("_ns.")),
        "{broken:?}"
    );
    let status = i32::from(!broken.is_empty());
    assert_eq!(output.status.code(), Some(status), "{said}");
    let model = &found["models"][0];
    for field in [
        "faces",
        "splits",
        "collapses",
        "chain",
        "closure_mean",
        "closure_max",
        "certified_ratio.p50",
        "certified_ratio.p95",
        "dial.asked_over_true_p50",
        "dial.asked_over_attainable_p50",
        "dial.asked_over_true_within_reach_p50",
        "dial.vsps_over_coarsest",
        "split_ns.p50",
        "split_ns.p99",
        "collapse_ns.p50",
        "collapse_ns.p99",
    ] {
        assert!(number(model, field) > 0.0, "{field}");
    }
    for field in ["mismatches", "certified_violations"] {
        assert_eq!(number(model, field), 0.0, "{field}");
    }
    assert!(number(model, "dial.exceeded_share") <= 1e-3);
    assert!(number(model, "dial.too_fine_share") <= 0.25);
    // One table: beside the JSON on standard error, without it on standard output.
    let table = std::fs::read_to_string(out.join("fronts.txt")).unwrap();
    assert!(table.lines().all(|line| line.chars().count() <= 160));
    assert!(said.contains(&table), "{said}");
    let shown = fronts(&[&mesh]);
    let [above, aside] = [shown.stdout, shown.stderr].map(|s| String::from_utf8(s).unwrap());
    // Limits on costs are the machine's: their sentences may stand aside, the table may not.
    let heading = table.lines().next().expect("the table has a heading");
    assert!(above.contains(heading) && above.contains("torus.obj"));
    assert!(!aside.contains(heading), "{aside}");
    assert!(out.join("fronts.json").is_file() && out.join("fronts.txt").is_file());

    let nowhere = folder.path().join("nowhere.obj");
    let refused = fronts(&[&nowhere]);
    assert!(refusal(&refused).contains("nowhere.obj"));
}

/// A model whose expected errors are all twice what they should be, as an SPM file.
fn build_with_errors_doubled(mesh: SoupMesh, path: &Path) {
    /// Codes of E for a factor of two.
    const OCTAVE: u16 = 2048;
    /// The same in the steps in which a vertex says from which E on it is active.
    const STEPS: u8 = 16;
    let mut parts = build_model(mesh, &BuildOptions::default(), &NoProgress).unwrap();
    for record in parts.records.iter_mut().filter(|record| record.e > 0) {
        record.e = record.e.saturating_add(OCTAVE);
    }
    // Other vertices count from their own VSP on, those of the base mesh from the largest code.
    for vertex in &mut parts.base_vertices {
        let begin = &mut vertex.certified.begin;
        if *begin != u8::MAX {
            *begin = begin.saturating_sub(STEPS);
        }
    }
    parts.seal();
    write_spm_file(&parts, path).unwrap();
}

/// The broken limits of a model, without those of cost, and its calibration.
fn broken_and_calibration(path: &Path) -> (Vec<String>, Value) {
    let found = json(&fronts(&["--json".as_ref(), path]));
    let broken = found["broken"].as_array().unwrap().iter();
    let broken = broken.map(|b| b.as_str().unwrap().to_string());
    (
        broken.filter(|b| !b.contains("_ns.")).collect(),
        found["models"][0]["dial"].clone(),
    )
}

#[test]
fn errors_stored_twice_too_large_are_told_from_a_mesh_without_finer_choices() {
    let folder = tempfile::tempdir().unwrap();
    let relief = folder.path().join("relief.obj");
    write_mesh(&generate(Shape::Relief, 20_000, 1), &relief).unwrap();
    // Of planes and facets: most of its stretches are far nearer than asked on any front that keeps
    // what is asked.
    let part = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/models/featuretype.stl");
    let (mut counted, mut skipped) = (0, Vec::new());
    for mesh in [&relief, &part] {
        if !mesh.exists() {
            skipped.push(mesh.display().to_string());
            continue;
        }
        let (broken, dial) = broken_and_calibration(mesh);
        // The part is beyond the limit, and the coarsest fronts that keep what is asked are as
        // well.
        let no_choice = |b: &String| b.contains("dial.asked_over_true_p50 (best");
        assert!(broken.iter().all(no_choice), "{broken:?}");
        assert!(
            broken.is_empty() || number(&dial, "asked_over_attainable_p50") > 3.5,
            "{dial}"
        );
        assert!(number(&dial, "vsps_over_coarsest") < 1.25, "{dial}");
        let doubled = folder.path().join("doubled.spm");
        build_with_errors_doubled(read_mesh(mesh).unwrap(), &doubled);
        let (broken, dial) = broken_and_calibration(&doubled);
        let too_fine = |b: &String| b.contains("dial.too_fine_share");
        assert!(broken.iter().any(too_fine), "{broken:?}");
        assert!(broken.iter().all(|b| b.contains("dial.")), "{broken:?}");
        assert!(number(&dial, "vsps_over_coarsest") > 1.25, "{dial}");
        counted += 1;
    }
    assert!(counted > 0);
    if !skipped.is_empty() {
        let _ = writeln!(
            std::io::stderr(),
            "skipped, not there: {}",
            skipped.join(", ")
        );
    }
}
