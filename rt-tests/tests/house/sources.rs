//! Crates and source files of the workspace.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// A crate of the workspace.
#[derive(Debug)]
pub struct Crate {
    /// Its name.
    pub name: String,
    /// Its folder.
    pub folder: PathBuf,
    /// What it needs to be built, by name; not what its tests need.
    pub dependencies: BTreeSet<String>,
}

/// A source file of the product.
pub struct Source {
    /// Its path from the root.
    pub shown: String,
    /// Its text.
    pub text: String,
    /// Its syntax.
    pub syntax: syn::File,
}

/// The root of the workspace.
pub fn root() -> PathBuf {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    own.parent()
        .expect("rt-tests lies in the workspace")
        .to_path_buf()
}

/// A path as it is shown: from the root.
pub fn shown(path: &Path) -> String {
    path.strip_prefix(root())
        .unwrap_or(path)
        .display()
        .to_string()
}

/// All crates of the workspace.
pub fn crates() -> Vec<Crate> {
    let text = std::fs::read_to_string(root().join("Cargo.toml")).expect("Cargo.toml is read");
    let table: toml::Table = text.parse().expect("Cargo.toml is TOML");
    let members = table["workspace"]["members"]
        .as_array()
        .expect("a list of members");
    let folders = members
        .iter()
        .map(|member| root().join(member.as_str().expect("a path")));
    let crates: Vec<Crate> = folders.map(read_crate).collect();
    assert!(crates.len() > 10, "{} crates", crates.len());
    crates
}

fn read_crate(folder: PathBuf) -> Crate {
    let text = std::fs::read_to_string(folder.join("Cargo.toml")).expect("a manifest is read");
    let table: toml::Table = text.parse().expect("a manifest is TOML");
    let dependencies = table.get("dependencies").and_then(|value| value.as_table());
    Crate {
        name: table["package"]["name"]
            .as_str()
            .expect("a name")
            .to_string(),
        dependencies: dependencies
            .into_iter()
            .flatten()
            .filter(|(_, typed)| !is_optional(typed))
            .map(|(name, _)| name.clone())
            .collect(),
        folder,
    }
}

/// Whether a dependency comes with a feature only, which no reader of a file turns on.
fn is_optional(typed: &toml::Value) -> bool {
    let optional = typed.get("optional").and_then(toml::Value::as_bool);
    optional.unwrap_or(false)
}

/// All Rust files below a folder, but not what a build leaves there.
pub fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut todo = vec![folder.to_path_buf()];
    while let Some(folder) = todo.pop() {
        for entry in std::fs::read_dir(&folder)
            .expect("a folder is listed")
            .flatten()
        {
            let path = entry.path();
            let name = entry.file_name().to_string_lossy().into_owned();
            if path.is_dir() {
                if name != "target" && !name.starts_with('.') {
                    todo.push(path);
                }
            } else if name.ends_with(".rs") {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

/// The files that make the product: sources of all crates but those of `rt-tests`, without tests.
pub fn product_files() -> Vec<Source> {
    let crates = crates();
    let product = crates
        .iter()
        .filter(|one| !one.folder.starts_with(root().join("rt-tests")));
    let paths = product.flat_map(|one| rust_files(&one.folder.join("src")));
    let files: Vec<Source> = paths
        .filter(|path| !is_test(path))
        .map(|path| read(&path))
        .collect();
    assert!(files.len() > 100, "{} files", files.len());
    files
}

/// Reads and parses a file.
pub fn read(path: &Path) -> Source {
    let text = std::fs::read_to_string(path).expect("a source file is read");
    let syntax = syn::parse_file(&text).unwrap_or_else(|error| panic!("{}: {error}", shown(path)));
    Source {
        shown: shown(path),
        text,
        syntax,
    }
}

/// Whether a file under `src` holds unit tests only.
pub fn is_test(path: &Path) -> bool {
    let is_named_so = |part: &str| matches!(part, "tests" | "testing" | "tests.rs" | "testing.rs");
    path.components().any(|part| {
        let part = part.as_os_str().to_string_lossy();
        is_named_so(&part) || part.ends_with("_tests.rs")
    })
}

/// Whether an item is compiled for tests only.
pub fn is_for_tests(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("test")
            || attribute.path().is_ident("cfg")
                && attribute
                    .parse_args::<syn::Ident>()
                    .is_ok_and(|inner| inner == "test")
    })
}
