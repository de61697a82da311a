//! No query of two bodies, a segment or a capsule touches the heap, nor does moving a tool.

#[path = "common/bodies.rs"]
mod bodies;
mod common;

use bodies::{Front, frame, full_mesh, orientation};
use common::Random;
use hrtc_core::contact::query::{
    Capsule, FacePair, Placed, all_pairs, closest_features, closest_to_capsule, deepest_sample,
    faces_near_capsule, first_pair, local_depth,
};
use hrtc_core::contact::tool::{Tool, capsule_mesh};
use realtime::counting_allocator::{CountingAllocator, count};
use std::ops::ControlFlow;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

#[test]
fn in_any_pose() {
    assert!(count(|| vec![0u8; 100]) > 0, "the allocator counts");
    let whole = full_mesh("cow.obj", 5000);
    let front = Front::of_mesh(&whole);
    let size = front.diagonal();
    let mesh = capsule_mesh(0.03 * size, 0.2 * size, 12, 10);
    let mut tool = Tool::new(&mesh).expect("a capsule is a tool");
    let rest = tool.clone();
    let mut out = vec![FacePair::NONE; 1 << 14];
    let mut random = Random(11);
    let mut met = 0;
    for _ in 0..300 {
        let at = whole.positions[random.below(whole.positions.len() as u64) as usize];
        let to_query = frame(at, orientation(&mut random), 1.0);
        let surface = front.surface();
        let calls = count(|| {
            tool.place(&to_query);
            met += all_pairs(&surface, &tool, u32::MAX, &mut out).count;
            let placed = Placed {
                body: &rest,
                to_query,
            };
            let first = first_pair(&surface, &placed, u32::MAX, None).0;
            let hint = first.map(|pair| (pair.a, pair.b));
            let features = closest_features(&surface, &tool, size, u32::MAX, hint);
            assert_eq!(features.at_least == 0.0, first.is_some());
            let _ = deepest_sample(surface, &tool, u32::MAX, None);
            let _ = local_depth(&surface, &tool, u32::MAX);
            let capsule = Capsule {
                axis: [at, to_query.point(mesh.positions[0])],
                radius: 0.03 * size,
            };
            let _ = closest_to_capsule(surface, capsule, u32::MAX, None);
            let near = |_| ControlFlow::Continue(());
            let _ = faces_near_capsule(surface, capsule, 0.0, u32::MAX, near);
        });
        assert_eq!(calls, 0);
    }
    assert!(met > 1000, "{met}");
}
