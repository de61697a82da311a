//! Models as they are named on the command line.

use super::Model;
use crate::failure::Failure;
use scene::ModelSource;
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, SoupMesh};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Seed of a generated shape.
const SHAPE_SEED: u64 = 1;

/// A short name and the source: a shape with its faces (`SHAPE:FACES`), or a file.
///
/// # Errors
/// One sentence for a shape without a number of faces.
pub fn source(typed: &str) -> Result<(String, ModelSource), Failure> {
    if let Some((shape, faces)) = typed.split_once(':')
        && shape.parse::<Shape>().is_ok()
    {
        let faces = faces.parse().map_err(|_| {
            Failure::Input(format!(
                "{typed}: write the number of faces after the shape, such as {shape}:20000"
            ))
        })?;
        let source = ModelSource::Generate {
            shape: shape.to_string(),
            faces,
        };
        return Ok((format!("{shape}-{faces}"), source));
    }
    let path = PathBuf::from(typed);
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    Ok((name.into_owned(), ModelSource::File(path)))
}

/// The names that were typed, or the default ones when there are none.
#[must_use]
pub fn typed_or(typed: &[String], default: &[&str]) -> Vec<String> {
    if typed.is_empty() {
        default.iter().map(ToString::to_string).collect()
    } else {
        typed.to_vec()
    }
}

/// A name for files of a model of which no other of these names says the same: its own, or with a
/// number behind it. It joins the names.
pub fn unused(name: &str, names: &mut BTreeSet<String>) -> String {
    let numbered = (2_u64..).map(|number| format!("{name}-{number}"));
    let mut all = std::iter::once(name.to_string()).chain(numbered);
    let free = all.find(|name| names.insert(name.clone()));
    free.unwrap_or_default()
}

/// Opens or builds a model that was typed, in memory.
///
/// # Errors
/// One sentence that names it.
pub fn open(typed: &str) -> Result<Model, Failure> {
    open_with(typed, &BuildOptions::default())
}

/// The same with other options for a mesh; an SPM file is taken as it is.
///
/// # Errors
/// One sentence that names it.
pub fn open_with(typed: &str, options: &BuildOptions) -> Result<Model, Failure> {
    match source(typed)? {
        (_, ModelSource::File(path)) => Model::open(&path, options, &NoProgress),
        (name, ModelSource::Generate { shape, faces }) => {
            let mesh = shape_soup(&shape, faces)?;
            Model::build(name, mesh, options, &NoProgress)
                .map_err(|error| Failure::Run(error.to_string()))
        }
    }
}

/// The mesh of a generated shape.
///
/// # Errors
/// When there is no such shape.
pub fn shape_soup(shape: &str, faces: u32) -> Result<SoupMesh, Failure> {
    let parsed: Shape = shape
        .parse()
        .map_err(|_| Failure::Input(format!("{shape} is no shape")))?;
    Ok(generate(parsed, faces, SHAPE_SEED))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_of_one_name_get_names_of_their_own() {
        let mut names = BTreeSet::new();
        let typed = ["cow.ply", "cow.ply", "cow.ply-2", "cow.ply"];
        let found = typed.map(|name| unused(name, &mut names));
        assert_eq!(found, ["cow.ply", "cow.ply-2", "cow.ply-2-2", "cow.ply-3"]);
    }
}
