//! Functions whose results are the same bits on every machine.
//!
//! The standard library takes sines, powers and their like from the C library of the machine, where
//! they differ by its version and by the processor (with or without fused products): a recording
//! would not replay elsewhere. These come from the crate `libm`. Sums, products, quotients and
//! square roots are the same everywhere.

use glam::{DQuat, DVec3};

pub use libm::{atan2, cos, exp, exp2, hypot, log as ln, log2, pow, sin, sincos as sin_cos};

/// The rotation about an axis by the length of the axis, radians.
#[must_use]
pub fn rotation(scaled_axis: DVec3) -> DQuat {
    let angle = scaled_axis.length();
    if angle == 0.0 {
        return DQuat::IDENTITY;
    }
    about(scaled_axis / angle, angle)
}

/// The rotation about a unit axis by an angle, radians.
#[must_use]
pub fn about(axis: DVec3, angle: f64) -> DQuat {
    let (sine, cosine) = sin_cos(0.5 * angle);
    let [x, y, z] = (axis * sine).to_array();
    DQuat::from_xyzw(x, y, z, cosine)
}

/// Rotation vector of a unit quaternion, radians, by the shorter way: a length of at most pi. Of
/// the smallest turns too, which glam takes for none.
#[must_use]
pub fn rotation_vector(turn: DQuat) -> DVec3 {
    let turn = if turn.w < 0.0 { -turn } else { turn };
    let sine = turn.xyz();
    let length = sine.length();
    // The angle divided by its sine; both vanish together.
    let stretch = if length > 0.0 {
        2.0 * atan2(length, turn.w) / length
    } else {
        2.0
    };
    sine * stretch
}

/// The unit quaternion at a share of the shorter way from one to another.
#[must_use]
pub fn slerp(from: DQuat, to: DQuat, share: f64) -> DQuat {
    (rotation(rotation_vector(to * from.conjugate()) * share) * from).normalize()
}

/// Angle between two unit quaternions, radians: at most pi.
#[must_use]
pub fn turn_between(one: DQuat, other: DQuat) -> f64 {
    rotation_vector(other * one.conjugate()).length()
}

/// Angle between two vectors, radians, that are not zero.
#[must_use]
pub fn angle_between(one: DVec3, other: DVec3) -> f64 {
    atan2(one.cross(other).length(), one.dot(other))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The bits that this build must give on any machine. Of libm 0.2; a newer one that gives
    /// others ends the replay of earlier recordings.
    #[test]
    fn the_bits_are_those_of_every_machine() {
        let found = [
            sin(1.1),
            cos(2.7),
            sin_cos(0.3).0,
            atan2(0.7, -0.2),
            exp(-0.37),
            exp2(3.3),
            ln(17.1),
            log2(0.013),
            pow(0.97, 13.7),
            hypot(0.3, 0.7),
        ];
        let expected = [
            0x3fec_84c5_4c2d_6338,
            0xbfec_ee28_b366_03a6,
            0x3fd2_e9cd_95ba_ba33,
            0x3ffd_95e5_ac22_d08d,
            0x3fe6_1a7e_e209_faff,
            0x4023_b2c4_7bff_8328,
            0x4006_b66e_c4fc_6122,
            0xc019_0fb6_7c6d_8411,
            0x3fe5_1520_b869_ac7c,
            0x3fe8_5ed7_614b_038c,
        ];
        assert_eq!(found.map(f64::to_bits), expected, "{found:?}");
    }

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array)
    }

    proptest! {
        #[test]
        fn a_rotation_and_its_vector_are_inverse(axis in vector(), small in 0u32..40) {
            let axis = axis * 0.5f64.powi(small as i32);
            let turn = rotation(axis);
            prop_assert!((turn.length() - 1.0).abs() < 1e-15);
            prop_assert!((rotation_vector(turn) - axis).length() <= 1e-15 * axis.length());
            prop_assert!((rotation_vector(-turn) - axis).length() <= 1e-15 * axis.length());
        }

        #[test]
        fn a_slerp_goes_the_shorter_way_at_a_constant_rate(
            from in vector(), turn in vector(), share in 0.0..1.0f64,
        ) {
            let from = rotation(from * 3.0);
            let to = rotation(turn) * from;
            for to in [to, -to] {
                let at = slerp(from, to, share);
                prop_assert!((turn_between(from, at) - share * turn.length()).abs() < 1e-14);
                prop_assert!((turn_between(at, to) - (1.0 - share) * turn.length()).abs() < 1e-14);
            }
        }

        #[test]
        fn the_angle_between_vectors_is_that_of_the_rotation(one in vector(), turn in 0.0..3.1f64) {
            let across = one.any_orthogonal_vector();
            prop_assume!(one.length() > 1e-3);
            let other = about(across.normalize(), turn) * one;
            prop_assert!((angle_between(one, other * 7.0) - turn).abs() < 1e-14);
        }
    }
}
