//! Rigid tools: contact, force and torque, alone on a surface and as probes of a scene.

#[path = "../common/mod.rs"]
mod common;

mod allocates_nothing;
mod catches_up;
mod contact;
mod drag;
mod in_scenes;
mod issues_of_collision_libraries;
mod issues_of_sweeps;
mod sheets;
mod stays_out;
mod stuck;
