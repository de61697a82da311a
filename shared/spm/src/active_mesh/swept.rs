//! What a split, a collapse or a step of a vertex sweeps over: the space between the surface before and after it.
//!
//! Both surfaces are patches with the same border, so together they enclose a volume; a point changes sides
//! exactly when it lies in it. Its winding number, a sum of solid angles, says so, and needs no normals, no neighbours and no closed mesh. Where the border itself moves, at the rim of
//! an open sheet, the patches leave a gap and the number is a fraction; the nearer whole number decides.

use super::{ActiveMesh, Handle, OperationFaces};
use geometry::solid_angle;
use glam::DVec3;
use std::f64::consts::TAU;

impl ActiveMesh {
    /// Whether the surface passed over a point (model units, finite) in the split, collapse or step that was
    /// performed last.
    ///
    /// Cheap where the point is outside the box of what moved: nearly always.
    #[must_use]
    pub fn swept_over(&self, operation: &OperationFaces, point: DVec3) -> bool {
        let from = operation.from.map(|place| place.as_dvec3());
        let (mut lower, mut upper) = (from[0].min(from[1]), from[0].max(from[1]));
        let mut include = |corners: [DVec3; 3]| {
            for corner in corners {
                lower = lower.min(corner);
                upper = upper.max(corner);
            }
        };
        for &face in operation.deformed() {
            include(self.corners(face));
        }
        for k in 0..operation.pair_count {
            include(self.pair_corners(operation, k));
        }
        if point.cmplt(lower).any() || point.cmpgt(upper).any() {
            return false;
        }
        let mut angle = 0.0;
        for (k, &face) in operation.deformed().iter().enumerate() {
            let side = usize::from(k >= operation.of_t);
            let after = self.corners(face);
            let mut before = after;
            if let Some(corner) = self.face(face).index_of(operation.moved[side]) {
                before[corner] = from[side];
            }
            angle += solid_angle(after, point) - solid_angle(before, point);
        }
        let sign = if operation.made { 1.0 } else { -1.0 };
        for k in 0..operation.pair_count {
            angle += sign * solid_angle(self.pair_corners(operation, k), point);
        }
        // A whole turn is 4 pi, that is 2 TAU.
        angle.abs() > TAU
    }

    /// Where the corners of a made face are, or those of a removed one were: fl is (vt, vu, vl), fr (vu, vt, vr).
    fn pair_corners(&self, operation: &OperationFaces, k: usize) -> [DVec3; 3] {
        let face: Handle = operation.pair[k];
        let corners = self.corners(face);
        if operation.made {
            return corners;
        }
        let [t, u] = operation.from.map(|place| place.as_dvec3());
        let [first, second] = if k == 0 { [t, u] } else { [u, t] };
        [first, second, corners[2]]
    }
}
