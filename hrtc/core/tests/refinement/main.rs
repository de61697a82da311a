//! Refinement: the front of an object, and the contact and the force while it changes.

#[path = "../common/mod.rs"]
mod common;

mod a_ball_in_a_convex_edge_slides_on;
mod a_stored_base_mesh_loads_in_any_tick;
mod cache_limit;
mod contact_is_at_full_resolution;
mod folds_are_passed;
mod front_is_independent_of_history;
mod global_refinement_is_exact;
mod imperceptible_changes_leave_the_force;
mod known_pairs_are_complete;
mod late_ticks;
mod memory_pressure_coarsens;
mod memory_pressure_over_sizes;
mod refinement_under_contact;
mod small_cache;
mod upkeep_is_bounded;
mod what_passes_over_a_ball_takes_it_along;

use hrtc_core::cache::Cache;

/// Checks that of no part of a cache more was ever in use than there is. All that there is takes no
/// more than its bytes: `tests/cache`.
fn ensure_within_capacity(cache: &Cache) {
    let high = cache.high_water();
    for (used, there) in [high.splits, high.blocks, high.regions, high.faces] {
        assert!(used <= there, "{high:?}");
    }
}
