//! A point changes sides exactly when the volume that a split or collapse sweeps holds it: the
//! winding number of the whole closed front is the oracle.

use crate::common::{build, load};
use geometry::solid_angle;
use glam::DVec3;
use rand::{RngCore, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use spm::{ActiveMesh, FrontWalk};
use spm_builder::generate::{Shape, generate};
use std::f64::consts::TAU;

/// How often the front winds round a point.
fn winding(mesh: &ActiveMesh, point: DVec3) -> f64 {
    let mut sum = 0.0;
    mesh.for_each_active_face(|face| sum += solid_angle(mesh.corners(face), point));
    sum / (2.0 * TAU)
}

#[test]
fn a_point_changes_sides_exactly_when_it_is_swept_over() {
    let seed = 21;
    println!("seed {seed}");
    for (shape, name) in Shape::ALL {
        let closed = matches!(shape, Shape::Sphere | Shape::Torus | Shape::Relief);
        if !closed {
            continue;
        }
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let parts = build(&generate(shape, 2000, 3), Some(60));
        let mut walk = FrontWalk::new(load(&parts));
        let (mut swept, mut stayed) = (0u32, 0u32);
        for _ in 0..6000 {
            let before = walk.mesh.clone();
            // More splits than collapses while the front is coarse, so that every level is met.
            let splits = random.next_u32() % 2000 > walk.mesh.active_faces();
            let next = &mut || random.next_u32();
            let done = if splits {
                walk.split(next, |_| true)
            } else {
                walk.collapse(next)
            };
            if done.is_none() {
                continue;
            }
            // Points that the operation moved things around: mixtures of corners before and after.
            let face = walk.out.deformed()[random.next_u32() as usize % walk.out.deformed().len()];
            let unit =
                |random: &mut Xoshiro256PlusPlus| f64::from(random.next_u32()) / 2f64.powi(32);
            let corners = [before.corners(face), walk.mesh.corners(face)];
            let [old, new] = corners.map(|[a, b, c]| {
                let (s, t) = (unit(&mut random), unit(&mut random));
                let (s, t) = if s + t > 1.0 {
                    (1.0 - s, 1.0 - t)
                } else {
                    (s, t)
                };
                a + (b - a) * s + (c - a) * t
            });
            let point = old.lerp(new, 1.5 * unit(&mut random) - 0.25);
            let windings = [&before, &walk.mesh].map(|mesh| winding(mesh, point));
            let whole = windings.map(f64::round);
            // On the surface itself there is no side.
            if windings
                .iter()
                .zip(whole)
                .any(|(w, whole)| (w - whole).abs() > 1e-6)
            {
                continue;
            }
            let over = walk.mesh.swept_over(&walk.out, point);
            assert_eq!(
                over,
                whole[0] != whole[1],
                "{name}: {windings:?} at {point}"
            );
            if over {
                swept += 1;
            } else {
                stayed += 1;
            }
        }
        println!("{name}: {swept} points swept over, {stayed} not");
        assert!(swept > 500 && stayed > 500, "{name}: {swept} {stayed}");
    }
}
