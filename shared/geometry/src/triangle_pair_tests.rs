use super::*;
use crate::closest_points_of_triangles;
use proptest::prelude::*;

type Grid = [[i64; 3]; 3];

fn points(t: Grid) -> [DVec3; 3] {
    t.map(|p| DVec3::new(p[0] as f64, p[1] as f64, p[2] as f64))
}

/// What an exact look at every separating direction says of triangles on a grid.
#[derive(Debug, PartialEq)]
enum Truth {
    Disjoint,
    Inner,
    Boundary,
    Coplanar,
    Degenerate,
}

fn sub(a: [i64; 3], b: [i64; 3]) -> [i64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
fn cross(a: [i64; 3], b: [i64; 3]) -> [i64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}
fn dot(a: [i64; 3], b: [i64; 3]) -> i64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Two convex figures are apart exactly when one of these directions separates them: the normals of
/// the facets of their difference, whatever its dimension. Their inner points are apart when one
/// separates them weakly and does not hold both.
fn truth(a: Grid, b: Grid) -> Truth {
    let all: Vec<[i64; 3]> = a.iter().chain(&b).copied().collect();
    let mut differences = Vec::new();
    for k in 0..6 {
        for l in 0..k {
            differences.push(sub(all[k], all[l]));
        }
    }
    let mut axes = differences.clone();
    for k in 0..differences.len() {
        for l in 0..k {
            let normal = cross(differences[k], differences[l]);
            if normal != [0; 3] {
                axes.push(normal);
                axes.extend(differences.iter().map(|&d| cross(normal, d)));
            }
        }
    }
    let (mut apart, mut inner_apart) = (false, false);
    for axis in axes {
        let range = |t: Grid| {
            let p = t.map(|c| dot(axis, c));
            (p[0].min(p[1]).min(p[2]), p[0].max(p[1]).max(p[2]))
        };
        let (ra, rb) = (range(a), range(b));
        apart |= ra.1 < rb.0 || rb.1 < ra.0;
        inner_apart |= (ra.1 <= rb.0 && ra.0 < rb.1) || (rb.1 <= ra.0 && rb.0 < ra.1);
    }
    let normal = |t: Grid| cross(sub(t[1], t[0]), sub(t[2], t[0]));
    let coplanar = b.iter().all(|&p| dot(normal(a), sub(p, a[0])) == 0);
    match () {
        () if apart => Truth::Disjoint,
        () if normal(a) == [0; 3] || normal(b) == [0; 3] => Truth::Degenerate,
        () if inner_apart => Truth::Boundary,
        () if coplanar => Truth::Coplanar,
        () => Truth::Inner,
    }
}

fn case(pair: &TrianglePair) -> Truth {
    match pair {
        TrianglePair::Disjoint => Truth::Disjoint,
        TrianglePair::Crossing { .. } => Truth::Inner,
        TrianglePair::Boundary { .. } => Truth::Boundary,
        TrianglePair::Coplanar { .. } => Truth::Coplanar,
        TrianglePair::Degenerate { .. } => Truth::Degenerate,
    }
}

fn ends(pair: &TrianglePair) -> Vec<DVec3> {
    match *pair {
        TrianglePair::Disjoint => vec![],
        TrianglePair::Coplanar { centre } => vec![centre],
        TrianglePair::Crossing { from, to }
        | TrianglePair::Boundary { from, to }
        | TrianglePair::Degenerate { from, to } => vec![from, to],
    }
}

/// Every order of the two and of their corners.
fn orders(a: [DVec3; 3], b: [DVec3; 3]) -> Vec<([DVec3; 3], [DVec3; 3])> {
    let turns = [
        [0, 1, 2],
        [1, 2, 0],
        [2, 0, 1],
        [0, 2, 1],
        [2, 1, 0],
        [1, 0, 2],
    ];
    let mut out = Vec::new();
    for ta in turns {
        for tb in turns {
            let (x, y) = (ta.map(|k| a[k]), tb.map(|k| b[k]));
            out.push((x, y));
            out.push((y, x));
        }
    }
    out
}

fn grid(most: i64) -> impl Strategy<Value = Grid> {
    prop::array::uniform3(prop::array::uniform3(-most..=most))
}

/// Points of a plane of the grid, so that coplanar pairs are common.
fn flat_grid() -> impl Strategy<Value = (Grid, Grid)> {
    let t = || prop::array::uniform3(prop::array::uniform2(-3i64..=3));
    (t(), t(), 0..4usize).prop_map(|(a, b, plane)| {
        let lift = |p: [i64; 2]| match plane {
            0 => [p[0], p[1], 0],
            1 => [2, p[0], p[1]],
            2 => [p[0], p[0] + p[1], p[1]],
            _ => [p[0], 2 * p[0] - 3 * p[1] + 1, p[1]],
        };
        (a.map(lift), b.map(lift))
    })
}

fn check(a: Grid, b: Grid) -> Result<(), TestCaseError> {
    let expected = truth(a, b);
    for scale in [1.0, 2f64.powi(-33), 2f64.powi(20)] {
        let (pa, pb) = (points(a).map(|p| p * scale), points(b).map(|p| p * scale));
        for (x, y) in orders(pa, pb) {
            let found = triangle_pair(x, y);
            prop_assert_eq!(case(&found), truth(a, b), "{:?} {:?} {:?}", a, b, found);
            // Their common points lie on both.
            for end in ends(&found) {
                for t in [x, y] {
                    let off = crate::closest_point_on_triangle(t, end).distance_squared;
                    prop_assert!(off.sqrt() <= 1e-13 * scale, "{end} is {} off", off.sqrt());
                }
            }
        }
        let closest = closest_points_of_triangles(pa, pb);
        prop_assert_eq!(closest.distance_squared == 0.0, expected != Truth::Disjoint);
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    /// The exact truth on coarse grids, where corners in planes, shared edges and flat triangles
    /// are common, in all 72 orders and at three scales.
    #[test]
    fn the_case_is_exact_on_a_small_grid(a in grid(2), b in grid(2)) {
        check(a, b)?;
    }

    #[test]
    fn the_case_is_exact_on_a_larger_grid(a in grid(9), b in grid(9)) {
        check(a, b)?;
    }

    #[test]
    fn the_case_is_exact_in_a_plane((a, b) in flat_grid()) {
        check(a, b)?;
    }

    /// Shared corners and edges, as between neighbours of a mesh.
    #[test]
    fn neighbours_share_their_boundary(
        a in grid(4), apex in prop::array::uniform3(-4i64..=4), shared in 1..3usize,
        other in prop::array::uniform3(-4i64..=4),
    ) {
        let b = if shared == 1 { [a[0], apex, other] } else { [a[0], a[1], apex] };
        check(a, b)?;
    }

    /// On any numbers, at any scale and place, the case is the same in any order; the ends lie on
    /// both.
    #[test]
    fn order_and_scale_do_not_matter(
        a in prop::array::uniform3(prop::array::uniform3(-1.0..1.0f64)),
        b in prop::array::uniform3(prop::array::uniform3(-1.0..1.0f64)),
        exponent in -10..=6i32,
    ) {
        let (a, b) = (a.map(DVec3::from_array), b.map(DVec3::from_array));
        let s = 10f64.powi(exponent);
        let expected = triangle_pair(a, b);
        for (x, y) in orders(a, b) {
            prop_assert_eq!(case(&triangle_pair(x, y)), case(&expected));
        }
        let scaled = triangle_pair(a.map(|p| p * s), b.map(|p| p * s));
        prop_assert_eq!(case(&scaled), case(&expected));
        for (end, unscaled) in ends(&scaled).iter().zip(ends(&expected)) {
            prop_assert!(end.distance(unscaled * s) <= 1e-9 * s);
        }
    }
}

#[test]
fn numbers_that_are_none_meet_nothing() {
    let t = [DVec3::ZERO, DVec3::X, DVec3::Y];
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e200, -1e300] {
        for k in 0..3 {
            for axis in 0..3 {
                let mut u = t;
                u[k][axis] = bad;
                for other in [t, u, [DVec3::Z, -DVec3::Z, DVec3::ONE]] {
                    assert_eq!(triangle_pair(other, u), TrianglePair::Disjoint, "{bad}");
                    assert_eq!(triangle_pair(u, other), TrianglePair::Disjoint, "{bad}");
                }
            }
        }
    }
}

/// A million pairs of whatever numbers: no panic, nothing that is not finite, the same case with
/// the two exchanged, and distance 0 exactly where they meet.
#[test]
fn any_numbers_are_answered() {
    let mut state = 7u64;
    let mut next = || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (state ^ state >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    };
    let mut cases = [0usize; 5];
    for _ in 0..1_000_000 {
        let kind = next() % 16;
        let scale = 10f64.powi((next() % 17) as i32 - 10);
        let mut number = || {
            let unit = (next() >> 11) as f64 / (1u64 << 53) as f64 - 0.5;
            match (kind, next() % 8) {
                (0, 0) => [f64::NAN, f64::INFINITY, 1e300, -1e200][(next() % 4) as usize],
                (1, _) => unit * 10f64.powi((next() % 121) as i32 - 60),
                (2..=5, _) => (unit * 5.0).round() * scale,
                (6..=7, _) => (unit * 3.0).round() * scale + unit * 1e-14 * scale,
                (8, 0..3) => 0.0,
                _ => unit * scale,
            }
        };
        let mut t = || [0; 3].map(|_| DVec3::new(number(), number(), number()));
        let (a, mut b) = (t(), t());
        match next() % 12 {
            0 => b[0] = a[0],
            1 => (b[0], b[1]) = (a[1], a[0]),
            2 => b[2] = b[0],
            3 => b[2] = b[0].lerp(b[1], 0.25),
            4 => b[0] = a[0].lerp(a[1], 0.5),
            _ => {}
        }
        let pair = triangle_pair(a, b);
        assert!(ends(&pair).iter().all(|end| end.is_finite()), "{a:?} {b:?}");
        let swapped = triangle_pair(b, a);
        assert_eq!(case(&pair), case(&swapped), "{a:?} {b:?}");
        cases[case(&pair) as usize] += 1;
        let within = |p: &DVec3| p.abs().cmplt(DVec3::splat(1e60)).all();
        if kind > 1 && a.iter().chain(&b).all(within) {
            let closest = closest_points_of_triangles(a, b);
            assert!(closest.distance_squared.is_finite());
            assert!(closest.points.iter().all(|p| p.is_finite()));
            assert!(!pair.meets() || closest.distance_squared == 0.0);
        }
    }
    assert!(cases.iter().all(|&count| count > 1000), "{cases:?}");
}

/// Tests from threads: the numbers are those of the reports.
#[allow(clippy::excessive_precision, reason = "the numbers are the reports'")]
mod threads {
    use super::*;

    fn t(corners: [[f64; 3]; 3]) -> [DVec3; 3] {
        corners.map(DVec3::from_array)
    }

    fn meets_in_every_order(a: [DVec3; 3], b: [DVec3; 3]) -> bool {
        let first = triangle_pair(a, b).meets();
        for (x, y) in orders(a, b) {
            assert_eq!(triangle_pair(x, y).meets(), first);
        }
        first
    }

    /// dimforge/parry #253: EPA panicked, later said no contact. A corner of the second lies within
    /// rounding on an edge of the first, both at y = 1: exactly next to it as f64, and whatever it
    /// is, the same in every order.
    #[test]
    fn parry_issue_253() {
        let a = [
            [-13.174434, 1.0, 8.736801],
            [3.5251038, 1.0, 12.1],
            [3.2048466, 1.0, 12.218325],
        ];
        let b = [
            [-1.63, 0.0, 11.19],
            [-2.349647, 0.0, 11.037681],
            [-2.349647, 1.0, 11.037681],
        ];
        let as_f32 = |t: [[f64; 3]; 3]| t.map(|p| p.map(|x| f64::from(x as f32)));
        for (a, b) in [(t(a), t(b)), (t(as_f32(a)), t(as_f32(b)))] {
            let meets = meets_in_every_order(a, b);
            let closest = closest_points_of_triangles(a, b);
            assert_eq!(closest.distance_squared == 0.0, meets);
            assert!(closest.distance_squared.sqrt() < 1e-6);
            assert!(closest.points.iter().all(|p| p.distance(b[2]) < 1e-6));
            // A hair towards the middle of the first it meets, in one point.
            let inward = (a[0] + a[1] + a[2]) / 3.0 - b[2];
            let moved = b.map(|p| p + inward * 1e-5 * DVec3::new(1.0, 0.0, 1.0));
            let pair = triangle_pair(a, moved);
            assert!(
                matches!(pair, TrianglePair::Boundary { from, to }
                    if from == moved[2] && to == from),
                "{pair:?}"
            );
            assert!(meets_in_every_order(a, moved));
        }
    }

    /// dimforge/ncollide #313: index out of bounds; they share a corner.
    #[test]
    fn ncollide_issue_313() {
        let a = t([
            [6.292823, 6.456138, 19.66036],
            [6.280472, 6.421245, 19.57066],
            [6.275294, 6.449808, 19.57066],
        ]);
        let b = t([
            [6.292823, 6.456138, 19.66036],
            [6.299445, 6.421245, 19.66036],
            [6.280472, 6.421245, 19.57066],
        ]);
        assert!(matches!(
            triangle_pair(a, b),
            TrianglePair::Boundary { from, to } if from != to
        ));
    }

    /// llnl/axom #152: 6 of 36 orders said no.
    #[test]
    fn axom_issue_152() {
        let a = t([
            [76.648, 54.6752, 15.0012],
            [76.648, 54.6752, 14.5542],
            [76.582, 54.6752, 14.7879],
        ]);
        let b = t([
            [76.6252, 54.6752, 14.892],
            [76.582, 54.6752, 14.7879],
            [76.5617, 54.6752, 14.7929],
        ]);
        assert!(meets_in_every_order(a, b));
        assert!(matches!(triangle_pair(a, b), TrianglePair::Coplanar { .. }));
    }

    /// libigl #2381: neighbours of a triangle cut in four twice do not overlap.
    #[test]
    fn libigl_issue_2381() {
        let v = [
            [0.280039012432098, 0.82766300439834595, 0.46377500891685502],
            [
                0.30947001278400399,
                0.80785250663757346,
                0.47595100104808802,
            ],
            [
                0.29475451260805097,
                0.81775775551795971,
                0.46986300498247152,
            ],
            [
                0.28954251110553697,
                0.81283825635910045,
                0.47110325843095802,
            ],
            [
                0.30425801128148999,
                0.80293300747871421,
                0.47719125449657451,
            ],
            [0.299046009778976, 0.79801350831985496, 0.47843150794506101],
        ]
        .map(DVec3::from_array);
        let faces = [[0, 2, 3], [2, 1, 4], [3, 4, 5], [2, 4, 3]];
        for a in 0..4 {
            for b in 0..a {
                let pair = triangle_pair(faces[a].map(|k| v[k]), faces[b].map(|k| v[k]));
                let touch = matches!(pair, TrianglePair::Boundary { .. });
                assert!(touch, "{a} {b}: {pair:?}");
            }
        }
    }

    /// isl-org/Open3D #5117, PR #7539 and microsoft/DirectXMath #197 are one defect: an absolute
    /// epsilon on distances times an unnormalised normal. A small triangle just off the plane of
    /// another, turned about and scaled.
    #[test]
    fn open3d_issue_5117() {
        let a = t([[0.0, 0.0, 0.0], [1e-4, 0.0, 0.0], [0.0, 1e-4, 0.0]]);
        let b = a.map(|p| DVec3::new(p.x + 1e-5, p.y + 1e-5, 1e-9));
        for k in 0..50 {
            let axis = DVec3::new(1.0, 2.0, f64::from(k)).normalize();
            let turn = glam::DQuat::from_axis_angle(axis, 0.3 * f64::from(k));
            for s in [1e-6, 1.0, 1e6] {
                let moved = |c: [DVec3; 3]| c.map(|p| turn * (p * s));
                assert!(!meets_in_every_order(moved(a), moved(b)), "{k} {s}");
            }
        }
    }

    /// Long thin triangles (jrouwe/JoltPhysics #2065, RenderKit/embree #423): an edge of 200 units
    /// across a needle.
    #[test]
    fn jolt_issue_2065() {
        let needle = t([
            [-0.228017807, -28.1085911, 0.140446782],
            [-0.252283931, 173.436920, 0.0938473940],
            [-0.252283931, 172.436920, 0.0938473940],
        ]);
        let through = needle[0].lerp(needle[1].lerp(needle[2], 0.5), 0.5);
        let side = DVec3::new(0.3, 0.0, 0.7);
        let cut = [through - side, through + side, through + side + DVec3::Y];
        assert!(meets_in_every_order(needle, cut));
        let apart = cut.map(|p| p + DVec3::new(2.0, 0.0, 0.0));
        assert!(!meets_in_every_order(needle, apart));
        let closest = closest_points_of_triangles(needle, apart);
        for (point, tri) in closest.points.iter().zip([needle, apart]) {
            let off = crate::closest_point_on_triangle(tri, *point).distance_squared;
            assert!(off.sqrt() < 1e-12, "the point lies on its triangle: {off}");
        }
    }
}
