//! A model in its scene, and the same mesh never simplified as the reference.

use crate::failure::Failure;
use crate::models::Model;
use crate::models::source::source;
use crate::scenes::{BUNDLED_SCENE, prepare_models};
use geometry::closest_point_on_triangle;
use glam::DVec3;
use hrtc_core::Controller;
use protocol::{Request, TourAsk, TourPoint};
use scene::{NoFiles, Overrides, ScenePlan, TrajectoryPlan, parse};
use simulator::{Client, ClientOptions, STATION, Simulation, new_controller};
use spm::{FileError, SpmFile, write_spm};
use spm_builder::{BuildOptions, NoProgress, SoupMesh, build_model};
use station_core::station::{ServedModel, ServedObject, Station};
use station_core::tour::make_tour;
use std::collections::BTreeMap;
use std::path::Path;
use ve_station::FileBytes;

/// Longest side of every model, metres.
pub const SIZE_M: f64 = 0.15;
/// Bytes of a cache for each face, enough for a whole mesh in it, base mesh or records.
const CACHE_BYTES_A_FACE: usize = 400;
/// What the device can render, newtons: as the simulated one.
const DEVICE_MAX_N: f64 = 10.0;

/// A model in its scene.
#[derive(Debug)]
pub struct SceneModel {
    /// The model; positions relative to the file's origin.
    pub mesh: Model<FileBytes>,
    /// The scene: one object, one probe, tolerance 0, no trajectory of its own.
    pub plan: ScenePlan,
    /// Metres a model unit.
    pub metres_per_unit: f64,
    /// Speed and depth of the tour, m/s and m.
    tour: (f64, f64),
}

impl SceneModel {
    /// Opens a model; builds it first when the cache folder does not hold it.
    ///
    /// # Errors
    /// One sentence that names the file.
    pub fn open(typed: &str) -> Result<Self, Failure> {
        let (name, source) = source(typed)?;
        let mut plan = parse(
            BUNDLED_SCENE,
            "accuracy",
            Path::new(""),
            &Overrides::default(),
            &NoFiles,
        )?;
        plan.objects[0].model = source;
        plan.objects[0].scale = scene::ModelScale::Size(SIZE_M);
        let tour = match plan.probes[0].trajectory {
            TrajectoryPlan::Tour {
                speed_m_per_s,
                depth_m,
                ..
            } => (speed_m_per_s, depth_m),
            TrajectoryPlan::Points(_) => (0.1, 0.002),
        };
        // Poses are replayed, so no tour goes over the link and into the bytes.
        plan.probes[0].trajectory = TrajectoryPlan::Points(Vec::new());
        let file = open(&plan)?.file;
        let damaged = |error: FileError| Failure::Input(format!("the model {name}: {error}"));
        let mesh = Model::of_file(name.clone(), file).map_err(damaged)?;
        let header = mesh.file.model_header();
        let sides = DVec3::from_array(header.upper) - DVec3::from_array(header.lower);
        let metres_per_unit = plan.objects[0].scale.metres_per_unit(sides.max_element());
        Ok(Self {
            mesh,
            plan,
            metres_per_unit,
            tour,
        })
    }

    /// Distance from a point to the full mesh by looking at every face, model units: an oracle for
    /// the file's own search.
    #[must_use]
    pub fn brute_distance(&self, point: DVec3) -> f64 {
        let squared = self.mesh.full_faces.iter().map(|corners| {
            let corners = corners.map(|corner| self.mesh.positions[corner as usize]);
            closest_point_on_triangle(corners, point).distance_squared
        });
        squared.fold(f64::INFINITY, f64::min).sqrt()
    }

    /// Makes the tours go at this speed, m/s.
    pub fn set_speed(&mut self, speed_m_per_s: f64) {
        self.tour.0 = speed_m_per_s;
    }

    /// Diagonal of the object's box, metres.
    #[must_use]
    pub fn diagonal_m(&self) -> f64 {
        self.mesh.file.model_header().diagonal * self.metres_per_unit
    }

    /// The tour of a seed.
    ///
    /// # Errors
    /// One sentence when the file is damaged.
    pub fn tour(&self, seed: u64, seconds: f64) -> Result<Vec<TourPoint>, Failure> {
        let scale = self.metres_per_unit;
        let ask = TourAsk {
            seed,
            seconds,
            speed: self.tour.0 / scale,
            depth: self.tour.1 / scale,
            radius: self.plan.probes[0].shape.tip_m() / scale,
            from: 0,
        };
        make_tour(&self.mesh.file, ask)
            .map_err(|error| Failure::Input(format!("a tour of {}: {error}", self.mesh.name)))
    }

    /// Bytes of a cache that holds the whole mesh.
    #[must_use]
    pub fn cache_for_all(&self) -> usize {
        CACHE_BYTES_A_FACE * self.mesh.file.model_header().faces as usize + (16 << 20)
    }

    /// A fresh controller of a plan.
    #[must_use]
    pub fn controller(plan: &ScenePlan) -> Controller {
        let options = ClientOptions {
            device_max_n: DEVICE_MAX_N,
            ..ClientOptions::default()
        };
        new_controller(plan, &options)
    }

    /// Controller and station of a plan, with nothing sent yet.
    ///
    /// # Errors
    /// One sentence when the file has gone since.
    pub fn simulation(&self, plan: &ScenePlan) -> Result<Simulation<FileBytes>, Failure> {
        let served = open(plan)?;
        Ok(simulation(plan, served))
    }

    /// The reference: the same mesh never simplified. Its base mesh *is* the full mesh: no record,
    /// no region and no refinement has a part in what it gives.
    ///
    /// # Errors
    /// One sentence when it cannot be built.
    pub fn reference(&self) -> Result<Simulation<Vec<u8>>, Failure> {
        let all = BuildOptions {
            base_faces: Some(u32::MAX),
            ..BuildOptions::default()
        };
        let failed = |error: &dyn std::fmt::Display| {
            Failure::Run(format!("the reference of {}: {error}", self.mesh.name))
        };
        let parts =
            build_model(full_soup(&self.mesh), &all, &NoProgress).map_err(|e| failed(&e))?;
        let mut bytes = Vec::new();
        write_spm(&parts, &mut bytes).map_err(|e| failed(&e))?;
        let file = SpmFile::open(bytes).map_err(|e| failed(&e))?;
        let header = file.model_header();
        if header.vsps != 0 || header.faces != self.mesh.file.model_header().faces {
            return Err(failed(&format!(
                "it has {} of {} faces and {} splits",
                header.faces,
                self.mesh.file.model_header().faces,
                header.vsps
            )));
        }
        let mut plan = self.plan.clone();
        plan.cache_bytes = self.cache_for_all();
        let name = plan.objects[0].model.name();
        Ok(simulation(&plan, ServedModel { name, file }))
    }
}

/// The full mesh with its vertices numbered as the faces first name them, in the file's units.
fn full_soup(model: &Model<FileBytes>) -> SoupMesh {
    let origin = DVec3::from_array(model.file.model_header().origin);
    let mut places = BTreeMap::new();
    let mut mesh = SoupMesh::default();
    for corners in &model.full_faces {
        let corners = corners.map(|vertex| {
            *places.entry(vertex).or_insert_with(|| {
                let position = model.positions[vertex as usize] + origin;
                mesh.positions.push(position.to_array());
                mesh.positions.len() as u32 - 1
            })
        });
        mesh.triangles.push(corners);
    }
    mesh
}

fn open(plan: &ScenePlan) -> Result<ServedModel<FileBytes>, Failure> {
    let mut models = prepare_models(plan)?.models;
    models
        .pop()
        .ok_or_else(|| Failure::Run("the scene has no model".to_string()))
}

fn simulation<D: AsRef<[u8]>>(plan: &ScenePlan, served: ServedModel<D>) -> Simulation<D> {
    let object = ServedObject {
        model: 0,
        name: Request::name_hash(&served.name),
    };
    let station = Station::new(STATION, vec![served], vec![object]);
    let options = ClientOptions {
        device_max_n: DEVICE_MAX_N,
        ..ClientOptions::default()
    };
    Simulation::new(station, Client::new(plan, options))
}
