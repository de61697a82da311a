//! Neither a query of two bodies nor moving a tool allocates.

use crate::common::fronts::{Front, frame, full_mesh};
use hrtc_core::contact::query::{FacePair, Placed, all_pairs, first_pair};
use hrtc_core::contact::tool::{Tool, capsule_mesh};
use realtime::counting_allocator::count;
use simulator::Random;

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
    let mut random = Random::new(11);
    let mut met = 0;
    for _ in 0..300 {
        let at = whole.positions[random.below(whole.positions.len() as u64) as usize];
        let to_query = frame(at, random.orientation(), 1.0);
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
            assert_eq!(
                first_pair(&surface, &tool, u32::MAX, hint).0.is_some(),
                first.is_some()
            );
        });
        assert_eq!(calls, 0);
    }
    assert!(met > 1000, "{met}");
}
