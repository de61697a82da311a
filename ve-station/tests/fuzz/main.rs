//! Files and messages from hell: mutated from a corpus, always the same ones for a seed.
//!
//! Nothing may panic, hang, or take memory beyond what its length explains, and every refusal is
//! one sentence. `HRTC_FUZZ_ROUNDS` makes the runs longer (800 by default), `HRTC_FUZZ_SEED` other
//! ones. An input that fails is kept in a file, named in the message: move it to `tests/corpus`,
//! where every run starts from it.

#[path = "../common/mod.rs"]
mod common;
mod memory;
mod meshes;
mod mutate;
mod spm_files;
mod station;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The tests take turns, so that the memory counted is that of one.
fn turn() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

fn number(variable: &str, default: u64) -> u64 {
    std::env::var(variable).map_or(default, |text| text.parse().expect(variable))
}

/// Inputs of a run, and its seed, printed.
fn rounds_and_seed() -> (u64, u64) {
    let (rounds, seed) = (number("HRTC_FUZZ_ROUNDS", 800), number("HRTC_FUZZ_SEED", 1));
    println!("seed {seed}, {rounds} rounds");
    (rounds, seed)
}

/// Files of the corpus with one of these endings, by name.
fn corpus(endings: &[&str]) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus");
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| {
            let ending = path.extension().and_then(|e| e.to_str());
            endings.contains(&ending.unwrap_or_default())
        })
        .collect();
    paths.sort();
    assert!(!paths.is_empty(), "no corpus for {endings:?}");
    paths
        .into_iter()
        .map(|path| {
            let bytes = std::fs::read(&path).unwrap();
            (path, bytes)
        })
        .collect()
}

/// Runs a check on an input; keeps the input when it panics.
fn keeping(bytes: &[u8], ending: &str, check: impl FnOnce()) {
    let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(check));
    if let Err(panic) = result {
        let hash = xxhash_rust::xxh3::xxh3_64(bytes);
        let path =
            Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("failed-{hash:016x}.{ending}"));
        std::fs::write(&path, bytes).unwrap();
        println!("the input that failed is kept in {}", path.display());
        std::panic::resume_unwind(panic);
    }
}

/// One line that a person can read.
fn check_sentence(text: &str) {
    assert!(!text.trim().is_empty() && text.len() < 400, "{text:?}");
    assert!(!text.chars().any(char::is_control), "{text:?}");
}
