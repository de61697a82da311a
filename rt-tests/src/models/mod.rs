//! Meshes and fronts that measurements and checks stand on.
//!
//! | module | holds |
//! |---|---|
//! | [`Model`] | an SPM file with all its records and positions at hand |
//! | [`source`] | models as they are named on the command line |
//! | [`hard_meshes`] | generated meshes on which builders and fronts fail first |
//! | [`surface`], [`path`] | exact distances to triangles; paths over them |
//! | [`profiles`] | meshes of a profile: slots, edges, holes |
//! | [`front_walk`] | random walks over fronts with an AB-tree |
//! | [`local_front`] | fronts around a contact as the two processes form them |

pub mod front_walk;
pub mod hard_meshes;
pub mod local_front;
pub mod path;
pub mod profiles;
pub mod source;
pub mod surface;

use crate::failure::Failure;
use glam::DVec3;
use spm::{ActiveMesh, ErrorScale, FileError, SpmFile, VspRecord, write_spm};
use spm_builder::{BuildError, BuildOptions, Progress, SoupMesh, build_model, is_mesh_file};
use std::path::Path;

/// A model in memory.
#[derive(Debug)]
pub struct Model<D = Vec<u8>> {
    /// Name in a table: that of the file or of the generated shape.
    pub name: String,
    /// The file.
    pub file: SpmFile<D>,
    /// Every record, ascending.
    pub records: Vec<VspRecord>,
    /// Positions of all vertices by id, model units; [V0 + 2 n].
    pub positions: Vec<DVec3>,
    /// Corners of the faces of the full mesh in the order of the AB-tree, vertex ids.
    pub full_faces: Vec<[u32; 3]>,
}

impl Model {
    /// Opens an SPM file, or builds a mesh file.
    ///
    /// # Errors
    /// One sentence that names the file.
    pub fn open(
        path: &Path,
        options: &BuildOptions,
        progress: &dyn Progress,
    ) -> Result<Self, Failure> {
        let refused = |error: BuildError| Failure::Input(error.in_file(path).to_string());
        let name = path.file_name().map_or_else(
            || path.display().to_string(),
            |n| n.to_string_lossy().into(),
        );
        if is_mesh_file(path) {
            let mesh = spm_builder::read_mesh(path).map_err(refused)?;
            return Self::build(name, mesh, options, progress).map_err(refused);
        }
        let bytes = std::fs::read(path).map_err(|error| refused(BuildError::Io(error)))?;
        Self::of_bytes(name, bytes)
            .map_err(|error| Failure::Input(format!("{}: {error}", path.display())))
    }

    /// Builds a mesh.
    ///
    /// # Errors
    /// When nothing of the mesh is left to build from.
    pub fn build(
        name: String,
        mesh: SoupMesh,
        options: &BuildOptions,
        progress: &dyn Progress,
    ) -> Result<Self, BuildError> {
        let parts = build_model(mesh, options, progress)?;
        let mut bytes = Vec::new();
        write_spm(&parts, &mut bytes)?;
        Self::of_bytes(name, bytes).map_err(|error| BuildError::Internal(error.to_string()))
    }

    fn of_bytes(name: String, bytes: Vec<u8>) -> Result<Self, FileError> {
        Self::of_file(name, SpmFile::open(bytes)?)
    }
}

impl<D: AsRef<[u8]>> Model<D> {
    /// Reads everything from an open file.
    ///
    /// # Errors
    /// When a record or a face is damaged.
    pub fn of_file(name: String, file: SpmFile<D>) -> Result<Self, FileError> {
        let header = file.model_header();
        let records: Vec<VspRecord> = (0..header.vsps)
            .map(|i| file.record(i))
            .collect::<Result<_, _>>()?;
        let of_base = file.base_vertices().iter().map(|v| v.position);
        let made = records.iter().flat_map(|r| [r.pos_t, r.pos_u]);
        let positions = of_base
            .chain(made)
            .map(|p| glam::Vec3::from_array(p).as_dvec3())
            .collect();
        let full_faces = (0..header.faces)
            .map(|place| Ok(file.full_face(place)?.corners))
            .collect::<Result<_, FileError>>()?;
        Ok(Self {
            name,
            records,
            positions,
            full_faces,
            file,
        })
    }

    /// All records loaded into the slots of their numbers, none performed: handles are the file's
    /// ids.
    ///
    /// # Panics
    /// Never: the file has checked its base mesh when it was opened.
    #[must_use]
    pub fn active_mesh(&self) -> ActiveMesh {
        let mut mesh = self.base_mesh();
        for record in &self.records {
            self.load(&mut mesh, record);
        }
        mesh
    }

    /// The base mesh, with room for every record.
    ///
    /// # Panics
    /// Never: the file has checked its base mesh when it was opened.
    #[must_use]
    pub fn base_mesh(&self) -> ActiveMesh {
        let header = self.file.model_header();
        let mut mesh = ActiveMesh::new(header.base_vertices, header.base_faces, header.vsps)
            .with_quarters(header.quartered as usize);
        for (handle, vertex) in (0u32..).zip(self.file.base_vertices()) {
            mesh.set_base_vertex(
                handle,
                vertex.position,
                self.scale().certified_of_base(vertex),
            );
        }
        for (handle, face) in (0u32..).zip(self.file.base_faces()) {
            let set = mesh.set_base_face(handle, face.corners, face.neighbours);
            assert!(set.is_some(), "the file has checked its base mesh");
        }
        for quartered in self.file.quartered_faces() {
            let is_added = mesh.add_quarters(quartered, self.scale());
            assert!(is_added, "the file has checked its quartered faces");
        }
        mesh
    }

    /// Loads a record into the slot of its number.
    pub fn load(&self, mesh: &mut ActiveMesh, record: &VspRecord) {
        let certified = self.scale().certified(record);
        mesh.load(record.i, record, record.vs, record.fn_, certified);
    }

    fn scale(&self) -> ErrorScale {
        ErrorScale::for_diagonal(self.file.model_header().diagonal)
    }

    /// The faces of the full mesh, in the order of the AB-tree.
    #[must_use]
    pub fn full_triangles(&self) -> Vec<[DVec3; 3]> {
        self.full_faces
            .iter()
            .map(|corners| corners.map(|v| self.positions[v as usize]))
            .collect()
    }

    /// The full mesh alone: its vertices, in the order in which its faces name them, which are in
    /// the order of the AB-tree.
    #[must_use]
    pub fn full_mesh(&self) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let mut places = vec![None; self.positions.len()];
        let mut positions = Vec::new();
        let mut place = |vertex: u32| {
            *places[vertex as usize].get_or_insert_with(|| {
                positions.push(self.positions[vertex as usize]);
                positions.len() as u32 - 1
            })
        };
        let faces = self.full_faces.iter();
        let faces = faces.map(|face| face.map(&mut place)).collect();
        (positions, faces)
    }

    /// Ids of the vertices of the full mesh, ascending.
    #[must_use]
    pub fn full_vertices(&self) -> Vec<u32> {
        let mut used: Vec<u32> = self.full_faces.as_flattened().to_vec();
        used.sort_unstable();
        used.dedup();
        used
    }
}

/// The active faces of a mesh as triangles, with their handles.
#[must_use]
pub fn active_triangles(mesh: &ActiveMesh) -> (Vec<u32>, Vec<[DVec3; 3]>) {
    let mut handles = Vec::with_capacity(mesh.active_faces() as usize);
    mesh.for_each_active_face(|face| handles.push(face));
    let triangles = handles.iter().map(|&face| mesh.corners(face)).collect();
    (handles, triangles)
}
