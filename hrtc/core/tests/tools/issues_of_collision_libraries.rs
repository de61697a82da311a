//! Hard cases reported to other libraries, each named after its issue, of pairs of bodies and of
//! points of meshes. Those of single triangles are beside the triangle tests of `geometry`.

use crate::common::fronts::{Front, box_mesh, frame, full_mesh, plate_mesh, scaled};
use crate::common::signed_distance::signed_distance;
use geometry::{Pose, Similarity, TrianglePair, closest_point_on_triangle};
use glam::{DQuat, DVec3};
use hrtc_core::contact::query::{Body, Ending, FacePair, all_pairs, closest_point};
use hrtc_core::contact::tool::{Tool, ToolMesh, capsule_mesh, cylinder_mesh};
use simulator::Random;

fn tool(mesh: &ToolMesh) -> Tool {
    Tool::new(mesh).expect("the mesh is a tool")
}

fn pairs<A: Body, B: Body>(a: &A, b: &B) -> Vec<FacePair> {
    let mut out = vec![FacePair::NONE; 1 << 16];
    let found = all_pairs(a, b, u32::MAX, &mut out);
    assert_eq!(found.ending, Ending::Complete);
    out.truncate(found.count);
    out
}

/// dimforge/parry #17: a cube of 1e-10 (metres in Angstrom) panicked; here any unit from 1e-10 to
/// 1e6.
#[test]
fn parry_issue_17() {
    for exponent in -10..=6 {
        let s = 10f64.powi(exponent);
        let cube = Front::of_mesh(&scaled(&box_mesh(DVec3::splat(0.5)), s));
        for x in [0.7, 1.0, 40.0] {
            let point = DVec3::new(x, 0.2, -0.1) * s;
            let nearest = closest_point(cube.surface(), point, None)
                .0
                .expect("it has faces");
            let signed = signed_distance(cube.surface(), point, &nearest);
            assert!((signed / s - (x - 0.5)).abs() < 1e-6, "{exponent} {signed}");
        }
        let inside = DVec3::new(0.3, 0.2, -0.1) * s;
        let nearest = closest_point(cube.surface(), inside, None)
            .0
            .expect("it has faces");
        assert!((signed_distance(cube.surface(), inside, &nearest) / s + 0.2).abs() < 1e-6);
    }
}

/// dimforge/parry #395: a NaN panicked. A pose that is none is refused where it is made.
#[test]
fn parry_issue_395() {
    let good = Pose::IDENTITY;
    for bad in [f64::NAN, f64::INFINITY] {
        let mut pose = good;
        pose.position.y = bad;
        assert!(Similarity::new(pose, 1.0).is_none());
        let mut pose = good;
        pose.orientation.z = bad;
        assert!(Similarity::new(pose, 1.0).is_none());
        assert!(Similarity::new(good, bad).is_none());
    }
    let huge = |x: f64| frame(DVec3::splat(x), DQuat::IDENTITY, 1.0);
    assert!(Similarity::relative(&huge(1e308), &huge(-1e308)).is_none());
}

/// dimforge/parry #396: coaxial cylinders one in the other "do not intersect": their surfaces do
/// not, until one reaches out of the other.
#[test]
fn parry_issue_396() {
    let big = Front::of_mesh(&cylinder_mesh(100.0, 100.0, 2000));
    let mut small = tool(&cylinder_mesh(1.0, 3.0, 240));
    for x in [0.0, 1e-9, 5.0] {
        small.place(&frame(DVec3::X * x, DQuat::IDENTITY, 1.0));
        assert!(pairs(&big.surface(), &small).is_empty());
    }
    // Half out at the end, still coaxial.
    small.place(&frame(DVec3::Z * 50.0, DQuat::IDENTITY, 1.0));
    assert!(!pairs(&big.surface(), &small).is_empty());
}

/// dimforge/parry #387, #388: with the two exchanged hits were missed. A capsule and a box in 200
/// poses.
#[test]
fn parry_issue_387() {
    let mut random = Random::new(387);
    let (of_box, of_capsule) = (box_mesh(DVec3::ONE), capsule_mesh(0.3, 1.5, 12, 10));
    let (front_box, front_capsule) = (Front::of_mesh(&of_box), Front::of_mesh(&of_capsule));
    let (mut tool_box, mut tool_capsule) = (tool(&of_box), tool(&front_capsule.as_mesh()));
    let mut hits = 0;
    for _ in 0..200 {
        let turn = random.orientation();
        let position = random.vector() * 1.6;
        tool_capsule.place(&frame(position, turn, 1.0));
        tool_box.place(&frame(turn.inverse() * -position, turn.inverse(), 1.0));
        let one = pairs(&front_box.surface(), &tool_capsule);
        let other = pairs(&front_capsule.surface(), &tool_box);
        let mut one: Vec<_> = one
            .iter()
            .map(|p| (p.a, front_capsule.faces[p.b as usize].0))
            .collect();
        let mut other: Vec<_> = other.iter().map(|p| (p.b, p.a)).collect();
        one.sort_unstable();
        other.sort_unstable();
        assert_eq!(one, other);
        hits += usize::from(!one.is_empty());
    }
    assert!(hits > 40 && hits < 200, "{hits}");
}

/// dimforge/parry #289, #132: coplanar faces crashed. A box flat on a plate: overlaps in a plane,
/// and only touches.
#[test]
fn parry_issue_289() {
    let plate = Front::of_mesh(&plate_mesh(2.0, 8));
    let mut flat = tool(&box_mesh(DVec3::new(0.6, 0.7, 0.25)));
    flat.place(&frame(
        DVec3::new(0.125, 0.0625, 0.25),
        DQuat::IDENTITY,
        1.0,
    ));
    let found = pairs(&plate.surface(), &flat);
    let coplanar = |p: &&FacePair| matches!(p.meeting, TrianglePair::Coplanar { .. });
    assert!(found.iter().filter(coplanar).count() > 10);
    assert!(
        !found
            .iter()
            .any(|p| matches!(p.meeting, TrianglePair::Crossing { .. }))
    );
    for pair in &found {
        let point = pair.meeting.point().expect("they meet");
        assert!(point.z.abs() < 1e-15);
        assert!((point.x - 0.125).abs() <= 0.6 + 1e-12 && (point.y - 0.0625).abs() <= 0.7 + 1e-12);
    }
}

/// flexible-collision-library/fcl #106: contacts of a box on a box lay at corners of the larger
/// one, and twice. Here each pair is there once and all contact is within the overlap.
#[test]
fn fcl_issue_106() {
    let ground = Front::of_mesh(&box_mesh(DVec3::new(2.0, 2.0, 0.5)));
    let mut cube = tool(&box_mesh(DVec3::splat(0.5)));
    cube.place(&frame(DVec3::new(0.3, 0.2, 1.0), DQuat::IDENTITY, 1.0));
    let found = pairs(&ground.surface(), &cube);
    assert!(!found.is_empty());
    let mut names: Vec<_> = found.iter().map(|p| (p.a, p.b)).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), found.len());
    for pair in &found {
        let point = pair.meeting.point().expect("they meet");
        assert_eq!(point.z, 0.5);
        assert!((point.x - 0.3).abs() <= 0.5 + 1e-12 && (point.y - 0.2).abs() <= 0.5 + 1e-12);
    }
}

/// BerkeleyAutomation/python-fcl #54, fcl #275, #127, #525: nearest points must lie on what they
/// are nearest points of. The numbers are python-fcl's.
#[test]
fn python_fcl_issue_54() {
    let positions = [
        [1.0, 1.0, 1.0],
        [2.0, 1.0, 1.0],
        [1.0, 2.0, 1.0],
        [1.0, 1.0, 2.0],
    ];
    let mesh = ToolMesh {
        positions: positions.map(DVec3::from_array).to_vec(),
        triangles: vec![[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]],
    };
    let front = Front::of_mesh(&mesh);
    let query = DVec3::new(1.5, 1.25, 1.0);
    let nearest = closest_point(front.surface(), query, None)
        .0
        .expect("it has faces");
    assert!(nearest.closest.point.distance(query) < 1e-15);
}

/// coal-library/coal #636: contacts of all NaN. Nothing that is not finite comes out, degenerate
/// faces included.
#[test]
fn coal_issue_636() {
    let mut random = Random::new(636);
    for _ in 0..300 {
        // Faces with repeated, collinear and near corners among others.
        let mut soup = || {
            let mut mesh = ToolMesh::default();
            for k in 0..60u32 {
                let a = random.vector() * 0.3;
                let (b, c) = match k % 5 {
                    0 => (a, a),
                    1 => (a + DVec3::X * 0.1, a + DVec3::X * 0.3),
                    2 => (a, random.vector()),
                    3 => (a + DVec3::splat(1e-30), random.vector()),
                    _ => (random.vector(), random.vector()),
                };
                mesh.positions.extend([a, b, c]);
                mesh.triangles.push([3 * k, 3 * k + 1, 3 * k + 2]);
            }
            mesh
        };
        let (a, mut b) = (Front::of_mesh(&soup()), tool(&soup()));
        let scale = 10f64.powi(random.below(13) as i32 - 6);
        b.place(&frame(random.vector() * 0.1, random.orientation(), scale));
        for pair in pairs(&a.surface(), &b) {
            let finite = match pair.meeting {
                TrianglePair::Disjoint => false,
                TrianglePair::Coplanar { centre } => centre.is_finite(),
                TrianglePair::Crossing { from, to }
                | TrianglePair::Boundary { from, to }
                | TrianglePair::Degenerate { from, to } => from.is_finite() && to.is_finite(),
            };
            assert!(finite, "{pair:?}");
        }
    }
}

/// coal-library/coal #440, #609: a sphere of radius 50 with a gap of 1e-6 to a mesh was a hit, its
/// contact outside the sphere.
#[test]
fn coal_issue_440() {
    let mut plate = plate_mesh(100.0, 40);
    // Bumps, the highest at 0.
    for p in &mut plate.positions {
        p.z = -(0.01 * (p.x * 0.7).sin().powi(2) + 0.01 * (p.y * 0.3).cos().powi(2));
    }
    let front = Front::of_mesh(&plate);
    for gap in [1e-6, 1e-9, -1e-6] {
        let at = closest_point(front.surface(), DVec3::new(-2.0, 3.0, 50.0), None).0;
        let nearest = at.expect("it has faces").closest;
        // The ball that is moved along the line to the nearest point keeps that point nearest.
        assert!(nearest.distance_squared.sqrt() > 50.0 + gap);
        let centre = nearest.point
            + (DVec3::new(-2.0, 3.0, 50.0) - nearest.point).normalize() * (50.0 + gap);
        let at = closest_point(front.surface(), centre, None).0;
        let nearest = at.expect("it has faces").closest;
        let distance = nearest.distance_squared.sqrt() - 50.0;
        assert!((distance - gap).abs() < 1e-12, "{distance} for {gap}");
        assert!((nearest.point.distance(centre) - 50.0 - distance).abs() < 1e-12);
    }
}

/// mikedh/trimesh #741, unibas-gravis/scalismo #262: one degenerate face among many gave an index
/// of NaN.
#[test]
fn scalismo_issue_262() {
    let mut mesh = full_mesh("cow.obj", 4000);
    let first = mesh.positions.len() as u32;
    let on_it = mesh.positions[mesh.triangles[7][0] as usize];
    mesh.positions
        .extend([on_it, on_it, on_it + DVec3::X * 0.01]);
    mesh.triangles.push([first, first + 1, first + 2]);
    let front = Front::of_mesh(&mesh);
    let size = front.diagonal();
    let mut random = Random::new(262);
    for _ in 0..200 {
        let point = on_it + random.vector() * 0.1 * size;
        let nearest = closest_point(front.surface(), point, None)
            .0
            .expect("it has faces");
        let brute = front
            .faces
            .iter()
            .map(|(_, t)| closest_point_on_triangle(*t, point).distance_squared);
        let least = brute.fold(f64::INFINITY, f64::min);
        assert!((nearest.closest.distance_squared - least).abs() <= 1e-12 * size * size);
    }
}

/// dimforge/parry #58, #333, PR #100: signs along faces, edges and corners, with a face of no area
/// beside them.
#[test]
fn parry_issue_58() {
    let mut cube = box_mesh(DVec3::ONE);
    // The edge from 0 to 1 is cut by a face without area that its two faces share.
    let middle = cube.positions.len() as u32;
    cube.positions.push(DVec3::new(0.0, -1.0, -1.0));
    let [a, b] = [0u32, 1];
    for t in &mut cube.triangles {
        if t.contains(&a) && t.contains(&b) && t.iter().any(|&v| cube.positions[v as usize].z > 0.0)
        {
            *t = t.map(|v| if v == b { middle } else { v });
        }
    }
    cube.triangles.push([a, b, middle]);
    let fourth = 5;
    cube.triangles.push([middle, b, fourth]);
    let front = Front::of_mesh(&cube);
    let mut random = Random::new(58);
    for _ in 0..2000 {
        let p = random.vector() * 1.5;
        let on_feature = DVec3::from_array(
            p.to_array()
                .map(|x| if x.abs() > 1.2 { x.signum() * 1.2 } else { x }),
        );
        for point in [p, on_feature] {
            let nearest = closest_point(front.surface(), point, None)
                .0
                .expect("it has faces");
            let signed = signed_distance(front.surface(), point, &nearest);
            let inside = point.abs().max_element() < 1.0;
            assert_eq!(signed < 0.0, inside, "{point} {signed}");
        }
    }
}

/// The unit sweep : a capsule at a model of 0.001 to 1000 units meets the same faces. GJK lost 98 %
/// of the contacts of a 10 cm object in metres.
#[test]
fn the_unit_of_length_does_not_change_what_meets() {
    let whole = full_mesh("bunny20k.obj", 20_000);
    let plain = Front::of_mesh(&whole);
    let size = plain.diagonal();
    let unit = scaled(&whole, 1.0 / size);
    let mut counts: Vec<Vec<usize>> = Vec::new();
    for diagonal in [1e-6, 1e-3, 0.01, 0.1, 1.0, 10.0, 100.0, 1e6] {
        let front = Front::of_mesh(&scaled(&unit, diagonal));
        let mut probe = tool(&scaled(&capsule_mesh(0.015, 0.1, 12, 10), diagonal));
        let mut random = Random::new(27);
        let mut at_scale = Vec::new();
        for _ in 0..40 {
            let face = random.below(whole.triangles.len() as u64) as usize;
            let on_it = unit.positions[whole.triangles[face][0] as usize] * diagonal;
            probe.place(&frame(on_it, random.orientation(), 1.0));
            at_scale.push(pairs(&front.surface(), &probe).len());
        }
        counts.push(at_scale);
    }
    let total: usize = counts[4].iter().sum();
    assert!(total > 1000, "{total}");
    for at_scale in &counts {
        // The model's own rounding to f32 differs from unit to unit: a face of a thousand may turn.
        let off: usize = at_scale
            .iter()
            .zip(&counts[4])
            .map(|(a, b)| a.abs_diff(*b))
            .sum();
        assert!(off * 500 <= total, "{off} of {total}");
    }
}

/// dimforge/rapier #961: the tree panicked on huge, empty and NaN boxes. What is none is refused,
/// all else is answered.
#[test]
fn rapier_issue_961() {
    for size in [0.0, 1e-38, 1e-20, 1e15, 1e30] {
        let mesh = scaled(&box_mesh(DVec3::ONE), size);
        let front = Front::of_mesh(&mesh);
        let mut probe = tool(&mesh);
        for shift in [0.0, 0.5, 3.0] {
            let at = DVec3::splat(shift * size);
            probe.place(&frame(at, DQuat::IDENTITY, 1.0));
            // Boxes one inside a corner of the other, apart, or all in one point; two that are one
            // but for the rounding to f32 may do either.
            let meets = size == 0.0 || shift < 2.0;
            let found = pairs(&front.surface(), &probe);
            assert!(shift == 0.0 || found.is_empty() != meets, "{size} {shift}");
            let nearest = closest_point(front.surface(), at, None).0;
            let nearest = nearest.expect("it has faces").closest;
            assert!(nearest.point.is_finite() && nearest.distance_squared.is_finite());
        }
    }
    for bad in [f64::NAN, f64::INFINITY, 1e300] {
        let mut mesh = box_mesh(DVec3::ONE);
        mesh.positions[3].y = bad;
        assert!(Tool::new(&mesh).is_err(), "{bad}");
    }
}

/// flexible-collision-library/fcl #395, #322: a face without area threw an exception. With such
/// faces in the mesh, at a corner and along an edge, all else is found as without them.
#[test]
fn fcl_issue_395() {
    let plain = box_mesh(DVec3::ONE);
    let mut with = plain.clone();
    let first = with.positions.len() as u32;
    let [a, b, c] = plain.triangles[0];
    let [at_a, at_b, at_c] = [a, b, c].map(|v| plain.positions[v as usize]);
    with.positions
        .extend([0.5 * (at_a + at_b), at_a, at_a, at_c]);
    with.triangles
        .extend([[a, first, b], [a, first + 1, first + 2], [c, first + 3, b]]);
    let count = plain.triangles.len() as u32;
    let (plain, with) = (Front::of_mesh(&plain), Front::of_mesh(&with));
    let mut probe = tool(&capsule_mesh(0.3, 1.5, 12, 10));
    let mut random = Random::new(395);
    let mut met = 0;
    for _ in 0..200 {
        let at = random.vector() * 1.4;
        probe.place(&frame(at, random.orientation(), 1.0));
        let sorted = |front: &Front| {
            let found = pairs(&front.surface(), &probe);
            assert!(
                found
                    .iter()
                    .all(|pair| pair.meeting.point().is_some_and(DVec3::is_finite))
            );
            let real = found.iter().filter(|pair| pair.a < count);
            let mut real: Vec<_> = real.map(|pair| (pair.a, pair.b)).collect();
            real.sort_unstable();
            real
        };
        let expected = sorted(&plain);
        met += expected.len();
        assert_eq!(sorted(&with), expected);
    }
    assert!(met > 500, "{met}");
}

/// libigl #644, #905, mikedh/trimesh #75, #242: wrong signs by a face that is there twice, the
/// second time turned over, and by open meshes. The distance is right, and the sign wherever the
/// closest face is not the double one.
#[test]
fn libigl_issue_644() {
    let mut double = box_mesh(DVec3::ONE);
    let [a, b, c] = double.triangles[0];
    let corners = [a, b, c].map(|v| double.positions[v as usize]);
    let turned = double.triangles.len() as u32;
    double.triangles.push([a, c, b]);
    let mut open = box_mesh(DVec3::ONE);
    open.triangles.remove(0);
    let fronts = [Front::of_mesh(&double), Front::of_mesh(&open)];
    let mut random = Random::new(644);
    let mut judged = 0;
    for _ in 0..2000 {
        let point = random.vector() * 1.5;
        let at_hole = closest_point_on_triangle(corners, point).distance_squared;
        for front in &fronts {
            let nearest = closest_point(front.surface(), point, None).0;
            let nearest = nearest.expect("it has faces");
            let signed = signed_distance(front.surface(), point, &nearest);
            assert_eq!(signed.abs(), nearest.closest.distance_squared.sqrt());
            // The double face itself is as near as the hole, but for rounding.
            if nearest.closest.distance_squared < at_hole * (1.0 - 1e-9) {
                judged += 1;
                assert_ne!(nearest.face, turned);
                let inside = point.abs().max_element() < 1.0;
                assert_eq!(signed < 0.0, inside, "{point} {signed}");
            }
        }
    }
    assert!(judged > 2000, "{judged}");
}
