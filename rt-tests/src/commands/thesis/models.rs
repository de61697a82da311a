//! The models of Table 4.1, and what the thesis says of them.

use super::result::{Figure, Quote, Series};
use crate::failure::Failure;
use crate::models::Model;
use crate::models::source::open_with;
use crate::report::chart::COLORS;
use spm_builder::{BuildOptions, is_mesh_file, read_mesh};
use std::path::{Path, PathBuf};

/// A row of Table 4.1.
#[derive(Debug, PartialEq, Eq)]
pub struct Published {
    /// The model.
    pub name: &'static str,
    /// Faces and vertices of the full mesh.
    pub full: [u32; 2],
    /// Faces and vertices of the base mesh.
    pub base: [u32; 2],
    /// Vertex split records.
    pub vsps: u32,
    /// Height of the AB-tree.
    pub height: u32,
}

/// Table 4.1 as printed.
pub const TABLE: [Published; 4] = [
    Published {
        name: "sphere",
        full: [496, 2050],
        base: [50, 27],
        vsps: 2023,
        height: 12,
    },
    Published {
        name: "cow",
        full: [5804, 2904],
        base: [704, 355],
        vsps: 2549,
        height: 12,
    },
    Published {
        name: "bunny",
        full: [37576, 20000],
        base: [500, 1406],
        vsps: 18594,
        height: 16,
    },
    Published {
        name: "dragon",
        full: [50760, 25418],
        base: [500, 258],
        vsps: 25160,
        height: 16,
    },
];

/// The sphere where none is given: one of its vertices makes two faces.
const SPHERE: &str = "sphere:4096";

/// A model of the study, built with the base mesh of Table 4.1.
pub struct StudyModel {
    /// Its name.
    pub name: String,
    /// As it was typed or found.
    pub typed: String,
    /// Its row of the table, if it has one.
    pub published: Option<&'static Published>,
    /// The model.
    pub model: Model,
    /// Its colour in every picture.
    pub color: &'static str,
}

impl StudyModel {
    fn open(
        typed: String,
        published: Option<&'static Published>,
        color: &'static str,
    ) -> Result<Self, Failure> {
        let options = BuildOptions {
            base_faces: published.map(|row| row.base[0]),
            ..BuildOptions::default()
        };
        let model = open_with(&typed, &options)?;
        Ok(Self {
            name: published.map_or(model.name.clone(), |row| row.name.to_string()),
            typed,
            published,
            model,
            color,
        })
    }

    /// Faces of the full mesh.
    #[must_use]
    pub fn faces(&self) -> u32 {
        self.model.file.model_header().faces
    }
}

/// Opens the models of some files and folders, in the order of Table 4.1, then the others; the
/// sphere is generated where none is given. Says which file became which.
///
/// # Errors
/// One sentence that names the file.
pub fn open_all(paths: &[PathBuf]) -> Result<Vec<StudyModel>, Failure> {
    let colors = COLORS.into_iter().cycle();
    let opened = choose(paths)?.into_iter().zip(colors);
    opened
        .map(|((typed, row), color)| {
            match row {
                Some(row) => eprintln!("{} of Table 4.1: {typed}", row.name),
                None => eprintln!("not of Table 4.1: {typed}"),
            }
            StudyModel::open(typed, row, color)
        })
        .collect()
}

/// A model as it is typed, and its row of the table, if it has one.
type Typed = (String, Option<&'static Published>);

/// The models of Table 4.1 among some files and those of some folders, and what else was named: of
/// a folder only the table's are taken.
///
/// # Errors
/// One sentence that names the file.
fn choose(paths: &[PathBuf]) -> Result<Vec<Typed>, Failure> {
    let mut given: Vec<PathBuf> = Vec::new();
    for path in paths {
        if path.is_dir() {
            given.extend(mesh_files(path)?);
        } else {
            given.push(path.clone());
        }
    }
    let mut chosen: Vec<&PathBuf> = Vec::new();
    let mut typed: Vec<Typed> = Vec::new();
    for row in &TABLE {
        let is_free = |path: &&PathBuf| is_of(path, row) && !chosen.contains(path);
        let own: Vec<&PathBuf> = given.iter().filter(is_free).collect();
        match nearest(&own, row)? {
            Some(path) => {
                chosen.push(path);
                typed.push((path.display().to_string(), Some(row)));
            }
            None if row.name == "sphere" => typed.push((SPHERE.to_string(), Some(row))),
            None => {}
        }
    }
    let rest = paths
        .iter()
        .filter(|path| !path.is_dir() && !chosen.contains(path));
    typed.extend(rest.map(|path| (path.display().to_string(), None)));
    Ok(typed)
}

/// Mesh files of a folder, by name.
fn mesh_files(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let refused = |error| Failure::Input(format!("{}: {error}", folder.display()));
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(refused)? {
        let path = entry.map_err(refused)?.path();
        if is_mesh_file(&path) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// Whether a file is named after a row of the table: one of the words of its name is the row's. A
/// word ends where the letters do, so that a number may follow.
fn is_of(path: &Path, row: &Published) -> bool {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let stem = stem.to_lowercase();
    let mut words = stem.split(|c: char| !c.is_alphabetic());
    words.any(|word| word == row.name)
}

/// Of several files the one whose vertices are nearest in number to those of the row.
fn nearest<'a>(files: &[&'a PathBuf], row: &Published) -> Result<Option<&'a PathBuf>, Failure> {
    if files.len() < 2 {
        return Ok(files.first().copied());
    }
    let mut best = None;
    for &path in files {
        let mesh =
            read_mesh(path).map_err(|error| Failure::Input(error.in_file(path).to_string()))?;
        let apart = (mesh.positions.len() as u32).abs_diff(row.full[1]);
        if best.is_none_or(|(least, _)| apart < least) {
            best = Some((apart, path));
        }
    }
    Ok(best.map(|(_, path)| path))
}

/// Table 4.1.
#[must_use]
pub fn table(models: &[StudyModel]) -> Figure {
    let mut series = Vec::new();
    for of in models {
        let header = of.model.file.model_header();
        let vertices = header.base_vertices + header.vsps;
        let height = header.faces.next_power_of_two().ilog2();
        let row = of.published;
        let mut add = |what: &str, ours: u32, published: Option<u32>| {
            let name = format!("{}: {what}", of.name);
            let published: Vec<f64> = published.into_iter().map(f64::from).collect();
            series.push(Series::new(name, "", f64::from(ours)).beside(&published));
        };
        add(
            "faces of the full mesh",
            header.faces,
            row.map(|r| r.full[0]),
        );
        add(
            "vertices of the full mesh",
            vertices,
            row.map(|r| r.full[1]),
        );
        add(
            "faces of the base mesh",
            header.base_faces,
            row.map(|r| r.base[0]),
        );
        add(
            "vertices of the base mesh",
            header.base_vertices,
            row.map(|r| r.base[1]),
        );
        add("vertex split records", header.vsps, row.map(|r| r.vsps));
        add("height of the AB-tree", height, row.map(|r| r.height));
    }
    Figure {
        figure: "table4.1",
        title: "The models",
        series,
        says: "The models were built with the thesis's base meshes. The 496 faces of its sphere are a misprint of \
            4096: a closed surface of 2050 vertices has 2 (2050 - 2) faces. Its bunny counts vertices that no face \
            uses, most of the 1406 of its base mesh of 500 faces; we drop them. Its cow has one vertex that two fans \
            share; both cut it. Our height is the logarithm of the faces rounded up, so the cow's is 13 and not 12: \
            a binary tree of height 12 has at most 4096 leaves."
            .to_string(),
        quotes: vec![Quote {
            section: "4.3",
            line: 2521,
            text: "Table 4.1 Parameter Settings for Models",
        }],
        charts: Vec::new(),
        names: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spm_builder::generate::{Shape, generate};
    use spm_builder::write_mesh;

    #[test]
    fn the_thesis_counts_records_as_vertices_less_those_of_the_base_mesh() {
        for row in &TABLE {
            assert_eq!(row.full[1], row.base[1] + row.vsps, "{}", row.name);
        }
    }

    #[test]
    fn files_are_known_by_their_names_and_the_sphere_is_made_where_none_is_given() {
        assert!(is_of(Path::new("a/Stanford-Bunny.obj"), &TABLE[2]));
        assert!(is_of(Path::new("bunny20k.obj"), &TABLE[2]));
        assert!(!is_of(Path::new("bunny/cow.obj"), &TABLE[2]));
        assert!(!is_of(Path::new("hemisphere.obj"), &TABLE[0]));
        assert!(!is_of(Path::new("cowboy.obj"), &TABLE[1]));
        let models = open_all(&[]).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(models.len(), 1);
        let series = table(&models).series;
        assert_eq!(series.len(), 6);
        // 4096 or a few more, from the generator's rings.
        assert!((4000.0..4300.0).contains(&series[0].ours), "{series:?}");
        assert!(open_all(&[PathBuf::from("missing/dragon.obj")]).is_err());
    }
    #[test]
    fn a_file_that_was_named_is_measured_if_not_as_a_row_then_as_itself() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        for (name, faces) in [
            ("hemisphere.obj", 500),
            ("cow-left.obj", 500),
            ("cow-right.obj", 5000),
        ] {
            let mesh = generate(Shape::Relief, faces, 1);
            write_mesh(&mesh, &path(name)).expect("it is written");
        }
        let chosen = |names: &[&str]| {
            let paths: Vec<PathBuf> = names.iter().map(|name| path(name)).collect();
            let chosen = choose(&paths).unwrap_or_else(|error| panic!("{error}"));
            let name = |typed: &str| match Path::new(typed).file_name() {
                Some(name) => name.to_string_lossy().into_owned(),
                None => typed.to_string(),
            };
            let chosen = chosen.iter();
            let chosen = chosen.map(|(typed, row)| (name(typed), row.map(|row| row.name)));
            chosen.collect::<Vec<_>>()
        };
        let of = |typed: &str, row: Option<&'static str>| (typed.to_string(), row);
        let sphere = of(SPHERE, Some("sphere"));
        // The cow with the vertices nearest to the table's 2904.
        let cow = of("cow-right.obj", Some("cow"));
        assert_eq!(
            chosen(&["hemisphere.obj", "cow-left.obj", "cow-right.obj"]),
            [
                sphere.clone(),
                cow.clone(),
                of("hemisphere.obj", None),
                of("cow-left.obj", None),
            ]
        );
        // Of a folder only the table's.
        assert_eq!(chosen(&[""]), [sphere.clone(), cow]);
        // One that was named beside its folder is there once.
        let left = of("cow-left.obj", None);
        assert_eq!(
            chosen(&["", "cow-left.obj"]),
            [sphere, of("cow-right.obj", Some("cow")), left]
        );
    }
}
