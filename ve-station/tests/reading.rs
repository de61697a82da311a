//! What reading, cleaning and cutting cost: linear in the size of the mesh, in time and in memory.

use spm_builder::{clean, cut_to_manifold, read_mesh};
use std::process::Command;
use std::time::Instant;

/// Writes a terrain in another process, so that the memory measured is the reader's.
fn terrain(folder: &std::path::Path, faces: u32) -> std::path::PathBuf {
    let path = folder.join(format!("{faces}.ply"));
    let made = Command::new(env!("CARGO_BIN_EXE_ve-station"))
        .args(["generate", "terrain", "--faces", &faces.to_string(), "-o"])
        .arg(&path)
        .output()
        .unwrap();
    assert!(made.status.success());
    path
}

/// The most memory that this process had, bytes.
fn peak() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    let kilobytes: f64 = line
        .and_then(|line| line.split_whitespace().nth(1))
        .and_then(|word| word.parse().ok())
        .unwrap();
    kilobytes * 1024.0
}

/// Seconds, and bytes a face, from the file to a manifold.
fn cost(path: &std::path::Path) -> (f64, f64) {
    let before = peak();
    let start = Instant::now();
    let cleaned = clean(read_mesh(path).unwrap()).unwrap();
    println!(
        "  read and cleaned after {:.2} s",
        start.elapsed().as_secs_f64()
    );
    let mesh = cut_to_manifold(&cleaned);
    let faces = mesh.triangles.len() as f64;
    let (seconds, bytes) = (start.elapsed().as_secs_f64(), (peak() - before).max(0.0));
    println!(
        "{faces} faces: {:.2} us and {:.0} bytes a face",
        1e6 * seconds / faces,
        bytes / faces
    );
    (seconds / faces, bytes / faces)
}

#[test]
fn reading_takes_150_bytes_a_face() {
    let folder = tempfile::tempdir().unwrap();
    let (_, bytes) = cost(&terrain(folder.path(), 400_000));
    assert!(bytes < 150.0, "{bytes} bytes a face");
}

/// `HRTC_READ_FACES=10000000 cargo test --release -p ve-station --test reading -- --ignored
/// --nocapture`
#[test]
#[ignore = "large: run it alone"]
fn reading_takes_four_microseconds_a_face() {
    let faces = std::env::var("HRTC_READ_FACES").map_or(2_000_000, |text| text.parse().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let (seconds, bytes) = cost(&terrain(folder.path(), faces));
    assert!(seconds < 4e-6 && bytes < 150.0);
}
