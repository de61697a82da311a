//! Neither the tick nor the device allocates or frees, whatever happens.

use crate::common::{plan, spm, station, world};
use realtime::counting_allocator::count;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

#[test]
fn over_a_tour_with_loading_evictions_a_silent_link_and_a_restarted_station() {
    assert!(count(|| vec![0u8; 100]) > 0, "the allocator counts");
    let mesh = generate(Shape::Relief, 60_000, 1);
    let model = spm(mesh, &BuildOptions::default());
    let mut plan = plan("");
    plan.cache_bytes = 1 << 20;
    let mut world = world(&plan, &model, 10.0);
    for tick in 0..8000 {
        world.client_mut().link().cut((3000..3400).contains(&tick));
        if tick == 5000 {
            world.start_station(station(&plan, &model, 101));
        }
        world.step_led();
        assert_eq!(world.client().allocations(), 0, "tick {tick}");
    }
    let s = world.summary();
    println!(
        "contact {} of {} ticks, evicted {}, asked again {}",
        s.contact, s.ticks, s.last.evicted, s.last.resubscribed
    );
    assert!(s.contact > 2000 && s.vsplits > 0 && s.ecols > 0);
    assert!(s.last.evicted > 0, "the cache is small enough to evict");
    assert!(s.last.resubscribed > 0, "the restart was met");
}
