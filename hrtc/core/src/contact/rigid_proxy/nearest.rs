//! The nearest points of tool and surface, for what acts before they touch.

use super::ToolProxy;
use crate::contact::query::{Body, Limit, PairWork, Surface};
use crate::contact::tool::{RelativePath, Resume, for_each_near_pair};
use geometry::{Pose, closest_points_of_triangles};
use glam::DVec3;
use spm::Handle;
use std::ops::ControlFlow;

/// Nearest points of a tool at its proxy and of the surface; model frame and units.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct NearestPair {
    /// The face of the surface and that of the tool.
    pub faces: [Handle; 2],
    /// The point on the surface and that on the tool.
    pub points: [DVec3; 2],
    /// Their squared distance; 0 where the faces meet.
    pub distance_squared: f64,
}

impl NearestPair {
    /// The same points where the tool has moved from one pose to another since.
    #[must_use]
    pub fn moved(self, from: &Pose, to: &Pose) -> Self {
        let [on_surface, on_tool] = self.points;
        let on_tool = to.transform_point(from.inverse_transform_point(on_tool));
        Self {
            faces: self.faces,
            points: [on_surface, on_tool],
            distance_squared: on_surface.distance_squared(on_tool),
        }
    }
}

impl ToolProxy {
    /// The nearest points of the tool, where it is, and the surface, no farther apart than `reach`
    /// (model units).
    ///
    /// `before`: the faces of an earlier answer, whose distance now bounds the search: without them
    /// it begins with all pairs within the reach. Returns as well whether it is complete; else the
    /// answer is the nearest of what was searched.
    #[must_use]
    pub fn nearest_within(
        &self,
        surface: Surface<'_>,
        reach: f64,
        before: Option<[Handle; 2]>,
        limit: &mut Limit<'_>,
    ) -> (Option<NearestPair>, PairWork, bool) {
        let (centre, rotation) = (self.at.centre, self.at.rotation());
        let pair_of = |[face, of_tool]: [Handle; 2]| {
            let own = self.shape.faces[of_tool as usize].vertices;
            let placed = own.map(|v| centre + rotation * self.shape.points[v as usize]);
            let closest = closest_points_of_triangles(surface.corners(face), placed);
            NearestPair {
                faces: [face, of_tool],
                points: closest.points,
                distance_squared: closest.distance_squared,
            }
        };
        let is_within = |pair: &NearestPair| pair.distance_squared <= reach * reach;
        let before = before.filter(|&[face, _]| surface.has(face));
        let mut best = before.map(pair_of).filter(is_within);
        let margin = |best: &Option<NearestPair>| {
            best.map_or(reach, |pair| pair.distance_squared.sqrt().min(reach))
        };
        let path = RelativePath::new([centre; 2], [rotation; 2]);
        let (start, resume) = (margin(&best), Resume::START);
        let blocks = &self.shape.blocks;
        let (ending, mut work, _) = for_each_near_pair(
            &surface,
            blocks,
            &path,
            start,
            resume,
            limit,
            |face, of_tool| {
                let pair = pair_of([face, of_tool]);
                let is_nearer =
                    best.is_none_or(|best| pair.distance_squared < best.distance_squared);
                if is_nearer && is_within(&pair) {
                    best = Some(pair);
                }
                ControlFlow::Continue(margin(&best))
            },
        );
        work.faces += u32::from(before.is_some());
        (best, work, ending.is_complete())
    }
}
