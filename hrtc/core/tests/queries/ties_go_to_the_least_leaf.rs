//! The closest face is that of a search of all faces, bit for bit, and of equals the one whose leaf
//! key is least. A hint changes the cost of a search and nothing else.

use crate::common::fronts::{Front, models, plate_mesh, scaled};
use geometry::closest_point_on_triangle;
use glam::DVec3;
use hrtc_core::contact::query::closest_point;
use hrtc_core::contact::tool::ToolMesh;
use simulator::Random;
use spm::Handle;

/// The least distance, the face by the rule, and how many faces are as near.
fn of_all(front: &Front, point: DVec3) -> (f64, Handle, usize) {
    let distance =
        |&(_, t): &(Handle, [DVec3; 3])| closest_point_on_triangle(t, point).distance_squared;
    let least = front
        .faces
        .iter()
        .map(distance)
        .fold(f64::INFINITY, f64::min);
    let equals = || front.faces.iter().filter(|face| distance(face) == least);
    let first = equals().min_by_key(|(face, _)| front.tree.leaf_of(*face));
    (least, first.expect("a face is nearest").0, equals().count())
}

/// Asks without a hint and with several; whether it was a tie.
fn check(front: &Front, point: DVec3, random: &mut Random) -> bool {
    let (least, face, equals) = of_all(front, point);
    let mut hints = vec![None, Some(face)];
    hints.extend((0..4).map(|_| Some(front.any_face(random).0)));
    for hint in hints {
        let (nearest, work) = closest_point(front.surface(), point, hint);
        let nearest = nearest.expect("the front has faces");
        assert_eq!(nearest.closest.distance_squared, least, "{point} {hint:?}");
        assert_eq!(nearest.face, face, "{point} {hint:?}");
        assert!(work.faces as usize >= equals);
    }
    equals > 1
}

/// Above a vertex, an edge and a face of a plate, at any scale: six faces are equally near, two or
/// one.
#[test]
fn over_a_plate_at_any_scale() {
    let mut random = Random::new(4);
    for exponent in -6..=6 {
        let plate = scaled(&plate_mesh(1.0, 8), 10f64.powi(exponent));
        let front = Front::of_mesh(&plate);
        let size = front.diagonal();
        for _ in 0..40 {
            let [a, b, c] = front.any_face(&mut random).1;
            let up = DVec3::Z * (size * 0.1 * (random.unit() - 0.3));
            assert!(check(&front, a + up, &mut random), "a vertex has two faces");
            check(&front, 0.5 * (a + b) + up, &mut random);
            check(&front, (a + b + c) / 3.0 + up, &mut random);
        }
    }
}

/// A fan of more faces than a search keeps as candidates: over its middle all are equally near.
#[test]
fn in_the_middle_of_a_fan() {
    let mut random = Random::new(6);
    for faces in [5, 16, 17, 33, 60] {
        let rim = |k: u32| {
            let angle = std::f64::consts::TAU * f64::from(k % faces) / f64::from(faces);
            DVec3::new(angle.cos(), angle.sin(), -0.5)
        };
        let mesh = ToolMesh {
            positions: (0..faces).map(rim).chain([DVec3::ZERO]).collect(),
            triangles: (0..faces).map(|k| [k, (k + 1) % faces, faces]).collect(),
        };
        let front = Front::of_mesh(&mesh);
        for height in [0.0, 1e-3, 0.4, 50.0] {
            let is_tie = check(&front, DVec3::Z * height, &mut random);
            assert!(is_tie, "{faces} {height}");
        }
    }
}

/// On, near and far from fronts of many sorts.
#[test]
fn on_fronts_from_coarse_to_full() {
    let mut random = Random::new(5);
    let mut ties = 0;
    for (name, parts) in models(1500) {
        for chance in [0, 60, 97, 100] {
            let front = Front::new(&parts, chance, &mut random);
            let size = front.diagonal();
            for k in 0..40 {
                let [a, b, _] = front.any_face(&mut random).1;
                let point = match k % 4 {
                    0 => a,
                    1 => a.lerp(b, 0.5),
                    2 => a + random.vector() * (0.05 * size),
                    _ => a + random.vector() * (2.0 * size),
                };
                ties += usize::from(check(&front, point, &mut random));
            }
        }
        println!("{name}: {ties} ties so far");
    }
    assert!(ties > 100, "{ties}");
}
