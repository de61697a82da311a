use super::*;
use crate::{CertifiedCode, ErrorScale, QuarterCodes, QuarteredFace};
use glam::DVec3;

fn record(i: u32, leaf_r: u32) -> VspRecord {
    VspRecord {
        i,
        vs: 0,
        fn_: [NONE; 4],
        leaf_l: 2,
        leaf_r,
        pos_t: [0.0, 1.0, 0.0],
        pos_u: [0.0, -1.0, 0.0],
        certified: [CertifiedCode::default(); 2],
        e: 0,
    }
}

/// A hexagonal fan around vertex 0, boundary vertices 1..=6, faces k = (0, k + 1, k + 2).
fn hexagon(slots: u32) -> ActiveMesh {
    let mut mesh = ActiveMesh::new(7, 6, slots);
    for v in 0..7 {
        let angle = f64::from(v) * std::f64::consts::FRAC_PI_3;
        let p = if v == 0 { 0.0 } else { 3.0 };
        mesh.set_base_vertex(
            v,
            [(p * angle.cos()) as f32, (p * angle.sin()) as f32, 0.0],
            Certified::EXACT,
        );
    }
    for k in 0..6 {
        let corners = [0, 1 + k, 1 + (k + 1) % 6];
        let neighbours = [NONE, (k + 1) % 6, (k + 5) % 6];
        mesh.set_base_face(k, corners, neighbours).unwrap();
    }
    assert!(mesh.base_is_consistent());
    mesh.check();
    mesh
}

/// Around an inner vertex, around one of a boundary from either end and from between, and to the
/// first that is accepted.
#[test]
fn each_face_of_a_fan_is_shown_once() {
    let mesh = hexagon(1);
    let shown = |face, corner, until| {
        let mut shown = Vec::new();
        let found = mesh.any_around(face, corner, |at| {
            shown.push(at);
            shown.len() == until
        });
        assert_eq!(found, shown.len() == until);
        shown.sort_unstable();
        shown
    };
    assert_eq!(shown(2, 0, usize::MAX), [0, 1, 2, 3, 4, 5]);
    // Vertex 1 is the first rim vertex of face 0 and the last of face 5.
    assert_eq!(shown(0, 1, usize::MAX), [0, 5]);
    assert_eq!(shown(5, 1, usize::MAX), [0, 5]);
    assert_eq!(shown(2, 0, 3).len(), 3);
}

#[test]
fn a_split_parts_the_fan_and_a_collapse_restores_it() {
    let mut mesh = hexagon(1);
    let before = mesh.faces.clone();
    // vl = vertex 1 (between faces 5 and 0), vr = vertex 4 (between faces 2 and 3).
    mesh.load(0, &record(0, 3), 0, [0, 5, 2, 3], [Certified::EXACT; 2]);
    let mut out = OperationFaces::new();
    mesh.split(0, &mut out).unwrap();
    assert_eq!(out.deformed(), [0, 1, 2, 3, 4, 5]);
    assert_eq!(mesh.face(6).corners, [7, 8, 1]);
    assert_eq!(mesh.face(7).corners, [8, 7, 4]);
    assert_eq!(mesh.active_faces(), 8);
    mesh.check();
    mesh.collapse(0, &mut out).unwrap();
    mesh.check();
    assert_eq!(mesh.faces[..6], before[..6]);
}

#[test]
fn a_face_has_bounds_of_its_quarters_while_its_corners_are_those_of_a_front() {
    let mut mesh = hexagon(1).with_quarters(3).with_geomorphs(2);
    let scale = ErrorScale::for_diagonal(6.0);
    let active = |radius: f32, begin, end| Certified {
        begin,
        end,
        ..Certified::of_radius(radius)
    };
    for vertex in 0..7 {
        let position = mesh.position(vertex).to_array();
        mesh.set_base_vertex(vertex, position, active(1.0, 40_000, u16::MAX));
    }
    let quartered = |face, end, bounds| QuarteredFace {
        face,
        end,
        part: 0,
        quarters: QuarterCodes::new(scale, bounds),
    };
    let of_base = quartered(0, u16::MAX, [0.1, 0.2, 3.0, f64::INFINITY]);
    // Face 6 is the one that the split makes.
    let of_split = quartered(6, 40_000, [0.3, 0.4, 0.2, 0.1]);
    assert!(mesh.add_quarters(&of_base, scale) && mesh.add_quarters(&of_split, scale));
    assert!(
        !mesh.add_quarters(&of_base, scale),
        "not above the one before"
    );
    let [a, b, c] = mesh.corners(0);
    let points = [a, b.lerp(a, 0.3), c, (a + b + c) / 3.0];
    let found = |mesh: &ActiveMesh, face| {
        let bounds = points.map(|point| mesh.certified_distance(face, point));
        bounds.map(|bound| (10.0 * bound).round() / 10.0)
    };
    assert_eq!(found(&mesh, 0), [0.1, 0.2, 1.0, 1.0]);
    assert_eq!(found(&mesh, 1), [1.0; 4]);
    let of_children = [active(0.5, 0, 40_000); 2];
    mesh.load(0, &record(9, 3), 0, [0, 5, 2, 3], of_children);
    let mut out = OperationFaces::new();
    mesh.split(0, &mut out).unwrap();
    assert_eq!(found(&mesh, 0), [1.0; 4]);
    // The slot is 0 and the split is 9: face 6 is the model's face 24.
    let apart = |mesh: &ActiveMesh| {
        let [a, b, c] = mesh.corners(6);
        let points = [a, b, c, (a + b + c) / 3.0];
        let bounds = points.map(|point| mesh.certified_distance(6, point));
        bounds.map(|bound| (10.0 * bound).round() / 10.0)
    };
    assert_eq!(apart(&mesh), [1.0; 4]);
    let of_split = quartered(24, 40_000, [0.3, 0.4, 0.2, 0.1]);
    // Vertex 1 begins at the code at which the children end.
    assert!(mesh.add_quarters(&of_split, scale));
    assert_eq!(mesh.quartered(), 3);
    assert!(
        !mesh.add_quarters(&quartered(25, 1, [0.0; 4]), scale),
        "no room"
    );
    assert_eq!(apart(&mesh), [1.0; 4]);
    let place = mesh.position(1).to_array();
    mesh.set_base_vertex(1, place, active(1.0, 30_000, u16::MAX));
    assert_eq!(apart(&mesh), [0.3, 0.4, 0.2, 0.1]);
    // Its corners begin at their parent, 1 away from where they will be.
    mesh.start_split_geomorph(&out);
    assert_eq!(apart(&mesh)[2], 1.0);
    mesh.step_geomorph(0, 0.5, &out);
    mesh.step_geomorph(1, 0.5, &out);
    assert_eq!(apart(&mesh)[2], 0.7);
    mesh.collapse(0, &mut out).unwrap();
    assert_eq!(found(&mesh, 0), [0.1, 0.2, 1.0, 1.0]);
}

#[test]
fn the_fan_of_vt_may_be_in_two_pieces_at_a_boundary() {
    // Without face 1 the vertex 0 lies on the boundary: vt gets face 0 and face 2 with the gap
    // between them.
    let mut mesh = ActiveMesh::new(7, 5, 1);
    let place = [0, NONE, 1, 2, 3, 4];
    for k in [0usize, 2, 3, 4, 5] {
        let corners = [0, 1 + k as u32, 1 + (k as u32 + 1) % 6];
        let neighbours = [NONE, place[(k + 1) % 6], place[(k + 5) % 6]];
        mesh.set_base_face(place[k], corners, neighbours).unwrap();
    }
    assert!(mesh.base_is_consistent());
    mesh.load(0, &record(0, 3), 0, [0, 4, 1, 2], [Certified::EXACT; 2]);
    let mut out = OperationFaces::new();
    mesh.split(0, &mut out).unwrap();
    mesh.check();
    assert!(mesh.face(0).corners.contains(&7) && mesh.face(1).corners.contains(&7));
    assert!(mesh.face(2).corners.contains(&8) && mesh.face(4).corners.contains(&8));
    mesh.collapse(0, &mut out).unwrap();
    mesh.check();
}

#[test]
fn a_record_that_does_not_fit_is_refused_and_changes_nothing() {
    for fn_ in [
        [0, 4, 2, 3],
        [0, 5, 2, 4],
        [0, 5, 3, 2],
        [5, 0, 2, 3],
        [0, 5, 0, 5],
    ] {
        let mut mesh = hexagon(1);
        mesh.load(0, &record(7, 3), 0, fn_, [Certified::EXACT; 2]);
        let before = mesh.faces.clone();
        let mut out = OperationFaces::new();
        assert_eq!(
            mesh.split(0, &mut out),
            Err(OperationError::Damaged(7)),
            "{fn_:?}"
        );
        assert_eq!(mesh.faces, before);
    }
}

/// Corners of all active faces.
fn places(mesh: &ActiveMesh) -> Vec<[DVec3; 3]> {
    let mut all = Vec::new();
    mesh.for_each_active_face(|face| all.push(mesh.corners(face)));
    all
}

/// Moves every vertex in geomorph until so much of its way is done.
fn advance_all(mesh: &mut ActiveMesh, done: f64, out: &mut OperationFaces) {
    for index in 0..mesh.geomorphs().len() {
        let geomorph = mesh.geomorphs()[index];
        mesh.faces_around_geomorph(&geomorph, out)
            .expect("the fans are small");
        mesh.step_geomorph(index, done.max(geomorph.done()), out);
    }
    mesh.finish_geomorphs();
}

#[test]
fn a_split_takes_off_from_where_the_surface_was_and_lands_where_the_file_says() {
    let mut mesh = hexagon(2).with_geomorphs(4);
    let mut at_once = hexagon(2);
    mesh.set_base_vertex(0, [0.0, 0.0, 0.5], Certified::of_radius(2.0));
    at_once.set_base_vertex(0, [0.0, 0.0, 0.5], Certified::of_radius(2.0));
    let before = places(&mesh);
    let mut out = OperationFaces::new();
    for mesh in [&mut mesh, &mut at_once] {
        mesh.load(
            0,
            &record(0, 3),
            0,
            [0, 5, 2, 3],
            [0.25, 0.5].map(Certified::of_radius),
        );
        mesh.split(0, &mut out).unwrap();
    }
    mesh.start_split_geomorph(&out);
    assert_eq!(mesh.geomorphs().len(), 2);
    assert!(mesh.can_start_geomorph());
    // The six faces are where they were, and the pair has no area: nothing has been passed.
    assert_eq!(places(&mesh)[..6], before[..]);
    assert!(!mesh.swept_over(&out, DVec3::new(0.1, 0.1, 0.2)));
    for face in 0..8 {
        assert!(mesh.certified_error(face) >= 2.0, "the parent's R");
    }
    advance_all(&mut mesh, 0.25, &mut out);
    assert_eq!(mesh.position(7).to_array(), [0.0, 0.25, 0.375]);
    mesh.check();
    advance_all(&mut mesh, 1.0, &mut out);
    assert!(mesh.geomorphs().is_empty());
    assert_eq!(places(&mesh), places(&at_once));
    assert_eq!([7, 8].map(|v| mesh.radius(v)), [0.25, 0.5]);

    // And back: at the parent's place the collapse moves nothing.
    mesh.start_collapse_geomorph(0);
    advance_all(&mut mesh, 0.5, &mut out);
    assert!(!mesh.has_reached_parent(0));
    advance_all(&mut mesh, 1.0, &mut out);
    assert!(mesh.has_reached_parent(0));
    assert_eq!(places(&mesh)[..6], before[..]);
    mesh.collapse(0, &mut out).unwrap();
    assert!(mesh.geomorphs().is_empty());
    assert_eq!(places(&mesh), before);
    assert_eq!([7, 8].map(|v| mesh.radius(v)), [0.25, 0.5]);
}

#[test]
fn a_step_of_a_vertex_sweeps_the_points_between_the_surfaces() {
    let mut mesh = hexagon(1).with_geomorphs(2);
    mesh.set_base_vertex(0, [0.0, 0.0, 2.0], Certified::EXACT);
    mesh.load(0, &record(0, 3), 0, [0, 5, 2, 3], [Certified::EXACT; 2]);
    let mut out = OperationFaces::new();
    mesh.split(0, &mut out).unwrap();
    mesh.start_split_geomorph(&out);
    // Under the tip, over the flat front that the split leads to.
    let point = DVec3::new(0.01, 0.02, 1.0);
    let mut passed = 0;
    for k in 1..=8 {
        for index in 0..2 {
            let geomorph = mesh.geomorphs()[index];
            mesh.faces_around_geomorph(&geomorph, &mut out).unwrap();
            mesh.step_geomorph(index, f64::from(k) / 8.0, &out);
            passed += u32::from(mesh.swept_over(&out, point));
        }
    }
    mesh.finish_geomorphs();
    assert_eq!(passed, 1, "it is passed once");
    assert!(mesh.geomorphs().is_empty());
}

/// In any order, whichever face is set again: what the links of all faces say at the end.
#[test]
fn the_base_mesh_is_consistent_where_all_links_are_mutual() {
    let face = |k: u32| {
        (
            [0, 1 + k, 1 + (k + 1) % 6],
            [NONE, (k + 1) % 6, (k + 5) % 6],
        )
    };
    let mut mesh = hexagon(1);
    let mut set = |k: u32, (corners, neighbours): ([u32; 3], [u32; 3])| {
        mesh.set_base_face(k, corners, neighbours).unwrap();
        mesh.base_is_consistent()
    };
    assert!(set(3, face(3)), "the same again");
    let ([a, b, c], [x, y, z]) = face(3);
    // A link to nowhere, to a face that is elsewhere, and a face that is turned over.
    assert!(!set(3, ([a, b, c], [x, NONE, z])));
    assert!(set(3, face(3)));
    assert!(!set(3, ([a, b, c], [1, y, z])));
    assert!(set(3, face(3)));
    assert!(!set(3, ([a, c, b], [x, y, z])));
    assert!(set(3, face(3)));
    // Faces that have not come yet, in another order.
    mesh.begin_clear();
    mesh.forget_base_faces(0..6);
    for (count, k) in (1..).zip([4, 0, 5, 2, 1, 3]) {
        let (corners, neighbours) = face(k);
        mesh.set_base_face(k, corners, neighbours).unwrap();
        assert_eq!(mesh.base_is_consistent(), count == 6);
    }
}

/// Also where one vertex of a split finishes, or is split itself, before the other.
#[test]
fn a_face_moves_exactly_while_a_corner_has_a_geomorph() {
    let mut mesh = hexagon(2).with_geomorphs(4);
    mesh.set_base_vertex(0, [0.0, 0.0, 0.5], Certified::EXACT);
    mesh.load(0, &record(0, 3), 0, [0, 5, 2, 3], [Certified::EXACT; 2]);
    // Of vertex 7, vt of the first: between faces 0 and 1, and between 2 and 7.
    mesh.load(1, &record(1, 3), 7, [1, 0, 2, 7], [Certified::EXACT; 2]);
    let mut out = OperationFaces::new();
    let moving = |mesh: &ActiveMesh| {
        mesh.check();
        let moving: Vec<Handle> = mesh.geomorphs().iter().map(Geomorph::vertex).collect();
        for face in 0..10 {
            let mut corners = mesh.face(face).corners.iter();
            let expected = corners.any(|corner| moving.contains(corner));
            assert_eq!(mesh.any_geomorphing(&[face]), expected, "face {face}");
        }
        moving.len()
    };
    mesh.split(0, &mut out).unwrap();
    assert_eq!(moving(&mesh), 0);
    mesh.start_split_geomorph(&out);
    assert_eq!(moving(&mesh), 2);
    for left in [1, 0] {
        let geomorph = mesh.geomorphs()[0];
        mesh.faces_around_geomorph(&geomorph, &mut out).unwrap();
        mesh.step_geomorph(0, 1.0, &out);
        mesh.finish_geomorphs();
        assert_eq!(moving(&mesh), left);
    }
    mesh.start_collapse_geomorph(0);
    assert_eq!(moving(&mesh), 2);
    mesh.reverse_geomorphs(0);
    mesh.split(1, &mut out).unwrap();
    assert_eq!(moving(&mesh), 1, "vertex 8");
    mesh.start_split_geomorph(&out);
    assert_eq!(moving(&mesh), 3);
    mesh.collapse(1, &mut out).unwrap();
    assert_eq!(moving(&mesh), 1);
    advance_all(&mut mesh, 1.0, &mut out);
    assert_eq!(moving(&mesh), 0);
    mesh.start_collapse_geomorph(0);
    mesh.collapse(0, &mut out).unwrap();
    assert_eq!(moving(&mesh), 0);
    mesh.split(0, &mut out).unwrap();
    mesh.start_split_geomorph(&out);
    mesh.begin_clear();
    assert!(mesh.geomorphs().is_empty());
    assert_eq!(mesh.states[0].performed, Performed::AtRest);
}

/// So that a recording's twin, and its keyframes, are as large as what a run has used.
#[test]
fn slots_that_were_never_used_are_not_written() {
    let mut mesh = ActiveMesh::new(0, 0, 1 << 16);
    assert_eq!(mesh.reshape(7, 6), Some((1 << 16) - 4));
    let lengths = |mesh: &ActiveMesh| [mesh.vertices.len(), mesh.faces.len(), mesh.links.len()];
    assert_eq!(lengths(&mesh), [0; 3]);
    let whole = hexagon(0);
    for v in 0..7 {
        let at = whole.position(v).to_array();
        mesh.set_base_vertex(v, at, Certified::EXACT);
    }
    // The neighbours of the first one have not come yet.
    for k in 0..6 {
        let face = whole.face(k);
        mesh.set_base_face(k, face.corners, face.neighbours)
            .unwrap();
    }
    assert!(mesh.base_is_consistent());
    mesh.load(0, &record(0, 3), 0, [0, 5, 2, 3], [Certified::EXACT; 2]);
    mesh.split(0, &mut OperationFaces::new()).unwrap();
    mesh.check();
    assert_eq!(lengths(&mesh), [9, 8, 1]);
    // Those of another model begin elsewhere, also where more of them are to be unused than were
    // ever set.
    mesh.begin_clear();
    assert_eq!(mesh.forget_slots(0..2), 6..10);
    mesh.forget_base_faces(0..6);
    assert!(mesh.faces.iter().all(|of| *of == Face::UNUSED));
    assert_eq!(mesh.reshape(3, 1), Some((1 << 16) - 2));
    assert_eq!(lengths(&mesh), [9, 8, 1]);
}
