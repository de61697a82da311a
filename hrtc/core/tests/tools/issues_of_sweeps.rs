//! Hard cases reported to other libraries, each named after its issue, of moving and sliding
//! bodies. Those of resting pairs are in `issues_of_collision_libraries`.

use crate::common::fronts::{Front, box_mesh, plate_mesh};
use crate::common::signed_distance::signed_distance;
use glam::DVec3;
use hrtc_core::contact::query::{closest_point, swept_sphere};
use simulator::Random;

/// dimforge/parry #70: sweeps at coordinates of a hundred units went through. Balls dropped
/// onto a plate there all land.
#[test]
fn parry_issue_70() {
    let far = DVec3::new(100.0, -100.0, 100.0);
    let mut plate = plate_mesh(2.0, 16);
    plate.positions.iter_mut().for_each(|p| *p += far);
    let front = Front::of_mesh(&plate);
    for k in 0..=400 {
        let along = -1.9 + 3.8 * f64::from(k) / 400.0;
        let above = far + DVec3::new(along, 0.3 * along, 1.0);
        let (hit, _) = swept_sphere(front.surface(), above, DVec3::Z * -2.0, 0.1);
        let free = hit.expect("the ball lands").fraction;
        assert!((free - 0.45).abs() < 1e-9, "{along} {free}");
    }
}

/// dimforge/rapier #95, #404, #524, parry PR #101: ghost contacts at inner edges. A ball that
/// slides over a plate of many faces is pushed straight up on faces, edges and corners, and not
/// stopped.
#[test]
fn rapier_issue_95() {
    let front = Front::of_mesh(&plate_mesh(2.0, 16));
    let radius = 0.3;
    let mut hint = None;
    for k in 0..=800 {
        let along = -1.5 + 3.0 * f64::from(k) / 800.0;
        for across in [0.0, 0.25, 0.1] {
            let pressed = DVec3::new(along, across, 0.9 * radius);
            let (nearest, _) = closest_point(front.surface(), pressed, hint);
            let nearest = nearest.expect("it has faces");
            hint = Some(nearest.face);
            let up = pressed - nearest.closest.point;
            assert!(up.truncate().length() < 1e-15 && up.z > 0.0, "{up}");
            let resting = pressed.with_z(radius * (1.0 + 1e-6));
            let slide = DVec3::new(0.4, -0.1, 0.0);
            assert!(
                swept_sphere(front.surface(), resting, slide, radius)
                    .0
                    .is_none()
            );
        }
    }
}

/// dimforge/rapier #331: a surface has no inside, so what is past it in one step stays there. A
/// sweep from where it was is stopped, however thin the plate, and the side is known on both.
#[test]
fn rapier_issue_331() {
    for thickness in [1e-2, 1e-4, 1e-6] {
        let plate = Front::of_mesh(&box_mesh(DVec3::new(1.0, 1.0, 0.5 * thickness)));
        let mut random = Random::new(331);
        for _ in 0..300 {
            let from = random.vector().with_z(0.0) * 0.8 + DVec3::Z * 0.3;
            let motion = random.vector() * 0.1 - DVec3::Z * 0.6;
            let radius = 1e-3;
            let (hit, _) = swept_sphere(plate.surface(), from, motion, radius);
            let hit = hit.expect("it does not get through");
            let centre = from + motion * hit.fraction;
            assert!(
                (centre.z - radius - 0.5 * thickness).abs() < 1e-8,
                "{centre}"
            );
            for (point, outside) in [(centre, true), (centre.with_z(0.2 * thickness), false)] {
                let nearest = closest_point(plate.surface(), point, None).0;
                let nearest = nearest.expect("it has faces");
                let signed = signed_distance(plate.surface(), point, &nearest);
                assert_eq!(signed > 0.0, outside, "{thickness} {point}");
            }
        }
    }
}
