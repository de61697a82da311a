//! The viewer of a run.

use crate::typed::{refusal, rt_tests};
use crate::{run, scene};

#[cfg(feature = "view")]
#[test]
fn a_run_is_shown_while_it_goes_on() {
    let out = tempfile::tempdir().unwrap();
    let target = out.path().join("run.rrd");
    let view = format!("--view={}", target.display());
    let output = run(&scene(), out.path(), &["--seconds=3", &view]);
    let words = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{}", crate::said(&output));
    let shown = words.lines().find(|line| line.contains("viewer: "));
    let shown = shown.unwrap_or_else(|| panic!("{words}"));
    assert!(
        shown.contains("gave the controller's outputs again"),
        "{shown}"
    );
    assert!(target.metadata().unwrap().len() > 100_000);
}

#[test]
fn a_viewer_without_a_recording_or_that_is_not_built_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let output = run(&scene(), &out, &["--view", "--record=off"]);
    let expected = if cfg!(feature = "view") {
        "nothing is recorded"
    } else {
        "--features view"
    };
    let sentence = refusal(&output);
    assert!(sentence.contains(expected), "{sentence}");
    assert!(!out.exists(), "nothing half-written");
}

#[test]
fn a_picture_that_is_the_recording_or_no_png_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("recording.mcap");
    std::fs::write(&recording, b"all that there is of a touch").unwrap();
    let [other, second] = ["other.mcap", "recording-0001.mcap"].map(|of| folder.path().join(of));
    std::fs::write(&second, b"and its second file").unwrap();
    let address = folder.path().join("localhost:9876");
    let cases = [
        ("--out", &recording, "the input"),
        ("--rerun", &recording, "the input"),
        ("--out", &other, ".png"),
        ("--rerun", &second, ".rrd"),
        ("--rerun", &address, ".rrd"),
    ];
    for (option, path, expected) in cases {
        let mut view = rt_tests("view");
        view.arg(&recording).arg(option).arg(path);
        let sentence = refusal(&view.output().unwrap());
        assert!(sentence.contains(expected), "{option}: {sentence}");
    }
    let kept = std::fs::read(&recording).unwrap();
    assert_eq!(kept, b"all that there is of a touch");
    let kept = std::fs::read(&second).unwrap();
    assert_eq!(kept, b"and its second file");
    assert!(!other.exists() && !address.exists());
}
