//! The proxy of a tool on a plate.

use super::*;
use ab_tree::{AbTree, leaf_key};
use glam::DQuat;
use spm::Certified;

/// The plate is in millimetres.
const METRES_PER_UNIT: f64 = 1e-3;
const CAPSULE: ProbeShape = ProbeShape::Capsule {
    radius_m: 3e-3,
    length_m: 0.02,
    faces: 960,
};

/// There is time for everything.
struct Never;

impl Deadline for Never {
    fn is_over(&mut self) -> bool {
        false
    }
}

/// A plate of two faces.
fn plate() -> (ActiveMesh, AbTree) {
    let mut mesh = ActiveMesh::new(4, 2, 0);
    let corners = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)];
    for (vertex, (x, y)) in (0u32..).zip(corners) {
        mesh.set_base_vertex(vertex, [100.0 * x, 100.0 * y, 0.0], Certified::EXACT);
    }
    let mut tree = AbTree::new(2);
    tree.preconstruct(2);
    for (face, corners) in (0u32..).zip([[0, 1, 2], [3, 2, 1]]) {
        mesh.set_base_face(face, corners, [NONE; 3])
            .expect("the vertices are there");
        tree.insert(face, leaf_key(face, 2));
    }
    tree.refit(|face| mesh.face_box(face));
    (mesh, tree)
}

/// A stylus that is tilted and pressed with its tip is turned against its proxy. The forces of its
/// contacts are those of the coupling all the same, and so is the size of its wrench.
#[test]
fn the_contacts_of_a_tilted_tool_have_the_force_of_the_coupling() {
    let (mesh, tree) = plate();
    let surface = Surface {
        mesh: &mesh,
        tree: &tree,
    };
    let turn = DQuat::from_rotation_y(std::f64::consts::FRAC_PI_4);
    let tool = ToolMesh::of_shape(&CAPSULE).and_then(|mesh| Tool::new(&mesh).ok());
    let tool = tool.expect("it is a tool");
    let heights = tool.local_vertices().iter().map(|&v| (turn * v).z);
    let lowest = heights.fold(f64::INFINITY, f64::min) / METRES_PER_UNIT;
    // Away from the edge between the faces.
    let at = |depth: f64| Pose {
        position: DVec3::new(-60.0, -20.0, -lowest - depth),
        orientation: turn,
    };
    let mut proxy = ProxyKind::new(&CAPSULE);
    proxy.begin(1e-3, METRES_PER_UNIT, Some(at(-1.0)));
    for tick in 0..1000_u32 {
        let depth = (0.01 * f64::from(tick) - 1.0).min(2.0);
        proxy.advance(surface, &at(depth), u32::MAX, &mut Never);
    }
    let plan = SurfacePlan {
        stiffness_n_per_m: 800.0,
        damping_ns_per_m: 0.0,
    };
    let still = Twist::default();
    let (_, [wrench, _], spring) = proxy.render(&at(2.0), METRES_PER_UNIT, &plan, &still);
    let turned = proxy.tool().map(|tool| tool.penetration().angular.length());
    assert!(turned.is_some_and(|angle| angle > 0.05), "{turned:?}");
    let of_spring = (2.0 * spring.stiffness_n_per_m * spring.stored_j).sqrt();
    let size = proxy.wrench_size(&wrench, METRES_PER_UNIT) / of_spring;
    assert!((size - 1.0).abs() < 1e-6, "{size} of the spring's force");
    let (pushes, count) = proxy.pushes(&wrench, METRES_PER_UNIT);
    let sum: DVec3 = pushes[..count].iter().map(|push| push.force).sum();
    let off = sum.distance(wrench.force) / wrench.force.length();
    assert!(off < 1e-3, "{count} contacts: {sum}, {}", wrench.force);
}

/// What a hand cannot perceive is in the units of a model: of the next one it is not known yet.
#[test]
fn a_tool_at_another_model_knows_no_encoder_of_the_one_before() {
    let mut proxy = ProxyKind::new(&CAPSULE);
    proxy.begin(1e-3, METRES_PER_UNIT, None);
    proxy.set_imperceptible(Imperceptible {
        step: 0.0,
        quantization: 5e-6 / METRES_PER_UNIT,
        period_s: 1e-3,
    });
    let offset_m = |proxy: &ProxyKind, metres_per_unit: f64| {
        let tool = proxy.tool().expect("it has begun");
        tool.static_offset() * metres_per_unit
    };
    assert!((offset_m(&proxy, METRES_PER_UNIT) - 5e-6).abs() < 1e-15);
    proxy.invalidate();
    proxy.begin(1e-3, 1.0, None);
    let offset_m = offset_m(&proxy, 1.0);
    assert!(offset_m < 5e-6, "{offset_m} m");
}
