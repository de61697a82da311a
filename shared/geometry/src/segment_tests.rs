use super::*;
use crate::{closest_point_on_triangle, closest_points_of_triangles};
use parry3d_f64::math::Pose;
use parry3d_f64::query::ClosestPoints;
use parry3d_f64::query::details::closest_points_segment_segment;
use parry3d_f64::shape::Segment;
use proptest::prelude::*;

fn vector() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array)
}

/// A point of a small grid: parallel, collinear, touching and empty figures are common.
fn grid() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-2..=2i32).prop_map(|p| DVec3::from_array(p.map(f64::from)))
}

fn any() -> impl Strategy<Value = DVec3> {
    prop_oneof![vector(), grid()]
}

/// The least distance of two convex figures by descent: alternating closest points converge on
/// convex sets, and from several starts the best is the least.
fn alternating(
    on_first: impl Fn(DVec3) -> DVec3,
    on_second: impl Fn(DVec3) -> DVec3,
    starts: &[DVec3],
) -> f64 {
    let mut least = f64::INFINITY;
    for &start in starts {
        let (mut p, mut q) = (on_first(start), on_second(start));
        for _ in 0..20_000 {
            q = on_second(p);
            let next = on_first(q);
            if next == p {
                break;
            }
            p = next;
        }
        least = least.min(p.distance(q));
    }
    least
}

proptest! {
    #[test]
    fn segments_are_as_near_as_parry_finds_and_as_any_sample(
        p in prop::array::uniform2(any()), q in prop::array::uniform2(any()),
        exponent in -10..=6i32,
    ) {
        let s = 10f64.powi(exponent);
        let ours = closest_points_of_segments(p.map(|x| x * s), q.map(|x| x * s));
        let distance = ours.distance_squared.sqrt() / s;
        // The points lie on their segments and have the distance.
        prop_assert!(foot(p, ours.points[0] / s).distance(ours.points[0] / s) < 1e-14);
        prop_assert!(foot(q, ours.points[1] / s).distance(ours.points[1] / s) < 1e-14);
        prop_assert!((ours.points[0].distance(ours.points[1]) / s - distance).abs() < 1e-14);
        for k in 0..=20 {
            let sample = p[0].lerp(p[1], f64::from(k) / 20.0);
            prop_assert!(distance <= foot(q, sample).distance(sample) + 1e-14);
        }
        let swapped = closest_points_of_segments(q.map(|x| x * s), p.map(|x| x * s));
        prop_assert!((swapped.distance_squared.sqrt() / s - distance).abs() < 1e-14);
        if p[0] != p[1] && q[0] != q[1] {
            let theirs = match closest_points_segment_segment(
                &Pose::IDENTITY, &Segment::new(p[0], p[1]), &Segment::new(q[0], q[1]), f64::MAX,
            ) {
                ClosestPoints::WithinMargin(a, b) => a.distance(b),
                _ => 0.0,
            };
            prop_assert!((distance - theirs).abs() <= 1e-7 && distance <= theirs + 1e-12, "{} {}", distance, theirs);
        }
    }

    /// Nearly parallel segments at any angle: no worse than by sampling.
    #[test]
    fn nearly_parallel_segments_keep_their_distance(
        p in prop::array::uniform2(vector()), gap in vector(), slope in vector(),
        exponent in 2..17i32,
    ) {
        let tilt = slope * 10f64.powi(-exponent);
        let q = [p[0] + gap, p[1] + gap + tilt];
        let distance = closest_points_of_segments(p, q).distance_squared.sqrt();
        for k in 0..=50 {
            let sample = p[0].lerp(p[1], f64::from(k) / 50.0);
            prop_assert!(distance <= foot(q, sample).distance(sample) + 1e-14);
        }
    }

    /// Segments that cross at any angle, however small, are at distance 0 within rounding.
    #[test]
    fn nearly_parallel_segments_that_cross_meet(
        p in prop::array::uniform2(vector()), place in 0.2..0.8f64, slope in vector(),
        exponent in 1..17i32,
    ) {
        let half = 0.5 * (p[1] - p[0]) + slope * 10f64.powi(-exponent);
        let middle = p[0].lerp(p[1], place);
        let closest = closest_points_of_segments(p, [middle - half, middle + half]);
        let distance = closest.distance_squared.sqrt();
        prop_assert!(distance < 4e-15, "{}", distance);
    }

    #[test]
    fn a_segment_and_a_triangle(
        p in prop::array::uniform2(any()), t in prop::array::uniform3(any()),
        exponent in -10..=6i32,
    ) {
        let s = 10f64.powi(exponent);
        let ours = closest_points_of_segment_and_triangle(p.map(|x| x * s), t.map(|x| x * s));
        let distance = ours.distance_squared.sqrt() / s;
        prop_assert!(foot(p, ours.points[0] / s).distance(ours.points[0] / s) < 1e-13);
        let off = closest_point_on_triangle(t, ours.points[1] / s).distance_squared;
        prop_assert!(off.sqrt() < 1e-13);
        prop_assert!((ours.points[0].distance(ours.points[1]) / s - distance).abs() < 1e-13);
        let nearest = |x: DVec3| closest_point_on_triangle(t, x).point;
        let starts = [p[0], p[1], t[0], t[1], t[2]];
        let least = alternating(|x| foot(p, x), nearest, &starts);
        // Alternation comes down slowly where it ends in 0.
        prop_assert!(distance <= least + 1e-13 && least <= distance + 2e-2, "{} {}", distance, least);
    }

    #[test]
    fn triangles(
        a in prop::array::uniform3(any()), b in prop::array::uniform3(any()),
        exponent in -10..=6i32,
    ) {
        let s = 10f64.powi(exponent);
        let ours = closest_points_of_triangles(a.map(|x| x * s), b.map(|x| x * s));
        let distance = ours.distance_squared.sqrt() / s;
        for (triangle, point) in [a, b].into_iter().zip(ours.points) {
            let off = closest_point_on_triangle(triangle, point / s).distance_squared;
            prop_assert!(off.sqrt() < 1e-13);
        }
        prop_assert!((ours.points[0].distance(ours.points[1]) / s - distance).abs() < 1e-13);
        let on = |t: [DVec3; 3]| move |x: DVec3| closest_point_on_triangle(t, x).point;
        let least = alternating(on(a), on(b), &[a[0], a[1], a[2], b[0], b[1], b[2]]);
        prop_assert!(distance <= least + 1e-13 && least <= distance + 2e-2, "{} {}", distance, least);
        let swapped = closest_points_of_triangles(b.map(|x| x * s), a.map(|x| x * s)).swapped();
        prop_assert!((swapped.distance_squared.sqrt() / s - distance).abs() < 1e-14);
    }
}

/// dimforge/parry #76: a triangle whose second and third corner are one is a segment, and not at
/// distance 0.
#[test]
fn parry_issue_76() {
    let p = DVec3::new(1.10000002, -7.9000001, 16.5879993);
    let a = DVec3::new(2.27699995, -7.9000001, 16.3180008);
    let b = DVec3::new(-0.569999993, -8.10000038, 16.6070004);
    let to_triangle = closest_point_on_triangle([a, b, b], p)
        .distance_squared
        .sqrt();
    let to_segment = foot([a, b], p).distance(p);
    assert_eq!(to_triangle, to_segment);
    // The thread's number is of f32.
    assert!((to_triangle - 0.17147861).abs() < 1e-6, "{to_triangle}");
    let as_triangles = closest_points_of_triangles([p, p, p], [a, b, b]);
    assert!((as_triangles.distance_squared.sqrt() - to_segment).abs() < 1e-15);
}

/// dimforge/parry #310, #358, #437: collinear corners, down to subnormal differences: never NaN.
#[test]
fn parry_issue_310() {
    for s in [1.0, 1e-10, 1e-40, 1e-100] {
        let d = DVec3::new(s, 2.0 * s, -s);
        let line = [DVec3::ZERO, d, d * 0.3];
        let other = [DVec3::Z * s, DVec3::X * s, d];
        for (a, b) in [(line, other), (other, line), (line, line)] {
            let closest = closest_points_of_triangles(a, b);
            assert!(closest.distance_squared.is_finite());
            assert!(closest.points.iter().all(|p| p.is_finite()));
            assert_eq!(closest.distance_squared, 0.0, "they share a point");
        }
    }
}

/// dimforge/parry #194: a point on an edge projects onto itself in all six windings.
#[test]
fn parry_issue_194() {
    let v = [[2.0, 1.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]].map(DVec3::from_array);
    let query = DVec3::new(1.4, 1.0, 0.0);
    for [a, b, c] in [
        [0, 1, 2],
        [1, 2, 0],
        [2, 0, 1],
        [0, 2, 1],
        [2, 1, 0],
        [1, 0, 2],
    ] {
        let closest = closest_point_on_triangle([v[a], v[b], v[c]], query);
        assert!(closest.point.distance(query) < 1e-15, "{:?}", closest.point);
    }
}

/// jrouwe/JoltPhysics #886: a sphere of radius 0.2 near a triangle that is nearly a segment is not
/// a hit.
#[test]
fn jolt_issue_886() {
    let t = [
        [14.5536213, 10.5973721, -0.00600051880],
        [14.5536213, 10.5969315, -3.18638134],
        [14.5536213, 10.5969315, -5.18637228],
    ]
    .map(DVec3::from_array);
    let start = DVec3::new(14.8314590, 8.19055080, -4.30825043);
    let motion = DVec3::new(-0.0988006592, 5.96046448e-08, 0.000732421875);
    let closest = closest_points_of_segment_and_triangle([start, start + motion], t);
    let distance = closest.distance_squared.sqrt() - 0.2;
    assert!(distance > 2.2 - 0.01 && distance < 2.3, "{distance}");
}

/// dimforge/parry #378: a capsule's end over the corner of a box; both points must be near each
/// other.
#[test]
fn parry_issue_378() {
    let top = [[-4.0, 0.5, -1.0], [4.0, 0.5, -1.0], [4.0, 0.5, 1.0]].map(DVec3::from_array);
    for y in [-1.2391, -1.25, -1.26] {
        let at = DVec3::new(2.0373735, -y, 0.0);
        let axis = [at - DVec3::Y * 0.25, at + DVec3::Y * 0.25];
        let closest = closest_points_of_segment_and_triangle(axis, top);
        let distance = closest.distance_squared.sqrt();
        let expected = (at.y - 0.25) - 0.5;
        assert!((distance - expected).abs() < 1e-12, "{distance} {expected}");
        assert!((closest.points[1].x - at.x).abs() < 1e-12);
    }
}

/// RenderKit/embree #387, #423: a segment that grazes a skinny triangle is told exactly, one ulp
/// next to it.
#[test]
fn embree_issue_387() {
    let t = [DVec3::ZERO, DVec3::X * 1e6, DVec3::new(1e6, 1e-6, 0.0)];
    let at = DVec3::new(5e5, 0.0, 0.0);
    let through = closest_points_of_segment_and_triangle([at + DVec3::Z, at - DVec3::Z], t);
    assert_eq!(through.distance_squared, 0.0);
    let off = at - DVec3::Y * 1e-20;
    let off = closest_points_of_segment_and_triangle([off + DVec3::Z, off - DVec3::Z], t);
    assert!(off.distance_squared > 0.0);
    let parallel = [DVec3::new(0.0, -1e-9, 1e-12), DVec3::new(1e6, 1e-6, 1e-12)];
    let grazing = closest_points_of_segment_and_triangle(parallel, t);
    assert!((grazing.distance_squared.sqrt() - 1e-12).abs() < 1e-20);
}

/// Found by a random seed: the corner is on the segment, the edge next to it off by a rounding.
#[test]
fn a_segment_along_an_edge_is_told_a_point_of_the_triangle() {
    let segment = [
        DVec3::new(1.0, -0.5546875, 0.0),
        DVec3::new(1.0, 2.4453125000000004, 0.0),
    ];
    let triangle = [
        DVec3::new(0.8046875, 0.66015625, 0.1953125),
        DVec3::new(1.0, 0.625, 0.0),
        DVec3::new(1.0, 1.0, 1.1102230246251565e-15),
    ];
    let closest = closest_points_of_segment_and_triangle(segment, triangle);
    assert_eq!(closest.distance_squared, 0.0);
    for point in closest.points {
        let on_face = closest_point_on_triangle(triangle, point);
        assert!(on_face.distance_squared.sqrt() <= 1e-14, "{point}");
    }
}
