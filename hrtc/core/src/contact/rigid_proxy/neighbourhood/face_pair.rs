//! The first test of a near pair: the direction along which two faces are farthest apart on a
//! straight path. What depends on one of the faces only is computed once for all of its pairs.

use super::{Direction, normal_of};
use glam::{DMat3, DVec3};
use spm::{ActiveMesh, Handle};

/// Least and most of corners along a direction.
#[inline]
fn extent(direction: DVec3, corners: [DVec3; 3]) -> [f64; 2] {
    let [a, b, c] = corners.map(|p| direction.dot(p));
    [a.min(b).min(c), a.max(b).max(c)]
}

/// Sum of corners: three times their middle.
#[inline]
fn middle([a, b, c]: [DVec3; 3]) -> DVec3 {
    a + b + c
}

/// A face of the surface for which pairs are collected.
pub(super) struct CandidateFace {
    pub face: Handle,
    pub corners: [DVec3; 3],
    /// Unit normal; zero without area.
    normal: DVec3,
    /// Its extent along its normal.
    extent: [f64; 2],
    middle: DVec3,
    /// Index among the faces that have a pair.
    pub place: Option<u32>,
}

impl CandidateFace {
    /// A face of a mesh, without pairs so far.
    #[inline]
    pub fn of(mesh: &ActiveMesh, face: Handle) -> Self {
        let corners = mesh.corners(face);
        let normal = normal_of(corners);
        Self {
            face,
            corners,
            normal,
            extent: extent(normal, corners),
            middle: middle(corners),
            place: None,
        }
    }
}

/// A face of the tool as it is throughout a collection.
#[derive(Debug, Clone, Copy)]
struct TurnedFace {
    /// Number of the collection; 0 before the first.
    collection: u64,
    /// Normal in the model's axes at the start of the path.
    normal: DVec3,
    /// Its extent along that on the path.
    extent: [f64; 2],
    /// At the start of the path.
    middle: DVec3,
}

impl TurnedFace {
    /// Of no collection.
    const NONE: Self = Self {
        collection: 0,
        normal: DVec3::ZERO,
        extent: [0.0; 2],
        middle: DVec3::ZERO,
    };
}

/// The faces of the tool in a collection, each computed when it is first needed.
#[derive(Debug, Clone, Default)]
pub(super) struct TurnedFaces {
    faces: Vec<TurnedFace>,
    /// Number of the collection.
    collection: u64,
}

impl TurnedFaces {
    /// Room for so many faces.
    pub fn new(count: usize) -> Self {
        Self {
            faces: vec![TurnedFace::NONE; count],
            collection: 0,
        }
    }

    /// Begins a collection over so many faces: the tool may have moved since the last.
    pub fn begin(&mut self, count: usize) {
        // Changes nothing unless the state comes from a recording, which is without them.
        self.faces.resize(count, TurnedFace::NONE);
        self.collection += 1;
    }

    /// A face in this collection.
    #[inline]
    fn of(&mut self, moving: &MovingFace) -> &TurnedFace {
        let turned = &mut self.faces[moving.face as usize];
        if turned.collection != self.collection {
            let normal = moving.rotation * moving.own;
            *turned = TurnedFace {
                collection: self.collection,
                normal,
                extent: moving.extent(normal),
                middle: middle(moving.corners[0]),
            };
        }
        turned
    }
}

/// A face of the tool for which pairs are collected.
pub(super) struct MovingFace {
    pub face: u32,
    /// Corners at the start and at the end of the path.
    pub corners: [[DVec3; 3]; 2],
    /// Normal in the tool's axes.
    pub own: DVec3,
    /// From the tool's axes to the model's at the start.
    pub rotation: DMat3,
}

impl MovingFace {
    /// Least and most along a direction at both ends of the path.
    #[inline]
    fn extent(&self, direction: DVec3) -> [f64; 2] {
        let [start, end] = &self.corners;
        let [p, q, r] = start.map(|p| direction.dot(p));
        let [s, t, u] = end.map(|p| direction.dot(p));
        let least = p.min(q).min(r).min(s.min(t).min(u));
        let most = p.max(q).max(r).max(s.max(t).max(u));
        [least, most]
    }

    /// The direction of largest separation along the straight path, among the normals of two faces
    /// and the direction between their centres, and that separation; or the first direction with a
    /// separation above `enough`.
    #[inline]
    pub fn best_apart(
        &self,
        face: &CandidateFace,
        turned: &mut TurnedFaces,
        enough: f64,
    ) -> (f64, Direction) {
        // Both signs of a direction at once, by the extents of surface and tool along it.
        let either = |[low, high]: [f64; 2], [least, most]: [f64; 2]| {
            let (ahead, behind) = (least - high, low - most);
            if ahead >= behind {
                (ahead, 1.0, high)
            } else {
                (behind, -1.0, -low)
            }
        };
        let still = |normal: DVec3, sign: f64, height: f64| {
            let direction = sign * normal;
            Direction::Still { direction, height }
        };
        let (over, sign, height) = either(face.extent, self.extent(face.normal));
        let over_face = still(face.normal, sign, height);
        if over > enough {
            return (over, over_face);
        }
        let turned = turned.of(self);
        let (under, sign, _) = either(extent(turned.normal, face.corners), turned.extent);
        let under_tool = Direction::Turning(sign * self.own);
        if under > enough {
            return (under, under_tool);
        }
        let between = (turned.middle - face.middle).normalize_or_zero();
        let (beside, sign, height) = either(extent(between, face.corners), self.extent(between));
        if beside > over.max(under) {
            (beside, still(between, sign, height))
        } else if over >= under {
            (over, over_face)
        } else {
            (under, under_tool)
        }
    }
}
