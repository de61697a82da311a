//! Mesh files: every reader, and the builder behind it.

use super::common::{active_faces, input_faces, load, refine};
use super::memory::most_bytes;
use super::mutate::Mutator;
use super::{check_sentence, corpus, keeping, rounds_and_seed, turn};
use spm_builder::{BuildOptions, MeshFormat, NoProgress, build_model, read_mesh_bytes};

/// Bytes that a reader may have at once: some for every byte of the file, and a start.
fn allowed(length: usize) -> usize {
    64 * length + (1 << 16)
}

/// Reads, and builds what could be read: the full refinement must be the cleaned input.
fn check(bytes: &[u8], format: MeshFormat, build: bool) -> bool {
    let (read, most) = most_bytes(|| read_mesh_bytes(bytes, format));
    assert!(
        most <= allowed(bytes.len()),
        "reading {} bytes took {most}",
        bytes.len()
    );
    let mesh = match read {
        Ok(mesh) => mesh,
        Err(error) => {
            check_sentence(&error.to_string());
            return false;
        }
    };
    if !build {
        return true;
    }
    let options = BuildOptions {
        base_faces: Some(1),
        regions: None,
    };
    match build_model(mesh.clone(), &options, &NoProgress) {
        Ok(parts) => {
            let mut active = load(&parts);
            refine(&mut active, &parts);
            active.check();
            assert!(active_faces(&active) == input_faces(&mesh));
        }
        Err(error) => check_sentence(&error.to_string()),
    }
    true
}

#[test]
fn mesh_files_of_any_content_build_or_are_refused_in_a_sentence() {
    let _turn = turn();
    let (rounds, seed) = rounds_and_seed();
    let endings: Vec<&str> = MeshFormat::ENDINGS.map(|(ending, _)| ending).to_vec();
    let files = corpus(&endings);
    let format = |path: &std::path::Path| MeshFormat::of(path).unwrap();
    let ending = |path: &std::path::Path| path.extension().unwrap().to_string_lossy().into_owned();
    // rayon's threads are no memory of a reader.
    rayon::scope(|_| {});
    for (path, bytes) in &files {
        keeping(bytes, &ending(path), || {
            check(bytes, format(path), true);
        });
    }
    let full: Vec<_> = files
        .iter()
        .filter(|(_, bytes)| !bytes.is_empty())
        .collect();
    let mut mutator = Mutator::new(seed);
    let mut understood = 0;
    for round in 0..rounds {
        let (path, original) = &full[mutator.below(full.len())];
        let (_, other) = &files[mutator.below(files.len())];
        let mut bytes = original.clone();
        mutator.damage(&mut bytes, other, true);
        keeping(&bytes, &ending(path), || {
            understood += u64::from(check(&bytes, format(path), round % 4 == 0));
        });
    }
    println!("{understood} of {rounds} were understood");
    // Damage that nothing survives, or that nothing notices, would test nothing.
    assert!(understood > rounds / 10 && understood < rounds);
}
