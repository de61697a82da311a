//! Whole scenes: both cores and a link, in virtual time.

#[path = "../common/mod.rs"]
mod common;

mod any_input;
mod compact_chunks;
mod effects;
mod effects_of_tools;
mod far_station;
mod far_tour;
mod faulty_link;
mod faulty_models;
mod force_steps;
mod implausible_samples;
mod importance;
mod moving_bodies;
mod moving_objects;
mod nothing_falls_through;
mod places;
mod policies;
mod rates;
mod replay;
mod several_clients;
mod several_objects;
mod skipped_periods;
mod stalls;
mod tick_allocates_nothing;
