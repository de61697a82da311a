//! A hundred thousand splits and collapses of each model: legality by counters equals the adjacency
//! test of thesis 5.2.3, mesh and tree keep every invariant, every front is the image of the full
//! mesh, and no split ever needs a collapse first. The larger models are for the command `rt-tests
//! fronts`.

use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use rt_tests::commands::fronts::legality::{OPERATIONS, chain, walk};
use rt_tests::models::Model;
use rt_tests::models::hard_meshes::HARD_MESHES;
use spm_builder::{BuildOptions, NoProgress, is_mesh_file};
use std::io::Write as _;
use std::path::Path;

fn check(model: &Model) {
    let seed = 21;
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let found = walk(model, &mut random);
    println!("{} (seed {seed}): {found:?}", model.name);
    assert_eq!(found.mismatches, 0, "{}", model.name);
    assert_eq!(found.needed_a_collapse, 0, "{}", model.name);
    assert_eq!(found.wrong_images, 0, "{}", model.name);
    assert!(chain(model) <= 40, "{}: {}", model.name, chain(model));
    if !model.records.is_empty() {
        assert_eq!(found.splits + found.collapses, OPERATIONS, "{}", model.name);
        assert!(found.splits.min(found.collapses) > OPERATIONS / 4);
    }
}

#[test]
fn fronts_of_generated_worst_cases_hold() {
    for (name, make) in HARD_MESHES.iter().filter(|(name, _)| *name != "relief") {
        let options = BuildOptions::default();
        check(&Model::build((*name).to_string(), make(), &options, &NoProgress).unwrap());
    }
}

#[test]
fn fronts_of_small_real_meshes_hold() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/models");
    let Ok(entries) = std::fs::read_dir(&folder) else {
        let _ = writeln!(
            std::io::stderr(),
            "skipped: no mesh was walked, {} is not there",
            folder.display()
        );
        return;
    };
    let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| is_mesh_file(path) && path.metadata().unwrap().len() < 900_000);
    paths.sort();
    for path in paths {
        check(&Model::open(&path, &BuildOptions::default(), &NoProgress).unwrap());
    }
}
