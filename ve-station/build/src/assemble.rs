//! From a history to the parts of an SPM file: ids and records.

use crate::cracks::widest_crack;
use crate::default_grid::default_grid;
use crate::error::BuildError;
use crate::hierarchy::{add_hierarchy, level_tolerances};
use crate::history::{History, QuarterBounds};
use crate::ids::Ids;
use crate::manifold::ManifoldMesh;
use crate::progress::Progress;
use crate::regions::{Model, regions_of};
use ab_tree::leaf_key;
use geometry::Aabb;
use glam::Vec3;
use spm::{BaseFace, BaseVertex, ModelHeader};
use spm::{
    BuildSummary, CertifiedCode, ErrorScale, FullFace, NONE, QuarterCodes, QuarteredFace,
    RegionGrid, Sizes, SpmParts, VspRecord,
};

/// Assembles the parts of an SPM file: `divisions` along the longest side, or the default grid.
pub fn assemble(
    origin: [f64; 3],
    mesh: &ManifoldMesh,
    history: History,
    divisions: Option<u32>,
    progress: &dyn Progress,
) -> Result<SpmParts, BuildError> {
    let faces = mesh.triangles.len() as u32;
    let bounds = bounds_of(mesh);
    let scale = ErrorScale::for_diagonal(bounds.diagonal());
    let ids = Ids::new(&history, faces);
    let refinement = Refinement::new(mesh, history, &ids, scale)?;

    progress.phase("assigning regions", faces.into());
    let grid = region_grid(bounds, divisions, mesh)?;
    let model = Model {
        grid: &grid,
        mesh,
        ids: &ids,
        base_vertices: &refinement.base_vertices,
        base_faces: &refinement.base_faces,
        records: &refinement.records,
    };
    let found = regions_of(&model, progress);

    let mut parts = SpmParts {
        header: ModelHeader {
            model: 0,
            diagonal: bounds.diagonal(),
            origin,
            lower: bounds.lower.as_dvec3().to_array(),
            upper: bounds.upper.as_dvec3().to_array(),
            grid,
            level_tolerances: level_tolerances(&refinement.records, scale, &grid),
            base_vertices: ids.sizes.base_vertices,
            base_faces: ids.sizes.base_faces,
            vsps: ids.sizes.vsps,
            faces,
            dependency_depth: longest_chain(&refinement.records, ids.sizes),
            closure_max: found.closure_max,
            quartered: refinement.quartered.len() as u32,
            reserved: 0,
        },
        summary: BuildSummary {
            closure_mean: found.closure_mean,
            empty_regions: found.empty,
            cracks_max: refinement.cracks_max,
            ..mesh.summary
        },
        base_vertices: refinement.base_vertices,
        base_faces: refinement.base_faces,
        quartered: refinement.quartered,
        records: refinement.records,
        regions: found.regions,
        seed_offsets: found.seed_offsets,
        seeds: found.seeds,
        full_faces: full_faces(mesh, &ids),
        base_splits: Vec::new(),
        hierarchy: Vec::new(),
    };
    progress.phase("linking the hierarchy", ids.sizes.vsps.into());
    add_hierarchy(&mut parts);
    if !parts.header.is_valid() {
        return Err(BuildError::Internal("the header".to_string()));
    }
    parts.seal();
    Ok(parts)
}

/// Base mesh and records of a history, in the ids of the file.
struct Refinement {
    base_vertices: Vec<BaseVertex>,
    base_faces: Vec<BaseFace>,
    quartered: Vec<QuarteredFace>,
    records: Vec<VspRecord>,
    /// Upper bound of the widest crack, model units.
    cracks_max: f64,
}

impl Refinement {
    /// Consumes the history: its memory is free before the regions are searched.
    fn new(
        mesh: &ManifoldMesh,
        history: History,
        ids: &Ids,
        scale: ErrorScale,
    ) -> Result<Self, BuildError> {
        let faces = mesh.triangles.len() as u32;
        let code = |vertex: u32, end: u16| {
            let made = vertex.checked_sub(history.full_vertices);
            let made = made.map(|made| made as usize);
            let radius = made.map_or(0.0, |made| history.radius[made]);
            let begin = made.map(|made| history.expected[made]);
            CertifiedCode::new(scale, radius, history.close[vertex as usize], begin, end)
        };
        let records = records(&history, ids, faces, &code);
        check_records(&records, ids.sizes)?;
        Ok(Self {
            base_vertices: base_vertices(&history, ids, &code),
            base_faces: base_faces(&history, ids, faces),
            quartered: quartered_faces(&history, ids, scale),
            records,
            cracks_max: widest_crack(mesh, &history),
        })
    }
}

fn region_grid(
    bounds: Aabb,
    divisions: Option<u32>,
    mesh: &ManifoldMesh,
) -> Result<RegionGrid, BuildError> {
    let (lower, upper) = (bounds.lower.as_dvec3(), bounds.upper.as_dvec3());
    let grid = match divisions {
        Some(divisions) => RegionGrid::new(lower, upper, divisions),
        None => default_grid(lower, upper, mesh),
    };
    grid.ok_or_else(|| {
        BuildError::Empty("the model is too small for numbers of this size".to_string())
    })
}

fn full_faces(mesh: &ManifoldMesh, ids: &Ids) -> Vec<FullFace> {
    (0u32..)
        .zip(&mesh.triangles)
        .map(|(face, t)| FullFace {
            corners: t.map(|v| ids.vertex[v as usize]),
            face: ids.face(face),
        })
        .collect()
}

/// Box of a mesh.
pub fn bounds_of(mesh: &ManifoldMesh) -> Aabb {
    Aabb::of_points(mesh.positions.iter().map(|&p| Vec3::from_array(p)))
}

fn base_vertices(
    history: &History,
    ids: &Ids,
    code: &impl Fn(u32, u16) -> CertifiedCode,
) -> Vec<BaseVertex> {
    let mut all = vec![
        BaseVertex {
            position: [0.0; 3],
            certified: CertifiedCode::default(),
            reserved: 0,
        };
        ids.sizes.base_vertices as usize
    ];
    for (vertex, &id) in (0u32..).zip(&ids.vertex) {
        if let Some(slot) = all.get_mut(id as usize) {
            *slot = BaseVertex {
                position: history.positions[vertex as usize],
                certified: code(vertex, u16::MAX),
                reserved: 0,
            };
        }
    }
    all
}

fn base_faces(history: &History, ids: &Ids, faces: u32) -> Vec<BaseFace> {
    history
        .base
        .iter()
        .map(|left| BaseFace {
            corners: left.corners.map(|v| ids.vertex[v as usize]),
            leaf: leaf_key(left.face, faces),
            neighbours: left.neighbours.map(|face| ids.face(face)),
            reserved: 0,
        })
        .collect()
}

fn quartered_faces(history: &History, ids: &Ids, scale: ErrorScale) -> Vec<QuarteredFace> {
    let of = |quarters: &QuarterBounds| QuarteredFace {
        face: ids.face(quarters.face),
        end: quarters.end,
        part: quarters.part,
        quarters: QuarterCodes::new(scale, quarters.bounds),
    };
    let mut all: Vec<QuarteredFace> = history.quarters.iter().map(of).collect();
    all.sort_unstable_by_key(QuarteredFace::key);
    all
}

fn records(
    history: &History,
    ids: &Ids,
    faces: u32,
    code: &impl Fn(u32, u16) -> CertifiedCode,
) -> Vec<VspRecord> {
    let made = history.full_vertices..;
    let mut records: Vec<VspRecord> = history
        .collapses
        .iter()
        .zip(&history.expected)
        .zip(made)
        .zip((0..ids.sizes.vsps).rev())
        .map(|(((collapse, &expected), made), i)| VspRecord {
            i,
            vs: ids.vertex[made as usize],
            fn_: collapse.fn_.map(|face| ids.face(face)),
            leaf_l: leaf_key(collapse.fl, faces),
            leaf_r: if collapse.fr == NONE {
                NONE
            } else {
                leaf_key(collapse.fr, faces)
            },
            pos_t: history.positions[collapse.vt as usize],
            pos_u: history.positions[collapse.vu as usize],
            certified: [collapse.vt, collapse.vu].map(|vertex| code(vertex, expected)),
            e: expected,
        })
        .collect();
    records.reverse();
    records
}

fn check_records(records: &[VspRecord], sizes: Sizes) -> Result<(), BuildError> {
    for (i, record) in (0u32..).zip(records) {
        record
            .validate(i, sizes)
            .map_err(|e| BuildError::Internal(e.to_string()))?;
    }
    Ok(())
}

/// VSPs in the longest chain of dependencies.
fn longest_chain(records: &[VspRecord], sizes: Sizes) -> u32 {
    let mut length: Vec<u32> = Vec::with_capacity(records.len());
    for record in records {
        let before = record.dependencies(sizes).map(|d| length[d as usize]).max();
        length.push(before.unwrap_or(0) + 1);
    }
    length.into_iter().max().unwrap_or(0)
}
