//! The hard cases, each with its measure, its limit, and a fault in the product under which it must
//! fail.
//!
//! The pure cores run in virtual time with the product's defaults; where a case departs from them
//! it says so, and why. The loop is closed by the simulated device. Energy is measured at the
//! device, by force times motion. Every run repeats.
//!
//! | file | cases |
//! |---|---|
//! | `walls` | energy, onset and creep of the force, the encoder |
//! | `missed` | ticks that are missed in contact |
//! | `sheets` | nothing is passed: thin, sharp, broken, or coarse |
//! | `corners` | ridges, valleys, tips and corners |
//! | `effects`, `toggles` | friction, texture, fields: energy, drift, switching |
//! | `fronts` | a front that moves, files in any unit |
//! | `motion` | objects that are driven onto a probe, or pushed by one |
//! | `rotation` | tools that a hand turns: energy at a device of six degrees of freedom |
//! | `refinement` | splits and collapses under the probe |
//! | `station` | a station that goes away, a cache that is too small |
//! | `disturbances` | jumps, spikes, noise, another scale, a second run |
//! | `fits` | a tool in what it fits: holes, slots, threads |
//! | `tools` | a tool in grooves and pits, on plates and edges, between sheets |
//! | [`mod@bench`], [`mod@setup`], [`mod@device`], `shapes`, `tool_shapes` | a controller that touches one mesh; meshes |
//! | [`contender`] | other proxies in place of the product's |
//! | `changes` | changes of a force, and what is not felt of them |
//! | `slides` | slides along a surface: how the force changes, and that it is there |
//! | [`held_tool`] | a tool in a hand, the loop closed in six degrees of freedom |
//! | [`mod@case`] | a case, the size of its run, its result |

pub mod bench;
pub mod case;
mod changes;
pub mod contender;
mod corners;
pub mod device;
mod disturbances;
mod effects;
mod fits;
mod fronts;
pub mod held_tool;
mod missed;
mod motion;
mod refinement;
mod rotation;
pub mod setup;
mod shapes;
mod sheets;
mod slides;
mod station;
mod toggles;
mod tool_shapes;
mod tools;
pub mod walls;

pub use case::{Case, Found, ProbeOfCase, Size, Trial};

/// The cases of every file, in the order of the table.
const ALL: [&[Case]; 14] = [
    walls::CASES,
    missed::CASES,
    sheets::CASES,
    corners::CASES,
    disturbances::CASES,
    fronts::CASES,
    refinement::CASES,
    station::CASES,
    effects::CASES,
    toggles::CASES,
    motion::CASES,
    fits::CASES,
    tools::CASES,
    rotation::CASES,
];

/// The cases, in the order of the table.
pub fn all() -> impl Iterator<Item = &'static Case> {
    ALL.into_iter().flatten()
}
