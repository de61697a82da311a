//! The steps of a build in their order.

use crate::assemble;
use crate::clean::clean;
use crate::error::BuildError;
use crate::import::read_mesh;
use crate::manifold::cut_to_manifold;
use crate::mesh::SoupMesh;
use crate::order;
use crate::progress::Progress;
use crate::simplify;
use crate::write::{check_room, try_output, write_spm_file};
use spm::{ErrorScale, SpmParts};
use std::path::Path;

/// Counted up whenever the builder makes another file from the same mesh; part of a cache's key.
pub const BUILDER_VERSION: u32 = 20;

/// What the user may set (thesis Table 4.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BuildOptions {
    /// Faces of the base mesh to aim at; by default 300 to 700, growing with the mesh.
    pub base_faces: Option<u32>,
    /// Cells along the longest side, a power of two up to 1024; by default such that an occupied
    /// region owns about 40 to 140 faces at median.
    pub regions: Option<u32>,
}

/// What a build of a file took.
#[derive(Debug, Clone, PartialEq)]
pub struct BuildReport {
    /// What was built.
    pub parts: SpmParts,
    /// Length of the file, bytes.
    pub file_bytes: u64,
}

impl BuildOptions {
    /// Checks what was typed.
    ///
    /// # Errors
    /// When a number is out of range.
    pub fn check(&self) -> Result<(), BuildError> {
        if let Some(divisions) = self.regions
            && !(divisions.is_power_of_two() && divisions <= spm::RegionGrid::MAX_DIVISIONS)
        {
            return Err(BuildError::Option(format!(
                "--regions {divisions} is not possible: give a power of two from 1 to {}",
                spm::RegionGrid::MAX_DIVISIONS
            )));
        }
        if self.base_faces == Some(0) {
            return Err(BuildError::Option(
                "--base-faces 0 is not possible: a mesh keeps at least one face".to_string(),
            ));
        }
        Ok(())
    }
}

/// Builds all that an SPM file holds, content hash included.
///
/// # Errors
/// When an option is out of range or nothing of the mesh is left after cleaning.
pub fn build_model(
    mesh: SoupMesh,
    options: &BuildOptions,
    progress: &dyn Progress,
) -> Result<SpmParts, BuildError> {
    options.check()?;
    progress.phase("cleaning", mesh.triangles.len() as u64);
    let cleaned = clean(mesh)?;
    progress.phase("cutting to a manifold", cleaned.triangles.len() as u64);
    let manifold = cut_to_manifold(&cleaned);
    let origin = cleaned.origin;
    drop(cleaned);
    progress.phase("ordering the tree", manifold.triangles.len() as u64);
    let manifold = order::in_tree_order(manifold);
    let target = options
        .base_faces
        .unwrap_or_else(|| (manifold.triangles.len() as u32 / 100).clamp(300, 700));
    let scale = ErrorScale::for_diagonal(assemble::bounds_of(&manifold).diagonal());
    let history = simplify::simplify(&manifold, target, scale, progress);
    assemble::assemble(origin, &manifold, history, options.regions, progress)
}

/// Builds an SPM file from a mesh file. The file appears whole or not at all.
///
/// # Errors
/// When the mesh cannot be read or built, or there is no room for the file, or it cannot be
/// written; the file is named.
pub fn build_file(
    input: &Path,
    output: &Path,
    options: &BuildOptions,
    progress: &dyn Progress,
) -> Result<BuildReport, BuildError> {
    options.check()?;
    let in_input = |e: BuildError| e.in_file(input);
    let in_output = |e| BuildError::Io(e).in_file(output);
    try_output(output).map_err(in_output)?;
    progress.phase("reading", 0);
    let mesh = read_mesh(input).map_err(in_input)?;
    check_room(output, mesh.triangles.len() as u64)?;
    let parts = build_model(mesh, options, progress).map_err(in_input)?;
    progress.phase("writing", 0);
    let file_bytes = write_spm_file(&parts, output).map_err(in_output)?;
    Ok(BuildReport { parts, file_bytes })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::{Shape, generate};
    use crate::import::{MeshFormat, read_mesh_bytes};
    use crate::progress::NoProgress;
    use crate::write::write_mesh;
    use std::cell::Cell;

    /// A relief of whole numbers over a square, and a fan: no function of a library decides a bit.
    fn mesh() -> SoupMesh {
        const SIDE: u32 = 40;
        let mut mesh = SoupMesh::default();
        for j in 0..SIDE {
            for i in 0..SIDE {
                let height = (i * i * 7 + j * j * 13 + i * j) % 17;
                mesh.positions
                    .push([f64::from(i), f64::from(j), f64::from(height) / 8.0]);
                if i > 0 && j > 0 {
                    let [a, b] = [(j - 1) * SIDE + i - 1, (j - 1) * SIDE + i];
                    let [c, d] = [a + SIDE, b + SIDE];
                    mesh.triangles.extend([[a, b, d], [a, d, c]]);
                }
            }
        }
        // A fan around a vertex beside it.
        let tip = mesh.positions.len() as u32;
        mesh.positions.push([100.0, 0.0, 5.0]);
        for k in 0..100 {
            let along = f64::from(k);
            mesh.positions
                .push([50.0 + along, along * (100.0 - along) / 50.0 - 60.0, 0.0]);
        }
        mesh.triangles
            .extend((1..100).map(|k| [tip, tip + k, tip + k + 1]));
        mesh
    }

    /// Counts the phases that a build goes through.
    #[derive(Default)]
    struct Phases(Cell<u32>);

    impl Progress for Phases {
        fn phase(&self, _: &'static str, _: u64) {
            self.0.set(self.0.get() + 1);
        }
        fn done(&self, _: u64) {}
    }

    #[test]
    fn an_output_that_cannot_be_written_is_named_before_anything_is_done() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        write_mesh(&mesh(), &at("good.ply")).unwrap();
        std::fs::create_dir(at("folder.spm")).unwrap();
        let phases = Phases::default();
        let options = BuildOptions::default();
        let build = |output: &str| build_file(&at("good.ply"), &at(output), &options, &phases);
        for output in ["nowhere/out.spm", "folder.spm"] {
            let sentence = build(output).unwrap_err().to_string();
            assert!(sentence.contains(output), "{sentence}");
            assert_eq!(phases.0.get(), 0, "{output}");
        }
        build("out.spm").unwrap();
        assert!(phases.0.get() > 0);
    }

    /// A number that tells bytes apart.
    fn digest(bytes: impl IntoIterator<Item = u8>) -> u64 {
        bytes.into_iter().fold(0, |sum: u64, byte| {
            (sum.rotate_left(5) ^ u64::from(byte)).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        })
    }

    fn digest_of_soup(mesh: &SoupMesh) -> u64 {
        let positions = mesh.positions.as_flattened().iter();
        let corners = mesh.triangles.as_flattened().iter();
        let positions = positions.flat_map(|x| x.to_bits().to_le_bytes());
        digest(positions.chain(corners.flat_map(|v| v.to_le_bytes())))
    }

    fn digest_of_file(options: &BuildOptions) -> u64 {
        let parts = build_model(mesh(), options, &NoProgress).unwrap();
        let mut bytes = Vec::new();
        spm::write_spm(&parts, &mut bytes).unwrap();
        digest(bytes)
    }

    /// What all of the builder makes: of the mesh above the whole file, with a small base mesh and
    /// by default, what it reads, and the shapes of which no function of a library decides a bit.
    fn all_that_is_made() -> Vec<String> {
        let corpus: [(&str, MeshFormat, &[u8]); 4] = [
            (
                "polygons.obj",
                MeshFormat::Obj,
                include_bytes!("../../tests/corpus/polygons.obj"),
            ),
            (
                "text.stl",
                MeshFormat::Stl,
                include_bytes!("../../tests/corpus/text.stl"),
            ),
            (
                "plate.spmtxt",
                MeshFormat::Thesis,
                include_bytes!("../../tests/corpus/plate.spmtxt"),
            ),
            (
                "torus.cdpm",
                MeshFormat::Thesis,
                include_bytes!("../../tests/corpus/torus.cdpm"),
            ),
        ];
        let small = BuildOptions {
            base_faces: Some(60),
            regions: Some(8),
        };
        let mut made = vec![
            ("small base".to_owned(), digest_of_file(&small)),
            (
                "default".to_owned(),
                digest_of_file(&BuildOptions::default()),
            ),
        ];
        made.extend(corpus.map(|(name, format, bytes)| {
            let soup = read_mesh_bytes(bytes, format).unwrap();
            (name.to_owned(), digest_of_soup(&soup))
        }));
        made.extend([Shape::Plate, Shape::Wedge, Shape::Terrain].map(|shape| {
            let soup = generate(shape, 2000, 1);
            (shape.to_string(), digest_of_soup(&soup))
        }));
        let lines = made.iter().map(|(what, sum)| format!("{what} {sum:016x}"));
        let version = format!("builder {BUILDER_VERSION}");
        std::iter::once(version).chain(lines).collect()
    }

    /// A cache keeps what another builder made under its version: whoever changes what is built
    /// raises [`BUILDER_VERSION`], and notes here what it makes now. (Another format of the file
    /// changes the first two as well, and has a version of its own.)
    #[test]
    fn what_is_built_belongs_to_this_version_of_the_builder() {
        let expected = [
            "builder 20",
            "small base 57703167f413efea",
            "default 4346f7a58a0034a9",
            "polygons.obj 3d3787d84cebe538",
            "text.stl 41ea51af9c0179bc",
            "plate.spmtxt ce553a681bfd4141",
            "torus.cdpm 13f3797bdc11d293",
            "plate a025a79bb230dbea",
            "wedge 59703631a9b6fd5d",
            "terrain 7d0236c9c928a522",
        ];
        assert_eq!(all_that_is_made(), expected);
    }
}
