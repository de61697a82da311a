//! The house rules of this project: what a reader may rely on wherever the tree is opened.
//!
//! | module | holds |
//! |---|---|
//! | [`sources`] | the crates and source files of the workspace, parsed |
//! | [`functions`] | length and nesting of functions |
//! | [`rooms`] | which module imports which, and circles among them |
//! | [`words`] | the private words that no identifier may use |
//! | [`citations`] | the papers that comments cite |
//! | [`portable`] | functions that differ from machine to machine |
//! | [`walks`] | the two walks through the core, function by function |

mod citations;
mod functions;
mod portable;
mod rooms;
mod sources;
mod walks;
mod words;

use sources::{Crate, crates, product_files, root, rust_files};
use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

/// Lines of a product function, from its signature to its closing brace.
const MAX_FUNCTION_LINES: usize = 70;
/// Control flow inside control flow: `if`, `match`, loops and closures.
const MAX_NESTING: usize = 5;
/// Lines of a file.
const MAX_FILE_LINES: usize = 600;
/// Columns of a comment: rustfmt's width, which it does not apply to them.
const MAX_COLUMNS: usize = 100;
/// Crates that read no clock, open no file, start no thread and iterate in no random order.
const PURE: [&str; 9] = [
    "geometry",
    "ab-tree",
    "spm",
    "protocol",
    "file-transfer",
    "scene",
    "hrtc-core",
    "station-core",
    "simulator",
];

/// Fails with all findings at once, one a line.
fn assert_none(what: &str, findings: &[String]) {
    assert!(
        findings.is_empty(),
        "{} {what}:\n{}",
        findings.len(),
        findings.join("\n")
    );
}

#[test]
fn functions_are_short_and_flat() {
    let mut findings = Vec::new();
    for file in product_files() {
        for function in functions::of_file(&file) {
            if function.lines > MAX_FUNCTION_LINES {
                findings.push(format!("{}: {} lines", function.place, function.lines));
            }
            if function.nesting > MAX_NESTING {
                findings.push(format!(
                    "{}: nested {} deep",
                    function.place, function.nesting
                ));
            }
        }
    }
    assert_none("functions are too long or nested too deep", &findings);
}

#[test]
fn files_are_short_and_lines_fit() {
    let mut findings = Vec::new();
    for path in rust_files(&root()) {
        let text = std::fs::read_to_string(&path).expect("a source file is read");
        let shown = sources::shown(&path);
        if text.lines().count() > MAX_FILE_LINES {
            findings.push(format!("{shown}: {} lines", text.lines().count()));
        }
        // Code has rustfmt; a row of a table cannot be wrapped.
        let is_prose = |line: &str| line.starts_with("//") && !line.starts_with("//! |");
        for (number, line) in (1..).zip(text.lines()) {
            if line.chars().count() > MAX_COLUMNS && is_prose(line.trim_start()) {
                findings.push(format!(
                    "{shown}:{number}: {} columns",
                    line.chars().count()
                ));
            }
        }
    }
    assert_none("files or lines are too long", &findings);
}

#[test]
fn what_comments_cite_is_in_the_references() {
    let path = root().join("shared/REFERENCES.md");
    let page = std::fs::read_to_string(path).expect("the references are read");
    let keys = citations::keys(&page);
    let (mut findings, mut cited) = (Vec::new(), BTreeSet::new());
    for path in rust_files(&root()) {
        let text = std::fs::read_to_string(&path).expect("a source file is read");
        for key in citations::of_source(&text) {
            if !keys.contains(key.as_str()) {
                findings.push(format!("{}: {key}", sources::shown(&path)));
            }
            cited.insert(key);
        }
    }
    assert_none("citations have no line in shared/REFERENCES.md", &findings);
    assert!(cited.len() > 20, "citations were found: {cited:?}");
}

#[test]
fn no_crate_depends_on_itself() {
    let crates = crates();
    let edges: BTreeMap<String, BTreeSet<String>> = crates
        .iter()
        .map(|one| (one.name.clone(), one.dependencies.clone()))
        .collect();
    assert_none("circles of crates", &rooms::circles(&edges));
}

#[test]
fn no_folder_imports_in_a_circle() {
    let findings: Vec<String> = crates().iter().flat_map(rooms::circles_of_crate).collect();
    assert_none("circles of folders", &findings);
}

#[test]
fn reading_an_spm_pulls_in_no_transport_and_no_scene() {
    let crates = crates();
    let mut todo = vec!["spm".to_string()];
    let mut pulled = BTreeSet::new();
    while let Some(name) = todo.pop() {
        if !pulled.insert(name.clone()) {
            continue;
        }
        let own = crates.iter().find(|one| one.name == name);
        todo.extend(
            own.into_iter()
                .flat_map(|one| one.dependencies.iter().cloned()),
        );
    }
    assert!(
        pulled.contains("geometry"),
        "the dependencies were read: {pulled:?}"
    );
    for foreign in [
        "iceoryx2",
        "toml",
        "png",
        "serde",
        "protocol",
        "transport",
        "scene",
    ] {
        let found = pulled.iter().find(|name| name.starts_with(foreign));
        assert_eq!(found, None, "of {pulled:?}");
    }
}

#[test]
fn pure_crates_deny_clocks_files_and_threads_at_their_root() {
    let crates = crates();
    for name in PURE {
        let one = crates.iter().find(|one| one.name == name);
        let Crate { folder, .. } = one.unwrap_or_else(|| panic!("there is no crate {name}"));
        let text = std::fs::read_to_string(folder.join("src/lib.rs")).expect("lib.rs is read");
        let lint = "#![deny(clippy::disallowed_methods, clippy::disallowed_types)]";
        assert!(text.contains(lint), "{name} does not say {lint}");
    }
    // Once, at the root: not again in a module.
    let again: Vec<String> = product_files()
        .iter()
        .filter(|file| !file.shown.ends_with("lib.rs") && file.text.contains("clippy::disallowed"))
        .map(|file| file.shown.clone())
        .collect();
    assert_none("modules deny or allow it again", &again);
}

/// What the tick, its device, the station and the builder compute is the same on every machine.
#[test]
fn the_cores_take_nothing_from_the_c_library() {
    let crates = crates();
    let others = ["simulated-device", "spm-builder"];
    let is_core = |name: &str| PURE.contains(&name) || others.contains(&name);
    let folders: Vec<_> = crates
        .iter()
        .filter(|one| is_core(&one.name))
        .map(|one| sources::shown(&one.folder.join("src")))
        .collect();
    let files = product_files();
    let of_cores: Vec<_> = files
        .iter()
        .filter(|file| folders.iter().any(|folder| file.shown.starts_with(folder)))
        .collect();
    assert!(of_cores.len() > 100, "{} files", of_cores.len());
    let findings: Vec<String> = of_cores
        .into_iter()
        .flat_map(portable::calls_of_the_c_library)
        .collect();
    assert_none(
        "calls differ from machine to machine; see geometry::portable",
        &findings,
    );
}

#[test]
fn identifiers_are_the_words_of_the_field() {
    let findings: Vec<String> = product_files()
        .iter()
        .flat_map(words::private_words)
        .collect();
    assert_none("identifiers are words of this project only", &findings);
}

#[test]
fn the_walks_through_the_core_are_short() {
    walks::assert_walk("device sample to force", &walks::SAMPLE_TO_FORCE, 12);
    walks::assert_walk("prediction to refined face", &walks::PREDICTION_TO_FACE, 14);
}

#[test]
fn every_path_in_the_readme_exists() {
    let text = std::fs::read_to_string(root().join("README.md")).expect("README.md is read");
    let mut missing = Vec::new();
    let mut named = 0;
    for path in text.split('`').skip(1).step_by(2) {
        let is_path = path.contains('/') && !path.contains([' ', '{', '*', ':', '=', '$', '<']);
        let made = ["reports/", "target/", "../", "/etc/", "/dev/", "X/", "~"];
        if is_path && !made.iter().any(|start| path.starts_with(start)) {
            named += 1;
            if !root().join(path).exists() {
                missing.push(path.to_string());
            }
        }
    }
    assert!(named > 10, "the README names its folders: {named}");
    assert_none("paths of the README do not exist", &missing);
}

/// A link is of a feature, and those who build without it have none of its crates.
#[test]
fn the_default_build_has_no_crate_of_the_link() {
    let mut tree = Command::new(env!("CARGO"));
    tree.args(["tree", "--workspace", "--edges=normal,build"]);
    tree.args(["--prefix=none", "--offline", "--locked"]);
    let output = tree.current_dir(root()).output().expect("cargo is run");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let text = String::from_utf8_lossy(&output.stdout);
    let names: BTreeSet<&str> = text
        .lines()
        .filter_map(|line| line.split(' ').next())
        .collect();
    for own in ["tunnel", "iceoryx2", "hrtc", "ve-station"] {
        assert!(names.contains(own), "the tree was read: {names:?}");
    }
    let of_link = [
        "zenoh",
        "rustls",
        "rcgen",
        "tokio",
        "iceoryx2-link",
        "quinn",
    ];
    let is_of_link = |name: &&&str| of_link.iter().any(|begin| name.starts_with(begin));
    let found: Vec<String> = names
        .iter()
        .filter(is_of_link)
        .map(ToString::to_string)
        .collect();
    assert_none("crates of the link are in the default build", &found);
}

/// What a user reads about a message is of no use when the program says something else.
#[test]
fn every_message_on_the_page_of_two_machines_is_in_the_code() {
    let page = "ve-station/src/lib.rs";
    let text = std::fs::read_to_string(root().join(page)).expect("the page is read");
    let table = text
        .split("| it says |")
        .nth(1)
        .expect("a table of messages");
    let rows = table
        .lines()
        .take_while(|line| line.starts_with("//! |") || line.contains("do |"));
    let messages: Vec<&str> = rows
        .filter_map(|row| row.split('|').nth(1))
        .flat_map(|cell| cell.split('*').skip(1).step_by(2))
        .collect();
    assert!(messages.len() > 20, "the messages were read: {messages:?}");
    let said: Vec<String> = product_files()
        .into_iter()
        .filter(|file| file.shown != page)
        .map(|file| file.text)
        .collect();
    let is_said = |message: &&&str| said.iter().any(|text| text.contains(**message));
    let missing = messages.iter().filter(|message| !is_said(message));
    let missing: Vec<String> = missing.map(|&message| message.into()).collect();
    assert_none("messages of the page are said nowhere", &missing);
}
