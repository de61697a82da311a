//! The models of all runs, built once, each in two versions: the second is what the station serves
//! after it was rebuilt under the same name.

use crate::failure::Failure;
use crate::models::Model;
use crate::models::surface::Surface;
use glam::DVec3;
use scene::ScenePlan;
use spm::{SpmFile, write_spm};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, build_model};
use station_core::station::ServedModel;
use std::sync::Arc;

/// Shapes and their faces: small, so that a run's checks by brute force are cheap.
const SHAPES: [(Shape, u32); 8] = [
    (Shape::Sphere, 1_200),
    (Shape::Torus, 2_000),
    (Shape::Terrain, 2_500),
    (Shape::Plate, 500),
    (Shape::Wedge, 1_000),
    (Shape::Relief, 800),
    (Shape::Relief, 2_500),
    (Shape::Relief, 5_000),
];
/// Faces of the base meshes: most of a model is refined.
const BASE_FACES: u32 = 100;

/// Share of an open mesh's sides beside each rim where no hand goes.
const RIM: f64 = 0.2;

/// Bytes of a file that all runs share.
pub type Bytes = Arc<[u8]>;

/// One version of a model.
pub struct Version {
    /// The file with all of its records.
    pub model: Model<Bytes>,
    /// The full mesh, stored coordinates.
    pub full: Surface,
    /// Whether the full mesh is closed, so that it has an inside.
    pub is_closed: bool,
    bytes: Bytes,
}

impl Version {
    fn build(name: &str, shape: Shape, faces: u32, seed: u64) -> Result<Self, Failure> {
        let failed = |error: &dyn std::fmt::Display| Failure::Run(format!("{name}: {error}"));
        let options = BuildOptions {
            base_faces: Some(BASE_FACES),
            ..BuildOptions::default()
        };
        let parts = build_model(generate(shape, faces, seed), &options, &NoProgress)
            .map_err(|error| failed(&error))?;
        let mut bytes = Vec::new();
        write_spm(&parts, &mut bytes).map_err(|error| failed(&error))?;
        let bytes: Bytes = bytes.into();
        let file = SpmFile::open(bytes.clone()).map_err(|error| failed(&error))?;
        let model = Model::of_file(name.to_string(), file).map_err(|error| failed(&error))?;
        Ok(Self {
            full: Surface::new(model.full_triangles()),
            is_closed: matches!(shape, Shape::Sphere | Shape::Torus | Shape::Relief),
            model,
            bytes,
        })
    }

    /// The place in the middle of an open mesh that is nearest to a place: a hand that goes over
    /// its rim comes back from below. Of a closed mesh, the place itself.
    #[must_use]
    pub fn within_rim(&self, place: DVec3) -> DVec3 {
        if self.is_closed {
            return place;
        }
        let header = self.model.file.model_header();
        let origin = DVec3::from_array(header.origin);
        let [lower, upper] = [header.lower, header.upper].map(|of| DVec3::from_array(of) - origin);
        let margin = (upper - lower) * DVec3::new(RIM, RIM, 0.0);
        place.clamp(lower + margin, upper - margin)
    }

    /// Hash of its contents.
    #[must_use]
    pub fn hash(&self) -> u64 {
        self.model.file.model_header().model
    }
}

/// The models, by number.
pub struct Library {
    models: Vec<[Version; 2]>,
}

impl Library {
    /// Builds every model.
    ///
    /// # Errors
    /// One sentence when one cannot be built.
    pub fn build() -> Result<Self, Failure> {
        let models = (0u64..).zip(SHAPES).map(|(k, (shape, faces))| {
            let name = Self::name(k as usize);
            let first = Version::build(&name, shape, faces, 2 * k + 1)?;
            // Plates and spheres have no seed: another number of faces makes another model.
            let second = Version::build(&name, shape, faces + faces / 8, 2 * k + 2)?;
            Ok([first, second])
        });
        let models = models.collect::<Result<_, Failure>>()?;
        Ok(Self { models })
    }

    /// Name of a model in a scene.
    #[must_use]
    pub fn name(number: usize) -> String {
        format!("model-{number}.spm")
    }

    /// Number of models.
    #[must_use]
    pub fn len(&self) -> usize {
        self.models.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.models.is_empty()
    }

    /// A version of a model.
    #[must_use]
    pub fn version(&self, number: usize, is_rebuilt: bool) -> &Version {
        &self.models[number][usize::from(is_rebuilt)]
    }

    /// The version with these contents.
    #[must_use]
    pub fn by_hash(&self, hash: u64) -> Option<&Version> {
        let mut all = self.models.iter().flatten();
        all.find(|version| version.hash() == hash)
    }

    /// What a station of a scene serves.
    ///
    /// # Errors
    /// Never: the files were opened before.
    pub fn served(
        &self,
        plan: &ScenePlan,
        is_rebuilt: bool,
    ) -> Result<Vec<ServedModel<Bytes>>, Failure> {
        let numbers = (0..self.len()).filter(|&number| {
            let name = Self::name(number);
            plan.objects
                .iter()
                .any(|object| object.model.name() == name)
        });
        let served = numbers.map(|number| {
            let version = self.version(number, is_rebuilt);
            let file = SpmFile::open(version.bytes.clone());
            let file = file.map_err(|error| Failure::Run(error.to_string()))?;
            Ok(ServedModel {
                name: Self::name(number),
                file,
            })
        });
        served.collect()
    }
}
