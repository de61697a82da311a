//! No tick of the tool's proxy allocates: in the air, in contact, and when it is told of a split.

use crate::common::fronts::{Front, full_mesh};
use geometry::Pose;
use glam::{DQuat, DVec3};
use hrtc_core::contact::coupling::Coupling;
use hrtc_core::contact::motion::Twist;
use hrtc_core::contact::rigid_proxy::ToolProxy;
use hrtc_core::contact::tool::{Tool, capsule_mesh};
use realtime::counting_allocator::count;
use spm::OperationFaces;

#[test]
fn in_any_tick() {
    assert!(count(|| vec![0u8; 100]) > 0, "the allocator counts");
    let front = Front::of_mesh(&full_mesh("cow.obj", 5000));
    let size = front.diagonal();
    let mesh = capsule_mesh(0.03 * size, 0.2 * size, 12, 10);
    let tool = Tool::new(&mesh).expect("a capsule is a tool");
    let mut proxy = ToolProxy::new(tool, 1.0).expect("it has an extent");
    let middle = 0.5 * (front.lower + front.upper);
    let none = OperationFaces::new();
    let spring = Coupling {
        stiffness_n_per_m: 1.0,
        damping_ns_per_m: 0.1,
    };
    let mut contacts = 0;
    for k in 0..1000 {
        let t = 0.002 * f64::from(k);
        let pose = Pose {
            position: middle + DVec3::Z * size * (1.0 - t),
            orientation: DQuat::from_rotation_x(3.0 * t),
        };
        let calls = count(|| {
            proxy.carry(&front.mesh, &none);
            contacts += proxy
                .advance(front.surface(), &pose, 1 << 16)
                .contacts()
                .len();
            let _ = proxy.wrench(&spring, 1.0, &Twist::default());
            assert!(proxy.clearance() >= 0.0);
        });
        assert_eq!(calls, 0);
    }
    assert!(contacts > 100, "{contacts}");
}
