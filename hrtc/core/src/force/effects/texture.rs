//! Texture: a relief over the surface, given by its height h without faces (Ho 1999).
//!
//! The depth changes by h, and the normal n becomes `n' = n - ∇h + (∇h · n) n`. It is not
//! normalised: the force is then the gradient of `K d² / 2` with the depth d, so a closed path
//! gains no energy.
//!
//! Each contact of a tool has its own height and slope, and its share of the surface's stiffness:
//! where all of them are lowered by the same, the sum of their forces falls as that of one contact.
//!
//! The surface is lowered by the largest height, so that a first contact is not a step. A wave that
//! is too short for the rate of the loop, with `v / wavelength` near half the rate, fades out
//! before it aliases (Choi 2004 gives the limits of perception). Of a height map only the fine
//! levels fade.

use super::contact_set::Acting;
use super::{ContactSample, Rendered};
use geometry::portable::{log2, sin_cos};
use glam::{DVec2, DVec3};
use mutants::{Mutant, is};
use scene::{Pattern, TexturePlan};
use std::f64::consts::TAU;

/// Relief of one surface.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Texture {
    plan: TexturePlan,
}

/// Height and gradient at a place, for an amplitude of 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Relief {
    /// Relative height, -1 to 1.
    pub height: f64,
    /// Gradient of the relative height, object's axes, 1/m.
    pub gradient: DVec3,
}

impl Texture {
    /// The planned texture.
    #[must_use]
    pub fn new(plan: TexturePlan) -> Self {
        Self { plan }
    }

    /// Applies the relief to the force of each contact and to the spring, scaled by `amount` (0 to
    /// 1).
    pub fn raise(
        &self,
        at: &ContactSample<'_>,
        contacts: &mut [Acting],
        amount: f64,
        out: &mut Rendered,
    ) {
        let (mut whole, mut lowered) = (0.0, 0.0);
        for contact in contacts {
            let size = contact.force.length();
            if size > 0.0 && size.is_finite() {
                whole += size;
                lowered += self.raise_one(at, (contact, size), amount, out);
            }
        }
        // Damping is no part of the spring, which is as long as without it.
        let spring = whole * at.undamped;
        if spring > 0.0 && spring.is_finite() {
            let left = (spring + lowered).max(0.0) / spring;
            out.spring.stored_j *= left * left;
        }
    }

    /// Applies it to a contact with a normal force of this size. Returns by how much that changes
    /// its spring, newtons.
    fn raise_one(
        &self,
        at: &ContactSample<'_>,
        (contact, size): (&mut Acting, f64),
        amount: f64,
        out: &mut Rendered,
    ) -> f64 {
        let normal = contact.force / size;
        let step = step_along(at, normal, contact.arm);
        let relief = relief(&self.plan.pattern, contact.point + at.origin, step);
        let amplitude = amount * self.plan.amplitude_m;
        let lowered = amplitude * (relief.height - 1.0);
        let slope = relief.gradient * amplitude;
        let tilted = normal - slope + normal * normal.dot(slope);
        let lowered_n = at.paid_n_per_m * contact.share * lowered;
        let pressed = (size + lowered_n).max(0.0);
        let force = tilted * pressed;
        contact.add(force - contact.force, out);
        lowered_n
    }
}

/// Motion of the probe in a period at a lever arm, along the surface of a normal, metres: what is
/// estimated comes after a sudden motion by some periods, what the samples say has their noise.
fn step_along(at: &ContactSample<'_>, normal: DVec3, arm: DVec3) -> f64 {
    let measured = at.moved.linear + at.moved.angular.cross(arm);
    let estimated = at.velocity_at(arm) * at.clock.period_s;
    let along = |motion: DVec3| (motion - normal * normal.dot(motion)).length();
    along(measured).max(along(estimated))
}

/// Relief of a pattern at a place of the object (metres). `step`: displacement of the probe along
/// the surface in a tick, metres.
#[must_use]
pub fn relief(pattern: &Pattern, place: DVec3, step: f64) -> Relief {
    match pattern {
        Pattern::Grating {
            wavelength_m,
            direction,
        } => {
            let (sine, cosine) = sin_cos(TAU * (place.dot(*direction) / wavelength_m).fract());
            let share = share(*wavelength_m, step);
            Relief {
                height: share * sine,
                gradient: *direction * (share * cosine * TAU / wavelength_m),
            }
        }
        Pattern::Noise { wavelength_m, seed } => {
            let (height, gradient) = noise(place / *wavelength_m, *seed);
            let share = share(*wavelength_m, step);
            Relief {
                height: share * height,
                gradient: gradient * (share / wavelength_m),
            }
        }
        Pattern::HeightMap { map, width_m, axis } => {
            let across = DVec2::new(*width_m, width_m / map.aspect());
            // The other two axes, in cyclic order.
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            // The shortest wave of a level is two samples, and has to last more than two ticks. The
            // quadratic spline of a level may keep half of a shorter wave: one level more.
            let apart = width_m / map.width() as f64;
            let coarseness = log2((2.0 * step / apart).max(f64::MIN_POSITIVE));
            let at = map.at(DVec2::new(place[u], place[v]) / across, coarseness);
            let mut gradient = DVec3::ZERO;
            gradient[u] = at.slope.x / across.x;
            gradient[v] = at.slope.y / across.y;
            Relief {
                height: at.height,
                gradient,
            }
        }
    }
}

/// Remaining amplitude, 0 to 1, of a wave (metres) for a displacement per tick (metres): 1 up to a
/// quarter of the rate of the loop, 0 from half of it on, linear between.
fn share(wavelength: f64, step: f64) -> f64 {
    let least = if is(Mutant::Alias) { 1.0 } else { 0.0 };
    (2.0 - 4.0 * step / wavelength).clamp(least, 1.0)
}

/// Smooth noise, -1 to 1, and its gradient, for a place in units of the wavelength: random heights
/// at whole coordinates, blended by the quintic of Perlin 2002, which has a smooth slope.
fn noise(place: DVec3, seed: u64) -> (f64, DVec3) {
    let cell = place.floor();
    let within = place - cell;
    let blend = |t: f64| {
        (
            t * t * t * (t * (6.0 * t - 15.0) + 10.0),
            30.0 * t * t * (t - 1.0) * (t - 1.0),
        )
    };
    let [(sx, dx), (sy, dy), (sz, dz)] = within.to_array().map(blend);
    let mut height = 0.0;
    let mut gradient = DVec3::ZERO;
    for corner in 0..8u32 {
        let side = |bit: u32, s: f64, d: f64| {
            if corner >> bit & 1 == 1 {
                (s, d)
            } else {
                (1.0 - s, -d)
            }
        };
        let [(wx, gx), (wy, gy), (wz, gz)] = [side(0, sx, dx), side(1, sy, dy), side(2, sz, dz)];
        let offset = DVec3::new(
            f64::from(corner & 1),
            f64::from(corner >> 1 & 1),
            f64::from(corner >> 2 & 1),
        );
        let value = random((cell + offset).to_array().map(|x| x as i64), seed);
        height += value * wx * wy * wz;
        gradient += value * DVec3::new(gx * wy * wz, wx * gy * wz, wx * wy * gz);
    }
    (height, gradient)
}

/// A pseudorandom number, -1 to 1, of a lattice point: mixing steps of SplitMix64 (Lea 2014).
fn random(cell: [i64; 3], seed: u64) -> f64 {
    let mut bits = seed;
    for x in cell {
        bits = (bits ^ x as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
        bits = (bits ^ bits >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ bits >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^= bits >> 31;
    }
    (bits >> 11) as f64 * (2.0 / (1u64 << 53) as f64) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::effects::contact_set::{ContactSet, Push};
    use crate::force::effects::tests::Bench;
    use crate::force::passivity::CouplingSpring;
    use proptest::prelude::*;
    use scene::HeightMap;
    use std::sync::Arc;

    /// While a probe moves in or out, damping adds to the force of the surface or takes from it;
    /// the energy in its spring is that of its length.
    #[test]
    fn the_energy_of_the_spring_does_not_depend_on_damping() {
        let plan = TexturePlan {
            amplitude_m: 1e-4,
            pattern: patterns().swap_remove(0),
        };
        let texture = Texture::new(plan);
        let stiffness_n_per_m = 800.0;
        let depth_m = 1e-3;
        let mut bench = Bench::new(0.01);
        let stored = [0.5, 1.0, 2.0].map(|damped| {
            let force = DVec3::Y * (stiffness_n_per_m * depth_m * damped);
            let passive = geometry::Wrench {
                force,
                ..geometry::Wrench::ZERO
            };
            let spring = CouplingSpring {
                stiffness_n_per_m,
                stored_j: 0.5 * stiffness_n_per_m * depth_m * depth_m,
                raised_j: 0.0,
            };
            let mut out = Rendered::new(passive, spring);
            bench.step();
            let pushes = [0.3, 0.7].map(|share| Push {
                point: DVec3::ZERO,
                force: force * share,
            });
            let sample = ContactSample {
                undamped: 1.0 / damped,
                ..bench.sample(&pushes)
            };
            let mut contacts = ContactSet::default().track(&sample, force);
            texture.raise(&sample, contacts.all(), 1.0, &mut out);
            out.spring.stored_j
        });
        // At its middle height the relief lies an amplitude below its crests.
        let due = 0.5 * stiffness_n_per_m * (depth_m - 1e-4) * (depth_m - 1e-4);
        for stored in stored {
            assert!((stored / due - 1.0).abs() < 1e-12, "{stored} {due}");
        }
    }

    fn patterns() -> Vec<Pattern> {
        let samples = (0..32 * 16).map(|k| random([k, 0, 0], 7) as f32);
        let map = HeightMap::new(32, 16, samples.collect());
        vec![
            Pattern::Grating {
                wavelength_m: 2e-3,
                direction: DVec3::new(0.6, 0.0, 0.8),
            },
            Pattern::Noise {
                wavelength_m: 3e-3,
                seed: 5,
            },
            Pattern::HeightMap {
                map: Arc::new(map),
                width_m: 0.05,
                axis: 1,
            },
        ]
    }

    proptest! {
        #[test]
        fn the_gradient_is_that_of_the_height(
            x in -0.1..0.1f64, y in -0.1..0.1f64, z in -0.1..0.1f64, step in 0.0..4e-4f64,
        ) {
            let place = DVec3::new(x, y, z);
            for pattern in patterns() {
                let here = relief(&pattern, place, step);
                prop_assert!(here.height.abs() <= 1.0 + 1e-12);
                let h = 1e-8;
                for axis in 0..3 {
                    let d = DVec3::AXES[axis] * h;
                    let [a, b] = [d, -d].map(|d| relief(&pattern, place + d, step).height);
                    let slope = (a - b) / (2.0 * h);
                    let found = here.gradient[axis];
                    prop_assert!(
                        (slope - found).abs() < 0.05 + 1e-3 * slope.abs(),
                        "{pattern:?} {axis} {slope} {found}"
                    );
                }
            }
        }

        #[test]
        fn waves_beyond_the_rate_of_the_loop_have_no_amplitude(x in -0.1..0.1f64) {
            for pattern in patterns() {
                // Half a wave per tick; for the map its whole width.
                let step = match &pattern {
                    Pattern::Grating { wavelength_m, .. }
                    | Pattern::Noise { wavelength_m, .. } => 0.5 * wavelength_m,
                    Pattern::HeightMap { width_m, .. } => *width_m,
                };
                let [a, b] = [0.0, 1.3e-3]
                    .map(|d| relief(&pattern, DVec3::splat(x + d), step).height);
                prop_assert!((a - b).abs() < 1e-9, "{pattern:?}");
            }
        }
    }
}
