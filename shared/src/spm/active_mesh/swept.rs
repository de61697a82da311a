//! What a split or collapse sweeps over: the space between the surface before and after it.
//!
//! Both surfaces are patches with the same border, so together they enclose a volume; a point changes sides
//! exactly when it lies in it. Its winding number, a sum of solid angles, says so, and needs no normals, no neighbours and no closed mesh. Where the border itself moves, at the rim of
//! an open sheet, the patches leave a gap and the number is a fraction; the nearer whole number decides.

use super::{ActiveMesh, Handle, OperationFaces};
use crate::geometry::solid_angle;
use glam::DVec3;
use std::f64::consts::TAU;

impl ActiveMesh {
    /// Whether the surface passed over a point (model units, finite) in the split or collapse that was
    /// performed last.
    ///
    /// Cheap where the point is outside the box of what moved: nearly always.
    #[must_use]
    pub fn swept_over(&self, operation: &OperationFaces, point: DVec3) -> bool {
        let Some(slot) = self.maker_of_face(operation.pair[0]) else {
            return false;
        };
        let vt = self.vt(slot);
        let vs = self.links[slot as usize].vs;
        let moved = [vs, vt, vt + 1];
        let position = |vertex: Handle| self.position(vertex).as_dvec3();
        let (mut lower, mut upper) = (position(vs), position(vs));
        let mut include = |vertex: Handle| {
            lower = lower.min(position(vertex));
            upper = upper.max(position(vertex));
        };
        moved.into_iter().for_each(&mut include);
        let around = operation.deformed().iter();
        let all = around.chain(operation.made_or_removed());
        for &face in all {
            self.face(face).corners.into_iter().for_each(&mut include);
        }
        if point.cmplt(lower).any() || point.cmpgt(upper).any() {
            return false;
        }
        let mut angle = 0.0;
        for (k, &face) in operation.deformed().iter().enumerate() {
            let fine = if k < operation.of_t { vt } else { vt + 1 };
            let corners = self.face(face).corners;
            let with = |vertex: Handle| {
                corners.map(|c| position(if moved.contains(&c) { vertex } else { c }))
            };
            angle += solid_angle(with(fine), point) - solid_angle(with(vs), point);
        }
        for &face in operation.made_or_removed() {
            angle += solid_angle(self.corners(face), point);
        }
        // A whole turn is 4 pi, that is 2 TAU.
        angle.abs() > TAU
    }
}
