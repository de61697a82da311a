//! The vertex hierarchy: the VSPs that split the children of a VSP, and the bounds of each subtree.
//!
//! The *bounds* of VSP i are the box of its split vertex, of all descendants of that vertex, and of
//! all full-mesh faces at such a descendant. The vertices that i creates descend from it, so the
//! bounds of the VSPs that split them are within those of i. Their E is not larger either, because
//! they depend on i. So a search from the base mesh that stops where E or the bounds exclude a VSP
//! finds every VSP that both accept. It visits only those, their children and the base mesh.

use super::NONE;
use bytemuck::{Pod, Zeroable};
use geometry::Aabb;
use glam::DVec3;

/// A VSP in the hierarchy.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct VspNode {
    /// The VSPs that split vt and vu; [`NONE`] for a vertex of the full mesh.
    pub children: [u32; 2],
    /// Its bounds in steps of the model's box, lower corner, then upper, rounded outwards
    /// ([`BoundsScale`]).
    pub bounds: [u16; 6],
}

impl VspNode {
    /// Whether its children can be those of VSP i among n.
    #[must_use]
    pub fn is_valid(&self, i: u32, vsps: u32) -> bool {
        let [t, u] = self.children;
        let child_ok = |child: u32| child == NONE || (child > i && child < vsps);
        child_ok(t) && child_ok(u) && (t != u || t == NONE)
    }
}

/// Converts boxes in model units to steps of the model's box and back.
///
/// The first and the last step also stand for everything beyond, since vertices of coarse meshes
/// may be outside the model's box. The test against a box that meets the model's box gives the
/// exact answer, or a false yes within one step of rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundsScale {
    lower: DVec3,
    step: DVec3,
}

impl BoundsScale {
    const LAST: f64 = u16::MAX as f64;

    /// The scale of a model whose box has these corners (model units, finite, `lower <= upper`).
    #[must_use]
    pub fn new(lower: [f64; 3], upper: [f64; 3]) -> Self {
        let lower = DVec3::from_array(lower);
        // Rounded up: the last step must not be below the upper corner.
        let step = (DVec3::from_array(upper) - lower) / Self::LAST * (1.0 + 4.0 * f64::EPSILON);
        Self { lower, step }
    }

    /// Steps around a box. Those of an empty box only meet boxes around the whole model.
    #[must_use]
    pub fn encode(&self, bounds: &Aabb) -> [u16; 6] {
        let mut steps = [0; 6];
        for axis in 0..3 {
            let (low, high) = (f64::from(bounds.lower[axis]), f64::from(bounds.upper[axis]));
            let (origin, step) = (self.lower[axis], self.step[axis]);
            // Where the quotient was rounded inwards, one more step outwards. A flat side has steps
            // of 0; their quotients are NaN and become 0 by the cast.
            let mut down = ((low - origin) / step).floor().clamp(0.0, Self::LAST);
            if down > 0.0 && origin + down * step > low {
                down -= 1.0;
            }
            let mut up = ((high - origin) / step).ceil().clamp(0.0, Self::LAST);
            if up < Self::LAST && origin + up * step < high {
                up += 1.0;
            }
            steps[axis] = down as u16;
            steps[axis + 3] = up as u16;
        }
        steps
    }

    /// Lower and upper corner of the box of steps, model units; infinite beyond the model's box.
    #[must_use]
    pub fn decode(&self, steps: [u16; 6]) -> (DVec3, DVec3) {
        let at = |k: usize| {
            let along = DVec3::new(
                f64::from(steps[k]),
                f64::from(steps[k + 1]),
                f64::from(steps[k + 2]),
            );
            self.lower + along * self.step
        };
        let (mut lower, mut upper) = (at(0), at(3));
        for axis in 0..3 {
            if steps[axis] == 0 {
                lower[axis] = f64::NEG_INFINITY;
            }
            if self.step[axis] == 0.0 || steps[axis + 3] == u16::MAX {
                upper[axis] = f64::INFINITY;
            }
        }
        (lower, upper)
    }

    /// Whether the box of steps meets a closed box.
    #[must_use]
    pub fn meets(&self, steps: [u16; 6], lower: DVec3, upper: DVec3) -> bool {
        let (own_lower, own_upper) = self.decode(steps);
        own_lower.cmple(upper).all() && own_upper.cmpge(lower).all()
    }
}

// The layout of the file (`FORMAT_VERSION`).
const _: () = assert!(size_of::<VspNode>() == 20 && std::mem::offset_of!(VspNode, bounds) == 8);

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn steps_enclose_the_box_and_are_at_most_one_and_a_half_wider(
            model in prop::array::uniform3((-1e3..1e3f64, 0.0..1e3f64)),
            corners in prop::array::uniform2(prop::array::uniform3(-0.2..1.2f64)),
            flat in 0usize..4,
        ) {
            let lower = model.map(|(low, _)| f64::from(low as f32));
            let mut upper = model.map(|(low, side)| f64::from((low + side) as f32));
            if flat < 3 {
                upper[flat] = lower[flat];
            }
            let scale = BoundsScale::new(lower, upper);
            let (lower, upper) = (DVec3::from_array(lower), DVec3::from_array(upper));
            // Bounds meet the model's box, but may extend beyond it.
            let [first, second] = corners.map(DVec3::from_array);
            let first = first.clamp(DVec3::ZERO, DVec3::ONE);
            let points = [first, second].map(|c| (lower + c * (upper - lower)).as_vec3());
            let bounds = Aabb::of_points(points);
            let (low, high) = scale.decode(scale.encode(&bounds));
            prop_assert!(low.cmple(bounds.lower.as_dvec3()).all());
            prop_assert!(high.cmpge(bounds.upper.as_dvec3()).all());
            let near = |a: f64, b: f64, side: f64| {
                a.is_infinite() || (a - b).abs() <= 1.5 * side / 65535.0
            };
            for axis in 0..3 {
                let side = upper[axis] - lower[axis];
                prop_assert!(near(low[axis], f64::from(bounds.lower[axis]), side));
                prop_assert!(near(high[axis], f64::from(bounds.upper[axis]), side));
            }
        }
    }

    #[test]
    fn everything_meets_the_model_and_children_come_later() {
        let scale = BoundsScale::new([0.0; 3], [1.0; 3]);
        let all = scale.encode(&Aabb {
            lower: Vec3::splat(-3.0),
            upper: Vec3::splat(9.0),
        });
        assert_eq!(all, [0, 0, 0, u16::MAX, u16::MAX, u16::MAX]);
        assert!(scale.meets(all, DVec3::splat(-2.0), DVec3::splat(-1.0)));
        let node = |children| VspNode {
            children,
            bounds: all,
        };
        assert!(node([4, NONE]).is_valid(3, 5));
        assert!(!node([3, NONE]).is_valid(3, 5));
        assert!(!node([4, 5]).is_valid(3, 5));
        assert!(!node([4, 4]).is_valid(3, 5));
    }
}
