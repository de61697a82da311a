//! What splits and collapses have moved near the tool since the last tick.

use super::neighbourhood::{Neighbourhood, apart, reach_along};
use super::shape::ToolShape;
use geometry::BoxPair;
use glam::DVec3;
use spm::{ActiveMesh, Handle, NONE, OperationFaces};

/// Ways out that are tried, each twice as far as the one before.
const ESCAPES: i32 = 6;
/// The same before, up to twice what the surface does in a tick where that is limited: of what has changed, most has not
/// come so far where it meets the tool.
const SHORT_ESCAPES: i32 = 4;

/// Changed faces that are listed, at the most.
const MAX_LISTED: usize = 512;

/// Changes of the surface near the tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshChange {
    is_there: bool,
    may_have_met: bool,
    /// Sum of the directions from changed faces to the tool.
    side: DVec3,
    /// How far a changed face has come out towards the tool, at the most; model units.
    push: f64,
    /// What has changed near the tool; more than fits when the count is greater. Some may have gone since.
    faces: [Handle; MAX_LISTED],
    count: usize,
}

impl MeshChange {
    /// None.
    pub fn new() -> Self {
        Self {
            is_there: false,
            may_have_met: false,
            side: DVec3::ZERO,
            push: 0.0,
            faces: [NONE; MAX_LISTED],
            count: 0,
        }
    }

    /// What was noted, which is forgotten here.
    pub fn take(&mut self) -> Self {
        std::mem::replace(self, Self::new())
    }

    /// Whether a face near the tool has changed.
    pub fn is_there(&self) -> bool {
        self.is_there
    }

    /// Whether the surface may meet the tool now.
    pub fn may_have_met(&self) -> bool {
        self.may_have_met
    }

    /// The faces near the tool that have changed, of which some may have gone; `None` when they were too many.
    pub fn changed(&self) -> Option<&[Handle]> {
        self.faces.get(..self.count)
    }

    /// Notes an operation. What was near is told by the faces gathered, what has come near by the boxes of the tool
    /// where it was gathered; by its ball, where nothing is gathered.
    pub fn note(
        &mut self,
        near: &mut Neighbourhood,
        shape: &ToolShape,
        centre: DVec3,
        mesh: &ActiveMesh,
        operation: &OperationFaces,
    ) {
        let changed = || {
            operation
                .deformed()
                .iter()
                .chain(operation.made_or_removed())
        };
        let (mut lower, mut upper) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for &face in changed().filter(|&&face| mesh.is_active(face)) {
            for corner in mesh.corners(face) {
                (lower, upper) = (lower.min(corner), upper.max(corner));
            }
        }
        let outside = (lower - centre).max(centre - upper).max(DVec3::ZERO);
        let ball = shape.radius + near.reach();
        let mut is_near = outside.length_squared() <= ball * ball;
        if is_near {
            // From the way that was gathered along the tool has strayed by less than the margin.
            let around = BoxPair::twice_widened(lower.as_vec3a(), upper.as_vec3a());
            is_near = near.may_reach(shape, &around.get(0));
        }
        let mut was_near = false;
        for &face in changed() {
            let Some(place) = near.place_of(face) else {
                continue;
            };
            was_near = true;
            if !mesh.is_active(face) {
                continue;
            }
            let corners = mesh.corners(face);
            let before = std::mem::replace(&mut near.faces[place as usize].corners, corners);
            for pair in near.pairs.iter() {
                if pair.surface != place {
                    continue;
                }
                let direction = near.direction(pair);
                let height = reach_along(direction, corners);
                self.push = self.push.max(height - reach_along(direction, before));
                self.side += direction;
                let tool = near.corners(shape, pair.tool);
                self.may_have_met |= apart(direction, height, tool) <= 0.0;
            }
        }
        if is_near || was_near {
            self.is_there = true;
            for &face in changed().filter(|&&face| mesh.is_active(face)) {
                if let Some(place) = self.faces.get_mut(self.count) {
                    *place = face;
                }
                self.count += 1;
            }
        }
        // What was not near before has no direction that tells.
        self.may_have_met |= is_near;
    }

    /// Ways out along the side of the tool, the shortest first; `rest` is the distance at which contacts act, `most` how
    /// far the surface comes in a tick where that is limited.
    pub fn escapes(&self, offset: f64, most: f64) -> impl Iterator<Item = DVec3> + use<> {
        let (side, push) = (
            self.side.normalize_or_zero(),
            self.push.max(offset) + offset,
        );
        let shorter = (0..SHORT_ESCAPES).map(move |k| most * 0.25 * f64::from(1 << k));
        let shorter = shorter.filter(move |&escape| offset < escape && escape < push);
        let all = shorter.chain((0..ESCAPES).map(move |k| push * f64::from(1 << k)));
        all.map(move |escape| side * escape)
    }
}
