//! The volume that a split, a collapse or a step of a vertex sweeps: the space between the surfaces
//! before and after it.
//!
//! Both surfaces are patches with the same border, so together they enclose a volume. A point
//! changes sides exactly when it is inside. Its winding number, a sum of solid angles, tells that
//! without normals, neighbours or a closed mesh. Where the border itself moves, at the boundary of
//! an open sheet, the patches leave a gap and the number is a fraction; it is rounded.

use super::{ActiveMesh, Handle, OperationFaces};
use geometry::solid_angle;
use glam::DVec3;
use std::f64::consts::TAU;

impl ActiveMesh {
    /// Whether the surface passed over a point (model units, finite) in the last split, collapse or
    /// step.
    ///
    /// Cheap where the point is outside the box of the moved faces: nearly always.
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
            let fan = usize::from(k >= operation.of_t);
            let after = self.corners(face);
            let mut before = after;
            if let Some(corner) = self.face(face).index_of(operation.moved[fan]) {
                before[corner] = from[fan];
            }
            angle += solid_angle(after, point) - solid_angle(before, point);
        }
        let sign = if operation.made { 1.0 } else { -1.0 };
        for k in 0..operation.pair_count {
            angle += sign * solid_angle(self.pair_corners(operation, k), point);
        }
        // Inside, the winding number is 1 and the angle 4 pi, that is 2 TAU.
        angle.abs() > TAU
    }

    /// The largest displacement of a corner in the last split, collapse or step, model units: the
    /// surface moved nowhere by more.
    #[must_use]
    pub fn displacement(&self, operation: &OperationFaces) -> f64 {
        let ends = operation.moved.into_iter().zip(operation.from);
        let distances = ends.map(|(vertex, from)| {
            let to = self.position(vertex).as_dvec3();
            to.distance(from.as_dvec3())
        });
        distances.fold(0.0, f64::max)
    }

    /// Corners of a created or removed face: fl is (vt, vu, vl), fr (vu, vt, vr).
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
