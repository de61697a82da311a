//! Which module imports which, and circles among them.

use super::sources::{Crate, is_for_tests, is_test, read, rust_files};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use syn::visit::{self, Visit};

/// Who imports whom.
type Edges = BTreeMap<String, BTreeSet<String>>;

/// The circles of a graph, each as a line; a circle is a set of nodes that all reach each other.
pub fn circles(edges: &Edges) -> Vec<String> {
    let reached: Edges = edges
        .keys()
        .map(|from| (from.clone(), all_reached(edges, from)))
        .collect();
    let mut found = BTreeSet::new();
    for (from, to) in &reached {
        let circle: BTreeSet<&str> = to
            .iter()
            .filter(|other| reached.get(*other).is_some_and(|back| back.contains(from)))
            .map(String::as_str)
            .collect();
        if !circle.is_empty() {
            found.insert(circle.into_iter().collect::<Vec<_>>().join(" - "));
        }
    }
    found.into_iter().collect()
}

fn all_reached(edges: &Edges, from: &str) -> BTreeSet<String> {
    let mut reached = BTreeSet::new();
    let mut todo: Vec<&String> = edges.get(from).into_iter().flatten().collect();
    while let Some(next) = todo.pop() {
        if reached.insert(next.clone()) {
            todo.extend(edges.get(next).into_iter().flatten());
        }
    }
    reached
}

/// The circles among the modules of a crate: at its root among all, further down among those with
/// a folder in the circle.
pub fn circles_of_crate(one: &Crate) -> Vec<String> {
    let source = one.folder.join("src");
    // By parent: which child imports which other child.
    let mut graphs: BTreeMap<Vec<String>, Edges> = BTreeMap::new();
    for path in rust_files(&source).iter().filter(|path| !is_test(path)) {
        let own = module_of(path.strip_prefix(&source).expect("it lies there"));
        let mut imports = Imports {
            own: own.clone(),
            all: BTreeSet::new(),
        };
        imports.visit_file(&read(path).syntax);
        for target in imports.all {
            let common = own.iter().zip(&target).take_while(|(a, b)| a == b).count();
            let (Some(from), Some(to)) = (own.get(common), target.get(common)) else {
                continue;
            };
            let parent = own[..common].to_vec();
            if is_module(&source, &parent, to) {
                let edges = graphs.entry(parent).or_default();
                edges.entry(from.clone()).or_default().insert(to.clone());
            }
        }
    }
    let mut found = Vec::new();
    for (parent, edges) in &graphs {
        let folder = parent.iter().fold(source.clone(), |at, part| at.join(part));
        for circle in circles(edges) {
            let has_folder = circle.split(" - ").any(|name| folder.join(name).is_dir());
            if parent.is_empty() || has_folder {
                found.push(format!("{} {}: {circle}", one.name, parent.join("::")));
            }
        }
    }
    found
}

/// The module that a file holds: `a/b.rs` and `a/b/mod.rs` hold `a::b`.
fn module_of(path: &Path) -> Vec<String> {
    let parts = path.with_extension("");
    let mut parts: Vec<String> = parts
        .components()
        .map(|part| part.as_os_str().to_string_lossy().into_owned())
        .collect();
    if matches!(
        parts.last().map(String::as_str),
        Some("mod" | "lib" | "main")
    ) {
        parts.pop();
    }
    parts
}

fn is_module(source: &Path, parent: &[String], name: &str) -> bool {
    let folder = parent
        .iter()
        .fold(source.to_path_buf(), |at, part| at.join(part));
    folder.join(name).is_dir() || folder.join(format!("{name}.rs")).is_file()
}

/// Paths of a file that begin in its own crate.
struct Imports {
    own: Vec<String>,
    all: BTreeSet<Vec<String>>,
}

impl Imports {
    /// A path as written, from the crate's root; `None` when it begins elsewhere.
    fn resolved(&self, path: &[String]) -> Option<Vec<String>> {
        match path.first().map(String::as_str) {
            Some("crate") => Some(path[1..].to_vec()),
            Some("self") => Some([&self.own[..], &path[1..]].concat()),
            Some("super") => {
                let up = path.iter().take_while(|part| *part == "super").count();
                let base = self.own.len().checked_sub(up)?;
                Some([&self.own[..base], &path[up..]].concat())
            }
            _ => None,
        }
    }

    fn add_tree(&mut self, tree: &syn::UseTree, before: &mut Vec<String>) {
        match tree {
            syn::UseTree::Path(path) => {
                before.push(path.ident.to_string());
                self.add_tree(&path.tree, before);
                before.pop();
            }
            syn::UseTree::Group(group) => {
                for item in &group.items {
                    self.add_tree(item, before);
                }
            }
            syn::UseTree::Name(name) => self.add_leaf(&name.ident, before),
            syn::UseTree::Rename(name) => self.add_leaf(&name.ident, before),
            syn::UseTree::Glob(_) => {
                let target = self.resolved(before);
                self.all.extend(target);
            }
        }
    }

    fn add_leaf(&mut self, name: &syn::Ident, before: &[String]) {
        let whole = [before, &[name.to_string()]].concat();
        let target = self.resolved(&whole);
        self.all.extend(target);
    }
}

impl<'ast> Visit<'ast> for Imports {
    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if is_for_tests(&item.attrs) {
            return;
        }
        self.own.push(item.ident.to_string());
        visit::visit_item_mod(self, item);
        self.own.pop();
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        // A re-export of a child says where a name lives, not who needs whom.
        self.add_tree(&item.tree, &mut Vec::new());
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let parts: Vec<String> = path
            .segments
            .iter()
            .map(|part| part.ident.to_string())
            .collect();
        let target = self.resolved(&parts);
        self.all.extend(target.filter(|_| parts.len() > 1));
        visit::visit_path(self, path);
    }
}
