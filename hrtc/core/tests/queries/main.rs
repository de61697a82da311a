//! Queries: of a point, of a swept sphere, of two bodies; each against a search of all faces.

#[path = "../common/mod.rs"]
mod common;

mod a_small_budget_stops_short;
mod near_faces_are_the_nearest;
mod nearest_hit_equals_brute_force;
mod pair_queries_allocate_nothing;
mod random_queries;
mod ties_go_to_the_least_leaf;
mod two_bodies;
