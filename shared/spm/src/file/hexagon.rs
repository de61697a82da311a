//! A tiny model for examples and tests.

use super::{BuildSummary, FullFace, SpmParts};
use crate::CertifiedCode;
use crate::{
    BaseFace, BaseVertex, LEVELS, ModelHeader, NONE, RegionGrid, RegionId, VspNode, VspRecord,
};
use ab_tree::leaf_key;
use bytemuck::Zeroable;
use glam::{DVec3, UVec3};

/// Corners around the centre of the base mesh.
const CORNERS: u32 = 6;
/// Faces of the full mesh: those of the base mesh and two of the split.
const FACES: u32 = CORNERS + 2;

impl SpmParts {
    /// The smallest model with an interior split, sealed: a hexagon of six faces around vertex 0,
    /// and one VSP that splits vertex 0 along y. One region owns everything.
    #[must_use]
    pub fn hexagon() -> Self {
        // At multiples of 60 degrees; literal numbers, the same on every machine.
        let outer = [
            [3.0, 0.0],
            [1.5, 2.598],
            [-1.5, 2.598],
            [-3.0, 0.0],
            [-1.5, -2.598],
            [1.5, -2.598],
        ];
        let (lower, upper) = (DVec3::new(-3.0, -3.0, 0.0), DVec3::new(3.0, 3.0, 0.0));
        let centre = [0.0; 2];
        let corner = |k: u32| 1 + k % CORNERS;
        let mut level_tolerances = [f32::INFINITY; LEVELS];
        level_tolerances[0] = 0.0;
        let mut parts = Self {
            header: ModelHeader {
                diagonal: (upper - lower).length(),
                lower: lower.to_array(),
                upper: upper.to_array(),
                grid: RegionGrid::new(lower, upper, 1).unwrap_or(RegionGrid::zeroed()),
                level_tolerances,
                base_vertices: 1 + CORNERS,
                base_faces: CORNERS,
                vsps: 1,
                faces: FACES,
                dependency_depth: 1,
                closure_max: 1,
                ..ModelHeader::zeroed()
            },
            summary: BuildSummary::default(),
            base_vertices: [centre]
                .iter()
                .chain(&outer)
                .map(|&[x, y]| BaseVertex {
                    position: [x, y, 0.0],
                    certified: CertifiedCode::default(),
                    reserved: 0,
                })
                .collect(),
            base_faces: (0..CORNERS)
                .map(|k| BaseFace {
                    corners: [0, corner(k), corner(k + 1)],
                    leaf: leaf_key(k, FACES),
                    neighbours: [NONE, (k + 1) % CORNERS, (k + 5) % CORNERS],
                    reserved: 0,
                })
                .collect(),
            quartered: Vec::new(),
            records: vec![record()],
            regions: vec![RegionId::of_cell(UVec3::ZERO)],
            seed_offsets: vec![0, 1],
            seeds: vec![0],
            full_faces: (0..FACES).map(full_face).collect(),
            base_splits: (0..=CORNERS)
                .map(|v| if v == 0 { 0 } else { NONE })
                .collect(),
            hierarchy: vec![VspNode {
                children: [NONE; 2],
                bounds: [0, 0, 0, u16::MAX, u16::MAX, u16::MAX],
            }],
        };
        parts.seal();
        parts
    }
}

/// Splits the centre: vl is vertex 1, between the faces 0 and 5, vr is vertex 4, between 2 and 3.
fn record() -> VspRecord {
    VspRecord {
        i: 0,
        vs: 0,
        fn_: [0, 5, 2, 3],
        leaf_l: leaf_key(CORNERS, FACES),
        leaf_r: leaf_key(CORNERS + 1, FACES),
        pos_t: [0.0, 1.0, 0.0],
        pos_u: [0.0, -1.0, 0.0],
        certified: [CertifiedCode::default(); 2],
        e: u16::MAX,
    }
}

/// A face after the split: the first three faces belong to vt, the next three to vu.
fn full_face(face: u32) -> FullFace {
    let (vt, vu) = (1 + CORNERS, 2 + CORNERS);
    let corners = match face {
        0..=2 => [vt, 1 + face, 2 + face],
        3..=5 => [vu, 1 + face, 1 + (face + 1) % CORNERS],
        6 => [vt, vu, 1],
        _ => [vu, vt, 4],
    };
    FullFace { corners, face }
}
